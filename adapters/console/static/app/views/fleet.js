/** All known rovers, one a row; without one, how to start it. */

import { button, html, reconcile, setText, tableHead } from "../dom.js";
import { openRecording } from "./recording.js";
import { View } from "./view.js";
import { age, fixed, interval } from "../format.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { RecordingEntry } from "../model/messages.js" */

export class FleetView extends View {
  #rows = html("tbody");
  #table = html("table", {}, tableHead("rover", "mode", "activity", "position", "links", "authority", "last contact"), this.#rows);
  #addresses = html("p", { className: "dim" });
  #message = html("span", { className: "dim", role: "status" });
  #file = html("input", { type: "file", accept: ".mcap", "aria-label": "file of a recording", onchange: () => this.#open(this.#file.files[0]) });
  #opener = html("p", { className: "opener", hidden: !this.session.hasLog }, html("label", {}, "Open a recording (.mcap): ", this.#file), " ", this.#message);
  #noRover = html(
    "div",
    { className: "no-rover" },
    html("p", { className: "title", textContent: "No rover is connected." }),
    html("p", {}, "Start a simulated one with ", html("code", { textContent: "rover demo --stay" }), "; it appears here by itself."),
    this.#addresses,
  );
  root = html("section", { className: "rover-view fleet-view" }, this.#noRover, html("div", { className: "scroll" }, this.#table), this.#opener);

  start() {
    return [this.session.on("assets", this.draw), this.session.onSecond(this.draw)];
  }

  /** @param {File | undefined} chosen */
  async #open(chosen) {
    if (!chosen) return;
    setText(this.#message, `Reading ${chosen.name} …`);
    try {
      await openRecording(this, `/api/recordings/${encodeURIComponent(chosen.name)}`, { body: chosen });
      setText(this.#message, "");
    } catch (error) {
      setText(this.#message, error.message);
    }
    this.#file.value = "";
  }

  render() {
    const { rovers, tried } = this.session;
    this.#noRover.hidden = rovers.length > 0;
    this.#table.hidden = !this.#noRover.hidden;
    setText(this.#addresses, tried.length ? `rover-console tries ${tried.join(", ")}; its option --to adds addresses.` : "");
    const make = ({ name }) =>
      html("tr", { onclick: () => this.shown.choose(name) }, html("td", {}, button(name, "", () => {})), ...Array.from({ length: 6 }, () => html("td")));
    reconcile(this.#rows, rovers, (asset) => asset.name, make, (row, /** @type {Asset} */ asset) => {
      const texts = asset.recording ? recordingTexts(asset.recording) : this.#textsOf(asset);
      texts.forEach((text, index) => setText(row.children[index + 1], text));
    });
  }

  /** @param {Asset} asset */
  #textsOf({ pose, status, authority, values, mode, activeCommand, links }) {
    const lastReceived_s = Math.max(0, ...[...values.values()].flatMap((samples) => [...samples.values()].map((each) => each.rx)));
    return [
      mode,
      activeCommand?.name ?? status?.plan ?? "",
      pose ? `${fixed(pose.x, 1)}, ${fixed(pose.y, 1)} m` : "",
      [...links.values()].map((link) => `${link.link} ${link.state}`).join(", "),
      authority?.holder ?? (authority?.needed ? "none" : "not required"),
      lastReceived_s ? age(this.session.now - lastReceived_s) : "never",
    ];
  }
}

/** @param {RecordingEntry} recording */
function recordingTexts({ file, rover, start, end, complete }) {
  return ["recording", `${file}, of ${rover}`, "", "", "none: recording", `${interval(start, end)}${complete ? "" : ", incomplete"}`];
}
