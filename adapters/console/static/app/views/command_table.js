/**
 * The commands of an asset, newest first, and the life of each, stage by stage. What was sent is not
 * shown as done: only EXECUTED is green, and a command of which nothing was heard is UNKNOWN.
 */

import { ask } from "../model/connection.js";
import { html, keep, say, set } from "../dom.js";
import { View } from "./view.js";
import { clock, number, unitOf } from "../words.js";

/** @import { CommandStatus, ExplanationBody } from "../model/messages.js" */

const MOST_ROWS = 100;
/** The way of a command that is carried out, by each link; a recording knows what the rover said. */
const WAYS = {
  recording: ["RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"],
  direct: ["SENT", "RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"],
  relay: ["SENT", "TAKEN", "FORWARDED", "RECEIVED", "ACCEPTED", "STARTED", "EXECUTED"],
};
const WORDS = {
  sending: ["sending", "on its way; not answered yet"],
  taken: ["with the relay", "the other end of the link has it; the rover may not"],
  received: ["received", "the rover has it"],
  accepted: ["accepted", "it will be carried out"],
  started: ["under way", "it is being carried out"],
  executed: ["executed", "it was carried out"],
  rejected: ["rejected", "it was not carried out"],
  failed: ["failed", "it was begun and not completed"],
  cancelled: ["cancelled", "ended by a later command"],
  expired: ["expired", "its time was over before it began"],
  given_up: ["given up", "the relay gave it up; the rover may have carried it out"],
  unknown: ["unknown", "nothing was heard of it in time; the rover may have carried it out"],
};

export class CommandTable extends View {
  /** @type {Map<string, ExplanationBody | null>} what was told of why, by command and whether it had ended */
  #told = new Map();

