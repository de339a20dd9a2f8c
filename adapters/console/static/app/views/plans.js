/**
 * Plans: submit one from a file, activate, suspend, resume or abort it, and see its progress. Each action
 * is a command, and appears in the command table.
 */

import { fetchJson, newId } from "../model/connection.js";
import { button, html, reconcile, setText, set, tableHead } from "../dom.js";
import { View } from "./view.js";
import { clock } from "../format.js";

/** @import { PlanProgress, PlanRevision } from "../model/messages.js" */

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

export class PlansView extends View {
  /** @type {PlanRevision[]} plans submitted at the console, newest first */
  #submitted = [];
  #path = `/api/plans/${encodeURIComponent(this.asset.name)}`;

  #file = html("input", { type: "file", accept: ".xml", "aria-label": "file of a plan", onchange: () => this.#read(this.#file.files[0]) });
  #name = html("input", { type: "text", "aria-label": "name of the plan", placeholder: "name", oninput: this.draw });
  #content = html("textarea", { "aria-label": "plan", rows: 8, spellcheck: false, placeholder: "XML of a plan: choose a file, or write it here.", oninput: this.draw });
  #submit = html("button", { type: "submit", className: "send" });
  #message = html("p", { className: "message", role: "status" });
  #rows = html("tbody");
  #table = html("table", {}, tableHead("plan", "state", "progress", "", "submitted"), this.#rows);
  #form = html(
    "form",
    { onsubmit: (event) => (event.preventDefault(), this.#send()) },
    html("div", { className: "buttons" }, this.#file, this.#name, this.#submit),
    this.#content,
  );
  #empty = html("p", { className: "empty" });
  root = html("section", { className: "rover-view plans-view" }, html("div", { className: "scroll" }, this.#table, this.#empty, this.#form, this.#message));

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
    await this.#attempt(fetchJson(this.#path, { json: plan }), `${plan.plan_id} was sent; see the commands.`);
    this.#refresh();
  }

  #act(name, plan) {
    const posted = { id: newId(), asset: this.asset.name, name, args: { plan_id: plan } };
    return this.#attempt(fetchJson("/api/commands", { json: posted }), `${name} ${plan} was sent; see the commands.`);
  }

  /** @param {Promise<any>} request @param {string} text */
  async #attempt(request, text) {
    setText(this.#message, await request.then(() => text, (error) => error.message));
  }

  async #refresh() {
    const answer = await fetchJson(this.#path).catch(() => null);
    if (answer) this.#submitted = answer.plans;
    this.draw();
  }

  async #show(revision) {
    const { plan, content } = await fetchJson(`${this.#path}/${revision}`);
    this.#fill(plan, content);
  }

  render() {
    const { asset, session } = this;
    // Plans submitted at the console or reported by the rover, the last revision of each.
    const known = [...new Set([...this.#submitted.map((each) => each.plan), ...asset.plans.keys()])];
    this.#table.hidden = known.length === 0;
    this.#empty.hidden = known.length > 0;
    setText(this.#empty, asset.isReached ? "No plan yet. Choose a file below: config/plans/look-around.xml is an example." : session.unreached(asset));
    const make = () => html("tr", {}, html("td"), html("td"), html("td"), html("td"), html("td", { className: "dim" }));
    reconcile(this.#rows, known, String, make, (row, plan) => this.#drawRow(row, plan, asset.plans.get(plan), this.#submitted.find((each) => each.plan === plan)));
    this.#submit.disabled = !asset.isReached || !this.#name.value.trim() || !this.#content.value.trim();
    setText(this.#submit, `Submit to ${asset.name}`);
  }

  /** @param {HTMLElement} row @param {string} plan @param {PlanProgress | undefined} progress @param {PlanRevision | undefined} revision */
  #drawRow(row, plan, progress, revision) {
    const [title, state, progressCell, acts, when] = /** @type {any} */ (row.children);
    const status = progress?.status ?? "";
    setText(title, plan);
    setText(state, status.toLowerCase());
    setText(progressCell, [progress?.total ? `${progress.done ?? 0} of ${progress.total}` : "", progress?.text ?? ""].filter(Boolean).join(", "));
    set(progressCell, { title: progress?.node ?? "" });
    setText(when, revision ? `${clock(revision.utc)} by ${revision.operator}, revision ${revision.revision}` : "not at this console");
    const offered = [...(ACTS[status] ?? []), ...(revision ? [`show ${revision.revision}`] : [])];
    reconcile(acts, offered, String, (each) => this.#makeAct(each, plan, revision));
  }

  /** @param {string} act name of a command, or `show` with a revision */
  #makeAct(act, plan, revision) {
    if (act.startsWith("show")) return button("show", "", () => this.#show(revision.revision));
    return button(act.replace("Plan", ""), "", () => this.#act(act, plan));
  }
}
