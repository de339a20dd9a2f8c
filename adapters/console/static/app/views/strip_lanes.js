/** Lanes of the time strip: bars, each with its parts in time. */

import { nameOf } from "../model/asset.js";
import { clock } from "../format.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { AlarmStatus, CommandStatus } from "../model/messages.js" */
/** @import { ArchivedHistory } from "../model/archive.js" */
/** @typedef {{from: number, to: number, style: string}} Part */
/** @typedef {{key: string, label: string, title: string, style: string, parts: Part[], command?: string, state?: string, expected?: number, row?: number}} Bar `to` of the last part is Infinity while it is open; `expected` is the predicted end, `row` that of a lane that is not packed */
/** @typedef {{name: string, bars: Bar[], isPacked: boolean}} Lane */

const ENDED_PLANS = ["plan-completed", "plan-failed", "plan-aborted"];
const UNCERTAIN_STATES = ["unknown", "lost"];

/** @param {Asset} asset @param {ArchivedHistory} history @param {number} now_s @returns {Lane[]} */
export function lanesOf(asset, history, now_s) {
  const { modes, authority, plans } = history.records;
  return [
    { name: "plans", bars: planBars(plans), isPacked: false },
    { name: "commands", bars: [...asset.commands.values()].map((each) => commandBar(each, now_s)), isPacked: true },
    { name: "mode", bars: statesOf(modes, (each) => [each.mode, each.mode, `mode-${each.mode}`]), isPacked: false },
    {
      name: "activity",
      bars: statesOf(modes, (each) => {
        const command = workOf(asset, each.active);
        return [each.active ?? "", command?.name ?? each.active ?? "", each.active ? "started" : "none"];
      }).filter((each) => each.label),
      isPacked: false,
    },
    {
      name: "authority",
      bars: statesOf(authority, (each) => {
        const holder = each.operator ?? each.holder ?? "";
        return [holder, holder, holder ? "held" : "none"];
      }).filter((each) => each.label),
      isPacked: false,
    },
    { name: "alarms", bars: history.alarms.map(alarmBar), isPacked: true },
  ];
}

/** Return the active command of an asset, by SOURCE:NUMBER or by its number. */
function workOf(asset, active) {
  if (!active) return null;
  return asset.commandOf(active) ?? asset.lastCommands.find((each) => String(each.number) === active) ?? null;
}

/** Return bars of states, each until the next record with another state; of several records of one moment the last counts. @returns {Bar[]} */
function statesOf(records, describe) {
  const bars = [];
  for (const each of records) {
    const [state, label, style] = describe(each);
    if (bars.at(-1)?.parts[0].from === each.utc) bars.pop();
    const last = bars.at(-1);
    if (last) last.parts[0].to = last.state === state ? Infinity : each.utc;
    if (last?.state === state) continue;
    bars.push({ key: String(each.utc), state, label, title: `${label} from ${clock(each.utc)}`, style, parts: [{ from: each.utc, to: Infinity, style }] });
  }
  return bars.map(({ state, ...bar }) => bar);
}

/** Return one bar for each activity of a plan, from one report to the next; plans at the same time are in different rows. @returns {Bar[]} */
function planBars(plans) {
  const bars = [];
  /** @type {number[]} end of the last plan of each row */
  const ends = [];
  for (const plan of new Set(plans.map((each) => each.plan))) {
    const records = plans.filter((each) => each.plan === plan);
    const states = statesOf(records, (each) => {
      const status = each.status.toLowerCase();
      const activity = each.node?.split("/").at(-1) ?? "";
      return [`${status} ${each.node}`, [plan, activity || status].join(": "), `plan-${status}`];
    });
    const free = ends.findIndex((end) => end <= states[0].parts[0].from);
    const row = free < 0 ? ends.length : free;
    for (const bar of states) {
      const [part] = bar.parts;
      if (ENDED_PLANS.includes(bar.style)) part.to = part.from;
      ends[row] = part.to;
      bars.push({ ...bar, key: `${plan} ${bar.key}`, title: `${bar.title}, ${bar.style.slice(5)}`, row });
    }
  }
  return bars;
}

/** @param {CommandStatus} command @param {number} now_s @returns {Bar} */
function commandBar(command, now_s) {
  const when = (...stages) => command.history.find((each) => stages.includes(each.stage))?.utc;
  const isUncertain = UNCERTAIN_STATES.includes(command.state);
  const last = command.history.at(-1)?.utc ?? command.created;
  const end = Math.max(command.created, command.ended || isUncertain ? last : Infinity);
  const accepted = when("RECEIVED", "ACCEPTED") ?? (command.ended ? when("STARTED") : undefined) ?? end;
  const started = when("STARTED") ?? end;
  const predicted = command.history.findLast((each) => each.stage === "PREDICTED")?.figures;
  const duration_s = /** @type {number | undefined} */ (predicted?.["predicted duration"]);
  const expected = duration_s === undefined || started === end ? undefined : started + duration_s;
  const until = (utc) => Math.min(Math.max(utc, command.created), end);
  const outcome = command.ended || isUncertain ? command.state : "started";
  const parts = [
    { from: command.created, to: until(accepted), style: "sent" },
    { from: until(accepted), to: until(Math.max(started, accepted)), style: "accepted" },
    { from: until(Math.max(started, accepted)), to: end, style: outcome },
  ];
  const shown = parts.filter(({ from, to }, index) => to > from || (index === 2 && from <= now_s && end !== Infinity));
  return {
    key: command.id,
    label: nameOf(command),
    title: `${nameOf(command)} by ${command.by}, created ${clock(command.created, true)}: ${command.state.replace("_", " ")}. ${command.history.at(-1)?.detail ?? ""}${
      expected === undefined ? "" : ` (predicted to end ${clock(expected)})`
    }`,
    style: `of-command ${command.ended || isUncertain ? "" : "in-flight"}`,
    parts: shown.map((each) => (isUncertain && each.style !== command.state ? { ...each, style: `${each.style} uncertain` } : each)),
    command: command.id,
    state: command.state,
    expected,
  };
}

/** @param {AlarmStatus} alarm @returns {Bar} */
function alarmBar(alarm) {
  const style = `alarm-${alarm.severity.toLowerCase()}`;
  const acknowledged = alarm.acknowledged === null ? "not acknowledged" : `acknowledged by ${alarm.operator}`;
  return {
    key: String(alarm.id),
    label: alarm.text,
    title: `${alarm.severity}, ${alarm.occurrences} times since ${clock(alarm.raised)}, ${acknowledged}: ${alarm.text}`,
    style,
    parts: [{ from: alarm.raised, to: alarm.cleared ?? Infinity, style }],
  };
}
