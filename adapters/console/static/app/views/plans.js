/**
 * Plans: submit one from a file, give it the rover, take the rover from it, and see how far it is. Each act
 * is a command as any other, and appears among the commands.
 */

import { ask, newId } from "../model/connection.js";
import { button, html, keep, say, set, tableHead } from "../dom.js";
import { View } from "./view.js";
import { clock } from "../words.js";

/** @import { PlanProgress, PlanRevision } from "../model/messages.js" */

/** What may be done to a plan in each of its states. */
const ACTS = {
  SUBMITTED: ["activatePlan", "removePlan"],
  ACTIVATED: ["suspendPlan", "abortPlan"],
  EXECUTING: ["suspendPlan", "abortPlan"],
  SUSPENDED: ["resumePlan", "abortPlan"],
  COMPLETED: ["removePlan"],
  FAILED: ["removePlan"],
  ABORTED: ["removePlan"],
};

export class PlansView extends View {
  /** @type {PlanRevision[]} those that were submitted here, the newest first */
  #submitted = [];
  #path = `/api/plans/${encodeURIComponent(this.asset.name)}`;

  #file = html("input", { type: "file", accept: ".xml", "aria-label": "file of a plan", onchange: () => this.#read(this.#file.files[0]) });
  #name = html("input", { type: "text", "aria-label": "name of the plan", placeholder: "its name", oninput: this.draw });
  #content = html("textarea", { "aria-label": "plan", rows: 8, spellcheck: false, placeholder: "The XML of a plan: choose a file, or write it here.", oninput: this.draw });
  #submit = html("button", { type: "submit", className: "send" });
  #told = html("p", { className: "told", role: "status" });
  #rows = html("tbody");
  #table = html("table", {}, tableHead("plan", "state", "how far", "", "submitted"), this.#rows);
  #form = html(
    "form",
    { onsubmit: (event) => (event.preventDefault(), this.#send()) },
    html("div", { className: "buttons" }, this.#file, this.#name, this.#submit),
    this.#content,
  );
  #empty = html("p", { className: "empty" });
  root = html("section", { className: "rover-view plans-view" }, html("div", { className: "scroll" }, this.#table, this.#empty, this.#form, this.#told));

  start() {
    this.#refresh();
    return [this.asset.on("plans", this.draw), this.asset.on("links", this.draw)];
  }

  /** @param {File | undefined} chosen */
  async #read(chosen) {
    if (!chosen) return;
    const octets = await chosen.arrayBuffer();
    const known = /^<\?xml[^>]*encoding=["'](iso-8859-(?:[1-9]|1[0134-6])|windows-125\d)["']/i;
    const declared = known.exec(new TextDecoder("ascii").decode(octets));
    this.#fill(chosen.name.replace(/\.xml$/i, ""), new TextDecoder(declared ? declared[1] : "utf-8").decode(octets));
  }

  /** @param {string} name @param {string} content */
  #fill(name, content) {
    this.#name.value = name;
    this.#content.value = content;
    this.draw();
  }

  async #send() {
    const plan = { id: newId(), plan_id: this.#name.value.trim(), content: this.#content.value };
    await this.#attempt(ask(this.#path, { json: plan }), `${plan.plan_id} was sent; see the commands.`);
    this.#refresh();
  }

  #act(name, plan) {
    const posted = { id: newId(), asset: this.asset.name, name, args: { plan_id: plan } };
    return this.#attempt(ask("/api/commands", { json: posted }), `${name} ${plan} was sent; see the commands.`);
  }

  /** @param {Promise<any>} asked @param {string} words */
  async #attempt(asked, words) {
    say(this.#told, await asked.then(() => words, (error) => error.message));
  }

  async #refresh() {
    const answer = await ask(this.#path).catch(() => null);
    if (answer) this.#submitted = answer.plans;
    this.draw();
  }

  async #show(revision) {
    const { plan, content } = await ask(`${this.#path}/${revision}`);
    this.#fill(plan, content);
  }

  render() {
    const { asset, session } = this;
    // Plans that were submitted here or told of by the rover, the last revision of each.
    const known = [...new Set([...this.#submitted.map((each) => each.plan), ...asset.plans.keys()])];
    this.#table.hidden = known.length === 0;
    this.#empty.hidden = known.length > 0;
    say(this.#empty, asset.isReached ? "No plan yet. Choose a file below: config/plans/look-around.xml is an example." : session.unreached(asset));
    const make = () => html("tr", {}, html("td"), html("td"), html("td"), html("td"), html("td", { className: "dim" }));
    keep(this.#rows, known, String, make, (row, plan) => this.#drawRow(row, plan, asset.plans.get(plan), this.#submitted.find((each) => each.plan === plan)));
    this.#submit.disabled = !asset.isReached || !this.#name.value.trim() || !this.#content.value.trim();
    say(this.#submit, `Submit to ${asset.name}`);
  }

  /** @param {HTMLElement} row @param {string} plan @param {PlanProgress | undefined} progress @param {PlanRevision | undefined} revision */
  #drawRow(row, plan, progress, revision) {
    const [title, state, far, acts, when] = /** @type {any} */ (row.children);
    const status = progress?.status ?? "";
    say(title, plan);
    say(state, status.toLowerCase());
    say(far, [progress?.total ? `${progress.done ?? 0} of ${progress.total}` : "", progress?.text ?? ""].filter(Boolean).join(", "));
    set(far, { title: progress?.node ?? "" });
    say(when, revision ? `${clock(revision.utc)} by ${revision.operator}, revision ${revision.revision}` : "elsewhere");
    const offered = [...(ACTS[status] ?? []), ...(revision ? [`show ${revision.revision}`] : [])];
    keep(acts, offered, String, (each) => this.#makeAct(each, plan, revision));
  }

  /** @param {string} act the name of a command, or to show a revision */
  #makeAct(act, plan, revision) {
    if (act.startsWith("show")) return button("show", "", () => this.#show(revision.revision));
    return button(act.replace("Plan", ""), "", () => this.#act(act, plan));
  }
}
