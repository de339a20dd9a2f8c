/**
 * A plan in preparation for one asset: its steps, each a draft of a command, or its XML as typed, and the
 * result of its check and preview. The map adds and moves its steps as it does with a `Draft`.
 */

import { fetchJson } from "./connection.js";
import { Draft } from "./draft.js";
import { Observable } from "./observable.js";

/** @import { OutlineNode, Preview } from "./messages.js" */
/** @typedef {{name?: string, operation: string, args: Record<string, any>, deadline?: number | null, conditions?: Record<string, string>}} StepContent `args` in SI units, `deadline` in s */
/** @typedef {{name: string, steps: StepContent[], xml: string | null}} PlanContent `xml`: as typed; null if the steps are the plan */
/** @typedef {{step: PlanStep, item: number, x: number, y: number, label: string, isSelected: boolean, isRefused: boolean}} Mark waypoint of a step */

const DEBOUNCE_MS = 300;
const MAX_UNDO = 100;
/** Families of commands that no plan may give. */
const STEERING = ["plan", "plan: activate, resume", "stop", "resume", "pose confirmation"];

/** A step: a command, wait, question or condition, the name of its node, its deadline and its own conditions. */
export class PlanStep {
  static #count = 0;
  key = String(PlanStep.#count++);
  /** path of its leaf, as in the progress of the plan */
  node = "";
  /** why it would be refused */
  problem = "";
  /** @type {any} its preview; null without one */
  preview = null;

  /** @param {Draft} draft @param {string} name @param {string} deadline as typed, s @param {Record<string, string>} conditions by attribute */
  constructor(draft, name, deadline, conditions) {
    this.draft = draft;
    this.name = name;
    this.deadline = deadline;
    this.conditions = conditions;
  }

  /** Whether it is a command, which has a deadline of its own. */
  get isCommand() {
    return this.draft.entry.service !== "";
  }

  /** The missing or wrong fields. */
  get incomplete() {
    const { problems } = this.draft;
    const [[field, problem] = []] = problems;
    if (problem === "needed") return `fill in ${[...problems.keys()].join(", ")}`;
    if (problem) return `${field} ${problem}`.trim();
    return this.deadline && !(Number(this.deadline) > 0) ? "deadline: seconds are needed" : "";
  }

  /** The missing or wrong fields, or why it would be refused. */
  get objection() {
    return this.incomplete || this.problem;
  }

  /** @returns {StepContent} */
  get content() {
    const deadline = Number(this.deadline) || null;
    const conditions = Object.fromEntries(Object.entries(this.conditions).filter(([, text]) => text));
    const more = { ...(deadline && { deadline }), ...(Object.keys(conditions).length && { conditions }) };
    return { ...(this.name && { name: this.name }), operation: this.draft.entry.name, args: this.draft.values, ...more };
  }
}

export class PlanDraft extends Observable {
  #timer = 0;
  #edits = 0;
  #isRestored = false;
  /** @type {string[]} earlier contents */
  #history = [];
  #stored = "";
  name = "";
  /** @type {PlanStep[]} */
  steps = [];
  /** @type {PlanStep | null} new steps follow it; null: the last one */
  selected = null;
  /** the XML: as typed, or as made of the steps */
  xml = "";
  /** whether the XML was edited last; the steps are then those that were found in it */
  isTyped = false;
  /** why it would be refused or fail */
  problem = "";
  /** why its XML is no list of steps */
  notSteps = "";
  /** @type {OutlineNode[]} its nodes, if it is no list of steps */
  outline = [];
  /** @type {Preview | null} of the whole plan */
  preview = null;
  /** why there is no preview */
  notPreviewed = "";
  /** whether a check is pending */
  waits = false;
  /** whether the results are those of the present plan */
  isChecked = false;

  /** @param {import("./asset.js").Asset} asset */
  constructor(asset) {
    super();
    this.asset = asset;
  }

  /** The commands that can be steps. */
  get offered() {
    return (this.asset.entry?.commands ?? []).filter((each) => !STEERING.includes(each.family));
  }

