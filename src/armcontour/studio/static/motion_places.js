// Places in the time of a motion: contours, stops, the slowest place.

import { largest } from "./polylines.js";
import { along, indexAt } from "./state.js";

/** @typedef {import("./state.js").Frame} Frame */

/** Times that differ by less are one place [s]. */
const SAME = 1e-6;
/** The tool stands still below this share of its largest speed. */
const STILL = 1e-4;

/** Return begin and end of each contour, in the order of the motion [s]. @param {Frame} picture @returns {[number, number][]} */
export const contourTimes = (picture) => picture.head.contours.map((/** @type {any} */ x) => x.t ?? []);

/** Return the index of the contour at a time, or -1 between contours. @param {Frame} picture @param {number} t s @returns {number} */
export const contourAt = (picture, t) => contourTimes(picture).findIndex(([begin, end]) => t >= begin && t <= end);

/**
 * Return the contour that begins next, or the one that began last before a time; -1 if there is none.
 * @param {Frame} picture @param {number} t s @param {1 | -1} way @returns {number}
 */
export function contourBeside(picture, t, way) {
  const times = contourTimes(picture);
  if (way > 0) return times.findIndex(([begin]) => begin > t + SAME);
  return times.findLastIndex(([begin]) => begin < t - SAME);
}

/** Return the times at which the tool stands still on contours, in order [s]. @param {Frame} picture @returns {number[]} */
export function stopsOf({ arrays: { path_t: times, speed } }) {
  const still = STILL * largest(speed);
  const stops = /** @type {number[]} */ ([]);
  for (let i = 0; i < times.length; i++) {
    const isNew = !stops.length || times[i] > stops[stops.length - 1] + SAME;
    if (speed[i] <= still && isNew) stops.push(times[i]);
  }
  return stops;
}

/** Return the next stop, or the one before a time [s]; undefined if there is none. @param {Frame} picture @param {number} t s @param {1 | -1} way @returns {number | undefined} */
export function stopBeside(picture, t, way) {
  const stops = stopsOf(picture);
  return way > 0 ? stops.find((x) => x > t + SAME) : stops.findLast((x) => x < t - SAME);
}

/**
 * Return the time at which the tool is slowest inside a contour, as a share of the assigned speed [s]. Speeds that only rise at the begin
 * of a contour and fall at its end do not count; undefined if there is no other minimum.
 * @param {Frame} picture @returns {number | undefined}
 */
export function slowestOf({ arrays: { path_t: times, speed, assigned, path_breaks: breaks } }) {
  const fastest = largest(speed);
  const shareAt = (/** @type {number} */ i) => speed[i] / (Number.isFinite(assigned[i]) ? assigned[i] : fastest);
  let [found, least] = [/** @type {number | undefined} */ (undefined), Infinity];
  for (let k = 0; k + 1 < breaks.length; k++) {
    let isFalling = false;
    // Index of the first point of the lowest speed since the speed has fallen.
    let low = breaks[k];
    for (let i = breaks[k] + 1; i < breaks[k + 1]; i++) {
      const [before, now] = [shareAt(i - 1), shareAt(i)];
      if (now < before) {
        isFalling = true;
        low = i;
      }
      if (now > before && isFalling) {
        if (shareAt(low) < least) [found, least] = [times[low], shareAt(low)];
        isFalling = false;
      }
    }
  }
  return found;
}

/**
 * Return the planned tool speed at a time, and the index of the contour there; between contours -1, and NaN if the tool waits there.
 * @param {Frame} picture @param {number} t s @returns {{speed: number, contour: number}} speed [m/s]
 */
export function speedAt(picture, t) {
  const contour = contourAt(picture, t);
  const { path_t: times, speed, path_breaks: breaks, rapid_t: rapidTimes, rapid_speed: rapidSpeed, rapid_breaks: rapidBreaks } = picture.arrays;
  if (contour >= 0) return { speed: within(times, speed, breaks, contour, t), contour };
  if (!rapidBreaks) return { speed: NaN, contour };
  const rapid = indexAt(rapidBreaks, indexAt(rapidTimes, t));
  const last = rapidBreaks[rapid + 1] - 1;
  const isRapid = t >= rapidTimes[rapidBreaks[rapid]] && t <= rapidTimes[last];
  return { speed: isRapid ? within(rapidTimes, rapidSpeed, rapidBreaks, rapid, t) : NaN, contour };
}

/** Interpolate values of one line. @param {import("./state.js").Numbers} times @param {import("./state.js").Numbers} values @param {import("./state.js").Numbers} breaks @param {number} line @param {number} t s */
const within = (times, values, breaks, line, t) => along(times.subarray(breaks[line], breaks[line + 1]), values.subarray(breaks[line], breaks[line + 1]), t)[0];
