/**
 * The status bar above every page: STOP, authority, states of the links, alarms, open pages, and the
 * connection of this page. It is in the top layer, above all dialogs and overlays, which begin below it.
 */

import { AlarmsView, isAcknowledged, needsAction } from "./alarms.js";
import { fetchJson, newId, operator } from "../model/connection.js";
import { button, html, reconcile, setText, set } from "../dom.js";
import { themeButton } from "../theme.js";
import { beep } from "../sound.js";
import { setTitle } from "../title.js";
import { Questions } from "./questions.js";
import { Shortcuts, isStopKey } from "./shortcuts.js";
import { Stops } from "./stops.js";
import { View } from "./view.js";
import { age, clock, number } from "../format.js";
import { NOTICEABLE_S } from "../model/asset.js";

/** @import { Asset } from "../model/asset.js" */
/** @import { AuthorityMessage, CommandStatus, LinkStatus } from "../model/messages.js" */

const TOPICS = ["links", "authority", "status", "tree", "plans", "entry"];
const MESSAGE_MS = 8000;

export class StatusBar extends View {
  #hiding = 0;
  /** number of alarms that needed an action at the last drawing */
  #alarmed = 0;
  /** @type {Map<Asset, (() => void)[]>} the functions that end the subscriptions */
  #watched = new Map();
  #unmountAlarms = () => {};

