/** The light page for slow links: STOP, map, commands and values, without Open MCT. */

import { StatusBar } from "./views/status_bar.js";
import { CommandForm } from "./views/command_form.js";
import { CommandTable } from "./views/command_table.js";
import { contextOf } from "./model/context.js";
import { html } from "./dom.js";
import { FleetView } from "./views/fleet.js";
import { login } from "./views/login.js";
import { MapView } from "./views/map.js";
import { LIGHT_TOPICS, Session } from "./model/session.js";
import { ValuesView } from "./views/values.js";

/** @type {[string, {mount: (element: HTMLElement, context: import("./model/context.js").Context) => () => void}][]} */
const PANELS = [
  ["Map", MapView],
  ["Command", CommandForm],
  ["Commands", CommandTable],
  ["Latest values", ValuesView],
];

await login();
const session = new Session(LIGHT_TOPICS);
/** @type {import("./model/context.js").Context["shown"]} */
const shown = { name: null, choose: show };
const top = html("div");
const panels = html("main", { className: "panels" });
const noRover = html("div");
document.body.append(
  top,
  noRover,
  panels,
  html("footer", {}, html("a", { href: "/", textContent: "full console" }), html("a", { href: "/help", textContent: "help" }), "Light page, without Open MCT."),
);
let unmounts = [];

/** @param {string} name */
function show(name) {
  shown.name = name;
  for (const unmount of unmounts) unmount();
  panels.replaceChildren();
  const context = contextOf(session, name);
  unmounts = PANELS.map(([title, view]) => {
    const inside = html("div");
    panels.append(html("section", { className: "panel", "aria-label": title }, html("h2", { textContent: title }), inside));
    return view.mount(inside, context);
  });
}

function choose() {
  if (shown.name === null && session.rovers.length > 0) show(session.rovers[0].name);
  noRover.hidden = shown.name !== null;
  panels.hidden = shown.name === null;
}

StatusBar.mount(top, { session, shown });
FleetView.mount(noRover, { session, shown });
session.on("assets", choose);
choose();
