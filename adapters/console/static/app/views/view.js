/**
 * A view: its elements and its state are fields, `start` subscribes to what it shows, handlers change the
 * state, and `render` draws it.
 */

import { eachFrame } from "../dom.js";

/** @import { Context } from "../model/context.js" */

export class View {
  /** @type {HTMLElement} */
  root;
  /** Have it drawn in the next frame. */
  draw = eachFrame(() => this.render());

  /** @param {Context} context */
  constructor({ session, shown, asset, selection, cursor, span, draft }) {
    this.session = session;
    this.shown = shown;
    this.asset = asset;
    this.selection = selection;
    this.cursor = cursor;
    this.span = span;
    this.draft = draft;
  }

  /** Put one into an element. @param {HTMLElement} element @param {Context} context @returns {() => void} takes it out again */
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

  /** Subscribe to what it shows. @returns {(() => void)[]} what ends with it */
  start() {
    return [];
  }

  render() {}
}
