/**
 * Alarms: what calls for somebody's attention. One stands until it is over and somebody acknowledged it; all
 * consoles show the same.
 */

import { ask } from "../model/connection.js";
import { contextOf } from "../model/context.js";
import { button, html, keep, say, set } from "../dom.js";
import { View } from "./view.js";
import { clock } from "../words.js";

/** @import { AlarmStatus } from "../model/messages.js" */

const SEVERITIES = ["CRITICAL", "SEVERE", "ALARM", "WARNING"];

/** @param {AlarmStatus} alarm */
export const isUnacknowledged = (alarm) => alarm.acknowledged === null;

/** The worst first, and of these the last. @param {AlarmStatus} one @param {AlarmStatus} other */
const byUrgency = (one, other) =>
  Number(isUnacknowledged(other)) - Number(isUnacknowledged(one)) ||
  SEVERITIES.indexOf(one.severity) - SEVERITIES.indexOf(other.severity) ||
  other.last - one.last;

/** Without an asset it shows the alarms of all. */
export class AlarmsView extends View {
  /** @type {AlarmStatus[] | null} those that were, and those that stand; null while they are not shown */
  #past = null;

  #count = html("span");
  #all = button("acknowledge all", "", () => this.#acknowledge(this.#standing));
  #history = button("also those that are over", "", () => this.#togglePast());
  #told = html("p", { className: "told", role: "status" });
  #empty = html("p", { className: "empty" });
  #rows = html("tbody");
  root = html(
    "section",
    { className: "rover-view alarms-view" },
    html("header", {}, this.#count, html("span", { className: "tools" }, this.#history, this.#all)),
    this.#told,
    this.#empty,
    html("div", { className: "scroll" }, html("table", {}, this.#rows)),
  );

  start() {
    return [this.session.on("alarms", () => (this.#past === null ? this.draw() : this.#readPast()))];
  }

  get #standing() {
    const isOurs = (alarm) => !this.asset || alarm.asset === this.asset.name;
    return [...this.session.alarms.values()].filter(isOurs).sort(byUrgency);
  }

  /** @param {AlarmStatus[]} alarms as they are seen here: what has occurred again meanwhile is not acknowledged */
  async #acknowledge(alarms) {
    const seen = alarms.filter(isUnacknowledged).map((each) => [each.id, each.occurrences]);
    try {
      await ask("/api/alarms/acknowledge", { json: { alarms: seen } });
      say(this.#told, "");
    } catch (error) {
      say(this.#told, error.message);
    }
  }

  async #readPast() {
    const query = this.asset ? `?asset=${encodeURIComponent(this.asset.name)}` : "";
    this.#past = (await ask(`/api/alarms${query}`).catch(() => null))?.alarms ?? null;
    this.draw();
  }

  #togglePast() {
    if (this.#past === null) return this.#readPast();
    this.#past = null;
    this.draw();
  }

  render() {
    const now = this.#standing;
    const open = now.filter(isUnacknowledged).length;
    const ids = new Set(now.map((each) => each.id));
    const shown = [...now, ...(this.#past ?? []).filter((each) => !ids.has(each.id))];
    say(this.#count, now.length ? `${now.length} standing, ${open} to acknowledge` : "");
    this.#all.hidden = open === 0;
    this.#history.classList.toggle("on", this.#past !== null);
    this.#empty.hidden = shown.length > 0;
    say(this.#empty, this.#past ? "There was no alarm yet." : "No alarm stands. Warnings and faults that are reported, and values beyond their limits, are listed here.");
    keep(this.#rows, shown, (each) => String(each.id), (each) => this.#makeRow(each), (row, each) => this.#drawRow(row, each));
  }

  #makeRow({ asset, source, command, severity }) {
    const select = () => command && contextOf(this.session, asset).selection.selectCommand(command);
    return html(
      "tr",
      { "data-source": source, onclick: select },
      html("td", { className: "severity", textContent: severity.toLowerCase() }),
      html("td", { className: "dim", textContent: this.asset ? "" : asset }),
      html("td"),
      html("td"),
      html("td", { className: "text" }),
      html("td"),
    );
  }

  /** @param {HTMLElement} row @param {AlarmStatus} alarm */
  #drawRow(row, alarm) {
    const [severity, , state, time, text, who] = row.children;
    const isOpen = isUnacknowledged(alarm);
    const isActive = alarm.cleared === null;
    set(row, {
      class: `${alarm.severity.toLowerCase()}${isOpen ? " open" : ""}`,
      "data-state": isActive ? "active" : "cleared",
      "data-acknowledged": String(!isOpen),
    });
    say(severity, alarm.severity.toLowerCase());
    say(state, isActive ? "active" : "over");
    set(state, { class: isActive ? "" : "dim" });
    say(time, clock(alarm.last));
    set(time, { title: `first ${clock(alarm.raised, true)}, last ${clock(alarm.last, true)} UTC aboard${isActive ? "" : `, over ${clock(alarm.cleared, true)}`}` });
    say(text, alarm.occurrences > 1 ? `${alarm.text} (${alarm.occurrences} times)` : alarm.text);
    set(text, { title: alarm.source });
    keep(/** @type {HTMLElement} */ (who), [alarm], () => `${alarm.operator}`, () => (isOpen ? this.#acknowledger(alarm) : acknowledgement(alarm)));
  }

  /** @param {AlarmStatus} alarm */
  #acknowledger(alarm) {
    return button("acknowledge", "", (event) => {
      event.stopPropagation();
      this.#acknowledge([this.session.alarms.get(alarm.id) ?? alarm]);
    });
  }
}

/** @param {AlarmStatus} alarm */
const acknowledgement = ({ operator, acknowledged }) => html("span", { className: "dim", textContent: `by ${operator}, ${clock(acknowledged)}` });
