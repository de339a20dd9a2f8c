/**
 * Driving by keys or gamepad, beside the camera. While a key is held, `drive` is repeated; each one lasts for
 * HOLD_S aboard, so that the rover stops by itself when none follows. As the key is released, the page loses the
 * focus or the gamepad its connection, zero velocity is commanded at once; it does not latch, as STOP does.
 */

import { fetchJson, newId } from "../model/connection.js";
import { button, html, setText } from "../dom.js";
import { View } from "./view.js";
import { degrees } from "../format.js";

const PERIOD_MS = 250;
/** Duration of each drive aboard, and its maximum age at arrival: the dead-man. */
const HOLD_S = 0.8;
const LIFETIME_S = 2;
const CLOCK_OFFSET = "LINK_CLOCK_OFFSET";
/** With a larger clock offset no age is known. */
const MAX_OFFSET_S = 86_400;
const DEAD_ZONE = 0.15;
/** Direction ahead and to the left, by the code of a key. @type {Record<string, [number, number]>} */
const KEYS = {
  KeyW: [1, 0], ArrowUp: [1, 0],
  KeyS: [-1, 0], ArrowDown: [-1, 0],
  KeyA: [0, 1], ArrowLeft: [0, 1],
  KeyD: [0, -1], ArrowRight: [0, -1],
};
const SPEED = ["CURRENT_TRAVEL_SPEED", "CURRENT_ROTATE_SPEED"];
const STANDING = [0, 0];
const STOPPED_MODES = ["STOPPED", "SAFE"];

export class Teleop extends View {
  #isArmed = false;
  /** codes of the held keys */
  #held = new Set();
  /** @type {number[]} direction of the gamepad */
  #stick = STANDING;
  /** index of the gamepad in use */
  #pad = -1;
  /** @type {number[]} the velocity last commanded, as shares of the maximum */
  #commanded = STANDING;
  #isSending = false;
  /** id of the last drive */
  #last = "";
  #timer = 0;

