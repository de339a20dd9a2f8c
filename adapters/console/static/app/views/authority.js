/** Who may command a rover, and what may be asked for; a button stays the same while somebody presses it. */

import { ask, operator } from "../model/connection.js";
import { button, html, keep, say, set } from "../dom.js";
import { age } from "../words.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { AuthorityMessage } from "../model/messages.js" */

const ACTS = {
  request: ["request", "ask for the right to command"],
  take: ["take", "take it without being asked, where the rover's settings let you"],
  hand_over: ["hand over to", "let them command"],
  release: ["release", "let nobody command"],
};

export class Authority {
  #holder = html("span", {});
  #buttons = html("span", { className: "acts" });
  element = html("span", { className: "authority" }, this.#holder, this.#buttons);
  #rover = "";

  /** @param {(problem: string) => void} onProblem called with what was refused */
  constructor(onProblem) {
    this.onProblem = onProblem;
  }

  /** @param {Asset | null} rover @param {number} now */
  render(rover, now) {
    const held = rover?.authority;
    this.#rover = rover?.name ?? "";
    const make = () => html("span", { "data-testid": "holder" });
    keep(this.#holder, held ? [held] : [], () => "holder", make, (element) => drawHolder(element, held, now));
    keep(this.#buttons, actsOf(held), (each) => each.join(" "), (each) => this.#makeButton(each), (made, [what]) => {
      if (what === "request") say(made, held.asked_by === operator.name ? "asked for" : "request");
    });
  }

  /** @param {string[]} act what, and to whom */
  #makeButton([what, to]) {
    const [words, title] = ACTS[what];
    return button(to ? `${words} ${to}` : words, title, () => this.#act(to ? { act: what, to } : { act: what }));
  }

  async #act(json) {
    try {
      await ask(`/api/authority/${encodeURIComponent(this.#rover)}`, { json });
    } catch (error) {
      this.onProblem(error.message);
    }
  }
}

/** What may be asked for, and for whom. @param {AuthorityMessage | null | undefined} held */
function actsOf(held) {
  if (!held) return [];
  if (held.holder !== operator.name) return held.holder ? [["request"], ["take"]] : [["request"]];
  return held.asked_by && held.asked_by !== operator.name ? [["hand_over", held.asked_by], ["release"]] : [["release"]];
}

/** @param {HTMLElement} element @param {AuthorityMessage} held @param {number} now */
function drawHolder(element, { holder, needed, lease, lease_left, utc, epoch }, now) {
  const mine = holder === operator.name;
  const left = Math.max(0, lease_left - (now - utc));
  say(element, mine ? "you command" : holder ? `${holder} commands` : needed ? "nobody commands" : "anyone may command");
  element.className = `holder ${mine ? "mine" : holder ? "other" : "none"}`;
  set(element, { title: holder ? `lease of ${age(lease)}, ${age(left)} left, grant ${epoch}` : "" });
}
