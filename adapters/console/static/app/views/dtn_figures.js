/** Figures of the relay that orbiter and rover report, now or at the displayed time. */

import { valuesAt } from "./values.js";
import { age, clock, duration } from "../format.js";

/** @import { Context } from "../model/context.js" */
/** @import { Sample } from "../model/messages.js" */

export class RelayFigures {
  #context;
  #keys;
  /** @type {Map<string, Map<string, Sample>>} the values at the displayed time */
  #past = new Map();

  /** @param {Context} context @param {string[]} keys of the parameters */
  constructor(context, keys) {
    this.#context = context;
    this.#keys = keys;
  }

  /** Read the values at the displayed time; false if that time has changed since the request. */
  async loadPast() {
    const { asset, cursor } = this.#context;
    const utc = cursor.utc_s;
    const found = utc === null ? new Map() : await valuesAt(asset, this.#keys, utc);
    if (cursor.utc_s !== utc) return false;
    this.#past = found;
    return true;
  }

  get now() {
    return this.#context.cursor.utc_s ?? this.#context.session.now;
  }

  /** The newest sample of a parameter over the relay. @param {string} key @returns {Sample | undefined} */
  sample(key) {
    const { asset, cursor } = this.#context;
    return (cursor.utc_s === null ? asset.values : this.#past).get(key)?.get("relay");
  }

  /** The number of a parameter; null if unknown. @param {string} key @returns {number | null} */
  number(key) {
    const value = this.sample(key)?.value ?? null;
    return value === null ? null : Number(value);
  }

  /** @param {number} utc */
  ago(utc) {
    const text = age(this.now - utc);
    return text === "now" ? text : `${text} ago`;
  }

  /** Age of the last report of the rover's end; empty without one. */
  get aboard() {
    const sample = this.sample("DTN_ABOARD_QUEUED");
    return typeof sample?.value === "number" ? `reported ${this.ago(sample.utc)}` : "";
  }

  /** The contact between orbiter and rover, with the time of its end or of the next one. */
  get contact() {
    const next = this.sample("DTN_NEXT_CONTACT");
    const override = this.number("DTN_OVERRIDE");
    const held = override === 1 ? "held open until CONTACT PLAN" : override === -1 ? "held closed until CONTACT PLAN" : "";
    if (!next) return { title: "", lines: ["no report yet"], isOpen: false };
    if (next.value === 0) {
      const end = this.contacts("DTN_CONTACTS_UP")?.find(([begin, end]) => begin <= this.now && this.now < end)?.[1];
      return { title: "contact", lines: [held || (end ? `until ${clock(end)}, for another ${duration(end - this.now)}` : "")], isOpen: true };
    }
    const begin = typeof next.value === "number" ? next.utc + next.value : null;
    const when = begin === null ? "none planned" : `next at ${clock(begin)}, in ${duration(begin - this.now)}`;
    return { title: "no contact", lines: [held || when], isOpen: false };
  }

  /** The planned contacts of a direction; null without a plan. @param {string} key @returns {[number, number][] | null} */
  contacts(key) {
    const listed = this.sample(key)?.value;
    if (typeof listed !== "string") return null;
    const ends = (text) => /** @type {[number, number]} */ (text.split("/").map((each) => Date.parse(each) / 1000));
    return listed.split(" ").filter(Boolean).map(ends);
  }
}
