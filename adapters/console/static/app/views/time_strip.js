/**
 * The history of an asset over the span of the time conductor, in lanes: plans, commands, modes, authority,
 * alarms. A click on a command selects it; a click beside it sets the displayed time.
 */

import { button, html, reconcile, setText, set, svg } from "../dom.js";
import { ArchivedHistory } from "../model/archive.js";
import { openRecording } from "./recording.js";
import { lanesOf } from "./strip_lanes.js";
import { View } from "./view.js";
import { dateOf, interval, timeOfDay } from "../format.js";

/** @import { Lane } from "./strip_lanes.js" */

const LEFT_PX = 74;
const AXIS_PX = 20;
const ROW_PX = 16;
const GAP_PX = 8;
const CHARACTER_PX = 6.4;
const MIN_PX = 4;
/** Maximum rows of a lane with labels beside the bars; a fuller lane is packed without labels. */
const MAX_LABELLED_ROWS = 12;
const TICKS_S = [0.1, 0.5, 1, 5, 10, 30, 60, 300, 900, 1800, 3600, 10800, 21600, 86400];
const TICK_PX = 110;
const LEGEND = { sent: "sent", accepted: "accepted", started: "active", expected: "predicted end", executed: "executed", rejected: "refused, failed", unknown: "unknown" };

export class TimeStripView extends View {
  #history = new ArchivedHistory(this.session, this.asset, this.draw);

