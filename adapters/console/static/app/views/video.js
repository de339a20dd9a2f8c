/**
 * The camera, live: the newest picture, the frame rate, and a pad that turns the camera. The stream is
 * requested while the view is open; a separate command switches the rover's video. Below it the rover is driven by keys.
 */

import { fetchJson, newId } from "../model/connection.js";
import { button, html, setText } from "../dom.js";
import { Teleop } from "./teleop.js";
import { View } from "./view.js";
import { degrees, fixed, radians } from "../format.js";

/** Octets of the reception time before each picture. */
const TIME_OCTETS = 8;
const STEP_DEG = 10;
const PAD = [
  ["↖", 1, 1], ["↑", 0, 1], ["↗", -1, 1],
  ["←", 1, 0], ["", 0, 0], ["→", -1, 0],
  ["↙", 1, -1], ["↓", 0, -1], ["↘", -1, -1],
];

export class VideoView extends View {
  /** @type {WebSocket | null} */
  #socket = null;
  /** frames and octets of this second */
  #frames = 0;
  #octets = 0;
  #isDecoding = false;
  /** @type {ArrayBuffer | null} the newest picture, not shown yet */
  #waiting = null;

  #canvas = html("canvas", { width: 640, height: 480, "data-testid": "video" });
  #teleop = html("div");
  #rate = html("span", { className: "dim rate" });
  #angles = html("span", { className: "dim angles", "data-testid": "camera-angles" });
  #message = html("span", { className: "message", role: "status" });
  #watch = button("", "", () => (this.#socket ? this.#close() : this.#open()));
  #pad = PAD.map(([sign, left, up]) => (sign ? button(String(sign), "turn the camera", () => this.#turn(Number(left), Number(up))) : html("span")));
  root = html(
    "section",
    { className: "rover-view video-view" },
    html(
      "header",
      {},
      this.#watch,
      button("video on", "switch the rover's video on", () => this.#send("executeAction", { action: "VIDEO ON" })),
      button("video off", "switch the rover's video off", () => this.#send("executeAction", { action: "VIDEO OFF" })),
      button("take picture", "take a picture and store it aboard", () => this.#send("takePicture", {})),
      html("span", { className: "tools" }, this.#angles, this.#rate),
    ),
    html("div", { className: "canvas" }, this.#canvas, html("div", { className: "pad", title: `turns the camera by ${STEP_DEG}° each` }, ...this.#pad)),
    this.#teleop,
    this.#message,
  );

  start() {
    this.#open();
    return [Teleop.mount(this.#teleop, this), this.asset.on("values", this.draw), this.session.onSecond(() => this.#drawRate()), () => this.#close()];
  }

  #open() {
    const path = `/ws/video/${encodeURIComponent(this.asset.name)}`;
    const socket = new WebSocket(new URL(path, location.href.replace(/^http/, "ws")));
    this.#socket = socket;
    socket.binaryType = "arraybuffer";
    setText(this.#message, "Waiting for pictures: the rover sends them after “video on”.");
    socket.onmessage = ({ data }) => {
      this.#waiting = data;
      this.#show();
    };
    socket.onclose = ({ reason }) => {
      if (this.#socket) setText(this.#message, reason || "The stream has ended; watch it again.");
      this.#socket = null;
      this.draw();
    };
    this.draw();
  }

  #close() {
    const closed = this.#socket;
    this.#socket = null;
    closed?.close();
    setText(this.#message, "");
    this.draw();
  }

  /** Draw the newest picture; earlier ones received during decoding are skipped. */
  async #show() {
    if (this.#isDecoding || this.#waiting === null) return;
    this.#isDecoding = true;
    const message = this.#waiting;
    this.#waiting = null;
    try {
      const canvas = this.#canvas;
      const bitmap = await createImageBitmap(new Blob([message.slice(TIME_OCTETS)], { type: "image/jpeg" }));
      if (canvas.width !== bitmap.width) Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
      canvas.getContext("2d").drawImage(bitmap, 0, 0);
      bitmap.close();
      canvas.dataset.frames = String(Number(canvas.dataset.frames ?? 0) + 1);
      this.#frames++;
      this.#octets += message.byteLength;
      setText(this.#message, "");
    } catch {
      setText(this.#message, "A picture could not be decoded.");
    } finally {
      this.#isDecoding = false;
    }
    this.#show();
  }

  async #send(name, args) {
    await fetchJson("/api/commands", { json: { id: newId(), asset: this.asset.name, name, args } }).catch((error) => setText(this.#message, error.message));
  }

  /** @param {number} left steps @param {number} up steps */
  #turn(left, up) {
    return this.#send("moveCameraAngles", { pan: radians(STEP_DEG * left), tilt: radians(STEP_DEG * up) });
  }

  render() {
    setText(this.#watch, this.#socket ? "stop watching" : "watch");
    this.#watch.classList.toggle("on", this.#socket !== null);
    /** @type {[string, number][]} */
    const angles = [["pan", "CAM_PAN"], ["tilt", "CAM_TILT"]].map(([name, key]) => [name, Number(this.asset.newest(key)?.value ?? NaN)]);
    setText(this.#angles, angles.map(([name, value]) => (Number.isFinite(value) ? `${name} ${fixed(degrees(value), 0)}°` : "")).filter(Boolean).join("  "));
  }

  #drawRate() {
    setText(this.#rate, this.#socket ? `${this.#frames} pictures/s, ${Math.round((this.#octets * 8) / 1000)} kbit/s` : "");
    this.#frames = this.#octets = 0;
  }
}
