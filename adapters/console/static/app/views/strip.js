/**
 * What the asset did over the span of the time conductor, in lanes: plans, commands, modes, who held the
 * authority, alarms. A click on a command selects it, one beside it sets the moment that is looked at.
 */

import { eachFrame, html, keep, say, set, svg } from "../dom.js";
import { exporter } from "./export.js";
import { Past } from "../model/past.js";
import { clock } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */
/** @import { AlarmStatus, CommandStatus } from "../model/messages.js" */
/** @typedef {{from: number, to: number, look: string}} Part */
/** @typedef {{key: string, label: string, title: string, look: string, parts: Part[], command?: string, state?: string, expected?: number}} Bar `to` of the last part is Infinity while it goes on; `expected` is when it was to end */
/** @typedef {{name: string, bars: Bar[], isPacked: boolean}} Lane */

const LEFT_PX = 74;
const AXIS_PX = 20;
const ROW_PX = 16;
const GAP_PX = 8;
const CHARACTER_PX = 6.4;
const LEAST_PX = 4;
/** Rows of a lane in which each bar has its label beside it; more bars are packed without. */
const MOST_LABELLED_ROWS = 12;
const TICKS_S = [0.1, 0.5, 1, 5, 10, 30, 60, 300, 900, 1800, 3600, 10800, 21600, 86400];
const TICK_PX = 110;
const DOUBTED = ["unknown", "given_up"];
const LEGEND = { sent: "sent", accepted: "accepted", started: "under way", expected: "predicted end", executed: "executed", rejected: "refused, failed", unknown: "unknown" };

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session, selection, cursor, span } = context;
  const past = new Past(session, asset, () => draw());
  const told = html("span", { className: "dim" });
  const legend = Object.entries(LEGEND).map(([look, words]) => html("span", { className: "key" }, html("i", { className: look }), words));
  const axis = svg("g", { class: "axis" });
  const lanes = svg("g");
  const later = svg("rect", { class: "later", y: AXIS_PX });
  const now = svg("line", { class: "now" });
  const at = svg("line", { class: "at", "data-testid": "strip-cursor" });
  const picture = svg("svg", { class: "strip" }, axis, lanes, later, now, at);
  const scroll = html("div", { className: "scroll" }, picture);
  const root = html(
    "section",
    { className: "rover-view strip-view" },
    html("header", {}, told, html("span", { className: "tools" }, ...legend), exporter(asset, span)),
    scroll,
  );
  element.append(root);
  picture.addEventListener("click", (event) => {
    const x = event.clientX - picture.getBoundingClientRect().left;
    if (x < LEFT_PX) return;
    const utc = span.start_s + ((x - LEFT_PX) / (width() - LEFT_PX)) * (span.end_s - span.start_s);
    if (asset.recording) cursor.set(utc);
    else cursor.set(utc >= session.now ? null : utc);
  });

  const width = () => Math.max(scroll.clientWidth, LEFT_PX + 100);

  function render() {
    const { start_s, end_s } = span;
    past.look(start_s, end_s);
    const end_px = width();
    const scale = (end_px - LEFT_PX) / (end_s - start_s);
    const xOf = (utc) => LEFT_PX + (Math.min(Math.max(utc, start_s), end_s) - start_s) * scale;
    const now_s = asset.recording?.ended ?? session.now;
    let y = AXIS_PX;
    const drawn = lanesOf(asset, past, now_s).map((lane) => {
      const placed = placedOf(lane, { xOf, end_px, start_s, end_s, now_s });
      const top = y;
      y += placed.rows * ROW_PX + GAP_PX;
      return { name: lane.name, bars: placed.bars, top, height: placed.rows * ROW_PX };
    });
    set(picture, { width: end_px, height: Math.max(y, scroll.clientHeight - 4) });
    keep(lanes, drawn, (lane) => lane.name, makeLane, (group, lane) => {
      const [back, name, bars] = group.children;
      set(back, { y: lane.top - GAP_PX / 2, width: end_px, height: lane.height + GAP_PX });
      set(name, { y: lane.top + 12 });
      keep(bars, lane.bars, (each) => each.bar.key, makeBar, (bar, each) => drawBar(bar, each, lane.top));
    });
    keep(axis, ticksOf(start_s, end_s, scale), String, () => svg("g", {}, svg("line"), svg("text", { y: 13 })), (tick, utc) => {
      const [line, text] = tick.children;
      set(line, { x1: xOf(utc), x2: xOf(utc), y1: 0, y2: y });
      set(text, { x: xOf(utc) + 3 });
      say(text, clock(utc));
    });
    drawMoment(now, asset.recording ? null : now_s, y);
    drawMoment(at, cursor.utc_s, y);
    const isPast = cursor.utc_s !== null && cursor.utc_s < end_s;
    set(later, { x: xOf(cursor.utc_s ?? end_s), width: isPast ? end_px - xOf(cursor.utc_s) : 0, height: Math.max(y - AXIS_PX, 0) });
    const day = new Date(start_s * 1000).toISOString().slice(0, 10);
    say(told, past.problem || `${day}, ${clock(start_s)} to ${clock(end_s)} UTC`);

    function drawMoment(line, utc, bottom) {
      const isShown = utc !== null && utc >= start_s && utc <= end_s;
      set(line, { visibility: isShown ? "visible" : "hidden", x1: xOf(utc ?? start_s), x2: xOf(utc ?? start_s), y1: 0, y2: bottom });
    }
  }

  /** @param {any} lane */
  const makeLane = ({ name }) => {
    const text = svg("text", { class: "lane", x: 6 });
    say(text, name);
    return svg("g", { "data-lane": name }, svg("rect", { class: "back", x: 0 }), text, svg("g"));
  };

  /** @param {any} placed */
  const makeBar = ({ bar }) => {
    const made = svg("g", {}, svg("title"), svg("g"), svg("text"), svg("line", { class: "expected" }));
    if (bar.command) {
      made.addEventListener("click", (event) => {
        event.stopPropagation();
        selection.selectCommand(bar.command);
      });
    }
    return made;
  };

  function drawBar(made, { bar, row, parts, text_px, anchor, label, expected_px }, top) {
    const [title, rects, text, expected] = made.children;
    const y = top + row * ROW_PX;
    const isSelected = bar.command !== undefined && bar.command === selection.command;
    set(made, { class: `bar ${bar.look}${isSelected ? " selected" : ""}`, ...(bar.state ? { "data-state": bar.state, "data-command": bar.command } : {}) });
    say(title, bar.title);
    keep(rects, parts, (part) => part.look, () => svg("rect", { rx: 2, height: ROW_PX - 3 }), (rect, part) =>
      set(rect, { class: part.look, x: part.x, y, width: part.width }),
    );
    set(text, { x: text_px, y: y + 11, "text-anchor": anchor });
    say(text, label);
    set(expected, { visibility: expected_px === null ? "hidden" : "inherit", x1: expected_px ?? 0, x2: expected_px ?? 0, y1: y - 1, y2: y + ROW_PX - 2 });
  }

  const draw = eachFrame(render);
  const size = new ResizeObserver(draw);
  size.observe(scroll);
  const offs = [
    asset.on("commands", draw),
    asset.on("entry", draw),
    session.onSecond(draw),
    selection.on(draw),
    cursor.on(draw),
    span.on(draw),
    () => size.disconnect(),
    () => past.close(),
  ];
  draw();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

