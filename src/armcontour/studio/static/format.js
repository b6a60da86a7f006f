// Numbers as text with fixed decimals, so that their width does not change.

/** Text for a missing number. */
export const NONE = "–";

/** Number and name of a contour. @param {{number: number, name: string}} contour @returns {string} */
export const contourLabel = ({ number, name }) => `${number}${name && name !== String(number) ? ` · ${name}` : ""}`;

/** Format a number with fixed decimals; zero has no sign. @param {number | null | undefined} x @param {number} decimals @returns {string} */
export function fixed(x, decimals) {
  if (x === null || x === undefined || !Number.isFinite(x)) return NONE;
  const text = x.toFixed(decimals);
  return Number(text) ? text.replace("-", "−") : text.replace("-", "");
}

/** Return a figure of a frame, or undefined. @param {any} head @param {string} name @returns {any} */
export const rowOf = (head, name) => head?.rows?.find((/** @type {any} */ x) => x.name === name);

/** Count the decimals of a figure with three digits, such as 17.0, whose zeros are omitted. @param {string} text @returns {number} */
const decimalsOf = (text) => Math.max(text.split(".")[1]?.length ?? 0, Number(text) ? 2 - Math.floor(Math.log10(Math.abs(Number(text)))) : 0);

/** Return the digits of a figure, with these zeros. @param {string} text @returns {string} */
export const whole = (text) => (isPlain(text) ? fixed(Number(text), decimalsOf(text)) : text);

/** A figure with its unit. @param {{text: string, unit: string} | undefined} row @returns {string} */
export const textOf = (row) => (row ? `${row.text} ${row.unit}`.trim() : NONE);

/** Time. @param {number | null | undefined} s @returns {string} */
export const seconds = (s) => fixed(s, 3);

/** A time with its unit. @param {number} s @returns {string} */
export const clockOf = (s) => `${short(s)} s`;

/** A length. @param {number | null | undefined} m @param {number} [decimals] @returns {string} mm */
export const mm = (m, decimals = 3) => fixed(m === null || m === undefined ? m : 1000 * m, decimals);

/**
 * Return the difference of two figures as shown, with its sign; empty if unknown.
 * @param {{text: string, unit: string} | undefined} a @param {{text: string, unit: string} | undefined} b @returns {string}
 */
export function difference(a, b) {
  const by = Number(a?.text) - Number(b?.text);
  if (!a || !b || a.unit !== b.unit || !Number.isFinite(by)) return "";
  const text = fixed(by, Math.min(decimalsOf(a.text), decimalsOf(b.text)));
  return `${by > 0 && Number(text) ? "+" : ""}${text} ${a.unit}`;
}

/** Format a number with about four significant digits, without trailing zeros. @param {number} x @param {number} [digits] @returns {string} */
export function short(x, digits = 4) {
  if (!Number.isFinite(x)) return NONE;
  return String(Number(x.toPrecision(digits)));
}

/** Date and time to the minute, as the server writes them. @param {Date} time @returns {string} */
export function timeText(time) {
  const two = (/** @type {number} */ x) => String(x).padStart(2, "0");
  return `${time.getFullYear()}-${two(time.getMonth() + 1)}-${two(time.getDate())} ${two(time.getHours())}:${two(time.getMinutes())}`;
}

const PLAIN = /^[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?$/;

/** True if a quantity is written without a unit. @param {string} text @returns {boolean} */
export const isPlain = (text) => PLAIN.test(text);

/** A quantity of a slider, such as "150 mm/s". @param {number} value SI @param {{unit: string, factor: number}} of @returns {string} */
export const quantity = (value, { unit, factor }) => `${short(value / factor)}${unit ? ` ${unit}` : ""}`;
