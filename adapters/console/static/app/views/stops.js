/**
 * The stops without an answer. This page repeats a stop until rover-console has received it, and rover-console
 * until the rover has answered; both can be called off.
 */

import { fetchJson } from "../model/connection.js";
import { button, html, reconcile, setText } from "../dom.js";
import { age } from "../format.js";

/** @import { Session } from "../model/session.js" */
/** @import { StopStatus } from "../model/messages.js" */

const RETRY_MS = 400;
const TIMEOUT_MS = 3000;
const pause = (time_ms) => new Promise((done) => setTimeout(done, time_ms));
const pathOf = (name) => `/api/stop/${encodeURIComponent(name)}`;

export class Stops {
  /** @type {Map<string, number>} times of the presses that rover-console has not received, by rover, ms */
  #unsent = new Map();
  element = html("div", { role: "alert" });

  /** @param {() => void} draw called after a change @param {(text: string, level: "good" | "bad") => void} show called with the end of a stop */
  constructor(draw, show) {
    this.draw = draw;
    this.show = show;
  }

  /** Stop a rover. @param {string} name */
  async press(name) {
    const isRepeated = this.#unsent.has(name);
    this.#unsent.set(name, Date.now());
    while (!isRepeated && this.#unsent.has(name)) {
      this.draw();
      const pressed_ms = this.#unsent.get(name);
      const end = await this.#attempt(name, pressed_ms);
      if (!end) await pause(RETRY_MS);
      else if (this.#unsent.get(name) === pressed_ms) this.#unsent.delete(name); // not a newer press
    }
    this.draw();
  }

  /** @param {string} name @param {number} pressed_ms rover-console lets a stop expire by its age @returns {Promise<boolean>} whether no further attempt is needed */
  async #attempt(name, pressed_ms) {
    try {
      await fetchJson(pathOf(name), { json: { age: (Date.now() - pressed_ms) / 1000 }, keepalive: true, signal: AbortSignal.timeout(TIMEOUT_MS) });
      return true;
    } catch (error) {
      if (error.status === 0) return false;
      this.show(`STOP was not sent to ${name}: ${error.message}.`, "bad");
      return true;
    }
  }

  /** Show how a stop ended. @param {StopStatus | null} stop */
  onChange(stop) {
    if (!stop || stop.state === "waiting") return;
    if (stop.state === "answered") this.show(`STOP of ${stop.operator} reached ${stop.asset}. It stays stopped until the stop is released.`, "good");
    else this.show(`STOP of ${stop.operator} for ${stop.asset}: ${stop.detail}.`, "bad");
  }

  /** @param {Session} session */
  render(session) {
    const waiting = session.rovers.flatMap(({ name, stop }) => (stop?.state === "waiting" ? [{ name, text: textOf(stop, session.now) }] : []));
    const unsent = [...this.#unsent].map(([name, pressed_ms]) => ({ name, text: unsentText(name, (Date.now() - pressed_ms) / 1000) }));
    const shown = [...unsent, ...waiting.filter(({ name }) => !this.#unsent.has(name))];
    /** @param {{name: string, text: string}} shown */
    const make = ({ name }) => html("div", { className: "message bad" }, html("span"), button("call off", "do not send this stop again", () => this.#callOff(name)));
    reconcile(this.element, shown, ({ name }) => name, make, (row, { text }) => setText(row.firstChild, text));
  }

  /** @param {string} name */
  async #callOff(name) {
    const isUnsent = this.#unsent.delete(name);
    this.draw();
    if (isUnsent) return;
    await fetchJson(pathOf(name), { method: "DELETE" }).catch((error) => this.show(error.message, "bad"));
  }
}

/** @param {StopStatus} stop @param {number} now */
function textOf({ asset, operator, pressed }, now) {
  if (now - pressed < 1) return `STOP of ${operator} is being sent to ${asset} …`;
  return `STOP of ${operator}: no answer of ${asset} for ${age(now - pressed)}; it is sent again as soon as the link is up.`;
}

/** @param {string} name @param {number} age_s */
function unsentText(name, age_s) {
  if (age_s < 1) return `Sending STOP to ${name} …`;
  return `STOP for ${name}: no answer of rover-console for ${age(age_s)}; it is sent again until then.`;
}
