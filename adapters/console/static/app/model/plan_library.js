/**
 * Plans to begin with: drafts and templates that operators stored, shared by all consoles, the templates of
 * `config/plans`, and the plans submitted at the console.
 */

import { fetchJson } from "./connection.js";
import { Observable } from "./observable.js";

/** @import { PlanContent } from "./plan_draft.js" */
/** @import { PlanRevision } from "./messages.js" */
/** @typedef {"draft" | "template"} Kind */
/** @typedef {{group: string, name: string, read: () => Promise<Partial<PlanContent>>}} LibraryEntry */

/** Keys of the stored objects, with the name of the plan behind them. */
const PREFIXES = { draft: "plan-draft:", template: "plan-template:" };
const path = (key) => `/api/objects/${encodeURIComponent(key)}`;

export class PlanLibrary extends Observable {
  /** @type {Map<string, number>} revisions that this page has read or written, by key */
  #revisions = new Map();
  /** @type {LibraryEntry[]} */
  entries = [];
  /** @type {PlanRevision[]} plans submitted at the console, newest first */
  submitted = [];

  /** @param {string} asset */
  constructor(asset) {
    super();
    this.path = `/api/plans/${encodeURIComponent(asset)}`;
  }

  /** Read the lists. */
  async refresh() {
    const [stored, templates, sent] = await Promise.all(
      ["/api/objects", "/api/plans/templates", this.path].map((each) => fetchJson(each).catch(() => ({}))),
    );
    const keys = (stored.objects ?? []).map((each) => each.key);
    this.submitted = sent.plans ?? [];
    const newest = this.submitted.filter((each, index, all) => all.findIndex(({ plan }) => plan === each.plan) === index);
    this.entries = [
      ...this.#stored("draft", keys),
      ...this.#stored("template", keys),
      ...(templates.templates ?? []).map(({ name, xml }) => ({ group: "templates", name, read: async () => ({ name, xml }) })),
      ...newest.map(({ plan, revision }) => ({ group: "submitted", name: plan, read: () => this.readRevision(revision) })),
    ];
    this.changed();
  }

  /** @param {Kind} kind @param {string[]} keys @returns {LibraryEntry[]} */
  #stored(kind, keys) {
    const prefix = PREFIXES[kind];
    const own = keys.filter((each) => each.startsWith(prefix));
    return own.map((key) => ({ group: `${kind}s`, name: key.slice(prefix.length), read: () => this.#read(key) }));
  }

  async #read(key) {
    const { revision, value } = await fetchJson(path(key));
    this.#revisions.set(key, revision);
    return value;
  }

  /** @param {number} revision of a submitted plan @returns {Promise<Partial<PlanContent>>} */
  async readRevision(revision) {
    const { plan, content } = await fetchJson(`${this.path}/${revision}`);
    return { name: plan, xml: content };
  }

  /** Store a plan. One that another operator changed since this page read it is not overwritten. @param {Kind} kind @param {PlanContent} value */
  async save(kind, value) {
    const key = PREFIXES[kind] + value.name;
    const known = this.#revisions.get(key);
    const headers = known === undefined ? { "If-None-Match": "*" } : { "If-Match": `"${known}"` };
    try {
      const { revision } = await fetchJson(path(key), { method: "PUT", json: { value }, headers });
      this.#revisions.set(key, revision);
    } catch (error) {
      if (error.status !== 412) throw error;
      throw new Error(`there is a newer ${kind} ${value.name}: open it first, or use another name`);
    }
    await this.refresh();
  }

  /** Whether this page may delete a stored plan. @param {Kind} kind @param {string} name */
  has(kind, name) {
    return this.#revisions.has(PREFIXES[kind] + name);
  }

  /** @param {Kind} kind @param {string} name */
  async remove(kind, name) {
    const key = PREFIXES[kind] + name;
    await fetchJson(path(key), { method: "DELETE", headers: { "If-Match": `"${this.#revisions.get(key)}"` } });
    this.#revisions.delete(key);
    await this.refresh();
  }
}
