/** The asset that the page shows, named by the address of the page in the format of Open MCT. */

import { identifierOf, partsOf } from "./identifiers.js";

const DISPLAY_OPTIONS = "hideInspector=true&hideRecents=true";
export const ROVERS = `#/browse/rover:rovers?${DISPLAY_OPTIONS}`;

export class Shown {
  /** @type {string | null} */
  name = null;
  #session;
  /** @type {string | null} the asset that was chosen last */
  #last = null;
  #hasNoPath = !location.hash.includes(":");

  /** @param {import("../model/session.js").Session} session */
  constructor(session) {
    this.#session = session;
    if (this.#hasNoPath) location.hash = ROVERS;
    this.update();
    session.on("assets", () => this.update());
    addEventListener("hashchange", () => this.update());
  }

  /** Show the operations of an asset. @param {string} name */
  choose(name) {
    this.name = this.#last = name;
    const path = [identifierOf(), identifierOf(name), identifierOf(name, "layout")];
    const keys = path.map((each, index) => (index ? `rover:${each.key}` : "rover:rovers")).join("/");
    location.hash = `#/browse/${keys}?${DISPLAY_OPTIONS}`;
  }

  /** Show the asset that was chosen last again, if Open MCT has replaced the address while it started. */
  restore() {
    if (this.#last !== null && this.name !== this.#last) this.choose(this.#last);
  }

  /** The asset of the shown object, else the first asset. */
  #chosen() {
    const found = /rover:([^/?]+)(?:[?]|$)/.exec(location.hash.replace(/rover:rovers\/?/, ""));
    const name = found ? partsOf({ key: found[1] })[0] : null;
    const assets = this.#session.rovers;
    if (assets.some((each) => each.name === name)) return name;
    if (name !== null && this.name !== null && this.#session.assets.has(name)) return this.name;
    return (assets.find((each) => !each.recording) ?? assets[0])?.name ?? null;
  }

  /** Follow the address. If it names no object, show the first rover as soon as there is one. */
  update() {
    const name = this.#chosen();
    if (this.#hasNoPath && name !== null) {
      this.#hasNoPath = false;
      this.choose(name);
    }
    this.name = name;
  }
}
