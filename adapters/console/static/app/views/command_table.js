/**
 * The commands of an asset, newest first, in two lines each, and the life cycle of each, stage by stage. A sent
 * command is not shown as done: only EXECUTED is green, and a command without a report in time is UNKNOWN. The
 * arrow keys move through the rows, and Enter opens one.
 */

import { nameOf } from "../model/asset.js";
import { fetchJson, newId, operator } from "../model/connection.js";
import { button, html, reconcile, setText, set } from "../dom.js";
import { View } from "./view.js";
import { clock, degrees, duration, fixed, number, today, unitOf } from "../format.js";

/** @import { CommandStatus, ExplanationBody, PlanProgress } from "../model/messages.js" */

const MAX_ROWS = 100;
/** New commands are in view while the list is scrolled by less, in pixels. */
const TOP_PX = 10;
/** Stages of an executed command, by link. A recording has the rover's reports only. */
const STAGES = {
  recording: ["RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"],
  direct: ["SENT", "RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"],
  relay: ["SENT", "ACKNOWLEDGED", "FORWARDED", "RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"],
};
const STATE_LABELS = {
  sending: ["sending", "sent, not answered yet"],
  acknowledged: ["at the relay", "the other end of the link has received it; the rover may not have"],
  received: ["received", "the rover has received it"],
  accepted: ["accepted", "it will be executed"],
  started: ["active", "it is being executed"],
  executed: ["executed", "it was executed"],
  rejected: ["rejected", "it was not executed"],
  failed: ["failed", "it was started and not completed"],
  cancelled: ["cancelled", "ended by a later command"],
  expired: ["expired", "its lifetime ended before it started"],
  lost: ["lost", "the relay expects no report any longer; the rover may have executed it"],
  unknown: ["unknown", "no report in time; the rover may have executed it"],
};

export class CommandTable extends View {
  /** @type {Map<string, ExplanationBody | null>} explanations, by command and whether it had ended */
  #explanations = new Map();

  /** @type {WeakMap<HTMLElement, CommandStatus>} the commands as their rows show them */
  #drawn = new WeakMap();
  /** basis of all rows: the units of arguments, and the present date @type {any[]} */
  #basis = [];
  /** @type {Set<string>} ids of the commands up to the last one that was in view */
  #seen = new Set();
  /** @type {string | undefined} id of the command with the tab stop */
  #current;

