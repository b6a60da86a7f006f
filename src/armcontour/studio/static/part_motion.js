// Motion of the part in its plane between two pictures.

/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {{by: [number, number], turn: number}} Move a turn [rad] about the origin, then a shift [m] */

/** Paths are the same within this share of their size: pictures are in single precision. */
const SAME = 1e-4;

/**
 * The rigid motion from one picture's path to another's; null if it is another path.
 * @param {Frame} before
 * @param {Frame} now
 * @returns {Move | null}
 */
export function movedSince(before, now) {
  const [a, b] = [before.arrays.objective, now.arrays.objective];
  if (a.length !== b.length || a.length < 4) return null;
  const far = farthest(a);
  const from = arrow(a, far);
  const to = arrow(b, far);
  const turn = Math.atan2(from[0] * to[1] - from[1] * to[0], from[0] * to[0] + from[1] * to[1]);
  const [c, s] = [Math.cos(turn), Math.sin(turn)];
  const size = Math.hypot(...from);
  for (let k = 0; k < a.length; k += 2) {
    const [x, y] = [a[k] - a[0], a[k + 1] - a[1]];
    const off = Math.hypot(c * x - s * y - (b[k] - b[0]), s * x + c * y - (b[k + 1] - b[1]));
    if (off > SAME * size) return null;
  }
  const start = [a[0] + before.head.centre[0], a[1] + before.head.centre[1]];
  const end = [b[0] + now.head.centre[0], b[1] + now.head.centre[1]];
  return { turn, by: [end[0] - (c * start[0] - s * start[1]), end[1] - (s * start[0] + c * start[1])] };
}

/**
 * The edit that takes a part, which was moved since, to a place that is given from where it was before.
 * @param {[number, number, number]} shift right, up [m] and turn [rad] about `about`, from before
 * @param {Move} moved since then
 * @param {[number, number]} about [m]
 * @returns {{do: "place", by: [number, number], turn: number, about: [number, number]}}
 */
export function moveTo(shift, moved, about) {
  const [c, s] = [Math.cos(moved.turn), Math.sin(moved.turn)];
  // Where the point `about` of the part is now.
  const now = /** @type {[number, number]} */ ([
    c * about[0] - s * about[1] + moved.by[0], s * about[0] + c * about[1] + moved.by[1],
  ]);
  const by = /** @type {[number, number]} */ ([about[0] + shift[0] - now[0], about[1] + shift[1] - now[1]]);
  return { do: "place", by, turn: shift[2] - moved.turn, about: now };
}

/** Index of the point farthest from the first one. @param {ArrayLike<number>} points */
function farthest(points) {
  let [best, most] = [2, -1];
  for (let k = 2; k < points.length; k += 2) {
    const far = Math.hypot(points[k] - points[0], points[k + 1] - points[1]);
    if (far > most) [best, most] = [k, far];
  }
  return best;
}

/** @param {ArrayLike<number>} points @param {number} k */
function arrow(points, k) {
  return [points[k] - points[0], points[k + 1] - points[1]];
}
