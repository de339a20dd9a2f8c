/**
 * Files of a component, newest first, and pictures among them; and those that are on their way from it. A file
 * is fetched from the rover when somebody asks for it, not before: the link may be slow.
 */

import { ask } from "../model/connection.js";
import { eachFrame, html, keep, say, set } from "../dom.js";
import { age, clock, inTypedUnit, sizeOf } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @param {(name: string) => void} choose shows an asset
 * @returns {() => void}
 */
export function mount(element, context, choose) {
  const { asset, session } = context;
  const isHere = asset.isConsole;
  let files = [];
  let trouble = "";
  let wasReached = false;
  const empty = html("p", { className: "empty" });
  const told = html("p", { className: "told", role: "status" });
  const rows = html("tbody");
  const table = tableOf(["file", "size", "changed (UTC)", ""], rows);
  const moving = html("tbody");
  const transfers = tableOf(["transfer", "", "by", ""], moving, "transfers");
  const picture = html("img", { alt: "", onerror: () => say(caption, "It could not be fetched.") });
  const caption = html("figcaption", { className: "dim" });
  const shown = html("figure", { hidden: true }, picture, caption);
  const root = html("section", { className: "rover-view files-view" }, told, html("div", { className: "scroll" }, shown, transfers, empty, table));
  element.append(root);

  const draw = eachFrame(render);
  const pathOf = (file) => `/api/files/${encodeURIComponent(asset.name)}/${file.path.split("/").map(encodeURIComponent).join("/")}`;
  const button = (textContent, title, onclick) => html("button", { type: "button", textContent, title, onclick });

  async function refresh() {
    try {
      files = (await ask(`/api/files/${encodeURIComponent(asset.name)}`)).files.sort((one, other) => other.modified - one.modified);
      trouble = "";
    } catch (error) {
      trouble = error.message;
    }
    draw();
  }

  /** Ask what is aboard once the rover is there, again: what was told meanwhile was not heard. */
  function followLink() {
    if (asset.isReached && !wasReached) refresh();
    wasReached = asset.isReached;
    draw();
  }

  function show(file) {
    shown.hidden = false;
    say(caption, isHere ? file.path : `${file.path} is being fetched from aboard …`);
    picture.onload = async () => {
      const about = isHere ? file : await ask(`${pathOf(file)}?about`).catch(() => file);
      if (picture.src.endsWith(pathOf(file))) say(caption, [`${file.path}, ${clock(file.modified)} UTC`, ...figuresOf(about)].join("; "));
    };
    picture.src = pathOf(file);
  }

  /** Where a picture was taken, and how the camera stood, in words. */
  function figuresOf(file) {
    const entries = new Map(asset.entry?.parameters.map((each) => [each.key, each]));
    return Object.entries(file.meta).filter(([key]) => entries.has(key)).map(([key, value]) => {
      const { text, unit } = inTypedUnit(value, entries.get(key));
      return `${key} ${text} ${unit}`.trim();
    });
  }

  /** Do what a button says, and tell what was refused. */
  async function act(path, request) {
    say(told, "");
    try {
      return await ask(path, request);
    } catch (error) {
      say(told, error.message);
      return undefined;
    }
  }

  const fetchFile = (file) => act("/api/transfers", { json: { asset: asset.name, path: file.path } });
  const turn = (transfer, what) => act(`/api/transfers/${transfer.id}`, { json: { act: what } });
  const forget = (transfer) => act(`/api/transfers/${transfer.id}`, { method: "DELETE" });

  async function openRecording(transfer) {
    say(told, `${transfer.path} is being read …`);
    const entry = await act(`/api/transfers/${transfer.id}/recording`, { method: "POST" });
    if (!entry) return;
    await session.readDictionary();
    choose(entry.asset);
  }

  function render() {
    const known = [...asset.transfers.values()].sort((one, other) => other.made - one.made);
    transfers.hidden = known.length === 0;
    keep(moving, known, (transfer) => transfer.id, makeTransfer, drawTransfer);
    empty.hidden = files.length > 0;
    table.hidden = !empty.hidden;
    if (isHere) say(empty, trouble || "No file was fetched yet. “fetch” does that, under “Files” of a rover.");
    else if (!asset.isReached) say(empty, session.unreached(asset));
    else say(empty, trouble || "There are no files aboard. “takePicture” makes one.");
    keep(rows, files, (file) => `${file.path} ${file.modified}`, make, () => {});
  }

  const make = (file) =>
    html(
      "tr",
      {},
      html("td", { textContent: file.path }),
      html("td", { className: "figure", textContent: sizeOf(file.size) }),
      html("td", { textContent: `${new Date(file.modified * 1000).toISOString().slice(0, 10)} ${clock(file.modified)}` }),
      html(
        "td",
        {},
        isPicture(file) && button("show", "", () => show(file)),
        isHere ? save(pathOf(file), file.path) : button("fetch", "from aboard to this console, where all can save it", () => fetchFile(file)),
      ),
    );

  const save = (href, path) => html("a", { href, download: path.split("/").at(-1), textContent: "save" });

  const makeTransfer = (transfer) =>
    html(
      "tr",
      { "data-path": transfer.path },
      html("td", { textContent: transfer.path }),
      html("td", {}, html("progress", { "aria-label": transfer.path }), html("span", { className: "how" })),
      html("td", { textContent: transfer.by }),
      html("td"),
    );

  function drawTransfer(row, transfer) {
    const { state, done, size, rate } = transfer;
    const [bar, how] = row.children[1].children;
    set(row, { "data-state": state });
    bar.hidden = state === "done" || state === "failed" || size === null;
    Object.assign(bar, { max: size ?? 1, value: done });
    const part = size === null ? "" : `${sizeOf(done)} of ${sizeOf(size)}`;
    const pace = rate ? `${sizeOf(rate)}/s, ${age((size - done) / rate)} more` : "";
    const words = state === "done" ? [sizeOf(size)] : [state, part, pace, transfer.detail];
    say(how, words.filter(Boolean).join(", "));
    if (row.drawn === state) return;
    row.drawn = state;
    const isMoving = ["waiting", "running", "interrupted"].includes(state);
    row.children[3].replaceChildren(
      ...[
        isMoving && button("pause", "what came is kept", () => turn(transfer, "pause")),
        state === "paused" && button("resume", "go on where it stopped", () => turn(transfer, "resume")),
        state === "failed" && button("again", "", () => fetchFile(transfer)),
        state === "done" && /\.mcap$/i.test(transfer.path) && button("open", "look at this recording", () => openRecording(transfer)),
        button(state === "done" || state === "failed" ? "clear" : "end", "take it off the list", () => forget(transfer)),
        state === "done" && save(pathOf(transfer), transfer.path),
      ].filter(Boolean),
    );
  }

  const offs = [
    asset.on("files", refresh),
    asset.on("transfers", draw),
    asset.on("links", followLink),
  ];
  if (isHere) refresh();
  followLink();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

const tableOf = (heads, rows, className = "") =>
  html("table", { className }, html("thead", {}, html("tr", {}, ...heads.map((textContent) => html("th", { textContent })))), rows);

const isPicture = (file) => /^image\/|jpe?g$|png$/i.test(file.mime ?? file.path);
