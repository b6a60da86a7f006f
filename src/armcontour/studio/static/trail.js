// The tool's path in space, in short pieces coloured by the limit that binds there.

import { styleOf } from "./colours.js";
import { indexAt } from "./state.js";
import { kindAt } from "./strokes.js";

/** @typedef {import("./motion.js").Motion} Motion */
/** @typedef {import("./state.js").Frame} Frame */
/**
 * @typedef {object} Trail
 * @property {Float32Array} ends of its pieces in the work frame [m], (n, 6)
 * @property {Float32Array} colours of these ends, red green blue from 0 to 1, (n, 6)
 * @property {Float64Array} times when the tool is at the end of each piece [s], (n,)
 */

/** More pieces than this are not visible. */
const MOST_PIECES = 4000;

/**
 * The trail of a motion.
 * @param {Motion} motion
 * @param {Frame} picture says what binds when
 * @param {"light" | "dark"} theme
 * @returns {Trail}
 */
export function trailOf({ trail, trailTimes }, picture, theme) {
  const count = Math.min(trail.length / 3, trailTimes.length);
  const step = Math.max(1, Math.ceil((count - 1) / MOST_PIECES));
  const pieces = Math.max(0, Math.ceil((count - 1) / step));
  const ends = new Float32Array(6 * pieces);
  const colours = new Float32Array(6 * pieces);
  const times = new Float64Array(pieces);
  /** @type {Map<string, number[]>} */
  const known = new Map();
  for (let k = 0; k < pieces; k += 1) {
    const [from, to] = [k * step, Math.min((k + 1) * step, count - 1)];
    for (let j = 0; j < 3; j += 1) {
      ends[6 * k + j] = trail[3 * from + j];
      ends[6 * k + 3 + j] = trail[3 * to + j];
    }
    const kind = kindAt(picture, indexAt(picture.arrays.path_t, trailTimes[from]));
    const colour = known.get(kind) ?? channels(styleOf(kind, theme).colour);
    known.set(kind, colour);
    colours.set(colour, 6 * k);
    colours.set(colour, 6 * k + 3);
    times[k] = trailTimes[to];
  }
  return { ends, colours, times };
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
  return [1, 3, 5].map((k) => parseInt(hex.slice(k, k + 2), 16) / 255);
}
