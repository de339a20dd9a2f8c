/** What this page knows of one asset, told to the views by topics. */

import { Topics } from "./observable.js";

/** @import { AssetEntry, AssetState, AuthorityMessage, CommandStatus, LinkStatus, Notified, PlanProgress, Sample, Transfer, TreeState } from "./messages.js" */
/** @typedef {Sample & {interval?: number}} Latest `interval`: seconds since the one before */
/** @typedef {{utc: number, x: number, y: number, heading: number}} Fix */

const CONSOLE = "rover-console";
const POSE = ["POS_X", "POS_Y", "HEAD"];
/** How far it may be from its pose: m, rad. */
export const UNCERTAINTY = ["EXEC_POSITION_UNCERTAINTY", "EXEC_HEADING_UNCERTAINTY"];
/** Less is none. */
const CERTAIN = [0.01, 0.005];
const MOST_FIXES = 20000;
const MOST_NOTICES = 2000;
const UNKNOWN_FOOTPRINT = { length_m: 0.5, width_m: 0.4 };
const MOST_WAITING = 50;

/** @extends {Topics<string>} */
export class Asset extends Topics {
  /** @type {Map<string, Set<string>>} the paths of the nodes that worked on each command, by SOURCE:NUMBER */
  #nodes = new Map();
  #fixes = new Map();
  /** @type {Fix | null} the last one that came in time; null while none did, and when the clock aboard was set back */
  #lastFix = null;
  /** @type {AssetEntry | null} its entry in the dictionary; null until it is known */
  entry = null;
  /** @type {Map<string, Map<string, Latest>>} the newest of each parameter, by link */
  values = new Map();
  /** @type {Fix[]} where it was, in the order of time */
  track = [];
  /** @type {Map<string, {utc: number, value: any}[]>} how uncertain its pose was, where that changed */
  #uncertainty = new Map(UNCERTAINTY.map((key) => [key, []]));
  /** @type {Map<string, CommandStatus>} */
  commands = new Map();
  /** @type {Notified[]} in the order of time */
  notices = [];
  /** @type {Map<string, LinkStatus>} by link */
  links = new Map();
  /** @type {AuthorityMessage | null} who may command it; null until it is known */
  authority = null;
  /** @type {AssetState | null} mode, command under way, plan; null until it is known */
  status = null;
  /** @type {TreeState | null} */
  tree = null;
  /** @type {Map<string, PlanProgress>} how far each plan is */
  plans = new Map();
  /** @type {Map<string, Transfer>} how each transfer of a file of it is, by its id */
  transfers = new Map();

  /** what it keeps away from */
  get zones() {
    return this.entry?.zones ?? [];
  }

  get footprint() {
    return this.entry?.footprint ?? UNKNOWN_FOOTPRINT;
  }

  /** what it is a recording of; null for a rover */
  get recording() {
    return this.entry?.recording ?? null;
  }

  /** Whether it is the console itself, which tells of itself as a rover does, and cannot be commanded. */
  get isConsole() {
    return this.name === CONSOLE;
  }

  /** The links by which values are told. @returns {string[]} */
  get valueLinks() {
    if (this.isConsole) return ["console"];
    return this.recording ? ["recording"] : [...this.links.keys()].sort();
  }

  /** @param {string} name @param {AssetEntry | null} [entry] */
  constructor(name, entry = null) {
    super();
    this.name = name;
    this.entry = entry;
  }

  /** @param {Sample} sample */
  addSample(sample) {
    const links = this.values.get(sample.key) ?? new Map();
    this.values.set(sample.key, links);
    const last = links.get(sample.link);
    if (last && sample.utc < last.utc && sample.q !== "late") this.#forgetAfter(sample.utc);
    if (!last || sample.q !== "late") links.set(sample.link, { ...sample, interval: intervalOf(last, sample) });
    if (POSE.includes(sample.key)) this.#addToFix(sample);
    if (UNCERTAINTY.includes(sample.key)) this.addUncertainty(sample.key, [sample]);
    this.changed("sample", sample);
    this.changed("values");
  }