/** @param {import("../model/asset.js").Asset} asset @param {Past} past @param {number} now_s @returns {Lane[]} */
function lanesOf(asset, past, now_s) {
  const { modes, authority, plans } = past.told;
  return [
    { name: "plans", bars: planBars(plans), isPacked: true },
    { name: "commands", bars: [...asset.commands.values()].map((each) => commandBar(each, now_s)), isPacked: true },
    { name: "mode", bars: statesOf(modes, (each) => [each.mode, each.mode, `mode-${each.mode}`]), isPacked: false },
    {
      name: "works on",
      bars: statesOf(modes, (each) => {
        const command = workOf(asset, each.active);
        return [each.active ?? "", command?.name ?? each.active ?? "", each.active ? "started" : "none"];
      }).filter((each) => each.label),
      isPacked: false,
    },
    {
      name: "authority",
      bars: statesOf(authority, (each) => {
        const who = each.operator ?? each.holder ?? "";
        return [who, who, who ? "held" : "none"];
      }).filter((each) => each.label),
      isPacked: false,
    },
    { name: "alarms", bars: past.alarms.map(alarmBar), isPacked: true },
  ];
}

/** The command that an asset says it works on, by SOURCE:NUMBER or number alone. */
function workOf(asset, active) {
  if (!active) return null;
  return asset.commandOf(active) ?? asset.lastCommands.find((each) => String(each.number) === active) ?? null;
}

/** Bars of what holds until something else is told. @returns {Bar[]} */
function statesOf(told, describe) {
  const bars = [];
  let last = null;
  for (const each of told) {
    const [state, label, look] = describe(each);
    if (last?.state === state) continue;
    if (last) last.parts[0].to = each.utc;
    last = { key: String(each.utc), state: "", label, title: `${label} from ${clock(each.utc)}`, look, parts: [{ from: each.utc, to: Infinity, look }] };
    bars.push(last);
    last.state = state;
  }
  return bars.map(({ state, ...bar }) => bar);
}

/** One bar for each activity: from one report of a plan to the next. @returns {Bar[]} */
function planBars(plans) {
  const bars = [];
  for (const plan of new Set(plans.map((each) => each.plan))) {
    const told = plans.filter((each) => each.plan === plan);
    for (const bar of statesOf(told, (each) => {
      const status = each.status.toLowerCase();
      const activity = each.node?.split("/").at(-1) ?? "";
      return [`${status} ${each.node}`, [plan, activity || status].join(": "), `plan-${status}`];
    })) {
      const isOver = ["plan-completed", "plan-failed", "plan-aborted"].includes(bar.look);
      const { from, to, look } = bar.parts[0];
      bars.push({ ...bar, key: `${plan} ${from}`, title: `${bar.title}, ${look.slice(5)}`, parts: [{ from, to: isOver ? from : to, look }] });
    }
  }
  return bars;
}

