/**
 * The map, in the odometry frame of the rover, m: pose, driven track, planned and previewed motion, zones and
 * rocks. x is to the right and y is up; the grid lines are labelled in metres.
 */

import { button, html, reconcile, setText, set, svg } from "../dom.js";
import * as layers from "./map_layers.js";
import { PictureMarks, ShownPicture } from "./pictures.js";
import { Goals, Steps } from "./route.js";
import { View } from "./view.js";
import { Viewport } from "./viewport.js";
import { age, clock, degrees, fixed } from "../format.js";
import { composed, inverse } from "../model/asset.js";
import { ScannedObstacles } from "../model/obstacles.js";
import { Pictures } from "../model/pictures.js";
import { PlanRoutes } from "../model/routes.js";

/** @import { Fix, Frame } from "../model/asset.js" */
/** @import { FileEntry, PosePrediction } from "../model/messages.js" */
/** @import { Mark } from "../model/plan_draft.js" */

const CLICK_PX = 4;
const LATE_S = 5;
const CLOSE_PX = 8;

export class MapView extends View {
  /** whether the map follows the rover */
  #follows = true;
  /** @type {{x: number, y: number, moved: boolean, at: [number, number]} | null} */
  #drag = null;

  #grid = new layers.Grid();
  #zones = new layers.Zones();
  #scanned = new layers.Scanned();
  #tracks = new layers.Tracks();
  #fork = new layers.ForkTrack();
  #preview = new layers.Preview();
  #uncertain = new layers.UncertaintyMark();
  #rover = new layers.Rover();
  #predicted = new layers.Predicted();
  #pictureMarks = new PictureMarks();
  #goals = new Goals();
  #steps = new Steps();
  #routes = new PlanRoutes(this.session, this.asset, this.draw);
  #obstacles = new ScannedObstacles(this.session, this.asset, this.draw);
  #pictures = new Pictures(this.session, this.asset, this.draw);
  #shown = new ShownPicture();
  #world = svg("g", {}, ...[this.#zones, this.#scanned, this.#tracks, this.#fork, this.#preview, this.#predicted, this.#uncertain, this.#rover].map((each) => each.element));
  #picture = svg("svg", { class: "map", role: "img", "aria-label": "map" }, this.#grid.element, this.#world, ...[this.#pictureMarks, this.#goals, this.#steps].map((each) => each.element));
  #viewport = new Viewport(this.#picture);
  #marks = new Marks(this.#viewport);
  #poseText = html("span", { className: "pose" });
  #predictedText = html("p", { className: "predicted-text", "data-testid": "predicted-text", hidden: true });
  #pointed = html("span", { className: "pointed dim" });
  #now = button("back to now", "", () => this.cursor.set(null), { className: "now" });
  #follow = button("follow", "centre the map on the rover", () => ((this.#follows = !this.#follows), this.draw()));
  #whole = button("show all", "fit track, goals, steps, pictures, obstacles and zones", () => this.#fit());
  #empty = html("p", { className: "empty over" });
  #hint = html("p", { className: "hint" });
  #menu = html("div", { className: "menu", hidden: true });
  /** @type {[any, {element: Element}][]} the legend's entries, each with its layer */
  #entries = [
    [html("span", { className: "commanded", textContent: "commanded" }), this.#goals],
    [html("span", { className: "plan", textContent: "steps of a plan" }), this.#steps],
    [html("span", { className: "scan", textContent: "scanned obstacle" }), this.#scanned],
    [html("span", { className: "taken", textContent: "picture" }), this.#pictureMarks],
    [html("span", { className: "draft", textContent: "preview, not sent" }), this.#preview],
    [html("span", { className: "expected", textContent: "predicted" }), this.#predicted],
    [html("span", { className: "draft", textContent: "with the change" }), this.#fork],
  ];
  root = html(
    "section",
    { className: "rover-view map-view" },
    html("header", {}, this.#poseText, html("span", { className: "tools" }, this.#pointed, this.#now, this.#follow, this.#whole)),
    this.#predictedText,
    html("div", { className: "canvas" }, this.#picture, html("div", { className: "legend" }, ...this.#entries.map(([entry]) => entry)), this.#empty, this.#hint, this.#menu, this.#shown.root),
  );

  start() {
    const { asset, session, selection, cursor, draft, draw } = this;
    this.#picture.append(this.#marks.element);
    this.#picture.addEventListener("pointerdown", (event) => this.#onDown(event));
    this.#picture.addEventListener("pointermove", (event) => this.#onMove(event));
    this.#picture.addEventListener("pointerup", (event) => this.#onUp(event));
    this.#picture.addEventListener("pointerleave", () => setText(this.#pointed, ""));
    this.#picture.addEventListener("wheel", (event) => this.#onWheel(event), { passive: false });
    const resized = new ResizeObserver(draw);
    resized.observe(this.#picture);
    return [
      ...["track", "commands", "entry", "links", "plans", "prediction"].map((topic) => asset.on(topic, draw)),
      session.onSecond(draw),
      ...[selection, cursor, draft].map((each) => each.on(draw)),
      () => resized.disconnect(),
      () => this.#routes.close(),
      () => this.#obstacles.close(),
      () => this.#pictures.close(),
      this.#shown.start(),
    ];
  }

  render() {
    const { asset, cursor, draft, selection } = this;
    const viewport = this.#viewport;
    const pose = cursor.utc_s === null ? asset.pose : asset.poseAt(cursor.utc_s);
    const uncertainty = pose && asset.uncertaintyAt(cursor.utc_s);
    if (this.#follows && pose) viewport.centreAt(pose.x, pose.y);
    this.#follow.classList.toggle("on", this.#follows);
    this.#now.hidden = cursor.utc_s === null || asset.recording !== null;
    const { width, height } = viewport.size;
    const { scale } = viewport;
    set(this.#picture, { viewBox: `0 0 ${width} ${height}`, "data-scale": scale });
    set(this.#world, { transform: viewport.transform });
    this.#grid.render(viewport);
    this.#zones.render(asset.zones);
    this.#scanned.render(this.#obstacles.at(cursor.utc_s));
    this.#tracks.render(asset.track, cursor.utc_s, selection.spanOf(asset));
    this.#fork.render(selection.fork);
    this.#preview.render(draft, scale);
    const predicted = cursor.utc_s === null ? asset.predictionAt(this.session.now) : null;
    this.#predicted.render(asset, predicted, scale);
    this.#predictedText.hidden = predicted === null;
    if (predicted) setText(this.#predictedText, predictedText(predicted, this.session.now));
    this.#uncertain.render(asset, pose, uncertainty, scale);
    this.#rover.render(asset, pose, scale);
    this.#pictureMarks.render(asset, this.#pictures.at(cursor.utc_s), viewport, (picture) => this.#showPicture(picture));
    const plans = this.#routes.at(cursor.utc_s);
    this.#goals.render(asset, cursor.utc_s, pose, viewport, plans);
    this.#steps.render(asset, cursor.utc_s, pose, viewport, plans);
    this.#marks.render(draft);
    this.#drawLegend();
    this.#drawTexts(pose, uncertainty);
  }

  /** Show a picture on the side of the map without its mark. @param {FileEntry} picture */
  #showPicture(picture) {
    const [x] = this.#viewport.toScreen(Number(picture.meta.POS_X), 0);
    this.#shown.root.classList.toggle("left", x > this.#viewport.size.width / 2);
    this.#shown.show(this.asset, picture);
  }

  /** Show the legend's entries of the layers that are not empty. */
  #drawLegend() {
    for (const [entry, { element }] of this.#entries) entry.hidden = element.childElementCount === 0;
  }

  /** @param {Fix | null} pose @param {layers.Uncertainty | null} uncertainty */
  #drawTexts(pose, uncertainty) {
    const { asset, cursor, draft, session } = this;
    this.#empty.hidden = pose !== null;
    setText(this.#empty, asset.isReached ? "No position received yet." : session.unreached(asset));
    const isElsewhere = !draft.hint && draft.entry !== null && document.querySelector(".form-view") === null;
    this.#hint.hidden = !pose || asset.recording !== null || (draft.entry !== null && !isElsewhere && !draft.hint);
    setText(this.#hint, isElsewhere ? `${draft.entry.name} is prepared: send it under “Command”.` : draft.hint || "Click the map to prepare a move there.");
    if (!pose) return setText(this.#poseText, "");
    const origin = asset.mapOriginAt(cursor.utc_s);
    const inMap = origin && `${poseText({ ...composed(inverse(origin), pose), heading: pose.heading - origin.heading })} in map`;
    const text = `${poseText(pose)} in odom`;
    const when = cursor.utc_s === null ? `${age(session.now - pose.utc)}` : `at ${clock(pose.utc)} (past)`;
    setText(this.#poseText, [text, inMap, uncertainty ? layers.uncertainBy(uncertainty) : "", when === "now" ? "" : when].filter(Boolean).join("   "));
    this.root.classList.toggle("stale", cursor.utc_s === null && session.now - pose.utc > LATE_S);
    this.root.classList.toggle("past", cursor.utc_s !== null);
  }

  /** Fit all that is drawn into the view. */
  #fit() {
    const { asset, cursor, draft } = this;
    const layered = [this.#goals, this.#steps, this.#pictureMarks].flatMap((each) => each.points);
    const fixes = [...asset.track, ...layered, ...(draft.preview?.path ?? []), ...(asset.pose ? [asset.pose] : [])];
    const points = [...fixes.map(({ x, y }) => [x, y]), ...this.#obstacles.at(cursor.utc_s), ...asset.zones.flatMap(layers.outline)].filter(([x]) => x !== null);
    if (points.length) {
      this.#viewport.fit(points);
      this.#follows = false;
    }
    this.draw();
  }

  #onDown({ offsetX: x, offsetY: y, pointerId }) {
    this.#menu.hidden = true;
    this.#drag = { x, y, moved: false, at: [this.#viewport.x, this.#viewport.y] };
    this.#picture.setPointerCapture(pointerId);
  }

  #onMove({ offsetX, offsetY }) {
    const drag = this.#drag;
    const [x, y] = this.#viewport.toWorld(offsetX, offsetY);
    setText(this.#pointed, `${fixed(x, 2)}, ${fixed(y, 2)}`);
    if (!drag) return;
    const [dx, dy] = [offsetX - drag.x, offsetY - drag.y];
    if (!drag.moved && Math.hypot(dx, dy) < CLICK_PX) return;
    drag.moved = true;
    this.#follows = false;
    this.#viewport.centreAt(drag.at[0] - dx / this.#viewport.scale, drag.at[1] + dy / this.#viewport.scale);
    this.draw();
  }

  /** Prepare a move; on the driven track, offer the past at that point as well. */
  #onUp({ offsetX, offsetY }) {
    const isClick = this.#drag && !this.#drag.moved;
    this.#drag = null;
    if (!isClick) return;
    const [x, y] = this.#viewport.toWorld(offsetX, offsetY);
    const near = nearestOf(this.asset.track, x, y, CLOSE_PX / this.#viewport.scale);
    if (near) this.#offer(offsetX, offsetY, near, layers.tidy(x), layers.tidy(y));
    else if (!this.asset.recording) this.#prepare(layers.tidy(x), layers.tidy(y));
  }

  #onWheel(event) {
    event.preventDefault();
    const viewport = this.#viewport;
    const before = viewport.toWorld(event.offsetX, event.offsetY);
    viewport.zoom(Math.exp(-event.deltaY / 400));
    if (!this.#follows) {
      const after = viewport.toWorld(event.offsetX, event.offsetY);
      viewport.centreAt(viewport.x + before[0] - after[0], viewport.y + before[1] - after[1]);
    }
    this.draw();
  }

  /** Prepare a move to a point of the odometry frame, in the frame of its command. */
  #prepare(x, y) {
    const { asset, draft } = this;
    const path = draft.entry?.arguments.find((each) => each.type === "list");
    const at = asset.inFrame({ x, y }, path && draft.values.frame);
    if (!path) draft.prepare("moveTo", at ?? { x, y, frame: "odom" });
    else if (at) draft.addItem(path.name, { x: String(layers.tidy(at.x)), y: String(layers.tidy(at.y)) });
  }

  /** @param {number} px @param {number} py @param {Fix} fix @param {number} x @param {number} y */
  #offer(px, py, fix, x, y) {
    const { asset, cursor, selection } = this;
    const command = asset.lastCommands.find((each) => {
      const span = asset.spanOf(each);
      return span && span[0] <= fix.utc && fix.utc <= span[1];
    });
    const item = (text, act) => button(text, "", () => ((this.#menu.hidden = true), act()));
    this.#menu.replaceChildren(
      asset.recording ? "" : item(`prepare a move to ${x}, ${y}`, () => this.#prepare(x, y)),
      item(`show ${clock(fix.utc)}, when the rover was here`, () => cursor.set(fix.utc)),
      command ? item(`select ${command.name}, executed here`, () => selection.selectCommand(command.id)) : "",
    );
    const { width, height } = this.#viewport.size;
    const across = px < width / 2 ? { left: `${px + 6}px`, right: "" } : { left: "", right: `${width - px + 6}px` };
    const along = py < height / 2 ? { top: `${py + 6}px`, bottom: "" } : { top: "", bottom: `${height - py + 6}px` };
    Object.assign(this.#menu.style, across, along);
    this.#menu.hidden = false;
  }
}

/** @param {Frame} pose */
function poseText({ x, y, heading }) {
  return `x ${fixed(x, 2)} m  y ${fixed(y, 2)} m  ${fixed((Math.round(degrees(heading)) + 540) % 360 - 180, 0)}°`;
}

/** @param {PosePrediction} predicted @param {number} now */
function predictedText({ x, y, heading, within, as_of, arrival, utc }, now) {
  return `The next command finds it at ${poseText({ x, y, heading })} ± ${fixed(within, 2)} m: as of ${age(now - as_of)} ago, next command arrives in ${age(arrival - utc)}.`;
}

/** Return the fix nearest to a point, null if none is within `close`, m. @param {Fix[]} track @param {number} x @param {number} y @param {number} close */
function nearestOf(track, x, y, close) {
  const away = (fix) => Math.hypot(fix.x - x, fix.y - y);
  return track.reduce((best, fix) => (away(fix) <= (best ? away(best) : close) ? fix : best), null);
}

/** @typedef {{marks?: Mark[], moveMark?: (mark: Mark, x: number, y: number) => void, select?: (step: Mark["step"]) => void}} Marked a draft with waypoints to drag */

/** Layer of the map, in px: the waypoints of a plan in preparation, with the numbers of their steps, to be dragged. */
class Marks {
  /** key of the dragged waypoint */
  #dragged = "";
  element = svg("g", { class: "marks" });
  #viewport;

  /** @param {Viewport} viewport */
  constructor(viewport) {
    this.#viewport = viewport;
  }

  /** @param {Marked} draft */
  render(draft) {
    const keyOf = (/** @type {Mark} */ { step, item }) => `${step.key} ${item}`;
    reconcile(this.element, draft.marks ?? [], keyOf, (mark) => this.#make(draft, keyOf(mark)), (made, mark) => {
      const [circle, text] = made.children;
      set(made, { class: `${mark.isSelected ? "selected" : ""} ${mark.isRefused ? "refused" : ""}`, transform: `translate(${this.#viewport.toScreen(mark.x, mark.y)})`, "data-mark": mark.label });
      set(circle, { r: 7 + 2 * mark.label.length });
      setText(text, mark.label);
      made.mark = mark;
    });
  }

  /** @param {Marked} draft @param {string} key */
  #make(draft, key) {
    const made = svg("g", {}, svg("circle"), svg("text", { y: 4 }));
    made.onpointerdown = (event) => {
      event.stopPropagation();
      made.setPointerCapture(event.pointerId);
      this.#dragged = key;
      draft.select(made.mark.step);
    };
    made.onpointermove = (event) => {
      if (this.#dragged !== key) return;
      event.stopPropagation();
      const [x, y] = this.#viewport.toWorld(event.offsetX, event.offsetY);
      draft.moveMark(made.mark, layers.tidy(x), layers.tidy(y));
    };
    made.onpointerup = (event) => event.stopPropagation();
    made.onlostpointercapture = () => (this.#dragged = "");
    return made;
  }
}
