/** Exports the archived data of an asset over a time span. */

import { html } from "../dom.js";

const KINDS = { tm: "telemetry", commands: "commands", reports: "reports", tree: "behaviour tree", plans: "plans", alarms: "alarms" };
const ALL = Object.keys(KINDS).join(",");

/**
 * @param {import("../model/asset.js").Asset} asset
 * @param {import("../model/selection.js").Span} span
 * @returns {HTMLElement} a choice of the data, and a button for each format
 */
export function exporter(asset, span) {
  const option = ([value, textContent]) => html("option", { value, textContent });
  const what = html("select", { "aria-label": "what to export" }, ...Object.entries(KINDS).map(option), option([ALL, "all, as MCAP"]));
  what.onchange = () => (csv.disabled = what.value === ALL);
  const button = (textContent, title, format) => html("button", { type: "button", textContent, title, onclick: () => save(format) });
  const csv = button("export CSV", "a table of this span", "csv");
  const mcap = button("export MCAP", "this span for Foxglove or PlotJuggler", "mcap");

  function save(format) {
    const query = new URLSearchParams({ asset: asset.name, content: what.value, format, start: String(span.start_s), end: String(span.end_s) });
    html("a", { href: `/api/export?${query}`, download: "" }).click();
  }

  return html("span", { className: "tools" }, what, csv, mcap);
}