  #rows = html("div", { className: "commands", role: "list" });
  #empty = html("p", { className: "empty" });
  root = html("section", { className: "rover-view commands-view" }, this.#empty, html("div", { className: "scroll" }, this.#rows));

  start() {
    const { asset, selection, cursor, draw } = this;
    return [asset.on("commands", draw), asset.on("links", draw), selection.on(draw), cursor.on(draw)];
  }

  render() {
    const { asset, session } = this;
    const { utc_s } = this.cursor;
    const all = asset.commandsAt(utc_s);
    const first = utc_s === null ? 0 : all.findIndex((each) => each.made <= utc_s) - MOST_ROWS / 2;
    const shown = all.slice(Math.max(0, first)).slice(0, MOST_ROWS);
    this.#empty.hidden = shown.length > 0;
    say(this.#empty, asset.isReached ? "No command yet. Choose one under “Command”, or click the map." : session.unreached(asset));
    keep(this.#rows, shown, (command) => command.id, (command) => this.#makeRow(command), (row, command) => this.#drawRow(row, command));
  }

  /** @param {CommandStatus} command @returns {string[]} */
  #wayOf(command) {
    return WAYS[this.asset.recording ? "recording" : command.link] ?? WAYS.direct;
  }

  /** @param {CommandStatus} command */
  #makeRow(command) {
    const parts = [html("time"), html("b"), ...["arguments", "by dim", "state"].map((className) => html("span", { className }))];
    return html(
      "article",
      { role: "listitem", onclick: () => this.selection.selectCommand(command.id) },
      html("div", { className: "head" }, ...parts),
      lifeLine(this.#wayOf(command)),
      html("p", { className: "detail" }),
      html("div", { className: "whole", hidden: true, onclick: (event) => event.stopPropagation() }),
    );
  }

  /** @param {any} row @param {CommandStatus} command */
  #drawRow(row, command) {
    const [head, life, detail, whole] = row.children;
    const [time, name, args, by, state] = head.children;
    const [word, meaning] = WORDS[command.state] ?? [command.state, ""];
    const { utc_s } = this.cursor;
    const isChosen = this.selection.command === command.id;
    const isLater = utc_s !== null && command.made > utc_s;
    row.className = `command ${command.state}${isChosen ? " selected" : ""}${isLater ? " later" : ""}`;
    row.dataset.state = command.state;
    row.dataset.name = command.name;
    say(time, clock(command.made));
    say(name, command.name || "a command");
    say(args, shortly(command, this.asset));
    say(by, `${command.by}${command.link === "relay" ? ", by relay" : ""}`);
    say(state, word);
    set(state, { title: meaning });
    drawLife(life, command, this.#wayOf(command));
    const last = command.history.at(-1);
    const awaited = command.deadline !== null && !command.ended ? `; heard of by ${clock(command.deadline)}, or unknown` : "";
    say(detail, ["sending", "taken"].includes(command.state) ? `${meaning}${awaited}` : last?.detail || meaning);
    whole.hidden = !isChosen;
    if (isChosen) whole.replaceChildren(this.#why(command), comparison(command) ?? "", stageTable(command));
  }

  /** Why it ended as it did, or what it is about: asked for when it is looked at, and again when it has ended. @param {CommandStatus} command */
  #why(command) {
    const key = `${command.id} ${command.ended}`;
    if (!this.#told.has(key)) {
      this.#told.set(key, null);
      ask(`/api/why/${encodeURIComponent(this.asset.name)}/${encodeURIComponent(command.id)}`)
        .then((answer) => (this.#told.set(key, answer), this.draw()))
        .catch(() => {});
    }
    const known = this.#told.get(key);
    if (!known) return "";
    const steps = known.steps.map(({ utc, text }) => [utc === null ? "" : clock(utc, true), text]);
    return html("table", { className: "why-steps" }, ...[...steps, ...known.evidence.map((text) => ["evidence", text])].map((texts) => row(texts)));
  }
}

/** @param {string[]} texts of its cells @param {string} [name] of their element */
const row = (texts, name = "td") => html("tr", {}, ...texts.map((text) => html(name, { textContent: text ?? "" })));

/** Dots from the first stage to the end, each with the time since then. @param {string[]} way */
function lifeLine(way) {
  return html(
    "div",
    { className: "life" },
    ...way.map(() => html("span", { className: "step" }, html("i"), html("span", { className: "what" }), html("span", { className: "when" }))),
  );
}

/** @param {any} life @param {CommandStatus} command @param {string[]} way */
function drawLife(life, command, way) {
  const reached = new Map(command.history.map((each) => [each.stage, each]));
  const last = command.history.at(-1)?.stage;
  const end = way.includes(last ?? "") ? null : command.ended || ["unknown", "given_up"].includes(command.state) ? last : null;
  way.forEach((stage, index) => {
    const [, what, when] = life.children[index].children;
    const isEnd = index === way.length - 1;
    const shown = isEnd && end ? end : stage;
    const at = reached.get(shown);
    const progress = stage === "STARTED" ? command.history.findLast((each) => each.step !== null && each.step !== undefined) : undefined;
    const steps = progress && !command.ended ? ` ${progress.step}${progress.steps ? `/${progress.steps}` : ""}` : "";
    set(life.children[index], {
      class: `step ${at ? "reached" : ""} ${shown.toLowerCase()}`,
      "data-stage": shown,
      "data-reached": String(Boolean(at)),
      title: at ? `${shown}: ${clock(at.utc, true)} by the clock of ${at.node}, heard ${clock(at.rx, true)}` : `${shown}: not yet`,
    });
    say(what, shown.toLowerCase().replace("_", " ") + steps);
    say(when, !at ? "" : index === 0 ? "" : `+${(at.rx - command.made).toFixed(2)} s`);
  });
}

/** All stages, with both times. @param {CommandStatus} command */
function stageTable(command) {
  return html(
    "table",
    { className: "stages" },
    row(["stage", "by", "its time", "heard", ""], "th"),
    ...command.history.map((each) => row([each.stage, each.node, clock(each.utc, true), clock(each.rx, true), each.detail])),
  );
}

/** What became of a command beside what was predicted of it; nothing where nothing was. @param {CommandStatus} command */
export function comparison(command) {
  const figures = command.history.at(-1)?.figures ?? {};
  const predicted = command.history.findLast((each) => each.stage === "PREDICTED")?.figures ?? {};
  const names = Object.keys(figures).filter((name) => `predicted ${name}` in figures);
  const rows = names.length
    ? names.map((name) => [name, figures[`predicted ${name}`], figures[name]])
    : Object.entries(predicted).map(([name, value]) => [name.replace(/^predicted /, ""), value, null]);
  if (!rows.length) return null;
  const words = (value) => (value === null ? "" : typeof value === "number" ? number(value) : String(value));
  return html(
    "table",
    { className: "comparison" },
    row(["", "predicted", "came to"], "th"),
    ...rows.map(([name, before, after]) =>
      html("tr", {}, html("td", { textContent: name }), html("td", { className: "figure", textContent: words(before) }), html("td", { className: "figure", textContent: words(after) })),
    ),
  );
}

/** The arguments in a few characters. @param {CommandStatus} command @param {import("../model/asset.js").Asset} asset */
function shortly(command, asset) {
  const entry = asset.entry?.commands.find((each) => each.name === command.name);
  return Object.entries(command.args ?? {})
    .map(([name, value]) => {
      if (value && typeof value === "object") return `${Object.keys(value).length} ${name}`;
      const argument = entry?.arguments.find((each) => each.name === name);
      if (typeof value !== "number") return `${name} ${value}`;
      const factor = argument?.typed?.per_unit ?? 1;
      const unit = argument?.typed ? unitOf(argument) : "";
      return `${name} ${Math.round(value * factor * 1000) / 1000}${unit}`;
    })
    .join("  ");
}
