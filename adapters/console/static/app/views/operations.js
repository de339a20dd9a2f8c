/**
 * Operations without Open MCT: map, command, commands and values of the shown rover; log, plans and camera are loaded
 * when they are opened. This is the light page, and the full console until Open MCT is loaded.
 */

import { CommandForm } from "./command_form.js";
import { CommandTable } from "./command_table.js";
import { contextOf } from "../model/context.js";
import { html } from "../dom.js";
import { FleetView } from "./fleet.js";
import { MapView } from "./map.js";
import { ValuesView } from "./values.js";
import { View } from "./view.js";

/** @import { Context } from "../model/context.js" */

/** @type {[string, typeof View][]} */
const PANELS = [
  ["Map", MapView],
  ["Command", CommandForm],
  ["Commands", CommandTable],
  ["Latest values", ValuesView],
];

/** Title, topics and view of the panels that are opened by a click. @type {[string, string[], () => Promise<typeof View>][]} */
const MORE = [
  ["Log", ["ntf"], async () => (await import("./log.js")).LogView],
  ["Plans", ["obj"], async () => (await import("./plans.js")).PlansView],
  ["Camera", [], async () => (await import("./video.js")).VideoView],
];

export class OperationsView extends View {
  /** @type {string | null} the rover of the panels */
  #name = null;
  /** @type {(() => void)[]} */
  #unmounts = [];

  #noRover = html("div");
  #panels = html("div", { className: "panels" });
  #more = html("div", { className: "more" });
  root = html("main", { className: "operations" }, this.#noRover, this.#panels, this.#more);

  start() {
    const { session, shown, draw } = this;
    return [FleetView.mount(this.#noRover, { session, shown }), session.on("assets", draw), () => this.#clear()];
  }

  #clear() {
    for (const unmount of this.#unmounts) unmount();
    this.#panels.replaceChildren();
    this.#more.replaceChildren();
  }

  render() {
    const { name } = this.shown;
    this.#noRover.hidden = name !== null;
    this.#panels.hidden = name === null;
    if (name === this.#name) return;
    this.#name = name;
    this.#clear();
    const context = name === null ? null : contextOf(this.session, name);
    this.#unmounts = context === null ? [] : [...PANELS.map((each) => this.#mount(...each, context)), ...MORE.map((each) => this.#offer(...each, context))];
  }

  /** @param {string} title @param {typeof View} view @param {Context} context */
  #mount(title, view, context) {
    const inside = html("div");
    this.#panels.append(html("section", { className: "panel", "aria-label": title }, html("h2", { textContent: title }), inside));
    return view.mount(inside, context);
  }

  /** Add a panel that has its view while it is open. @param {string} title @param {string[]} topics @param {() => Promise<typeof View>} load @param {Context} context */
  #offer(title, topics, load, context) {
    const inside = html("div");
    let unmount = () => {};
    const panel = html("details", { className: "panel", ontoggle: toggle }, html("summary", { textContent: title }), inside);
    async function toggle() {
      unmount();
      unmount = () => {};
      if (!panel.open) return;
      context.session.subscribe(topics);
      const view = await load();
      if (panel.open && !inside.hasChildNodes()) unmount = view.mount(inside, context);
    }
    this.#more.append(panel);
    return () => unmount();
  }
}
