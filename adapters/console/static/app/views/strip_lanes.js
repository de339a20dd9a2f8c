/** Lanes of the time strip: bars, each with its parts in time. */

import { clock } from "../format.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { AlarmStatus, CommandStatus } from "../model/messages.js" */
/** @import { ArchivedHistory } from "../model/archive.js" */
/** @typedef {{from: number, to: number, style: string}} Part */
/** @typedef {{key: string, label: string, title: string, style: string, parts: Part[], command?: string, state?: string, expected?: number}} Bar `to` of the last part is Infinity while it is open; `expected` is the predicted end */
/** @typedef {{name: string, bars: Bar[], isPacked: boolean}} Lane */

const UNCERTAIN_STATES = ["unknown", "lost"];

/** @param {Asset} asset @param {ArchivedHistory} history @param {number} now_s @returns {Lane[]} */
export function lanesOf(asset, history, now_s) {
  const { modes, authority, plans } = history.records;
  return [
    { name: "plans", bars: planBars(plans), isPacked: true },
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

/** Return bars of states, each until the next record with another state. @returns {Bar[]} */
function statesOf(records, describe) {
  const bars = [];
  let last = null;
  for (const each of records) {
    const [state, label, style] = describe(each);
    if (last?.state === state) continue;
    if (last) last.parts[0].to = each.utc;
    last = { key: String(each.utc), state: "", label, title: `${label} from ${clock(each.utc)}`, style, parts: [{ from: each.utc, to: Infinity, style }] };
    bars.push(last);
    last.state = state;
  }
  return bars.map(({ state, ...bar }) => bar);
}

/** Return one bar for each activity of a plan, from one report to the next. @returns {Bar[]} */
function planBars(plans) {
  const bars = [];
  for (const plan of new Set(plans.map((each) => each.plan))) {
    const records = plans.filter((each) => each.plan === plan);
    for (const bar of statesOf(records, (each) => {
      const status = each.status.toLowerCase();
      const activity = each.node?.split("/").at(-1) ?? "";
      return [`${status} ${each.node}`, [plan, activity || status].join(": "), `plan-${status}`];
    })) {
      const isOver = ["plan-completed", "plan-failed", "plan-aborted"].includes(bar.style);
      const { from, to, style } = bar.parts[0];
      bars.push({ ...bar, key: `${plan} ${from} ${bar.label}`, title: `${bar.title}, ${style.slice(5)}`, parts: [{ from, to: isOver ? from : to, style }] });
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
    label: command.name,
    title: `${command.name} by ${command.by}, created ${clock(command.created, true)}: ${command.state.replace("_", " ")}. ${command.history.at(-1)?.detail ?? ""}${
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
