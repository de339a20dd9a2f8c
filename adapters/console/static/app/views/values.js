/** The newest value of each parameter, with its unit, its limits, and how old it is by each link. */

import { newestOf } from "../model/asset.js";
import { ask } from "../model/connection.js";
import { eachFrame, html, keep, say, set } from "../dom.js";
import { rangeOf } from "../model/draft.js";
import { age, clock, inTypedUnit } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */

const LATE_S = 5;

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session, cursor } = context;
  /** @type {Map<string, Map<string, any>>} the values of the time that is looked at */
  let past = new Map();
  const rows = html("tbody");
  const head = html("tr");
  const empty = html("p", { className: "empty" });
  const table = html("table", { className: "values" }, html("thead", {}, head), rows);
  const root = html("section", { className: "rover-view values-view" }, empty, html("div", { className: "scroll" }, table));
  element.append(root);

  const values = () => (cursor.utc_s === null ? asset.values : past);

  /** Ask what the values were at the time that is looked at. */
  async function lookBack() {
    const utc = cursor.utc_s;
    if (utc === null) past = new Map();
    else {
      const keys = (asset.entry?.parameters ?? []).map((each) => [asset.name, each.key]);
      const { samples } = await ask("/api/tm:batch", { json: { keys, end: utc } }).catch(() => ({ samples: [] }));
      if (cursor.utc_s !== utc) return;
      past = new Map();
      for (const sample of samples) past.set(sample.key, (past.get(sample.key) ?? new Map()).set(sample.link, sample));
    }
    draw();
  }

  function render() {
    const links = asset.valueLinks;
    root.classList.toggle("past", cursor.utc_s !== null);
    empty.hidden = asset.entry !== null || asset.values.size > 0;
    table.hidden = !empty.hidden;
    say(empty, asset.isReached ? "The rover has not told which values there are yet." : session.unreached(asset));
    head.replaceChildren(
      html("th", { textContent: "parameter" }),
      html("th", { className: "figure", textContent: "value" }),
      html("th", {}),
      ...links.map((link) => html("th", { className: "age", textContent: links.length > 1 ? `age, ${link}` : "age" })),
      html("th", { className: "limits", textContent: "limits" }),
    );
    const entries = asset.entry?.parameters ?? [...asset.values.keys()].map((key) => ({ key }));
    keep(rows, entries, (entry) => entry.key, make, (row, entry) => update(row, entry, links));
  }

  const make = (entry) =>
    html(
      "tr",
      {},
      html("td", { textContent: entry.key, title: entry.description ?? "" }),
      html("td", { className: "figure", "data-testid": `value-${entry.key}` }),
      html("td", { className: "unit" }),
      html("td", { className: "limits" }),
    );

  function update(row, entry, links) {
    const told = values().get(entry.key);
    const newest = newestOf(told);
    const now = cursor.utc_s ?? session.now;
    const cells = [...row.children];
    const limits = cells.at(-1);
    while (row.children.length < links.length + 4) row.insertBefore(html("td", { className: "age" }), limits);
    const { text, unit } = inTypedUnit(newest?.value, entry);
    say(cells[1], text);
    say(cells[2], unit);
    const late = newest === null || now - newest.utc > LATE_S;
    const state = newest === null || newest.value === null ? "none" : limitOf(entry, newest.value);
    set(row, { class: `${state}${late ? " stale" : ""}` });
    set(cells[1], { title: newest ? `${clock(newest.utc, true)} UTC by ${newest.link}` : "never told" });
    links.forEach((link, index) => {
      const sample = told?.get(link);
      say(row.children[3 + index], sample ? age(now - sample.utc) : "–");
    });
    say(limits, rangeOf({ ...entry, typed: entry.typed ?? null, unit: "", low: entry.low ?? null, high: entry.high ?? null }, ""));
  }

  const draw = eachFrame(render);
  const offs = [
    ...["values", "entry", "links"].map((topic) => asset.on(topic, draw)),
    session.onSecond(draw),
    cursor.on(lookBack),
    asset.on("entry", lookBack),
  ];
  draw();
  lookBack();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

/** Whether a value is beyond its limits. */
export function limitOf(entry, value) {
  if (typeof value !== "number") return "";
  const { low, high } = entry;
  const slack = 1e-6 + 0.01 * Math.abs((high ?? low ?? 0) - (low ?? high ?? 0));
  const isBeyond = (low != null && value < low - slack) || (high != null && value > high + slack);
  return isBeyond ? "beyond" : "";
}
