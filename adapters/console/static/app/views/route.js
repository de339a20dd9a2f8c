/** Layers of the map, in px: goals of the active and queued motions of all clients, and the steps of plans. */

import { reconcile, setText, set, svg } from "../dom.js";
import { duration, fixed } from "../format.js";

/** @import { Asset, Fix, Point } from "../model/asset.js" */
/** @import { CommandStatus } from "../model/messages.js" */
/** @import { PlanRoute } from "../model/routes.js" */
/** @import { Viewport } from "./viewport.js" */
/** @typedef {{x: number, y: number, names: Map<number, string>, isPresent: boolean}} StepMark with the names of its steps, by their numbers */
/** @typedef {{command: CommandStatus, points: Point[], step: number}} Target `step`: number of waypoints passed */

const MARGIN_PX = 12;
const GOAL_PX = 6;
/** Distance of steps that share a mark, m. */
const SAME_POSITION_M = 0.05;

/** Goals of the active and queued motions, in the order of execution, with the remaining distance and time of the active one. */
export class Goals {
  element = svg("g", { class: "goals" });
  /** @type {Point[]} the drawn points */
  points = [];

  /** @param {Asset} asset @param {number | null} utc_s null for now @param {Fix | null} pose @param {Viewport} viewport @param {PlanRoute[]} plans drawn plans */
  render(asset, utc_s, pose, viewport, plans) {
    const isDrawn = ({ source }) => plans.some(({ progress, steps }) => steps.length && source === `plan:${progress.plan}`);
    const targets = targetsOf(asset, utc_s);
    this.points = targets.flatMap((each) => each.points);
    const starts = targets.map((_, index) => (index ? targets[index - 1].points.at(-1) : pose));
    const make = () => svg("g", {}, svg("polyline"), svg("g"), svg("text"), svg("title"));
    reconcile(this.element, targets, ({ command }) => command.id, make, (made, target) => {
      const [line, marks, label, title] = made.children;
      const { command, points, step } = target;
      const start = starts[targets.indexOf(target)];
      const isActive = command.state === "started";
      set(made, { class: isActive ? "active" : "queued", "data-goal": command.name });
      set(line, { points: isDrawn(command) ? "" : screen(viewport, [...(start ? [start] : []), ...points.slice(step)]) });
      reconcile(marks, points, (each) => String(points.indexOf(each)), () => svg("circle"), (mark, point) => {
        const [cx, cy] = viewport.toScreen(point.x, point.y);
        set(mark, { cx, cy, r: GOAL_PX, class: points.indexOf(point) < step ? "done" : "" });
      });
      const text = [command.name, ...(isActive && pose ? remaining(target, pose, maxSpeed(asset, utc_s)) : [])].join("  ");
      drawLabel(label, text, points.at(-1), viewport);
      setText(title, `${isActive ? "active" : "queued"}: ${command.name} of ${command.by}`);
    });
  }
}

/** The remaining steps of plans, with their numbers. */
export class Steps {
  element = svg("g", { class: "steps" });
  /** @type {Point[]} the drawn points */
  points = [];

  /** @param {Asset} asset @param {number | null} utc_s null for now @param {Fix | null} pose @param {Viewport} viewport @param {PlanRoute[]} plans */
  render(asset, utc_s, pose, viewport, plans) {
    const drawn = plans.map((plan) => ({ ...plan, ...routeOf(asset, utc_s, plan) })).filter(({ path }) => path.length);
    this.points = drawn.flatMap((each) => each.path);
    const make = () => svg("g", {}, svg("polyline"), svg("g"), svg("text"));
    reconcile(this.element, drawn, ({ progress }) => progress.plan, make, (made, { progress, isActive, steps, path, positions }) => {
      const [line, marks, label] = made.children;
      set(made, { class: isActive ? "active" : "waiting", "data-plan": progress.plan });
      const start = isActive && pose ? [pose] : [];
      set(line, { points: screen(viewport, [...start, ...path]) });
      reconcile(marks, positions, ({ x, y }) => `${x} ${y}`, () => svg("g", {}, svg("rect"), svg("text"), svg("title")), (mark, position) => drawMark(mark, position, viewport));
      const distance_m = lengthOf([...start, ...path]);
      const least = steps.some(({ times }) => times > 1) ? "≥ " : "";
      const state = progress.status === "SUSPENDED" ? ["suspended"] : ["not active"];
      const texts = isActive ? [`${least}${fixed(distance_m, 1)} m`, leastTime(distance_m, maxSpeed(asset, utc_s))] : state;
      drawLabel(label, [progress.plan, ...texts].join("  "), path.at(-1), viewport, -MARGIN_PX);
    });
  }
}

/** Return the path of a plan and the positions of its steps, in the odometry frame. @param {Asset} asset @param {number | null} utc_s @param {PlanRoute} plan */
function routeOf(asset, utc_s, { progress, isActive, steps }) {
  const inOdometry = (points, frame) => asset.inOdometry(points.map(([x, y]) => ({ x, y })), frame, utc_s);
  const path = steps.flatMap(({ points, frame }) => inOdometry(points, frame));
  /** @type {StepMark[]} */
  const positions = [];
  for (const { node, number, name, at, frame, times } of steps) {
    const [point] = at ? inOdometry([at], frame) : [];
    if (!point) continue;
    let found = positions.find(({ x, y }) => Math.hypot(x - point.x, y - point.y) < SAME_POSITION_M);
    if (!found) positions.push((found = { ...point, names: new Map(), isPresent: false }));
    found.names.set(number, times > 1 ? `${name} (${times} times)` : name);
    found.isPresent ||= isActive && node === progress.node;
  }
  return { path: path.length ? path : positions.slice(0, 1), positions };
}

