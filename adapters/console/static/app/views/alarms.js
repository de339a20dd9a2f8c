/**
 * Alarms (ISA-18.2). An alarm stays open until it has cleared and an operator has acknowledged it. A shelved
 * alarm is neither listed nor counted until its time is over. All consoles show the same alarms.
 */

import { fetchJson } from "../model/connection.js";
import { button, html, reconcile, setText, set, tableHead } from "../dom.js";
import { soundButton } from "../sound.js";
import { View } from "./view.js";
import { clock, duration } from "../format.js";

/** @import { AlarmStatus } from "../model/messages.js" */
/** @typedef {"alarm" | "evidence" | "shelving"} Part of an alarm: its row, or a further row below it */

const SEVERITIES = ["CRITICAL", "SEVERE", "ALARM", "WARNING"];
const COLUMNS = ["severity", "rover", "cause", "first", "last", "ended", "count", "state", "actions"];
const STATES = { open: "open", active: "active", unacknowledged: "to acknowledge", shelved: "shelved", all: "open and closed" };
const SHELVING_S = { "15 min": 900, "1 h": 3600, "8 h": 28800, "1 day": 86400, "7 days": 604800 };

/** @param {AlarmStatus} alarm */
export const isAcknowledged = (alarm) => alarm.acknowledged !== null;

/** @param {AlarmStatus} alarm @param {number} now_s */
const isShelved = ({ shelved_until: until }, now_s) => until !== null && until > now_s;

/** @param {AlarmStatus} alarm */
const isOpen = (alarm) => alarm.cleared === null || !isAcknowledged(alarm);

/** Whether an operator must act: bar and title count these alarms. @param {AlarmStatus} alarm @param {number} now_s */
export const needsAction = (alarm, now_s) => !isAcknowledged(alarm) && !isShelved(alarm, now_s);

/** Order: unacknowledged first, then by severity, then newest first. @param {AlarmStatus} one @param {AlarmStatus} other */
const byUrgency = (one, other) =>
  Number(isAcknowledged(one)) - Number(isAcknowledged(other)) ||
  SEVERITIES.indexOf(one.severity) - SEVERITIES.indexOf(other.severity) ||
  other.last - one.last;

/** Shows the alarms of its asset; without one, those of all assets. */
export class AlarmsView extends View {
  /** @type {AlarmStatus[]} alarms of the archive, while closed ones are shown */
  #archived = [];
  /** @type {{id: number, part: Part} | null} the alarm with a further row */
  #unfolded = null;

