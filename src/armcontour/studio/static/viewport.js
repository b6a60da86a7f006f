// Visible part of the drawing's plane: metres relative to the drawing's centre <-> pixels.

/** @typedef {[number, number]} Point */
/** @typedef {{left: number, right: number, bottom: number, top: number}} Box */

const CLOSEST = 4e6; // px per m
const FARTHEST = 5;

export class Viewport {
  constructor() {
    this.width = 1;
    this.height = 1;
    /** Point in the middle of the screen [m]. */
    this.u = 0;
    this.v = 0;
    /** px per m */
    this.scale = 1000;
  }

  /** @param {Point} point m @returns {Point} px */
  toScreen([u, v]) {
    return [this.width / 2 + (u - this.u) * this.scale, this.height / 2 - (v - this.v) * this.scale];
  }

  /** @param {Point} point px @returns {Point} m */
  toPlane([x, y]) {
    return [this.u + (x - this.width / 2) / this.scale, this.v - (y - this.height / 2) / this.scale];
  }

  /** @param {number} x px @param {number} y px */
  pan(x, y) {
    this.u -= x / this.scale;
    this.v += y / this.scale;
  }

  /** Zoom about a point of the screen, which stays in place. @param {number} factor @param {Point} [about] px */
  zoom(factor, about = [this.width / 2, this.height / 2]) {
    const fixed = this.toPlane(about);
    this.scale = Math.min(CLOSEST, Math.max(FARTHEST, this.scale * factor));
    const now = this.toPlane(about);
    this.u += fixed[0] - now[0];
    this.v += fixed[1] - now[1];
  }

  /** Show all of a box, with room for handles around it. @param {Box} box m @param {{below?: number, left?: number}} [covered] height below and width at the left that are covered [px] */
  fit(box, { below = 0, left = 0 } = {}) {
    const margin = Math.min(56, 0.16 * this.width, 0.16 * this.height);
    const wide = Math.max(box.right - box.left, 1e-6);
    const high = Math.max(box.top - box.bottom, 1e-6);
    const room = [Math.max(40, this.width - 2 * margin - left), Math.max(40, this.height - 2 * margin - below)];
    this.scale = Math.min(CLOSEST, room[0] / wide, room[1] / high);
    this.u = (box.left + box.right) / 2 - left / 2 / this.scale;
    this.v = (box.bottom + box.top) / 2 - below / 2 / this.scale;
  }

  /** @param {{width: number, height: number}} size px */
  resize({ width, height }) {
    this.width = Math.max(1, width);
    this.height = Math.max(1, height);
  }

  /** @returns {{u: number, v: number, scale: number}} */
  get place() {
    return { u: this.u, v: this.v, scale: this.scale };
  }
}

/**
 * Return the smallest box around points; null without points.
 * @param {ArrayLike<number>} points pairs, row by row @returns {Box | null}
 */
export function boxOf(points) {
  if (points.length < 2) return null;
  const box = { left: Infinity, right: -Infinity, bottom: Infinity, top: -Infinity };
  for (let i = 0; i + 1 < points.length; i += 2) {
    box.left = Math.min(box.left, points[i]);
    box.right = Math.max(box.right, points[i]);
    box.bottom = Math.min(box.bottom, points[i + 1]);
    box.top = Math.max(box.top, points[i + 1]);
  }
  return Number.isFinite(box.left) ? box : null;
}

/** Return the round numbers (1, 2, 5, 10) in a number's decade. @param {number} x @returns {number[]} */
const roundNumbers = (x) => [1, 2, 5, 10].map((factor) => factor * 10 ** Math.floor(Math.log10(x)));

/** Return the next number that is 1, 2 or 5 times a power of ten. @param {number} least @returns {number} */
export const roundUp = (least) => roundNumbers(least).find((x) => x >= least) ?? least;

/**
 * Return a round length near a number of pixels, for a scale bar.
 * @param {number} scale px per m @param {number} [pixels] at most @returns {{length: number, pixels: number}} length [m]
 */
export function scaleBar(scale, pixels = 90) {
  const length = roundNumbers(pixels / scale).findLast((x) => x * scale <= pixels) ?? pixels / scale;
  return { length, pixels: length * scale };
}
