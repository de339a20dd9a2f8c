/** Formats numbers, times and angles for display. Input is in SI units and radians; degrees only appear in the output. */

import { serverClock } from "./model/server_clock.js";

const DEGREES = 180 / Math.PI;

/** @param {number} radians */
export const degrees = (radians) => radians * DEGREES;

/** @param {number} degrees_ */
export const radians = (degrees_) => degrees_ / DEGREES;

/** Format a number; the magnitude decides its decimal places. @param {number} value */
export function number(value) {
  if (!Number.isFinite(value)) return String(value);
  if (Number.isInteger(value)) return String(value);
  const size = Math.abs(value);
  return fixed(value, size >= 1000 ? 0 : size >= 100 ? 1 : size >= 10 ? 2 : 3);
}

/** Format a number with a fixed number of decimal places, without a minus before zero. */
export function fixed(value, digits) {
  const text = value.toFixed(digits);
  return Number(text) === 0 ? text.replace("-", "") : text;
}

/** Format the date of a time in UTC. @param {number} utc_s */
export const dateOf = (utc_s) => new Date(utc_s * 1000).toISOString().slice(0, 10);

/** Format the time of day in UTC, to the second or the millisecond. @param {number} utc_s @param {boolean} [exact] */
export const timeOfDay = (utc_s, exact = false) => new Date(utc_s * 1000).toISOString().slice(11, exact ? 23 : 19);

/** @param {number} utc_s */
const dayOf = (utc_s) => Math.floor(utc_s / 86_400);

/** The number of today since 1970 UTC, by the clock of the console. */
export const today = () => dayOf(serverClock.now_s);

/** Format a time in UTC, with its date unless it is of today. @param {number} utc_s @param {boolean} [exact] to the millisecond */
export function clock(utc_s, exact = false) {
  const text = new Date(utc_s * 1000).toISOString();
  return text.slice(dayOf(utc_s) === today() ? 11 : 0, exact ? 23 : 19).replace("T", " ");
}

/** Format a time span in UTC. @param {number} start_s @param {number} end_s */
export const interval = (start_s, end_s) => `${clock(start_s)} to ${dayOf(start_s) === dayOf(end_s) ? timeOfDay(end_s) : clock(end_s)}`;

/** Format an age, with its largest unit. @param {number} age_s */
export function age(age_s) {
  if (age_s < 0.95) return "now";
  if (age_s < 9.95) return `${age_s.toFixed(0)} s`;
  if (age_s < 120) return `${Math.round(age_s)} s`;
  if (age_s < 7200) return `${Math.round(age_s / 60)} min`;
  if (age_s < 172800) return `${Math.round(age_s / 3600)} h`;
  return `${Math.round(age_s / 86400)} d`;
}

/** Format a duration; from 2 h on with two units, rounded down. @param {number} time_s */
export function duration(time_s) {
  if (time_s < 7200) return time_s < 0.95 ? "0 s" : age(time_s);
  const [large, small, small_s, ratio] = time_s < 172800 ? ["h", "min", 60, 60] : ["d", "h", 3600, 24];
  const count = Math.floor(time_s / small_s);
  return [`${Math.floor(count / ratio)} ${large}`, count % ratio ? `${count % ratio} ${small}` : ""].join(" ").trim();
}

/** Format a number of octets, with its unit. @param {number} count @returns {{text: string, unit: string}} */
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
 * Format a value of a parameter in its display unit.
 * @param {any} value in SI units; null for an invalid value, undefined for none
 * @param {{unit?: string, display_unit?: {unit: string, per_unit: number} | null}} entry
 * @returns {{text: string, unit: string, factor: number}}
 */
export function inDisplayUnit(value, entry) {
  const factor = entry.display_unit?.per_unit ?? 1;
  const unit = unitOf(entry);
  if (value === undefined || value === null) return { text: "–", unit, factor };
  if (typeof value !== "number") return { text: String(value), unit, factor };
  if (unit === "B") return { ...octets(value), factor };
  return { text: entry.display_unit ? fixed(value * factor, 1) : number(value), unit, factor };
}

const UNITS = { deg: "°", "deg/s": "°/s" };

/** Return the display unit of a parameter. @param {{unit?: string, display_unit?: {unit: string} | null}} entry */
export function unitOf({ unit = "", display_unit: display = null }) {
  const used = display?.unit ?? unit;
  return UNITS[used] ?? used;
}
