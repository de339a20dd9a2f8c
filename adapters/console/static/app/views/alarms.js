/**
 * Alarms: what calls for somebody's attention. One stands until it is over and somebody acknowledged it; all
 * consoles show the same.
 */

import { ask } from "../model/connection.js";
import { contextOf } from "../model/context.js";
import { eachFrame, html, keep, say, set } from "../dom.js";
import { clock } from "../words.js";

/** @typedef {import("../model/session.js").Session} Session */
/** @import { AlarmStatus } from "../model/messages.js" */

const SEVERITIES = ["CRITICAL", "SEVERE", "ALARM", "WARNING"];

/** @param {AlarmStatus} alarm */
export const isUnacknowledged = (alarm) => alarm.acknowledged === null;

/** The worst first, and of these the last. @param {AlarmStatus} one @param {AlarmStatus} other */
const byUrgency = (one, other) =>
  Number(isUnacknowledged(other)) - Number(isUnacknowledged(one)) ||
  SEVERITIES.indexOf(one.severity) - SEVERITIES.indexOf(other.severity) ||
  other.last - one.last;

/**
 * @param {HTMLElement} element
 * @param {{session: Session, asset: {name: string} | null}} context without an asset it shows those of all
 * @returns {() => void}
 */
export function mount(element, { session, asset }) {
  /** @type {AlarmStatus[] | null} those that were, and those that stand; null while they are not shown */
  let past = null;
  const count = html("span");
  const all = html("button", { type: "button", textContent: "acknowledge all", onclick: () => acknowledge(standing()) });
  const history = html("button", { type: "button", textContent: "also those that are over", onclick: togglePast });
  const told = html("p", { className: "told", role: "status" });
  const empty = html("p", { className: "empty" });
  const rows = html("tbody");
  const root = html(
    "section",
    { className: "rover-view alarms-view" },
    html("header", {}, count, html("span", { className: "tools" }, history, all)),
    told,
    empty,
    html("div", { className: "scroll" }, html("table", {}, rows)),
  );
  element.append(root);

  const isOurs = (alarm) => asset === null || alarm.asset === asset.name;
  const standing = () => [...session.alarms.values()].filter(isOurs).sort(byUrgency);

  /** @param {AlarmStatus[]} alarms as they are seen here: what has occurred again meanwhile is not acknowledged */
  async function acknowledge(alarms) {
    const seen = alarms.filter(isUnacknowledged).map((each) => [each.id, each.occurrences]);
    try {
      await ask("/api/alarms/acknowledge", { json: { alarms: seen } });
      say(told, "");
    } catch (error) {
      say(told, error.message);
    }
  }

  async function readPast() {
    const query = asset === null ? "" : `?asset=${encodeURIComponent(asset.name)}`;
    past = (await ask(`/api/alarms${query}`).catch(() => null))?.alarms ?? null;
    draw();
  }

  function togglePast() {
    if (past === null) return readPast();
    past = null;
    draw();
  }

  function render() {
    const now = standing();
    const open = now.filter(isUnacknowledged).length;
    const ids = new Set(now.map((each) => each.id));
    const shown = [...now, ...(past ?? []).filter((each) => !ids.has(each.id))];
    say(count, now.length ? `${now.length} standing, ${open} to acknowledge` : "");
    all.hidden = open === 0;
    history.classList.toggle("on", past !== null);
    empty.hidden = shown.length > 0;
    say(empty, past ? "There was no alarm yet." : "No alarm stands. Warnings and faults that are reported, and values beyond their limits, are listed here.");
    keep(rows, shown, (each) => String(each.id), make, update);
  }

  const make = (alarm) =>
    html(
      "tr",
      { "data-source": alarm.source, onclick: () => alarm.command && contextOf(session, alarm.asset).selection.selectCommand(alarm.command) },
      html("td", { className: "severity", textContent: alarm.severity.toLowerCase() }),
      html("td", { className: "dim", textContent: asset === null ? alarm.asset : "" }),
      html("td"),
      html("td"),
      html("td", { className: "text" }),
      html("td"),
    );

  function update(row, alarm) {
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
    set(time, { title: `first ${clock(alarm.raised, true)}, last ${clock(alarm.last, true)} UTC aboard${alarm.cleared === null ? "" : `, over ${clock(alarm.cleared, true)}`}` });
    say(text, alarm.occurrences > 1 ? `${alarm.text} (${alarm.occurrences} times)` : alarm.text);
    set(text, { title: alarm.source });
    if (who.drawn === `${alarm.operator}`) return;
    who.drawn = `${alarm.operator}`;
    who.replaceChildren(
      isOpen
        ? html("button", { type: "button", textContent: "acknowledge", onclick: (event) => (event.stopPropagation(), acknowledge([session.alarms.get(alarm.id) ?? alarm])) })
        : html("span", { className: "dim", textContent: `by ${alarm.operator}, ${clock(/** @type {number} */ (alarm.acknowledged))}` }),
    );
  }

  const draw = eachFrame(render);
  const off = session.on("alarms", () => (past === null ? draw() : readPast()));
  draw();
  return () => {
    off();
    root.remove();
  };
}
