// Lines of a picture as paths in metres, one per colour: created once per picture, drawn often.

import { ALL, BETWEEN, shadeOf, styleOf } from "./colours.js";
import { along, indexAt } from "./state.js";
import { boxOf } from "./viewport.js";

/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {"light" | "dark"} Theme */
/** @typedef {{path: Path2D, colour: string, dash: number[]}} Stroke */
/** Visible part of a large picture: a box, without details up to the size `least` [m]. @typedef {import("./viewport.js").Box & {least: number}} Part */

const SHADES = 16;
// Dashes take longer to draw than the line itself, so long paths are drawn solid.
const MAX_DASHED = 6000;
/**
 * Make lines through points; a new line starts at every break.
 * @param {Numbers} points pairs @param {Iterable<number>} [breaks] indices of first points @param {Part | null} [part] @returns {Path2D}
 */
export function polyline(points, breaks = [], part = null) {
  return buckets(points, () => 0, new Set([0, ...breaks]), part).get(0) ?? new Path2D();
}

/** Return the squared distance to a piece of a polyline. @param {number} u @param {number} v @param {Numbers} points @param {number} k */
function squaredDistance(u, v, points, k) {
  const [du, dv] = [points[k + 2] - points[k], points[k + 3] - points[k + 1]];
  const square = du * du + dv * dv;
  const share = square > 0 ? Math.min(1, Math.max(0, ((u - points[k]) * du + (v - points[k + 1]) * dv) / square)) : 0;
  return (u - points[k] - share * du) ** 2 + (v - points[k + 1] - share * dv) ** 2;
}

/**
 * Sort the pieces between successive points into one path per bucket.
 * @param {Numbers} points pairs @param {(i: number) => number} bucketOf of the piece from point i to i + 1; below 0: not drawn
 * @param {Set<number>} starts first points of lines @param {Part | null} part
 * @returns {Map<number, Path2D>}
 */
function buckets(points, bucketOf, starts, part) {
  /** @type {Map<number, Path2D>} */
  const all = new Map();
  const count = points.length / 2;
  let last = -1;
  /** The last drawn point, and the end of the pieces after it. */
  let [from, to] = [0, 0];
  /** @type {Path2D | undefined} */
  let path;
  const finish = () => from !== to && path?.lineTo(points[2 * to], points[2 * to + 1]);
  for (let i = 0; i + 1 < count; i++) {
    const bucket = starts.has(i + 1) || (part && !touches(points, 2 * i, part)) ? -1 : bucketOf(i);
    if (bucket !== last) {
      finish();
      path = all.get(bucket);
      if (bucket >= 0 && !path) all.set(bucket, (path = new Path2D()));
      if (bucket >= 0) path?.moveTo(points[2 * i], points[2 * i + 1]);
      from = to = i;
      last = bucket;
    }
    if (bucket < 0) continue;
    to = i + 1;
    if (part && Math.abs(points[2 * to] - points[2 * from]) + Math.abs(points[2 * to + 1] - points[2 * from + 1]) < part.least) continue;
    finish();
    from = to;
  }
  finish();
  return all;
}

/** Return whether a piece may be in a box. @param {Numbers} points @param {number} k @param {Part} part */
const touches = (points, k, { left, right, bottom, top }) =>
  Math.max(points[k], points[k + 2]) >= left && Math.min(points[k], points[k + 2]) <= right &&
  Math.max(points[k + 1], points[k + 3]) >= bottom && Math.min(points[k + 1], points[k + 3]) <= top;

/** Line pieces by grid cell, so that the piece nearest to a point is found without a scan of all pieces. */
export class PieceGrid {
  /** @param {Numbers} points pairs @param {Set<number>} starts first points of lines */
  constructor(points, starts) {
    this.points = points;
    this.box = boxOf(points) ?? { left: 0, right: 0, bottom: 0, top: 0 };
    const { left, right, bottom, top } = this.box;
    this.side = Math.max(right - left, top - bottom, 1e-9) / Math.ceil(Math.sqrt(points.length / 2));
    /** @type {Map<number, Set<number>>} pieces by cell */
    this.cells = new Map();
    for (let i = 0; 2 * i + 3 < points.length; i++) {
      if (starts.has(i + 1)) continue;
      const [u, v] = [points[2 * i], points[2 * i + 1]];
      const [du, dv] = [points[2 * i + 2] - u, points[2 * i + 3] - v];
      // The box of a part up to the length of a cell covers at most four cells.
      const parts = Math.max(1, Math.ceil(Math.hypot(du, dv) / this.side));
      for (let k = 0; k < parts; k++) {
        const [a, b] = [k / parts, (k + 1) / parts];
        for (const cell of this.within(u + a * du, v + a * dv, u + b * du, v + b * dv))
          this.cells.set(cell, (this.cells.get(cell) ?? new Set()).add(i));
      }
    }
  }

