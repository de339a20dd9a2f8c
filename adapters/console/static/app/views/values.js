/** The newest value of each parameter, with its unit, its limits, and its age on each link. */

import { newestOf } from "../model/asset.js";
import { fetchJson } from "../model/connection.js";
import { html, reconcile, setText, set } from "../dom.js";
import { rangeOf } from "../model/draft.js";
import { View } from "./view.js";
import { age, clock, inDisplayUnit } from "../format.js";

/** @import { Latest } from "../model/asset.js" */
/** @import { Sample } from "../model/messages.js" */

const LATE_S = 5;
/** Number of sample intervals without a value after which it is late; chosen, not measured. */
const MISSED_INTERVALS = 2.5;
const MAX_INTERVAL_S = 30;

export class ValuesView extends View {
  /** @type {Map<string, Map<string, Sample>>} the values at the displayed time */
  #past = new Map();

  #rows = html("tbody");
  #head = html("tr");
  #empty = html("p", { className: "empty" });
  #table = html("table", { className: "values" }, html("thead", {}, this.#head), this.#rows);
  root = html("section", { className: "rover-view values-view" }, this.#empty, html("div", { className: "scroll", tabIndex: 0 }, this.#table));

  start() {
    const { asset, session, cursor, draw } = this;
    const loadPast = () => this.#loadPast();
    loadPast();
    return [
      ...["values", "entry", "links"].map((topic) => asset.on(topic, draw)),
      session.onSecond(draw),
      cursor.on(loadPast),
      asset.on("entry", loadPast),
    ];
  }

  /** Request the values at the displayed time. */
  async #loadPast() {
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
    setText(this.#empty, asset.isReached ? "No parameter list received yet." : session.unreached(asset));
    this.#head.replaceChildren(
      html("th", { textContent: "parameter" }),
      html("th", { className: "figure", textContent: "value" }),
      html("th", { textContent: "unit" }),
      ...links.map((link) => html("th", { className: "age", textContent: links.length > 1 ? `age, ${link}` : "age" })),
      html("th", { className: "limits", textContent: "limits" }),
    );
    const entries = asset.entry?.parameters ?? [...asset.values.keys()].map((key) => ({ key }));
    reconcile(this.#rows, entries, (entry) => entry.key, makeRow, (row, entry) => this.#drawRow(row, entry, links));
  }

  #drawRow(row, entry, links) {
    const { utc_s } = this.cursor;
    const samples = (utc_s === null ? this.asset.values : this.#past).get(entry.key);
    const newest = newestOf(samples);
    const now = utc_s ?? this.session.now;
    const [, figure, unitCell] = row.children;
    const limits = row.lastElementChild;
    while (row.children.length < links.length + 4) row.insertBefore(html("td", { className: "age" }), limits);
    const { text, unit } = inDisplayUnit(newest?.value, entry);
    setText(figure, text);
    setText(unitCell, unit);
    const state = newest === null || newest.value === null ? "none" : limitOf(entry, newest.value);
    set(row, { class: `${state}${isLate(newest, now) ? " stale" : ""}` });
    set(figure, { title: newest ? `${clock(newest.utc, true)} UTC, ${newest.link}: ${text}` : "never received" });
    links.forEach((link, index) => {
      const sample = samples?.get(link);
      setText(row.children[3 + index], sample ? age(now - sample.utc) : "–");
      set(row.children[3 + index], { class: `age${sample && isLate(sample, now) ? " late" : ""}` });
    });
    setText(limits, limitsOf(entry));
  }
}

const makeRow = ({ key, name = "", description = "" }) =>
  html(
    "tr",
    {},
    html("td", { title: `${key}: ${description}` }, `${name} `, html("span", { className: "key dim" }, ...key.split(/(?<=_)/).flatMap((part) => [part, html("wbr")]))),
    html("td", { className: "figure", "data-testid": `value-${key}` }),
    html("td", { className: "unit" }),
    html("td", { className: "limits" }),
  );

/**
 * Request the last samples of parameters at or before a time, by keys and links.
 * @param {import("../model/asset.js").Asset} asset
 * @param {string[]} keys
 * @param {number} utc
 * @returns {Promise<Map<string, Map<string, Sample>>>}
 */
export async function valuesAt(asset, keys, utc) {
  const wanted = keys.map((key) => [asset.name, key]);
  const { samples } = await fetchJson("/api/tm:batch", { json: { keys: wanted, end: utc } }).catch(() => ({ samples: [] }));
  const found = new Map();
  for (const sample of samples) found.set(sample.key, (found.get(sample.key) ?? new Map()).set(sample.link, sample));
  return found;
}

/**
 * Whether a newer value is overdue, by its sample interval. Texts are never late: they are sent on change only.
 * @param {Latest | null | undefined} sample
 * @param {number} now
 */
export function isLate(sample, now) {
  if (!sample) return true;
  if (typeof sample.value === "string" && Number.isNaN(Number(sample.value))) return false;
  const usual = Math.min(MAX_INTERVAL_S, sample.interval ?? 0);
  return now - sample.utc > Math.max(LATE_S, MISSED_INTERVALS * usual);
}

/** Format the limits in the display unit; octets in megabytes. */
function limitsOf({ low = null, high = null, unit, display_unit = null }) {
  if (unit === "B") return rangeOf({ low, high, unit: "", display_unit: { unit: "MB", per_unit: 1e-6 } });
  return rangeOf({ low, high, unit: "", display_unit }, "");
}

/** Return "beyond" for a value outside its limits, else an empty string. The tolerance is 1% of the range. */
export function limitOf(entry, value) {
  if (typeof value !== "number") return "";
  const { low, high } = entry;
  const slack = 1e-6 + 0.01 * Math.abs((high ?? low ?? 0) - (low ?? high ?? 0));
  const isBeyond = (low != null && value < low - slack) || (high != null && value > high + slack);
  return isBeyond ? "beyond" : "";
}
