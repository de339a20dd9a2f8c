/** Pictures: their marks on the map, and a picture that is shown over a view until it is closed. */

import { button, html, reconcile, setText, set, svg } from "../dom.js";
import { clock, degrees, inDisplayUnit } from "../format.js";
import { commandOf, urlOf } from "../model/pictures.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { FileEntry } from "../model/messages.js" */
/** @import { Viewport } from "./viewport.js" */

/** Sector of a mark, outside the number of a step at its position: px, and half of its angle, rad; no field of view. */
const [INNER_PX, OUTER_PX, HALF_RAD] = [16, 30, 0.35];

/** Positions and directions of pictures, in px. */
export class PictureMarks {
  element = svg("g", { class: "pictures" });
  /** @type {{x: any, y: any}[]} positions of the pictures */
  points = [];

  /** @param {Asset} asset @param {FileEntry[]} pictures @param {Viewport} viewport @param {(picture: FileEntry) => void} onChosen */
  render(asset, pictures, viewport, onChosen) {
    this.points = pictures.map(({ meta }) => ({ x: meta.POS_X, y: meta.POS_Y }));
    const make = (picture) => svg("g", { "data-picture": picture.path }, svg("path", { d: sector() }), svg("title"));
    reconcile(this.element, pictures, ({ path, modified }) => `${path} ${modified}`, make, (mark, picture) => {
      const { POS_X: x, POS_Y: y, HEAD: heading, CAM_PAN: pan } = picture.meta;
      const direction = -degrees((heading ?? 0) + (pan ?? 0));
      set(mark, { transform: `translate(${viewport.toScreen(x, y)}) rotate(${direction.toFixed(1)})` });
      setText(mark.children[1], [picture.path, ...aboutPicture(asset, picture)].join("\n"));
      mark.onpointerdown = (event) => event.stopPropagation();
      mark.onclick = () => onChosen(picture);
    });
  }
}

/** A picture with its caption, closed by a button or Escape. */
export class ShownPicture {
  #shown = "";
  #picture = html("img", { alt: "", onerror: () => setText(this.#caption, "The picture could not be fetched.") });
  #caption = html("figcaption", { className: "dim" });
  root = html("figure", { className: "shown-picture", hidden: true }, button("×", "close (Escape)", () => this.close(), { className: "close" }), this.#picture, this.#caption);

  /** @returns {() => void} ends it */
  start() {
    const onKey = (event) => event.key === "Escape" && this.close();
    document.addEventListener("keydown", onKey);
    return () => document.removeEventListener("keydown", onKey);
  }

  close() {
    this.root.hidden = true;
    this.#shown = "";
    this.#picture.removeAttribute("src");
  }

  /** @param {Asset} asset @param {FileEntry} picture @param {Promise<FileEntry>} [attributes] */
  show(asset, picture, attributes = Promise.resolve(picture)) {
    const url = urlOf(asset.name, picture.path);
    this.#shown = url;
    this.root.hidden = false;
    setText(this.#caption, asset.isConsole ? picture.path : `Fetching ${picture.path} from the rover …`);
    this.#picture.onload = async () => {
      const about = await attributes.catch(() => picture);
      if (this.#shown === url) setText(this.#caption, [picture.path, ...aboutPicture(asset, about)].join("; "));
    };
    this.#picture.src = url;
  }
}

/** Format time, command, pose and camera angles of a picture. @param {Asset} asset @param {FileEntry} picture @returns {string[]} */
function aboutPicture(asset, picture) {
  const entries = new Map(asset.entry?.parameters.map((each) => [each.key, each]));
  const figures = Object.entries(picture.meta).filter(([key]) => entries.has(key)).map(([key, value]) => {
    const { text, unit } = inDisplayUnit(value, entries.get(key));
    return `${entries.get(key)?.name} ${text} ${unit}`.trim();
  });
  const command = commandOf(asset, picture);
  return [`${clock(picture.modified)} UTC`, ...(command ? [`${command.name} of ${command.by}`] : []), ...figures];
}

function sector() {
  const [cos, sin] = [Math.cos(HALF_RAD), Math.sin(HALF_RAD)];
  const at = (radius, side) => `${(radius * cos).toFixed(1)} ${(radius * sin * side).toFixed(1)}`;
  return `M${at(INNER_PX, -1)}L${at(OUTER_PX, -1)}A${OUTER_PX} ${OUTER_PX} 0 0 1 ${at(OUTER_PX, 1)}L${at(INNER_PX, 1)}A${INNER_PX} ${INNER_PX} 0 0 0 ${at(INNER_PX, -1)}Z`;
}
