/**
 * The map, in the rover's own metric frame: where it is and was, where it would go, and what it keeps
 * away from. x is to the right and y is up, as the frame has it; the grid tells the metres.
 */

import { eachFrame, html, keep, say, set, svg } from "../dom.js";
import { age, clock, degrees, fixed } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */
/** @import { CommandStatus, ZoneEntry } from "../model/messages.js" */

const CLICK_PX = 4;
const NEAREST_PX_PER_M = 2;
const CLOSEST_PX_PER_M = 400;
const FIRST_PX_PER_M = 45;
const LATE_S = 5;
const CLOSE_PX = 8;

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session, selection, cursor, draft } = context;
  const view = { x: 0, y: 0, scale: FIRST_PX_PER_M, follows: true };

  const grid = svg("g", { class: "grid" });
  const zones = svg("g", { class: "zones" });
  const track = svg("polyline", { class: "track" });
  const ahead = svg("polyline", { class: "track ahead" });
  const marked = svg("polyline", { class: "track marked" });
  const planned = svg("g", { class: "planned" });
  const preview = svg("g", { class: "preview" });
  const uncertain = svg("g", { class: "uncertain", "data-testid": "uncertain" }, svg("circle"), svg("path"), svg("title"));
  const rover = svg(
    "g",
    { class: "rover", "data-testid": "rover" },
    svg("rect", { class: "body" }),
    svg("path", { class: "nose" }),
    svg("title", {}),
  );
  const world = svg("g", {}, zones, ahead, track, marked, planned, preview, uncertain, rover);
  const picture = svg("svg", { class: "map", role: "img", "aria-label": "map" }, grid, world);
  const place = html("span", { className: "place" });
  const pointed = html("span", { className: "pointed dim" });
  const follow = html("button", {
    type: "button",
    textContent: "follow",
    title: "keep the rover in the middle",
    onclick: () => ((view.follows = !view.follows), draw()),
  });
  const whole = html("button", {
    type: "button",
    textContent: "show all",
    title: "show everything that is known",
    onclick: () => (fit(), draw()),
  });
  const empty = html("p", { className: "empty over" });
  const hint = html("p", { className: "hint" });
  const menu = html("div", { className: "menu", hidden: true });
  const now = html("button", {
    type: "button",
    className: "now",
    textContent: "back to now",
    onclick: () => cursor.set(null),
  });
  const root = html(
    "section",
    { className: "rover-view map-view" },
    html("header", {}, place, html("span", { className: "tools" }, pointed, now, follow, whole)),
    html("div", { className: "canvas" }, picture, empty, hint, menu),
  );
  element.append(root);

  const size = () => ({ width: picture.clientWidth || 400, height: picture.clientHeight || 300 });
  const toScreen = (x, y) => {
    const { width, height } = size();
    return [(x - view.x) * view.scale + width / 2, height / 2 - (y - view.y) * view.scale];
  };
  const toWorld = (px, py) => {
    const { width, height } = size();
    return [(px - width / 2) / view.scale + view.x, (height / 2 - py) / view.scale + view.y];
  };

  /** Show everything that is known. */
  function fit() {
    const points = [
      ...asset.track.map((each) => [each.x, each.y]),
      ...asset.zones.flatMap((zone) => outline(zone)),
      ...(draft.preview?.path ?? []).map((each) => [each.x, each.y]),
    ].filter((each) => each[0] !== null);
    const pose = asset.pose;
    if (pose) points.push([pose.x, pose.y]);
    if (!points.length) return;
    const xs = points.map((each) => each[0]);
    const ys = points.map((each) => each[1]);
    const [west, east, south, north] = [Math.min(...xs), Math.max(...xs), Math.min(...ys), Math.max(...ys)];
    const { width, height } = size();
    const scale = Math.min(width / (east - west + 2), height / (north - south + 2));
    view.scale = Math.min(Math.max(scale, NEAREST_PX_PER_M), FIRST_PX_PER_M * 2);
    view.x = (west + east) / 2;
    view.y = (south + north) / 2;
    view.follows = false;
  }

  function render() {
    const pose = cursor.utc_s === null ? asset.pose : asset.poseAt(cursor.utc_s);
    if (view.follows && pose) [view.x, view.y] = [pose.x, pose.y];
    follow.classList.toggle("on", view.follows);
    now.hidden = cursor.utc_s === null || asset.recording !== null;
    const { width, height } = size();
    set(picture, { viewBox: `0 0 ${width} ${height}`, "data-scale": view.scale });
    const k = view.scale;
    set(world, { transform: `matrix(${k} 0 0 ${-k} ${width / 2 - view.x * k} ${height / 2 + view.y * k})` });
    drawGrid(width, height);
    drawZones();
    drawTracks();
    drawPlanned();
    drawPreview();
    const uncertainty = pose && asset.uncertaintyAt(cursor.utc_s);
    drawUncertainty(pose, uncertainty);
    drawRover(pose);
    drawWords(pose, uncertainty);
  }

  function drawWords(pose, uncertainty) {
    empty.hidden = pose !== null;
    say(empty, asset.isReached ? "No position yet: the rover has not told where it is." : session.unreached(asset));
    const isElsewhere = draft.entry !== null && document.querySelector(".form-view") === null;
    hint.hidden = !pose || asset.recording !== null || (draft.entry !== null && !isElsewhere);
    say(hint, isElsewhere ? `${draft.entry.name} is prepared: see and send it under “Command”.` : "Click the map to prepare a move there.");
    if (!pose) return say(place, "");
    const words = `x ${fixed(pose.x, 2)} m  y ${fixed(pose.y, 2)} m  ${fixed(degrees(pose.heading), 0)}°`;
    const when = cursor.utc_s === null ? `${age(session.now - pose.utc)}` : `at ${clock(pose.utc)} (past)`;
    say(place, [words, uncertainty ? uncertainBy(uncertainty) : "", when === "now" ? "" : when].filter(Boolean).join("   "));
    root.classList.toggle("stale", cursor.utc_s === null && session.now - pose.utc > LATE_S);
    root.classList.toggle("past", cursor.utc_s !== null);
  }

  function drawGrid(width, height) {
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find((each) => each * view.scale >= 60) ?? 200;
    const [west, north] = toWorld(0, 0);
    const [east, south] = toWorld(width, height);
    const lines = [];
    for (let x = Math.ceil(west / step) * step; x <= east; x += step) lines.push(["x", tidy(x)]);
    for (let y = Math.ceil(south / step) * step; y <= north; y += step) lines.push(["y", tidy(y)]);
    keep(
      grid,
      lines,
      (line) => line.join(""),
      () => svg("g", {}, svg("line"), svg("text")),
      (made, [axis, value]) => {
        const [line, text] = made.children;
        const [px, py] = toScreen(value, value);
        const origin = value === 0 ? "origin" : "";
        if (axis === "x") {
          set(line, { x1: px, x2: px, y1: 0, y2: height, class: origin });
          set(text, { x: px + 3, y: height - 4 });
        } else {
          set(line, { x1: 0, x2: width, y1: py, y2: py, class: origin });
          set(text, { x: 3, y: py - 3 });
        }
        say(text, `${value} m`);
      },
    );
  }

  function drawZones() {
    keep(
      zones,
      asset.zones,
      (zone) => zone.title,
      () => svg("g", {}, svg("polygon"), svg("title", {})),
      (made, zone) => {
        const [shape, title] = made.children;
        set(made, { class: zone.kind });
        set(shape, { points: outline(zone).map((each) => each.join(",")).join(" ") });
        say(title, zone.title);
      },
    );
  }

  function drawTracks() {
    const until = cursor.utc_s ?? Infinity;
    const line = (points) => points.map((each) => `${each.x},${each.y}`).join(" ");
    set(track, { points: line(asset.track.filter((each) => each.utc <= until)) });
    set(ahead, { points: until === Infinity ? "" : line(asset.track.filter((each) => each.utc >= until)) });
    const span = selection.spanOf(asset);
    set(marked, {
      points: span ? line(asset.track.filter((each) => each.utc >= span[0] && each.utc <= span[1])) : "",
    });
  }

  function drawPlanned() {
    const points = waypointsOf(asset.commandsAt(cursor.utc_s));
    keep(
      planned,
      points.map((each, index) => ({ ...each, index })),
      (each) => String(each.index),
      () => svg("g", {}, svg("line"), svg("circle"), svg("title", {})),
      (made, each) => {
        const [line, circle, title] = made.children;
        const from = each.index ? points[each.index - 1] : each;
        set(made, { class: each.done ? "done" : "" });
        set(line, { x1: from.x, y1: from.y, x2: each.x, y2: each.y });
        set(circle, { cx: each.x, cy: each.y, r: 5 / view.scale });
        say(title, each.title);
      },
    );
  }

  function drawPreview() {
    const path = draft.preview?.path ?? [];
    const parts = [];
    if (path.length > 1) {
      parts.push(svg("polyline", { points: path.map((each) => `${each.x},${each.y}`).join(" ") }));
    }
    const end = path.at(-1);
    if (end) parts.push(svg("path", { d: arrow(), transform: turned(end), class: "ghost" }));
    const target = draft.target;
    if (target && !end) parts.push(svg("circle", { cx: target.x, cy: target.y, r: 6 / view.scale }));
    preview.replaceChildren(...parts);
  }

  /** @param {{x: number, y: number, heading: number | null}} pose */
  const turned = (pose) => `translate(${pose.x} ${pose.y}) rotate(${degrees(pose.heading ?? 0)})`;

  /** An arrow that stays visible however far out the view is. */
  function arrow() {
    const half = Math.max(0.25, 9 / view.scale);
    return `M${half} 0L${-half * 0.8} ${half * 0.65}L${-half * 0.45} 0L${-half * 0.8} ${-half * 0.65}Z`;
  }

  /** A circle in which the rover is, and a sector of its headings. */
  function drawUncertainty(pose, uncertainty) {
    set(uncertain, { visibility: uncertainty ? "visible" : "hidden" });
    if (!uncertainty) return;
    const [circle, sector, title] = uncertain.children;
    const half = Math.min(uncertainty.heading_rad, 3.1);
    const reach = Math.max(uncertainty.position_m, asset.footprint.length_m, 30 / view.scale) + 20 / view.scale;
    const [x, y] = [reach * Math.cos(half), reach * Math.sin(half)];
    set(circle, { r: uncertainty.position_m });
    set(sector, { d: `M0 0L${x} ${-y}A${reach} ${reach} 0 ${half > Math.PI / 2 ? 1 : 0} 1 ${x} ${y}Z` });
    set(uncertain, { transform: turned(pose), "data-position": uncertainty.position_m.toFixed(3) });
    say(title, `${asset.name} is ${uncertainBy(uncertainty)}: correct its pose by setPositionCompensation, or confirm it by confirmPose`);
  }

  function drawRover(pose) {
    set(rover, { visibility: pose ? "visible" : "hidden" });
    if (!pose) return;
    const [body, nose, title] = rover.children;
    const { length_m, width_m } = asset.footprint;
    set(body, { x: -length_m / 2, y: -width_m / 2, width: length_m, height: width_m });
    set(nose, { d: arrow() });
    set(rover, { transform: turned(pose), "data-x": pose.x.toFixed(3), "data-y": pose.y.toFixed(3) });
    say(title, `${asset.name}, ${clock(pose.utc)}`);
  }

  /** @type {{x: number, y: number, moved: boolean, at: [number, number]} | null} */
  let drag = null;
  picture.addEventListener("pointerdown", (event) => {
    menu.hidden = true;
    drag = { x: event.offsetX, y: event.offsetY, moved: false, at: [view.x, view.y] };
    picture.setPointerCapture(event.pointerId);
  });
  picture.addEventListener("pointermove", (event) => {
    const [x, y] = toWorld(event.offsetX, event.offsetY);
    say(pointed, `${fixed(x, 2)}, ${fixed(y, 2)}`);
    if (!drag) return;
    const [dx, dy] = [event.offsetX - drag.x, event.offsetY - drag.y];
    if (!drag.moved && Math.hypot(dx, dy) < CLICK_PX) return;
    drag.moved = true;
    view.follows = false;
    view.x = drag.at[0] - dx / view.scale;
    view.y = drag.at[1] + dy / view.scale;
    draw();
  });
  picture.addEventListener("pointerup", (event) => {
    if (drag && !drag.moved) clicked(event);
    drag = null;
  });
  picture.addEventListener("pointerleave", () => say(pointed, ""));
  picture.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const before = toWorld(event.offsetX, event.offsetY);
      const factor = Math.exp(-event.deltaY / 400);
      view.scale = Math.min(Math.max(view.scale * factor, NEAREST_PX_PER_M), CLOSEST_PX_PER_M);
      if (!view.follows) {
        const after = toWorld(event.offsetX, event.offsetY);
        view.x += before[0] - after[0];
        view.y += before[1] - after[1];
      }
      draw();
    },
    { passive: false },
  );

  /** Prepare a move, or on the driven path: let the operator choose between that and what was there. */
  function clicked(event) {
    const [x_m, y_m] = toWorld(event.offsetX, event.offsetY);
    const near = nearestOf(asset.track, x_m, y_m, CLOSE_PX / view.scale);
    if (near) offer(event.offsetX, event.offsetY, near, x_m, y_m);
    else if (!asset.recording) prepare(x_m, y_m);
  }

  function prepare(x, y) {
    menu.hidden = true;
    const path = draft.entry?.arguments.find((each) => each.type === "list");
    if (path) draft.addItem(path.name, { x: String(tidy(x)), y: String(tidy(y)) });
    else draft.prepare("moveTo", { x: tidy(x), y: tidy(y) });
  }

  /** @param {number} px @param {number} py @param {import("../model/asset.js").Fix} fix */
  function offer(px, py, fix, x, y) {
    const command = asset.lastCommands.find((each) => {
      const span = asset.spanOf(each);
      return span && span[0] <= fix.utc && fix.utc <= span[1];
    });
    const item = (textContent, act) =>
      html("button", { type: "button", textContent, onclick: () => ((menu.hidden = true), act()) });
    const items = [
      ...(asset.recording ? [] : [item(`prepare a move to ${tidy(x)}, ${tidy(y)}`, () => prepare(x, y))]),
      item(`show ${clock(fix.utc)}, when it was here`, () => cursor.set(fix.utc)),
    ];
    if (command) items.push(item(`select ${command.name}, which it carried out here`, () => selection.selectCommand(command.id)));
    menu.replaceChildren(...items);
    const { width, height } = size();
    const across = px < width / 2 ? { left: `${px + 6}px`, right: "" } : { left: "", right: `${width - px + 6}px` };
    const along = py < height / 2 ? { top: `${py + 6}px`, bottom: "" } : { top: "", bottom: `${height - py + 6}px` };
    Object.assign(menu.style, across, along);
    menu.hidden = false;
  }

  const draw = eachFrame(render);
  const resized = new ResizeObserver(draw);
  resized.observe(picture);
  const offs = [
    ...["track", "commands", "entry", "links"].map((topic) => asset.on(topic, draw)),
    session.onSecond(draw),
    selection.on(draw),
    cursor.on(draw),
    draft.on(draw),
  ];
  draw();
  return () => {
    resized.disconnect();
    offs.forEach((off) => off());
    root.remove();
  };
}