  #count = html("span");
  #search = html("input", { type: "search", placeholder: "find an alarm", "aria-label": "find an alarm", oninput: this.draw });
  #maxSeverity = html("select", { "aria-label": "minimum severity", onchange: this.draw }, ...SEVERITIES.map(severityOption).reverse());
  #state = html("select", { "aria-label": "state of the alarms", onchange: () => this.#read() }, ...Object.entries(STATES).map(([value, textContent]) => html("option", { value, textContent })));
  #all = button("acknowledge all shown", "", () => this.#acknowledge(this.#shown));
  #message = html("p", { className: "message", role: "status" });
  #empty = html("p", { className: "empty" });
  #rows = html("tbody");
  #table = html("table", {}, tableHead(...COLUMNS), this.#rows);
  root = html(
    "section",
    { className: "rover-view alarms-view" },
    html("header", {}, this.#count, html("span", { className: "tools" }, this.#state, this.#maxSeverity, this.#search, this.#all, soundButton())),
    this.#message,
    this.#empty,
    html("div", { className: "scroll", tabIndex: 0 }, this.#table),
  );

  start() {
    return [this.session.on("alarms", () => this.#read()), this.session.onSecond(this.draw)];
  }

  /** The open alarms, and closed ones while they are shown. */
  get #alarms() {
    const isOurs = (alarm) => !this.asset || alarm.asset === this.asset.name;
    const { alarms } = this.session;
    return [...alarms.values(), ...this.#archived.filter((each) => !alarms.has(each.id))].filter(isOurs).sort(byUrgency);
  }

  /** The alarms that match the filters. */
  get #shown() {
    const { now } = this.session;
    const state = this.#state.value;
    const sought = this.#search.value.trim().toLowerCase();
    return this.#alarms.filter(
      (each) =>
        (state === "all" || (state === "shelved") === isShelved(each, now)) &&
        (state !== "active" || each.cleared === null) &&
        (state !== "unacknowledged" || !isAcknowledged(each)) &&
        SEVERITIES.indexOf(each.severity) <= Number(this.#maxSeverity.value) &&
        `${each.asset} ${each.source} ${each.text} ${each.operator ?? ""} ${each.comment ?? ""}`.toLowerCase().includes(sought),
    );
  }

  /** Read the closed alarms, if they are shown. */
  async #read() {
    const query = this.asset ? `?asset=${encodeURIComponent(this.asset.name)}` : "";
    const found = this.#state.value === "all" ? await fetchJson(`/api/alarms${query}`).catch(() => null) : null;
    this.#archived = found?.alarms ?? [];
    this.draw();
  }

  /** @param {AlarmStatus[]} alarms as shown here; a recurrence after that stays unacknowledged */
  #acknowledge(alarms) {
    return this.#change("acknowledge", { alarms: alarms.filter((each) => !isAcknowledged(each)).map((each) => [each.id, each.occurrences]) });
  }

  /** @param {number} alarm @param {number} duration_s 0 ends the shelving @param {string} [comment] */
  async #shelve(alarm, duration_s, comment) {
    if (await this.#change("shelve", { alarm, duration: duration_s, comment })) this.#unfold(null);
  }

  /** Request a change of alarms; return whether it was made. @param {"acknowledge" | "shelve"} what @param {object} json */
  async #change(what, json) {
    const problem = await fetchJson(`/api/alarms/${what}`, { json }).then(() => "", (error) => error.message);
    setText(this.#message, problem);
    return !problem;
  }

  /** Show a further row of an alarm, or hide it if it is shown. @param {AlarmStatus | null} alarm @param {Part} [part] */
  #unfold(alarm, part = "evidence") {
    const { id, part: shown } = this.#unfolded ?? {};
    this.#unfolded = alarm === null || (id === alarm.id && shown === part) ? null : { id: alarm.id, part };
    this.render(); // with the click: the form receives each key after it
  }

