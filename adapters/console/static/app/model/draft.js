/**
 * A command in preparation for one asset: its entry, its arguments as typed, and its preview. The form
 * fills it and the map shows it; it is only sent from the form.
 */

import { fetchJson, operator } from "./connection.js";
import { Observable } from "./observable.js";
import { number, unitOf } from "../format.js";

const DEBOUNCE_MS = 250;
/** Minimum time from a send until the same form can be sent again. */
const REARM_MS = 1000;
/** Motion of the rover after which a preview is requested again, and the minimum time between such requests. */
const MOVED_M = 0.05;
const MOVED_RAD = 0.035;
const REFRESH_MS = 2000;
/** Bounds of the precondition "where it is shown"; chosen. `rover bench preconditions` measures them. */
export const SHOWN_M = 0.5;
export const SHOWN_RAD = 0.2;
const MOVING_MODES = ["MOVING", "TELEOP", "PLAN"];

/** @import { ArgumentEntry, CommandEntry, Preview } from "./messages.js" */

export class Draft extends Observable {
  #timer = 0;
  #edits = 0;
  #rearmed_ms = 0;
  #refreshed_ms = 0;
  /** @type {import("./asset.js").Fix | null} the pose of the rover when the preview was requested */
  #from = null;
  /** whether it was sent as it is now; an edit arms it again */
  isSent = false;
  /** @type {CommandEntry | null} the entry of the command in the dictionary; null for none */
  entry = null;
  /** @type {Record<string, any>} as typed: texts; of a list, one such record an item */
  typed = {};
  /** whether it replaces the active and queued motions */
  replace = false;
  /** @type {boolean | null} whether it needs the rover where it is shown; null for the default */
  onlyShown = null;
  /** @type {Preview | null} null until received */
  preview = null;
  /** the rover's refusal, or the reason why no preview was received */
  objection = "";
  /** whether a preview is pending */
  waits = false;

  /** @param {import("./asset.js").Asset} asset @param {boolean} [isPreviewed] whether it requests its preview; a plan does for its steps, which may be other nodes than commands */
  constructor(asset, isPreviewed = true) {
    super();
    this.asset = asset;
    this.isPreviewed = isPreviewed;
  }

  /** Start a draft with another command. @param {string | null} name of the command; null for none @param {Record<string, any>} [values] in SI units */
  prepare(name, values = {}) {
    const { commands = [], nodes = [] } = this.asset.entry ?? {};
    const offered = this.asset.recording ? [] : this.isPreviewed ? commands : [...commands, ...nodes];
    this.entry = offered.find((each) => each.name === name) ?? null;
    this.typed = {};
    this.replace = false;
    this.onlyShown = null;
    for (const argument of this.entry?.arguments ?? []) {
      this.typed[argument.name] =
        argument.type === "list" ? typedItems(argument, values[argument.name]) : typedText(argument, values[argument.name]);
    }
    this.#edited();
  }

  /** Set the typed text of an argument. @param {Record<string, any>} record `typed`, or an item of one of its lists @param {string} name @param {string} text */
  type(record, name, text) {
    record[name] = text;
    this.#edited();
  }

  /** Add an item to a list, such as a waypoint to a path. @param {string} list @param {Record<string, any>} item */
  addItem(list, item) {
    const items = this.typed[list];
    const blank = items.length === 1 && Object.values(items[0]).every((each) => each === "" || each === undefined);
    if (blank) items.splice(0, 1, item);
    else items.push(item);
    this.#edited();
  }

  /** @param {string} list @param {number} index */
  removeItem(list, index) {
    this.typed[list].splice(index, 1);
    this.#edited();
  }

  /** @param {boolean} replace */
  setReplace(replace) {
    this.replace = replace;
    this.#edited();
  }

  /** @param {boolean} onlyShown */
  setOnlyShown(onlyShown) {
    this.onlyShown = onlyShown;
    this.#edited();
  }

  /** Whether it can need the rover where it is shown: a motion over a link that supports this. */
  get offersOnlyShown() {
    return Boolean(this.entry?.motion && this.asset.pose && this.asset.commandLink?.preconditions);
  }