  #rows = html("div", { className: "commands", role: "list", onkeydown: (event) => this.#onKey(event) });
  #scroll = html("div", { className: "scroll", onscroll: this.draw }, this.#rows);
  #jump = button("", "go to the newest command", () => (this.#scroll.scrollTop = 0), { className: "jump", "data-testid": "new-commands" });
  #empty = html("p", { className: "empty" });
  #plans = html("div");
  root = html("section", { className: "rover-view commands-view" }, this.#plans, this.#empty, this.#jump, this.#scroll);

  start() {
    const { asset, selection, cursor, draw } = this;
    return [PlanStrip.mount(this.#plans, this), asset.on("commands", draw), asset.on("links", draw), selection.on(draw), cursor.on(draw)];
  }

  render() {
    const { asset, session } = this;
    const { utc_s } = this.cursor;
    const folded = asset.continuedDrives;
    const all = asset.commandsAt(utc_s).filter(({ id }) => !folded.has(id) || id === this.selection.command);
    const first = utc_s === null ? 0 : all.findIndex((each) => each.created <= utc_s) - MAX_ROWS / 2;
    const shown = all.slice(Math.max(0, first)).slice(0, MAX_ROWS);
    this.#empty.hidden = shown.length > 0;
    setText(this.#empty, asset.isReached ? "No command yet. Choose one under “Command”, or click the map." : session.unreached(asset));
    const basis = [asset.entry, today()];
    if (basis.some((each, index) => each !== this.#basis[index])) this.#drawn = new WeakMap();
    this.#basis = basis;
    if (!this.#rows.contains(document.activeElement) || !shown.some((each) => each.id === this.#current)) this.#current = shown[0]?.id;
    reconcile(this.#rows, shown, (command) => command.id, (command) => this.#makeRow(command), (row, command) => this.#drawRow(row, command));
    if (utc_s === null) this.#showNew(shown);
    else this.#jump.hidden = true;
  }

  /** Scroll to a new command of this operator; announce those of others while they are out of view. @param {CommandStatus[]} shown newest first */
  #showNew(shown) {
    const unseen = shown.filter((each) => !this.#seen.has(each.id));
    const own = unseen.find((each) => each.by === operator.name);
    if (own) this.#rows.children[shown.indexOf(own)].scrollIntoView({ block: "nearest" });
    const isInView = this.#scroll.scrollTop < TOP_PX;
    if (isInView || own) this.#seen = new Set(shown.map((each) => each.id));
    this.#jump.hidden = isInView || own !== undefined || unseen.length === 0;
    setText(this.#jump, `↑ ${unseen.length} new`);
  }

  /** Move through the rows by arrow keys. @param {KeyboardEvent} event of a row */
  #onKey(event) {
    const heads = [...this.#rows.querySelectorAll(".head")];
    const index = heads.indexOf(event.target);
    const next = { ArrowDown: index + 1, ArrowUp: index - 1, Home: 0, End: heads.length - 1 }[event.key];
    if (index < 0 || next === undefined) return;
    event.preventDefault();
    heads[Math.max(0, Math.min(next, heads.length - 1))].focus();
  }

  /** @param {string} id of the command that is focused */
  #onFocus(id) {
    this.#current = id;
    this.draw();
  }

  /** @param {CommandStatus} command @returns {string[]} */
  #stagesOf(command) {
    return STAGES[this.asset.recording ? "recording" : command.link] ?? STAGES.direct;
  }

  /** @param {CommandStatus} command */
  #makeRow(command) {
    const span = (className) => html("span", { className });
    return html(
      "div",
      { role: "listitem", onclick: () => this.selection.selectCommand(command.id) },
      html("button", { type: "button", className: "head", onfocus: () => this.#onFocus(command.id) }, html("time"), html("b"), span("arguments")),
      html("div", { className: "course" }, lifecycleLine(this.#stagesOf(command)), span("detail"), span("by dim"), span("state")),
      html("div", { className: "whole", hidden: true, onclick: (event) => event.stopPropagation() }),
    );
  }

  /** @param {any} row @param {CommandStatus} command */
  #drawRow(row, command) {
    const [head, course, whole] = row.children;
    const [lifecycle, detail, by, state] = course.children;
    const [time, name, args] = head.children;
    const [label, meaning] = STATE_LABELS[command.state] ?? [command.state, ""];
    const { utc_s } = this.cursor;
    const isChosen = this.selection.command === command.id;
    const isLater = utc_s !== null && command.created > utc_s;
    set(row, { class: `command ${command.state}${isChosen ? " selected" : ""}${isLater ? " later" : ""}` });
    set(head, { tabIndex: command.id === this.#current ? 0 : -1, "aria-expanded": isChosen });
    whole.hidden = !isChosen;
    if (isChosen) whole.replaceChildren(this.#why(command), comparison(command) ?? "", stageTable(command));
    if (this.#drawn.get(row) === command) return;
    this.#drawn.set(row, command);
    row.dataset.state = command.state;
    row.dataset.name = command.name;
    setText(time, clock(command.created));
    setText(name, nameOf(command));
    setText(args, argumentSummary(command, this.asset));
    set(args, { title: args.textContent });
    setText(by, `${command.by}${command.link === "relay" ? ", by relay" : ""}`);
    setText(state, label + stepsOf(command));
    set(state, { title: meaning });
    drawLifecycle(lifecycle, command, this.#stagesOf(command));
    const last = command.history.at(-1);
    const awaited = command.deadline !== null && !command.ended ? `; unknown after ${clock(command.deadline)} without a report` : "";
    setText(detail, ["sending", "acknowledged"].includes(command.state) ? `${meaning}${awaited}` : last?.detail || meaning);
    set(detail, { title: detail.textContent });
  }

  /** The explanation of a command; requested when it is selected, and again after it has ended. @param {CommandStatus} command */
  #why(command) {
    const key = `${command.id} ${command.ended}`;
    if (!this.#explanations.has(key)) {
      this.#explanations.set(key, null);
      fetchJson(`/api/why/${encodeURIComponent(this.asset.name)}/${encodeURIComponent(command.id)}`)
        .then((answer) => (this.#explanations.set(key, answer), this.draw()))
        .catch(() => {});
    }
    const known = this.#explanations.get(key);
    return known ? explanationTable(known) : "";
  }
}

/** Create the table of an explanation: its steps and their evidence. @param {ExplanationBody} explanation */
export function explanationTable({ steps, evidence }) {
  const texts = [...steps.map(({ utc, text }) => [utc === null ? "" : clock(utc, true), text]), ...evidence.map((text) => ["evidence", text])];
  return html("table", { className: "why-steps" }, ...texts.map((each) => row(each)));
}

/** @param {string[]} texts of its cells @param {string} [name] of their element */
export const row = (texts, name = "td") => html("tr", {}, ...texts.map((text) => html(name, { textContent: text ?? "" })));

/** Create dots for the stages, each with the time from the command to it; a narrow list shows the time of the last reached one only. @param {string[]} stages */
function lifecycleLine(stages) {
  return html(
    "div",
    { className: stages.length > STAGES.direct.length ? "lifecycle long" : "lifecycle" },
    ...stages.map(() => html("span", { className: "step" }, html("i"), html("span", { className: "what" }), html("span", { className: "when" }))),
  );
}

/** The progress of an active command, such as " 2/3"; empty if unknown. @param {CommandStatus} command */
function stepsOf({ ended, history }) {
  const { step, steps } = history.findLast((each) => typeof each.step === "number") ?? {};
  return ended || step === undefined ? "" : ` ${step}${steps ? `/${steps}` : ""}`;
}

/** @param {any} lifecycle @param {CommandStatus} command @param {string[]} stages */
function drawLifecycle(lifecycle, command, stages) {
  const reached = new Map(command.history.map((each) => [each.stage, each]));
  const last = command.history.at(-1)?.stage;
  const end = stages.includes(last ?? "") ? null : command.ended || ["unknown", "lost"].includes(command.state) ? last : null;
  const isAt = (stage, index) => reached.get(index === stages.length - 1 && end ? end : stage);
  const current = stages.findLastIndex(isAt);
  stages.forEach((stage, index) => {
    const [, what, when] = lifecycle.children[index].children;
    const isEnd = index === stages.length - 1;
    const shown = isEnd && end ? end : stage;
    const at = isAt(stage, index);
    set(lifecycle.children[index], {
      class: `step ${at ? "reached" : ""} ${index === current ? "current" : ""} ${shown.toLowerCase()}`,
      "data-stage": shown,
      "data-reached": String(Boolean(at)),
      title: at ? `${shown}: ${clock(at.utc, true)} by the clock of ${at.node}, received ${clock(at.rx, true)}` : `${shown}: not yet`,
    });
    setText(what, shown.toLowerCase().replace("_", " "));
    const made = !at || at.utc < command.created || at.utc > at.rx ? at?.rx : at.utc; // a time outside is of a wrong clock
    setText(when, index === 0 || !(made >= command.created) ? "" : `+${(made - command.created).toFixed(2)} s`);
  });
}

/** Create the table of all stages, with their times at the sender and of reception. @param {CommandStatus} command */
function stageTable(command) {
  return html(
    "table",
    { className: "stages" },
    row(["stage", "by", "its time", "received", ""], "th"),
    ...command.history.map((each) => row([each.stage, each.node, clock(each.utc, true), clock(each.rx, true), each.detail])),
  );
}

/** Create the table of predicted and measured figures of a command; null without a prediction. @param {CommandStatus} command */
export function comparison(command) {
  const figures = command.history.at(-1)?.figures ?? {};
  const predicted = command.history.findLast((each) => each.stage === "PREDICTED")?.figures ?? {};
  const names = Object.keys(figures).filter((name) => `predicted ${name}` in figures);
  const rows = names.length
    ? names.map((name) => [name, figures[`predicted ${name}`], figures[name]])
    : Object.entries(predicted).map(([name, value]) => [name.replace(/^predicted /, ""), value, null]);
  if (!rows.length) return null;
  const format = (name, value) => {
    if (typeof value !== "number") return String(value ?? "");
    return name.includes("heading") ? `${fixed(degrees(value), 1)}°` : number(value);
  };
  return html(
    "table",
    { className: "comparison" },
    row(["", "predicted", "measured"], "th"),
    ...rows.map(([name, before, after]) =>
      html("tr", {}, html("td", { textContent: name }), html("td", { className: "figure", textContent: format(name, before) }), html("td", { className: "figure", textContent: format(name, after) })),
    ),
  );
}

/** Format the arguments in one line. @param {Pick<CommandStatus, "name" | "args">} command @param {import("../model/asset.js").Asset} asset */
export function argumentSummary(command, asset) {
  const entry = asset.entry?.commands.find((each) => each.name === command.name);
  return Object.entries(command.args ?? {})
    .map(([name, value]) => {
      if (value && typeof value === "object") return `${Object.keys(value).length} ${name}`;
      const argument = entry?.arguments.find((each) => each.name === name);
      if (typeof value !== "number") return `${name} ${value}`;
      const factor = argument?.display_unit?.per_unit ?? 1;
      const [unit, scale] = argument?.display_unit ? [unitOf(argument), 100] : ["", 1000];
      return `${name} ${Math.round(value * factor * scale) / scale}${unit}`;
    })
    .join("  ");
}

const ACTS = { ACTIVATED: "suspendPlan", EXECUTING: "suspendPlan", SUSPENDED: "resumePlan" };

/** One line for each plan that runs or is suspended: state, step, predicted time left, suspend and resume. */
class PlanStrip extends View {
  #message = "";
  root = html("div", { className: "plan-strip", "data-testid": "plan-strip" });

  start() {
    const { asset, session, cursor, draw } = this;
    return [...["plans", "commands"].map((topic) => asset.on(topic, draw)), session.onSecond(draw), cursor.on(draw)];
  }

  render() {
    const { asset, cursor } = this;
    const isLive = cursor.utc_s === null && !asset.recording;
    const shown = isLive ? [...asset.plansAboard.values()].filter((each) => each.status in ACTS) : [];
    reconcile(this.root, shown, (each) => each.plan, (each) => this.#make(each), (line, each) => this.#drawLine(line, each));
  }

  /** @param {PlanProgress} progress */
  #make({ plan }) {
    const [suspend, resume] = ["suspendPlan", "resumePlan"].map((act) => button(act.replace("Plan", ""), `${act} ${plan}`, () => this.#act(act, plan)));
    return html("p", {}, html("b", { textContent: plan }), html("span"), html("span", { className: "step" }), suspend, resume);
  }

  /** @param {any} line @param {PlanProgress} progress */
  #drawLine(line, progress) {
    const [, state, step, suspend, resume] = line.children;
    const { status, done, total, node } = progress;
    set(line, { class: status.toLowerCase() });
    setText(state, status.toLowerCase());
    const left_s = this.#left_s(progress);
    const name = node?.split("/").at(-1) ?? "";
    const at = total ? `step ${Math.min((done ?? 0) + 1, total)} of ${total}` : "";
    setText(step, this.#message || [[at, name].filter(Boolean).join(": "), left_s === null ? "" : `${duration(left_s)} left`].filter(Boolean).join(", "));
    suspend.hidden = ACTS[status] !== "suspendPlan";
    resume.hidden = ACTS[status] !== "resumePlan";
  }

  /** The predicted time left; null if unknown, as after a suspension. @param {PlanProgress} progress */
  #left_s({ plan, status }) {
    const { asset } = this;
    const predicted = asset.notices.findLast((each) => each.text.startsWith(`plan ${plan} predicted`));
    const isResumed = ({ name, args, created }) => name === "resumePlan" && args?.plan_id === plan && created > predicted.utc;
    if (status !== "EXECUTING" || !predicted || !asset.pose || [...asset.commands.values()].some(isResumed)) return null;
    return Math.max(Number(predicted.figures["predicted duration"]) - (asset.pose.utc - predicted.utc), 0);
  }

  /** @param {string} name of the command @param {string} plan */
  async #act(name, plan) {
    const json = { id: newId(), asset: this.asset.name, name, args: { plan_id: plan } };
    this.#message = await fetchJson("/api/commands", { json }).then(() => "", (error) => error.message);
    this.draw();
  }
}
