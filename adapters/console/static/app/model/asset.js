/** State of one asset on this page. Views subscribe to its topics. */

import { Topics } from "./observable.js";

/** @import { AssetEntry, AssetState, AuthorityMessage, CommandStatus, LinkStatus, NotificationMessage, PlanProgress, PosePrediction, QuestionStatus, Sample, StopStatus, Transfer, TreeState } from "./messages.js" */
/** @typedef {Sample & {interval?: number}} Latest `interval`: seconds since the previous sample */
/** @typedef {{utc: number, x: number, y: number, heading: number}} Fix */
/** @typedef {{x: number, y: number}} Point */
/** @typedef {Point & {heading: number}} Frame origin and heading in another frame */

const CONSOLE = "rover-console";
const POSE = ["POS_X", "POS_Y", "HEAD"];
/** Parameters of the pose uncertainty: m, rad. */
const UNCERTAINTY = ["EXEC_POSITION_UNCERTAINTY", "EXEC_HEADING_UNCERTAINTY"];
/** Parameters of the origin of the map in the odometry frame: m, m, rad. */
const MAP_ORIGIN = ["EXEC_MAP_X", "EXEC_MAP_Y", "EXEC_MAP_HEADING"];
/** Parameters with a stored history of changes, to show the past. */
export const STORED = [...UNCERTAINTY, ...MAP_ORIGIN];
/** Smaller uncertainties are not shown: m, rad; chosen, not measured. */
const MIN_UNCERTAINTY = [0.01, 0.005];
/** Minimum round-trip time of a delayed link, s, as in adapters/mrs/ground/session.py. */
export const NOTICEABLE_S = 1;
const MAX_FIXES = 20000;
const MAX_NOTICES = 2000;
/** Limit of the commands; beyond it the earliest received one that has ended is discarded. */
const MAX_COMMANDS = 3000;
/** Number of the reason of a replaced motion. */
const REPLACED = 802;
const UNKNOWN_FOOTPRINT = { length_m: 0.5, width_m: 0.4 };
const MAX_PENDING_FIXES = 50;

/** @extends {Topics<string>} */
export class Asset extends Topics {
  /** @type {Map<string, Set<string>>} the paths of the nodes that executed each command, by SOURCE:NUMBER */
  #nodes = new Map();
  #fixes = new Map();
  /** @type {Fix | null} the last fix that was not late; null before the first, and after the onboard clock was set back */
  #lastFix = null;
  /** @type {AssetEntry | null} its entry in the dictionary; null until received */
  entry = null;
  /** @type {Map<string, Map<string, Latest>>} the newest sample of each parameter, by link */
  values = new Map();
  /** @type {Fix[]} the driven track, in the order of time */
  track = [];
  /** @type {Map<string, {utc: number, value: any}[]>} changes of the stored parameters */
  #stored = new Map(STORED.map((key) => [key, []]));
  /** @type {Map<string, CommandStatus>} */
  commands = new Map();
  /** @type {NotificationMessage[]} in the order of time */
  notices = [];
  /** @type {Map<string, LinkStatus>} by link */
  links = new Map();
  /** @type {AuthorityMessage | null} the authority over it; null until received */
  authority = null;
  /** @type {StopStatus | null} the last stop that an operator pressed; null until received */
  stop = null;
  /** @type {AssetState | null} mode, active command, plan; null until received */
  status = null;
  /** @type {TreeState | null} */
  tree = null;
  /** @type {PosePrediction | null} where the next command finds it; null until received */
  prediction = null;
  /** @type {Map<string, PlanProgress>} progress of each plan */
  plans = new Map();
  /** @type {Map<string, QuestionStatus>} open questions of its plans, by plan and question */
  questions = new Map();
  /** @type {Map<string, Transfer>} transfers of its files, by id */
  transfers = new Map();

  /** Keep-in zones, keep-out zones and rocks. */
  get zones() {
    return this.entry?.zones ?? [];
  }

  get footprint() {
    return this.entry?.footprint ?? UNKNOWN_FOOTPRINT;
  }

  /** Entry of the recording; null for a rover. */
  get recording() {
    return this.entry?.recording ?? null;
  }

  /** Whether it is the console itself, which sends telemetry as a rover does and cannot be commanded. */
  get isConsole() {
    return this.name === CONSOLE;
  }

