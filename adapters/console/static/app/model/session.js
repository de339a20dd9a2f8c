/** The session of one page: its connection, the assets, the open pages, and the one-second tick of the views. */

import { Asset, STORED } from "./asset.js";
import { Connection, fetchJson, operator } from "./connection.js";
import { Topics } from "./observable.js";
import { serverClock } from "./server_clock.js";

/** @import { AlarmStatus, AssetEntry, Message, OpenPage } from "./messages.js" */
/** @typedef {{assets: Record<string, AssetEntry>, console: AssetEntry}} Dictionary */

/** Topics of a page that shows neither log nor tree. */
export const LIGHT_TOPICS = ["tm", "cmd", "auth", "link", "asset", "presence", "dictionary", "alarm", "stop", "plan", "question", "prediction"];
const TOPICS = [...LIGHT_TOPICS, "ntf", "tree", "file", "transfer", "obj"];
const HISTORY_S = 3600;
const MAX_SAMPLES = 20000;
const MAX_RECORDING_ITEMS = 1000;
const MAX_NOTICES = 500;
const POSE = ["POS_X", "POS_Y", "HEAD"];

/** @extends {Topics<"second" | "assets" | "presence" | "object" | "alarms" | "question">} */
export class Session extends Topics {
  #resume = { instance: "", seq: 0 };
  #tried = new Map();
  #topics;
  /** @type {(value?: any) => void} */
  #becomeReady = () => {};
  /** @type {Map<string, Asset>} */
  assets = new Map();
  /** names of the recordings that this page does not show @type {Set<string>} */
  omitted = new Set();
  /** @type {Map<number, AlarmStatus>} open alarms of all assets */
  alarms = new Map();
  /** @type {OpenPage[]} open pages */
  presence = [];
  /** resolves when the dictionary was read for the first time */
  ready = new Promise((resolve) => (this.#becomeReady = resolve));

  /** @param {Dictionary | null} dictionary if it was read already @param {string[]} [topics] to subscribe to */
  constructor(dictionary, topics = TOPICS) {
    super();
    this.#topics = topics;
    this.hasLog = topics.includes("ntf");
    this.hasFiles = topics.includes("file");
    this.name = `page-${Math.random().toString(36).slice(2, 8)}`;
    this.connection = new Connection(
      (message) => this.#receive(message),
      () => ({
        op: "hello",
        console: this.name,
        operator: operator.name,
        topics: this.#topics,
        resume: this.#resume,
      }),
    );
    setInterval(() => this.changed("second"), 1000);
    if (dictionary) this.#take(dictionary);
  }

  /** The rovers and recordings, by their names. @returns {Asset[]} */
  get rovers() {
    const rovers = [...this.assets.values()].filter((each) => !each.isConsole);
    return rovers.sort((one, other) => one.name.localeCompare(other.name));
  }

  /** The addresses without a reached rover. */
  get tried() {
    return [...this.#tried.keys()];
  }

  /** The time by the server's clock, seconds since 1970-01-01 UTC. */
  get now() {
    return serverClock.now_s;
  }

  /** @param {() => void} listener */
  onSecond(listener) {
    return this.on("second", listener);
  }

  /** Subscribe to further topics; notifications are read from the archive, too. @param {string[]} topics */
  subscribe(topics) {
    const added = topics.filter((each) => !this.#topics.includes(each));
    if (added.length === 0) return;
    this.#topics = [...this.#topics, ...added];
    this.connection.send({ op: "sub", topics: this.#topics });
    if (added.includes("ntf")) for (const asset of this.assets.values()) this.#readNotices(asset);
  }

  /** Return an asset, created if unknown. @param {string} name @param {AssetEntry | null} [entry] of the dictionary, if known */
  asset(name, entry = null) {
    let asset = this.assets.get(name);
    if (!asset) {
      asset = new Asset(name, entry);
      this.assets.set(name, asset);
      this.changed("assets");
      if (this.connection.status === "open") this.#readHistory(asset);
    }
    return asset;
  }

  /** Return why there is no data, and what to do. @param {Asset} [asset] */
  unreached(asset) {
    if (this.connection.status !== "open") {
      return "rover-console does not answer. This page reconnects by itself.";
    }
    if (!asset) return "No rover is connected: start one with rover demo --stay";
    if (asset.recording) return `${asset.recording.file} holds no such data up to this time. Choose a later time, or open another recording under “Rovers”.`;
    const links = [...asset.links.values()].map((each) => `${each.link} link (${each.uri}) ${each.state}`);
    return `${asset.name} cannot be reached: ${links.join(", ") || "no link"}. Start it, for example with rover demo --stay`;
  }

  /** @param {Message} message */
  #receive(message) {
    if (message.seq !== undefined) this.#resume.seq = message.seq;
    switch (message.ty) {
      case "hello":
        if (message.operator !== operator.name) operator.name = message.operator;
        if (!message.resumed) this.#reload();
        if (!message.resumed) this.alarms.clear();
        for (const asset of this.assets.values()) {
          if (!message.resumed) asset.stop = null;
          if (!message.resumed) asset.questions.clear();
          asset.transfers.clear(); // the present ones follow
          asset.changed("transfers");
        }
        this.#resume = { instance: message.instance, seq: message.resumed ? this.#resume.seq : message.seq };
        break;
      case "tm":
        return this.asset(message.asset).addSample(message);
      case "cmd":
        return this.asset(message.asset).setCommand(message);
      case "ntf":
        return this.asset(message.asset).addNotices([message]);
      case "alarm":
        if (message.cleared === null || message.acknowledged === null) this.alarms.set(message.id, message);
        else this.alarms.delete(message.id);
        return this.changed("alarms", message);
      case "auth":
        return this.#set(message, "authority");
      case "stop":
        return this.#set(message, "stop");
      case "asset":
        return this.#set(message, "status");
      case "tree":
        this.asset(message.asset).noteNodes(message);
        return this.#set(message, "tree");
      case "prediction":
        return this.#set(message, "prediction");
      case "plan":
        return this.#put(message, "plans", message.plan);
      case "question":
        this.#put(message, "questions", `${message.plan} ${message.question}`, message.end !== null);
        return this.changed("question", message);
      case "link":
        if (message.asset === "") {
          this.#tried.set(message.uri, message);
          this.changed("assets");
        } else {
          this.#tried.delete(message.uri);
          this.#put(message, "links", message.link);
        }
        break;
      case "transfer":
        return this.#put(message, "transfers", message.id, message.state === "removed");
      case "file":
        return this.asset(message.asset).changed("files", message);
      case "presence":
        this.presence = message.consoles;
        return this.changed("presence");
      case "dictionary":
        this.readDictionary();
        break;
      case "obj":
        return this.changed("object", message);
    }
  }

  /** Reload the data that the socket will not send again. The dictionary may have been read just before. */
  #reload() {
    if (this.#resume.instance || this.assets.size === 0) this.readDictionary();
    for (const asset of this.assets.values()) this.#readHistory(asset);
  }

  #set(message, field) {
    const asset = this.asset(message.asset);
    asset[field] = message;
    asset.changed(field);
  }

  #put(message, field, key, isRemoved = false) {
    const asset = this.asset(message.asset);
    if (isRemoved) asset[field].delete(key);
    else asset[field].set(key, message);
    asset.changed(field);
  }

  /** Read the assets of the dictionary. */
  async readDictionary() {
    try {
      this.#take(await fetchJson("/api/dictionary"));
    } catch (error) {
      console.warn(error.message);
    }
  }

  /** Take the assets of a dictionary. A page without a log only names recordings. @param {Dictionary} dictionary */
  #take({ assets, console: own }) {
    this.omitted.clear();
    for (const [name, { entry }] of this.assets) if (entry?.recording && !(name in assets)) this.assets.delete(name);
    for (const [name, entry] of Object.entries({ ...assets, [own.asset]: own })) {
      if (entry.recording && !this.hasLog) {
        this.omitted.add(name);
        continue;
      }
      const asset = this.asset(name, entry);
      asset.entry = entry;
      asset.changed("entry");
    }
    this.#becomeReady();
    this.changed("assets");
  }

  /** Read the track, the notifications and a recording's commands from the archive. @param {Asset} asset */
  async #readHistory(asset) {
    const start = asset.recording?.start ?? this.now - HISTORY_S;
    const size = asset.recording ? MAX_SAMPLES : HISTORY_S;
    const name = encodeURIComponent(asset.name);
    try {
      if (asset.recording) {
        const { commands } = await fetchJson(`/api/commands?asset=${name}&limit=${MAX_RECORDING_ITEMS}`);
        for (const command of commands.reverse()) asset.setCommand(command);
      }
      if (this.#topics.includes("ntf")) await this.#readNotices(asset, asset.recording ? MAX_RECORDING_ITEMS : MAX_NOTICES);
      if (asset.isConsole) return; // it has no pose
      const read = (key) => fetchJson(`/api/tm/${name}/${key}?start=${start}&size=${size}`);
      const [xs, ys, headings] = await Promise.all(POSE.map(read));
      asset.addFixes(fixesOf(xs.samples, ys.samples, headings.samples));
      for (const key of STORED) asset.store(key, (await read(key)).samples);
    } catch (error) {
      console.warn(error.message);
    }
  }

  /** @param {Asset} asset */
  async #readNotices(asset, limit = MAX_NOTICES) {
    const answer = await fetchJson(`/api/notifications?asset=${encodeURIComponent(asset.name)}&limit=${limit}`).catch(() => null);
    if (answer) asset.addNotices(answer.notifications.reverse());
  }
}

/** Join samples with the same stamp. */
function fixesOf(xs, ys, headings) {
  const at = (samples) => new Map(samples.map((each) => [each.utc, each.value]));
  const [y, heading] = [at(ys), at(headings)];
  return xs
    .filter((each) => typeof each.value === "number" && typeof y.get(each.utc) === "number" && typeof heading.get(each.utc) === "number")
    .map((each) => ({ utc: each.utc, x: each.value, y: y.get(each.utc), heading: heading.get(each.utc) }));
}
