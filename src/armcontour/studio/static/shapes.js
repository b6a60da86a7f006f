// Shapes that are measured: points, straight lines, circles and arcs, and other curves; their distances and angles.

import { cross, dot, length, minus, plus, unit } from "./vectors.js";

/** @typedef {import("./vectors.js").Vector} Vector */
/** @typedef {import("./state.js").Numbers} Numbers */
/**
 * A shape in the work frame [m]. `points` is a polyline through it. A circle or an arc has a centre, a radius and an axis.
 * @typedef {Object} Shape
 * @property {"point" | "line" | "circle" | "arc" | "curve"} kind
 * @property {Vector[]} points
 * @property {number} length
 * @property {Vector} [centre]
 * @property {number} [radius]
 * @property {Vector} [axis]
 * @property {string} [of]   what a point is, in words
 * @property {Shape} [round]   the circle or the arc of which a point is the centre
 */
/**
 * What two shapes measure: the ends of the shortest line between them, its length and components [m], and their angle [rad].
 * @typedef {{ends: [Vector, Vector], distance: number, components: Vector, angle: number | null, fromCentres: number}} Measured
 *   `fromCentres` is the number of shapes that count as their centres
 */

/** Largest angle between points of an arc's polyline [rad]. */
const PIECE = Math.PI / 36;
/** Largest relative difference of the centres of arcs that are one. */
const SAME = 1e-6;
/** Smallest sine of the angle between lines that are not parallel. */
const PARALLEL = 1e-9;

/** @param {Vector} p @param {string} of what it is a point @returns {Shape} */
export const pointShape = (p, of) => ({ kind: "point", points: [p], length: 0, of });

/** @param {Vector} a @param {Vector} b @returns {Shape} */
export const lineShape = (a, b) => ({ kind: "line", points: [a, b], length: length(minus(b, a)) });

/**
 * Return an arc from a start, in the plane of its tangent and its normal.
 * @param {Vector} start @param {Vector} tangent unit @param {Vector} normal unit, towards the centre @param {number} radius m @param {number} arcLength m @returns {Shape}
 */
export function arcShape(start, tangent, normal, radius, arcLength) {
  const angle = arcLength / radius;
  const count = Math.max(2, Math.ceil(angle / PIECE));
  const centre = plus(start, normal, radius);
  const points = Array.from({ length: count + 1 }, (_, k) => {
    const a = (k * angle) / count;
    return plus(plus(centre, tangent, radius * Math.sin(a)), normal, -radius * Math.cos(a));
  });
  const isWhole = Math.abs(angle - 2 * Math.PI) < SAME;
  return { kind: isWhole ? "circle" : "arc", points, length: arcLength, centre, radius, axis: cross(tangent, normal) };
}

