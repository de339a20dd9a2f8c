/** All rovers that were heard of, a line each; where there is none, how to get one. */

import { button, html, keep, say, tableHead } from "../dom.js";
import { openRecording } from "./recording.js";
import { View } from "./view.js";
import { age, clock, fixed } from "../words.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { RecordingEntry } from "../model/messages.js" */

export class FleetView extends View {
  #rows = html("tbody");
  #table = html("table", {}, tableHead("rover", "mode", "does", "is at", "links", "who commands", "heard"), this.#rows);
  #where = html("p", { className: "dim" });
  #told = html("span", { className: "dim", role: "status" });
  #file = html("input", { type: "file", accept: ".mcap", "aria-label": "file of a recording", onchange: () => this.#open(this.#file.files[0]) });
  #opener = html("p", { className: "opener", hidden: !this.session.hasLog }, html("label", {}, "Open a recording (.mcap): ", this.#file), " ", this.#told);
  #nobody = html(
    "div",
    { className: "nobody" },
    html("p", { className: "title", textContent: "No rover is connected." }),
    html("p", {}, "Start a simulated one with ", html("code", { textContent: "./rover demo --stay" }), "; it appears here by itself."),
    this.#where,
  );
  root = html("section", { className: "rover-view fleet-view" }, this.#nobody, html("div", { className: "scroll" }, this.#table), this.#opener);

  start() {
    return [this.session.on("assets", this.draw), this.session.onSecond(this.draw)];
  }

  /** @param {File | undefined} chosen */
  async #open(chosen) {
    if (!chosen) return;
    say(this.#told, `${chosen.name} is being read …`);
    try {
      const name = await openRecording(chosen);
      await this.session.readDictionary();
      say(this.#told, "");
      this.shown.choose(name);
    } catch (error) {
      say(this.#told, error.message);
    }
    this.#file.value = "";
  }

  render() {
    const { rovers, tried } = this.session;
    this.#nobody.hidden = rovers.length > 0;
    this.#table.hidden = !this.#nobody.hidden;
    say(this.#where, tried.length ? `rover-console looks for one at ${tried.join(", ")}; others are named by its option --to.` : "");
    const make = ({ name }) =>
      html("tr", { onclick: () => this.shown.choose(name) }, html("td", {}, button(name, "", () => {})), ...Array.from({ length: 6 }, () => html("td")));
    keep(this.#rows, rovers, (asset) => asset.name, make, (row, /** @type {Asset} */ asset) => {
      const words = asset.recording ? wordsOfRecording(asset.recording) : this.#wordsOf(asset);
      words.forEach((text, index) => say(row.children[index + 1], text));
    });
  }

  /** @param {Asset} asset */
  #wordsOf({ pose, status, authority, values, mode, activeCommand, links }) {
    const heard = Math.max(0, ...[...values.values()].flatMap((samples) => [...samples.values()].map((each) => each.rx)));
    return [
      mode,
      activeCommand?.name ?? status?.plan ?? "",
      pose ? `${fixed(pose.x, 1)}, ${fixed(pose.y, 1)} m` : "",
      [...links.values()].map((link) => `${link.link} ${link.state}`).join(", "),
      authority?.holder ?? (authority?.needed ? "nobody" : "anyone"),
      heard ? age(this.session.now - heard) : "never",
    ];
  }
}

/** @param {RecordingEntry} recording */
function wordsOfRecording({ file, rover, began, ended, whole }) {
  return ["recording", `${file}, of ${rover}`, "", "", "nobody: it is past", `${clock(began)} to ${clock(ended)}${whole ? "" : ", where it breaks off"}`];
}