  /** Forget what is newest by a clock aboard that was set back. @param {number} utc */
  #forgetAfter(utc) {
    for (const links of this.values.values()) {
      for (const [link, sample] of links) if (sample.utc > utc) links.delete(link);
    }
    this.#fixes.clear();
    this.#lastFix = null;
  }

  /** The newest sample of a parameter by whatever link. @param {string} key */
  newest(key) {
    return newestOf(this.values.get(key));
  }

  /** A fix is complete when all its figures of one moment are there. */
  #addToFix(sample) {
    if (typeof sample.value !== "number") return;
    const fix = this.#fixes.get(sample.utc) ?? {};
    fix[sample.key] = sample.value;
    this.#fixes.set(sample.utc, fix);
    if (this.#fixes.size > MOST_WAITING) this.#fixes.delete(this.#fixes.keys().next().value);
    if (!POSE.every((key) => key in fix)) return;
    this.#fixes.delete(sample.utc);
    const whole = { utc: sample.utc, x: fix.POS_X, y: fix.POS_Y, heading: fix.HEAD };
    if (sample.q !== "late" && whole.utc >= (this.#lastFix?.utc ?? 0)) this.#lastFix = whole;
    this.addFixes([whole]);
  }

  /** Put fixes where they belong in time. @param {Fix[]} fixes in the order of time */
  addFixes(fixes) {
    for (const fix of fixes) {
      let place = this.track.length;
      while (place > 0 && this.track[place - 1].utc > fix.utc) place--;
      if (this.track[place - 1]?.utc !== fix.utc) this.track.splice(place, 0, fix);
    }
    if (this.track.length > MOST_FIXES) this.track.splice(0, this.track.length - MOST_FIXES);
    this.changed("track");
  }

  /** Where it was last known to be. */
  get pose() {
    return this.#lastFix ?? this.track.at(-1) ?? null;
  }

  /** The last fix until a moment. @param {number} utc */
  poseAt(utc) {
    return this.track.findLast((each) => each.utc <= utc) ?? null;
  }

  /** @param {string} key @param {{utc: number, value: any}[]} samples where one is not known, the one before holds */
  addUncertainty(key, samples) {
    const known = samples.filter((each) => typeof each.value === "number");
    const all = [...this.#uncertainty.get(key), ...known].sort((one, other) => one.utc - other.utc);
    const changes = all.filter((each, index) => each.value !== all[index - 1]?.value);
    this.#uncertainty.set(key, changes.slice(-MOST_FIXES));
    this.changed("track");
  }

  /** How uncertain its pose is, or was at a moment; null where it is certain, or nothing is known. @param {number | null} utc null for now */
  uncertaintyAt(utc) {
    const [position_m, heading_rad] = UNCERTAINTY.map((key) => {
      const now = utc === null ? this.newest(key)?.value : null;
      return now ?? this.#uncertainty.get(key).findLast((each) => each.utc <= (utc ?? Infinity))?.value ?? 0;
    });
    return position_m >= CERTAIN[0] || heading_rad >= CERTAIN[1] ? { position_m, heading_rad } : null;
  }

  /** @param {CommandStatus} command */
  setCommand(command) {
    const former = this.commandOf(`${command.source}:${command.number}`);
    if (former && former.id !== command.id) this.commands.delete(former.id); // heard of before it was known who posted it
    this.commands.set(command.id, command);
    this.changed("commands", command);
  }

  /** The command that the rover knows by SOURCE:NUMBER. @param {string} identity */
  commandOf(identity) {
    for (const each of this.commands.values()) if (identity === `${each.source}:${each.number}`) return each;
    return null;
  }

  /** Note which nodes of a tree worked on which commands. @param {TreeState} tree */
  noteNodes(tree) {
    for (const { command, path } of tree.nodes) {
      if (command === null) continue;
      if (!this.#nodes.has(command)) this.#nodes.set(command, new Set());
      this.#nodes.get(command).add(path);
    }
  }

  /** The paths of the nodes that worked on a command, as far as that was heard. @param {CommandStatus} command @returns {string[]} */
  nodesOf(command) {
    return [...(this.#nodes.get(`${command.source}:${command.number}`) ?? [])];
  }

  /** Commands, the last first. */
  get lastCommands() {
    return [...this.commands.values()].sort((one, other) => other.made - one.made);
  }

  /** Commands, the last first, each as it was at a moment; those that came later as they became. @param {number | null} utc null for now */
  commandsAt(utc) {
    return utc === null ? this.lastCommands : this.lastCommands.map((each) => (each.made <= utc ? commandAt(each, utc) : each));
  }

  /** The mode, by whatever told of it last; empty while it is not known. */
  get mode() {
    return (this.#isTreeNewer ? this.tree?.mode : this.status?.mode) ?? "";
  }

  /** The command under way; null for none, and for one that is not known here. */
  get activeCommand() {
    const active = this.#isTreeNewer ? this.tree?.active : this.status?.active;
    if (!active) return null;
    const names = (each) => [each.id, `${each.source}:${each.number}`, String(each.number)];
    return this.lastCommands.find((each) => names(each).includes(active)) ?? null;
  }

  get #isTreeNewer() {
    return this.tree !== null && this.tree.utc >= (this.status?.utc ?? 0);
  }

  /** When a command began to be carried out, and when it ended. @param {CommandStatus} command */
  spanOf(command) {
    const reached = (stage) => command.history.find((each) => each.stage === stage);
    const began = reached("STARTED") ?? reached("ACCEPTED");
    if (!began) return null;
    const last = command.history.at(-1);
    return [began.utc, command.ended ? last.utc : Infinity];
  }

  /** Add notifications; the same one may come by both links, and numbers start anew with a new ledger. @param {Notified[]} notices */
  addNotices(notices) {
    for (const notice of notices) {
      let place = this.notices.length;
      while (place > 0 && isAfter(this.notices[place - 1], notice)) place--;
      const before = this.notices[place - 1];
      const known = before?.sequence === notice.sequence && before.utc === notice.utc && before.command === notice.command;
      if (!known) this.notices.splice(place, 0, notice);
    }
    if (this.notices.length > MOST_NOTICES) this.notices.splice(0, this.notices.length - MOST_NOTICES);
    this.changed("notices");
  }

  /** Whether anything can be heard of it now. */
  get isReached() {
    return [...this.links.values()].some((link) => link.state === "up");
  }
}

/** @param {Latest | undefined} last @param {Sample} sample @returns {number | undefined} */
function intervalOf(last, sample) {
  if (!last || sample.utc < last.utc) return undefined;
  return sample.utc - last.utc || last.interval;
}

/** The newest sample of several links. @param {Map<string, Latest>} [links] */
export function newestOf(links) {
  let best = null;
  for (const sample of links?.values() ?? []) if (!best || sample.utc > best.utc) best = sample;
  return best;
}

/** How stages that are no states are told. */
const STATES = { SENT: "sending", PROGRESS: "started", PREDICTED: null };

/** A command as it was at a moment. @param {CommandStatus} command @param {number} utc @returns {CommandStatus} */
function commandAt(command, utc) {
  const history = command.history.filter((each) => each.utc <= utc);
  if (history.length === command.history.length) return command;
  const states = history.map((each) => (each.stage in STATES ? STATES[each.stage] : each.stage.toLowerCase()));
  return { ...command, history, ended: false, state: states.findLast(Boolean) ?? "sending" };
}

/** @param {Notified} one @param {Notified} other */
const isAfter = (one, other) => one.utc > other.utc || (one.utc === other.utc && one.sequence > other.sequence);
