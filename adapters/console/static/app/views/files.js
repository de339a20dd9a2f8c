/**
 * Files of a component, newest first, and pictures among them; and those that are on their way from it. A file
 * is fetched from the rover when somebody asks for it, not before: the link may be slow.
 */

import { ask } from "../model/connection.js";
import { button, html, keep, say, set, tableHead } from "../dom.js";
import { View } from "./view.js";
import { age, clock, inTypedUnit, sizeOf } from "../words.js";

/** @import { FileEntry, Transfer } from "../model/messages.js" */

const MOVING = ["waiting", "running", "interrupted"];

export class FilesView extends View {
  /** whether they are those that were fetched */
  #isHere = this.asset.isConsole;
  /** @type {FileEntry[]} the newest first */
  #files = [];
  #trouble = "";
  #wasReached = false;

  #empty = html("p", { className: "empty" });
  #told = html("p", { className: "told", role: "status" });
  #rows = html("tbody");
  #table = html("table", {}, tableHead("file", "size", "changed (UTC)", ""), this.#rows);
  #moving = html("tbody");
  #transfers = html("table", { className: "transfers" }, tableHead("transfer", "", "by", ""), this.#moving);
  #picture = html("img", { alt: "", onerror: () => say(this.#caption, "It could not be fetched.") });
  #caption = html("figcaption", { className: "dim" });
  #shown = html("figure", { hidden: true }, this.#picture, this.#caption);
  root = html("section", { className: "rover-view files-view" }, this.#told, html("div", { className: "scroll" }, this.#shown, this.#transfers, this.#empty, this.#table));

  start() {
    const { asset, draw } = this;
    if (this.#isHere) this.#refresh();
    this.#followLink();
    return [asset.on("files", () => this.#refresh()), asset.on("transfers", draw), asset.on("links", () => this.#followLink())];
  }

  /** Ask what is aboard once the rover is there, again: what was told meanwhile was not heard. */
  #followLink() {
    if (this.asset.isReached && !this.#wasReached) this.#refresh();
    this.#wasReached = this.asset.isReached;
    this.draw();
  }

  async #refresh() {
    try {
      const { files } = await ask(`/api/files/${encodeURIComponent(this.asset.name)}`);
      this.#files = files.sort((one, other) => other.modified - one.modified);
      this.#trouble = "";
    } catch (error) {
      this.#trouble = error.message;
    }
    this.draw();
  }

  /** @param {string} path */
  #urlOf(path) {
    return `/api/files/${encodeURIComponent(this.asset.name)}/${path.split("/").map(encodeURIComponent).join("/")}`;
  }

  /** Show a picture. @param {FileEntry} file */
  #show(file) {
    const url = this.#urlOf(file.path);
    this.#shown.hidden = false;
    say(this.#caption, this.#isHere ? file.path : `${file.path} is being fetched from aboard …`);
    this.#picture.onload = async () => {
      const about = this.#isHere ? file : await ask(`${url}?about`).catch(() => file);
      if (this.#picture.src.endsWith(url)) say(this.#caption, [`${file.path}, ${clock(file.modified)} UTC`, ...this.#figuresOf(about)].join("; "));
    };
    this.#picture.src = url;
  }

  /** Where a picture was taken, and how the camera stood, in words. @param {FileEntry} file */
  #figuresOf({ meta }) {
    const entries = new Map(this.asset.entry?.parameters.map((each) => [each.key, each]));
    return Object.entries(meta).filter(([key]) => entries.has(key)).map(([key, value]) => {
      const { text, unit } = inTypedUnit(value, entries.get(key));
      return `${key} ${text} ${unit}`.trim();
    });
  }

  /** Do what a button says, and tell what was refused. @param {string} path @param {any} request */
  async #act(path, request) {
    say(this.#told, "");
    return ask(path, request).catch((error) => say(this.#told, error.message));
  }

  /** @param {string} path */
  #fetch(path) {
    return this.#act("/api/transfers", { json: { asset: this.asset.name, path } });
  }

  /** @param {Transfer} transfer */
  async #openRecording({ id, path }) {
    say(this.#told, `${path} is being read …`);
    const entry = await this.#act(`/api/transfers/${id}/recording`, { method: "POST" });
    if (!entry) return;
    await this.session.readDictionary();
    this.shown.choose(entry.asset);
  }

  render() {
    const { asset, session } = this;
    const moving = [...asset.transfers.values()].sort((one, other) => other.made - one.made);
    this.#transfers.hidden = moving.length === 0;
    keep(this.#moving, moving, (transfer) => transfer.id, makeTransfer, (row, transfer) => this.#drawTransfer(row, transfer));
    this.#empty.hidden = this.#files.length > 0;
    this.#table.hidden = !this.#empty.hidden;
    if (this.#isHere) say(this.#empty, this.#trouble || "No file was fetched yet. “fetch” does that, under “Files” of a rover.");
    else if (!asset.isReached) say(this.#empty, session.unreached(asset));
    else say(this.#empty, this.#trouble || "There are no files aboard. “takePicture” makes one.");
    keep(this.#rows, this.#files, (file) => `${file.path} ${file.modified}`, (file) => this.#makeFile(file));
  }

  /** @param {FileEntry} file */
  #makeFile(file) {
    return html(
      "tr",
      {},
      html("td", { textContent: file.path }),
      html("td", { className: "figure", textContent: sizeOf(file.size) }),
      html("td", { textContent: `${new Date(file.modified * 1000).toISOString().slice(0, 10)} ${clock(file.modified)}` }),
      html(
        "td",
        {},
        isPicture(file) && button("show", "", () => this.#show(file)),
        this.#isHere ? this.#save(file.path) : button("fetch", "from aboard to this console, where all can save it", () => this.#fetch(file.path)),
      ),
    );
  }

  /** @param {string} path */
  #save(path) {
    return html("a", { href: this.#urlOf(path), download: path.split("/").at(-1), textContent: "save" });
  }

  /** @param {any} row @param {Transfer} transfer */
  #drawTransfer(row, transfer) {
    const { state, done, size, rate, detail } = transfer;
    const [, { children: [bar, how] }, , acts] = row.children;
    set(row, { "data-state": state });
    bar.hidden = state === "done" || state === "failed" || size === null;
    Object.assign(bar, { max: size ?? 1, value: done });
    const part = size === null ? "" : `${sizeOf(done)} of ${sizeOf(size)}`;
    const pace = rate ? `${sizeOf(rate)}/s, ${age((size - done) / rate)} more` : "";
    const words = state === "done" ? [sizeOf(size)] : [state, part, pace, detail];
    say(how, words.filter(Boolean).join(", "));
    // Buttons stay the same while somebody presses them.
    keep(acts, [MOVING.includes(state) ? "moving" : state], String, () => html("span", {}, ...this.#actsOf(transfer)));
  }

  /** @param {Transfer} transfer */
  #actsOf(transfer) {
    const { id, path, state } = transfer;
    const turn = (act) => this.#act(`/api/transfers/${id}`, { json: { act } });
    return [
      MOVING.includes(state) && button("pause", "what came is kept", () => turn("pause")),
      state === "paused" && button("resume", "go on where it stopped", () => turn("resume")),
      state === "failed" && button("again", "", () => this.#fetch(path)),
      state === "done" && /\.mcap$/i.test(path) && button("open", "look at this recording", () => this.#openRecording(transfer)),
      button(state === "done" || state === "failed" ? "clear" : "end", "take it off the list", () => this.#act(`/api/transfers/${id}`, { method: "DELETE" })),
      state === "done" && this.#save(path),
    ];
  }
}

/** @param {Transfer} transfer */
const makeTransfer = ({ path, by }) =>
  html(
    "tr",
    { "data-path": path },
    html("td", { textContent: path }),
    html("td", {}, html("progress", { "aria-label": path }), html("span", { className: "how" })),
    html("td", { textContent: by }),
    html("td"),
  );

/** @param {FileEntry} file */
const isPicture = ({ mime, path }) => /^image\/|jpe?g$|png$/i.test(mime ?? path);