/** @param {any} mark @param {StepMark} position @param {Viewport} viewport */
function drawMark(mark, { x, y, names, isPresent }, viewport) {
  const [box, text, title] = mark.children;
  const shown = ranges([...names.keys()].sort((one, other) => one - other));
  const width = 8 + 7 * shown.length;
  set(mark, { class: isPresent ? "present" : "", transform: `translate(${viewport.toScreen(x, y)})` });
  set(box, { x: -width / 2, y: -8, width, height: 16, rx: 8 });
  set(text, { y: 4 });
  setText(text, shown);
  setText(title, [...names].map(([number, name]) => `${number} ${name}`).join(", "));
}

/** Format numbers, such as "1–3, 5". @param {number[]} numbers in order */
function ranges(numbers) {
  const found = [];
  for (const each of numbers) {
    if (found.at(-1)?.[1] === each - 1) found.at(-1)[1] = each;
    else found.push([each, each]);
  }
  return found.map(([first, last]) => (first === last ? first : `${first}–${last}`)).join(", ");
}

/** Return the waypoints of motions that have not ended, in the odometry frame. @param {Asset} asset @param {number | null} utc_s null for now @returns {Target[]} */
function targetsOf(asset, utc_s) {
  const open = asset.commandsAt(utc_s).filter((each) => !each.ended && each.state !== "unknown" && (utc_s === null || each.created <= utc_s));
  const isMotion = ({ name }) => asset.entry?.commands.find((each) => each.name === name)?.motion ?? true;
  const targets = open.filter(isMotion).reverse().map((command) => {
    const steps = command.history.findLast((each) => each.step)?.step ?? 0;
    const points = pointsOf(asset, command, utc_s);
    return { command, points, step: Math.min(steps, points.length - 1) };
  });
  const isQueued = ({ command }) => Number(command.state !== "started");
  return targets.filter(({ points }) => points.length).sort((one, other) => isQueued(one) - isQueued(other));
}

/** Return the waypoints of a command, or else the predicted end. @param {Asset} asset @param {CommandStatus} command @param {number | null} utc_s @returns {Point[]} */
function pointsOf(asset, command, utc_s) {
  const isPoint = ({ x, y }) => Number.isFinite(x) && Number.isFinite(y);
  const given = [command.args?.waypoints ?? command.args ?? {}].flat().filter(isPoint);
  if (given.length) return asset.inOdometry(given, command.args.frame, utc_s);
  const figures = predicted(command);
  return [{ x: figures["predicted x"], y: figures["predicted y"] }].filter(isPoint);
}

/** @param {CommandStatus} command @returns {Record<string, any>} */
const predicted = (command) => command.history.findLast((each) => each.stage === "PREDICTED")?.figures ?? {};

/** Format the remaining distance along the waypoints, and the remaining time by the prediction. @param {Target} target @param {Fix} pose @param {number} speed_mps @returns {string[]} */
function remaining({ command, points, step }, pose, speed_mps) {
  const distance_m = lengthOf([pose, ...points.slice(step)]);
  const started = command.history.find((each) => each.stage === "STARTED");
  const left_s = predicted(command)["predicted duration"] - (pose.utc - (started?.utc ?? NaN));
  return [`${fixed(distance_m, 1)} m`, Number.isFinite(left_s) ? `${duration(Math.max(left_s, 0))} left` : leastTime(distance_m, speed_mps)];
}

/** Format the time of a distance without a prediction; empty if the speed is unknown. @param {number} distance_m @param {number} speed_mps */
const leastTime = (distance_m, speed_mps) => (speed_mps > 0 ? `≥ ${duration(distance_m / speed_mps)} left` : "");

/** The maximum speed of the rover; NaN if unknown, as at a time in the past. @param {Asset} asset @param {number | null} utc_s */
const maxSpeed = (asset, utc_s) => (utc_s === null ? Number(asset.newest("TRAVEL_SPEED")?.value) : NaN);

/** @param {Point[]} path */
const lengthOf = (path) => path.slice(1).reduce((sum, { x, y }, index) => sum + Math.hypot(x - path[index].x, y - path[index].y), 0);

/** @param {Viewport} viewport @param {Point[]} points */
const screen = (viewport, points) => points.map(({ x, y }) => viewport.toScreen(x, y).map((each) => each.toFixed(1)).join(",")).join(" ");

/** Write a label beside a point, or at the edge beside a point out of view. @param {SVGTextElement} label @param {string} text @param {Point} point @param {Viewport} viewport @param {number} [below_px] */
function drawLabel(label, text, point, viewport, below_px = 18) {
  const { width, height } = viewport.size;
  const [x, y] = viewport.toScreen(point.x, point.y);
  setText(label, text);
  const isLeft = x > width - 150;
  const within = (value, high) => Math.min(Math.max(value, MARGIN_PX), high - MARGIN_PX);
  set(label, { x: within(x + (isLeft ? -MARGIN_PX : MARGIN_PX), width), y: within(y + below_px, height), "text-anchor": isLeft ? "end" : "start" });
}