  render() {
    const { now } = this.session;
    const alarms = this.#alarms;
    const shown = this.#shown;
    const count = (isCounted) => alarms.filter(isCounted).length;
    const counts = { open: count(isOpen), "to acknowledge": count((each) => needsAction(each, now)), shelved: count((each) => isShelved(each, now)) };
    setText(this.#count, Object.entries(counts).filter(([, number]) => number).map(([name, number]) => `${number} ${name}`).join(", "));
    this.#all.hidden = shown.every(isAcknowledged);
    this.#table.hidden = shown.length === 0;
    this.#empty.hidden = shown.length > 0;
    setText(this.#empty, alarms.length ? "No alarm matches these filters." : "No open alarms. Reported warnings and faults, and values outside their limits, are listed here.");
    const items = shown.flatMap((alarm) => [{ alarm, part: "alarm" }, ...(alarm.id === this.#unfolded?.id ? [{ alarm, part: this.#unfolded.part }] : [])]);
    reconcile(this.#rows, items, keyOf, (item) => this.#makeRow(item), (row, { alarm, part }) => part === "alarm" && this.#drawRow(row, alarm));
  }

  /** The evidence of an alarm. Its module is loaded now, for the status bar with STOP to load sooner. */
  #evidence(alarm) {
    const element = html("div");
    import("./alarm_evidence.js").then(({ evidenceOf }) => element.replaceWith(evidenceOf(this.session, alarm)));
    return element;
  }

  #makeRow({ alarm, part }) {
    if (part === "evidence") return below(this.#evidence(alarm));
    if (part === "shelving") return below(this.#shelvingForm(alarm));
    const current = () => this.session.alarms.get(alarm.id) ?? alarm;
    return html(
      "tr",
      { "data-source": alarm.source },
      html("td", { className: "severity" }),
      html("td"),
      html("td", { className: "text" }, html("span"), button("", "", () => this.#unfold(alarm), { className: "evidence" })),
      ...["time", "time", "time", "figure", "state"].map((className) => html("td", { className })),
      html(
        "td",
        { className: "actions" },
        button("acknowledge", "", () => this.#acknowledge([current()])),
        button("", "", () => (isShelved(current(), this.session.now) ? this.#shelve(alarm.id, 0) : this.#unfold(alarm, "shelving"))),
      ),
    );
  }

  /** @param {HTMLElement} row @param {AlarmStatus} alarm */
  #drawRow(row, alarm) {
    const { now } = this.session;
    const [severity, rover, cause, first, last, ended, count, state, actions] = row.children;
    const isUnfolded = this.#unfolded?.id === alarm.id;
    set(row, {
      class: `${alarm.severity.toLowerCase()}${needsAction(alarm, now) ? " open" : ""}`,
      "data-state": alarm.cleared === null ? "active" : "cleared",
      "data-acknowledged": String(isAcknowledged(alarm)),
    });
    const texts = [alarm.severity.toLowerCase(), alarm.asset, clock(alarm.raised), clock(alarm.last), alarm.cleared === null ? "" : clock(alarm.cleared), String(alarm.occurrences), stateOf(alarm, now)];
    [severity, rover, first, last, ended, count, state].forEach((cell, index) => setText(cell, texts[index]));
    setText(cause.children[0], alarm.text);
    const isEvident = isUnfolded && this.#unfolded.part === "evidence";
    setText(cause.children[1], isEvident ? "hide evidence" : "evidence");
    set(cause.children[1], { "aria-expanded": String(isEvident) });
    const [acknowledge, shelve] = /** @type {any} */ (actions.children);
    acknowledge.hidden = isAcknowledged(alarm);
    shelve.hidden = !isOpen(alarm);
    setText(shelve, isShelved(alarm, now) ? "end shelving" : "shelve …");
    set(shelve, { "aria-expanded": String(isUnfolded && this.#unfolded.part === "shelving") });
  }

  /** Create the form that shelves an alarm. @param {AlarmStatus} alarm */
  #shelvingForm({ id }) {
    const comment = html("input", { type: "text", required: true, maxLength: 400, placeholder: "reason, and the next action", "aria-label": "comment" });
    const time = html("select", { "aria-label": "duration" }, ...Object.entries(SHELVING_S).map(([textContent, value]) => html("option", { textContent, value })));
    const onsubmit = (event) => (event.preventDefault(), this.#shelve(id, Number(time.value), comment.value.trim()));
    const cancel = button("cancel", "", () => this.#unfold(null));
    queueMicrotask(() => comment.focus()); // after it was added
    return html("form", { className: "tools", onsubmit }, "Shelve for", time, comment, html("button", { type: "submit", textContent: "shelve" }), cancel);
  }
}

/** @param {string} severity @param {number} index */
function severityOption(severity, index) {
  const isMild = index === SEVERITIES.length - 1;
  return html("option", { value: String(index), textContent: isMild ? "all severities" : index ? `${severity.toLowerCase()} and worse` : severity.toLowerCase() });
}

/** @param {{alarm: AlarmStatus, part: string}} item */
const keyOf = ({ alarm, part }) => (part === "evidence" ? `${alarm.id} ${part} ${alarm.occurrences}` : `${alarm.id} ${part}`);

/** Create a row over the whole width. @param {HTMLElement} content */
const below = (content) => html("tr", { className: "below" }, html("td", { colSpan: COLUMNS.length }, content));

/** @param {AlarmStatus} alarm @param {number} now_s */
function stateOf(alarm, now_s) {
  const { cleared, operator, acknowledged, shelved_until: until, shelved_by: by, comment } = alarm;
  const parts = [isOpen(alarm) ? (cleared === null ? "active" : "ended") : "closed"];
  if (isShelved(alarm, now_s)) parts.push(`shelved by ${by} for another ${duration(until - now_s)}: ${comment}`);
  parts.push(isAcknowledged(alarm) ? `acknowledged by ${operator}, ${clock(acknowledged)}` : "to acknowledge");
  return parts.join(", ");
}
