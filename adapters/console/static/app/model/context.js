/**
 * The context of a view. `mount(element, context)` puts the view into an element and returns a function that
 * removes it. Views of the same asset share selection, time cursor, draft and plan.
 */

import { Draft } from "./draft.js";
import { PlanDraft } from "./plan_draft.js";
import { Cursor, Selection, Span } from "./selection.js";

/**
 * @typedef {object} Context
 * @property {import("./session.js").Session} session
 * @property {{name: string | null, choose: (name: string) => void}} [shown] the asset that the page shows
 * @property {import("./asset.js").Asset} [asset]
 * @property {Selection} [selection]
 * @property {Cursor} [cursor]
 * @property {Span} [span]
 * @property {Draft & import("../views/map.js").Marked & {hint?: string}} [draft] `hint`: effect of a click on the map
 * @property {PlanDraft} [plan]
 */

/** @type {Map<string, Context>} */
const contexts = new Map();
/** Time cursor of the page, shared by all rovers. */
export const cursor = new Cursor();
export const span = new Span();

/**
 * @param {import("./session.js").Session} session
 * @param {string} name of the asset
 * @returns {Context}
 */
export function contextOf(session, name) {
  const asset = session.asset(name);
  let context = contexts.get(name);
  if (context?.asset !== asset) {
    context = { session, asset, cursor, span, selection: new Selection(), draft: new Draft(asset), plan: new PlanDraft(asset) };
    contexts.set(name, context);
  }
  return context;
}
