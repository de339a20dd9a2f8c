/**
 * Base class of views. Elements and state are fields, `start` subscribes to observables, handlers change
 * the state, and `render` draws it.
 */

import { eachFrame } from "../dom.js";

/** @import { Context } from "../model/context.js" */

export class View {
  /** @type {HTMLElement} */
  root;
  /** Schedule drawing in the next frame. */
  draw = eachFrame(() => this.render());

  /** @param {Context} context */
  constructor({ session, shown, asset, selection, cursor, span, draft, plan }) {
    this.session = session;
    this.shown = shown;
    this.asset = asset;
    this.selection = selection;
    this.cursor = cursor;
    this.span = span;
    this.draft = draft;
    this.plan = plan;
  }

  /** Create a view in an element. @param {HTMLElement} element @param {Context} context @returns {() => void} removes it */
  static mount(element, context) {
    const view = new this(context);
    element.append(view.root);
    const ends = view.start();
    view.draw();
    return () => {
      ends.forEach((end) => end());
      view.root.remove();
    };
  }

  /** Subscribe to the shown data. @returns {(() => void)[]} functions that end the subscriptions */
  start() {
    return [];
  }

  render() {}
}
