/** The notifications of an asset, newest first, with filters; those of the selected command are highlighted. */

import { button, html, reconcile, setText } from "../dom.js";
import { View } from "./view.js";
import { clock } from "../format.js";

/** @import { NotificationMessage } from "../model/messages.js" */

const MAX_ROWS = 300;
const SEVERITIES = ["INFORMATIONAL", "WARNING", "ALARM", "SEVERE", "CRITICAL"];
const KINDS = { COMMAND: "commands", EVENT: "events", LINK: "links" };

export class LogView extends View {
  /** the hidden kinds */
  #hidden = new Set();
  /** whether only lines of the selected command are shown */
  #isSelectedOnly = false;

  #search = html("input", { type: "search", placeholder: "find in the log", "aria-label": "find in the log", oninput: this.draw });
  #minSeverity = html(
    "select",
    { "aria-label": "minimum severity", onchange: this.draw },
    ...SEVERITIES.map((each, index) => html("option", { value: String(index), textContent: index ? `${each.toLowerCase()} and worse` : "all severities" })),
  );
  #kinds = Object.entries(KINDS).map(([kind, label]) => button(label, "", () => this.#toggle(kind), { "data-kind": kind }));
  #selectedOnly = button("only the selected command", "", () => ((this.#isSelectedOnly = !this.#isSelectedOnly), this.draw()));
  #empty = html("p", { className: "empty" });
  #lines = html("div", { className: "lines", role: "log" });
  root = html(
    "section",
    { className: "rover-view log-view" },
    html("header", {}, html("span", { className: "tools" }, ...this.#kinds, this.#minSeverity, this.#search, this.#selectedOnly)),
    this.#empty,
    html("div", { className: "scroll", tabIndex: 0 }, this.#lines),
  );

  start() {
    const { asset, selection, cursor, draw } = this;
    return [asset.on("notices", draw), asset.on("links", draw), selection.on(draw), cursor.on(draw)];
  }

  /** @param {string} kind */
  #toggle(kind) {
    if (!this.#hidden.delete(kind)) this.#hidden.add(kind);
    this.draw();
  }

  render() {
    const { asset, session, selection } = this;
    this.#isSelectedOnly &&= selection.command !== null;
    this.#selectedOnly.hidden = selection.command === null;
    this.#selectedOnly.classList.toggle("on", this.#isSelectedOnly);
    for (const each of this.#kinds) {
      const isShown = !this.#hidden.has(each.dataset.kind);
      each.classList.toggle("on", isShown);
      each.setAttribute("aria-pressed", String(isShown));
    }
    const shown = this.#shown();
    this.#empty.hidden = shown.length > 0;
    if (asset.notices.length) setText(this.#empty, "No notification matches these filters.");
    else setText(this.#empty, asset.isReached ? "No notifications yet. Send a command to see its life cycle here." : session.unreached(asset));
    reconcile(this.#lines, shown, (notice) => `${notice.utc} ${notice.sequence}`, (notice) => this.#makeLine(notice), (line, notice) => this.#drawLine(line, notice));
  }

  /** The lines that match the filters, around the displayed time. */
  #shown() {
    const { notices } = this.asset;
    const { utc_s } = this.cursor;
    const sought = this.#search.value.trim().toLowerCase();
    const until = utc_s === null ? notices.length : notices.findLastIndex((each) => each.utc <= utc_s) + MAX_ROWS / 2;
    const folded = this.asset.continuedDrives;
    const shown = [];
    for (let index = Math.min(notices.length - 1, until); index >= 0 && shown.length < MAX_ROWS; index--) {
      const { kind, severity, text, command } = notices[index];
      if (this.#hidden.has(kind) || SEVERITIES.indexOf(severity) < Number(this.#minSeverity.value)) continue;
      if (command && folded.has(command) && command !== this.selection.command) continue;
      if (sought && !text.toLowerCase().includes(sought)) continue;
      if (!this.#isSelectedOnly || command === this.selection.command) shown.push(notices[index]);
    }
    return shown;
  }

  /** @param {NotificationMessage} notice */
  #makeLine({ utc, severity, link, sequence, command, stage, kind, text }) {
    const select = () => (command ? this.selection.selectCommand(command) : this.cursor.set(this.cursor.utc_s === utc ? null : utc));
    return html(
      "div",
      { className: `line ${severity.toLowerCase()}`, title: `${text}\n${clock(utc, true)} UTC aboard, by ${link}, number ${sequence}`, onclick: select },
      html("time"),
      html("span", { className: `stage ${(stage ?? "").toLowerCase()}`, textContent: stage ?? kind }),
      html("span", { className: "text", textContent: text }),
    );
  }

  /** @param {HTMLElement} line @param {NotificationMessage} notice */
  #drawLine(line, { command, utc }) {
    const { utc_s } = this.cursor;
    setText(line.children[0], clock(utc));
    line.classList.toggle("selected", command !== null && command === this.selection.command);
    line.classList.toggle("later", utc_s !== null && utc > utc_s);
  }
}
