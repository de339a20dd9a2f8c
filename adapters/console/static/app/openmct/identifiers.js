/** Identifiers of the rovers' objects: asset, kind, and for telemetry link and parameter. */

export const NAMESPACE = "rover";
export const ROOT = "rovers";
const MARK = "~";

/** @param {...string} parts */
export const identifierOf = (...parts) => ({ namespace: NAMESPACE, key: parts.map(encodeURIComponent).join(MARK) });

/** @param {{key: string}} identifier */
export const partsOf = (identifier) => identifier.key.split(MARK).map(decodeURIComponent);
