// Numbers as text: fixed decimals, so that they do not jump in width while they change.

/** Figure that a missing number is shown as. */
export const NONE = "–";
/** Decimals of contour errors in mm. */
export const ERROR_DIGITS = 4;

/** @param {number | null | undefined} x @param {number} decimals @returns {string} */
function fixed(x, decimals) {
  return x === null || x === undefined || !Number.isFinite(x) ? NONE : x.toFixed(decimals).replace("-", "−");
}

/** Time. @param {number | null | undefined} s @returns {string} */
export const seconds = (s) => fixed(s, 3);

/** A length. @param {number | null | undefined} m @param {number} [decimals] @returns {string} mm */
export const mm = (m, decimals = 3) => fixed(m === null || m === undefined ? m : 1000 * m, decimals);

/** A share. @param {number | null | undefined} x @returns {string} percent */
export const percent = (x) => (x === null || x === undefined ? NONE : fixed(100 * x, x < 10 ? 1 : 0));

/** A difference with its sign. @param {number} x @param {number} decimals @returns {string} */
export const signed = (x, decimals) => {
  const shown = Math.abs(x) < 0.5 * 10 ** -decimals ? 0 : x;
  return (shown > 0 ? "+" : "") + fixed(shown, decimals);
};

/** A number with about four significant digits, without needless zeros. @param {number} x @returns {string} */
export function short(x) {
  if (!Number.isFinite(x)) return NONE;
  return String(Number(x.toPrecision(4)));
}

const NUMBER = String.raw`[-+]?(?:\d+\.?\d*|\.\d+)(?:[eE][-+]?\d+)?`;
const PLAIN = RegExp(`^${NUMBER}$`);

/** Whether a quantity is written without a unit. @param {string} text @returns {boolean} */
export const isPlain = (text) => PLAIN.test(text);

/**
 * What somebody typed over a quantity: a plain number has the unit that is shown.
 * @param {string} typed @param {string} shown @param {string} [unit] where nothing with a unit is shown
 * @returns {string}
 */
export function withUnit(typed, shown, unit = "") {
  // Where the file has a plain number, in SI units, so is what is typed.
  if (!isPlain(typed) || isPlain(shown)) return typed;
  // The blank between belongs to neither: of "25 1/s" the unit is "1/s".
  const known = RegExp(`^${NUMBER}(.*)$`).exec(shown)?.[1].trim() ?? unit;
  return known ? `${typed} ${known}` : typed;
}

/** A quantity of a slider, such as "150 mm/s". @param {number} value SI @param {{unit: string, factor: number}} of @returns {string} */
export const quantity = (value, { unit, factor }) => `${short(value / factor)}${unit ? ` ${unit}` : ""}`;
