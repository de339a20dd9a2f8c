/** The fork of a recording: a change, its outcome beside the recorded one, and the first different decision. */

import { fetchJson } from "../model/connection.js";
import { button, html, reconcile, set, setText, tableHead } from "../dom.js";
import { View } from "./view.js";

/** Times in s since the start of the recording. @typedef {{command: string, name: string, stage: string, reason: string, text: string, end_s: number}} Outcome */
/** @typedef {{time_s: number, recorded: string, forked: string, recorded_why: string, forked_why: string}} Difference */
/** @typedef {{commands: Outcome[], first_difference: Difference | null, lacks: string[], track: {x_m: number, y_m: number}[]}} Fork */
/** @typedef {{recorded: Fork, unchanged: Fork, fidelity: string, forks: Fork[]}} WhatIf the JSON of `rover whatif` */

const CONTROLLERS = { "": "controller as recorded", turn_drive: "turn_drive", mpc: "mpc", navigation: "navigation" };

export class ForkPanel extends View {
  #isRunning = false;
  #error = "";
  /** @type {WhatIf | null} */
  #answer = null;
  #setting = html("input", { type: "text", "aria-label": "setting", placeholder: "setting: drive.travel_speed=0.6", title: "a key of the rover's settings; it holds from the start of the recording" });
  #command = html("input", { type: "text", "aria-label": "command at this time", placeholder: "command: moveTo 3 2 --replace", title: "sent at the time of the slider, typed as for rover command" });
  #controller = html("select", { "aria-label": "controller" }, ...Object.entries(CONTROLLERS).map(([value, textContent]) => html("option", { value, textContent })));
  #start = button("fork here", "simulate the run again with this change", () => this.#fork());
  #text = html("p");
  #rows = html("tbody");
  #table = html("table", {}, tableHead("command", "recorded", "with the change"), this.#rows);
  #result = html("div", { className: "fork-result", role: "status", tabIndex: 0, "data-testid": "fork" }, this.#text, this.#table);
  root = html("div", { className: "fork" }, html("div", { className: "buttons" }, this.#setting, this.#command, this.#controller, this.#start), this.#result);

  start() {
    return [() => this.selection.setFork([])];
  }

  async #fork() {
    const { start, end } = this.asset.recording;
    const texts = (input) => [input.value.trim()].filter(Boolean);
    const json = { at: (this.cursor.utc_s ?? end) - start, set: texts(this.#setting), command: texts(this.#command), controller: this.#controller.value || null };
    this.#isRunning = true;
    this.draw();
    try {
      this.#answer = await fetchJson(`/api/recordings/${encodeURIComponent(this.asset.name)}/fork`, { json });
      this.#error = "";
    } catch (error) {
      [this.#answer, this.#error] = [null, error.message];
    }
    this.#isRunning = false;
    this.selection.setFork((this.#answer?.forks[0]?.track ?? []).map(({ x_m: x, y_m: y }) => ({ x, y })));
    this.draw();
  }

  render() {
    this.#start.disabled = this.#isRunning;
    const fork = this.#isRunning ? undefined : this.#answer?.forks[0];
    this.#result.hidden = !this.#isRunning && !this.#error && !this.#answer;
    this.#result.classList.toggle("refused", Boolean(this.#error));
    set(this.#result, { "aria-busy": this.#isRunning, "data-fidelity": this.#answer?.fidelity ?? "" });
    setText(this.#text, this.#isRunning ? "The run is simulated, first without the change …" : this.#error || textOf(this.#answer));
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
  const lacks = answer.unchanged.lacks.length ? ` The recording lacks: ${answer.unchanged.lacks.join(", ")}.` : "";
  if (answer.forks.length === 0) return `Without a change the simulation does not reproduce the recording: no answer.${lacks}`;
  const difference = answer.forks[0].first_difference;
  if (difference === null) return `Nothing differs.${lacks}`;
  const { time_s, recorded, forked, recorded_why, forked_why } = difference;
  return `First difference after ${time_s.toFixed(2)} s: ${forked}, recorded: ${recorded}. ${forked_why}; recorded: ${recorded_why}.${lacks}`;
}