  /** Whether it needs that; by default behind a delay. */
  get isOnlyShown() {
    return this.offersOnlyShown && (this.onlyShown ?? this.asset.isDelayed);
  }

  /** The last motion of this operator, which must be executed before, if its end is not known: without it the rover may be nearly where it is shown. */
  get predecessor() {
    const motions = new Set(this.asset.entry?.commands.filter(({ motion }) => motion).map(({ name }) => name));
    const last = this.asset.lastCommands.find(({ by, name }) => by === operator.name && motions.has(name));
    return last && !last.ended && !this.replace ? last : null;
  }

  /** The precondition now, as posted. */
  get precondition() {
    if (!this.isOnlyShown) return {};
    const { x, y, heading } = this.asset.pose;
    const { predecessor } = this;
    return { only_at: [x, y, SHOWN_M, heading, SHOWN_RAD].join(" "), ...(predecessor ? { only_after: predecessor.number } : {}) };
  }

  /** Whether it can be sent: it was edited since it was sent, at least REARM_MS ago. */
  get isArmed() {
    return !this.isSent && Date.now() >= this.#rearmed_ms;
  }

  /** Disarm it, since it is sent now, and end its preview. */
  disarm() {
    this.#discard();
    this.isSent = true;
    this.#rearmed_ms = Date.now() + REARM_MS;
    setTimeout(() => this.changed(), REARM_MS);
    this.changed();
  }

  /** Arm it again without an edit, for example after a refusal. */
  rearm() {
    this.#rearmed_ms = 0;
    this.#edited();
  }

