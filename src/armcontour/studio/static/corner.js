// Tolerance of a rounded corner as a position: the apex of the rounding on the corner's bisector.

import { mm } from "./format.js";
import { shownText } from "./units.js";

/** @typedef {[number, number]} Point */
/**
 * A rounded corner, as in pictures; lengths in metres.
 * @typedef {{index: number, vertex: number, apex: Point, corner: Point, error: number,
 *   allowed: number | null, radius: number, reason: string}} Corner
 */

/** Smallest tolerance by dragging; smaller ones can be typed. */
export const LEAST_TOLERANCE = 1e-5; // m
// The handle is beyond the apex by this, so that it does not lie on the waypoint.
const BEYOND = 20; // px

/** Return the direction from a corner to its apex. @param {Corner} corner @returns {Point} of length 1 */
function bisectorOf({ apex, corner }) {
  const [du, dv] = [apex[0] - corner[0], apex[1] - corner[1]];
  const length = Math.hypot(du, dv);
  return length > 0 ? [du / length, dv / length] : [0, 1];
}

/**
 * Project a displacement onto a corner's bisector, away from the corner. By arrow keys, up and right lead away.
 * @param {Corner} corner @param {Point} by m @param {boolean} byKeys @returns {number} m
 */
export function along(corner, [du, dv], byKeys) {
  const [bu, bv] = bisectorOf(corner);
  return byKeys ? du + dv : du * bu + dv * bv;
}

/** Return the apex of a corner that uses its whole tolerance. @param {Corner} corner @param {number} value m @returns {Point} */
export function apexAt(corner, value) {
  const [du, dv] = bisectorOf(corner);
  return [corner.corner[0] + value * du, corner.corner[1] + value * dv];
}

/** Return where the handle of an apex is drawn. @param {Corner} corner @param {Point} apex px @returns {Point} px */
export function beyond(corner, [x, y]) {
  const [du, dv] = bisectorOf(corner);
  return [x + BEYOND * du, y - BEYOND * dv];
}

/** List the corners of a picture that have a handle. @param {{head: any} | null} picture @returns {Corner[]} */
export function handledOf(picture) {
  return (picture?.head.corners ?? []).filter((/** @type {any} */ x) => x.apex && x.corner && x.allowed !== null);
}

/** @param {Corner} corner @returns {string} */
export function wordsOf({ error, allowed, reason }) {
  return shownText(`corner error ${mm(error)} mm of ${mm(allowed)} mm${reason ? `, ${reason}` : ""}`);
}
