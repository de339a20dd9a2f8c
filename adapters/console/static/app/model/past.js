/**
 * What an asset did over time: modes, authority, plans and alarms from the archive, and from then on as the
 * page hears of it. Commands are put to those of the asset.
 */

import { ask } from "./connection.js";

/** @import { AlarmStatus } from "./messages.js" */
/** @import { Asset } from "./asset.js" */
/** @import { Session } from "./session.js" */
/** @typedef {{utc: number, [name: string]: any}} Told */
/** @typedef {"modes" | "authority" | "plans"} Kind */

const MOST = 1000;
/** Commands that were made before, and may go on. */
const BEFORE = 20;
/** What is read beside what is asked for, of its length: so that a step back needs no reading. */
const MARGIN = 0.5;

export class Past {
  #reading = 0;
  #asset;
  #session;
  #offs;
  /** @type {[number, number]} from when to when it is known */
  #known = [Infinity, -Infinity];
  /** @type {Record<Kind, Told[]>} in the order of time; the first may be from before */
  told = { modes: [], authority: [], plans: [] };
  /** @type {AlarmStatus[]} */
  alarms = [];
  /** why it could not be read; empty where it could */
  problem = "";

  /** @param {Session} session @param {Asset} asset @param {() => void} changed called when there is more */
  constructor(session, asset, changed) {
    this.#session = session;
    this.#asset = asset;
    this.changed = changed;
    this.#offs = [
      session.connection.on(() => this.#forget()),
      asset.on("status", () => this.#hear("modes", asset.status)),
      asset.on("authority", () => this.#hear("authority", asset.authority)),
      asset.on("plans", () => [...asset.plans.values()].forEach((each) => this.#hear("plans", each))),
      session.on("alarms", (alarm) => alarm?.asset === asset.name && this.#hearAlarms([alarm])),
    ];
  }

  /** Have a span read, where it is not known. @param {number} start_s @param {number} end_s */
  async look(start_s, end_s) {
    const until = Math.min(end_s, this.#session.now);
    if (start_s >= this.#known[0] && until <= this.#known[1]) return;
    const margin = (end_s - start_s) * MARGIN;
    const [start, end] = [start_s - margin, end_s + margin];
    // What comes from now on is heard.
    this.#known = [start, end >= this.#session.now ? Infinity : end];
    const reading = ++this.#reading;
    try {
      const found = await this.#read(start, end);
      if (reading !== this.#reading) return;
      this.problem = "";
      this.told = found.told;
      this.alarms = found.alarms;
      for (const command of found.commands) if (!this.#asset.commands.has(command.id)) this.#asset.setCommand(command);
      this.#hearAlarms([...this.#session.alarms.values()].filter((each) => each.asset === this.#asset.name));
    } catch (error) {
      if (reading !== this.#reading) return;
      this.problem = error.message;
    }
    this.changed();
  }

  /** Have all read anew, once the server is back: what was told meanwhile is not known. */
  #forget() {
    if (this.#session.connection.status !== "open") return;
    this.#known = [Infinity, -Infinity];
    this.changed();
  }

  close() {
    this.#offs.forEach((off) => off());
  }

  async #read(start, before) {
    const name = encodeURIComponent(this.#asset.name);
    const get = async (path, what, query) => (await ask(`/api/${path}?asset=${name}&before=${before}&${query}`))[what];
    const all = `start=${start}&limit=${MOST}`;
    const records = async (ty) => {
      const [last, within] = await Promise.all([
        ask(`/api/records/${ty}?asset=${name}&before=${start}&limit=1`),
        get(`records/${ty}`, "records", all),
      ]);
      return [...within, ...last.records].reverse();
    };
    // A recording tells of the mode with its tree.
    const [modes, authority, plans, alarms, commands, earlier] = await Promise.all([
      records(this.#asset.recording ? "tree" : "asset"),
      records("auth"),
      records("plan"),
      get("alarms", "alarms", `limit=${MOST}`),
      get("commands", "commands", all),
      ask(`/api/commands?asset=${name}&before=${start}&limit=${BEFORE}`),
    ]);
    const heard = (kind, known) => {
      const last = known.at(-1)?.utc ?? -Infinity;
      return before < this.#session.now ? known : [...known, ...this.told[kind].filter((each) => each.utc > last)];
    };
    return {
      told: { modes: heard("modes", modes), authority: heard("authority", authority), plans: heard("plans", plans) },
      alarms: alarms.reverse(),
      commands: [...commands, ...earlier.commands],
    };
  }

  /** @param {Kind} kind @param {Told} message */
  #hear(kind, message) {
    const known = this.told[kind];
    const isSame = (each) => each.utc === message.utc && each.plan === message.plan && each.link === message.link;
    if (known.some(isSame)) return;
    const before = known.findLastIndex((each) => each.utc <= message.utc);
    known.splice(before + 1, 0, message);
    this.changed();
  }

  /** @param {AlarmStatus[]} alarms as they are now */
  #hearAlarms(alarms) {
    const ids = new Set(alarms.map((each) => each.id));
    this.alarms = [...this.alarms.filter((each) => !ids.has(each.id)), ...alarms];
    this.changed();
  }
}
