/**
 * The way by the relay: ground, orbiter and rover, what waits and what went over each link, when there is
 * contact, and where each command under way is. All figures are those that orbiter and rover tell as
 * parameters DTN_…, so that it shows the past as well.
 */

import { eachFrame, html, keep, say, set } from "../dom.js";
import { age, clock, number, octets } from "../words.js";
import { isLate, valuesAt } from "./values.js";

/** @typedef {import("../model/context.js").Context} Context */
/** @import { CommandStatus, Sample } from "../model/messages.js" */
/** @typedef {{kind: string, title: string, lines: string[], isOpen?: boolean}} Part `isOpen` is of a link */
/** @typedef {{key: string, title: string, contacts: [number, number][]}} Strip */

/** Rows of the table: what it is, the parameter of the orbiter, that of the rover's end, how it is written. */
const ROWS = [
  ["bundles that wait", "DTN_QUEUED", "DTN_ABOARD_QUEUED", "bundles"],
  ["their octets", "DTN_QUEUED_OCTETS", "DTN_ABOARD_QUEUED_OCTETS", "octets"],
  ["the oldest waits for", "DTN_OLDEST", "DTN_ABOARD_OLDEST", "span"],
  ["sent", "DTN_SENT", "DTN_ABOARD_SENT", "bundles"],
  ["acknowledged", "DTN_ACKNOWLEDGED", "DTN_ABOARD_ACKNOWLEDGED", "bundles"],
  ["sent again", "DTN_RETRANSMITTED", "DTN_ABOARD_RETRANSMITTED", "pieces"],
  ["expired", "DTN_EXPIRED", "DTN_ABOARD_EXPIRED", "bundles"],
  ["round trip", "DTN_ROUND_TRIP", "DTN_ABOARD_ROUND_TRIP", "seconds"],
  ["came from the other end", "DTN_RECEIVED", "DTN_ABOARD_RECEIVED", "bundles"],
  ["the other end was last heard", "DTN_LAST_HEARD", "DTN_ABOARD_LAST_HEARD", "ago"],
];
const KEYS = [
  ...ROWS.flatMap(([, here, aboard]) => [here, aboard]),
  ...["DTN_NEXT_CONTACT", "DTN_OVERRIDE", "DTN_ROOM", "DTN_CONTACTS_UP", "DTN_CONTACTS_DOWN"],
  "LINK_ROUND_TRIP",
  ...["DTN_ABOARD_CONTACT", "DTN_ABOARD_NEXT_CONTACT", "DTN_ABOARD_UNREAD", "DTN_ABOARD_REFUSED"],
];
const DIRECTIONS = [
  ["DTN_CONTACTS_UP", "orbiter → rover"],
  ["DTN_CONTACTS_DOWN", "rover → orbiter"],
];
const SHORTEST_STRIP_S = 600;
const LONGEST_STRIP_S = 86_400;
/** How much of the strip is past. */
const PAST = 0.2;
const MOST_COMMANDS = 30;

/**
 * @param {HTMLElement} element
 * @param {Context} context
 * @returns {() => void}
 */
