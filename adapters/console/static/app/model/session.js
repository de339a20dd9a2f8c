/** One page at work: its connection, the assets, who else is there, and the second that views tick by. */

import { Asset, UNCERTAINTY } from "./asset.js";
import { Connection, ask, operator } from "./connection.js";
import { Topics } from "./observable.js";

/** @import { AlarmStatus, AssetEntry, Message, OpenPage } from "./messages.js" */

/** What a page hears of that shows neither log nor tree. */
export const LIGHT_TOPICS = ["tm", "cmd", "auth", "link", "asset", "presence", "dictionary", "alarm"];
const TOPICS = [...LIGHT_TOPICS, "ntf", "tree", "plan", "file", "transfer", "obj"];
const HISTORY_S = 3600;
const MOST_SAMPLES = 20000;
const MOST_PAST = 1000;
const MOST_NOTICES = 500;
const POSE = ["POS_X", "POS_Y", "HEAD"];

/** @extends {Topics<"second" | "assets" | "presence" | "object" | "alarms">} */
export class Session extends Topics {
  #heard = { instance: "", seq: 0 };
  #tried = new Map();
  /** @type {(value?: any) => void} */
  #becomeReady = () => {};
  /** @type {Map<string, Asset>} */
  assets = new Map();
  /** @type {Map<number, AlarmStatus>} those that stand, of all assets */
  alarms = new Map();
  /** @type {OpenPage[]} pages that are open */
  presence = [];
  /** when the dictionary was read for the first time */
  ready = new Promise((resolve) => (this.#becomeReady = resolve));

  /** @param {string[]} [topics] what it hears of */
  constructor(topics = TOPICS) {
    super();
    this.hasLog = topics.includes("ntf");
    this.name = `page-${Math.random().toString(36).slice(2, 8)}`;
    this.connection = new Connection(
      (message) => this.#receive(message),
      () => ({
        op: "hello",
        console: this.name,
        operator: operator.name,
        topics,
        resume: this.#heard,
      }),
    );
    setInterval(() => this.changed("second"), 1000);
  }

  /** The rovers and recordings, by their names. @returns {Asset[]} */
  get rovers() {
    const rovers = [...this.assets.values()].filter((each) => !each.isConsole);
    return rovers.sort((one, other) => one.name.localeCompare(other.name));
  }

  /** The addresses at which no rover was reached yet. */
  get tried() {
    return [...this.#tried.keys()];
  }

  /** The time by the server's clock, seconds since 1970-01-01 UTC. */
  get now() {
    return Date.now() / 1000 + this.connection.ahead_s;
  }

  /** @param {() => void} listener */
  onSecond(listener) {
    return this.on("second", listener);
  }

  /** Return an asset, new if it was not heard of. @param {string} name @param {AssetEntry | null} [entry] of the dictionary, where that is known */
  asset(name, entry = null) {
    let asset = this.assets.get(name);
    if (!asset) {
      asset = new Asset(name, entry);
      this.assets.set(name, asset);
      this.changed("assets");
      this.#readPast(asset);
    }
    return asset;
  }

  /** Why nothing is there to be seen, and what to do. @param {Asset} [asset] */
  unreached(asset) {
    if (this.connection.status !== "open") {
      return "rover-console does not answer. This page goes on by itself when it is back.";
    }
    if (!asset) return "No rover is connected: start one with ./rover demo --stay";
    if (asset.recording) return `${asset.recording.file} holds nothing of this until then. Look at a later time, or open another recording under “Rovers”.`;
    const links = [...asset.links.values()].map((each) => `${each.link} link (${each.uri}) ${each.state}`);
    return `${asset.name} cannot be reached: ${links.join(", ") || "no link"}. Start it, for example with ./rover demo --stay`;
  }

  /** @param {Message} message */
  #receive(message) {
    if (message.seq !== undefined) this.#heard.seq = message.seq;
    switch (message.ty) {
      case "hello":
        if (message.operator !== operator.name) operator.name = message.operator;
        if (!message.resumed) this.#catchUp();
        if (!message.resumed) this.alarms.clear();
        for (const asset of this.assets.values()) {
          asset.transfers.clear(); // those that there are follow
          asset.changed("transfers");
        }
        this.#heard = { instance: message.instance, seq: message.resumed ? this.#heard.seq : message.seq };
        break;
      case "tm":
        this.asset(message.asset).addSample(message);
        break;
      case "cmd":
        this.asset(message.asset).setCommand(message);
        break;
      case "ntf":
        this.asset(message.asset).addNotices([message]);
        break;
      case "alarm":
        if (message.cleared === null || message.acknowledged === null) this.alarms.set(message.id, message);
        else this.alarms.delete(message.id);
        this.changed("alarms", message);
        break;
      case "auth":
        this.#set(message, "authority");
        break;
      case "asset":
        this.#set(message, "status");
        break;
      case "tree":
        this.asset(message.asset).noteNodes(message);
        this.#set(message, "tree");
        break;
      case "plan":
        this.#put(message, "plans", message.plan);
        break;
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
        this.#put(message, "transfers", message.id, message.state === "removed");
        break;
      case "file":
        this.asset(message.asset).changed("files", message);
        break;
      case "presence":
        this.presence = message.consoles;
        this.changed("presence");
        break;
      case "dictionary":
        this.readDictionary();
        break;
      case "obj":
        this.changed("object", message);
        break;
    }
  }

  /** Read anew what the socket will not tell again. */
  #catchUp() {
    this.readDictionary();
    for (const asset of this.assets.values()) this.#readPast(asset);
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

  /** Read which assets there are; recordings, which are all past, are not for a page without the past. */
  async readDictionary() {
    try {
      const { assets, console: own } = await ask("/api/dictionary");
      for (const [name, { entry }] of this.assets) if (entry?.recording && !(name in assets)) this.assets.delete(name);
      for (const [name, entry] of [...Object.entries(assets), [own.asset, own]]) {
        if (entry.recording && !this.hasLog) continue;
        const asset = this.asset(name, entry);
        asset.entry = entry;
        asset.changed("entry");
      }
      this.#becomeReady();
      this.changed("assets");
    } catch (error) {
      console.warn(error.message);
    }
  }

  /** Read where it was, and what it told, before this page listened. @param {Asset} asset */
  async #readPast(asset) {
    const start = asset.recording?.began ?? this.now - HISTORY_S;
    const size = asset.recording ? MOST_SAMPLES : HISTORY_S;
    const name = encodeURIComponent(asset.name);
    try {
      if (asset.recording) {
        const { commands } = await ask(`/api/commands?asset=${name}&limit=${MOST_PAST}`);
        for (const command of commands.reverse()) asset.setCommand(command);
        const told = await ask(`/api/notifications?asset=${name}&limit=${MOST_PAST}`);
        asset.addNotices(told.notifications.reverse());
      } else if (this.hasLog) {
        const told = await ask(`/api/notifications?asset=${name}&limit=${MOST_NOTICES}`);
        asset.addNotices(told.notifications.reverse());
      }
      const read = (key) => ask(`/api/tm/${name}/${key}?start=${start}&size=${size}`);
      const [xs, ys, headings] = await Promise.all(POSE.map(read));
      asset.addFixes(fixesOf(xs.samples, ys.samples, headings.samples));
      for (const key of UNCERTAINTY) asset.addUncertainty(key, (await read(key)).samples);
    } catch (error) {
      console.warn(error.message);
    }
  }
}

/** Join samples of the same moment. */
function fixesOf(xs, ys, headings) {
  const at = (samples) => new Map(samples.map((each) => [each.utc, each.value]));
  const [y, heading] = [at(ys), at(headings)];
  return xs
    .filter((each) => typeof each.value === "number" && typeof y.get(each.utc) === "number" && typeof heading.get(each.utc) === "number")
    .map((each) => ({ utc: each.utc, x: each.value, y: y.get(each.utc), heading: heading.get(each.utc) }));
}
