/** One line for each plan that runs or is suspended: state, step, predicted time left, suspend and resume. */

import { fetchJson, newId } from "../model/connection.js";
import { button, html, reconcile, setText, set } from "../dom.js";
import { View } from "./view.js";
import { duration } from "../format.js";

/** @import { PlanProgress } from "../model/messages.js" */

const ACTS = { ACTIVATED: "suspendPlan", EXECUTING: "suspendPlan", SUSPENDED: "resumePlan" };

export class PlanStrip extends View {
  #message = "";
  root = html("div", { className: "plan-strip", "data-testid": "plan-strip" });

  start() {
    const { asset, session, cursor, draw } = this;
    return [...["plans", "commands"].map((topic) => asset.on(topic, draw)), session.onSecond(draw), cursor.on(draw)];
  }

  render() {
    const { asset, cursor } = this;
    const isLive = cursor.utc_s === null && !asset.recording;
    const shown = isLive ? [...asset.plansAboard.values()].filter((each) => each.status in ACTS) : [];
    reconcile(this.root, shown, (each) => each.plan, (each) => this.#make(each), (line, each) => this.#drawLine(line, each));
  }

  /** @param {PlanProgress} progress */
  #make({ plan }) {
    const [suspend, resume] = ["suspendPlan", "resumePlan"].map((act) => button(act.replace("Plan", ""), `${act} ${plan}`, () => this.#act(act, plan)));
    return html("p", {}, html("b", { textContent: plan }), html("span"), html("span", { className: "step" }), suspend, resume);
  }

  /** @param {any} line @param {PlanProgress} progress */
  #drawLine(line, progress) {
    const [, state, step, suspend, resume] = line.children;
    const { status, done, total, node } = progress;
    set(line, { class: status.toLowerCase() });
    setText(state, status.toLowerCase());
    const left_s = this.#left_s(progress);
    const name = node?.split("/").at(-1) ?? "";
    const at = total ? `step ${Math.min((done ?? 0) + 1, total)} of ${total}` : "";
    setText(step, this.#message || [[at, name].filter(Boolean).join(": "), left_s === null ? "" : `${duration(left_s)} left`].filter(Boolean).join(", "));
    suspend.hidden = ACTS[status] !== "suspendPlan";
    resume.hidden = ACTS[status] !== "resumePlan";
  }

  /** The predicted time left; null if unknown, as after a suspension. @param {PlanProgress} progress */
  #left_s({ plan, status }) {
    const { asset } = this;
    const predicted = asset.notices.findLast((each) => each.text.startsWith(`plan ${plan} predicted`));
    const isResumed = ({ name, args, created }) => name === "resumePlan" && args?.plan_id === plan && created > predicted.utc;
    if (status !== "EXECUTING" || !predicted || !asset.pose || [...asset.commands.values()].some(isResumed)) return null;
    return Math.max(Number(predicted.figures["predicted duration"]) - (asset.pose.utc - predicted.utc), 0);
  }

  /** @param {string} name of the command @param {string} plan */
  async #act(name, plan) {
    const json = { id: newId(), asset: this.asset.name, name, args: { plan_id: plan } };
    this.#message = await fetchJson("/api/commands", { json }).then(() => "", (error) => error.message);
    this.draw();
  }
}
