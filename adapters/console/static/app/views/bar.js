/**
 * What is above every page: STOP, who may command, how the links are, which pages are open, and whether
 * this page is connected at all.
 */

import * as alarms from "./alarms.js";
import { ask, operator } from "../model/connection.js";
import { contextOf } from "../model/context.js";
import { eachFrame, html, keep, say, set } from "../dom.js";
import { age, clock } from "../words.js";

/** @typedef {import("../model/session.js").Session} Session */
/** @typedef {import("../model/asset.js").Asset} Asset */

const STOP_KEYS = ["F8", "Pause"];
const STANDING = ["STOPPED", "SAFE", "PAUSED"];
const ACTS = {
  request: ["request", "ask for the right to command"],
  take: ["take", "take it without being asked, where the rover's settings let you"],
  hand_over: ["hand over to", "let them command"],
  release: ["release", "let nobody command"],
};
const RETRIES = 5;
const RETRY_MS = 400;
const TOLD_MS = 8000;

/**
 * @param {HTMLElement} element
 * @param {Session} session
 * @param {{name: string | null, choose: (name: string) => void}} shown the asset that the page shows
 * @returns {() => void}
 */
export function mount(element, session, shown) {
  const picker = html("select", { "aria-label": "rover", onchange: () => shown.choose(picker.value) });
  const mode = html("span", { className: "mode", "data-testid": "mode" });
  const doing = html("span", { className: "doing" });
  const resume = html("button", {
    type: "button",
    className: "resume",
    textContent: "resume …",
    title: "prepare the command that lets it move again",
    onclick: () => contextOf(session, shown.name ?? "").draft.prepare("resume"),
  });
  const links = html("span", { className: "links" });
  const authority = html("span", {});
  const buttons = html("span", { className: "acts" });
  const pages = html("span", { className: "pages dim" });
  const name = html("button", {
    type: "button",
    className: "operator",
    title: "under which name you command; click to change it",
    onclick: rename,
  });
  const stop = html(
    "button",
    { type: "button", className: "stop", "data-testid": "stop", onclick: () => pressed() },
    html("b", { textContent: "STOP" }),
    html("small", { textContent: STOP_KEYS[0] }),
  );
  const alarm = html("button", {
    type: "button",
    className: "alarms",
    "data-testid": "alarms",
    title: "alarms of all rovers; click to see and acknowledge them",
    onclick: toggleAlarms,
  });
  const list = html("div", { className: "alarm-list", hidden: true });
  const told = html("div", { className: "told", role: "alert", hidden: true });
  const lost = html("div", { className: "lost", role: "alert", hidden: true });
  const root = html(
    "header",
    { className: "rover-bar" },
    html("div", { className: "row" }, picker, mode, resume, doing, links, html("span", { className: "authority" }, authority, buttons), html("span", { className: "who" }, name, pages), alarm, stop),
    list,
    told,
    lost,
  );
  element.append(root);
  let hiding = 0;

  /** Say something for a while. @param {string} text @param {"good" | "bad"} look */
  function tell(text, look) {
    say(told, text);
    told.className = `told ${look}`;
    told.hidden = false;
    clearTimeout(hiding);
    hiding = setTimeout(() => (told.hidden = true), TOLD_MS);
  }

  const asset = () => (shown.name === null ? null : session.asset(shown.name));

  async function pressed() {
    const rover = asset();
    if (!rover) return tell("There is no rover to stop.", "bad");
    if (rover.recording) return tell(`${rover.name} is a recording: choose the rover that is to stop.`, "bad");
    stop.classList.add("pressed");
    tell(`STOP is being sent to ${rover.name} …`, "bad");
    try {
      await stopRover(rover.name);
      tell(`STOP was sent to ${rover.name}. It stays stopped until “resume”.`, "good");
    } catch (error) {
      tell(`STOP may not have reached ${rover.name}: ${error.message}. Press it again.`, "bad");
    } finally {
      stop.classList.remove("pressed");
    }
  }

  function toggleAlarms() {
    if (list.hidden) unmountAlarms = alarms.mount(list, { session, asset: null });
    else unmountAlarms();
    list.hidden = !list.hidden;
    alarm.setAttribute("aria-expanded", String(!list.hidden));
  }
  let unmountAlarms = () => {};

  function drawAlarms() {
    const standing = [...session.alarms.values()];
    const open = standing.filter(alarms.isUnacknowledged);
    say(alarm, `${open.length || standing.length || "no"} alarm${(open.length || standing.length) === 1 ? "" : "s"}${standing.length && !open.length ? " acknowledged" : ""}`);
    const worst = open.some((each) => each.severity !== "WARNING") ? "alarm" : open.length ? "warning" : "none";
    set(alarm, { "data-worst": worst, "data-open": open.length });
  }

  async function act(what, more = {}) {
    const rover = asset();
    try {
      await ask(`/api/authority/${encodeURIComponent(rover.name)}`, { json: { act: what, ...more } });
    } catch (error) {
      tell(error.message, "bad");
    }
  }

  function rename() {
    const next = prompt("Under which name do you command?", operator.name)?.trim();
    if (!next || next === operator.name) return;
    operator.name = next;
    location.reload();
  }

  function render() {
    const rover = asset();
    const names = session.rovers.map((each) => each.name);
    picker.hidden = names.length === 0;
    keep(picker, names, (each) => each, (each) => html("option", { value: each, textContent: each }), () => {});
    if (shown.name !== null && picker.value !== shown.name) picker.value = shown.name;
    const recording = rover?.recording;
    say(mode, recording ? "RECORDING" : (rover?.mode ?? ""));
    mode.hidden = !mode.textContent;
    resume.hidden = Boolean(recording) || !STANDING.includes(rover?.mode ?? "");
    mode.dataset.mode = rover?.mode ?? "";
    say(doing, recording ? `of ${recording.rover}, to be looked at only${recording.whole ? "" : recording.damaged ? "; it is damaged" : "; it breaks off"}` : rover ? doingOf(rover) : session.unreached());
    keep(links, rover ? [...rover.links.values()] : [], (link) => link.link, () => html("span", { className: "link" }), drawLink);
    drawAuthority(rover);
    drawAlarms();
    say(name, operator.name);
    const others = session.presence.length - 1;
    say(pages, others > 0 ? `and ${others} more page${others > 1 ? "s" : ""}` : "alone here");
    set(pages, { title: session.presence.map((each) => `${each.operator} since ${clock(each.since)}`).join("\n") });
    stop.disabled = rover === null;
    stop.hidden = Boolean(recording);
    lost.hidden = session.connection.status !== "lost";
    if (!lost.hidden) {
      const ago = age((Date.now() - session.connection.since_ms) / 1000);
      say(lost, `No connection to rover-console for ${ago === "now" ? "a moment" : ago}. What you see is old; STOP is still tried.`);
    }
  }

  function drawLink(element, link) {
    const heard = link.heard === null ? "" : age(session.now - Math.max(link.heard, lastHeard(link)));
    element.dataset.state = link.state;
    say(element, `${link.link} ${link.state === "up" ? "" : link.state}`.trim());
    set(element, { title: `${link.uri}\n${link.state} since ${clock(link.since)}${link.detail ? `: ${link.detail}` : ""}\nheard ${heard || "never"}` });
  }

  function lastHeard(link) {
    let last = 0;
    for (const samples of asset()?.values.values() ?? []) last = Math.max(last, samples.get(link.link)?.rx ?? 0);
    return last;
  }

  /** Who commands, and what may be asked for; a button stays the same while somebody presses it. */
  function drawAuthority(rover) {
    const held = rover?.authority;
    const mine = held?.holder === operator.name;
    keep(authority, held ? [held] : [], () => "holder", () => html("span", { "data-testid": "holder" }), drawHolder);
    const acts = [];
    if (mine && held.asked_by && held.asked_by !== operator.name) acts.push(["hand_over", held.asked_by]);
    if (mine) acts.push(["release"]);
    if (held && !mine) acts.push(["request"]);
    if (held?.holder && !mine) acts.push(["take"]);
    keep(buttons, acts, (each) => each.join(" "), makeAct, (button, [what]) => {
      const isAsked = what === "request" && held.asked_by === operator.name;
      if (what === "request") say(button, isAsked ? "asked for" : "request");
    });
  }

  function drawHolder(element, held) {
    const mine = held.holder === operator.name;
    const nobody = held.needed ? "nobody commands" : "anyone may command";
    const left = Math.max(0, held.lease_left - (session.now - held.utc));
    say(element, mine ? "you command" : held.holder ? `${held.holder} commands` : nobody);
    element.className = `holder ${mine ? "mine" : held.holder ? "other" : "none"}`;
    set(element, { title: held.holder ? `lease of ${age(held.lease)}, ${age(left)} left, grant ${held.epoch}` : "" });
  }

  function makeAct([what, to]) {
    const [words, title] = ACTS[what];
    const more = to ? { to } : {};
    return html("button", { type: "button", textContent: to ? `${words} ${to}` : words, title, onclick: () => act(what, more) });
  }

  function onKey(event) {
    if (!STOP_KEYS.includes(event.key) || event.repeat) return;
    event.preventDefault();
    event.stopPropagation();
    pressed();
  }

  const draw = eachFrame(render);
  const offs = new Map();
  function watch() {
    for (const rover of session.rovers) {
      if (offs.has(rover)) continue;
      const topics = ["links", "authority", "status", "tree", "commands", "entry"];
      offs.set(rover, topics.map((topic) => rover.on(topic, draw)));
    }
    draw();
  }
  const ends = [
    session.on("assets", watch),
    session.on("presence", draw),
    session.on("alarms", draw),
    session.onSecond(draw),
    session.connection.on(draw),
  ];
  addEventListener("keydown", onKey, { capture: true });
  watch();
  return () => {
    removeEventListener("keydown", onKey, { capture: true });
    [...ends, ...[...offs.values()].flat()].forEach((off) => off());
    clearTimeout(hiding);
    unmountAlarms();
    root.remove();
  };
}

/** Send a stop, and again while the server cannot be reached. @param {string} name */
async function stopRover(name) {
  for (let attempt = 1; ; attempt++) {
    try {
      return await ask(`/api/stop/${encodeURIComponent(name)}`, { json: {}, keepalive: true });
    } catch (error) {
      if (error.status !== 0 || attempt === RETRIES) throw error;
      await new Promise((done) => setTimeout(done, RETRY_MS));
    }
  }
}

/** @param {Asset} rover */
function doingOf(rover) {
  const work = rover.activeCommand?.name ?? rover.status?.plan ?? "";
  const queued = rover.status?.queued ? `, ${rover.status.queued} waiting` : "";
  return `${work}${queued}`;
}
