/**
 * The rovers as objects of Open MCT: for each asset a folder with its views, a layout with all of them,
 * and its telemetry by link. They are derived from the dictionary, not stored, and cannot be edited.
 */

import { unitOf } from "../format.js";
import { NAMESPACE, ROOT, identifierOf, partsOf } from "./identifiers.js";
import { VIEWS, viewsOf } from "./views.js";

/** @typedef {import("../model/session.js").Session} Session */

/**
 * Columns of the layout: width in percent, and the height of each frame in percent.
 * @type {[number, [string, number][]][]}
 */
const LAYOUT = [
  [40, [["map", 54], ["commands", 46]]],
  [31, [["tree", 58], ["log", 42]]],
  [29, [["form", 56], ["values", 44]]],
];
/** @type {typeof LAYOUT} the layout of a recording, without the command form */
const RECORDING_LAYOUT = [...LAYOUT.slice(0, 2), [29, [["recording", 50], ["values", 50]]]];

/** @param {Session} session */
export function objects(session) {
  return (openmct) => {
    openmct.types.addType("rover.telemetry", { name: "Telemetry", cssClass: "icon-telemetry", description: "A parameter by one link" });
    openmct.objects.addRoot({ namespace: NAMESPACE, key: ROOT }, openmct.priority.HIGH);
    openmct.objects.addProvider(NAMESPACE, {
      get: async (identifier) => {
        await session.ready;
        return { createdBy: "rover-console", modifiedBy: "rover-console", ...objectOf(session, identifier) };
      },
    });
    openmct.composition.addProvider(composition(session));
  };
}

function objectOf(session, identifier) {
  const [name, kind, link, key] = partsOf(identifier);
  if (identifier.key === ROOT) {
    return { identifier, name: "Rovers", type: "rover.fleet", location: "ROOT" };
  }
  const root = `${NAMESPACE}:${ROOT}`;
  if (kind === undefined) return { identifier, name, type: "folder", location: root };
  const location = `${NAMESPACE}:${identifierOf(name).key}`;
  if (kind === "layout") return layoutOf(identifier, session.asset(name), location);
  if (kind === "telemetry" && key === undefined) {
    return { identifier, name: ["recording", "console"].includes(link) ? "Telemetry" : `By ${link} link`, type: "folder", location };
  }
  if (kind === "telemetry") {
    const entry = session.asset(name).entry?.parameters.find((each) => each.key === key);
    return telemetryOf(identifier, key, entry, `${NAMESPACE}:${identifierOf(name, "telemetry", link).key}`);
  }
  const view = VIEWS[kind];
  return { identifier, name: view?.name ?? kind, type: view ? `rover.${kind}` : "unknown", location };
}

function layoutOf(identifier, asset, location) {
  const { name } = asset;
  const layout = asset.recording ? RECORDING_LAYOUT : LAYOUT;
  const frames = layout.flatMap(([, each]) => each.map(([kind]) => kind));
  return {
    identifier,
    name: asset.recording ? "Recording, all" : "Operations",
    type: "flexible-layout",
    location,
    composition: frames.map((kind) => identifierOf(name, kind)),
    configuration: {
      rowsLayout: false,
      objectStyles: {},
      containers: layout.map(([size, each], column) => ({
        id: `column-${column}`,
        size,
        frames: each.map(([kind, height]) => ({
          id: `frame-${kind}`,
          domainObjectIdentifier: identifierOf(name, kind),
          size: height,
          noFrame: false,
        })),
      })),
    },
  };
}

function telemetryOf(identifier, key, entry, location) {
  const isText = entry?.type === "STRING";
  const unit = unitOf(entry ?? {});
  return {
    identifier,
    name: entry ? `${entry.name} (${key})` : key,
    type: "rover.telemetry",
    location,
    telemetry: {
      values: [
        { key: "utc", name: "Time aboard", source: "utc", format: "utc", hints: { domain: 1 } },
        { key: "value", name: entry?.name ?? key, unit, format: isText ? "string" : "number", hints: { range: 1 } },
        { key: "rx", name: "Received", format: "utc", hints: { domain: 2 } },
      ],
    },
  };
}

/** Children of the root, of an asset, and of its telemetry. Assets and parameters may be added, recordings removed. */
function composition(session) {
  const below = (object) => {
    const [name, kind, link] = partsOf(object.identifier);
    if (object.identifier.key === ROOT) return [...session.assets.keys()].sort().map((each) => identifierOf(each));
    const asset = session.asset(name);
    if (kind === undefined) {
      return [
        ...(asset.isConsole ? [] : [identifierOf(name, "layout")]),
        ...viewsOf(asset).map((each) => identifierOf(name, each)),
        ...asset.valueLinks.map((each) => identifierOf(name, "telemetry", each)),
      ];
    }
    return (asset.entry?.parameters ?? []).map((each) => identifierOf(name, "telemetry", link, each.key));
  };
  const watched = new Map();
  return {
    appliesTo: (object) =>
      object.identifier.namespace === NAMESPACE && ["rover.fleet", "folder"].includes(object.type),
    load: async (object) => {
      await session.ready;
      return below(object);
    },
    on: (object, event, callback, context) => {
      let known = below(object);
      const update = () => {
        const now = below(object);
        const [some, others] = event === "add" ? [now, known] : [known, now];
        const keys = new Set(others.map((each) => each.key));
        known = now;
        some.filter((each) => !keys.has(each.key)).forEach((each) => callback.call(context, each));
      };
      const [name] = partsOf(object.identifier);
      const offs =
        object.identifier.key === ROOT
          ? [session.on("assets", update)]
          : ["links", "entry"].map((topic) => session.asset(name).on(topic, update));
      watched.set(callback, offs);
    },
    off: (_, __, callback) => {
      watched.get(callback)?.forEach((off) => off());
      watched.delete(callback);
    },
    includes: (parent, child) => below(parent).some((each) => each.key === child.key),
  };
}
