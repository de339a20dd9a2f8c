/** What the time strip shows of an asset: lanes of bars, each with its parts in time. */

import { clock } from "../words.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { AlarmStatus, CommandStatus } from "../model/messages.js" */
/** @import { Past } from "../model/past.js" */
/** @typedef {{from: number, to: number, look: string}} Part */
/** @typedef {{key: string, label: string, title: string, look: string, parts: Part[], command?: string, state?: string, expected?: number}} Bar `to` of the last part is Infinity while it goes on; `expected` is when it was to end */
/** @typedef {{name: string, bars: Bar[], isPacked: boolean}} Lane */

const DOUBTED = ["unknown", "given_up"];

/** @param {Asset} asset @param {Past} past @param {number} now_s @returns {Lane[]} */
export function lanesOf(asset, past, now_s) {
  const { modes, authority, plans } = past.told;
  return [
    { name: "plans", bars: planBars(plans), isPacked: true },
    { name: "commands", bars: [...asset.commands.values()].map((each) => commandBar(each, now_s)), isPacked: true },
    { name: "mode", bars: statesOf(modes, (each) => [each.mode, each.mode, `mode-${each.mode}`]), isPacked: false },
    {
      name: "works on",
      bars: statesOf(modes, (each) => {
        const command = workOf(asset, each.active);
        return [each.active ?? "", command?.name ?? each.active ?? "", each.active ? "started" : "none"];
      }).filter((each) => each.label),
      isPacked: false,
    },
    {
      name: "authority",
      bars: statesOf(authority, (each) => {
        const who = each.operator ?? each.holder ?? "";
        return [who, who, who ? "held" : "none"];
      }).filter((each) => each.label),
      isPacked: false,
    },
    { name: "alarms", bars: past.alarms.map(alarmBar), isPacked: true },
  ];
}

/** The command that an asset says it works on, by SOURCE:NUMBER or number alone. */
function workOf(asset, active) {
  if (!active) return null;
  return asset.commandOf(active) ?? asset.lastCommands.find((each) => String(each.number) === active) ?? null;
}

/** Bars of what holds until something else is told. @returns {Bar[]} */
function statesOf(told, describe) {
  const bars = [];
  let last = null;
  for (const each of told) {
    const [state, label, look] = describe(each);
    if (last?.state === state) continue;
    if (last) last.parts[0].to = each.utc;
    last = { key: String(each.utc), state: "", label, title: `${label} from ${clock(each.utc)}`, look, parts: [{ from: each.utc, to: Infinity, look }] };
    bars.push(last);
    last.state = state;
  }
  return bars.map(({ state, ...bar }) => bar);
}

/** One bar for each activity: from one report of a plan to the next. @returns {Bar[]} */
function planBars(plans) {
  const bars = [];
  for (const plan of new Set(plans.map((each) => each.plan))) {
    const told = plans.filter((each) => each.plan === plan);
    for (const bar of statesOf(told, (each) => {
      const status = each.status.toLowerCase();
      const activity = each.node?.split("/").at(-1) ?? "";
      return [`${status} ${each.node}`, [plan, activity || status].join(": "), `plan-${status}`];
    })) {
      const isOver = ["plan-completed", "plan-failed", "plan-aborted"].includes(bar.look);
      const { from, to, look } = bar.parts[0];
      bars.push({ ...bar, key: `${plan} ${from}`, title: `${bar.title}, ${look.slice(5)}`, parts: [{ from, to: isOver ? from : to, look }] });
    }
  }
  return bars;
}

/** @param {CommandStatus} command @param {number} now_s @returns {Bar} */
function commandBar(command, now_s) {
  const when = (...stages) => command.history.find((each) => stages.includes(each.stage))?.utc;
  const isDoubted = DOUBTED.includes(command.state);
  const last = command.history.at(-1)?.utc ?? command.made;
  const end = Math.max(command.made, command.ended || isDoubted ? last : Infinity);
  const accepted = when("RECEIVED", "ACCEPTED") ?? (command.ended ? when("STARTED") : undefined) ?? end;
  const started = when("STARTED") ?? end;
  const predicted = command.history.findLast((each) => each.stage === "PREDICTED")?.figures;
  const duration_s = /** @type {number | undefined} */ (predicted?.["predicted duration"]);
  const expected = duration_s === undefined || started === end ? undefined : started + duration_s;
  const until = (utc) => Math.min(Math.max(utc, command.made), end);
  const outcome = command.ended || isDoubted ? command.state : "started";
  const parts = [
    { from: command.made, to: until(accepted), look: "sent" },
    { from: until(accepted), to: until(Math.max(started, accepted)), look: "accepted" },
    { from: until(Math.max(started, accepted)), to: end, look: outcome },
  ];
  const shown = parts.filter(({ from, to }, index) => to > from || (index === 2 && from <= now_s && end !== Infinity));
  return {
    key: command.id,
    label: command.name,
    title: `${command.name} by ${command.by}, made ${clock(command.made, true)}: ${command.state.replace("_", " ")}. ${command.history.at(-1)?.detail ?? ""}${
      expected === undefined ? "" : ` (predicted to end ${clock(expected)})`
    }`,
    look: `of-command ${command.ended || isDoubted ? "" : "in-flight"}`,
    parts: shown.map((each) => (isDoubted && each.look !== command.state ? { ...each, look: `${each.look} doubted` } : each)),
    command: command.id,
    state: command.state,
    expected,
  };
}

/** @param {AlarmStatus} alarm @returns {Bar} */
function alarmBar(alarm) {
  const look = `alarm-${alarm.severity.toLowerCase()}`;
  const acknowledged = alarm.acknowledged === null ? "not acknowledged" : `acknowledged by ${alarm.operator}`;
  return {
    key: String(alarm.id),
    label: alarm.text,
    title: `${alarm.severity}, ${alarm.occurrences} times since ${clock(alarm.raised)}, ${acknowledged}: ${alarm.text}`,
    look,
    parts: [{ from: alarm.raised, to: alarm.cleared ?? Infinity, look }],
  };
}
