/** The fork of a recording: a change, its outcome beside the recorded one, and the first different decision. */

import { fetchJson } from "../model/connection.js";
import { button, html, reconcile, set, setText, tableHead } from "../dom.js";
import { View } from "./view.js";

/** Times in s since the start of the recording. @typedef {{command: string, name: string, stage: string, reason: string, text: string, end_s: number}} Outcome */
/** @typedef {{time_s: number, recorded: string, forked: string, recorded_why: string, forked_why: string}} Difference */
/** @typedef {{commands: Outcome[], first_difference: Difference | null, lacks: string[], track: {x_m: number, y_m: number}[]}} Fork */
/** @typedef {{recorded: Fork, unchanged: Fork, fidelity: string, forks: Fork[]}} WhatIf the JSON of `rover whatif` */

/** Options of `rover whatif`: label, example, and explanation. @type {Record<string, [string, string, string]>} */
const CHANGES = {
  set: ["setting", "drive.travel_speed=0.6", "a key of the rover's settings; it holds from the start of the recording"],
  command: ["command at this time", "moveTo 3 2 --replace", "sent at the time of the slider, typed as for rover command"],
  drop: ["drop a command", "MOE:2", "a command that is not sent"],
  without: ["without a fault", "left_wheels_stuck", "a simulated fault that is not injected"],
  controller: ["controller", "mpc", "drives all motions to targets: turn_drive, mpc or navigation"],
  world: ["world", "scans", "a world of the simulation; scans: the obstacles that were measured"],
};

export class ForkPanel extends View {
  /** @type {AbortController | null} ends the running fork */
  #running = null;
  #error = "";
  /** @type {WhatIf | null} */
  #answer = null;
  #inputs = Object.values(CHANGES).map(([label, example, title]) => html("input", { type: "text", "aria-label": label, placeholder: `${label}: ${example}`, title }));
  #start = button("fork here", "simulate the run again with this change", () => this.#fork());
  #text = html("p");
  #rows = html("tbody");
  #table = html("table", {}, tableHead("command", "recorded", "with the change"), this.#rows);
  #result = html("div", { className: "fork-result", role: "status", tabIndex: 0, "data-testid": "fork" }, this.#text, this.#table);
  root = html("div", { className: "fork" }, html("div", { className: "buttons" }, ...this.#inputs, this.#start), this.#result);

  start() {
    return [() => this.selection.setFork([]), () => this.#running?.abort()];
  }

  async #fork() {
    const { start, end } = this.asset.recording;
    const changes = Object.keys(CHANGES).map((option, index) => [option, [this.#inputs[index].value.trim()].filter(Boolean)]);
    const json = { at: (this.cursor.utc_s ?? end) - start, ...Object.fromEntries(changes) };
    this.#running = new AbortController();
    this.draw();
    try {
      this.#answer = await fetchJson(`/api/recordings/${encodeURIComponent(this.asset.name)}/fork`, { json, signal: this.#running.signal });
      this.#error = "";
    } catch (error) {
      [this.#answer, this.#error] = [null, error.message];
    }
    this.#running = null;
    this.selection.setFork((this.#answer?.forks[0]?.track ?? []).map(({ x_m: x, y_m: y }) => ({ x, y })));
    this.draw();
  }

  render() {
    const isRunning = this.#running !== null;
    this.#start.disabled = isRunning;
    const fork = isRunning ? undefined : this.#answer?.forks[0];
    this.#result.hidden = !isRunning && !this.#error && !this.#answer;
    this.#result.classList.toggle("refused", Boolean(this.#error));
    set(this.#result, { "aria-busy": isRunning, "data-fidelity": this.#answer?.fidelity ?? "" });
    setText(this.#text, isRunning ? "The run is simulated, first without the change …" : this.#error || textOf(this.#answer));
    this.#table.hidden = fork === undefined;
    const recorded = new Map(this.#answer?.recorded.commands.map((each) => [each.command, each]));
    const make = () => html("tr", {}, html("th"), html("td"), html("td"));
    reconcile(this.#rows, fork?.commands ?? [], ({ command }) => command, make, (row, forked) => {
      const before = recorded.get(forked.command);
      const isOther = before?.stage !== forked.stage || before.reason !== forked.reason;
      set(row, { "data-command": forked.command, class: isOther ? "other" : "" });
      [`${forked.command} ${forked.name}`, before ? endOf(before) : "not sent", endOf(forked)].forEach((text, index) => setText(row.children[index], text));
      set(row.children[2], { title: forked.text });
    });
  }
}

/** @param {Outcome} outcome */
const endOf = ({ stage, reason, end_s }) => [stage, reason, `${end_s.toFixed(2)} s`].filter(Boolean).join(" ");

/** @param {WhatIf | null} answer */
function textOf(answer) {
  if (answer === null) return "";
  const isCompared = answer.fidelity !== "NOT_COMPARED";
  const missing = answer.unchanged.lacks.length ? ` The recording lacks: ${answer.unchanged.lacks.join(", ")}.` : "";
  const lacks = `${missing}${isCompared ? "" : " Not compared without a change: the fork begins at the end of the recording."}`;
  if (answer.forks.length === 0) return `Without a change the simulation does not reproduce the recording: no answer.${lacks}`;
  const difference = answer.forks[0].first_difference;
  if (difference === null) return `Nothing differs.${lacks}`;
  const { time_s, recorded, forked, recorded_why, forked_why } = difference;
  return `First difference after ${time_s.toFixed(2)} s: ${forked}, recorded: ${recorded}. ${forked_why}; recorded: ${recorded_why}.${lacks}`;
}