  #picker = html("select", { "aria-label": "rover", onchange: () => this.shown.choose(this.#picker.value) });
  #mode = html("span", { className: "mode", "data-testid": "mode" });
  #doing = html("span", { className: "doing" });
  #resume = button("", "send this command", () => this.#onResume(), { className: "resume" });
  /** id of the last command of the resume button */
  #resumed = "";
  #links = html("span", { className: "links" });
  #authority = new Authority((text, level) => this.#showMessage(text, level));
  #stops = new Stops(this.draw, (text, level) => this.#showMessage(text, level));
  #questions = new Questions(this.draw, (text, level) => this.#showMessage(text, level));
  #pages = html("span", { className: "pages dim" });
  #name = button("", "operator name; click to change it", () => this.#editName(true), { className: "operator" });
  #newName = html("input", { type: "text", "aria-label": "operator name", hidden: true, onkeydown: (event) => this.#onNameKey(event), onblur: () => this.#editName(false) });
  #stop = html(
    "button",
    { type: "button", className: "stop", "data-testid": "stop", title: "F8, Pause or Ctrl+Space" },
    html("b", { textContent: "STOP" }),
    html("small", { textContent: "F8" }),
  );
  #alarm = button("", "alarms of all rovers; click to show and acknowledge them", () => this.#toggleAlarms(), { className: "alarms", "data-testid": "alarms" });
  #list = html("div", { className: "alarm-list", hidden: true });
  #shortcuts = new Shortcuts();
  #message = html("div", { className: "message", role: "alert", hidden: true });
  #lost = html("div", { className: "lost", role: "alert", hidden: true });
  #identity = html("span", { className: "identity" }, this.#name, this.#newName, this.#pages, themeButton(), this.#shortcuts.button, html("a", { href: "/help", target: "rover-help", title: "documentation of the console", textContent: "help" }));
  #bar = html(
    "header",
    { className: "rover-bar", popover: "manual" },
    html("div", { className: "row" }, this.#picker, this.#mode, this.#resume, this.#doing, this.#links, this.#authority.element, this.#identity, this.#alarm, this.#stop),
    this.#list,
    this.#stops.element,
    this.#questions.element,
    this.#authority.notice,
    this.#shortcuts.element,
    this.#message,
    this.#lost,
  );
  /** Space of the bar in the page: an element in the top layer takes none. */
  root = html("div", { className: "bar-space" }, this.#bar);
  #height = new ResizeObserver(() => document.documentElement.style.setProperty("--bar-height", `${this.#bar.offsetHeight}px`));

  start() {
    const { session, draw } = this;
    const ending = new AbortController();
    const options = { capture: true, signal: ending.signal };
    addEventListener("keydown", (event) => this.#onKey(event), options);
    addEventListener("click", (event) => this.#onClick(event), options);
    addEventListener("toggle", (event) => event.target !== this.#bar && this.#raise(), options);
    addEventListener("fullscreenchange", () => this.#raise(), options);
    this.#raise();
    this.#height.observe(this.#bar);
    this.#watch();
    return [
      session.on("assets", () => this.#watch()),
      session.on("presence", draw),
      session.on("alarms", draw),
      session.on("question", (question) => (this.#questions.onChange(session.asset(question.asset), question), draw())),
      session.onSecond(draw),
      session.connection.on(draw),
      () => ending.abort(),
      () => this.#height.disconnect(),
      () => [...this.#watched.values()].flat().forEach((off) => off()),
      () => clearTimeout(this.#hiding),
      () => this.#unmountAlarms(),
    ];
  }

  /** Subscribe to new rovers. */
  #watch() {
    for (const rover of this.session.rovers) {
      if (this.#watched.has(rover)) continue;
      const onStop = () => (this.#stops.onChange(rover.stop), this.draw());
      const onCommand = (command) => (this.#onCommand(command), this.#questions.onCommand(command), this.draw());
      this.#watched.set(rover, [rover.on("stop", onStop), rover.on("commands", onCommand), ...TOPICS.map((topic) => rover.on(topic, this.draw))]);
    }
    this.draw();
  }

  /** Show a message for MESSAGE_MS. @param {string} text @param {"good" | "bad"} level */
  #showMessage(text, level) {
    setText(this.#message, text);
    this.#message.className = `message ${level}`;
    this.#message.hidden = false;
    clearTimeout(this.#hiding);
    this.#hiding = setTimeout(() => (this.#message.hidden = true), MESSAGE_MS);
  }

  get #rover() {
    return this.shown.name === null ? null : this.session.asset(this.shown.name);
  }

  #onKey(event) {
    if (!isStopKey(event)) return this.#shortcuts.onKey(event);
    event.preventDefault();
    event.stopPropagation();
    if (!event.repeat) this.#onStop();
  }

  /** Put the bar above the elements that have entered the top layer after it. */
  #raise() {
    if (this.#bar.matches(":popover-open")) this.#bar.hidePopover();
    this.#bar.showPopover();
  }

  /**
   * Stop by a click on STOP. An open modal dialog makes STOP inert, so that the click has another target: its position
   * decides. Clicks by keys and scripts (detail 0) have no position.
   */
  #onClick(event) {
    const { left, right, top, bottom } = this.#stop.getBoundingClientRect();
    const { clientX: x, clientY: y, detail } = event;
    const isWithin = detail > 0 && left <= x && x <= right && top <= y && y <= bottom;
    if (this.#stop.disabled || !(isWithin || this.#stop.contains(event.target))) return;
    event.preventDefault();
    event.stopImmediatePropagation();
    this.#onStop();
  }

  #onStop() {
    const rover = this.#rover;
    if (!rover) return this.#showMessage("There is no rover to stop.", "bad");
    if (rover.recording) return this.#showMessage(`${rover.name} is a recording: choose the rover to stop.`, "bad");
    this.#stops.press(rover.name);
  }

  async #onResume() {
    const rover = this.#rover;
    const { label, name, args } = resumptionOf(rover);
    this.#resumed = newId();
    try {
      await fetchJson("/api/commands", { json: { id: this.#resumed, asset: rover.name, name, args } });
      this.#showMessage(`Sent to ${rover.name}: ${label}.`, "good");
    } catch (error) {
      this.#showMessage(`Not sent: ${label}: ${error.message}.`, "bad");
    }
  }

  /** Show that the command of the resume button was refused. @param {CommandStatus} command */
  #onCommand({ id, asset, state, history }) {
    if (id === this.#resumed && ["rejected", "failed"].includes(state)) this.#showMessage(`${asset} refused it: ${history.at(-1).detail}.`, "bad");
  }

  /** Show the field of the operator's name instead of the name. A dialog of the browser would disable STOP. @param {boolean} editing */
  #editName(editing) {
    this.#newName.value = operator.name;
    this.#newName.hidden = !editing;
    this.#name.hidden = editing;
    if (editing) this.#newName.select();
  }

  #onNameKey({ key }) {
    const name = this.#newName.value.trim();
    if (key === "Escape") this.#editName(false);
    if (key !== "Enter" || !name) return;
    this.#editName(false);
    if (name === operator.name) return;
    operator.name = name;
    location.reload();
  }

  #toggleAlarms() {
    if (this.#list.hidden) this.#unmountAlarms = AlarmsView.mount(this.#list, { session: this.session });
    else this.#unmountAlarms();
    this.#list.hidden = !this.#list.hidden;
    this.#alarm.setAttribute("aria-expanded", String(!this.#list.hidden));
  }

  render() {
    const { session } = this;
    const rover = this.#rover;
    setTitle("rover", this.shown.name ?? "");
    this.#drawPicker();
    this.#drawMode(rover);
    reconcile(this.#links, [...(rover?.links.values() ?? [])], ({ link }) => link, () => html("span", { className: "link" }), (element, link) => this.#drawLink(element, link));
    this.#authority.render(rover, session.now);
    this.#stops.render(session);
    this.#questions.render(session);
    this.#drawAlarms();
    setText(this.#name, operator.name);
    const others = session.presence.length - 1;
    setText(this.#pages, others > 0 ? `and ${others} more page${others > 1 ? "s" : ""}` : "no other page");
    set(this.#pages, { title: session.presence.map((each) => `${each.operator} since ${clock(each.since)}`).join("\n") });
    this.#stop.disabled = rover === null;
    this.#stop.hidden = Boolean(rover?.recording);
    this.#drawLoss(rover);
  }

  /** Show the loss of the console, or of all links of the rover. @param {Asset | null} rover */
  #drawLoss(rover) {
    const { connection, now } = this.session;
    const isConsoleLost = connection.status === "lost";
    const isLost = Boolean(rover?.isLost);
    this.#lost.hidden = !isConsoleLost && !isLost;
    this.#lost.classList.toggle("alarm", !isConsoleLost);
    setTitle("link", isConsoleLost ? "⚠ no console" : isLost ? "⚠ no link" : "");
    if (isConsoleLost) setText(this.#lost, `No connection to rover-console for ${ageOf((Date.now() - connection.since_ms) / 1000)}. The page is out of date; STOP is still attempted.`);
    else if (isLost) setText(this.#lost, `No link to ${rover.name} for ${ageOf(now - rover.lastReceived)}. Last state: ${[rover.mode, doingOf(rover)].filter(Boolean).join(" ")}. STOP is sent as soon as a link is up.`);
  }

  #drawPicker() {
    const names = this.session.rovers.map((each) => each.name);
    this.#picker.hidden = names.length === 0;
    reconcile(this.#picker, names, String, (each) => html("option", { value: each, textContent: each }));
    if (this.shown.name !== null && this.#picker.value !== this.shown.name) this.#picker.value = this.shown.name;
  }

  /** @param {Asset | null} rover */
  #drawMode(rover) {
    const mode = rover?.mode ?? "";
    const isRecording = Boolean(rover?.recording);
    const isLost = Boolean(rover?.isLost);
    const lastMode = mode && isLost ? `${mode} ${ageOf(this.session.now - rover.lastReceived)} ago` : mode;
    setText(this.#mode, isRecording ? "RECORDING" : lastMode);
    this.#mode.hidden = !this.#mode.textContent;
    set(this.#mode, { "data-mode": mode, "data-stale": isLost });
    const resumption = rover && !isRecording && !isLost ? resumptionOf(rover) : null;
    this.#resume.hidden = resumption === null;
    setText(this.#resume, resumption?.label ?? "");
    setText(this.#doing, rover ? doingOf(rover) : this.session.unreached());
  }

  /** @param {HTMLElement} element @param {LinkStatus} status */
  #drawLink(element, status) {
    const { link, state, uri, since, detail, last_received: lastReceived } = status;
    const roundTrip_s = this.#rover.roundTripOf(status);
    const last = Math.max(lastReceived, ...[...this.#rover.values.values()].map((samples) => samples.get(link)?.rx ?? 0));
    element.dataset.state = state;
    const delay = roundTrip_s >= NOTICEABLE_S ? `${number(Math.round(10 * roundTrip_s) / 10)} s round trip` : "";
    setText(element, [link, state === "up" ? "" : state, delay].filter(Boolean).join(" "));
    const received = lastReceived === null ? "never" : age(this.session.now - last);
    set(element, { title: `${uri}\n${state} since ${clock(since)}${detail ? `: ${detail}` : ""}\nlast received: ${received}` });
  }

  #drawAlarms() {
    const openAlarms = [...this.session.alarms.values()];
    const unacknowledged = openAlarms.filter((each) => needsAction(each, this.session.now));
    setTitle("alarms", unacknowledged.length ? `(${unacknowledged.length})` : "");
    if (unacknowledged.length > this.#alarmed) beep();
    this.#alarmed = unacknowledged.length;
    const count = unacknowledged.length || openAlarms.length;
    setText(this.#alarm, `${count || "no"} alarm${count === 1 ? "" : "s"}${count && !unacknowledged.length ? (openAlarms.every(isAcknowledged) ? " acknowledged" : " shelved") : ""}`);
    const worst = unacknowledged.some((each) => each.severity !== "WARNING") ? "alarm" : unacknowledged.length ? "warning" : "none";
    set(this.#alarm, { "data-worst": worst, "data-open": unacknowledged.length });
  }
}

/** @param {number} age_s */
const ageOf = (age_s) => (age(age_s) === "now" ? "a moment" : age(age_s));

/** The command that lets a rover continue, and its label; null if nothing holds the rover. @param {Asset} rover @returns {{label: string, name: string, args: Record<string, any>} | null} */
function resumptionOf({ mode, plans }) {
  const release = { STOPPED: "release the stop", SAFE: "leave safe mode" }[mode];
  if (release) return { label: release, name: "resume", args: {} };
  if (mode !== "PAUSED") return null;
  const plan = [...plans.values()].find((each) => each.status === "SUSPENDED");
  if (!plan) return { label: "resume the motion", name: "resume", args: {} };
  const step = plan.node?.split("/").at(-1);
  return { label: `resume plan ${plan.plan}${step ? ` at ${step}` : ""}`, name: "resumePlan", args: { plan_id: plan.plan } };
}

/** @param {Asset} rover */
function doingOf({ recording, mode, lastStop, activeCommand, motionText, status }) {
  if (recording) return `of ${recording.rover}, view only${recording.complete ? "" : recording.damaged ? "; damaged" : "; incomplete"}`;
  if (mode === "STOPPED" && lastStop) return `stopped by ${lastStop.by}`;
  const motion = activeCommand && motionText ? `: ${motionText}` : "";
  return `${activeCommand?.name ?? status?.plan ?? ""}${motion}${status?.queued ? `, ${status.queued} queued` : ""}`;
}

const ACTS = {
  request: ["request", "request the authority"],
  take: ["take", "take the authority from its holder, if the rover's settings permit it"],
  hand_over: ["hand over to", "hand over the authority"],
  release: ["release", "release the authority"],
};

/** The authority over a rover, and the actions on it. Buttons are reused, so that a press is not lost. */
class Authority {
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