  /** @returns {PlanContent} */
  get content() {
    return { name: this.name, steps: this.steps.map((each) => each.content), xml: this.isTyped ? this.xml : null };
  }

  get isEmpty() {
    return this.isTyped ? !this.xml.trim() : this.steps.length === 0;
  }

  /** The waits, questions, conditions and scripts that can be steps. */
  get nodes() {
    return this.asset.entry?.nodes ?? [];
  }

  /** Whether it has no steps to edit: its XML is invalid, not checked yet, or no list of steps. */
  get isXmlOnly() {
    return this.isTyped && !this.isEmpty && this.steps.length === 0;
  }

  /** Replace the plan. @param {Partial<PlanContent>} content */
  load({ name = "", steps = [], xml = null }) {
    this.name = name;
    this.isTyped = xml !== null;
    this.xml = (xml ?? "").replace(/\r\n?/g, "\n"); // as a text area has it
    this.steps = steps.map((each) => this.#make(each)).filter(Boolean);
    this.selected = null;
    this.#edited();
  }

  get canUndo() {
    return this.#history.length > 0;
  }

  /** Return to the plan before the last change. */
  undo() {
    const before = this.#history.pop();
    if (!before) return;
    this.#stored = "";
    this.load(JSON.parse(before));
  }

  /** @param {string} name */
  rename(name) {
    this.name = name;
    this.#edited();
  }

  /** @param {string} xml */
  typeXml(xml) {
    this.load({ name: this.name, xml });
  }

  /** Add a step after the selected one, and select it. @param {string} operation @param {Record<string, any>} [args] in SI units */
  add(operation, args = {}) {
    const step = this.#make({ operation, args });
    if (!step) return;
    if (!this.name) this.name = this.#freeName();
    this.steps.splice(this.selected ? this.steps.indexOf(this.selected) + 1 : this.steps.length, 0, step);
    this.selected = step;
    this.#editedSteps();
  }

  #freeName() {
    let number = 1;
    while (this.asset.plansAboard.has(`plan-${number}`)) number++;
    return `plan-${number}`;
  }

  /** @param {PlanStep} step @param {number} index its new one */
  move(step, index) {
    this.steps.splice(this.steps.indexOf(step), 1);
    this.steps.splice(index, 0, step);
    this.#editedSteps();
  }

  /** @param {PlanStep} step */
  remove(step) {
    const index = this.steps.indexOf(step);
    this.steps.splice(index, 1);
    if (this.selected === step) this.selected = this.steps[index - 1] ?? null;
    this.#editedSteps();
  }

  /** @param {PlanStep} step @param {"name" | "deadline"} field @param {string} text */
  describe(step, field, text) {
    step[field] = text;
    this.#editedSteps();
  }

  /** @param {PlanStep} step @param {string} condition @param {string} text */
  guard(step, condition, text) {
    step.conditions[condition] = text;
    this.#editedSteps();
  }

  /** @param {PlanStep | null} step */
  select(step) {
    this.selected = step;
    this.changed();
  }

  /** Entry of the command that a click on the map continues: a selected path. */
  get entry() {
    const entry = this.selected?.draft.entry;
    return entry?.arguments.some((each) => each.type === "list") ? entry : null;
  }

  get values() {
    return this.selected?.draft.values ?? {};
  }

  /** Effect of a click on the map. */
  get hint() {
    if (this.isXmlOnly) return "This plan is edited as XML.";
    return this.entry ? "Click the map to add a waypoint." : "Click the map to add a move; drag a waypoint to move it.";
  }

  /** Add a step; called by the map. @param {string} operation @param {Record<string, any>} [args] */
  prepare(operation, args) {
    if (!this.isXmlOnly) this.add(operation, args);
  }

  /** Add a waypoint to the selected path; called by the map. @param {string} list @param {Record<string, any>} item */
  addItem(list, item) {
    this.selected.draft.addItem(list, item);
  }

