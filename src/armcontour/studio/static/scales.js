// Values of sliders and their positions, on linear and logarithmic scales.

/**
 * A quantity that can be set; the server's words, see the contract of frames in `sliders.py`.
 * @typedef {{key: string, label: string, group: string, value: number | string | null, written: string | null, unit: string,
 *   factor: number, min: number, max: number, log: boolean, choices?: (string | number)[] | null, from: string}} Slider
 */

/** Positions of a slider are whole numbers from 0 to this. */
export const STEPS = 1000;

/** @param {Slider} slider @param {number} value SI @returns {number} */
export function positionOf({ min, max, log }, value) {
  const share = log ? Math.log(value / min) / Math.log(max / min) : (value - min) / (max - min);
  return Math.round(STEPS * Math.min(1, Math.max(0, share)));
}

/** Value at a position, with three digits in the slider's unit. @param {Slider} slider @param {number} position @returns {number} SI */
export function valueAt({ min, max, log, factor }, position) {
  const share = position / STEPS;
  const value = log ? min * (max / min) ** share : min + share * (max - min);
  return Number((Number((value / factor).toPrecision(3)) * factor).toPrecision(12));
}
