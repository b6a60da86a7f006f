// Drawing of the layers on a canvas, from back to front.

import { themed } from "./colours.js";
import { placeNumbers } from "./contour_numbers.js";
import { bandOf, idleOf, marksOf } from "./polylines.js";
import { roundUp } from "./viewport.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./layers.js").Layers} Layers */
/** @typedef {import("./viewport.js").Viewport} Viewport */
/** @typedef {CanvasRenderingContext2D} Context */

// Minimum distance between grid lines.
const GRID = 60; // px
// Approximate minimum distance between contour marks.
const ROOM = 40; // px
// Width of the ground around contour numbers.
const HALO = 3; // px
// Radius of pierce marks.
const RING = 6.5; // px
// Lines with more coordinates are drawn solid, because dashes take longer than the line itself.
const LONG = 12_000;

export class Painter {
  /** @param {Store} store @param {Layers} layers */
  constructor(store, layers) {
    this.store = store;
    this.layers = layers;
  }

  /** Draw everything. @param {Context} context in px of the view @param {Viewport} view */
  paint(context, view) {
    context.fillStyle = themed("--ground");
    context.fillRect(0, 0, view.width, view.height);
    const picture = this.store.latest("picture");
    if (!picture) return;
    this.grid(context, view);
    const { refusal } = this.store;
    // The last valid motion is drawn in grey.
    context.globalAlpha = refusal?.head.tier === 1 && picture.arrays.path.length ? 0.28 : 1;
    this.inMetres(context, view, () => this.lines(context, view, picture));
    context.font = "11px system-ui, sans-serif";
    context.textAlign = "center";
    context.textBaseline = "middle";
    context.fillStyle = themed("--ink");
    this.contours(context, view, picture);
    context.globalAlpha = 1;
    if (refusal?.head.outline) this.inMetres(context, view, () => this.refused(context, view, refusal, picture));
  }

  /** Draw the refused path, with the refused contour in red. @param {Context} context @param {Viewport} view @param {Frame} refusal @param {Frame} picture */
  refused(context, view, refusal, picture) {
    const [u, v] = refusal.head.outline.centre;
    const { path, contour } = this.layers.refused(refusal);
    context.translate(u - picture.head.centre[0], v - picture.head.centre[1]);
    stroke(context, path, themed("--ink"), 1 / view.scale);
    stroke(context, contour, themed("--refusal"), 2.5 / view.scale);
  }

  /** @param {Context} context @param {Viewport} view @param {() => void} draw */
  inMetres(context, view, draw) {
    const [x, y] = view.toScreen([0, 0]);
    context.save();
    context.transform(view.scale, 0, 0, -view.scale, x, y);
    context.lineJoin = "round";
    context.lineCap = "butt";
    draw();
    context.restore();
  }

  /** @param {Context} context @param {Viewport} view @param {Frame} picture */
  lines(context, view, picture) {
    const { layers, store } = this;
    const px = 1 / view.scale;
    const executed = store.refusal ? null : store.latest("executed");
    const band = bandOf(picture);
    const objective = layers.lines(picture, "objective");
    if (band * view.scale > 1) stroke(context, objective, themed("--band"), 2 * band);
    for (const { kerf, path } of layers.cuts(picture)) stroke(context, path, themed("--kerf"), kerf);
    stroke(context, layers.lines(picture, "drawn"), themed("--ink"), px, [2 * px, 2 * px]);
    const count = picture.arrays.path.length;
    const dashed = count > 0 && count < LONG;
    stroke(context, objective, count ? themed("--faint") : themed("--ink"), px, dashed ? [5 * px, 4 * px] : []);
    stroke(context, layers.lines(picture, "left_out"), themed("--line"), 2 * px);
    stroke(context, layers.lines(picture, "rapid"), themed("--faint"), 1 * px, [1.5 * px, 4 * px]);
    if (store.options.contour >= 0) stroke(context, layers.contour(picture, store.options.contour), themed("--selected"), 11 * px);
    // Drawn below the limit colours, so it is visible where the tool leaves the path.
    if (executed && store.options.colour === "error") this.executed(context, view, executed);
    for (const { path, colour, dash } of layers.strokes(picture, executed)) {
      stroke(context, path, colour, 3.2 * px, dash.map((d) => d * px));
    }
    // A gap in the coloured line, filled by a thin line.
    const idle = layers.keep("idle", [picture], () => idleOf(picture));
    stroke(context, idle, themed("--ground"), 4 * px);
    stroke(context, idle, themed("--ink"), 0.8 * px);
  }