/** Return a circle. @param {Vector} centre @param {Vector} axis unit @param {number} radius m @returns {Shape} */
export function circleShape(centre, axis, radius) {
  const across = Math.abs(axis[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const normal = unit(plus(across, axis, -dot(across, axis)));
  return arcShape(plus(centre, normal, -radius), cross(normal, axis), normal, radius, 2 * Math.PI * radius);
}

/** Return the circle through three points; null if they are on a line. @param {Vector} a @param {Vector} b @param {Vector} c @returns {{centre: Vector, radius: number, axis: Vector} | null} */
export function circleThrough(a, b, c) {
  const [u, v] = [minus(b, a), minus(c, a)];
  const n = cross(u, v);
  const square = dot(n, n);
  if (square <= (PARALLEL * length(u) * length(v)) ** 2) return null;
  const toward = plus(cross(n, u).map((x) => x * dot(v, v)), cross(v, n), dot(u, u)).map((x) => x / (2 * square));
  return { centre: plus(a, toward), radius: length(toward), axis: unit(n) };
}

/**
 * Return the shapes of the segments of a drawing; arcs that continue each other are one.
 * @param {Record<string, Numbers>} arrays of the frame `segments` @param {number} count @returns {Shape[]}
 */
export function shapesOfSegments({ starts, ends, tangents, normals, curvatures, lengths }, count) {
  const row = (/** @type {Numbers} */ table, /** @type {number} */ k) => Array.from(table.subarray(3 * k, 3 * k + 3));
  const found = /** @type {Shape[]} */ ([]);
  for (let k = 0; k < count; k += 1) {
    const [start, end] = [row(starts, k), row(ends, k)];
    if (Number.isNaN(curvatures[k])) found.push({ kind: "curve", points: [start, end], length: lengths[k] });
    else if (curvatures[k] === 0) found.push(lineShape(start, end));
    else addArc(found, arcShape(start, row(tangents, k), row(normals, k), 1 / curvatures[k], lengths[k]));
  }
  return found;
}

/** Add an arc, to the arc before it if that is a part of the same circle. @param {Shape[]} found @param {Shape} arc */
function addArc(found, arc) {
  const before = found.at(-1);
  const near = SAME * (arc.radius ?? 1);
  const isSame = before?.kind === "arc" && before.centre && arc.centre && before.axis && arc.axis && length(minus(before.centre, arc.centre)) < near
    && Math.abs((before.radius ?? 0) - (arc.radius ?? 0)) < near && dot(before.axis, arc.axis) > 1 - SAME && length(minus(/** @type {Vector} */ (before.points.at(-1)), arc.points[0])) < near;
  if (!before || !isSame) {
    found.push(arc);
    return;
  }
  const whole = before.length + arc.length;
  const isCircle = Math.abs(whole / (arc.radius ?? 1) - 2 * Math.PI) < SAME;
  found[found.length - 1] = { ...before, kind: isCircle ? "circle" : "arc", points: [...before.points, ...arc.points.slice(1)], length: whole };
}

/** Return what counts for distances: the centre of a circle or an arc, else the shape itself. @param {Shape} shape @returns {Vector[]} */
const measuredPoints = ({ centre, points }) => (centre ? [centre] : points);

/**
 * Return the distance, the components and the angle of two shapes.
 * @param {Shape} a @param {Shape} b @returns {Measured}
 */
export function measure(a, b) {
  const [first, second] = [measuredPoints(a), measuredPoints(b)];
  let best = /** @type {[Vector, Vector]} */ ([first[0], second[0]]);
  let least = Infinity;
  for (let i = 0; i < Math.max(1, first.length - 1); i += 1)
    for (let j = 0; j < Math.max(1, second.length - 1); j += 1) {
      const ends = closest(first[i], first[i + 1] ?? first[i], second[j], second[j + 1] ?? second[j]);
      const away = length(minus(ends[1], ends[0]));
      if (away < least) [best, least] = [ends, away];
    }
  return { ends: best, distance: least, components: minus(best[1], best[0]), angle: angleOf(a, b), fromCentres: Number(Boolean(a.centre)) + Number(Boolean(b.centre)) };
}

/** Return the angle between two straight lines, or between the axes of two circles, at most 90° [rad]; null for other shapes. @param {Shape} a @param {Shape} b @returns {number | null} */
function angleOf(a, b) {
  const [u, v] = [a, b].map((shape) => shape.axis ?? (shape.kind === "line" ? unit(minus(shape.points[1], shape.points[0])) : null));
  if (!u || !v || Boolean(a.axis) !== Boolean(b.axis)) return null;
  return Math.atan2(length(cross(u, v)), Math.abs(dot(u, v)));
}

/** Return the nearest points of two segments, or of points. @param {Vector} a @param {Vector} b @param {Vector} c @param {Vector} d @returns {[Vector, Vector]} */
function closest(a, b, c, d) {
  const [u, v, w] = [minus(b, a), minus(d, c), minus(a, c)];
  const [A, B, C, D, E] = [dot(u, u), dot(u, v), dot(v, v), dot(u, w), dot(v, w)];
  const clamp = (/** @type {number} */ x) => Math.min(1, Math.max(0, x));
  const square = A * C - B * B;
  // Parallel segments have many nearest points: the middle is taken, where it has one.
  let s = square > PARALLEL * A * C ? clamp((B * E - C * D) / square) : A ? 0.5 : 0;
  const t = C ? clamp((B * s + E) / C) : 0;
  if (A) s = clamp((B * t - D) / A);
  return [plus(a, u, s), plus(c, v, C ? clamp((B * s + E) / C) : 0)];
}
