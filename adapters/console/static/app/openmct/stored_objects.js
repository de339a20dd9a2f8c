/**
 * Objects made by operators: layouts, plots, notebooks. rover-console stores them, and all consoles share
 * them. A change to an outdated revision is refused with an error, so nothing is overwritten.
 */

import { fetchJson } from "../model/connection.js";

const NAMESPACE = "shared";
const ROOT = "displays";
/** The folder of all objects, before the first is stored. */
const EMPTY_FOLDER = { name: "Displays", type: "folder", location: "ROOT", composition: [] };
/** Fields that Open MCT sets at each change of another field. */
const TIMES = ["modified", "persisted"];

/** @param {import("../model/session.js").Session} session */
export function storedObjects(session) {
  /** @type {Map<string, {revision: number | null, value: any}>} objects as this page shows them; without a revision if not stored yet */
  const shown = new Map();
  /** @type {Map<string, Promise<void>>} pending requests, by object */
  const sending = new Map();
  /** @type {Set<string>} objects that another operator changed while this page was changing them */
  const postponed = new Set();
  const path = (key) => `/api/objects/${encodeURIComponent(key)}`;
  const identifierOf = (key) => ({ namespace: NAMESPACE, key });

  return (openmct) => {
    const isBusy = (key) => sending.has(key) || openmct.editor.isEditing();

    /** @param {string} key @returns {Promise<any>} the stored object */
    async function read(key) {
      const { revision, value } = key === ROOT && !(await isStored(key)) ? { revision: null, value: EMPTY_FOLDER } : await fetchJson(path(key));
      const object = { ...value, identifier: identifierOf(key) };
      if (!shown.has(key)) shown.set(key, { revision, value: object });
      else if (!isBusy(key)) show(key, revision, object);
      return object;
    }

    async function isStored(key) {
      const { objects } = await fetchJson("/api/objects");
      return objects.some((stored) => stored.key === key);
    }

    /** Show another operator's revision of an object in all its views. */
    function show(key, revision, object) {
      const before = shown.get(key);
      if (revision <= (before.revision ?? 0)) return;
      shown.set(key, { revision, value: object });
      const fields = Object.keys(object).filter((field) => JSON.stringify(object[field]) !== JSON.stringify(before.value[field]));
      fields.sort((one, other) => Number(TIMES.includes(one)) - Number(TIMES.includes(other)));
      const mutable = openmct.objects.toMutable(before.value);
      for (const field of fields) mutable.$set(field, object[field]);
      if (fields.includes("configuration")) openmct.objectViews.emit("reload", mutable);
      mutable.$destroy();
    }

    /** Send an object after its pending requests: each change names the revision that it changes. */
    async function put(object) {
      const { key } = object.identifier;
      const value = JSON.parse(JSON.stringify(object));
      const sent = (sending.get(key) ?? Promise.resolve()).then(() => send(key, value));
      const over = sent.catch(() => {});
      sending.set(key, over);
      over.then(() => {
        if (sending.get(key) !== over) return;
        sending.delete(key);
        catchUp();
      });
      await sent;
      return true;
    }

    async function send(key, value) {
      const revision = shown.get(key)?.revision ?? null;
      const headers = revision === null ? { "If-None-Match": "*" } : { "If-Match": `"${revision}"` };
      try {
        const stored = await fetchJson(path(key), { method: "PUT", json: { value }, headers });
        shown.set(key, { revision: stored.revision, value });
      } catch (error) {
        if (error.status !== 412) throw error;
        shown.delete(key);
        throw new openmct.objects.errors.Conflict(error.message);
      }
    }

    /** Read a changed object again if it is shown; postponed while this page changes it. */
    async function refresh(key) {
      if (!shown.has(key)) return;
      if (isBusy(key)) postponed.add(key);
      else await read(key).catch((error) => console.warn(error.message));
    }

    function catchUp() {
      const waiting = [...postponed];
      postponed.clear();
      waiting.forEach(refresh);
    }

    openmct.objects.addProvider(NAMESPACE, { get: ({ key }) => read(key), create: put, update: put });
    openmct.objects.addRoot({ namespace: NAMESPACE, key: ROOT }, openmct.priority.LOW);
    openmct.editor.on("isEditing", (/** @type {boolean} */ isEditing) => isEditing || catchUp());
    session.on("object", ({ key, revision }) => {
      if (revision === null) shown.delete(key);
      else if (revision > (shown.get(key)?.revision ?? 0)) refresh(key);
    });
  };
}
