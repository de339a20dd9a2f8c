/** The obstacles that the laser has detected, polled while a view shows them; earlier ones as far as this page has received them. */

import { fetchJson } from "./connection.js";

/** @import { Asset } from "./asset.js" */
/** @import { Session } from "./session.js" */
/** @typedef {[x: number, y: number, radius: number]} Circle in the odometry frame, m */

const POLL_S = 2;
const MAX_CHANGES = 500;
/** Status of HTTP for a rover that did not answer in time. */
const UNAVAILABLE = 503;

export class ScannedObstacles {
  #session;
  #asset;
  #changed;
  #offs;
  #nextPoll = 0;
  /** @type {{utc: number, circles: Circle[]}[]} */
  #changes = [];

  /** @param {Session} session @param {Asset} asset @param {() => void} changed called after each change */
  constructor(session, asset, changed) {
    this.#session = session;
    this.#asset = asset;
    this.#changed = changed;
    this.#offs = [session.onSecond(() => this.#poll()), asset.on("links", () => (this.#nextPoll = 0))];
  }

  close() {
    this.#offs.forEach((off) => off());
  }

  /** @param {number | null} utc_s null for now @returns {Circle[]} */
  at(utc_s) {
    return this.#changes.findLast((each) => each.utc <= (utc_s ?? Infinity))?.circles ?? [];
  }

  async #poll() {
    const { pose, name, recording, isReached } = this.#asset;
    if (!pose || recording || !isReached || document.hidden || this.#session.now < this.#nextPoll) return;
    this.#nextPoll = Infinity;
    try {
      const { obstacles } = await fetchJson(`/api/obstacles/${encodeURIComponent(name)}`);
      this.#nextPoll = this.#session.now + POLL_S;
      if (String(obstacles) === String(this.at(null))) return;
      this.#changes = [...this.#changes, { utc: pose.utc, circles: obstacles }].slice(-MAX_CHANGES);
      this.#changed();
    } catch (error) {
      console.info(error.message); // an orbiter has none: polled again after a change of a link
      if (error.status === UNAVAILABLE) this.#nextPoll = this.#session.now + POLL_S;
    }
  }
}