  #spanText = html("span", { className: "dim" });
  #message = html("span", { className: "message", role: "status" });
  #fork = button("fork here", "fetch the current recording, and open it at this time", () => this.#openPast(), { hidden: Boolean(this.asset.recording) });
  #legend = Object.entries(LEGEND).map(([style, label]) => html("span", { className: "key" }, html("i", { className: style }), label));
  #axis = svg("g", { class: "axis" });
  #lanes = svg("g");
  #later = svg("rect", { class: "later", y: AXIS_PX });
  #now = svg("line", { class: "now" });
  #at = svg("line", { class: "at", "data-testid": "strip-cursor" });
  #picture = svg("svg", { class: "strip" }, this.#axis, this.#lanes, this.#later, this.#now, this.#at);
  #scroll = html("div", { className: "scroll", tabIndex: 0 }, this.#picture);
  root = html(
    "section",
    { className: "rover-view strip-view" },
    html("header", {}, this.#spanText, html("span", { className: "tools" }, ...this.#legend), this.#fork, exporter(this.asset, this.span)),
    this.#message,
    this.#scroll,
  );

  start() {
    const { asset, session, selection, cursor, span, draw } = this;
    this.#picture.addEventListener("click", (event) => this.#onClick(event));
    const size = new ResizeObserver(draw);
    size.observe(this.#scroll);
    return [
      asset.on("commands", draw),
      asset.on("entry", draw),
      session.onSecond(draw),
      ...[selection, cursor, span].map((each) => each.on(draw)),
      () => size.disconnect(),
      () => this.#history.close(),
    ];
  }

  /** Scale from time to px. */
  get #scale() {
    const { start_s, end_s } = this.span;
    const end_px = Math.max(this.#scroll.clientWidth, LEFT_PX + 100);
    const px_per_s = (end_px - LEFT_PX) / (end_s - start_s);
    const xOf = (utc) => LEFT_PX + (Math.min(Math.max(utc, start_s), end_s) - start_s) * px_per_s;
    return { start_s, end_s, end_px, px_per_s, xOf };
  }

  #onClick(event) {
    const { asset, cursor, session } = this;
    const { start_s, px_per_s } = this.#scale;
    const x = event.clientX - this.#picture.getBoundingClientRect().left;
    if (x < LEFT_PX) return;
    const utc = start_s + (x - LEFT_PX) / px_per_s;
    cursor.set(!asset.recording && utc >= session.now ? null : utc);
  }

  /** Fetch the recording that the rover writes, and open it at the displayed time. */
  async #openPast() {
    this.#fork.disabled = true;
    setText(this.#message, "The current recording is fetched …");
    const at = { utc_s: this.cursor.utc_s ?? this.session.now };
    await openRecording(this, `/api/files/${encodeURIComponent(this.asset.name)}/recording`, at).catch((error) => setText(this.#message, error.message));
    this.#fork.disabled = false;
  }

  render() {
    const { asset, cursor, session } = this;
    const scale = this.#scale;
    const { start_s, end_s, end_px, xOf } = scale;
    this.#history.load(start_s, end_s);
    const now_s = asset.recording?.end ?? session.now;
    const height = this.#drawLanes({ ...scale, now_s });
    set(this.#picture, { width: end_px, height: Math.max(height, this.#scroll.clientHeight - 4) });
    this.#drawAxis(scale, height);
    this.#drawMoment(this.#now, asset.recording ? null : now_s, height);
    this.#drawMoment(this.#at, cursor.utc_s, height);
    const isPast = cursor.utc_s !== null && cursor.utc_s < end_s;
    set(this.#later, { x: xOf(cursor.utc_s ?? end_s), width: isPast ? end_px - xOf(cursor.utc_s) : 0, height: Math.max(height - AXIS_PX, 0) });
    setText(this.#spanText, this.#history.problem || `${interval(start_s, end_s)} UTC`);
  }

  /** Draw the lanes below each other; return the lower end, px. */
  #drawLanes(scale) {
    let y = AXIS_PX;
    const drawn = lanesOf(this.asset, this.#history, scale.now_s).map((lane) => {
      const { bars, rows } = layOut(lane, scale);
      const top = y;
      y += rows * ROW_PX + GAP_PX;
      return { name: lane.name, bars, top, height: rows * ROW_PX };
    });
    const make = (lane) => svg("g", { "data-lane": lane.name }, svg("rect", { class: "back", x: 0 }), svg("text", { class: "lane", x: 6 }, lane.name), svg("g"));
    reconcile(this.#lanes, drawn, (lane) => lane.name, make, (group, { bars, top, height }) => {
      const [back, name, inside] = group.children;
      set(back, { y: top - GAP_PX / 2, width: scale.end_px, height: height + GAP_PX });
      set(name, { y: top + 12 });
      reconcile(inside, bars, (each) => each.bar.key, ({ bar }) => this.#makeBar(bar), (made, each) => this.#drawBar(made, each, top));
    });
    return y;
  }

  #makeBar({ command }) {
    const made = svg("g", {}, svg("title"), svg("g"), svg("text"), svg("line", { class: "expected" }));
    if (command) made.addEventListener("click", (event) => (event.stopPropagation(), this.selection.selectCommand(command)));
    return made;
  }

  #drawBar(made, { bar, row, parts, text_px, anchor, label, expected_px }, top) {
    const [title, rects, text, expected] = made.children;
    const y = top + row * ROW_PX;
    const isSelected = bar.command !== undefined && bar.command === this.selection.command;
    set(made, { class: `bar ${bar.style}${isSelected ? " selected" : ""}`, ...(bar.state ? { "data-state": bar.state, "data-command": bar.command } : {}) });
    setText(title, bar.title);
    const makePart = (part) => svg("rect", { rx: 2, height: ROW_PX - 3, class: part.style });
    reconcile(rects, parts, (part) => part.style, makePart, (rect, { x, width }) => set(rect, { x, y, width }));
    set(text, { x: text_px, y: y + 11, "text-anchor": anchor });
    setText(text, label);
    set(expected, { visibility: expected_px === null ? "hidden" : "inherit", x1: expected_px ?? 0, x2: expected_px ?? 0, y1: y - 1, y2: y + ROW_PX - 2 });
  }

  #drawAxis({ start_s, end_s, px_per_s, xOf }, height) {
    reconcile(this.#axis, ticksOf(start_s, end_s, px_per_s), String, () => svg("g", {}, svg("line"), svg("text", { y: 13 })), (tick, utc) => {
      const [line, text] = tick.children;
      set(line, { x1: xOf(utc), x2: xOf(utc), y1: 0, y2: height });
      set(text, { x: xOf(utc) + 3 });
      setText(text, utc % 86400 ? timeOfDay(utc) : dateOf(utc));
    });
  }

  #drawMoment(line, utc, height) {
    const { start_s, end_s, xOf } = this.#scale;
    const x = xOf(utc ?? start_s);
    set(line, { visibility: utc !== null && utc >= start_s && utc <= end_s ? "visible" : "hidden", x1: x, x2: x, y1: 0, y2: height });
  }
}

