/**
 * What operators make themselves: layouts, plots, notebooks. They are kept by rover-console, shared by all
 * consoles; who changes what somebody else changed meanwhile is told so, and nothing is overwritten.
 */

import { ask } from "../model/connection.js";

const NAMESPACE = "shared";
const ROOT = "displays";

/** @param {import("../model/session.js").Session} session */
export function storedObjects(session) {
  /** @type {Map<string, number>} */
  const revisions = new Map();
  const listed = ask("/api/objects").then(({ objects }) => {
    for (const { key, revision } of objects) revisions.set(key, revision);
  });

  return (openmct) => {
    const path = (key) => `/api/objects/${encodeURIComponent(key)}`;

    async function get(identifier) {
      const { key } = identifier;
      await listed;
      if (!revisions.has(key)) {
        if (key !== ROOT) return undefined;
        return { identifier, name: "Displays", type: "folder", location: "ROOT", composition: [] };
      }
      const { revision, value } = await ask(path(key));
      revisions.set(key, revision);
      return { ...value, identifier };
    }

    async function put(object) {
      const { key } = object.identifier;
      const known = revisions.get(key);
      const headers = known === undefined ? { "If-None-Match": "*" } : { "If-Match": `"${known}"` };
      try {
        const { revision } = await ask(path(key), { method: "PUT", json: { value: object }, headers });
        revisions.set(key, revision);
        return true;
      } catch (error) {
        if (error.status === 412) throw new openmct.objects.errors.Conflict(error.message);
        throw error;
      }
    }

    openmct.objects.addProvider(NAMESPACE, { get, create: put, update: put });
    openmct.objects.addRoot({ namespace: NAMESPACE, key: ROOT }, openmct.priority.LOW);
    session.on("object", ({ key, revision }) => {
      if (revision === null) revisions.delete(key);
      else if (!revisions.has(key)) revisions.set(key, revision);
    });
  };
}
