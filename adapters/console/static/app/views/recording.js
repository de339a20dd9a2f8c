/** A recording: its description, and a slider for the displayed time. */

import { fetchJson } from "../model/connection.js";
import { button, html, setText } from "../dom.js";
import { ForkPanel } from "./fork.js";
import { View } from "./view.js";
import { age, clock, interval } from "../format.js";

const STEP_S = 0.05;

export class RecordingView extends View {
  #what = html("p", { className: "what" });
  #at = html("output", { className: "at" });
  #fork = html("div");
  #slider = html("input", { type: "range", "aria-label": "moment", step: STEP_S, oninput: () => this.#setMoment(this.asset.recording.start + Number(this.#slider.value)) });
  root = html(
    "section",
    { className: "rover-view recording-view" },
    this.#what,
    this.#slider,
    html(
      "div",
      { className: "buttons" },
      button("◂ report", "previous report", () => this.#step(-1)),
      this.#at,
      button("report ▸", "next report", () => this.#step(1)),
      html("span", { className: "tools" }, button("close", "remove it from the console; the file is not changed", () => this.#close())),
    ),
    this.#fork,
  );

  start() {
    return [this.asset.on("entry", this.draw), this.cursor.on(this.draw), ForkPanel.mount(this.#fork, this)];
  }

  /** @param {number} utc */
  #setMoment(utc) {
    const { start, end } = this.asset.recording;
    this.cursor.set(Math.min(Math.max(utc, start), end));
  }

  /** Go to the previous or next notification. @param {1 | -1} direction */
  #step(direction) {
    const { recording, notices } = this.asset;
    const now = this.cursor.utc_s ?? recording.end;
    const isBeyond = (each) => (each.utc - now) * direction > STEP_S / 2;
    const notice = direction > 0 ? notices.find(isBeyond) : notices.findLast(isBeyond);
    if (notice) this.#setMoment(notice.utc);
  }

  async #close() {
    await fetchJson(`/api/recordings/${encodeURIComponent(this.asset.name)}`, { method: "DELETE" }).catch((error) => setText(this.#what, error.message));
  }

  render() {
    const { recording } = this.asset;
    if (!recording) return;
    const { file, rover, start, end, complete, damaged } = recording;
    const now = this.cursor.utc_s ?? end;
    setText(this.#what, `${file}: a recording of ${rover}, ${interval(start, end)} UTC (${age(end - start)}). ${complete ? "" : `${damaged ? "Damaged" : "Incomplete"} from there on. `}View only.`);
    this.#slider.max = String(end - start);
    this.#slider.value = String(now - start);
    setText(this.#at, `${clock(now, true)}, ${(now - start).toFixed(2)} s`);
  }
}

/**
 * Open a recording by a request, and show it.
 * @param {import("../model/context.js").Context} context
 * @param {string} path
 * @param {{body?: File, utc_s?: number}} [options] the file, and the displayed time; by default the end
 */
export async function openRecording({ session, shown, cursor }, path, { body, utc_s } = {}) {
  const { asset } = await fetchJson(path, { method: "POST", body });
  await session.readDictionary();
  const isThere = new Promise((resolve) => addEventListener("hashchange", resolve, { once: true }));
  shown.choose(asset);
  if (utc_s === undefined) return;
  await isThere; // that sets the time to the end of the recording
  const { start, end } = session.asset(asset).recording;
  cursor.set(Math.min(Math.max(utc_s, start), end));
}
