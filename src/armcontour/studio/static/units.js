// Display of lengths in inches: a switch of the page, which changes neither the job file nor the server's figures.

import { isPlain } from "./format.js";
import { signal } from "./vendor/preact.js";

/** One inch [mm]. */
const INCH = 25.4;
const KEPT_AS = "armcontour-inches";
/** For each metric unit, the unit that is shown instead, and its size in the metric unit. @type {Record<string, [string, number]>} */
const SHOWN = {
  mm: ["in", INCH], "mm/s": ["in/s", INCH], "mm/min": ["in/min", INCH], "mm/s²": ["in/s²", INCH], "mm/s^2": ["in/s^2", INCH],
  cm: ["in", INCH / 10], m: ["in", INCH / 1000], "m/s": ["in/s", INCH / 1000], "m/min": ["in/min", INCH / 1000],
  "m/s²": ["in/s²", INCH / 1000], "m/s^2": ["in/s^2", INCH / 1000], "m/s³": ["in/s³", INCH / 1000], "m/s^3": ["in/s^3", INCH / 1000],
  // A thousandth of an inch.
  "µm": ["mil", INCH],
};
const NUMBER = String.raw`[-+−]?(?:\d+\.?\d*|\.\d+)(?:e[-+−]?\d+)?`;
const QUANTITIES = new RegExp(String.raw`(${NUMBER}) (${Object.keys(SHOWN).sort((a, b) => b.length - a.length).join("|").replaceAll("^", "\\^")})(?![\w/²³^])`, "g");
/** Fewest significant digits of a converted number; a number with more keeps them, and a bound such as "< 0.001" its own. */
const DIGITS = 3;
const BOUND = /<\s*$/;

/** Whether lengths are shown in inches; the browser keeps it. */
export const inches = signal(globalThis.localStorage?.getItem(KEPT_AS) === "true");
inches.subscribe((is) => globalThis.localStorage?.setItem(KEPT_AS, String(is)));

/** Convert a number's text, with as many significant digits. @param {string} text @param {number} size of the new unit @param {number} [digits] at least @returns {string} */
function converted(text, size, digits = DIGITS) {
  const value = Number(text.replace("−", "-")) / size;
  const written = text.replace(/e.*$/i, "").replace(/\D/g, "").replace(/^0+/, "").length;
  const rounded = String(Number(value.toPrecision(Math.max(digits, written))));
  const sign = text.startsWith("+") ? "+" : "";
  return sign + (text.includes("−") ? rounded.replace("-", "−") : rounded);
}

/** Return a text of the server as the page shows it: lengths and speeds in the shown unit, code without backticks. @param {string} text @returns {string} */
export function shownText(text) {
  if (typeof text !== "string") return text;
  const plain = text.replaceAll("`", "");
  if (!inches.value) return plain;
  return plain.replace(QUANTITIES, (_all, /** @type {string} */ number, /** @type {string} */ unit, /** @type {number} */ at) => {
    const [name, size] = SHOWN[unit];
    return `${converted(number, size, BOUND.test(plain.slice(0, at)) ? 1 : DIGITS)} ${name}`;
  });
}

/** Return a figure of the server in the shown unit; its value stays in SI. @template {{text: string, unit: string, note?: string}} Row @param {Row} row @returns {Row} */
export function shownRow(row) {
  const [unit, size] = SHOWN[row?.unit] ?? [];
  if (!row) return row;
  const note = row.note && shownText(row.note);
  if (!inches.value) return { ...row, note };
  if (!unit || !size) return { ...row, note };
  return { ...row, note, unit, text: row.text.replace(new RegExp(NUMBER, "g"), (number) => converted(number, size, BOUND.test(row.text.split(number)[0]) ? 1 : DIGITS)) };
}

/** Return the unit in which the page shows values of a unit. @param {string | undefined} unit @returns {string} */
export const shownUnit = (unit = "") => (inches.value ? (SHOWN[unit]?.[0] ?? unit) : unit);

/** Return a length with its unit. @param {number} m @param {number} [decimals] of mm @returns {string} */
export function lengthText(m, decimals = 3) {
  if (!inches.value) return `${(1000 * m).toFixed(decimals)} mm`;
  return `${((1000 * m) / INCH).toFixed(decimals + 1)} in`;
}

/**
 * Return the text of a field as it is shown. Five digits suffice to type a converted value again.
 * @param {string} text as in the file @param {string} unit of a number without a unit @returns {string}
 */
export function shownField(text, unit) {
  if (!inches.value) return text;
  const one = (/** @type {string} */ part) => {
    const [, number, own = unit] = new RegExp(`^(${NUMBER})(?: (.+))?$`).exec(part) ?? [];
    const [name, size] = SHOWN[own] ?? [];
    if (number === undefined || !name || !size) return part;
    return `${converted(number, size, 5)}${own === unit && isPlain(part) ? "" : ` ${name}`}`;
  };
  return text.split(", ").map(one).join(", ");
}

/** Return typed text as the server reads it: a number without a unit is in the shown one. @param {string} text @param {string} unit of the field @returns {string} */
export function typedField(text, unit) {
  if (!inches.value || !SHOWN[unit]) return text;
  return text.split(",").map((part) => (isPlain(part.trim()) ? `${part.trim()} ${SHOWN[unit][0]}` : part.trim())).join(", ");
}

/** Return a slider with the shown unit. @template {{unit: string, factor: number}} Slider @param {Slider} slider @returns {Slider} */
export function shownSlider(slider) {
  const [unit, size] = SHOWN[slider.unit] ?? [];
  if (!inches.value || !unit || !size) return slider;
  return { ...slider, unit, factor: slider.factor * size };
}
