/** Layers of the map. Each is created once and updated from the state of the asset. */

import { reconcile, setText, set, svg } from "../dom.js";
import { clock, degrees, fixed } from "../format.js";

/** @import { Asset, Fix } from "../model/asset.js" */
/** @import { Draft } from "../model/draft.js" */
/** @import { PosePrediction, ZoneEntry } from "../model/messages.js" */
/** @import { Viewport } from "./viewport.js" */
/** @typedef {{position_m: number, heading_rad: number}} Uncertainty */

/** Grid lines, with their coordinates in metres. */
export class Grid {
  element = svg("g", { class: "grid" });

  /** @param {Viewport} viewport */
  render(viewport) {
    const { width, height } = viewport.size;
    const step = [0.1, 0.2, 0.5, 1, 2, 5, 10, 20, 50, 100].find((each) => each * viewport.scale >= 60) ?? 200;
    const [west, north] = viewport.toWorld(0, 0);
    const [east, south] = viewport.toWorld(width, height);
    /** @type {[string, number][]} */
    const lines = [];
    for (let x = Math.ceil(west / step) * step; x <= east; x += step) lines.push(["x", tidy(x)]);
    for (let y = Math.ceil(south / step) * step; y <= north; y += step) lines.push(["y", tidy(y)]);
    const make = () => svg("g", {}, svg("line"), svg("text"));
    reconcile(this.element, lines, (line) => line.join(""), make, ({ children: [line, text] }, [axis, value]) => {
      const [px, py] = viewport.toScreen(value, value);
      const across = axis === "x";
      const ends = across ? { x1: px, x2: px, y1: 0, y2: height } : { x1: 0, x2: width, y1: py, y2: py };
      set(line, { ...ends, class: value === 0 ? "origin" : "" });
      set(text, across ? { x: px + 3, y: height - 4 } : { x: 3, y: py - 3 });
      setText(text, `${value} m`);
    });
  }
}

/** Keep-in zones, keep-out zones and rocks. */
export class Zones {
  element = svg("g", { class: "zones" });

  /** @param {ZoneEntry[]} zones */
  render(zones) {
    const make = () => svg("g", {}, svg("polygon"), svg("title"));
    reconcile(this.element, zones, (zone) => zone.title, make, (made, zone) => {
      const [shape, title] = made.children;
      set(made, { class: zone.kind });
      set(shape, { points: outline(zone).map((each) => each.join(",")).join(" ") });
      setText(title, zone.title);
    });
  }
}

/** Obstacles that the laser has detected. */
export class Scanned {
  element = svg("g", { class: "scanned" });

  /** @param {import("../model/obstacles.js").Circle[]} circles */
  render(circles) {
    const make = () => svg("circle", {}, svg("title"));
    reconcile(this.element, circles, String, make, (made, [cx, cy, r]) => {
      set(made, { cx, cy, r });
      setText(made.firstChild, `scanned obstacle at ${fixed(cx, 2)}, ${fixed(cy, 2)}, radius ${fixed(r, 2)} m`);
    });
  }
}

