/** All rovers that were heard of, a line each; where there is none, how to get one. */

import { eachFrame, html, keep, say } from "../dom.js";
import * as recording from "./recording.js";
import { age, clock, fixed } from "../words.js";

/**
 * @param {HTMLElement} element
 * @param {import("../model/session.js").Session} session
 * @param {(name: string) => void} choose
 * @returns {() => void}
 */
export function mount(element, session, choose) {
  const rows = html("tbody");
  const table = html(
    "table",
    {},
    html("thead", {}, html("tr", {}, ...["rover", "mode", "does", "is at", "links", "who commands", "heard"].map((textContent) => html("th", { textContent })))),
    rows,
  );
  const where = html("p", { className: "dim" });
  const told = html("span", { className: "dim", role: "status" });
  const file = html("input", { type: "file", accept: ".mcap", "aria-label": "file of a recording", onchange: () => open(file.files[0]) });
  const opener = html("p", { className: "opener", hidden: !session.hasLog }, html("label", {}, "Open a recording (.mcap): ", file), " ", told);
  const nobody = html(
    "div",
    { className: "nobody" },
    html("p", { className: "title", textContent: "No rover is connected." }),
    html("p", {}, "Start a simulated one with ", html("code", { textContent: "./rover demo --stay" }), "; it appears here by itself."),
    where,
  );
  const root = html("section", { className: "rover-view fleet-view" }, nobody, html("div", { className: "scroll" }, table), opener);
  element.append(root);

  /** @param {File | undefined} chosen */
  async function open(chosen) {
    if (!chosen) return;
    say(told, `${chosen.name} is being read …`);
    try {
      const name = await recording.open(chosen);
      await session.readDictionary();
      say(told, "");
      choose(name);
    } catch (error) {
      say(told, error.message);
    }
    file.value = "";
  }

  function render() {
    const assets = session.rovers;
    nobody.hidden = assets.length > 0;
    table.hidden = !nobody.hidden;
    const tried = session.tried.join(", ");
    say(where, tried ? `rover-console looks for one at ${tried}; others are named by its option --to.` : "");
    keep(rows, assets, (asset) => asset.name, make, update);
  }

  const make = (asset) =>
    html(
      "tr",
      { onclick: () => choose(asset.name) },
      html("td", {}, html("button", { type: "button", textContent: asset.name })),
      ...Array.from({ length: 6 }, () => html("td")),
    );

  function update(row, asset) {
    if (asset.recording) return updateRecording(row, asset.recording);
    const { pose, status, authority } = asset;
    const heard = Math.max(0, ...[...asset.values.values()].flatMap((links) => [...links.values()].map((each) => each.rx)));
    const words = [
      asset.mode,
      asset.activeCommand?.name ?? status?.plan ?? "",
      pose ? `${fixed(pose.x, 1)}, ${fixed(pose.y, 1)} m` : "",
      [...asset.links.values()].map((link) => `${link.link} ${link.state}`).join(", "),
      authority?.holder ?? (authority?.needed ? "nobody" : "anyone"),
      heard ? age(session.now - heard) : "never",
    ];
    words.forEach((text, index) => say(row.children[index + 1], text));
  }

  function updateRecording(row, { file, rover, began, ended, whole }) {
    const words = ["recording", `${file}, of ${rover}`, "", "", "nobody: it is past", `${clock(began)} to ${clock(ended)}${whole ? "" : ", where it breaks off"}`];
    words.forEach((text, index) => say(row.children[index + 1], text));
  }

  const draw = eachFrame(render);
  const offs = [session.on("assets", draw), session.onSecond(draw)];
  draw();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}