  /** List the cells of a box, given by two opposite corners [m]. @param {number} u @param {number} v @param {number} x @param {number} y */
  *within(u, v, x, y) {
    const { side, box } = this;
    const column = (/** @type {number} */ a) => Math.floor((Math.min(box.right, Math.max(box.left, a)) - box.left) / side);
    const row = (/** @type {number} */ a) => Math.floor((Math.min(box.top, Math.max(box.bottom, a)) - box.bottom) / side);
    for (let i = column(Math.min(u, x)); i <= column(Math.max(u, x)); i++)
      for (let j = row(Math.min(v, y)); j <= row(Math.max(v, y)); j++) yield 2 ** 20 * i + j;
  }

  /** Return the first point of the piece nearest to a point; -1 if none is nearer than `near`. @param {number} u @param {number} v @param {number} near m */
  nearest(u, v, near) {
    let [best, least] = [-1, near * near];
    for (const cell of this.within(u - near, v - near, u + near, v + near))
      for (const i of this.cells.get(cell) ?? []) {
        const distance = squaredDistance(u, v, this.points, 2 * i);
        if (distance < least || (distance === least && i < best)) [best, least] = [i, distance];
      }
    return best;
  }
}

/** Return the largest tolerance of rounded corners. @param {Frame} picture @returns {number} m */
export function bandOf(picture) {
  return Math.max(0, ...picture.head.corners.map((/** @type {any} */ c) => c.allowed ?? 0));
}

/** Return the first points of the contours on the path. @param {Frame} picture @returns {Set<number>} */
export function startsOf(picture) {
  return new Set(picture.arrays.path_breaks);
}

/**
 * Return the kind of the limit that is active after a point; "unknown" without an explanation.
 * @param {Frame} picture @param {number} i @returns {string}
 */
export function kindAt(picture, i) {
  if (!picture.head.limits.length) return "unknown";
  return picture.head.limits[picture.arrays.binding[i]]?.kind ?? BETWEEN;
}

/** Return the middle of the longest interval with an active limit kind [s]. @param {Frame} picture @param {string} kind @returns {number | undefined} */
export function timeOf(picture, kind) {
  const { path_t: t } = picture.arrays;
  const starts = startsOf(picture);
  let [found, longest] = [/** @type {number | undefined} */ (undefined), 0];
  for (let from = 0; from + 1 < t.length;) {
    let to = from + 1;
    const is = kindAt(picture, from) === kind;
    while (to + 1 < t.length && !starts.has(to) && (kindAt(picture, to) === kind) === is) to++;
    if (is && t[to] - t[from] > longest) [found, longest] = [(t[from] + t[to]) / 2, t[to] - t[from]];
    from = to;
  }
  return found;
}

/** @param {Frame} picture @param {Theme} theme @param {Part | null} part @returns {Stroke[]} */
export function strokesByLimit(picture, theme, part) {
  const { path } = picture.arrays;
  const kinds = /** @type {string[]} */ ([]);
  const bucketOf = (/** @type {number} */ i) => {
    const kind = kindAt(picture, i);
    if (!kinds.includes(kind)) kinds.push(kind);
    return kinds.indexOf(kind);
  };
  const found = buckets(path, bucketOf, startsOf(picture), part);
  return [...found].map(([k, way]) => {
    const { colour, dash } = styleOf(kinds[k], theme);
    return { path: way, colour, dash: path.length > 2 * MAX_DASHED ? [] : dash };
  });
}

/** Return the error at 100 % of the colour scale [m]: the allowed one, or else the largest. @param {Frame | null} executed @returns {number} */
export const scaleOf = (executed) => executed?.head.allowed ?? largest(executed?.arrays.off ?? []);

/**
 * @param {Numbers} points pairs @param {Numbers} values one per point @param {number} most value of the last shade; larger ones are alarms
 * @param {Theme} theme @param {Set<number>} starts first points of lines @param {Part | null} part
 * @returns {Stroke[]}
 */
