/** A recording: what it is of, and the moment of it that is looked at. */

import { ask } from "../model/connection.js";
import { eachFrame, html, say } from "../dom.js";
import { age, clock } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */

const STEP_S = 0.05;

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, cursor } = context;
  const what = html("p", { className: "what" });
  const at = html("output", { className: "at" });
  const slider = html("input", {
    type: "range",
    "aria-label": "moment",
    step: STEP_S,
    oninput: () => look(asset.recording.began + Number(slider.value)),
  });
  const button = (textContent, title, onclick) => html("button", { type: "button", textContent, title, onclick });
  const root = html(
    "section",
    { className: "rover-view recording-view" },
    what,
    slider,
    html(
      "div",
      { className: "buttons" },
      button("◂ told", "the moment before at which it told something", () => step(-1)),
      at,
      button("told ▸", "the next moment at which it told something", () => step(1)),
      html("span", { className: "tools" }, button("close", "take it off the console; the file stays as it is", close)),
    ),
  );
  element.append(root);

  /** @param {number} utc */
  function look(utc) {
    const { began, ended } = asset.recording;
    cursor.set(Math.min(Math.max(utc, began), ended));
  }

  /** Go to the nearest moment, back or forth, at which something was told. */
  function step(direction) {
    const now = cursor.utc_s ?? asset.recording.ended;
    const isBeyond = (each) => (each.utc - now) * direction > STEP_S / 2;
    const told = direction > 0 ? asset.notices.find(isBeyond) : asset.notices.findLast(isBeyond);
    if (told) look(told.utc);
  }

  async function close() {
    await ask(`/api/recordings/${encodeURIComponent(asset.name)}`, { method: "DELETE" }).catch((error) => say(what, error.message));
  }

  function render() {
    const { recording } = asset;
    if (!recording) return;
    const { file, rover, began, ended, whole, damaged } = recording;
    const now = cursor.utc_s ?? ended;
    say(what, `${file}: a recording of ${rover}, ${new Date(began * 1000).toISOString().slice(0, 10)} from ${clock(began)} to ${clock(ended)} UTC (${age(ended - began)}). It ${whole ? "" : `${damaged ? "is damaged" : "breaks off"} there; it `}can be looked at, not commanded.`);
    slider.max = String(ended - began);
    slider.value = String(now - began);
    say(at, `${clock(now, true)}, ${(now - began).toFixed(2)} s`);
  }

  const draw = eachFrame(render);
  const offs = [asset.on("entry", draw), cursor.on(draw)];
  draw();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

/**
 * Give a file of this computer to the console.
 * @param {File} file
 * @returns {Promise<string>} the name of the asset that it is shown as
 */
export async function open(file) {
  const { asset } = await ask(`/api/recordings/${encodeURIComponent(file.name)}`, { method: "POST", body: file });
  return asset;
}