/** Lay out the bars of a lane; overlapping bars get further rows. @param {Lane} lane */
function layOut(lane, { xOf, end_px, start_s, end_s, now_s }) {
  const bars = [];
  for (const bar of lane.bars) {
    const from = bar.parts[0]?.from ?? Infinity;
    const to = Math.min(bar.parts.at(-1)?.to ?? from, now_s);
    if (from > end_s || to < start_s) continue;
    const parts = bar.parts
      .filter((each) => each.from <= end_s && each.to >= start_s)
      .map(({ from, to, style }) => {
        const x = xOf(from);
        return { style, x, width: Math.max(xOf(Math.min(to, now_s)) - x, MIN_PX) };
      });
    if (parts.length === 0) continue;
    const [x, right] = [parts[0].x, parts.at(-1).x + parts.at(-1).width];
    const isExpectedHere = bar.expected >= start_s && bar.expected <= end_s;
    bars.push({ bar, parts, x, right, expected_px: isExpectedHere ? xOf(bar.expected) : null, label_px: bar.label.length * CHARACTER_PX + 6 });
  }
  bars.sort((one, other) => one.x - other.x);
  if (!lane.isPacked) {
    const placed = bars.map((each) => ({ ...each, row: each.bar.row ?? 0, text_px: each.x + 4, anchor: "start", label: each.right - each.x >= each.label_px ? each.bar.label : "" }));
    return { bars: placed, rows: Math.max(0, ...placed.map((each) => each.row)) + 1 };
  }
  const labelled = packed(bars, end_px, true);
  return labelled.rows <= MAX_LABELLED_ROWS ? labelled : packed(bars, end_px, false);
}

/** Put each bar into the first row with free space; its label is inside if it fits, else to the right or left. */
function packed(bars, end_px, hasLabels) {
  /** @type {number[]} right end of the last bar of each row, px */
  const ends = [];
  const placed = bars.map((each) => {
    const fits = each.right - each.x >= each.label_px;
    const isRight = each.right + each.label_px <= end_px;
    const beside = hasLabels && !fits ? each.label_px : 0;
    const left = isRight ? each.x : each.x - beside;
    const right = isRight ? each.right + beside : each.right;
    let row = ends.findIndex((end) => end + 2 <= left);
    if (row < 0) row = ends.length;
    ends[row] = right;
    const text_px = fits ? each.x + 4 : isRight ? each.right + 4 : each.x - 4;
    return { ...each, row, text_px, anchor: fits || isRight ? "start" : "end", label: fits || hasLabels ? each.bar.label : "" };
  });
  return { bars: placed, rows: Math.max(ends.length, 1) };
}

/** Return the times of the ticks, at multiples of a step. */
function ticksOf(start_s, end_s, scale) {
  const step = TICKS_S.find((each) => each * scale >= TICK_PX) ?? 7 * 86400;
  const first = Math.ceil(start_s / step);
  return Array.from({ length: Math.max(0, Math.floor(end_s / step) - first + 1) }, (_, index) => (first + index) * step);
}

const KINDS = { tm: "telemetry", commands: "commands", reports: "reports", tree: "behaviour tree", plans: "plans", alarms: "alarms" };
const ALL = Object.keys(KINDS).join(",");

/**
 * Export the archived data of an asset over a time span.
 * @param {import("../model/asset.js").Asset} asset
 * @param {import("../model/selection.js").Span} span
 * @returns {HTMLElement} a choice of the data, and a button for each format
 */
function exporter(asset, span) {
  const option = ([value, textContent]) => html("option", { value, textContent });
  const what = html("select", { "aria-label": "what to export" }, ...Object.entries(KINDS).map(option), option([ALL, "all, as MCAP"]));
  what.onchange = () => (csv.disabled = what.value === ALL);
  const csv = button("export CSV", "a table of this span", () => save("csv"));
  const mcap = button("export MCAP", "this span for Foxglove or PlotJuggler", () => save("mcap"));

  function save(format) {
    const query = new URLSearchParams({ asset: asset.name, content: what.value, format, start: String(span.start_s), end: String(span.end_s) });
    html("a", { href: `/api/export?${query}`, download: "" }).click();
  }

  return html("span", { className: "tools" }, what, csv, mcap);
}
