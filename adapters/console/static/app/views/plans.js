/**
 * Plans: steps by clicks on the map and from the catalogue, or XML; checked and previewed as they are edited,
 * stored as drafts, submitted and commanded. Each action is a command, and appears in the
 * command table.
 */

import { fetchJson, newId } from "../model/connection.js";
import { PlanLibrary } from "../model/plan_library.js";
import { predictionText } from "./command_form.js";
import { MapView } from "./map.js";
import { PlanChecks } from "./plan_checks.js";
import { PlanNodes } from "./plan_nodes.js";
import { PlanSteps } from "./plan_steps.js";
import { button, html, reconcile, setText, set, tableHead } from "../dom.js";
import { View } from "./view.js";
import { clock } from "../format.js";

/** @import { CommandStatus, PlanProgress, PlanRevision } from "../model/messages.js" */

/** Commands for a plan, by its state. */
const ACTS = {
  SUBMITTED: ["activatePlan", "removePlan"],
  ACTIVATED: ["suspendPlan", "abortPlan"],
  EXECUTING: ["suspendPlan", "abortPlan"],
  SUSPENDED: ["resumePlan", "abortPlan"],
  COMPLETED: ["removePlan"],
  FAILED: ["removePlan"],
  ABORTED: ["removePlan"],
};
const LABELS = { activatePlan: "run", suspendPlan: "suspend", resumePlan: "resume", abortPlan: "abort", removePlan: "remove" };
const UNANSWERED = ["unknown", "lost"];

export class PlansView extends View {
  #library = new PlanLibrary(this.asset.name);
  /** @type {Map<number, string>} XML of submitted revisions; empty until received */
  #received = new Map();
  /** whether the XML is shown instead of the steps */
  #showsXml = false;
  /** id of the command that this page sent last */
  #sent = "";
  /** refusal, the reason why it may not have been sent, or the result of storing a plan */
  #message = "";

