/**
 * Alarms (ISA-18.2). An alarm stays open until it has cleared and an operator has acknowledged it; all
 * consoles show the same alarms.
 */

import { fetchJson } from "../model/connection.js";
import { contextOf } from "../model/context.js";
import { button, html, reconcile, setText, set } from "../dom.js";
import { View } from "./view.js";
import { clock } from "../format.js";

/** @import { AlarmStatus } from "../model/messages.js" */

const SEVERITIES = ["CRITICAL", "SEVERE", "ALARM", "WARNING"];

/** @param {AlarmStatus} alarm */
export const isAcknowledged = (alarm) => alarm.acknowledged !== null;

/** @param {AlarmStatus} alarm @param {number} now_s */
const isShelved = ({ shelved_until: until }, now_s) => until !== null && until > now_s;

/** Whether an operator must act: bar and title count these alarms. @param {AlarmStatus} alarm @param {number} now_s */
export const needsAction = (alarm, now_s) => !isAcknowledged(alarm) && !isShelved(alarm, now_s);

/** Order: unacknowledged first, then by severity, then newest first. @param {AlarmStatus} one @param {AlarmStatus} other */
const byUrgency = (one, other) =>
  Number(isAcknowledged(one)) - Number(isAcknowledged(other)) ||
  SEVERITIES.indexOf(one.severity) - SEVERITIES.indexOf(other.severity) ||
  other.last - one.last;

/** Shows the alarms of its asset; without one, those of all assets. */
export class AlarmsView extends View {
  /** @type {AlarmStatus[] | null} closed and open alarms of the archive; null while hidden */
  #closed = null;

  #count = html("span");
  #all = button("acknowledge all", "", () => this.#acknowledge(this.#openAlarms));
  #history = button("show closed alarms", "", () => this.#toggleClosed());
  #message = html("p", { className: "message", role: "status" });
  #empty = html("p", { className: "empty" });
  #rows = html("tbody");
  root = html(
    "section",
    { className: "rover-view alarms-view" },
    html("header", {}, this.#count, html("span", { className: "tools" }, this.#history, this.#all)),
    this.#message,
    this.#empty,
    html("div", { className: "scroll" }, html("table", {}, this.#rows)),
  );

  start() {
    return [this.session.on("alarms", () => (this.#closed === null ? this.draw() : this.#readClosed()))];
  }

  get #openAlarms() {
    const isOurs = (alarm) => !this.asset || alarm.asset === this.asset.name;
    return [...this.session.alarms.values()].filter(isOurs).sort(byUrgency);
  }

  /** @param {AlarmStatus[]} alarms as shown here; a recurrence after that stays unacknowledged */
  async #acknowledge(alarms) {
    const seen = alarms.filter((each) => !isAcknowledged(each)).map((each) => [each.id, each.occurrences]);
    try {
      await fetchJson("/api/alarms/acknowledge", { json: { alarms: seen } });
      setText(this.#message, "");
    } catch (error) {
      setText(this.#message, error.message);
    }
  }

  async #readClosed() {
    const query = this.asset ? `?asset=${encodeURIComponent(this.asset.name)}` : "";
    this.#closed = (await fetchJson(`/api/alarms${query}`).catch(() => null))?.alarms ?? null;
    this.draw();
  }

  #toggleClosed() {
    if (this.#closed === null) return this.#readClosed();
    this.#closed = null;
    this.draw();
  }

  render() {
    const now = this.#openAlarms;
    const unacknowledged = now.filter((each) => !isAcknowledged(each)).length;
    const ids = new Set(now.map((each) => each.id));
    const shown = [...now, ...(this.#closed ?? []).filter((each) => !ids.has(each.id))];
    setText(this.#count, now.length ? `${now.length} open, ${unacknowledged} to acknowledge` : "");
    this.#all.hidden = unacknowledged === 0;
    this.#history.classList.toggle("on", this.#closed !== null);
    this.#empty.hidden = shown.length > 0;
    setText(this.#empty, this.#closed ? "No alarms yet." : "No open alarms. Reported warnings and faults, and values outside their limits, are listed here.");
    reconcile(this.#rows, shown, (each) => String(each.id), (each) => this.#makeRow(each), (row, each) => this.#drawRow(row, each));
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
    const [severity, , state, time, text, operator] = row.children;
    const isUnacked = !isAcknowledged(alarm);
    const isActive = alarm.cleared === null;
    set(row, {
      class: `${alarm.severity.toLowerCase()}${isUnacked ? " open" : ""}`,
      "data-state": isActive ? "active" : "cleared",
      "data-acknowledged": String(!isUnacked),
    });
    setText(severity, alarm.severity.toLowerCase());
    setText(state, isActive ? "active" : "cleared");
    set(state, { class: isActive ? "" : "dim" });
    setText(time, clock(alarm.last));
    set(time, { title: `first ${clock(alarm.raised, true)}, last ${clock(alarm.last, true)} UTC aboard${isActive ? "" : `, cleared ${clock(alarm.cleared, true)}`}` });
    setText(text, alarm.occurrences > 1 ? `${alarm.text} (${alarm.occurrences} times)` : alarm.text);
    set(text, { title: alarm.source });
    reconcile(/** @type {HTMLElement} */ (operator), [alarm], () => `${alarm.operator}`, () => (isUnacked ? this.#acknowledger(alarm) : acknowledgement(alarm)));
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
