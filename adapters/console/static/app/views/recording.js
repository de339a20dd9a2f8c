/** A recording: what it is of, and the moment of it that is looked at. */

import { ask } from "../model/connection.js";
import { button, html, say } from "../dom.js";
import { View } from "./view.js";
import { age, clock } from "../words.js";

const STEP_S = 0.05;

export class RecordingView extends View {
  #what = html("p", { className: "what" });
  #at = html("output", { className: "at" });
  #slider = html("input", { type: "range", "aria-label": "moment", step: STEP_S, oninput: () => this.#look(this.asset.recording.began + Number(this.#slider.value)) });
  root = html(
    "section",
    { className: "rover-view recording-view" },
    this.#what,
    this.#slider,
    html(
      "div",
      { className: "buttons" },
      button("◂ told", "the moment before at which it told something", () => this.#step(-1)),
      this.#at,
      button("told ▸", "the next moment at which it told something", () => this.#step(1)),
      html("span", { className: "tools" }, button("close", "take it off the console; the file stays as it is", () => this.#close())),
    ),
  );

  start() {
    return [this.asset.on("entry", this.draw), this.cursor.on(this.draw)];
  }

  /** @param {number} utc */
  #look(utc) {
    const { began, ended } = this.asset.recording;
    this.cursor.set(Math.min(Math.max(utc, began), ended));
  }

  /** Go to the nearest moment, back or forth, at which something was told. @param {1 | -1} direction */
  #step(direction) {
    const { recording, notices } = this.asset;
    const now = this.cursor.utc_s ?? recording.ended;
    const isBeyond = (each) => (each.utc - now) * direction > STEP_S / 2;
    const told = direction > 0 ? notices.find(isBeyond) : notices.findLast(isBeyond);
    if (told) this.#look(told.utc);
  }

  async #close() {
    await ask(`/api/recordings/${encodeURIComponent(this.asset.name)}`, { method: "DELETE" }).catch((error) => say(this.#what, error.message));
  }

  render() {
    const { recording } = this.asset;
    if (!recording) return;
    const { file, rover, began, ended, whole, damaged } = recording;
    const now = this.cursor.utc_s ?? ended;
    say(this.#what, `${file}: a recording of ${rover}, ${new Date(began * 1000).toISOString().slice(0, 10)} from ${clock(began)} to ${clock(ended)} UTC (${age(ended - began)}). It ${whole ? "" : `${damaged ? "is damaged" : "breaks off"} there; it `}can be looked at, not commanded.`);
    this.#slider.max = String(ended - began);
    this.#slider.value = String(now - began);
    say(this.#at, `${clock(now, true)}, ${(now - began).toFixed(2)} s`);
  }
}

/** Give a file of this computer to the console. @param {File} file @returns {Promise<string>} the name of the asset that it is shown as */
export async function openRecording(file) {
  const { asset } = await ask(`/api/recordings/${encodeURIComponent(file.name)}`, { method: "POST", body: file });
  return asset;
}
