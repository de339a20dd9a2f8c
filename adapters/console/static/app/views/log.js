/** What the asset told: its notifications, newest first, with filters; those of the selection stand out. */

import { eachFrame, html, keep, say, set } from "../dom.js";
import { clock } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */

const MOST_ROWS = 300;
const SEVERITIES = ["INFORMATIONAL", "WARNING", "ALARM", "SEVERE", "CRITICAL"];
const KINDS = { COMMAND: "commands", EVENT: "events", LINK: "links" };

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session, selection, cursor } = context;
  const hidden = new Set();
  const search = html("input", { type: "search", placeholder: "find in the log", "aria-label": "find in the log", oninput: () => draw() });
  const least = html(
    "select",
    { "aria-label": "least severity", onchange: () => draw() },
    ...SEVERITIES.map((each, index) =>
      html("option", { value: String(index), textContent: index ? `${each.toLowerCase()} and worse` : "all severities" }),
    ),
  );
  const kinds = Object.entries(KINDS).map(([kind, words]) =>
    html("button", {
      type: "button",
      className: "on",
      textContent: words,
      "aria-pressed": "true",
      onclick: (event) => {
        if (!hidden.delete(kind)) hidden.add(kind);
        event.currentTarget.classList.toggle("on", !hidden.has(kind));
        event.currentTarget.setAttribute("aria-pressed", String(!hidden.has(kind)));
        draw();
      },
    }),
  );
  const only = html("button", {
    type: "button",
    textContent: "only the selected command",
    onclick: () => (only.classList.toggle("on"), draw()),
  });
  const empty = html("p", { className: "empty" });
  const lines = html("div", { className: "lines", role: "log" });
  const root = html(
    "section",
    { className: "rover-view log-view" },
    html("header", {}, html("span", { className: "tools" }, ...kinds, least, search, only)),
    empty,
    html("div", { className: "scroll" }, lines),
  );
  element.append(root);

  function render() {
    only.hidden = selection.command === null;
    if (only.hidden) only.classList.remove("on");
    const sought = search.value.trim().toLowerCase();
    const shown = [];
    const last = lastShown(asset.notices, cursor.utc_s);
    for (let index = last; index >= 0 && shown.length < MOST_ROWS; index--) {
      const notice = asset.notices[index];
      if (hidden.has(notice.kind) || SEVERITIES.indexOf(notice.severity) < Number(least.value)) continue;
      if (sought && !notice.text.toLowerCase().includes(sought)) continue;
      if (only.classList.contains("on") && notice.command !== selection.command) continue;
      shown.push(notice);
    }
    empty.hidden = shown.length > 0;
    if (asset.notices.length) say(empty, "Nothing in the log fits these filters.");
    else say(empty, asset.isReached ? "Nothing was told yet. Send a command, and its life is told here." : session.unreached(asset));
    keep(lines, shown, (notice) => `${notice.utc} ${notice.sequence}`, make, update);
  }

  const make = (notice) =>
    html(
      "div",
      {
        className: `line ${notice.severity.toLowerCase()}`,
        title: `${clock(notice.utc, true)} UTC aboard, by ${notice.link}, number ${notice.sequence}`,
        onclick: () => {
          if (notice.command) selection.selectCommand(notice.command);
          else cursor.set(cursor.utc_s === notice.utc ? null : notice.utc);
        },
      },
      html("time", { textContent: clock(notice.utc) }),
      html("span", { className: `stage ${(notice.stage ?? "").toLowerCase()}`, textContent: notice.stage ?? notice.kind }),
      html("span", { className: "text", textContent: notice.text }),
    );

  function update(line, notice) {
    const chosen = notice.command !== null && notice.command === selection.command;
    line.classList.toggle("selected", chosen);
    line.classList.toggle("later", cursor.utc_s !== null && notice.utc > cursor.utc_s);
  }

  const draw = eachFrame(render);
  const offs = [asset.on("notices", draw), asset.on("links", draw), selection.on(draw), cursor.on(draw)];
  draw();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

/** Where the lines that are shown begin: at the last one, or not far behind the moment that is looked at. */
function lastShown(notices, utc) {
  const last = notices.length - 1;
  if (utc === null) return last;
  const until = notices.findLastIndex((each) => each.utc <= utc);
  return Math.min(last, until + MOST_ROWS / 2);
}
