/**
 * The open questions of plans of all rovers, with a button for each answer and the time left by the onboard clock.
 * An answer is a command of the operator; the first one counts.
 */

import { fetchJson, newId } from "../model/connection.js";
import { button, html, reconcile, setText, set } from "../dom.js";
import { duration, timeOfDay } from "../format.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { CommandStatus, QuestionStatus } from "../model/messages.js" */
/** @import { Session } from "../model/session.js" */

export class Questions {
  /** @type {Map<string, string>} keys of the questions that this page has answered, by the ids of the commands */
  #sent = new Map();
  element = html("div", { className: "questions" });

  /** @param {() => void} draw called after a change @param {(text: string, level: "good" | "bad") => void} show called with the end of a question */
  constructor(draw, show) {
    this.draw = draw;
    this.show = show;
  }

  /** Show how a question ended, with the operator of its answer. @param {Asset} rover @param {QuestionStatus} question */
  onChange(rover, question) {
    const { asset, plan, text, end } = question;
    if (end === null) return;
    const answer = rover.lastCommands.find((each) => each.state === "executed" && isAnswerTo(question, each));
    const isMeant = answer && (end === "" || end === `answered ${answer.args.option}`);
    const how = isMeant ? `was answered: ${answer.args.option}, by ${answer.by}` : end || "ended without an answer";
    this.show(`${asset}, plan ${plan}: “${text}” ${how}.`, "good");
  }

  /** Show that an answer was refused, for example since another operator was first. @param {CommandStatus} command */
  onCommand({ id, asset, ended, state, history }) {
    if (!this.#sent.has(id) || !(ended || state === "unknown")) return;
    this.#sent.delete(id);
    if (state !== "executed") this.show(`${asset} did not take the answer: ${history.at(-1).detail}.`, "bad");
  }

  /** @param {Session} session */
  render(session) {
    const open = session.rovers.flatMap((rover) => [...rover.questions.values()].map((question) => ({ rover, question, key: keyOf(question) })));
    open.sort((one, other) => (one.question.until ?? Infinity) - (other.question.until ?? Infinity));
    reconcile(this.element, open, ({ key }) => key, (each) => this.#make(each.question), (row, each) => this.#drawRow(row, each.rover, each.question, session.now));
  }

  /** @param {QuestionStatus} question */
  #make(question) {
    const { asset, plan, text, options } = question;
    const answers = options.map((option) => button(option, `answer ${option}`, () => this.#answer(question, option)));
    return html(
      "section",
      { className: "question", "aria-label": `question of plan ${plan}`, "data-question": question.question },
      html("p", { role: "alert" }, html("b", { textContent: `${asset}, plan ${plan}, question: ` }), text),
      html("span", { className: "buttons" }, ...answers),
      html("span", { className: "left", role: "timer" }),
    );
  }

  /** @param {any} row @param {Asset} rover @param {QuestionStatus} question @param {number} now */
  #drawRow(row, rover, question, now) {
    const [, answers, left] = row.children;
    const isSent = [...this.#sent.values()].includes(keyOf(question));
    for (const each of answers.children) {
      each.disabled = isSent;
      each.classList.toggle("default", each.textContent === question.default);
    }
    setText(left, leftText(question, now + rover.clockLead_s));
    set(row, { "aria-busy": isSent });
  }

  /** @param {QuestionStatus} question @param {string} option */
  async #answer(question, option) {
    const id = newId();
    this.#sent.set(id, keyOf(question));
    this.draw();
    const args = { plan_id: question.plan, question: question.question, option };
    try {
      await fetchJson("/api/commands", { json: { id, asset: question.asset, name: "answerQuestion", args } });
    } catch (error) {
      this.#sent.delete(id);
      this.show(`Not sent: ${error.message}.`, "bad");
      this.draw();
    }
  }
}

/** @param {QuestionStatus} question @param {CommandStatus} command */
const isAnswerTo = ({ plan, question }, { name, args }) => name === "answerQuestion" && args?.plan_id === plan && `/${question}`.endsWith(`/${args.question}`);

/** @param {QuestionStatus} question */
const keyOf = ({ asset, plan, question }) => `${asset} ${plan} ${question}`;

/** Format the deadline, the time left and the default. @param {QuestionStatus} question @param {number} now by the onboard clock */
function leftText({ until, default: fallback }, now) {
  if (until === null) return "no deadline";
  const then = fallback === null ? "the question fails" : `${fallback}`;
  const left_s = until - now;
  return left_s > 0 ? `${duration(left_s)} left, until ${timeOfDay(until)} UTC, then ${then}` : `the deadline has passed: ${then}`;
}