/** The driven track: before and after the displayed time, and during the selected command. */
export class Tracks {
  #before = svg("polyline", { class: "track" });
  #after = svg("polyline", { class: "track ahead" });
  #marked = svg("polyline", { class: "track marked" });
  element = svg("g", {}, this.#after, this.#before, this.#marked);

  /** @param {Fix[]} track @param {number | null} utc_s null for now @param {number[] | null} span */
  render(track, utc_s, span) {
    const draw = (line, isPart) => set(line, { points: isPart ? track.filter(isPart).map((each) => `${each.x},${each.y}`).join(" ") : "" });
    draw(this.#before, (each) => each.utc <= (utc_s ?? Infinity));
    draw(this.#after, utc_s !== null && ((each) => each.utc >= utc_s));
    draw(this.#marked, span && ((each) => each.utc >= span[0] && each.utc <= span[1]));
  }
}

/** The track of a fork of the recording. */
export class ForkTrack {
  element = svg("g", {});

  /** @param {{x: number, y: number}[]} track */
  render(track) {
    const points = track.map((each) => `${each.x},${each.y}`).join(" ");
    this.element.replaceChildren(...(points ? [svg("polyline", { class: "track fork", points, "data-testid": "fork-track" })] : []));
  }
}

/** Predicted path of the command in preparation. */
export class Preview {
  element = svg("g", { class: "preview" });

  /** @param {Draft} draft @param {number} scale */
  render({ preview, target }, scale) {
    const path = preview?.path ?? [];
    const end = path.at(-1);
    const parts = [];
    if (path.length > 1) parts.push(svg("polyline", { points: path.map((each) => `${each.x},${each.y}`).join(" ") }));
    if (end) parts.push(svg("path", { d: arrow(scale), transform: turned(end), class: "ghost" }));
    else if (target) parts.push(svg("circle", { cx: target.x, cy: target.y, r: 6 / scale }));
    this.element.replaceChildren(...parts);
  }
}

/** Uncertainty of the pose: a circle for the position and a sector for the heading. */
export class UncertaintyMark {
  #circle = svg("circle");
  #sector = svg("path");
  #title = svg("title");
  element = svg("g", { class: "uncertain", "data-testid": "uncertain" }, this.#circle, this.#sector, this.#title);

  /** @param {Asset} asset @param {Fix | null} pose @param {Uncertainty | null} uncertainty @param {number} scale */
  render(asset, pose, uncertainty, scale) {
    set(this.element, { visibility: uncertainty ? "visible" : "hidden" });
    if (!uncertainty) return;
    const { position_m, heading_rad } = uncertainty;
    const half = Math.min(heading_rad, 3.1);
    const reach = Math.max(position_m, asset.footprint.length_m, 30 / scale) + 20 / scale;
    const [x, y] = [reach * Math.cos(half), reach * Math.sin(half)];
    set(this.#circle, { r: position_m });
    set(this.#sector, { d: `M0 0L${x} ${-y}A${reach} ${reach} 0 ${half > Math.PI / 2 ? 1 : 0} 1 ${x} ${y}Z` });
    set(this.element, { transform: turned(pose), "data-position": position_m.toFixed(3) });
    setText(this.#title, `${asset.name} is ${uncertainBy(uncertainty)}: correct its pose by setPositionCompensation, or, once checked, confirm it by confirmPose with position 0 and heading 0`);
  }
}

/** The rover's footprint and heading. */
export class Rover {
  #body = svg("rect", { class: "body" });
  #nose = svg("path", { class: "nose" });
  #title = svg("title");
  element;

  /** @param {string} [kind] class of its element */
  constructor(kind = "rover") {
    this.element = svg("g", { class: kind, "data-testid": kind }, this.#body, this.#nose, this.#title);
  }

  /** @param {Asset} asset @param {Fix | null} pose @param {number} scale */
  render({ name, footprint: { length_m, width_m } }, pose, scale) {
    set(this.element, { visibility: pose ? "visible" : "hidden" });
    if (!pose) return;
    set(this.#body, { x: -length_m / 2, y: -width_m / 2, width: length_m, height: width_m });
    set(this.#nose, { d: arrow(scale) });
    set(this.element, { transform: turned(pose), "data-x": pose.x.toFixed(3), "data-y": pose.y.toFixed(3) });
    setText(this.#title, `${name}, ${clock(pose.utc)}`);
  }
}

/** Where the next command finds the rover, its deviation at 2 sigma, and the path that it is on in any case. */
export class Predicted {
  #path = svg("polyline");
  #circle = svg("circle");
  #rover = new Rover("predicted-rover");
  element = svg("g", { class: "predicted" });

  /** @param {Asset} asset @param {PosePrediction | null} predicted @param {number} scale */
  render(asset, predicted, scale) {
    this.element.replaceChildren(...(predicted ? [this.#path, this.#circle, this.#rover.element] : []));
    if (!predicted) return;
    set(this.#path, { points: predicted.path.map((each) => each.join(",")).join(" ") });
    set(this.#circle, { cx: predicted.x, cy: predicted.y, r: predicted.within, "data-within": predicted.within.toFixed(3) });
    this.#rover.render(asset, { ...predicted, utc: predicted.arrival }, scale);
  }
}

/** @param {Uncertainty} uncertainty */
export function uncertainBy({ position_m, heading_rad }) {
  return `uncertain by ${fixed(position_m, 2)} m and ${fixed(degrees(heading_rad), 1)}°`;
}

/** Round to 0.01, without the noise of binary fractions. @param {number} value */
export function tidy(value) {
  return Math.round(value * 100) / 100 || 0;
}

/** @param {ZoneEntry} zone */
export function outline({ corners, x, y, radius }) {
  if (corners.length) return corners;
  const angles = Array.from({ length: 24 }, (_, part) => (part / 24) * 2 * Math.PI);
  return angles.map((angle) => [x + radius * Math.cos(angle), y + radius * Math.sin(angle)]);
}

/** @param {{x: number, y: number, heading: number | null}} pose */
const turned = (pose) => `translate(${pose.x} ${pose.y}) rotate(${degrees(pose.heading ?? 0)})`;

/** Return the path of an arrow with a minimum size in px. @param {number} scale */
function arrow(scale) {
  const half = Math.max(0.25, 9 / scale);
  return `M${half} 0L${-half * 0.8} ${half * 0.65}L${-half * 0.45} 0L${-half * 0.8} ${-half * 0.65}Z`;
}