export function mount(element, context) {
  const { asset, session, selection, cursor } = context;
  /** @type {Map<string, Map<string, Sample>>} the values of the time that is looked at */
  let past = new Map();
  const empty = html("p", { className: "empty" });
  const path = html("div", { className: "path" });
  const strips = html("div", { className: "strips" });
  const rows = html("tbody");
  const asOf = html("th", { className: "figure" });
  const commands = html("tbody");
  const noCommands = html("p", { className: "empty" });
  const commandTable = html("table", {}, tableHead("command", "sent", "at the orbiter", "left it", "aboard", "now"), commands);
  const body = html(
    "div",
    { className: "scroll" },
    path,
    strips,
    html(
      "table",
      { className: "traffic" },
      html("thead", {}, html("tr", {}, html("th"), html("th", { className: "figure", textContent: "orbiter → rover" }), asOf)),
      rows,
    ),
    html("h3", { textContent: "Commands under way by the relay" }),
    commandTable,
    noCommands,
  );
  const root = html("section", { className: "rover-view dtn-view" }, empty, body);
  element.append(root);

  const now = () => cursor.utc_s ?? session.now;

  /** The newest value of a parameter by the relay. @param {string} key @returns {Sample | undefined} */
  const sampleOf = (key) => (cursor.utc_s === null ? asset.values : past).get(key)?.get("relay");

  /** The number of a parameter; null where it is not known. @param {string} key @returns {number | null} */
  function figureOf(key) {
    const value = sampleOf(key)?.value;
    return value === null || value === undefined ? null : Number(value);
  }

  async function lookBack() {
    const utc = cursor.utc_s;
    const found = utc === null ? new Map() : await valuesAt(asset, KEYS, utc);
    if (cursor.utc_s !== utc) return;
    past = found;
    draw();
  }

  function render() {
    const isThere = asset.links.has("relay") || sampleOf("DTN_QUEUED") !== undefined;
    body.hidden = !isThere;
    empty.hidden = isThere;
    if (!isThere) {
      say(empty, `No orbiter is known by which ${asset.name} is reached. Start rover-console with a further --to, the address that rover-mops prints for it, such as --to 127.0.0.1:21100.`);
      return;
    }
    root.classList.toggle("past", cursor.utc_s !== null);
    drawPath();
    drawStrips();
    drawTraffic();
    drawCommands();
  }

  function drawPath() {
    const link = asset.links.get("relay");
    const [heard, room] = [sampleOf("DTN_QUEUED"), figureOf("DTN_ROOM")];
    const roundTrip = figureOf("LINK_ROUND_TRIP");
    const unread = figureOf("DTN_ABOARD_UNREAD");
    const refused = figureOf("DTN_ABOARD_REFUSED");
    const rover = [toldAboard() || "told nothing yet", unread ? `${unread} commands not taken` : "", refused ? `${refused} refused` : ""];
    const ground = [link?.detail || (heard ? `told ${ago(heard.utc)}` : "nothing told yet"), roundTrip === null ? "" : `round trip ${number(roundTrip)} s`];
    /** @type {Part[]} */
    const parts = [
      { kind: "ground", title: "rover-console", lines: [] },
      { kind: "mal", title: `link ${link?.state ?? "not known"}`, lines: ground, isOpen: link?.state === "up" },
      { kind: "orbiter", title: "orbiter", lines: [room === null ? "" : `room for ${amount(room)}`] },
      { kind: "bundles", ...contactUp() },
      { kind: "rover", title: asset.name, lines: rover },
    ];
    keep(path, parts, ({ kind }) => kind, makePart, (part, { kind, title, lines, isOpen }) => {
      set(part, { "data-open": isOpen ?? "", class: isOpen === undefined ? "node" : `leg ${kind}` });
      say(part.children[0], title);
      say(part.children[1], lines.filter(Boolean).join(", "));
    });
  }

  const ago = (utc) => (age(now() - utc) === "now" ? "now" : `${age(now() - utc)} ago`);

  /** When the rover's end told of itself; empty where it did not. */
  function toldAboard() {
    const told = sampleOf("DTN_ABOARD_QUEUED");
    return typeof told?.value === "number" ? `told ${ago(told.utc)}` : "";
  }

  /** Whether the orbiter can send to the rover, and until when or from when on. */
  function contactUp() {
    const next = sampleOf("DTN_NEXT_CONTACT");
    const override = figureOf("DTN_OVERRIDE");
    const held = override === 1 ? "held open until CONTACT PLAN" : override === -1 ? "held closed until CONTACT PLAN" : "";
    if (!next) return { title: "", lines: ["nothing told yet"], isOpen: false };
    if (next.value === 0) {
      const end = contactsOf("DTN_CONTACTS_UP")?.find(([begin, end]) => begin <= now() && now() < end)?.[1];
      return { title: "contact", lines: [held || (end ? `until ${clock(end)}` : "")], isOpen: true };
    }
    const begin = typeof next.value === "number" ? next.utc + next.value : null;
    const when = begin === null ? "none is planned" : `next at ${clock(begin)}, in ${span(begin - now())}`;
    return { title: "no contact", lines: [held || when], isOpen: false };
  }

  /** The planned contacts of a direction; null where there is no plan. @param {string} key @returns {[number, number][] | null} */
  function contactsOf(key) {
    const listed = sampleOf(key)?.value;
    if (typeof listed !== "string") return null;
    return listed
      .split(" ")
      .filter(Boolean)
      .map((each) => /** @type {[number, number]} */ (each.split("/").map((text) => Date.parse(text) / 1000)));
  }

  function drawStrips() {
    /** @type {Strip[]} */
    const planned = DIRECTIONS.flatMap(([key, title]) => {
      const contacts = contactsOf(key);
      return contacts === null ? [] : [{ key, title, contacts }];
    });
    const ends = planned.flatMap((each) => each.contacts).flat();
    const ahead = Math.max(SHORTEST_STRIP_S, ...ends.map((each) => each - now()));
    const span = Math.min(LONGEST_STRIP_S, ahead / (1 - PAST));
    const begin = now() - span * PAST;
    const place = (utc) => Math.min(100, Math.max(0, ((utc - begin) / span) * 100));
    keep(strips, planned, ({ key }) => key, makeStrip, (strip, { title, contacts }) => {
      say(strip.children[0], title);
      const [, line] = strip.children;
      line.replaceChildren(
        ...contacts
          .filter(([from, until]) => until > begin && from < begin + span)
          .map(([from, until]) =>
            html("i", {
              title: `${clock(from)} to ${clock(until)} UTC`,
              style: `left: ${place(from)}%; width: ${place(until) - place(from)}%`,
              "data-contact": from,
            }),
          ),
        html("b", { title: `now, ${clock(now())} UTC`, style: `left: ${place(now())}%` }),
        html("small", { textContent: clock(begin) }),
        html("small", { className: "end", textContent: clock(begin + span) }),
      );
    });
    strips.hidden = planned.length === 0;
  }

  function drawTraffic() {
    say(asOf, ["rover → orbiter", toldAboard()].filter(Boolean).join(", "));
    keep(rows, ROWS, ([title]) => title, makeRow, (row, [, ...keys]) => {
      const kind = keys.pop() ?? "";
      keys.forEach((key, index) => {
        const sample = sampleOf(key);
        say(row.children[index + 1], written(sample, kind));
        set(row.children[index + 1], { class: `figure${isLate(sample, now()) ? " late" : ""}` });
      });
    });
  }

  /** @param {Sample | undefined} sample @param {string} kind */
  function written(sample, kind) {
    if (typeof sample?.value !== "number") return "–";
    switch (kind) {
      case "octets":
        return amount(sample.value);
      case "span":
        return span(sample.value);
      case "ago":
        return ago(sample.utc - sample.value);
      case "seconds":
        return `${number(sample.value)} s`;
      default:
        return number(sample.value);
    }
  }

  function drawCommands() {
    const open = asset.commandsAt(cursor.utc_s).filter((each) => each.link === "relay" && !each.ended && (cursor.utc_s === null || each.made <= cursor.utc_s));
    const shown = open.slice(0, MOST_COMMANDS);
    keep(commands, shown, (command) => command.id, makeCommand, (row, command) => {
      const reached = (stage) => command.history.find((each) => each.stage === stage);
      const [taken, left, received] = ["TAKEN", "FORWARDED", "RECEIVED"].map(reached);
      const texts = [
        command.name,
        clock(command.made),
        ...[taken, left, received].map((each) => (each ? clock(each.utc) : "")),
        whereIs(command, taken, left, received),
      ];
      texts.forEach((text, index) => say(row.children[index], text));
      set(row, { "data-state": command.state, class: selection.command === command.id ? "selected" : "" });
    });
    commandTable.hidden = shown.length === 0;
    noCommands.hidden = shown.length > 0;
    say(noCommands, "No command is on its way by the relay.");
  }

  /** @param {CommandStatus} command */
  function whereIs(command, taken, left, received) {
    if (command.state === "given_up") return "given up by the orbiter: the rover may have it";
    if (received) return `aboard, ${command.state === "unknown" ? "not heard of since" : command.state}`;
    if (left) return `left the orbiter ${span(now() - left.utc)} ago, not heard of since`;
    if (taken) return `waits at the orbiter for ${span(now() - taken.utc)}`;
    return command.state === "unknown" ? "not known" : "on its way to the orbiter";
  }

  const makeCommand = (command) =>
    html("tr", { onclick: () => selection.selectCommand(command.id), "data-id": command.id }, ...Array.from({ length: 6 }, () => html("td")));

  const draw = eachFrame(render);
  const offs = [
    ...["values", "entry", "links", "commands"].map((topic) => asset.on(topic, draw)),
    session.onSecond(draw),
    selection.on(draw),
    cursor.on(lookBack),
  ];
  draw();
  lookBack();
  return () => {
    offs.forEach((off) => off());
    root.remove();
  };
}

const tableHead = (...titles) => html("thead", {}, html("tr", {}, ...titles.map((textContent) => html("th", { textContent }))));

/** @param {Part} part */
const makePart = ({ kind }) => html("div", { "data-part": kind }, html("b"), html("span"));

/** @param {Strip} strip */
const makeStrip = ({ key }) => html("div", { className: "strip", "data-strip": key }, html("span"), html("div"));

const makeRow = ([title, here, aboard]) =>
  html("tr", {}, html("td", { textContent: title }), html("td", { "data-testid": here }), html("td", { "data-testid": aboard }));

/** How long something takes. @param {number} time_s */
const span = (time_s) => (age(time_s) === "now" ? "0 s" : age(time_s));

/** @param {number} count */
function amount(count) {
  const { text, unit } = octets(count);
  return `${text} ${unit}`;
}