  /** Draw number, start, direction and pierce of each contour that has room for them. @param {Context} context @param {Viewport} view @param {Frame} picture */
  contours(context, view, picture) {
    const taken = new Set();
    const [arrows, pierces] = [new Path2D(), new Path2D()];
    const marks = this.layers.keep("marks", [picture], () => marksOf(picture));
    for (const { at, along, size, inner, isPierced } of marks) {
      const [x, y] = view.toScreen(at);
      const cell = `${Math.round(x / ROOM)} ${Math.round(y / ROOM)}`;
      if (x < 0 || y < 0 || x > view.width || y > view.height) continue;
      if (size * view.scale < ROOM / 2 || taken.has(cell)) continue;
      taken.add(cell);
      arrow(arrows, x, y, along);
      pierces.moveTo(x + RING, y);
      if (isPierced) pierces.arc(x, y, RING, 0, 2 * Math.PI);
      if (size * view.scale > 3 * ROOM) arrow(arrows, ...view.toScreen(inner.at), inner.along);
    }
    context.fill(arrows);
    stroke(context, pierces, themed("--ink"), 1.2);
    this.numbers(context, placeNumbers(marks, view, this.store.options.contour));
  }

  /** Draw the numbers of contours, legible over lines. @param {Context} context @param {import("./contour_numbers.js").Placed[]} numbers */
  numbers(context, numbers) {
    context.strokeStyle = themed("--ground");
    context.lineWidth = HALO;
    context.lineJoin = "round";
    context.setLineDash([]);
    for (const { number, x, y } of numbers) context.strokeText(number, x, y);
    for (const { number, x, y } of numbers) context.fillText(number, x, y);
  }

  /** @param {Context} context @param {Viewport} view @param {Frame} moved */
  executed(context, view, moved) {
    const colour = themed("--executed");
    const factor = this.layers.magnification(view.scale);
    const px = 1 / view.scale;
    const { tool, errors } = this.layers.executed(moved, factor);
    const alpha = context.globalAlpha;
    context.globalAlpha = 0.35 * alpha;
    stroke(context, errors, colour, 0.8 * px);
    context.globalAlpha = alpha;
    stroke(context, tool, colour, 1.3 * px);
  }

  /** Draw grid lines at round distances. @param {Context} context @param {Viewport} view */
  grid(context, view) {
    const step = roundUp(GRID / view.scale);
    const centre = this.store.latest("picture")?.head.centre ?? [0, 0];
    const [left, top] = view.toPlane([0, 0]);
    const [right, bottom] = view.toPlane([view.width, view.height]);
    context.strokeStyle = themed("--grid");
    context.lineWidth = 1;
    context.beginPath();
    for (const [axis, low, high] of [[0, left, right], [1, bottom, top]])
      for (let k = Math.ceil((low + centre[axis]) / step); k * step <= high + centre[axis]; k++) {
        const at = Math.round(view.toScreen([k * step - centre[0], k * step - centre[1]])[axis]) + 0.5;
        context.moveTo(axis ? 0 : at, axis ? at : 0);
        context.lineTo(axis ? view.width : at, axis ? at : view.height);
      }
    context.stroke();
  }
}

/** Add an arrow in a direction in the plane. @param {Path2D} path @param {number} x px @param {number} y px @param {number[]} along */
function arrow(path, x, y, [u, v]) {
  const at = (/** @type {number} */ a, /** @type {number} */ b) => /** @type {[number, number]} */ ([x + a * u + b * v, y - a * v + b * u]);
  path.moveTo(...at(8, 0));
  path.lineTo(...at(-1, 4));
  path.lineTo(...at(-1, -4));
  path.closePath();
}

/**
 * @param {Context} context @param {Path2D} path @param {string} colour @param {number} width @param {number[]} [dash]
 */
function stroke(context, path, colour, width, dash = []) {
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.stroke(path);
}