export function strokesByHeat(points, values, most, theme, starts, part) {
  const bucketOf = (/** @type {number} */ i) => {
    const share = values[i] / most || 0;
    return share > ALL ? SHADES : Math.round(Math.min(1, share) * (SHADES - 1));
  };
  const found = buckets(points, bucketOf, starts, part);
  return [...found].map(([k, path]) => ({ path, colour: shadeOf(k / (SHADES - 1), theme), dash: [] }));
}

/**
 * Return the parts of the path on which the process is off, such as leads and tabs.
 * @param {Frame} picture @returns {Path2D}
 */
export function idleOf(picture) {
  const { idle = [], path, path_s, path_breaks: breaks } = picture.arrays;
  const lines = new Path2D();
  for (let k = 0; k < idle.length; k += 3) {
    const [begin, end] = [breaks[idle[k]], breaks[idle[k] + 1]];
    const [places, line] = [path_s.subarray(begin, end), path.subarray(2 * begin, 2 * end)];
    const [from, to] = [idle[k + 1], idle[k + 2]];
    const [first, last] = [along(places, line, from, 2), along(places, line, to, 2)];
    lines.moveTo(first[0], first[1]);
    for (let i = indexAt(places, from) + 1; places[i] < to; i++) lines.lineTo(line[2 * i], line[2 * i + 1]);
    lines.lineTo(last[0], last[1]);
  }
  return lines;
}

/** @typedef {{at: [number, number], along: [number, number]}} Place a point, and a direction of length 1 */

/**
 * Return each contour's start and direction, the outward direction there, its size, and a later point.
 * @param {Frame} picture @returns {(Place & {out: [number, number], centre: [number, number], size: number, inner: Place, number: string, isPierced: boolean})[]}
 */
export function marksOf({ head, arrays }) {
  const [points, breaks] = arrays.path?.length ? [arrays.path, arrays.path_breaks] : [arrays.objective, arrays.objective_breaks];
  return head.contours.map((/** @type {any} */ { number, pierces }, /** @type {number} */ k) => {
    const line = points.subarray(2 * breaks[k], 2 * breaks[k + 1]);
    const { left, right, bottom, top } = /** @type {import("./viewport.js").Box} */ (boxOf(line));
    const out = unit(line[0] - (left + right) / 2, line[1] - (bottom + top) / 2);
    const size = Math.max(right - left, top - bottom);
    const centre = /** @type {[number, number]} */ ([(left + right) / 2, (bottom + top) / 2]);
    return { ...placeOn(line, 0), out, size, centre, inner: placeOn(line, line.length >> 2), number: String(number), isPierced: pierces };
  });
}

/** @param {Numbers} line @param {number} i index of a point @returns {Place} with the direction to the next point that is elsewhere */
function placeOn(line, i) {
  const [u, v] = [line[2 * i], line[2 * i + 1]];
  let next = 2 * i + 2;
  while (next + 3 < line.length && line[next] === u && line[next + 1] === v) next += 2;
  return { at: [u, v], along: unit(line[next] - u, line[next + 1] - v) };
}

/** @param {number} u @param {number} v @returns {[number, number]} */
const unit = (u, v) => [u / (Math.hypot(u, v) || 1), v / (Math.hypot(u, v) || 1)];

/**
 * Return the executed tool path with magnified error, and lines from the path to it.
 * @param {Frame} executed @param {number} magnify @returns {{tool: Path2D, errors: Path2D}}
 */
export function magnified(executed, magnify) {
  const { base, offset } = executed.arrays;
  const points = new Float32Array(base.length);
  for (let i = 0; i < base.length; i++) points[i] = base[i] + magnify * offset[i];
  const errors = new Path2D();
  const step = Math.max(1, Math.round(base.length / 2 / 240));
  for (let i = 0; 2 * i < base.length; i += step) {
    errors.moveTo(base[2 * i], base[2 * i + 1]);
    errors.lineTo(points[2 * i], points[2 * i + 1]);
  }
  return { tool: polyline(points, executed.arrays.breaks), errors };
}

/** Return the largest positive number, or 0. @param {Iterable<number | null>} values @returns {number} */
export function largest(values) {
  let most = 0;
  for (const x of values) if (x !== null && x > most) most = x;
  return most;
}
