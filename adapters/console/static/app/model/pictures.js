/** The pictures aboard with the pose and the camera angles at their times, the newest first. */

import { fetchJson } from "./connection.js";

/** @import { Asset } from "./asset.js" */
/** @import { FileEntry } from "./messages.js" */
/** @import { Session } from "./session.js" */

/** Maximum number of pictures; the attributes of each are a request. */
const MAX_PICTURES = 50;

export class Pictures {
  #asset;
  #changed;
  #offs;
  #isReading = false;
  #isStale = false;
  /** @type {Map<string, FileEntry>} by path and time */
  #known = new Map();
  /** @type {FileEntry[]} */
  #list = [];

  /** @param {Session} session @param {Asset} asset @param {() => void} changed called after each change */
  constructor(session, asset, changed) {
    this.#asset = asset;
    this.#changed = changed;
    this.#offs = session.hasFiles ? [asset.on("files", () => this.#read()), asset.onReached(() => this.#read())] : [];
  }

  close() {
    this.#offs.forEach((off) => off());
  }

  /** The pictures taken until a time, with the position of each. @param {number | null} utc_s null for now */
  at(utc_s) {
    return this.#list.filter((each) => each.modified <= (utc_s ?? Infinity));
  }

  async #read() {
    this.#isStale = true;
    if (this.#isReading) return;
    this.#isReading = true;
    try {
      while (this.#isStale) {
        this.#isStale = false;
        await this.#readOnce();
      }
    } catch (error) {
      console.info(error.message);
    } finally {
      this.#isReading = false;
    }
  }

  async #readOnce() {
    const { files } = await fetchJson(`/api/files/${encodeURIComponent(this.#asset.name)}`);
    const newest = files.filter(isPicture).sort((one, other) => other.modified - one.modified).slice(0, MAX_PICTURES);
    const show = () => {
      this.#list = newest.map((each) => this.#known.get(keyOf(each))).filter((each) => each && "POS_X" in each.meta);
      this.#changed();
    };
    for (const file of newest) {
      if (this.#isStale) break;
      if (this.#known.has(keyOf(file))) continue;
      this.#known.set(keyOf(file), await fetchJson(`${urlOf(this.#asset.name, file.path)}?about`).catch(() => file));
      show();
    }
    show();
  }
}

/** @param {FileEntry} file */
const keyOf = ({ path, modified }) => `${path} ${modified}`;

/** @param {FileEntry} file */
export const isPicture = ({ mime, path }) => /^image\/|jpe?g$|png$/i.test(mime ?? path);

/** @param {string} name of the asset @param {string} path */
export const urlOf = (name, path) => `/api/files/${encodeURIComponent(name)}/${path.split("/").map(encodeURIComponent).join("/")}`;

/** The command that took a picture; null if this page does not know it. @param {Asset} asset @param {FileEntry} picture */
export function commandOf(asset, { path, meta }) {
  const isSource = (source) => path.startsWith(`pictures/${source.replace(/[^A-Za-z0-9_-]/g, "_")}-`);
  return asset.lastCommands.find((each) => each.number === meta.commandId && isSource(each.source)) ?? null;
}