  /** The links that carry values. @returns {string[]} */
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
    if (last && sample.utc < last.utc && sample.q !== "late") this.#discardAfter(sample.utc);
    if (!last || sample.q !== "late") links.set(sample.link, { ...sample, interval: intervalOf(last, sample) });
    if (POSE.includes(sample.key)) this.#addToFix(sample);
    if (STORED.includes(sample.key)) this.store(sample.key, [sample]);
    this.changed("sample", sample);
    this.changed("values");
  }

  /** Discard samples with later stamps, after the onboard clock was set back. @param {number} utc */
  #discardAfter(utc) {
    for (const links of this.values.values()) {
      for (const [link, sample] of links) if (sample.utc > utc) links.delete(link);
    }
    this.#fixes.clear();
    this.#lastFix = null;
  }

  /** The newest sample of a parameter over all links. @param {string} key */
  newest(key) {
    return newestOf(this.values.get(key));
  }

  /** Join samples with the same stamp to a fix, once all its coordinates are received. */
  #addToFix(sample) {
    if (typeof sample.value !== "number") return;
    const fix = this.#fixes.get(sample.utc) ?? {};
    fix[sample.key] = sample.value;
    this.#fixes.set(sample.utc, fix);
    if (this.#fixes.size > MAX_PENDING_FIXES) this.#fixes.delete(this.#fixes.keys().next().value);
    if (!POSE.every((key) => key in fix)) return;
    this.#fixes.delete(sample.utc);
    const whole = { utc: sample.utc, x: fix.POS_X, y: fix.POS_Y, heading: fix.HEAD };
    if (sample.q !== "late" && whole.utc >= (this.#lastFix?.utc ?? 0)) this.#lastFix = whole;
    this.addFixes([whole]);
  }

  /** Insert fixes into the track by their stamps. @param {Fix[]} fixes in the order of time */
  addFixes(fixes) {
    for (const fix of fixes) {
      let index = this.track.length;
      while (index > 0 && this.track[index - 1].utc > fix.utc) index--;
      if (this.track[index - 1]?.utc !== fix.utc) this.track.splice(index, 0, fix);
    }
    if (this.track.length > MAX_FIXES) this.track.splice(0, this.track.length - MAX_FIXES);
    this.changed("track");
  }

  /** The last known pose. */
  get pose() {
    return this.#lastFix ?? this.track.at(-1) ?? null;
  }

  /** The last fix at or before a time. @param {number} utc */
  poseAt(utc) {
    return this.track.findLast((each) => each.utc <= utc) ?? null;
  }

  /** @param {string} key @param {{utc: number, value: any}[]} samples without a number are skipped: the previous one holds */
  store(key, samples) {
    const known = samples.filter((each) => typeof each.value === "number");
    const all = [...this.#stored.get(key), ...known].sort((one, other) => one.utc - other.utc);
    const changes = all.filter((each, index) => each.value !== all[index - 1]?.value);
    this.#stored.set(key, changes.slice(-MAX_FIXES));
    this.changed("track");
  }

  /** The pose uncertainty now or at a time; null below the threshold or if unknown. @param {number | null} utc null for now */
  uncertaintyAt(utc) {
    const [position_m, heading_rad] = UNCERTAINTY.map((key) => this.#storedAt(key, utc) ?? 0);
    return position_m >= MIN_UNCERTAINTY[0] || heading_rad >= MIN_UNCERTAINTY[1] ? { position_m, heading_rad } : null;
  }

  /** The value of a stored parameter, now or at a time; undefined if unknown. @param {string} key @param {number | null} utc null for now */
  #storedAt(key, utc) {
    const now = utc === null ? this.newest(key)?.value : null;
    return now ?? this.#stored.get(key).findLast((each) => each.utc <= (utc ?? Infinity))?.value;
  }

  /** The last known origin of the map in the odometry frame; null if unknown. @param {number | null} utc null for now */
  mapOriginAt(utc) {
    const [x, y, heading] = MAP_ORIGIN.map((key) => this.#storedAt(key, utc));
    return heading === undefined ? null : { x, y, heading };
  }

  /** The points of a command in the odometry frame, which the map shows; none if they are in the map and its origin is unknown. @template {Point} P @param {P[]} points @param {string | undefined} frame of the command @param {number | null} utc null for now @returns {P[]} */
  inOdometry(points, frame, utc) {
    if ((frame ?? this.entry?.frame) !== "map") return points;
    const origin = this.mapOriginAt(utc);
    return origin === null ? [] : points.map((each) => ({ ...each, ...composed(origin, each) }));
  }

  /** A point of the odometry frame in that of a command; null if that is the map and its origin is unknown. @param {Point} point @param {string} [frame] of the command @returns {Point | null} */
  inFrame(point, frame) {
    if ((frame ?? this.entry?.frame) !== "map") return point;
    const origin = this.mapOriginAt(null);
    return origin && composed(inverse(origin), point);
  }

  /** The plans aboard: the reported ones that were not removed since. @returns {Map<string, PlanProgress>} */
  get plansAboard() {
    return new Map([...this.plans].filter(([, each]) => !this.isRemoved(each)));
  }

  /** Whether a plan was removed between a report of it and now, or a time. @param {PlanProgress} progress @param {number | null} [until_s] null for now */
  isRemoved({ plan, utc }, until_s = null) {
    const isWithin = (each) => each.stage === "EXECUTED" && each.utc >= utc && each.utc <= (until_s ?? Infinity);
    return [...this.commands.values()].some(({ name, args, history }) => name === "removePlan" && args?.plan_id === plan && history.some(isWithin));
  }

  /** @param {CommandStatus} command */
  setCommand(command) {
    const former = this.commandOf(`${command.source}:${command.number}`);
    if (former && former.id !== command.id) this.commands.delete(former.id); // received before its sender was known
    this.commands.set(command.id, command);
    if (this.commands.size > MAX_COMMANDS) this.commands.delete([...this.commands.values()].find((each) => each.ended)?.id);
    this.changed("commands", command);
  }

  /** The command with an identity SOURCE:NUMBER. @param {string} identity */
  commandOf(identity) {
    for (const each of this.commands.values()) if (identity === `${each.source}:${each.number}`) return each;
    return null;
  }

  /** Record which nodes of a tree executed which commands. @param {TreeState} tree */
  noteNodes(tree) {
    for (const { command, path } of tree.nodes) {
      if (command === null) continue;
      if (!this.#nodes.has(command)) this.#nodes.set(command, new Set());
      if (this.#nodes.size > MAX_COMMANDS) this.#nodes.delete(this.#nodes.keys().next().value);
      this.#nodes.get(command).add(path);
    }
  }

  /** The paths of the nodes that executed a command, as far as received. @param {CommandStatus} command @returns {string[]} */
  nodesOf(command) {
    return [...(this.#nodes.get(`${command.source}:${command.number}`) ?? [])];
  }

  /** Commands, newest first. */
  get lastCommands() {
    return [...this.commands.values()].sort((one, other) => other.created - one.created);
  }

  /** Ids of the drives that the next drive of the same operator continues: driving by keys repeats them, and ends them by zero. @returns {Set<string>} */
  get continuedDrives() {
    const all = this.lastCommands;
    const isContinued = (each, later) =>
      each.name === "drive" && later?.name === "drive" && later.by === each.by && (each.history.at(-1)?.code === REPLACED || (each.state === "executed" && each.args?.duration === 0));
    return new Set(all.filter((each, index) => isContinued(each, all[index - 1])).map((each) => each.id));
  }

  /** Commands, newest first, in their states at a time; later commands in their present states. @param {number | null} utc null for now */
  commandsAt(utc) {
    return utc === null ? this.lastCommands : this.lastCommands.map((each) => (each.created <= utc ? commandAt(each, utc) : each));
  }

  /** The mode of the newer of tree and status; empty until received. */
  get mode() {
    return (this.#isTreeNewer ? this.tree?.mode : this.status?.mode) ?? "";
  }

  /** The active command; null if there is none, or if this page does not know it. */
  get activeCommand() {
    const active = this.#isTreeNewer ? this.tree?.active : this.status?.active;
    if (!active) return null;
    const names = (each) => [each.id, `${each.source}:${each.number}`, String(each.number)];
    return this.lastCommands.find((each) => names(each).includes(active)) ?? null;
  }

  /** The progress of the active motion: its remaining path, or the state of the navigation; empty if none is active. */
  get motionText() {
    const leaf = this.tree?.nodes.findLast(({ kind, status, path }) => kind === "leaf" && status === "running" && path.includes("/motion/"));
    return leaf?.message ?? "";
  }

  /** The last stop without a later resume; null if there is none. */
  get lastStop() {
    const last = this.lastCommands.find(({ name, state }) => ["stop", "resume"].includes(name) && ["started", "executed", "cancelled"].includes(state));
    return last?.name === "stop" ? last : null;
  }

  get #isTreeNewer() {
    return this.tree !== null && this.tree.utc >= (this.status?.utc ?? 0);
  }

  /** Start and end of the execution of a command. @param {CommandStatus} command */
  spanOf(command) {
    const reached = (stage) => command.history.find((each) => each.stage === stage);
    const began = reached("STARTED") ?? reached("ACCEPTED");
    if (!began) return null;
    const last = command.history.at(-1);
    return [began.utc, command.ended ? last.utc : Infinity];
  }

  /** Add notifications. Both links may carry the same one, and a new ledger restarts the numbers. @param {NotificationMessage[]} notices */
  addNotices(notices) {
    for (const notice of notices) {
      let index = this.notices.length;
      while (index > 0 && isAfter(this.notices[index - 1], notice)) index--;
      const before = this.notices[index - 1];
      const known = before?.sequence === notice.sequence && before.utc === notice.utc && before.command === notice.command;
      if (!known) this.notices.splice(index, 0, notice);
    }
    if (this.notices.length > MAX_NOTICES) this.notices.splice(0, this.notices.length - MAX_NOTICES);
    this.changed("notices");
  }

  /** Lead of the onboard clock over that of the console, s; 0 if unknown. */
  get clockLead_s() {
    return Number(this.newest("LINK_CLOCK_OFFSET")?.value ?? 0);
  }

  /** Whether it is a rover without a link that is up. */
  get isLost() {
    return !this.recording && this.links.size > 0 && !this.isReached;
  }

  /** Time of the last reception over any link, before their losses; 0 for never. */
  get lastReceived() {
    return Math.max(0, ...[...this.links.values()].map((link) => link.last_received ?? 0));
  }

  /** Call a listener when it is reached: now, and after each outage. @param {() => void} listener @returns {() => void} ends it */
  onReached(listener) {
    let wasReached = false;
    const update = () => {
      if (this.isReached && !wasReached) listener();
      wasReached = this.isReached;
    };
    update();
    return this.on("links", update);
  }

  /** The default link of commands: the direct one if it is up, else the relay. @returns {LinkStatus | null} */
  get commandLink() {
    const all = ["direct", "relay"].flatMap((kind) => this.links.get(kind) ?? []);
    return all.find((each) => each.state === "up") ?? all[0] ?? null;
  }

  /** The round-trip time of a link, s: the measured one, before that the declared one. @param {LinkStatus | null} [link] */
  roundTripOf(link = this.commandLink) {
    const measured = this.values.get("LINK_ROUND_TRIP")?.get(link?.link ?? "")?.value;
    return typeof measured === "number" ? measured : (link?.round_trip ?? 0);
  }

  get roundTrip_s() {
    return this.roundTripOf();
  }

  /** Whether commands arrive noticeably later than they are sent. */
  get isDelayed() {
    const link = this.commandLink;
    return link?.link === "relay" || (link?.round_trip ?? 0) >= NOTICEABLE_S;
  }

  /** Where a command that is sent now finds it; null if commands arrive at once, or if that time has passed. @param {number} now @returns {PosePrediction | null} */
  predictionAt(now) {
    return this.prediction && this.isDelayed && now < this.prediction.arrival ? this.prediction : null;
  }

  /** Whether at least one of its links is up. */
  get isReached() {
    return [...this.links.values()].some((link) => link.state === "up");
  }
}

/** @param {Latest | undefined} last @param {Sample} sample @returns {number | undefined} */
function intervalOf(last, sample) {
  if (!last || sample.utc < last.utc) return undefined;
  return sample.utc - last.utc || last.interval;
}

/** Return the newest sample of several links. @param {Map<string, Latest>} [links] */
export function newestOf(links) {
  let best = null;
  for (const sample of links?.values() ?? []) if (!best || sample.utc > best.utc) best = sample;
  return best;
}

/** States of the stages that do not name a state. */
const STATES = { SENT: "sending", PROGRESS: "started", ACTIVE: "started", PREDICTED: null };

/** Return a command in its state at a time. @param {CommandStatus} command @param {number} utc @returns {CommandStatus} */
function commandAt(command, utc) {
  const history = command.history.filter((each) => each.utc <= utc);
  if (history.length === command.history.length) return command;
  const states = history.map((each) => (each.stage in STATES ? STATES[each.stage] : each.stage.toLowerCase()));
  return { ...command, history, ended: false, state: states.findLast(Boolean) ?? "sending" };
}

/** Return the name of a command, also of one that only its number is known of. @param {CommandStatus} command */
export const nameOf = ({ name, number, source }) => name || `command ${number} of ${source}`;

/** Return a point of a frame in the frame around that. @param {Frame} frame @param {Point} point @returns {Point} */
export function composed({ x, y, heading }, point) {
  const [cos, sin] = [Math.cos(heading), Math.sin(heading)];
  return { x: x + cos * point.x - sin * point.y, y: y + sin * point.x + cos * point.y };
}

/** Return the frame around a frame in that. @param {Frame} frame @returns {Frame} */
export function inverse({ x, y, heading }) {
  return { ...composed({ x: 0, y: 0, heading: -heading }, { x: -x, y: -y }), heading: -heading };
}

/** @param {NotificationMessage} one @param {NotificationMessage} other */
const isAfter = (one, other) => one.utc > other.utc || (one.utc === other.utc && one.sequence > other.sequence);
