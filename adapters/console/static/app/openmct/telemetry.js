/** Telemetry provider for Open MCT: live values, history, limits, staleness. One object is one parameter over one link. */

import { fetchJson } from "../model/connection.js";
import { limitOf } from "../views/values.js";
import { NAMESPACE, partsOf } from "./identifiers.js";

const BATCH_MS = 20;
const STALE_S = 5;
const UNBOUNDED = 1e9;
const LIMIT_VIOLATION = { cssClass: "is-limit--red", name: "outside its limits" };

/** @param {import("../model/session.js").Session} session */
export function telemetry(session) {
  const latest = batched(session);

  /** @param {any} object */
  function known(object) {
    const [name, , link, key] = partsOf(object.identifier);
    const asset = session.asset(name);
    const entry = asset.entry?.parameters.find((each) => each.key === key);
    return { asset, link, key, entry, factor: entry?.display_unit?.per_unit ?? 1 };
  }

  const isOurs = (object) => object.identifier.namespace === NAMESPACE && object.type === "rover.telemetry";
  // Whole milliseconds: a sample that is both pushed and requested is then equal, and a table shows it once.
  const datum = (sample, factor) => ({
    utc: Math.round(sample.utc * 1000),
    rx: Math.round(sample.rx * 1000),
    value: typeof sample.value === "number" ? sample.value * factor : (sample.value ?? NaN),
  });

  return (openmct) => {
    openmct.telemetry.addProvider({
      supportsSubscribe: isOurs,
      subscribe: (object, callback) => {
        const { asset, link, key, factor } = known(object);
        let before;
        return asset.on("sample", (sample) => {
          // Late samples are in the history only; a live plot of Open MCT 4.2 would draw them as the newest.
          if (sample.key !== key || sample.link !== link || sample.q === "late") return;
          if (isDrawn(sample, before)) callback(datum(sample, factor));
          before = sample;
        });
      },
      supportsRequest: isOurs,
      request: async (object, options) => {
        const { asset, link, key, factor } = known(object);
        if (options.strategy === "latest" && options.size === 1) {
          const sample = await latest(asset.name, key, link);
          const inside = sample && sample.utc * 1000 <= options.end;
          return inside && sample.value !== null ? [datum(sample, factor)] : [];
        }
        const query = new URLSearchParams({ link, start: String(options.start / 1000), end: String(options.end / 1000) });
        if (options.strategy) query.set("strategy", options.strategy);
        if (options.size) query.set("size", String(Math.round(options.size)));
        const path = `/api/tm/${encodeURIComponent(asset.name)}/${encodeURIComponent(key)}?${query}`;
        const { samples } = await fetchJson(path, { signal: options.signal });
        return samples.filter((each, at) => isDrawn(each, samples[at - 1])).map((each) => datum(each, factor));
      },
      supportsLimits: isOurs,
      getLimitEvaluator: (object) => ({
        evaluate: ({ value }, metadata) => {
          const { entry, factor } = known(object);
          if (metadata?.key !== "value" || !entry) return undefined;
          return limitOf(entry, value / factor) ? LIMIT_VIOLATION : undefined;
        },
      }),
      getLimits: (object) => ({
        limits: async () => {
          const { entry, factor } = known(object);
          const { low = null, high = null } = entry ?? {};
          if (low === null && high === null) return {};
          // Open MCT requires both ends of a limit.
          return {
            DISTRESS: {
              low: { color: "red", value: low === null ? -UNBOUNDED : low * factor },
              high: { color: "red", value: high === null ? UNBOUNDED : high * factor },
            },
          };
        },
      }),
      supportsStaleness: isOurs,
      isStale: async (object) => staleness(known(object), session),
      subscribeToStaleness: (object, callback) => {
        let was = null;
        return session.onSecond(() => {
          const now = staleness(known(object), session);
          if (now.isStale !== was) callback(now);
          was = now.isStale;
        });
      },
    });
  };
}

function staleness({ asset, link, key }, session) {
  const sample = asset.values.get(key)?.get(link);
  return { isStale: !sample || session.now - sample.utc > STALE_S, timestamp: session.now * 1000 };
}

/** Whether a sample is drawn: of consecutive unknown values only the first, which ends the line. */
function isDrawn(sample, before) {
  return sample.value !== null || (before !== undefined && before.value !== null);
}

/** Request the last values of many parameters at once: a table of Open MCT requests them row by row. */
function batched(session) {
  let waiting = [];
  async function send() {
    const batch = waiting;
    waiting = [];
    try {
      const keys = batch.map((each) => each.key);
      const { samples } = await fetchJson("/api/tm:batch", { json: { keys } });
      for (const each of batch) {
        const [asset, key, link] = each.key;
        each.resolve(samples.find((sample) => sample.asset === asset && sample.key === key && sample.link === link));
      }
    } catch (error) {
      batch.forEach((each) => each.reject(error));
    }
  }
  return (asset, key, link) => {
    const live = session.asset(asset).values.get(key)?.get(link);
    if (live) return Promise.resolve(live);
    return new Promise((resolve, reject) => {
      waiting.push({ key: [asset, key, link], resolve, reject });
      if (waiting.length === 1) setTimeout(send, BATCH_MS);
    });
  };
}