  #name = html("input", { type: "text", "aria-label": "name of the plan", placeholder: "name", maxLength: 64, oninput: () => this.plan.rename(this.#name.value.trim()) });
  #open = html("select", { "aria-label": "open a plan", onchange: () => this.#read(this.#open.value) });
  #file = html("input", { type: "file", accept: ".xml", hidden: true, "aria-label": "file of a plan", onchange: () => this.#readFile(this.#file.files[0]) });
  #save = button("save draft", "store the plan for all consoles, to continue later or to begin others with", () => this.#attempt(() => this.#library.save(this.plan.content), `draft ${this.plan.name} is stored for all consoles`));
  #delete = button("delete draft", "", () => this.#attempt(() => this.#library.remove(this.plan.name), "deleted"));
  #undo = button("undo", "return to the plan before the last change", () => this.plan.undo());
  #asSteps = button("steps", "edit the plan as a list", () => this.#show(false));
  #asXml = button("XML", "edit the plan as XML", () => this.#show(true));
  #mapBox = html("div", { className: "map-box" });
  #steps = new PlanSteps(this);
  #nodes = new PlanNodes(this);
  #checks = new PlanChecks(this);
  /** plan aboard with its nodes shown instead of the plan in preparation */
  #shownAboard = "";
  #aboard = button("", "return to the plan in preparation", () => this.#showAboard(""));
  #xml = html("textarea", { "aria-label": "plan", spellcheck: false, placeholder: "XML of a plan", oninput: () => this.#typeXml() });
  #notSteps = html("p", { className: "empty" });
  #check = html("div", { className: "preview-text", role: "status", "data-testid": "plan-check" });
  #submit = button("", "", () => this.#onSubmit(), { className: "send" });
  #acts = html("span", { className: "buttons" });
  #hindrance = html("span", { className: "hindrance" });
  #outcome = html("div", { className: "outcome", role: "status", "data-testid": "plan-outcome" });
  #rows = html("tbody");
  #table = html("table", {}, tableHead("plan aboard", "state", "progress", "commands"), this.#rows);
  root = html(
    "section",
    { className: "rover-view plans-view" },
    html(
      "header",
      {},
      this.#name,
      this.#open,
      button("file …", "open a plan from a file", () => this.#file.click()),
      this.#file,
      button("new", "begin an empty plan", () => this.plan.load({})),
      this.#save,
      this.#delete,
      html("span", { className: "tools" }, this.#undo, this.#asSteps, this.#asXml),
    ),
    html(
      "div",
      { className: "columns" },
      html("div", { className: "column" }, this.#mapBox, html("div", { className: "scroll aboard", tabIndex: 0 }, this.#table)),
      html(
        "div",
        { className: "column side" },
        html("div", { className: "scroll", tabIndex: 0 }, this.#aboard, this.#steps.root, this.#notSteps, this.#nodes.root, this.#xml),
        this.#steps.adders,
        this.#check,
        this.#checks.root,
        html("div", { className: "buttons" }, this.#submit, this.#acts, this.#hindrance),
        this.#outcome,
      ),
    ),
  );

  start() {
    const { asset, session, plan, draw } = this;
    let mode = asset.mode;
    plan.restore();
    if (!plan.isEmpty) plan.check();
    this.#library.refresh();
    this.#steps.stateOf = (index) => this.#stateOf(index);
    this.#nodes.onRead = draw;
    this.#steps.findingsAt = (index) => this.#checks.check.atStep(index);
    this.#nodes.findingsAt = (line) => (this.#shownAboard ? [] : this.#checks.check.atLine(line));
    this.#nodes.steer = (act, args) => this.#send("/api/commands", { asset: asset.name, name: act, args });
    const onMode = () => {
      if (mode === asset.mode) return;
      mode = asset.mode;
      if (mode === "IDLE" && !plan.isEmpty) plan.check();
    };
    return [
      MapView.mount(this.#mapBox, /** @type {any} */ ({ ...this, draft: plan })),
      ...this.#steps.start(),
      ...this.#nodes.start(),
      ...this.#checks.start(),
      this.#checks.check.on(draw),
      plan.on(draw),
      this.#library.on(draw),
      ...["plans", "links", "commands"].map((topic) => asset.on(topic, draw)),
      asset.on("entry", () => plan.restore()),
      ...["status", "tree"].map((topic) => asset.on(topic, onMode)),
      session.on("object", () => this.#library.refresh()),
    ];
  }

  #typeXml() {
    this.#showsXml = true;
    this.plan.typeXml(this.#xml.value);
  }

  /** @param {string} plan empty for the plan in preparation */
  #showAboard(plan) {
    this.#shownAboard = plan;
    this.draw();
  }

  /** @param {boolean} showsXml */
  #show(showsXml) {
    this.#shownAboard = "";
    this.#showsXml = showsXml;
    this.draw();
  }

  /** @param {string} index of an entry of the library */
  #read(index) {
    this.#open.value = "";
    this.#load(this.#library.entries[Number(index)].read);
  }

  /** @param {import("../model/plan_library.js").LibraryEntry["read"]} read */
  #load(read) {
    this.#shownAboard = "";
    return this.#attempt(async () => this.plan.load(await read()));
  }

  /** @param {File | undefined} chosen */
  async #readFile(chosen) {
    if (!chosen) return;
    const octets = await chosen.arrayBuffer();
    this.#file.value = "";
    const known = /^<\?xml[^>]*encoding=["'](iso-8859-(?:[1-9]|1[0134-6])|windows-125\d)["']/i;
    const declared = known.exec(new TextDecoder("ascii").decode(octets));
    this.plan.load({ name: chosen.name.replace(/\.xml$/i, ""), xml: new TextDecoder(declared ? declared[1] : "utf-8").decode(octets) });
  }

  /** @param {() => Promise<void>} act @param {string} [done] message after it */
  async #attempt(act, done = "") {
    this.#sent = "";
    this.#message = await act().then(() => done, (error) => error.message);
    this.draw();
  }

  /** Submit the plan; remove a former one of this name first. */
  async #onSubmit() {
    const { name, xml } = this.plan;
    if (this.asset.plansAboard.has(name) && (await this.#act("removePlan", name))?.state !== "executed") return;
    await this.#send(`${this.#library.path}`, { plan_id: name, content: xml });
    this.#library.refresh();
  }

  /** @param {string} act name of a command @param {string} plan @param {object} [more] arguments */
  #act(act, plan, more = {}) {
    return this.#send("/api/commands", { asset: this.asset.name, name: act, args: { plan_id: plan, ...more } });
  }

  /** Send a command and wait for its end. @param {string} path @param {object} json @returns {Promise<CommandStatus | null>} null if it was not sent */
  async #send(path, json) {
    const id = newId();
    this.#sent = id;
    this.#message = "";
    this.draw();
    try {
      await fetchJson(path, { json: { id, ...json } });
    } catch (error) {
      this.#message = error.message;
      this.draw();
      return null;
    }
    return this.#endOf(id);
  }

  /** @param {string} id of a command @returns {Promise<CommandStatus>} */
  #endOf(id) {
    return new Promise((resolve) => {
      const check = () => {
        const command = this.asset.commands.get(id);
        if (!command?.ended && !UNANSWERED.includes(command?.state)) return;
        off();
        resolve(command);
      };
      const off = this.asset.on("commands", check);
      check();
    });
  }

