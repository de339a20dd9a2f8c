/** The remaining steps of the plans aboard, now or at a time. The rover is queried for the steps of each plan that is shown. */

import { ArchivedHistory } from "./archive.js";
import { fetchJson } from "./connection.js";

/** @import { Asset } from "./asset.js" */
/** @import { PlanProgress, RouteStep } from "./messages.js" */
/** @import { Session } from "./session.js" */
/** @typedef {{progress: PlanProgress, isActive: boolean, steps: RouteStep[]}} PlanRoute */

const ACTIVE = ["ACTIVATED", "EXECUTING"];
const HISTORY_S = 3600;
/** Grid of the start positions of plans that have not started, m. */
const START_M = 0.5;
const MAX_QUERIES = 100;
/** Status of HTTP for a rover that did not answer in time. */
const UNAVAILABLE = 503;
const RETRY_MS = 3000;
const MAX_RECEIVED = 1000;

export class PlanRoutes {
  #session;
  #asset;
  #changed;
  #offs;
  /** @type {Set<PlanProgress>} received progress, which the archive may not have yet */
  #received = new Set();
  /** @type {ArchivedHistory | null} */
  #history = null;
  /** @type {Map<string, RouteStep[] | null>} steps by query; null until received */
  #steps = new Map();
  /** @type {Map<string, RouteStep[]>} the last received steps of each plan */
  #last = new Map();
  /** @type {Map<string, number>} time of the last submission of each plan */
  #submitted = new Map();

  /** @param {Session} session @param {Asset} asset @param {() => void} changed called after each update */
  constructor(session, asset, changed) {
    this.#session = session;
    this.#asset = asset;
    this.#changed = changed;
    // Queries may have failed while the link was down.
    this.#offs = [asset.on("links", () => this.#steps.clear()), asset.on("plans", () => this.#receive())];
    this.#receive();
  }

  #receive() {
    for (const each of this.#asset.plans.values()) this.#received.add(each);
    if (this.#received.size > MAX_RECEIVED) this.#received.delete([...this.#received][0]);
  }

  close() {
    this.#offs.forEach((off) => off());
    this.#history?.close();
    this.#changed = () => {};
  }

  /** The active and suspended plans, and the last submitted one. @param {number | null} utc_s null for now @returns {PlanRoute[]} */
  at(utc_s) {
    const aboard = this.#progressAt(utc_s).filter((each) => ["SUBMITTED", "SUSPENDED", ...ACTIVE].includes(each.status) && !this.#asset.isRemoved(each, utc_s));
    const waiting = aboard.filter((each) => each.status === "SUBMITTED").sort((one, other) => other.utc - one.utc);
    const started = aboard.filter((each) => each.status !== "SUBMITTED");
    return [...started, ...waiting.slice(0, 1)].map((progress) => ({
      progress,
      isActive: ACTIVE.includes(progress.status),
      steps: this.#stepsOf(progress),
    }));
  }

  /** @param {number | null} utc_s @returns {PlanProgress[]} */
  #progressAt(utc_s) {
    const now = this.#asset.plans;
    for (const each of now.values()) if (each.status === "SUBMITTED") this.#submitted.set(each.plan, each.utc);
    if (utc_s === null) return [...now.values()];
    this.#history ??= new ArchivedHistory(this.#session, this.#asset, this.#changed);
    this.#history.load(utc_s - HISTORY_S, Math.max(utc_s, this.#session.now));
    const archived = /** @type {PlanProgress[]} */ (this.#history.records.plans);
    const records = [...archived, ...this.#received].sort((one, other) => one.utc - other.utc);
    const found = new Map(records.filter((each) => each.utc <= utc_s).map((each) => [each.plan, each]));
    // The rover stores the last submission only.
    const isReplaced = ({ plan, utc }) => records.some((each) => each.plan === plan && each.status === "SUBMITTED" && each.utc > utc);
    return [...found.values()].filter((each) => !isReplaced(each));
  }

  /** @param {PlanProgress} progress */
  #stepsOf({ plan, node, done, utc }) {
    const pose = (node === null ? this.#asset.pose : this.#asset.poseAt(utc)) ?? this.#asset.pose;
    const start = pose && [pose.x, pose.y, pose.heading];
    const area = node === null && start ? start.map((each) => Math.round(each / START_M)).join() : "";
    const key = [plan, this.#submitted.get(plan), node, done, area].join(" ");
    if (!this.#steps.has(key)) this.#fetch(key, plan, { ...(start && { start: start.join() }), ...(node !== null && { node }), ...(done && { done: String(done) }) });
    return this.#steps.get(key) ?? this.#last.get(plan) ?? [];
  }

  /** @param {string} key @param {string} plan @param {Record<string, string>} query */
  async #fetch(key, plan, query) {
    if (this.#steps.size > MAX_QUERIES) this.#steps.clear();
    this.#steps.set(key, null);
    const path = `/api/plans/${encodeURIComponent(this.#asset.name)}/${encodeURIComponent(plan)}/steps?${new URLSearchParams(query)}`;
    try {
      const { steps } = await fetchJson(path);
      this.#steps.set(key, steps);
      this.#last.set(plan, steps);
    } catch (error) {
      console.info(error.message);
      if (error.status !== UNAVAILABLE) this.#steps.set(key, []);
      else setTimeout(() => (this.#steps.delete(key), this.#changed()), RETRY_MS);
    }
    this.#changed();
  }
}
