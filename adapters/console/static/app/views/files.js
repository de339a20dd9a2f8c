/**
 * Files aboard, newest first, and pictures among them. A file is fetched from the rover when somebody asks
 * for it, not before: the link may be slow.
 */

import { ask } from "../model/connection.js";
import { eachFrame, html, keep, say } from "../dom.js";
import { clock, inTypedUnit } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session } = context;
  let files = [];
  let trouble = "";
  let isAsked = false;
  const empty = html("p", { className: "empty" });
  const rows = html("tbody");
  const table = html(
    "table",
    {},
    html("thead", {}, html("tr", {}, ...["file", "size", "changed (UTC)", ""].map((textContent) => html("th", { textContent })))),
    rows,
  );
  const picture = html("img", { alt: "", onload: () => draw(), onerror: () => say(caption, "It could not be fetched.") });
  const caption = html("figcaption", { className: "dim" });
  const shown = html("figure", { hidden: true }, picture, caption);
  const root = html("section", { className: "rover-view files-view" }, empty, html("div", { className: "scroll" }, shown, table));
  element.append(root);

  const pathOf = (file) => `/api/files/${encodeURIComponent(asset.name)}/${file.path.split("/").map(encodeURIComponent).join("/")}`;

  async function refresh() {
    isAsked = true;
    try {
      files = (await ask(`/api/files/${encodeURIComponent(asset.name)}`)).files.sort((one, other) => other.modified - one.modified);
      trouble = "";
    } catch (error) {
      trouble = error.message;
      isAsked = false;
    }
    draw();
  }

  function show(file) {
    shown.hidden = false;
    say(caption, `${file.path} is being fetched from aboard …`);
    picture.onload = async () => {
      const about = await ask(`${pathOf(file)}?about`).catch(() => file);
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

  function render() {
    empty.hidden = files.length > 0;
    table.hidden = !empty.hidden;
    if (!asset.isReached) say(empty, session.unreached(asset));
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
        isPicture(file) && html("button", { type: "button", textContent: "show", onclick: () => show(file) }),
        html("a", { href: pathOf(file), download: file.path.split("/").at(-1), textContent: "save" }),
      ),
    );

  const draw = eachFrame(render);
  const offs = [
    asset.on("files", refresh),
    asset.on("links", () => (asset.isReached && !isAsked ? refresh() : draw())),
  ];
  if (asset.isReached) refresh();
  draw();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

const isPicture = (file) => /^image\/|jpe?g$|png$/i.test(file.mime ?? file.path);

function sizeOf(octets) {
  if (octets < 1000) return `${octets} B`;
  return octets < 1e6 ? `${(octets / 1000).toFixed(1)} kB` : `${(octets / 1e6).toFixed(1)} MB`;
}
