/** A check of the plan in preparation by the rover: `check`, `prove` or `try`, and its result until the plan changes. */

import { fetchJson } from "./connection.js";
import { Observable } from "./observable.js";

/** @import { DraftCheck } from "./messages.js" */
/** @import { PlanDraft } from "./plan_draft.js" */
/** @typedef {"check" | "prove" | "try"} CheckLevel */

export class PlanCheck extends Observable {
  /** the plan that was checked, as text */
  #content = "";
  /** @type {AbortController | null} ends the request */
  #request = null;
  /** @type {CheckLevel | ""} of the last check; empty before */
  level = "";
  /** @type {DraftCheck | null} */
  result = null;
  /** why there is no result */
  error = "";
  began_ms = 0;

  /** @param {PlanDraft} plan */
  constructor(plan) {
    super();
    this.plan = plan;
  }

  get isRunning() {
    return this.#request !== null;
  }

  /** Whether the plan was changed since. */
  get isOld() {
    return this.#content !== JSON.stringify(this.plan.content);
  }

  /** Call the running check off: its result is not shown. */
  cancel() {
    this.#request?.abort();
  }

  /** @param {CheckLevel} level @param {number | null} draws number of runs of `try` */
  async run(level, draws = null) {
    const request = new AbortController();
    this.#request = request;
    this.#content = JSON.stringify(this.plan.content);
    Object.assign(this, { level, result: null, error: "", began_ms: Date.now() });
    this.changed();
    const { name, steps, xml } = this.plan.content;
    const json = { plan: name.trim() || "plan", level, ...(draws && { draws }), ...(xml === null ? { steps } : { xml }) };
    try {
      this.result = await fetchJson(`/api/plans/${encodeURIComponent(this.plan.asset.name)}/check`, { json, signal: request.signal });
    } catch (error) {
      this.error = request.signal.aborted ? "called off" : error.message;
    }
    this.#request = null;
    this.changed();
  }

  /** The findings of the present plan. */
  get #findings() {
    return this.isOld ? [] : (this.result?.findings ?? []);
  }

  /** The findings at a step, as texts. @param {number} index */
  atStep(index) {
    return this.#findings.filter(({ step }) => step === index).map(textOf);
  }

  /** The findings at a line of the XML, as texts. @param {number} line */
  atLine(line) {
    return this.#findings.filter((each) => each.line === line).map(textOf);
  }
}

/** @param {{level: string, text: string}} finding */
const textOf = ({ level, text }) => `${level}: ${text}`;
