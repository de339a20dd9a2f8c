/** The authority over a rover, and the actions on it. Buttons are reused, so that a press is not lost. */

import { fetchJson, operator } from "../model/connection.js";
import { button, html, reconcile, setText, set } from "../dom.js";
import { age } from "../format.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { AuthorityMessage } from "../model/messages.js" */

const ACTS = {
  request: ["request", "request the authority"],
  take: ["take", "take over the authority, if the rover's settings permit it"],
  hand_over: ["hand over to", "hand over the authority"],
  release: ["release", "release the authority"],
};

export class Authority {
  #holder = html("span", {});
  #buttons = html("span", { className: "acts" });
  element = html("span", { className: "authority" }, this.#holder, this.#buttons);
  /** Notice to the holder of a request for the authority. */
  notice = html("div", { className: "lost", role: "alert", hidden: true });
  #rover = "";

  /** @param {(text: string, level: "good" | "bad") => void} show called with the result of an action */
  constructor(show) {
    this.show = show;
  }

  /** @param {Asset | null} rover @param {number} now */
  render(rover, now) {
    const held = rover?.authority;
    this.#rover = rover?.name ?? "";
    const isRequested = held?.holder === operator.name && Boolean(held.requested_by) && held.requested_by !== operator.name;
    this.notice.hidden = !isRequested;
    if (isRequested) setText(this.notice, `${held.requested_by} requests the authority over ${rover.name}, which you hold. Hand it over above, or ignore this.`);
    const make = () => html("span", { "data-testid": "holder" });
    reconcile(this.#holder, held ? [held] : [], () => "holder", make, (element) => drawHolder(element, held, now));
    reconcile(this.#buttons, actsOf(held, rover?.entry?.takers ?? null), (each) => each.join(" "), (each) => this.#makeButton(each), (made, [what]) => {
      if (what === "request") setText(made, held.requested_by === operator.name ? "requested" : "request");
    });
  }

  /** @param {string[]} act action, and the operator of a hand-over */
  #makeButton([what, to]) {
    const [label, title] = ACTS[what];
    return button(to ? `${label} ${to}` : label, title, () => this.#act(to ? { action: what, to } : { action: what }));
  }

  async #act(json) {
    try {
      await fetchJson(`/api/authority/${encodeURIComponent(this.#rover)}`, { json });
    } catch (error) {
      const holder = error.status === 403 && json.action === "request" && error.body?.holder;
      if (holder) this.show(`Requested from ${holder}, with a notice in the bar: the authority over ${this.#rover}.`, "good");
      else this.show(error.message, "bad");
    }
  }
}

/** Return the available actions, each with its operator if it needs one. @param {AuthorityMessage | null | undefined} held @param {string[] | null} takers null if unknown */
function actsOf(held, takers) {
  if (!held) return [];
  const mayTake = held.holder && (takers === null || takers.includes(operator.name));
  if (held.holder !== operator.name) return mayTake ? [["request"], ["take"]] : [["request"]];
  return held.requested_by && held.requested_by !== operator.name ? [["hand_over", held.requested_by], ["release"]] : [["release"]];
}

/** @param {HTMLElement} element @param {AuthorityMessage} held @param {number} now */
function drawHolder(element, { holder, needed, lease, lease_left, utc, epoch }, now) {
  const mine = holder === operator.name;
  const left = Math.max(0, lease_left - (now - utc));
  setText(element, mine ? "you command" : holder ? `${holder} commands` : needed ? "no operator commands" : "every operator may command");
  element.className = `holder ${mine ? "mine" : holder ? "other" : "none"}`;
  set(element, { title: holder ? `lease of ${age(lease)}, ${age(left)} left, grant ${epoch}` : "" });
}