  #arm = button("", "W A S D or arrow keys, or the left stick of a gamepad", () => this.#setArmed(!this.#isArmed), { className: "arm", "aria-pressed": "false" });
  #share = html("input", { type: "range", min: "5", max: "100", value: "30", "aria-label": "maximum speed", oninput: () => this.draw() });
  #bounds = html("span", { className: "figure" });
  #actual = html("span", { className: "figure", "data-testid": "velocity" });
  #message = html("span", { className: "message", role: "status", "data-testid": "teleop" });
  root = html("div", { className: "teleop" }, this.#arm, html("label", {}, "up to ", this.#share, this.#bounds), this.#actual, this.#message);

  start() {
    const ending = new AbortController();
    const { signal } = ending;
    const release = () => this.#release();
    addEventListener("keydown", (event) => this.#onKey(event, true), { signal });
    addEventListener("keyup", (event) => this.#onKey(event, false), { signal });
    addEventListener("blur", release, { signal });
    addEventListener("pagehide", release, { signal });
    addEventListener("gamepaddisconnected", release, { signal });
    document.addEventListener("visibilitychange", () => document.hidden && release(), { signal });
    const topics = ["values", "status", "tree", "commands", "entry"];
    return [...topics.map((topic) => this.asset.on(topic, this.draw)), () => (this.#setArmed(false), ending.abort())];
  }

  /** @param {boolean} isArmed @param {string} [why] */
  #setArmed(isArmed, why = "") {
    if (!isArmed) this.#release();
    this.#isArmed = isArmed;
    clearInterval(this.#timer);
    if (isArmed) this.#timer = window.setInterval(() => this.#tick(), PERIOD_MS);
    this.#last = "";
    setText(this.#message, why);
    this.draw();
  }

  /** @param {KeyboardEvent} event @param {boolean} isDown */
  #onKey(event, isDown) {
    const isTyping = event.target instanceof Element && event.target.closest("input:not([type=range]), textarea, select");
    if (!this.#isArmed || !(event.code in KEYS) || (isDown && (isTyping || event.ctrlKey || event.altKey || event.metaKey))) return;
    if (isDown) event.preventDefault();
    if (event.repeat) return;
    if (isDown) this.#held.add(event.code);
    else this.#held.delete(event.code);
    this.#send();
  }

  /** Command zero velocity, and forget the held keys. */
  #release() {
    this.#held.clear();
    this.#stick = STANDING;
    this.#pad = -1;
    if (this.#commanded.some(Boolean)) this.#send();
  }

  #tick() {
    this.#readGamepad();
    if (this.#wanted.some(Boolean) || this.#commanded.some(Boolean)) this.#send();
  }

  /** Read the gamepad in use, otherwise the first one that is moved; a lost one commands zero. */
  #readGamepad() {
    const pads = document.hasFocus() ? [...navigator.getGamepads()].filter((each) => each?.connected) : [];
    /** @param {Gamepad} pad */
    const axes = ({ axes: [x, y] }) => [-y, -x].map((each) => (Math.abs(each) > DEAD_ZONE ? each : 0));
    const pad = pads.find((each) => each.index === this.#pad) ?? pads.find((each) => axes(each).some(Boolean));
    this.#pad = pad?.index ?? -1;
    this.#stick = pad ? axes(pad) : STANDING;
  }

  /** The wanted velocity, as shares of the maximum. */
  get #wanted() {
    const directions = [...[...this.#held].map((code) => KEYS[code]), this.#stick];
    return [0, 1].map((axis) => Math.max(-1, Math.min(1, directions.reduce((sum, each) => sum + each[axis], 0))));
  }

  /** The maximum travel speed in m/s and turn rate in rad/s: those of the slider, within the asset's bounds. */
  get #limits() {
    const [travel, rotate] = this.asset.entry?.commands.find(({ name }) => name === "drive")?.arguments ?? [];
    return [travel, rotate].map((each) => ((each?.high ?? 0) * Number(this.#share.value)) / 100);
  }

  /** Send the wanted velocity. One request is pending at a time, so that none overtakes another; the latest follows. */
  async #send() {
    if (this.#isSending) return;
    this.#isSending = true;
    try {
      do {
        const wanted = this.#wanted;
        this.#commanded = wanted;
        await this.#drive(wanted.map((each, axis) => each * this.#limits[axis]));
      } while (this.#wanted.join() !== this.#commanded.join());
    } catch (error) {
      this.#setArmed(false, `${error.message}. A rover in motion stops by itself after ${HOLD_S} s.`);
    } finally {
      this.#isSending = false;
    }
    this.draw();
  }

  /** @param {number[]} velocity */
  #drive([travel, rotate]) {
    const args = { travel, rotate, duration: travel || rotate ? HOLD_S : 0 };
    const ahead_s = Math.max(0, Number(this.asset.newest(CLOCK_OFFSET)?.value ?? 0));
    this.#last = newId();
    const lifetime = ahead_s < MAX_OFFSET_S ? LIFETIME_S + ahead_s : undefined;
    const json = { id: this.#last, asset: this.asset.name, name: "drive", args, preemption: "replace", lifetime };
    return fetchJson("/api/commands", { json, keepalive: true, signal: AbortSignal.timeout(LIFETIME_S * 1000) });
  }

  render() {
    const { asset } = this;
    const [travel, rotate] = this.#limits;
    this.root.hidden = travel === 0;
    const last = asset.commands.get(this.#last);
    if (this.#isArmed && STOPPED_MODES.includes(asset.mode)) {
      this.#commanded = STANDING;
      this.#setArmed(false, `${asset.mode}: resume the rover first`);
    } else if (this.#isArmed && last && ["rejected", "failed", "expired"].includes(last.state)) this.#setArmed(false, last.history.at(-1)?.detail);
    setText(this.#arm, `drive by keys: ${this.#isArmed ? "on" : "off"}`);
    this.#arm.classList.toggle("on", this.#isArmed);
    this.#arm.setAttribute("aria-pressed", String(this.#isArmed));
    setText(this.#bounds, ` ${travel.toFixed(2)} m/s, ${degrees(rotate).toFixed(0)} °/s`);
    const [speed, rate] = SPEED.map((key) => asset.newest(key)?.value);
    setText(this.#actual, typeof speed === "number" && typeof rate === "number" ? `actual ${speed.toFixed(2)} m/s, ${degrees(rate).toFixed(0)} °/s` : "");
  }
}