/** @param {CommandStatus} command @param {number} now_s @returns {Bar} */
function commandBar(command, now_s) {
  const when = (...stages) => command.history.find((each) => stages.includes(each.stage))?.utc;
  const isDoubted = DOUBTED.includes(command.state);
  const last = command.history.at(-1)?.utc ?? command.made;
  const end = Math.max(command.made, command.ended || isDoubted ? last : Infinity);
  const accepted = when("RECEIVED", "ACCEPTED") ?? (command.ended ? when("STARTED") : undefined) ?? end;
  const started = when("STARTED") ?? end;
  const predicted = command.history.findLast((each) => each.stage === "PREDICTED")?.figures;
  const duration_s = /** @type {number | undefined} */ (predicted?.["predicted duration"]);
  const expected = duration_s === undefined || started === end ? undefined : started + duration_s;
  const until = (utc) => Math.min(Math.max(utc, command.made), end);
  const outcome = command.ended || isDoubted ? command.state : "started";
  const parts = [
    { from: command.made, to: until(accepted), look: "sent" },
    { from: until(accepted), to: until(Math.max(started, accepted)), look: "accepted" },
    { from: until(Math.max(started, accepted)), to: end, look: outcome },
  ];
  const shown = parts.filter(({ from, to }, index) => to > from || (index === 2 && from <= now_s && end !== Infinity));
  return {
    key: command.id,
    label: command.name,
    title: `${command.name} by ${command.by}, made ${clock(command.made, true)}: ${command.state.replace("_", " ")}. ${command.history.at(-1)?.detail ?? ""}${
      expected === undefined ? "" : ` (predicted to end ${clock(expected)})`
    }`,
    look: `of-command ${command.ended || isDoubted ? "" : "in-flight"}`,
    parts: shown.map((each) => (isDoubted && each.look !== command.state ? { ...each, look: `${each.look} doubted` } : each)),
    command: command.id,
    state: command.state,
    expected,
  };
}

/** @param {AlarmStatus} alarm @returns {Bar} */
function alarmBar(alarm) {
  const look = `alarm-${alarm.severity.toLowerCase()}`;
  const acknowledged = alarm.acknowledged === null ? "not acknowledged" : `acknowledged by ${alarm.operator}`;
  return {
    key: String(alarm.id),
    label: alarm.text,
    title: `${alarm.severity}, ${alarm.occurrences} times since ${clock(alarm.raised)}, ${acknowledged}: ${alarm.text}`,
    look,
    parts: [{ from: alarm.raised, to: alarm.cleared ?? Infinity, look }],
  };
}

/** Where the bars of a lane are drawn; those that would overlap get rows of their own. @param {Lane} lane */
function placedOf(lane, { xOf, end_px, start_s, end_s, now_s }) {
  const bars = [];
  for (const bar of lane.bars) {
    const from = bar.parts[0]?.from ?? Infinity;
    const to = Math.min(bar.parts.at(-1)?.to ?? from, now_s);
    if (from > end_s || to < start_s) continue;
    const parts = bar.parts
      .filter((each) => each.from <= end_s && each.to >= start_s)
      .map(({ from, to, look }) => {
        const x = xOf(from);
        return { look, x, width: Math.max(xOf(Math.min(to, now_s)) - x, LEAST_PX) };
      });
    if (parts.length === 0) continue;
    const [x, right] = [parts[0].x, parts.at(-1).x + parts.at(-1).width];
    const isExpectedHere = bar.expected >= start_s && bar.expected <= end_s;
    bars.push({ bar, parts, x, right, expected_px: isExpectedHere ? xOf(bar.expected) : null, label_px: bar.label.length * CHARACTER_PX + 6 });
  }
  bars.sort((one, other) => one.x - other.x);
  if (!lane.isPacked) {
    const placed = bars.map((each) => ({ ...each, row: 0, text_px: each.x + 4, anchor: "start", label: each.right - each.x >= each.label_px ? each.bar.label : "" }));
    return { bars: placed, rows: 1 };
  }
  const labelled = packed(bars, end_px, true);
  return labelled.rows <= MOST_LABELLED_ROWS ? labelled : packed(bars, end_px, false);
}

/** Put each bar into the first row where it has room, with its label inside, else to the right or left of it. */
function packed(bars, end_px, hasLabels) {
  /** @type {number[]} where the last bar of each row ends */
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

/** Whole times for the axis. */
function ticksOf(start_s, end_s, scale) {
  const step = TICKS_S.find((each) => each * scale >= TICK_PX) ?? 7 * 86400;
  const first = Math.ceil(start_s / step);
  return Array.from({ length: Math.max(0, Math.floor(end_s / step) - first + 1) }, (_, index) => (first + index) * step);
}
