// Tool path in space, in pieces coloured by the active limit.

import { styleOf } from "./colours.js";
import { indexAt } from "./state.js";
import { kindAt } from "./polylines.js";

/** @typedef {import("./motion.js").Motion} Motion */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./state.js").Numbers} Numbers */
/**
 * @typedef {object} Trail
 * @property {Float32Array} ends of its pieces in the work frame [m], (n, 6)
 * @property {Float32Array} colours of these ends, red green blue from 0 to 1 and linear, as WebGL mixes them, (n, 6)
 * @property {Float64Array} times when the tool is at the end of each piece [s], (n,)
 */

/** More pieces than this are not visible. */
const MAX_PIECES = 4000;
/** The tool needs at most this share of the duration for a piece: the trail follows it closely. */
const LONGEST = 1 / 400;

/**
 * The trail of a motion.
 * @param {Motion} motion
 * @param {Frame} picture says what is active when
 * @param {"light" | "dark"} theme
 * @returns {Trail}
 */
export function trailOf(motion, picture, theme) {
  const all = [...runsOf(motion, picture)].sort((a, b) => motionTime(a) - motionTime(b));
  const count = all.reduce((sum, x) => sum + x.times.length - 1, 0);
  const step = Math.max(1, Math.ceil(count / MAX_PIECES));
  const found = new Pieces(motion.duration * LONGEST);
  const known = new Map();
  for (const { points, times, rapid } of all) {
    for (let from = 0; from < times.length - 1; from += step) {
      const to = Math.min(from + step, times.length - 1);
      const kind = rapid ? "rapids between contours" : kindAt(picture, indexAt(picture.arrays.path_t, times[from]));
      const colour = known.get(kind) ?? channels(styleOf(kind, theme).colour);
      known.set(kind, colour);
      found.add(points.subarray(3 * from, 3 * from + 3), points.subarray(3 * to, 3 * to + 3), times[from], times[to], colour);
    }
  }
  return found.trail;
}

/** Collects pieces, the long ones in parts. */
class Pieces {
  /** @param {number} longest [s] */
  constructor(longest) {
    this.longest = longest;
    /** @type {number[]} */
    this.ends = [];
    /** @type {number[]} */
    this.colours = [];
    /** @type {number[]} */
    this.times = [];
  }

  /**
   * @param {Numbers} a
   * @param {Numbers} b
   * @param {number} from [s]
   * @param {number} to [s]
   * @param {number[]} colour
   */
  add(a, b, from, to, colour) {
    const parts = Math.max(1, Math.ceil((to - from) / this.longest));
    const point = (/** @type {number} */ share) => [0, 1, 2].map((j) => a[j] + share * (b[j] - a[j]));
    for (let k = 0; k < parts; k += 1) {
      this.ends.push(...point(k / parts), ...point((k + 1) / parts));
      this.colours.push(...colour, ...colour);
      this.times.push(from + ((k + 1) / parts) * (to - from));
    }
  }

  /** @returns {Trail} */
  get trail() {
    const { ends, colours, times } = this;
    return { ends: Float32Array.from(ends), colours: Float32Array.from(colours), times: Float64Array.from(times) };
  }
}

/** @typedef {{points: Numbers, times: Numbers, rapid: boolean}} Stretch */

/**
 * Contours and the ways between them; an executed motion is one stretch.
 * @param {Motion} motion
 * @param {Frame} picture
 * @returns {Generator<Stretch>}
 */
function* runsOf({ of, trail, trailTimes }, picture) {
  if (of === "executed") {
    yield { points: trail, times: trailTimes, rapid: false };
    return;
  }
  const { path_breaks, rapid_xyz, rapid_t, rapid_breaks = [] } = picture.arrays;
  yield* partsOf(trail, trailTimes, path_breaks, false);
  yield* partsOf(rapid_xyz, rapid_t, rapid_breaks, true);
}

/** @param {Numbers} points @param {Numbers} times @param {Numbers | number[]} breaks @param {boolean} rapid @returns {Generator<Stretch>} */
function* partsOf(points, times, breaks, rapid) {
  for (let k = 0; k + 1 < breaks.length; k += 1) {
    const [from, to] = [breaks[k], breaks[k + 1]];
    yield { points: points.subarray(3 * from, 3 * to), times: times.subarray(from, to), rapid };
  }
}

/** @param {Stretch} stretch @returns {number} when it begins [s] */
function motionTime({ times }) {
  return times[0] ?? 0;
}

/**
 * How many pieces the tool has passed.
 * @param {Trail} trail
 * @param {number} t [s]
 * @returns {number}
 */
export function passed({ times }, t) {
  if (times.length === 0 || t < times[0]) return 0;
  return indexAt(times, t) + 1;
}

/**
 * @param {string} hex such as "#0072B2"
 * @returns {number[]} 0 to 1
 */
function channels(hex) {
  const linear = (/** @type {number} */ x) => (x <= 0.04045 ? x / 12.92 : ((x + 0.055) / 1.055) ** 2.4);
  return [1, 3, 5].map((k) => linear(parseInt(hex.slice(k, k + 2), 16) / 255));
}
