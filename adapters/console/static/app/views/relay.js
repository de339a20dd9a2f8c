/**
 * The path over the relay: ground, orbiter and rover, queues and traffic of each link, contacts, and the
 * location of each active command. All figures are parameters DTN_… of orbiter and rover, so the view can
 * also show the past.
 */

import { nameOf } from "../model/asset.js";
import { html, reconcile, setText, set, tableHead } from "../dom.js";
import { RelayFigures } from "./dtn_figures.js";
import { isLate } from "./values.js";
import { View } from "./view.js";
import { clock, duration, interval, number, sizeOf } from "../format.js";

/** @import { CommandStatus, Sample, StageEntry } from "../model/messages.js" */
/** @typedef {{kind: string, title: string, lines: string[], isOpen?: boolean}} Part `isOpen` is of a link */
/** @typedef {{key: string, title: string, contacts: [number, number][]}} Strip */

/** Rows of the table: title, parameter of the orbiter, parameter of the rover's end, format. */
const ROWS = [
  ["queued bundles", "DTN_QUEUED", "DTN_ABOARD_QUEUED", "bundles"],
  ["queued octets", "DTN_QUEUED_OCTETS", "DTN_ABOARD_QUEUED_OCTETS", "octets"],
  ["age of the first in the queue", "DTN_OLDEST_AGE", "DTN_ABOARD_OLDEST_AGE", "span"],
  ["sent", "DTN_SENT", "DTN_ABOARD_SENT", "bundles"],
  ["acknowledged", "DTN_ACKNOWLEDGED", "DTN_ABOARD_ACKNOWLEDGED", "bundles"],
  ["retransmitted", "DTN_RETRANSMITTED", "DTN_ABOARD_RETRANSMITTED", "pieces"],
  ["expired", "DTN_EXPIRED", "DTN_ABOARD_EXPIRED", "bundles"],
  ["round trip", "DTN_ROUND_TRIP", "DTN_ABOARD_ROUND_TRIP", "seconds"],
  ["received from the other end", "DTN_RECEIVED", "DTN_ABOARD_RECEIVED", "bundles"],
  ["last contact with the other end", "DTN_LAST_RECEIVED", "DTN_ABOARD_LAST_RECEIVED", "ago"],
];
/** Formats of a figure other than a number. @type {Record<string, (value: number) => string>} */
const FORMATS = { octets: sizeOf, span: duration, seconds: (value) => `${number(value)} s` };
const KEYS = [
  ...ROWS.flatMap(([, here, aboard]) => [here, aboard]),
  ...["DTN_NEXT_CONTACT", "DTN_OVERRIDE", "DTN_FREE_OCTETS", "DTN_CONTACTS_UP", "DTN_CONTACTS_DOWN"],
  "LINK_ROUND_TRIP",
  ...["DTN_ABOARD_CONTACT", "DTN_ABOARD_NEXT_CONTACT", "DTN_ABOARD_UNDELIVERED", "DTN_ABOARD_REFUSED"],
];
const DIRECTIONS = [
  ["DTN_CONTACTS_UP", "orbiter → rover"],
  ["DTN_CONTACTS_DOWN", "rover → orbiter"],
];
/** Limits of the future that the strips show, s. */
const MIN_AHEAD_S = 300;
const MAX_AHEAD_S = 86_400;
const MAX_COMMANDS = 30;