  /** Request the preview again if the rover has moved since, and is stationary now. */
  refresh() {
    const { pose, mode } = this.asset;
    if (!this.#from || !pose || this.waits || this.isSent || MOVING_MODES.includes(mode) || Date.now() < this.#refreshed_ms + REFRESH_MS) return;
    const turn = Math.abs(Math.atan2(Math.sin(pose.heading - this.#from.heading), Math.cos(pose.heading - this.#from.heading)));
    if (Math.hypot(pose.x - this.#from.x, pose.y - this.#from.y) > MOVED_M || turn > MOVED_RAD) this.#fetchPreview(this.#edits);
  }

  #discard() {
    clearTimeout(this.#timer);
    this.#edits++;
    Object.assign(this, { preview: null, objection: "", waits: false });
    this.#from = null;
  }

  #edited() {
    this.#discard();
    this.isSent = false;
    this.waits = this.isPreviewed && Boolean(this.entry?.motion) && this.problems.size === 0;
    if (this.waits) this.#timer = setTimeout(() => this.#fetchPreview(this.#edits), DEBOUNCE_MS);
    this.changed();
  }

  async #fetchPreview(edit) {
    let preview = null;
    let objection = "";
    this.#from = this.asset.pose;
    this.#refreshed_ms = Date.now();
    try {
      preview = await fetchJson("/api/preview", {
        json: { asset: this.asset.name, name: this.entry.name, args: this.values },
      });
    } catch (error) {
      objection = error.message;
    }
    if (edit !== this.#edits) return;
    Object.assign(this, { preview, objection, waits: false });
    this.changed();
  }

  /** The problems of the typed arguments, by the name of the argument. */
  get problems() {
    const found = new Map();
    for (const argument of this.entry?.arguments ?? []) {
      if (argument.type !== "list") {
        const problem = problemOf(argument, this.typed[argument.name]);
        if (problem) found.set(argument.name, problem);
        continue;
      }
      this.typed[argument.name].forEach((item, index) => {
        for (const part of argument.items) {
          const problem = problemOf(part, item[part.name]);
          if (problem) found.set(`${argument.name}.${index}.${part.name}`, problem);
        }
      });
      if (argument.max_items !== null && this.typed[argument.name].length > argument.max_items) {
        found.set(argument.name, `${argument.max_items} at most`);
      }
    }
    if (this.entry?.at_least_one && Object.keys(this.values).length === 0) {
      found.set("", "fill in one of these");
    }
    return found;
  }

  /** The arguments in SI units, without the omitted ones. */
  get values() {
    const values = {};
    for (const argument of this.entry?.arguments ?? []) {
      const typed = this.typed[argument.name];
      const value =
        argument.type === "list" ? typed.map((item) => valuesOf(argument.items, item)) : valueOf(argument, typed);
      if (value !== undefined) values[argument.name] = value;
    }
    return values;
  }

  /** The typed waypoints in the odometry frame; none once they were sent. @returns {{x: number, y: number, item: number}[]} `item`: its index in the list */
  get waypoints() {
    if (this.isSent) return [];
    const { x, y, waypoints, frame } = this.values;
    const typed = (waypoints ?? [{ x, y }]).map((each, item) => ({ ...each, item }));
    return this.asset.inOdometry(typed.filter((each) => Number.isFinite(each.x) && Number.isFinite(each.y)), frame, null);
  }

  /** The target of the motion in the odometry frame: the last typed waypoint, or null. */
  get target() {
    return this.waypoints.at(-1) ?? null;
  }
}

/** @param {ArgumentEntry[]} parts @param {Record<string, any>} item */
function valuesOf(parts, item) {
  const pairs = parts.map((part) => [part.name, valueOf(part, item[part.name])]);
  return Object.fromEntries(pairs.filter(([, value]) => value !== undefined));
}

/** @param {ArgumentEntry} argument @param {string | undefined} text */
function valueOf(argument, text) {
  if (text === undefined || text === "") return undefined;
  if (argument.type === "text" || argument.type === "choice") return text;
  return quantityOf(argument, text);
}

/** Read a number, in the display unit or with one of `units`. @param {ArgumentEntry} argument @param {string} text @returns {number} in SI units; NaN if it is none */
function quantityOf({ display_unit: display, units }, text) {
  const [, figure, unit] = /^\s*([-+]?(?:\d+[.,]?\d*|[.,]\d+)(?:e[-+]?\d+)?)\s*(\D*?)\s*$/i.exec(text) ?? [];
  return Number(figure?.replace(",", ".")) / (unit ? units[unit] : (display?.per_unit ?? 1));
}

/** @param {ArgumentEntry} list @param {Record<string, any>[]} [items] in SI units */
function typedItems({ items: parts }, items = [{}]) {
  return items.map((item) => Object.fromEntries(parts.map((part) => [part.name, typedText(part, item[part.name])])));
}

/** @param {ArgumentEntry} argument @param {any} value in SI units */
function typedText(argument, value) {
  if (value === undefined || value === null) return "";
  if (typeof value !== "number") return String(value);
  return String(Math.round(value * (argument.display_unit?.per_unit ?? 1) * 1000) / 1000);
}

/** @param {ArgumentEntry} argument @param {string | undefined} text */
function problemOf(argument, text) {
  if (text === undefined || text === "") return argument.optional ? "" : "needed";
  if (argument.type === "text" || argument.type === "choice") return "";
  const value = quantityOf(argument, text);
  if (!Number.isFinite(value)) return "not a number";
  if (argument.type === "integer" && !Number.isInteger(value)) return "not a whole number";
  const { low, high } = argument;
  const slack = 1e-9 + 1e-6 * Math.abs(value);
  if (argument.or_zero && value === 0) return "";
  if ((low !== null && value < low - slack) || (high !== null && value > high + slack)) {
    return `not in ${rangeOf(argument)}`;
  }
  return "";
}

/**
 * Format a range in its display unit; empty if there is none.
 * @param {Pick<ArgumentEntry, "display_unit" | "unit" | "low" | "high">} argument
 * @param {string} [unit] to display
 */
export function rangeOf(argument, unit = unitOf(argument)) {
  const factor = argument.display_unit?.per_unit ?? 1;
  const { low, high } = argument;
  const format = (figure) => number(Math.round(figure * factor * 100) / 100);
  if (low === null && high === null) return "";
  if (low === null) return `≤ ${format(high)} ${unit}`.trim();
  if (high === null) return `≥ ${format(low)} ${unit}`.trim();
  return `${format(low)} … ${format(high)} ${unit}`.trim();
}
