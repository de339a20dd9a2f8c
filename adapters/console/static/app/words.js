/** Numbers, times and angles as people read them. SI units and radians in, degrees only out. */

const DEGREES = 180 / Math.PI;

/** @param {number} radians */
export const degrees = (radians) => radians * DEGREES;

/** @param {number} degrees_ */
export const radians = (degrees_) => degrees_ / DEGREES;

/** A number with as many digits as its size asks for. @param {number} value */
export function number(value) {
  if (!Number.isFinite(value)) return String(value);
  if (Number.isInteger(value)) return String(value);
  const size = Math.abs(value);
  return fixed(value, size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3);
}

/** A number with so many digits behind the point, and no minus before zero. */
export function fixed(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/** Time of day in UTC, to the second or the millisecond. @param {number} utc_s @param {boolean} [exact] */
export function clock(utc_s, exact = false) {
  return new Date(utc_s * 1000).toISOString().slice(11, exact ? 23 : 19);
}

/** How long ago, in one or two characters more than needed. @param {number} age_s */
export function age(age_s) {
  if (age_s < 0.95) return "now";
  if (age_s < 9.95) return `${age_s.toFixed(0)} s`;
  if (age_s < 120) return `${Math.round(age_s)} s`;
  if (age_s < 7200) return `${Math.round(age_s / 60)} min`;
  if (age_s < 172800) return `${Math.round(age_s / 3600)} h`;
  return `${Math.round(age_s / 86400)} d`;
}

/** How long something takes. @param {number} time_s */
export const duration = (time_s) => (age(time_s) === "now" ? "0 s" : age(time_s));

/** A number of octets. @param {number} count @returns {{text: string, unit: string}} */
export function octets(count) {
  const [size, unit] = count >= 1e9 ? [1e9, "GB"] : count >= 1e6 ? [1e6, "MB"] : count >= 1e3 ? [1e3, "kB"] : [1, "B"];
  return { text: number(count / size), unit };
}

/** @param {number} count of octets */
export function sizeOf(count) {
  const { text, unit } = octets(count);
  return `${text} ${unit}`;
}

/**
 * A value of a parameter in the unit that people use.
 * @param {any} value in SI units; null where nothing valid is known, undefined where nothing was told
 * @param {{unit?: string, typed?: {unit: string, per_unit: number} | null}} entry
 * @returns {{text: string, unit: string, factor: number}}
 */
export function inTypedUnit(value, entry) {
  const factor = entry.typed?.per_unit ?? 1;
  const unit = unitOf(entry);
  if (value === undefined || value === null) return { text: "–", unit, factor };
  if (typeof value !== "number") return { text: String(value), unit, factor };
  if (unit === "B") return { ...octets(value), factor };
  return { text: entry.typed ? fixed(value * factor, 1) : number(value), unit, factor };
}

const UNITS = { deg: "°", "deg/s": "°/s" };

/** The unit that people use, as it is shown. @param {{unit?: string, typed?: {unit: string} | null}} entry */
export function unitOf({ unit = "", typed = null }) {
  const used = typed?.unit ?? unit;
  return UNITS[used] ?? used;
}
