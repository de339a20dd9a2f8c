/** Layers of the map, in px: goals of the active and queued motions of all clients, and the steps of plans. */

import { reconcile, setText, set, svg } from "../dom.js";
import { duration, fixed } from "../format.js";

/** @import { Asset, Fix, Point } from "../model/asset.js" */
/** @import { CommandStatus } from "../model/messages.js" */
/** @import { Viewport } from "./viewport.js" */
/** @typedef {{command: CommandStatus, points: Point[], step: number}} Target `step`: number of waypoints passed */

const MARGIN_PX = 12;
const GOAL_PX = 6;

/** Goals of the active and queued motions, in the order of execution, with the remaining distance and time of the active one. */
export class Goals {
  element = svg("g", { class: "goals" });
  /** @type {Point[]} the drawn points */
  points = [];

  /** @param {Asset} asset @param {number | null} utc_s null for now @param {Fix | null} pose @param {Viewport} viewport */
  render(asset, utc_s, pose, viewport) {
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
      set(line, { points: screen(viewport, [...(start ? [start] : []), ...points.slice(step)]) });
      reconcile(marks, points, (each) => String(points.indexOf(each)), () => svg("circle"), (mark, point) => {
        const [cx, cy] = viewport.toScreen(point.x, point.y);
        set(mark, { cx, cy, r: GOAL_PX, class: points.indexOf(point) < step ? "done" : "" });
      });
      const text = [command.name, ...(isActive && pose ? remaining(target, pose) : [])].join("  ");
      drawLabel(label, text, points.at(-1), viewport);
      setText(title, `${isActive ? "active" : "queued"}: ${command.name} of ${command.by}`);
    });
  }
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

/** Format the remaining distance along the waypoints, and the remaining time by the prediction. @param {Target} target @param {Fix} pose @returns {string[]} */
function remaining({ command, points, step }, pose) {
  const path = [pose, ...points.slice(step)];
  const distance_m = path.slice(1).reduce((sum, { x, y }, index) => sum + Math.hypot(x - path[index].x, y - path[index].y), 0);
  const started = command.history.find((each) => each.stage === "STARTED");
  const left_s = predicted(command)["predicted duration"] - (pose.utc - (started?.utc ?? NaN));
  return [`${fixed(distance_m, 1)} m`, Number.isFinite(left_s) ? `${duration(Math.max(left_s, 0))} left` : ""].filter(Boolean);
}

/** @param {Viewport} viewport @param {Point[]} points */
const screen = (viewport, points) => points.map(({ x, y }) => viewport.toScreen(x, y).map((each) => each.toFixed(1)).join(",")).join(" ");

/** Write a label beside a point, or at the edge beside a point out of view. @param {SVGTextElement} label @param {string} text @param {Point} point @param {Viewport} viewport */
function drawLabel(label, text, point, viewport) {
  const { width, height } = viewport.size;
  const [x, y] = viewport.toScreen(point.x, point.y);
  setText(label, text);
  const isLeft = x > width - 150;
  const within = (value, high) => Math.min(Math.max(value, MARGIN_PX), high - MARGIN_PX);
  set(label, { x: within(x + (isLeft ? -MARGIN_PX : MARGIN_PX), width), y: within(y + 4, height), "text-anchor": isLeft ? "end" : "start" });
}
