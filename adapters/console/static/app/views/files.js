/**
 * Files of a component, newest first, with their pictures, and the transfers from it. A file is fetched from
 * the rover on request only, since the link may be slow.
 */

import { fetchJson } from "../model/connection.js";
import { button, html, reconcile, setText, set, tableHead } from "../dom.js";
import { ShownPicture } from "./pictures.js";
import { openRecording } from "./recording.js";
import { View } from "./view.js";
import { age, clock, sizeOf } from "../format.js";
import { isPicture, urlOf } from "../model/pictures.js";

/** @import { FileEntry, Transfer } from "../model/messages.js" */

/** The asset that lists the files that the console stores. */
const STORE = "rover-console";
const MOVING = ["waiting", "running", "interrupted"];

export class FilesView extends View {
  /** whether it lists the fetched files, which the console stores */
  #isHere = this.asset.isConsole;
  /** @type {FileEntry[]} the newest first */
  #files = [];
  #trouble = "";
  /** number of ended transfers */
  #ended = 0;
  /** the files that the console stores, as ASSET/PATH and time @type {Set<string>} */
  #stored = new Set();

  #empty = html("p", { className: "empty" });
  #message = html("p", { className: "message", role: "status" });
  #rows = html("tbody");
  #table = html("table", {}, tableHead("picture", "file", "size", "changed (UTC)", ""), this.#rows);
  #moving = html("tbody");
  #transfers = html("table", { className: "transfers" }, tableHead("transfer", "", "by", ""), this.#moving);
  #shown = new ShownPicture();
  root = html(
    "section",
    { className: "rover-view files-view" },
    this.#message,
    html("div", { className: "beside" }, html("div", { className: "scroll", tabIndex: 0 }, this.#transfers, this.#empty, this.#table), this.#shown.root),
  );

  start() {
    const { asset, draw } = this;
    const refresh = () => this.#refresh();
    if (this.#isHere) refresh();
    return [asset.on("files", refresh), asset.on("transfers", () => this.#onTransfers()), asset.on("links", draw), asset.onReached(refresh), this.#shown.start()];
  }

  /** Read which files the console stores when a transfer has ended: those have thumbnails. */
  #onTransfers() {
    const ended = [...this.asset.transfers.values()].filter((each) => each.state === "done").length;
    if (ended > this.#ended) this.#refresh();
    this.#ended = ended;
    this.draw();
  }

  async #refresh() {
    try {
      const { files } = await fetchJson(`/api/files/${encodeURIComponent(this.asset.name)}`);
      this.#files = files.sort((one, other) => other.modified - one.modified);
      const stored = this.#isHere ? files : (await fetchJson(`/api/files/${STORE}`)).files;
      this.#stored = new Set(stored.map(({ path, modified }) => `${path} ${modified}`));
      this.#trouble = "";
    } catch (error) {
      this.#trouble = error.message;
    }
    this.draw();
  }

  /** Show a picture beside the list. @param {FileEntry} file */
  #show(file) {
    this.#shown.show(this.asset, file, this.#isHere ? undefined : fetchJson(`${urlOf(this.asset.name, file.path)}?about`));
  }

  /** The path of a picture in the store; null if it is not stored. @param {FileEntry} file */
  #storedPath({ path, modified }) {
    const stored = this.#isHere ? path : `${this.asset.name}/${path}`;
    return this.#stored.has(`${stored} ${modified}`) ? stored : null;
  }

  /** Send a request, and show its refusal. @param {string} path @param {any} request */
  async #act(path, request) {
    setText(this.#message, "");
    return fetchJson(path, request).catch((error) => setText(this.#message, error.message));
  }

  /** @param {string} path */
  #fetch(path) {
    return this.#act("/api/transfers", { json: { asset: this.asset.name, path } });
  }

  /** @param {Transfer} transfer */
  async #openRecording({ id, path }) {
    setText(this.#message, `Reading ${path} …`);
    await openRecording(this, `/api/transfers/${id}/recording`).catch((error) => setText(this.#message, error.message));
  }

  render() {
    const { asset, session } = this;
    const moving = [...asset.transfers.values()].sort((one, other) => other.created - one.created);
    this.#transfers.hidden = moving.length === 0;
    reconcile(this.#moving, moving, (transfer) => transfer.id, makeTransfer, (row, transfer) => this.#drawTransfer(row, transfer));
    this.#empty.hidden = this.#files.length > 0;
    this.#table.hidden = !this.#empty.hidden;
    if (this.#isHere) setText(this.#empty, this.#trouble || "No fetched files yet. Use “fetch” under “Files” of a rover.");
    else if (!asset.isReached) setText(this.#empty, session.unreached(asset));
    else setText(this.#empty, this.#trouble || "No files aboard. “takePicture” makes one.");
    reconcile(this.#rows, this.#files, (file) => `${file.path} ${file.modified} ${this.#storedPath(file) !== null}`, (file) => this.#makeFile(file));
  }

  /** @param {FileEntry} file */
  #makeFile(file) {
    const stored = isPicture(file) ? this.#storedPath(file) : null;
    return html(
      "tr",
      {},
      html("td", {}, stored !== null && html("img", { className: "thumbnail", alt: "", loading: "lazy", src: urlOf(STORE, stored), onclick: () => this.#show(file) })),
      html("td", { textContent: file.path }),
      html("td", { className: "figure", textContent: sizeOf(file.size) }),
      html("td", { textContent: clock(file.modified) }),
      html(
        "td",
        {},
        isPicture(file) && button("show", "", () => this.#show(file)),
        this.#isHere ? this.#save(file.path) : button("fetch", "transfer it to this console, where every operator can save it", () => this.#fetch(file.path)),
      ),
    );
  }

  /** @param {string} path */
  #save(path) {
    return html("a", { href: urlOf(this.asset.name, path), download: path.split("/").at(-1), textContent: "save" });
  }

  /** @param {any} row @param {Transfer} transfer */
  #drawTransfer(row, transfer) {
    const { state, done, size, rate, detail } = transfer;
    const [, { children: [bar, how] }, , acts] = row.children;
    set(row, { "data-state": state });
    bar.hidden = state === "done" || state === "failed" || size === null;
    Object.assign(bar, { max: size ?? 1, value: done });
    const part = size === null ? "" : `${sizeOf(done)} of ${sizeOf(size)}`;
    const rateText = rate ? `${sizeOf(rate)}/s, ${age((size - done) / rate)} left` : "";
    const parts = state === "done" ? [sizeOf(size)] : [state, part, rateText, detail];
    setText(how, parts.filter(Boolean).join(", "));
    // Buttons are reused, so that a press is not lost.
    reconcile(acts, [MOVING.includes(state) ? "moving" : state], String, () => html("span", {}, ...this.#actsOf(transfer)));
  }

  /** @param {Transfer} transfer */
  #actsOf(transfer) {
    const { id, path, state } = transfer;
    const apply = (action) => this.#act(`/api/transfers/${id}`, { json: { action } });
    return [
      MOVING.includes(state) && button("pause", "the received part is stored", () => apply("pause")),
      state === "paused" && button("resume", "continue at the interruption", () => apply("resume")),
      state === "failed" && button("retry", "", () => this.#fetch(path)),
      state === "done" && /\.mcap$/i.test(path) && button("open", "open this recording", () => this.#openRecording(transfer)),
      button(state === "done" || state === "failed" ? "clear" : "end", "remove it from the list", () => this.#act(`/api/transfers/${id}`, { method: "DELETE" })),
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