  get #progress() {
    return this.asset.plansAboard.get(this.plan.name);
  }

  /** The last revision of the plan's name that was submitted at the console. */
  get #revision() {
    return this.#library.submitted.find((each) => each.plan === this.plan.name);
  }

  /** The XML of that revision; empty until received. */
  get #sentXml() {
    const revision = this.#revision?.revision;
    if (revision === undefined) return "";
    if (!this.#received.has(revision)) {
      this.#received.set(revision, "");
      this.#library.readRevision(revision).then(({ xml }) => (this.#received.set(revision, xml), this.draw()), () => this.#received.delete(revision));
    }
    return this.#received.get(revision);
  }

  /** Progress of the plan, if it is the one of its name aboard; undefined if it was changed since. */
  get #ownProgress() {
    return this.plan.isChecked && this.#sentXml === this.plan.xml ? this.#progress : undefined;
  }

  /** The state aboard of a step. @param {number} index */
  #stateOf(index) {
    const { done = null, status = "" } = this.#ownProgress ?? {};
    const { steps } = this.plan;
    const before = steps.slice(0, index).filter((each) => each.isCommand).length; // only commands are counted
    const node = this.#nodes.nodeAt(steps[index].node);
    if (node?.status === "running") return status === "SUSPENDED" ? "held" : "active";
    if (node) return { success: "done", failure: "failed" }[node.result] ?? "";
    if (done === null || before + Number(!steps[index].isCommand) > done) return "";
    return before < done || !steps[index].isCommand ? "done" : { EXECUTING: "active", SUSPENDED: "held" }[status] ?? "";
  }

  render() {
    const { asset, plan } = this;
    const progress = this.#progress;
    if (this.#name.value.trim() !== plan.name) this.#name.value = plan.name;
    this.#drawLibrary();
    const aboard = asset.plansAboard.has(this.#shownAboard) ? this.#shownAboard : "";
    const showsOutline = !this.#showsXml && plan.outline.length > 0;
    const showsXml = !showsOutline && (this.#showsXml || plan.isXmlOnly);
    for (const [each, isOn] of /** @type {const} */ ([[this.#asSteps, !showsXml], [this.#asXml, showsXml]])) {
      each.classList.toggle("on", isOn);
      set(each, { "aria-pressed": isOn });
    }
    this.#asSteps.disabled = plan.isXmlOnly && !plan.outline.length;
    setText(this.#asSteps, plan.outline.length ? "outline" : "steps");
    this.#undo.disabled = !plan.canUndo;
    this.#steps.resumeAt = this.#ownProgress?.status === "SUSPENDED" ? (step) => this.#act("resumePlan", plan.name, { step: step.node }) : null;
    this.#steps.root.hidden = this.#steps.adders.hidden = showsXml || showsOutline || aboard !== "";
    this.#steps.draw();
    this.#xml.hidden = !showsXml || aboard !== "";
    if (this.#xml.value !== plan.xml) this.#xml.value = plan.xml;
    this.#notSteps.hidden = !plan.notSteps || aboard !== "";
    setText(this.#notSteps, `This plan is no list of steps: ${plan.notSteps}.`);
    this.#aboard.hidden = !aboard;
    setText(this.#aboard, `nodes of ${aboard}, ${asset.plansAboard.get(aboard)?.status.toLowerCase()}: close`);
    this.#nodes.show(aboard || (this.#ownProgress && !showsOutline ? plan.name : ""), showsOutline ? plan.outline : []);
    this.#nodes.root.hidden = !aboard && !showsOutline;
    this.#nodes.draw();
    this.#checks.root.hidden = aboard !== "";
    this.#checks.draw();
    this.#drawCheck();
    this.#drawButtons(progress);
    this.#drawOutcome();
    const known = [...asset.plansAboard.values()];
    this.#table.hidden = known.length === 0;
    const make = () => html("tr", {}, html("td"), html("td"), html("td"), html("td"));
    reconcile(this.#rows, known, (each) => each.plan, make, (row, each) => this.#drawRow(row, each));
  }

  #drawLibrary() {
    const { plan } = this;
    const { entries } = this.#library;
    const groups = [...new Set(entries.map((each) => each.group))];
    const isListed = this.#open.dataset.listed === (this.#open.dataset.listed = JSON.stringify(entries));
    if (!isListed) {
      const option = (entry) => html("option", { value: String(entries.indexOf(entry)), textContent: entry.name });
      const parts = groups.map((label) => html("optgroup", { label }, ...entries.filter((each) => each.group === label).map(option)));
      this.#open.replaceChildren(html("option", { value: "", textContent: "open …" }), ...parts);
    }
    this.#save.disabled = plan.isEmpty || !plan.name;
    this.#delete.hidden = !this.#library.has(plan.name);
  }

  #drawCheck() {
    const { plan } = this;
    const objections = plan.steps.map((each) => each.objection);
    const at = objections.findIndex(Boolean);
    const refused = at >= 0 ? `Step ${at + 1}: ${objections[at]}` : plan.problem;
    this.#check.hidden = plan.isEmpty;
    this.#check.classList.toggle("refused", !plan.waits && refused !== "");
    const isOther = this.#progress && plan.isChecked && !this.#ownProgress && this.#sentXml;
    const prediction = plan.preview ? predictionText(plan.preview) : `no preview: ${plan.notPreviewed}`;
    setText(this.#check, plan.waits ? "check pending …" : refused || `Valid: ${prediction}${isOther ? ". It differs from the plan aboard." : ""}`);
  }

  /** @param {PlanProgress | undefined} progress */
  #drawButtons(progress) {
    const { plan, asset } = this;
    const acts = ACTS[progress?.status ?? ""] ?? [];
    const canReplace = acts.includes("removePlan");
    const why = !asset.isReached
      ? this.session.unreached(asset)
      : !plan.name
        ? "give the plan a name"
        : progress && !canReplace
          ? `${plan.name} is ${progress.status.toLowerCase()}`
          : "";
    this.#submit.disabled = why !== "" || !plan.xml || (plan.waits && !plan.isTyped);
    setText(this.#hindrance, plan.isEmpty ? "" : why);
    setText(this.#submit, progress && canReplace ? `Replace on ${asset.name}` : `Submit to ${asset.name}`);
    reconcile(this.#acts, acts, String, (act) => this.#makeAct(act, () => plan.name));
  }

  #drawOutcome() {
    const command = this.asset.commands.get(this.#sent);
    const state = command?.state ?? (this.#message && this.#sent ? "rejected" : "sending");
    const text = command ? `${command.name}: ${state}. ${command.history.at(-1)?.detail ?? ""}` : this.#message || (this.#sent && "sending …");
    this.#outcome.hidden = !text;
    this.#outcome.className = `outcome ${state}`;
    setText(this.#outcome, text);
  }

  /** @param {any} row @param {PlanProgress} progress */
  #drawRow(row, progress) {
    const { plan: name, status } = progress;
    const revision = this.#library.submitted.find((each) => each.plan === name);
    const [title, state, done, acts] = row.children;
    setText(title, name);
    set(title, { title: revision ? `submitted ${clock(revision.utc)}` : "not submitted at this console" });
    setText(state, status.toLowerCase());
    const parts = [progress.total ? `${progress.done ?? 0} of ${progress.total}` : "", progress.text, revision ? `by ${revision.operator}, revision ${revision.revision}` : ""];
    setText(done, parts.filter(Boolean).join(", "));
    set(done, { title: progress.node ?? "" });
    const offered = [...(ACTS[status] ?? []), ...(status === "SUBMITTED" ? [] : ["nodes"]), ...(revision ? [`show ${revision.revision}`] : [])];
    reconcile(acts, offered, String, (act) => this.#makeAct(act, () => name, revision));
  }

  /** @param {string} act name of a command, or `show` with a revision @param {() => string} nameOf the plan @param {PlanRevision} [revision] */
  #makeAct(act, nameOf, revision) {
    if (act === "nodes") return button("nodes", "show the progress of its nodes, and steer it", () => this.#showAboard(nameOf()));
    if (!act.startsWith("show")) return button(LABELS[act], act, () => this.#act(act, nameOf()), { className: act });
    return button("show", "open this plan above", () => this.#load(() => this.#library.readRevision(revision.revision)));
  }
}