export class RelayView extends View {
  #figures = new RelayFigures(this, KEYS);
  #empty = html("p", { className: "empty" });
  #path = html("div", { className: "path" });
  #strips = html("div", { className: "strips" });
  #rows = html("tbody");
  #asOf = html("th", { className: "figure" });
  #commands = html("tbody");
  #noCommands = html("p", { className: "empty", textContent: "No active command over the relay." });
  #commandTable = html("table", {}, tableHead("command", "sent", "at the orbiter", "forwarded", "aboard", "now"), this.#commands);
  #trafficHead = html("thead", {}, html("tr", {}, html("th"), html("th", { className: "figure", textContent: "orbiter → rover" }), this.#asOf));
  #body = html(
    "div",
    { className: "scroll", tabIndex: 0 },
    this.#path,
    this.#strips,
    html("table", { className: "traffic" }, this.#trafficHead, this.#rows),
    html("h3", { textContent: "Active commands over the relay" }),
    this.#commandTable,
    this.#noCommands,
  );
  root = html("section", { className: "rover-view dtn-view" }, this.#empty, this.#body);

  start() {
    const { asset, session, selection, cursor, span, draw } = this;
    const loadPast = async () => (await this.#figures.loadPast()) && draw();
    loadPast();
    return [
      ...["values", "entry", "links", "commands"].map((topic) => asset.on(topic, draw)),
      session.onSecond(draw),
      selection.on(draw),
      span.on(draw),
      cursor.on(loadPast),
    ];
  }

  render() {
    const isThere = this.asset.links.has("relay") || this.#figures.sample("DTN_QUEUED") !== undefined;
    this.#body.hidden = !isThere;
    this.#empty.hidden = isThere;
    if (!isThere) {
      return setText(this.#empty, `No orbiter serves ${this.asset.name}. Start rover-console with a further --to and the address that rover-mops prints, such as --to 127.0.0.1:21100.`);
    }
    this.root.classList.toggle("past", this.cursor.utc_s !== null);
    this.#drawPath();
    this.#drawStrips();
    this.#drawTraffic();
    this.#drawCommands();
  }

  #drawPath() {
    const figures = this.#figures;
    const link = this.asset.links.get("relay");
    const [queued, freeSpace] = [figures.sample("DTN_QUEUED"), figures.number("DTN_FREE_OCTETS")];
    const roundTrip = figures.number("LINK_ROUND_TRIP");
    const undelivered = figures.number("DTN_ABOARD_UNDELIVERED");
    const refused = figures.number("DTN_ABOARD_REFUSED");
    const rover = [figures.aboard || "no report yet", undelivered ? `${undelivered} commands not delivered` : "", refused ? `${refused} refused` : ""];
    const ground = [link?.detail || (queued ? `reported ${figures.ago(queued.utc)}` : "no report yet"), roundTrip === null ? "" : `round trip ${number(roundTrip)} s`];
    /** @type {Part[]} */
    const parts = [
      { kind: "ground", title: "rover-console", lines: [] },
      { kind: "mal", title: `link ${link?.state ?? "unknown"}`, lines: ground, isOpen: link?.state === "up" },
      { kind: "orbiter", title: "orbiter", lines: [freeSpace === null ? "" : `${sizeOf(freeSpace)} free`] },
      { kind: "bundles", ...figures.contact },
      { kind: "rover", title: this.asset.name, lines: rover },
    ];
    const make = (/** @type {Part} */ { kind }) => html("div", { "data-part": kind }, html("b"), html("span"));
    reconcile(this.#path, parts, ({ kind }) => kind, make, (part, { kind, title, lines, isOpen }) => {
      set(part, { "data-open": isOpen ?? "", class: isOpen === undefined ? "node" : `leg ${kind}` });
      setText(part.children[0], title);
      setText(part.children[1], lines.filter(Boolean).join(", "));
    });
  }

  #drawStrips() {
    const { now } = this.#figures;
    /** @type {Strip[]} */
    const planned = DIRECTIONS.flatMap(([key, title]) => {
      const contacts = this.#figures.contacts(key);
      return contacts === null ? [] : [{ key, title, contacts }];
    });
    const [begin, end] = this.#strip(planned);
    const position = (utc) => Math.min(100, Math.max(0, ((utc - begin) / (end - begin)) * 100));
    const barsOf = (what, spans) => spans.filter(([from, until]) => until > begin && from < end).map(([from, until]) => ({ what, from, until }));
    const makeBar = ({ what, from }) => html("i", { className: what, [`data-${what}`]: from });
    const make = (/** @type {Strip} */ { key }) =>
      html("div", { className: "strip", "data-strip": key }, html("span"), html("div", {}, html("span"), html("b"), html("small"), html("small", { className: "end" })));
    reconcile(this.#strips, planned, ({ key }) => key, make, ({ children: [name, { children: [bars, mark, first, last] }] }, { title, contacts }) => {
      setText(name, title);
      reconcile(bars, [...barsOf("contact", contacts), ...barsOf("gap", gapsOf(contacts))], ({ what, from }) => `${what} ${from}`, makeBar, (bar, { what, from, until }) =>
        set(bar, {
          title: `${what === "gap" ? "no contact " : ""}${interval(from, until)} UTC, ${duration(until - from)}`,
          style: `left: ${position(from)}%; width: ${position(until) - position(from)}%`,
        }),
      );
      set(mark, { title: `now, ${clock(now)} UTC`, style: `left: ${position(now)}%` });
      setText(first, clock(begin));
      setText(last, clock(end));
    });
    this.#strips.hidden = planned.length === 0;
  }

  /** Begin and end of the strips: the span of the time conductor. Live, they extend as far ahead, and to the next contact. @param {Strip[]} planned */
  #strip(planned) {
    const { start_s, end_s } = this.span;
    const { now } = this.#figures;
    const begin = Math.min(start_s, now);
    if (this.cursor.utc_s !== null) return [begin, Math.max(end_s, now)];
    const ahead = Math.max(now - begin, MIN_AHEAD_S);
    const next = planned.flatMap(({ contacts }) => contacts.find(([, until]) => until > now)?.[0] ?? []);
    return [begin, Math.min(now + MAX_AHEAD_S, Math.max(now, ...next) + ahead)];
  }

  #drawTraffic() {
    const figures = this.#figures;
    setText(this.#asOf, ["rover → orbiter", figures.aboard].filter(Boolean).join(", "));
    const make = ([title, ...keys]) => html("tr", {}, html("td", { textContent: title }), ...keys.slice(0, 2).map((key) => html("td", { "data-testid": key })));
    reconcile(this.#rows, ROWS, ([title]) => title, make, ({ children: [, ...cells] }, [, here, aboard, kind]) => {
      for (const [index, key] of [here, aboard].entries()) {
        const sample = figures.sample(key);
        setText(cells[index], this.#formatted(sample, kind));
        set(cells[index], { class: `figure${isLate(sample, figures.now) ? " late" : ""}` });
      }
    });
  }

  /** @param {Sample | undefined} sample @param {string} kind */
  #formatted(sample, kind) {
    if (typeof sample?.value !== "number") return "–";
    if (kind === "ago") return this.#figures.ago(sample.utc - sample.value);
    return (FORMATS[kind] ?? number)(sample.value);
  }

  #drawCommands() {
    const { utc_s } = this.cursor;
    const open = this.asset.commandsAt(utc_s).filter((each) => each.link === "relay" && !each.ended && (utc_s === null || each.created <= utc_s));
    const shown = open.slice(0, MAX_COMMANDS);
    const make = (/** @type {CommandStatus} */ { id }) =>
      html("tr", { onclick: () => this.selection.selectCommand(id), "data-id": id }, ...Array.from({ length: 6 }, () => html("td")));
    reconcile(this.#commands, shown, (command) => command.id, make, (row, command) => {
      const reached = ["ACKNOWLEDGED", "FORWARDED", "RECEIVED"].map((stage) => command.history.find((each) => each.stage === stage));
      const times = reached.map((each) => (each ? clock(each.utc) : ""));
      const texts = [nameOf(command), clock(command.created), ...times, this.#whereIs(command, reached)];
      texts.forEach((text, index) => setText(row.children[index], text));
      set(row, { "data-state": command.state, class: this.selection.command === command.id ? "selected" : "" });
    });
    this.#commandTable.hidden = shown.length === 0;
    this.#noCommands.hidden = shown.length > 0;
  }

  /** @param {CommandStatus} command @param {StageEntry[]} reached */
  #whereIs({ state }, [acknowledged, left, received]) {
    const since = ({ utc }) => duration(this.#figures.now - utc);
    if (state === "lost") return "lost: the rover may have received it";
    if (received) return `aboard, ${state === "unknown" ? "no report since" : state}`;
    if (left) return `forwarded ${since(left)} ago, no report since`;
    if (acknowledged) return `at the orbiter for ${since(acknowledged)}`;
    return state === "unknown" ? "unknown" : "in transit to the orbiter";
  }
}

/** Return the times between contacts, which are in order. @param {[number, number][]} contacts @returns {[number, number][]} */
function gapsOf(contacts) {
  /** @type {[number, number][]} */
  const between = contacts.slice(1).map(([from], index) => [contacts[index][1], from]);
  return between.filter(([from, until]) => until > from);
}
