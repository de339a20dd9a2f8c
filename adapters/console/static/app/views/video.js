/**
 * The camera, live: the newest picture, how many come, and a pad that turns it. The
 * stream is asked for while somebody watches; whether the rover sends it is a command of its own.
 */

import { ask, newId } from "../model/connection.js";
import { eachFrame, html, say } from "../dom.js";
import { radians } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */

/** Of the time of arrival, before each picture. */
const TIME_OCTETS = 8;
const STEP_DEG = 10;
const PAD = [
  ["↖", 1, 1], ["↑", 0, 1], ["↗", -1, 1],
  ["←", 1, 0], ["", 0, 0], ["→", -1, 0],
  ["↙", 1, -1], ["↓", 0, -1], ["↘", -1, -1],
];

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session } = context;
  /** @type {WebSocket | null} */
  let socket = null;
  let frames = 0;
  let octets = 0;
  let isDecoding = false;
  /** @type {ArrayBuffer | null} the newest that is not shown */
  let waiting = null;
  const canvas = html("canvas", { width: 640, height: 480, "data-testid": "video" });
  const rate = html("span", { className: "dim rate" });
  const told = html("span", { className: "told", role: "status" });
  const watch = html("button", { type: "button", onclick: () => (socket ? close() : open()) });
  const button = (textContent, title, onclick) => html("button", { type: "button", textContent, title, onclick });
  const root = html(
    "section",
    { className: "rover-view video-view" },
    html(
      "header",
      {},
      watch,
      button("video on", "have the rover send its video", () => send("executeAction", { action: "VIDEO ON" })),
      button("video off", "have it send none", () => send("executeAction", { action: "VIDEO OFF" })),
      button("take picture", "take one and store it aboard", () => send("takePicture", {})),
      html("span", { className: "tools" }, rate),
    ),
    html(
      "div",
      { className: "canvas" },
      canvas,
      html(
        "div",
        { className: "pad", title: `turns the camera by ${STEP_DEG}° each` },
        ...PAD.map(([sign, left, up]) => (sign ? button(sign, "turn the camera", () => turn(Number(left), Number(up))) : html("span"))),
      ),
    ),
    told,
  );
  element.append(root);

  function open() {
    const path = `/ws/video/${encodeURIComponent(asset.name)}`;
    socket = new WebSocket(new URL(path, location.href.replace(/^http/, "ws")));
    socket.binaryType = "arraybuffer";
    say(told, "Waiting for pictures: the rover sends them after “video on”.");
    socket.onmessage = ({ data }) => {
      waiting = data;
      show();
    };
    socket.onclose = ({ reason }) => {
      if (socket) say(told, reason || "The stream has ended; watch it again.");
      socket = null;
      draw();
    };
    draw();
  }

  function close() {
    const closed = socket;
    socket = null;
    closed?.close();
    say(told, "");
    draw();
  }

  /** Draw the newest picture; those that came while one was decoded are passed over. */
  async function show() {
    if (isDecoding || waiting === null) return;
    isDecoding = true;
    const message = waiting;
    waiting = null;
    try {
      const bitmap = await createImageBitmap(new Blob([message.slice(TIME_OCTETS)], { type: "image/jpeg" }));
      if (canvas.width !== bitmap.width) Object.assign(canvas, { width: bitmap.width, height: bitmap.height });
      canvas.getContext("2d").drawImage(bitmap, 0, 0);
      bitmap.close();
      canvas.dataset.frames = String(Number(canvas.dataset.frames ?? 0) + 1);
      frames++;
      octets += message.byteLength;
      say(told, "");
    } catch {
      say(told, "A picture could not be read.");
    } finally {
      isDecoding = false;
    }
    show();
  }

  async function send(name, args) {
    try {
      await ask("/api/commands", { json: { id: newId(), asset: asset.name, name, args } });
    } catch (error) {
      say(told, error.message);
    }
  }

  const turn = (left, up) => send("moveCameraAngles", { pan: radians(STEP_DEG * left), tilt: radians(STEP_DEG * up) });

  function render() {
    say(watch, socket ? "stop watching" : "watch");
    watch.classList.toggle("on", socket !== null);
  }

  function everySecond() {
    say(rate, socket ? `${frames} pictures/s, ${Math.round((octets * 8) / 1000)} kbit/s` : "");
    frames = octets = 0;
  }

  const draw = eachFrame(render);
  const off = session.onSecond(everySecond);
  open();
  return () => {
    off();
    close();
    root.remove();
  };
}
