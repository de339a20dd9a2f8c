/** The newest value of each parameter, with its unit, its limits, and how old it is by each link. */

import { newestOf } from "../model/asset.js";
import { ask } from "../model/connection.js";
import { html, keep, say, set } from "../dom.js";
import { rangeOf } from "../model/draft.js";
import { View } from "./view.js";
import { age, clock, inTypedUnit } from "../words.js";

/** @import { Latest } from "../model/asset.js" */
/** @import { Sample } from "../model/messages.js" */

const LATE_S = 5;
/** So many of the usual intervals without a value are a loss. */
const MISSED = 2.5;
const LONGEST_INTERVAL_S = 30;

export class ValuesView extends View {
  /** @type {Map<string, Map<string, Sample>>} the values of the time that is looked at */
  #past = new Map();

  #rows = html("tbody");
  #head = html("tr");
  #empty = html("p", { className: "empty" });
  #table = html("table", { className: "values" }, html("thead", {}, this.#head), this.#rows);
  root = html("section", { className: "rover-view values-view" }, this.#empty, html("div", { className: "scroll" }, this.#table));

  start() {
    const { asset, session, cursor, draw } = this;
    const lookBack = () => this.#lookBack();
    lookBack();
    return [
      ...["values", "entry", "links"].map((topic) => asset.on(topic, draw)),
      session.onSecond(draw),
      cursor.on(lookBack),
      asset.on("entry", lookBack),
    ];
  }

  /** Ask what the values were at the time that is looked at. */
  async #lookBack() {
    const { asset, cursor } = this;
    const utc = cursor.utc_s;
    const keys = (asset.entry?.parameters ?? []).map((each) => each.key);
    const found = utc === null ? new Map() : await valuesAt(asset, keys, utc);
    if (cursor.utc_s !== utc) return;
    this.#past = found;
    this.draw();
  }

  render() {
    const { asset, session } = this;
    const links = asset.valueLinks;
    this.root.classList.toggle("past", this.cursor.utc_s !== null);
    this.#empty.hidden = asset.entry !== null || asset.values.size > 0;
    this.#table.hidden = !this.#empty.hidden;
    say(this.#empty, asset.isReached ? "The rover has not told which values there are yet." : session.unreached(asset));
    this.#head.replaceChildren(
      html("th", { textContent: "parameter" }),
      html("th", { className: "figure", textContent: "value" }),
      html("th", {}),
      ...links.map((link) => html("th", { className: "age", textContent: links.length > 1 ? `age, ${link}` : "age" })),
      html("th", { className: "limits", textContent: "limits" }),
    );
    const entries = asset.entry?.parameters ?? [...asset.values.keys()].map((key) => ({ key }));
    keep(this.#rows, entries, (entry) => entry.key, makeRow, (row, entry) => this.#drawRow(row, entry, links));
  }

  #drawRow(row, entry, links) {
    const { utc_s } = this.cursor;
    const told = (utc_s === null ? this.asset.values : this.#past).get(entry.key);
    const newest = newestOf(told);
    const now = utc_s ?? this.session.now;
    const [, figure, unitCell] = row.children;
    const limits = row.lastElementChild;
    while (row.children.length < links.length + 4) row.insertBefore(html("td", { className: "age" }), limits);
    const { text, unit } = inTypedUnit(newest?.value, entry);
    say(figure, text);
    say(unitCell, unit);
    const state = newest === null || newest.value === null ? "none" : limitOf(entry, newest.value);
    set(row, { class: `${state}${isLate(newest, now) ? " stale" : ""}` });
    set(figure, { title: newest ? `${clock(newest.utc, true)} UTC by ${newest.link}: ${text}` : "never told" });
    links.forEach((link, index) => {
      const sample = told?.get(link);
      say(row.children[3 + index], sample ? age(now - sample.utc) : "–");
      set(row.children[3 + index], { class: `age${sample && isLate(sample, now) ? " late" : ""}` });
    });
    say(limits, limitsOf(entry));
  }
}

const makeRow = ({ key, description = "" }) =>
  html(
    "tr",
    {},
    html("td", { title: description }, ...key.split(/(?<=_)/).flatMap((part) => [part, html("wbr")])),
    html("td", { className: "figure", "data-testid": `value-${key}` }),
    html("td", { className: "unit" }),
    html("td", { className: "limits" }),
  );

/**
 * The last values of parameters until a moment, by their keys and links.
 * @param {import("../model/asset.js").Asset} asset
 * @param {string[]} keys
 * @param {number} utc
 * @returns {Promise<Map<string, Map<string, Sample>>>}
 */
export async function valuesAt(asset, keys, utc) {
  const wanted = keys.map((key) => [asset.name, key]);
  const { samples } = await ask("/api/tm:batch", { json: { keys: wanted, end: utc } }).catch(() => ({ samples: [] }));
  const found = new Map();
  for (const sample of samples) found.set(sample.key, (found.get(sample.key) ?? new Map()).set(sample.link, sample));
  return found;
}

/**
 * Whether a value should have been told anew by now: by how often it is told, and a text at each change only.
 * @param {Latest | null | undefined} sample
 * @param {number} now
 */
export function isLate(sample, now) {
  if (!sample) return true;
  if (typeof sample.value === "string" && Number.isNaN(Number(sample.value))) return false;
  const usual = Math.min(LONGEST_INTERVAL_S, sample.interval ?? 0);
  return now - sample.utc > Math.max(LATE_S, MISSED * usual);
}

/** The limits in the unit that people use; of octets in megabytes. */
function limitsOf({ low = null, high = null, unit, typed = null }) {
  if (unit === "B") return rangeOf({ low, high, unit: "", typed: { unit: "MB", per_unit: 1e-6 } });
  return rangeOf({ low, high, unit: "", typed }, "");
}

/** Whether a value is beyond its limits. */
export function limitOf(entry, value) {
  if (typeof value !== "number") return "";
  const { low, high } = entry;
  const slack = 1e-6 + 0.01 * Math.abs((high ?? low ?? 0) - (low ?? high ?? 0));
  const isBeyond = (low != null && value < low - slack) || (high != null && value > high + slack);
  return isBeyond ? "beyond" : "";
}
