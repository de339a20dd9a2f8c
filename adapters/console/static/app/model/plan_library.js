/**
 * Plans to begin with: drafts that operators stored, shared by all consoles, the templates of `config/plans`, and
 * the plans submitted at the console.
 */

import { fetchJson } from "./connection.js";
import { Observable } from "./observable.js";

/** @import { PlanContent } from "./plan_draft.js" */
/** @import { PlanRevision } from "./messages.js" */
/** @typedef {{group: string, name: string, read: () => Promise<Partial<PlanContent>>}} LibraryEntry */

/** Prefix of the keys of drafts, before the name of the plan. */
const DRAFT = "plan-draft:";
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
    const drafts = (stored.objects ?? []).map((each) => each.key).filter((key) => key.startsWith(DRAFT));
    this.submitted = sent.plans ?? [];
    const newest = this.submitted.filter((each, index, all) => all.findIndex(({ plan }) => plan === each.plan) === index);
    this.entries = [
      ...drafts.map((key) => ({ group: "drafts", name: key.slice(DRAFT.length), read: () => this.#read(key) })),
      ...(templates.templates ?? []).map(({ name, xml }) => ({ group: "templates", name, read: async () => ({ name, xml }) })),
      ...newest.map(({ plan, revision }) => ({ group: "submitted", name: plan, read: () => this.readRevision(revision) })),
    ];
    this.changed();
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

  /** Store a draft. One that another operator changed since this page read it is not overwritten. @param {PlanContent} value */
  async save(value) {
    const key = DRAFT + value.name;
    const known = this.#revisions.get(key);
    const headers = known === undefined ? { "If-None-Match": "*" } : { "If-Match": `"${known}"` };
    try {
      const { revision } = await fetchJson(path(key), { method: "PUT", json: { value }, headers });
      this.#revisions.set(key, revision);
    } catch (error) {
      if (error.status !== 412) throw error;
      throw new Error(`there is a newer draft ${value.name}: open it first, or use another name`);
    }
    await this.refresh();
  }

  /** Whether this page has read a draft, and may delete it. @param {string} name */
  has(name) {
    return this.#revisions.has(DRAFT + name);
  }

  /** @param {string} name */
  async remove(name) {
    const key = DRAFT + name;
    await fetchJson(path(key), { method: "DELETE", headers: { "If-Match": `"${this.#revisions.get(key)}"` } });
    this.#revisions.delete(key);
    await this.refresh();
  }
}