  /** @returns {Mark[]} the waypoints of the steps in the odometry frame */
  get marks() {
    return this.steps.flatMap((step, index) => {
      const { waypoints } = step.draft;
      const label = (item) => (waypoints.length > 1 ? `${index + 1}.${item + 1}` : String(index + 1));
      return waypoints.map((each) => ({ ...each, step, label: label(each.item), isSelected: step === this.selected, isRefused: step.problem !== "" }));
    });
  }

  /** Move a waypoint. @param {Mark} mark @param {number} x @param {number} y in the odometry frame */
  moveMark({ step: { draft }, item }, x, y) {
    const { values, entry } = draft;
    const to = this.asset.inFrame({ x, y }, values.frame);
    if (!to) return;
    const { waypoints } = values;
    draft.prepare(entry.name, waypoints ? { ...values, waypoints: waypoints.with(item, { ...waypoints[item], ...to }) } : { ...values, ...to });
  }

  /** Check and preview the plan; again if the rover or its mode has changed. */
  check() {
    clearTimeout(this.#timer);
    this.#edits++;
    this.waits = !this.isEmpty && this.steps.every((each) => !each.incomplete);
    if (this.waits) this.#timer = setTimeout(() => this.#fetchCheck(this.#edits), DEBOUNCE_MS);
    else this.#receive({ xml: "" });
    this.changed();
  }

  #editedSteps() {
    this.isTyped = false;
    this.#edited();
  }

  #edited() {
    const content = JSON.stringify(this.content);
    if (this.#stored) this.#history = [...this.#history.slice(1 - MAX_UNDO), this.#stored];
    this.#stored = content;
    sessionStorage.setItem(this.#storageKey, content);
    this.isChecked = false;
    this.check();
  }

  async #fetchCheck(edit) {
    const { name, steps, xml } = this.content;
    const json = { plan: name.trim() || "plan", ...(xml === null ? { steps } : { xml }) };
    let answer;
    try {
      answer = await fetchJson(`/api/plans/${encodeURIComponent(this.asset.name)}/draft`, { json });
    } catch (error) {
      answer = { problem: { text: error.message } };
    }
    if (edit !== this.#edits) return;
    this.#receive(answer);
    Object.assign(this, { waits: false, isChecked: true });
    this.changed();
  }

  /** @param {any} answer of the server to a draft */
  #receive({ xml = "", steps = null, not_steps: notSteps = "", outline = [], problem = null, preview = null, not_previewed: notPreviewed = "" }) {
    if (!this.isTyped) this.xml = xml;
    else if (!this.steps.length) this.steps = (steps ?? []).map((each) => this.#make(each)).filter(Boolean);
    this.steps.forEach((step, index) => {
      step.node = steps?.[index]?.node ?? "";
      step.preview = preview?.steps.find(({ node }) => node === step.node) ?? null;
      step.problem = (problem?.step === index ? problem.text : step.preview?.refusal) ?? "";
    });
    this.problem = problem ? `${problem.line && this.isTyped ? `line ${problem.line}: ` : ""}${problem.text}` : (preview?.refusal ?? "");
    this.notSteps = notSteps ?? "";
    this.outline = outline;
    this.preview = preview?.total ?? null;
    this.notPreviewed = notPreviewed ?? "";
  }

  /** @param {StepContent} content @returns {PlanStep | null} */
  #make({ name = "", operation, args, deadline = null, conditions = {} }) {
    const draft = new Draft(this.asset, false);
    draft.prepare(operation, args);
    if (!draft.entry) return null;
    draft.on(() => this.#editedSteps());
    const isDefault = name.replace(/ \d+$/, "") === operation;
    return new PlanStep(draft, isDefault ? "" : name, deadline === null ? "" : String(deadline), { ...conditions });
  }

  get #storageKey() {
    return `rover-plan-${this.asset.name}`;
  }

  /** Load the plan of this page before a reload, once the commands are known. */
  restore() {
    if (this.#isRestored || !this.asset.entry) return;
    this.#isRestored = true;
    const stored = sessionStorage.getItem(this.#storageKey);
    if (stored && this.isEmpty) this.load(JSON.parse(stored));
  }
}
