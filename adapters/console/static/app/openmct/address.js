/** The asset that the page shows, named by the address of the page in the format of Open MCT. */

import { identifierOf, partsOf } from "./identifiers.js";

const DISPLAY_OPTIONS = "hideInspector=true&hideRecents=true";
const WRITE_MS = 300;
export const ROVERS = `#/browse/rover:rovers?${DISPLAY_OPTIONS}`;

/**
 * Let a new address win over what Open MCT writes. It writes its location 300 ms later than a change, and reads what
 * it has written: that would replace an address that it has not read yet, and undo a later change.
 * @param {any} router of Open MCT
 */
export function keepNewerAddress(router) {
  /** the address that the router has read or written last */
  let known = "";
  let timer = 0;
  const read = router.hashChanged.bind(router);
  router.hashChanged = (hash) => {
    if (location.hash === known) return;
    known = location.hash;
    read(hash);
  };
  router.setHash = () => {
    clearTimeout(timer);
    timer = setTimeout(() => {
      if (location.hash !== known) return;
      const { path, getQueryString } = router.getCurrentLocation();
      location.hash = `${path}?${getQueryString()}`;
      known = location.hash;
    }, WRITE_MS);
  };
}

export class Shown {
  /** @type {string | null} */
  name = null;
  #session;
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
    this.name = name;
    const path = [identifierOf(), identifierOf(name), identifierOf(name, "layout")];
    const keys = path.map((each, index) => (index ? `rover:${each.key}` : "rover:rovers")).join("/");
    location.hash = `#/browse/${keys}?${DISPLAY_OPTIONS}`;
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
