/** The checks of the plan in preparation by the rover, and the result of the last one. */

import { PlanCheck } from "../model/plan_check.js";
import { button, html, reconcile, set, setText, tableHead } from "../dom.js";
import { View } from "./view.js";
import { duration, number } from "../format.js";

/** @import { DraftCheck } from "../model/messages.js" */
/** @import { CheckLevel } from "../model/plan_check.js" */

/** @type {Record<CheckLevel, string>} */
const LEVELS = {
  check: "let the rover search for probable faults",
  prove: "let the rover explore all outcomes of steps, conditions, questions, timers and stops",
  try: "let the rover's computer run the plan in simulation, several times",
};
const VERDICTS = { refused: "refused", faults: "probable faults", "no fault found": "no fault found", proved: "proved", tried: "tried" };

export class PlanChecks extends View {
  check = new PlanCheck(this.plan);
  #draws = html("input", { type: "number", min: "1", max: "1000", value: "30", "aria-label": "runs of try", title: "number of simulated runs" });
  #starts = Object.entries(LEVELS).map(([level, title]) => button(level, title, () => this.check.run(/** @type {CheckLevel} */ (level), level === "try" ? Number(this.#draws.value) || null : null)));
  #cancel = button("call off", "do not wait for the result", () => this.check.cancel());
  #progress = html("progress", { "aria-label": "a check runs" });
  #verdict = html("p");
  #list = html("ul");
  #figures = html("tbody");
  #table = html("table", {}, tableHead("of the runs", "5 %", "median", "95 %"), this.#figures);
  #result = html("div", { className: "preview-text check-result", role: "status", tabIndex: 0, "data-testid": "plan-checks" }, this.#verdict, this.#list, this.#table);
  root = html("div", { className: "checks" }, html("span", { className: "buttons" }, ...this.#starts, html("label", {}, this.#draws, " runs"), this.#progress, this.#cancel), this.#result);

  start() {
    return [this.check.on(this.draw), this.plan.on(this.draw), this.session.onSecond(this.draw), () => this.check.cancel()];
  }

  render() {
    const { check, plan, asset } = this;
    const { isRunning, level, result, error } = check;
    for (const each of this.#starts) each.disabled = isRunning || plan.isEmpty || !asset.isReached || !plan.isChecked;
    this.#draws.disabled = isRunning;
    this.#progress.hidden = this.#cancel.hidden = !isRunning;
    const isShown = level !== "" && (isRunning || error !== "" || !check.isOld);
    this.#result.hidden = !isShown;
    set(this.#result, { role: isRunning ? "timer" : "status" }); // a screen reader does not read each second
    this.#result.classList.toggle("refused", Boolean(error) || ["refused", "faults"].includes(result?.verdict ?? ""));
    const passed = `${level}: ${duration((Date.now() - check.began_ms) / 1000)} …`;
    setText(this.#verdict, isRunning ? passed : error ? `${level}: ${error}` : result ? `${level}: ${verdictOf(result)}` : "");
    reconcile(this.#list, isRunning || !result ? [] : linesOf(result), String, (textContent) => html("li", { textContent }));
    const figures = isRunning ? [] : (result?.trial?.figures ?? []);
    this.#table.hidden = figures.length === 0;
    const make = () => html("tr", {}, html("th"), html("td"), html("td"), html("td"));
    reconcile(this.#figures, figures, ({ name }) => name, make, (row, { name, unit, low, median, high }) => {
      [`${name}, ${unit}`, ...[low, median, high].map(number)].forEach((text, index) => setText(row.children[index], text));
    });
  }
}

/** @param {DraftCheck} result */
function verdictOf({ verdict, refusal, states, trial, limits }) {
  const explored = states === null ? "" : `${states} states`;
  const share = trial && `${trial.successes} of ${trial.draws} runs completed (share ${percent(trial.successLow)} to ${percent(trial.successHigh)} with 95 % confidence)`;
  const limited = limits.length ? `with ${limits.length} limit${limits.length > 1 ? "s" : ""}` : "";
  return [VERDICTS[verdict] ?? verdict, refusal, share, explored, limited].filter(Boolean).join(", ");
}

/** @param {number} share */
const percent = (share) => `${Math.round(share * 100)} %`;

/** The findings, limits and branches, as texts. @param {DraftCheck} result */
function linesOf({ findings, limits, trial }) {
  return [
    ...findings.map(({ level, step, line, text }) => `${level}, ${step === null ? `line ${line}` : `step ${step + 1}`}: ${text}`),
    ...limits.map((text) => `limit: ${text}`),
    ...(trial?.branches ?? []).map(({ node, line, choice, draws }) => `branch, line ${line}: ${node} ${choice}: ${draws} of ${trial.draws} runs`),
    ...(trial?.worst ? [`worst run: ${trial.worst}`] : []),
  ];
}
