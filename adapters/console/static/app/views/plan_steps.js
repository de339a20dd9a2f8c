/** The steps of a plan in preparation: a list; its rows are dragged, moved by buttons, edited and removed. */

import { argumentSummary } from "./command_table.js";
import { fieldsOf } from "./forms.js";
import { View } from "./view.js";
import { button, html, reconcile, setText, set } from "../dom.js";
import { duration } from "../format.js";

/** @import { PlanStep } from "../model/plan_draft.js" */

/** Commands with a button of their own; all others are in a list. */
const FREQUENT = ["takePicture", "setCameraAngles"];
const MARKS = { done: "✓", failed: "✗", active: "▶", held: "‖" };

export class PlanSteps extends View {
  /** @type {PlanStep | null} the step that is being dragged */
  #dragged = null;
  /** @type {WeakMap<Element, StepRow>} */
  #rows = new WeakMap();
  /** @type {(index: number) => string} the state of a step aboard: done, failed, active, held or empty */
  stateOf = () => "";
  /** @type {(index: number) => string[]} the findings of a check at a step */
  findingsAt = () => [];
  /** @type {((step: PlanStep) => void) | null} resumes the plan at a step; null unless it is suspended */
  resumeAt = null;

  #list = html("ol", { className: "steps", "aria-label": "steps" });
  #empty = html("p", { className: "empty", textContent: "No step yet. Click the map for a move, or add a command." });
  #frequent = html("span", { className: "buttons" });
  #others = html("select", { "aria-label": "add a step", onchange: () => this.#add(this.#others.value) });
  #nodes = html("select", { "aria-label": "add a wait, question or condition", onchange: () => this.#add(this.#nodes.value) });
  /** the buttons that add steps */
  adders = html("div", { className: "buttons adders" }, this.#frequent, this.#others, this.#nodes);
  root = html("div", {}, this.#list, this.#empty);

  start() {
    return [this.plan.on(this.draw), this.asset.on("entry", this.draw)];
  }

  /** @param {string} operation */
  #add(operation) {
    this.plan.add(operation);
    this.#others.value = this.#nodes.value = "";
  }

  render() {
    const { plan } = this;
    this.#empty.hidden = plan.steps.length > 0 || plan.isTyped;
    const names = plan.offered.map((each) => each.name);
    const make = (name) => button(`+ ${name}`, `add ${name} after the selected step`, () => this.#add(name));
    reconcile(this.#frequent, FREQUENT.filter((each) => names.includes(each)), String, make);
    const makeOption = (label) => (value) => html("option", { value, textContent: value || label });
    reconcile(this.#others, ["", ...names.filter((each) => !FREQUENT.includes(each))], String, makeOption("+ other …"));
    reconcile(this.#nodes, ["", ...plan.nodes.map((each) => each.name)], String, makeOption("+ wait, question, condition …"));
    for (const option of this.#nodes.options) option.title = plan.nodes.find((each) => each.name === option.value)?.summary ?? "";
    this.#list.classList.toggle("old", !plan.isChecked);
    reconcile(this.#list, plan.steps, (each) => each.key, (step) => this.#makeRow(step), (element) => this.#rows.get(element).render());
  }

  /** @param {PlanStep} step */
  #makeRow(step) {
    const row = new StepRow(this, step);
    const { element, handle } = row;
    handle.ondragstart = ({ dataTransfer }) => {
      this.#dragged = step;
      dataTransfer.setData("text/plain", step.draft.entry.name);
      dataTransfer.setDragImage(element, 8, 8);
    };
    handle.ondragend = () => this.#markTarget(null);
    element.ondragover = (event) => {
      if (!this.#dragged) return;
      event.preventDefault();
      this.#markTarget(element);
    };
    element.ondrop = (event) => {
      event.preventDefault();
      if (this.#dragged) this.plan.move(this.#dragged, this.plan.steps.indexOf(step));
      this.#markTarget(null);
    };
    this.#rows.set(element, row);
    return element;
  }

  /** Mark the row that a drop replaces by the dragged step; null at the end of dragging. @param {Element | null} target */
  #markTarget(target) {
    for (const each of this.#list.children) each.classList.toggle("target", each === target);
    if (target === null) this.#dragged = null;
  }
}

/** One step: its number, command, arguments and figures; its fields if it is selected. */
class StepRow {
  #list;
  #step;
  /** @type {Record<string, any> | null} the typed arguments of the present fields */
  #typed = null;
  /** @type {ReturnType<typeof fieldsOf>} */
  #fields = [];
  handle = html("span", { className: "handle", draggable: true, textContent: "⠿", title: "drag to another row", "aria-hidden": "true" });
  #number = html("b");
  #title = html("span", { className: "what" });
  #arguments = html("span", { className: "arguments dim" });
  #choose = html("button", { type: "button", className: "choose", onclick: () => this.#toggle() }, this.#number, this.#title, this.#arguments);
  #figures = html("span", { className: "figures dim" });
  #resume = button("resume here", "resume the plan at this step", () => this.#list.resumeAt?.(this.#step));
  #up = button("▲", "", () => this.#move(-1));
  #down = button("▼", "", () => this.#move(1));
  #remove = button("×", "", () => this.#list.plan.remove(this.#step));
  #problem = html("p", { className: "problem" });
  #findings = html("p", { className: "finding" });
  #fieldBox = html("div", { className: "fields" });
  element = html(
    "li",
    { className: "step" },
    html("div", { className: "head" }, this.handle, this.#choose, this.#figures, this.#resume, this.#up, this.#down, this.#remove),
    this.#problem,
    this.#findings,
    this.#fieldBox,
  );

  /** @param {PlanSteps} list @param {PlanStep} step */
  constructor(list, step) {
    this.#list = list;
    this.#step = step;
  }

  #toggle() {
    const { plan } = this.#list;
    plan.select(plan.selected === this.#step ? null : this.#step);
  }

  /** @param {number} by */
  #move(by) {
    const { plan } = this.#list;
    plan.move(this.#step, plan.steps.indexOf(this.#step) + by);
  }

  render() {
    const { plan, asset, resumeAt } = this.#list;
    const { draft, name, preview, objection } = this.#step;
    const index = plan.steps.indexOf(this.#step);
    const isSelected = plan.selected === this.#step;
    const state = this.#list.stateOf(index);
    this.element.classList.toggle("selected", isSelected);
    this.element.classList.toggle("refused", objection !== "");
    set(this.element, { "data-state": state });
    setText(this.#number, MARKS[state] ?? String(index + 1));
    setText(this.#title, name || draft.entry.name);
    const given = (asset.entry?.conditions ?? []).filter((each) => this.#step.conditions[each.name]);
    const guards = given.map((each) => `${labelOf(each.name)} ${this.#step.conditions[each.name]}`);
    setText(this.#arguments, [name && draft.entry.name, argumentSummary({ name: draft.entry.name, args: draft.values }, asset), ...guards].filter(Boolean).join("  "));
    setText(this.#figures, preview && !objection ? figuresOf(preview) : "");
    setText(this.#problem, objection);
    setText(this.#findings, this.#list.findingsAt(index).join("\n"));
    set(this.#choose, { "aria-expanded": isSelected });
    for (const [each, act] of /** @type {const} */ ([[this.#up, "move up"], [this.#down, "move down"], [this.#remove, "remove"]])) set(each, { "aria-label": `${act} step ${index + 1}`, title: act });
    this.#up.disabled = index === 0;
    this.#down.disabled = index === plan.steps.length - 1;
    this.#resume.hidden = !resumeAt || ["done", "failed"].includes(state);
    if (!isSelected) this.#clearFields();
    else if (this.#typed !== draft.typed) this.#makeFields();
    for (const field of this.#fields) field.render(draft.problems);
  }

  #clearFields() {
    this.#typed = null;
    this.#fields = [];
    this.#fieldBox.replaceChildren();
  }

  #makeFields() {
    const { draft, name, deadline } = this.#step;
    this.#typed = draft.typed;
    this.#fields = fieldsOf(draft);
    const { plan, asset } = this.#list;
    const describe = (field) => (text) => plan.describe(this.#step, field, text);
    const conditions = (asset.entry?.conditions ?? []).map(({ name: each, choices, help }) =>
      fieldOf(labelOf(each), this.#step.conditions[each] ?? "", "", help, (text) => plan.guard(this.#step, each, text), choices),
    );
    const isGuarded = Object.values(this.#step.conditions).some(Boolean);
    this.#fieldBox.replaceChildren(
      html("p", { className: "help dim", textContent: draft.entry.summary }),
      ...this.#fields.map((each) => each.element),
      this.#step.isCommand ? fieldOf("deadline", deadline, "s", "the step fails when it takes longer", describe("deadline")) : "",
      fieldOf("name", name, "", "in reports and on the map", describe("name")),
      html("details", { className: "conditions", open: isGuarded }, html("summary", { textContent: "conditions and scripts" }), ...conditions),
    );
  }
}

/** Return the label of a condition: "skip if" of _skipIf. @param {string} attribute */
const labelOf = (attribute) => (attribute === "if" ? "only if" : attribute.replace(/^_/, "").replace(/[A-Z]/g, (letter) => ` ${letter.toLowerCase()}`));

/** Create a field of the step itself. @param {string} field @param {string} value @param {string} unit @param {string} help @param {(text: string) => void} typed @param {string[] | null} [choices] */
function fieldOf(field, value, unit, help, typed, choices = null) {
  const common = { "aria-label": `step ${field}`, value };
  const input = choices
    ? html("select", { ...common, onchange: () => typed(input.value) }, ...["", ...choices].map((each) => html("option", { value: each, textContent: each || "default", selected: each === value })))
    : html("input", { ...common, type: "text", inputMode: unit ? "decimal" : "text", placeholder: unit && "default", oninput: () => typed(input.value.trim()) });
  const texts = [html("span", { className: "unit", textContent: unit }), html("span", { className: "help dim", textContent: help })];
  return html("label", { className: "field" }, html("span", { className: "name", textContent: field }), input, ...texts);
}

/** Format time, length and clearance of a step's preview. */
function figuresOf({ duration: time_s, length: length_m, clearance: clearance_m }) {
  const parts = [time_s && duration(time_s), length_m && `${length_m.toFixed(1)} m`, clearance_m != null && `clearance ${clearance_m.toFixed(2)} m`];
  return parts.filter(Boolean).join(", ");
}
