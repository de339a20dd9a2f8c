/**
 * What operators make themselves: layouts, plots, notebooks. They are kept by rover-console, shared by all
 * consoles; who changes what somebody else changed meanwhile is told so, and nothing is overwritten.
 */

import { ask } from "../model/connection.js";

const NAMESPACE = "shared";
const ROOT = "displays";
/** The folder of all, before anything is put into it. */
const NOTHING_YET = { name: "Displays", type: "folder", location: "ROOT", composition: [] };
/** What Open MCT sets itself at each change of another field. */
const TIMES = ["modified", "persisted"];

/** @param {import("../model/session.js").Session} session */
export function storedObjects(session) {
  /** @type {Map<string, {revision: number | null, value: any}>} objects as this page shows them; no revision: it is not kept yet */
  const shown = new Map();
  /** @type {Map<string, Promise<void>>} until each object was sent that is being sent */
  const sending = new Map();
  /** @type {Set<string>} objects that others changed while they were changed here */
  const later = new Set();
  const path = (key) => `/api/objects/${encodeURIComponent(key)}`;
  const identifierOf = (key) => ({ namespace: NAMESPACE, key });

  return (openmct) => {
    const isBusy = (key) => sending.has(key) || openmct.editor.isEditing();

    /** @param {string} key @returns {Promise<any>} the object as it is kept */
    async function read(key) {
      const { revision, value } = key === ROOT && !(await isKept(key)) ? { revision: null, value: NOTHING_YET } : await ask(path(key));
      const object = { ...value, identifier: identifierOf(key) };
      if (!shown.has(key)) shown.set(key, { revision, value: object });
      else if (!isBusy(key)) show(key, revision, object);
      return object;
    }

    async function isKept(key) {
      const { objects } = await ask("/api/objects");
      return objects.some((kept) => kept.key === key);
    }

    /** Show an object as somebody else made it, wherever it is shown. */
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

    /** Send an object after what was sent of it before: each change names the revision that it changes. */
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
        const kept = await ask(path(key), { method: "PUT", json: { value }, headers });
        shown.set(key, { revision: kept.revision, value });
      } catch (error) {
        if (error.status !== 412) throw error;
        shown.delete(key);
        throw new openmct.objects.errors.Conflict(error.message);
      }
    }

    /** Look at an object that was changed, if it is shown; not while it is changed here. */
    async function look(key) {
      if (!shown.has(key)) return;
      if (isBusy(key)) later.add(key);
      else await read(key).catch((error) => console.warn(error.message));
    }

    function catchUp() {
      const waiting = [...later];
      later.clear();
      waiting.forEach(look);
    }

    openmct.objects.addProvider(NAMESPACE, { get: ({ key }) => read(key), create: put, update: put });
    openmct.objects.addRoot({ namespace: NAMESPACE, key: ROOT }, openmct.priority.LOW);
    openmct.editor.on("isEditing", (/** @type {boolean} */ isEditing) => isEditing || catchUp());
    session.on("object", ({ key, revision }) => {
      if (revision === null) shown.delete(key);
      else if (revision > (shown.get(key)?.revision ?? 0)) look(key);
    });
  };
}
