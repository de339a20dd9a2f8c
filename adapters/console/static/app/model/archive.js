/**
 * The history of an asset: modes, authority, plans and alarms, read from the archive and continued with the
 * messages that the page receives. Commands are added to those of the asset.
 */

import { fetchJson } from "./connection.js";

/** @import { AlarmStatus } from "./messages.js" */
/** @import { Asset } from "./asset.js" */
/** @import { Session } from "./session.js" */
/** @typedef {{utc: number, [name: string]: any}} ArchivedRecord */
/** @typedef {"modes" | "authority" | "plans"} Kind */

const MAX_RECORDS = 1000;
/** Number of commands read from before the span, since they may extend into it. */
const MAX_EARLIER_COMMANDS = 20;
/** Margin that is read on both sides, as a share of the span: a small shift then needs no request. */
const MARGIN = 0.5;

export class ArchivedHistory {
  #reading = 0;
  #asset;
  #session;
  #offs;
  /** @type {[number, number]} the loaded interval */
  #loaded = [Infinity, -Infinity];
  /** @type {Record<Kind, ArchivedRecord[]>} in the order of time; the first may precede the interval */
  records = { modes: [], authority: [], plans: [] };
  /** @type {AlarmStatus[]} */
  alarms = [];
  /** why reading failed; empty if it succeeded */
  problem = "";

  /** @param {Session} session @param {Asset} asset @param {() => void} changed called after each update */
  constructor(session, asset, changed) {
    this.#session = session;
    this.#asset = asset;
    this.changed = changed;
    this.#offs = [
      session.connection.on(() => this.#invalidate()),
      asset.on("status", () => this.#add("modes", asset.status)),
      asset.on("authority", () => this.#add("authority", asset.authority)),
      asset.on("plans", () => [...asset.plans.values()].forEach((each) => this.#add("plans", each))),
      session.on("alarms", (alarm) => alarm?.asset === asset.name && this.#addAlarms([alarm])),
    ];
  }

  /** Load a span, unless it is loaded already. @param {number} start_s @param {number} end_s */
  async load(start_s, end_s) {
    const until = Math.min(end_s, this.#session.now);
    if (start_s >= this.#loaded[0] && until <= this.#loaded[1]) return;
    const margin = (end_s - start_s) * MARGIN;
    const [start, end] = [start_s - margin, end_s + margin];
    // Later records arrive as messages.
    this.#loaded = [start, end >= this.#session.now ? Infinity : end];
    const reading = ++this.#reading;
    try {
      const found = await this.#read(start, end);
      if (reading !== this.#reading) return;
      this.problem = "";
      this.records = found.records;
      this.alarms = found.alarms;
      for (const command of found.commands) if (!this.#asset.commands.has(command.id)) this.#asset.setCommand(command);
      this.#addAlarms([...this.#session.alarms.values()].filter((each) => each.asset === this.#asset.name));
    } catch (error) {
      if (reading !== this.#reading) return;
      this.problem = error.message;
    }
    this.changed();
  }

  /** Discard the loaded interval after a reconnection: messages of the outage are missing. */
  #invalidate() {
    if (this.#session.connection.status !== "open") return;
    this.#loaded = [Infinity, -Infinity];
    this.changed();
  }

  close() {
    this.#offs.forEach((off) => off());
  }

  async #read(start, before) {
    const name = encodeURIComponent(this.#asset.name);
    const get = async (path, what, query) => (await fetchJson(`/api/${path}?asset=${name}&before=${before}&${query}`))[what];
    const all = `start=${start}&limit=${MAX_RECORDS}`;
    const readRecords = async (ty) => {
      const [last, within] = await Promise.all([
        fetchJson(`/api/records/${ty}?asset=${name}&before=${start}&limit=1`),
        get(`records/${ty}`, "records", all),
      ]);
      return [...within, ...last.records].reverse();
    };
    // In a recording the tree reports the mode.
    const [modes, authority, plans, alarms, commands, earlier] = await Promise.all([
      readRecords(this.#asset.recording ? "tree" : "asset"),
      readRecords("auth"),
      readRecords("plan"),
      get("alarms", "alarms", `limit=${MAX_RECORDS}`),
      get("commands", "commands", all),
      fetchJson(`/api/commands?asset=${name}&before=${start}&limit=${MAX_EARLIER_COMMANDS}`),
    ]);
    const merged = (kind, known) => {
      const last = known.at(-1)?.utc ?? -Infinity;
      return before < this.#session.now ? known : [...known, ...this.records[kind].filter((each) => each.utc > last)];
    };
    return {
      records: { modes: merged("modes", modes), authority: merged("authority", authority), plans: merged("plans", plans) },
      alarms: alarms.reverse(),
      commands: [...commands, ...earlier.commands],
    };
  }

  /** @param {Kind} kind @param {ArchivedRecord} message */
  #add(kind, message) {
    const known = this.records[kind];
    const isSame = (each) => each.utc === message.utc && each.plan === message.plan && each.link === message.link;
    if (known.some(isSame)) return;
    const before = known.findLastIndex((each) => each.utc <= message.utc);
    known.splice(before + 1, 0, message);
    this.changed();
  }

  /** @param {AlarmStatus[]} alarms in their present states */
  #addAlarms(alarms) {
    const ids = new Set(alarms.map((each) => each.id));
    this.alarms = [...this.alarms.filter((each) => !ids.has(each.id)), ...alarms];
    this.changed();
  }
}
