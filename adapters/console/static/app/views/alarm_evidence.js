/** The evidence of an alarm: why its command ended, and the log around its last occurrence. */

import { fetchJson } from "../model/connection.js";
import { contextOf } from "../model/context.js";
import { button, html } from "../dom.js";
import { explanationTable, row } from "./command_table.js";
import { clock } from "../format.js";

/** @import { AlarmStatus, NotificationMessage } from "../model/messages.js" */
/** @import { Session } from "../model/session.js" */

/** Interval of the log before and after the alarm, s. */
const AROUND_S = 30;
const MAX_ENTRIES = 30;

/** Return an element that the evidence of an alarm is read into. @param {Session} session @param {AlarmStatus} alarm @returns {HTMLElement} */
export function evidenceOf(session, alarm) {
  const element = html("div", { className: "whole", textContent: "Reading …" });
  read(alarm)
    .then(([explanation, entries]) => element.replaceChildren(...partsOf(session, alarm, explanation, entries)))
    .catch((error) => (element.textContent = error.message));
  return element;
}

/** @param {AlarmStatus} alarm */
async function read({ asset, command, last }) {
  const name = encodeURIComponent(asset);
  const why = command === null ? null : fetchJson(`/api/why/${name}/${encodeURIComponent(command)}`).catch(() => null);
  const { notifications } = await fetchJson(`/api/notifications?asset=${name}&start=${last - AROUND_S}&before=${last + AROUND_S}&limit=${MAX_ENTRIES}`);
  return [await why, notifications.sort((one, other) => one.utc - other.utc || one.sequence - other.sequence)];
}

/** @param {Session} session @param {AlarmStatus} alarm @param {any} explanation @param {NotificationMessage[]} entries */
function partsOf(session, { asset, command }, explanation, entries) {
  const log = entries.map(({ utc, stage, kind, text }) => row([clock(utc, true), stage ?? kind, text]));
  const select = () => contextOf(session, asset).selection.selectCommand(command);
  return [
    ...(explanation ? [html("h3", { textContent: explanation.headline }), explanationTable(explanation)] : []),
    html("h3", { textContent: `Log of ${asset}, ${AROUND_S} s before and after the alarm` }),
    log.length ? html("table", { className: "entries" }, ...log) : html("p", { className: "dim", textContent: "No entries." }),
    ...(command === null ? [] : [button("select the command in all views", "", select)]),
  ];
}
