// Labels of a time axis: seconds, minutes or hours, at round times.

import { roundUp } from "./viewport.js";

const [MINUTE, HOUR] = [60, 3600]; // s
/** Motions that last at least this long have labels in minutes [s]. */
const MINUTES_FROM = 2 * MINUTE;
/** Round steps of clocks, from a second to a day [s]. */
const CLOCK_STEPS = [1, 2, 5, 10, 15, 30, ...[1, 2, 5, 10, 15, 30].map((x) => x * MINUTE), ...[1, 2, 3, 6, 12, 24].map((x) => x * HOUR)];

/** Return a round step between labels. @param {number} least s @param {number} duration of the motion [s] @returns {number} s */
export function timeStep(least, duration) {
  if (duration < MINUTES_FROM || least < CLOCK_STEPS[0] / 2) return roundUp(least);
  const day = 24 * HOUR;
  return CLOCK_STEPS.find((x) => x >= least) ?? day * roundUp(least / day);
}

/**
 * Write a time: as "12.5 s", in a motion of minutes as "2:05 min", in one of hours as "1:30 h", or "1:30:05" between minutes.
 * @param {number} t s @param {number} step between labels [s] @param {number} duration of the motion [s] @returns {string}
 */
export function timeLabel(t, step, duration) {
  const decimals = Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
  const rounded = Number(t.toFixed(decimals));
  if (duration < MINUTES_FROM) return `${rounded} s`;
  const two = (/** @type {number} */ x) => String(x).padStart(2, "0");
  const [hours, minutes] = [Math.floor(rounded / HOUR), Math.floor(rounded / MINUTE)];
  const seconds = (rounded - minutes * MINUTE).toFixed(decimals).padStart(decimals ? decimals + 3 : 2, "0");
  if (duration < HOUR) return `${minutes}:${seconds} min`;
  const clock = `${hours}:${two(minutes % 60)}`;
  return step >= MINUTE ? `${clock} h` : `${clock}:${seconds}`;
}
