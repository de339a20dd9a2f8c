/**
 * Plans: submit one from a file, give it the rover, take the rover from it, and see how far it is. Each act
 * is a command as any other, and appears among the commands.
 */

import { ask, newId } from "../model/connection.js";
import { eachFrame, html, keep, say, set } from "../dom.js";
import { clock } from "../words.js";

/** @typedef {import("../model/context.js").Context} Context */

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

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session } = context;
  /** @type {any[]} those that were submitted here, the newest first */
  let submitted = [];
  const file = html("input", { type: "file", accept: ".xml", "aria-label": "file of a plan", onchange: read });
  const name = html("input", { type: "text", "aria-label": "name of the plan", placeholder: "its name", oninput: () => draw() });
  const content = html("textarea", { "aria-label": "plan", rows: 8, spellcheck: false, placeholder: "The XML of a plan: choose a file, or write it here.", oninput: () => draw() });
  const submit = html("button", { type: "submit", className: "send" });
  const told = html("p", { className: "told", role: "status" });
  const rows = html("tbody");
  const table = html(
    "table",
    {},
    html("thead", {}, html("tr", {}, ...["plan", "state", "how far", "", "submitted"].map((textContent) => html("th", { textContent })))),
    rows,
  );
  const form = html(
    "form",
    { onsubmit: (event) => (event.preventDefault(), send()) },
    html("div", { className: "buttons" }, file, name, submit),
    content,
  );
  const empty = html("p", { className: "empty" });
  const root = html("section", { className: "rover-view plans-view" }, html("div", { className: "scroll" }, table, empty, form, told));
  element.append(root);

  async function read() {
    const chosen = file.files[0];
    if (!chosen) return;
    const octets = await chosen.arrayBuffer();
    const known = /^<\?xml[^>]*encoding=["'](iso-8859-(?:[1-9]|1[0134-6])|windows-125\d)["']/i;
    const declared = known.exec(new TextDecoder("ascii").decode(octets));
    content.value = new TextDecoder(declared ? declared[1] : "utf-8").decode(octets);
    name.value = chosen.name.replace(/\.xml$/i, "");
    draw();
  }

  async function send() {
    const plan = { id: newId(), plan_id: name.value.trim(), content: content.value };
    await attempt(ask(`/api/plans/${encodeURIComponent(asset.name)}`, { json: plan }), `${plan.plan_id} was sent; see the commands.`);
    refresh();
  }

  function act(command, plan) {
    const posted = { id: newId(), asset: asset.name, name: command, args: { plan_id: plan } };
    return attempt(ask("/api/commands", { json: posted }), `${command} ${plan} was sent; see the commands.`);
  }

  /** @param {Promise<any>} asked @param {string} words */
  async function attempt(asked, words) {
    try {
      await asked;
      say(told, words);
    } catch (error) {
      say(told, error.message);
    }
  }

  async function refresh() {
    const answer = await ask(`/api/plans/${encodeURIComponent(asset.name)}`).catch(() => null);
    if (answer) submitted = answer.plans;
    draw();
  }

  async function show(revision) {
    const plan = await ask(`/api/plans/${encodeURIComponent(asset.name)}/${revision}`);
    content.value = plan.content;
    name.value = plan.plan;
    draw();
  }

  /** Plans that were submitted here or told of by the rover, the last revision of each. */
  function plans() {
    const names = new Set([...submitted.map((each) => each.plan), ...asset.plans.keys()]);
    return [...names].map((plan) => ({
      plan,
      progress: asset.plans.get(plan),
      revision: submitted.find((each) => each.plan === plan),
    }));
  }

  function render() {
    const known = plans();
    table.hidden = known.length === 0;
    empty.hidden = known.length > 0;
    say(empty, asset.isReached ? "No plan yet. Choose a file below: config/plans/look-around.xml is an example." : session.unreached(asset));
    keep(rows, known, (each) => each.plan, make, update);
    submit.disabled = !asset.isReached || !name.value.trim() || !content.value.trim();
    say(submit, `Submit to ${asset.name}`);
  }

  const make = () => html("tr", {}, html("td"), html("td"), html("td"), html("td"), html("td", { className: "dim" }));

  function update(row, { plan, progress, revision }) {
    const [title, state, far, acts, when] = row.children;
    const status = progress?.status ?? "";
    say(title, plan);
    say(state, status.toLowerCase());
    say(far, [progress?.total ? `${progress.done ?? 0} of ${progress.total}` : "", progress?.text ?? ""].filter(Boolean).join(", "));
    set(far, { title: progress?.node ?? "" });
    say(when, revision ? `${clock(revision.utc)} by ${revision.operator}, revision ${revision.revision}` : "elsewhere");
    if (acts.drawn === `${status} ${revision?.revision}`) return;
    acts.drawn = `${status} ${revision?.revision}`;
    const button = (textContent, onclick) => html("button", { type: "button", textContent, onclick });
    acts.replaceChildren(
      ...(ACTS[status] ?? []).map((command) => button(command.replace("Plan", ""), () => act(command, plan))),
      revision ? button("show", () => show(revision.revision)) : "",
    );
  }

  const draw = eachFrame(render);
  const offs = [asset.on("plans", draw), asset.on("links", draw)];
  refresh();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}