/** @param {{position_m: number, heading_rad: number}} uncertainty */
function uncertainBy(uncertainty) {
  return `uncertain by ${fixed(uncertainty.position_m, 2)} m and ${fixed(degrees(uncertainty.heading_rad), 1)}°`;
}

/** Without the noise of binary fractions. */
function tidy(value) {
  return Math.round(value * 100) / 100 || 0;
}

/** @param {ZoneEntry} zone */
function outline(zone) {
  if (zone.corners.length) return zone.corners;
  const corners = [];
  for (let part = 0; part < 24; part++) {
    const angle = (part / 24) * 2 * Math.PI;
    corners.push([zone.x + zone.radius * Math.cos(angle), zone.y + zone.radius * Math.sin(angle)]);
  }
  return corners;
}

/** The fix nearest to a place, if it is close. @param {import("../model/asset.js").Fix[]} track */
function nearestOf(track, x, y, close) {
  let best = null;
  let least = close;
  for (const fix of track) {
    const away = Math.hypot(fix.x - x, fix.y - y);
    if (away <= least) [best, least] = [fix, away];
  }
  return best;
}

/** Where the motions under way and waiting lead. @param {CommandStatus[]} commands the last first */
function waypointsOf(commands) {
  const open = commands.filter((each) => !each.ended && each.args && each.state !== "unknown");
  return open.reverse().flatMap((command) => {
    const step = command.history.findLast((each) => each.step)?.step ?? 0;
    const places = command.args.waypoints ?? [command.args];
    return places
      .filter((place) => Number.isFinite(place.x) && Number.isFinite(place.y))
      .map((place, index, all) => ({
        x: place.x,
        y: place.y,
        done: all.length > 1 && index < step,
        title: all.length > 1 ? `${command.name}, place ${index + 1} of ${all.length}` : command.name,
      }));
  });
}
