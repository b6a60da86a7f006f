// The arm as lines on Canvas 2D, where there is no WebGL.

import { compose, place } from "./kinematics.js";
import { PAINTS } from "./cell.js";

/** @typedef {import("./kinematics.js").Pose} Pose */
/** @typedef {import("./camera.js").Camera} Camera */
/** @typedef {import("./cell.js").Cell} Cell */
/** @typedef {import("./cell.js").Paint} Paint */
/** @typedef {(p: ArrayLike<number>) => [number, number]} Projection */

/** The same methods as those of Scene3D. */
export class Stick2D {
  /** @param {HTMLCanvasElement} canvas */
  constructor(canvas) {
    this.canvas = canvas;
    this.context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
    this.kind = "stick";
    this.software = true;
    this.paint = PAINTS.light;
    /** @type {Cell | null} */
    this.cell = null;
    /** @type {Pose[]} */
    this.links = [];
    this.done = 0;
    /** @type {import("./cell.js").Point | null} */
    this.alarm = null;
    /** @type {Float32Array} */
    this.trail = new Float32Array();
    /** @type {Float32Array} */
    this.colours = new Float32Array();
  }

  /**
   * @param {Cell} cell
   * @param {Paint} paint
   */
  setCell(cell, paint) {
    this.cell = cell;
    this.paint = paint;
    this.links = [];
  }

  /**
   * @param {Float32Array} ends
   * @param {Float32Array} colours
   */
  setTrail(ends, colours) {
    this.trail = ends;
    this.colours = colours;
  }

  /**
   * @param {Pose[]} links
   * @param {Pose} at
   * @param {number} done
   */
  pose(links, at, done) {
    this.links = links;
    this.at = at;
    this.done = done;
  }

  /** @param {import("./cell.js").Point | null} at */
  mark(at) {
    this.alarm = at;
  }

  /**
   * @param {Camera} camera
   * @param {number} width [px]
   * @param {number} height [px]
   * @param {boolean} _rests
   * @param {number} [ratio] pixels per px
   */
  render(camera, width, height, _rests, ratio = window.devicePixelRatio) {
    const { context, paint, cell } = this;
    const [wide, high] = [Math.round(width * ratio), Math.round(height * ratio)];
    if (this.canvas.width !== wide || this.canvas.height !== high) Object.assign(this.canvas, { width: wide, height: high });
    context.setTransform(ratio, 0, 0, ratio, 0, 0);
    context.fillStyle = paint.ground;
    context.fillRect(0, 0, width, height);
    if (!cell || this.links.length === 0) return;
    const to = camera.projection(width, height);
    this.drawObstacles(cell, to);
    this.drawTrail(cell, to);
    this.drawLimbs(cell, to);
  }

  /**
   * Outlines of what stands around.
   * @param {Cell} cell
   * @param {Projection} to
   */
  drawObstacles(cell, to) {
    const { context, paint } = this;
    for (const body of cell.bodies.filter((x) => x.link === 0 && x.colour !== "link")) {
      const frame = compose(this.links[0], body.at);
      context.strokeStyle = paint.bodies[body.colour];
      context.lineWidth = 1;
      context.beginPath();
      for (let k = 0; k + 8 < body.triangles.length; k += 9) {
        const [a, b, c] = [0, 3, 6].map((j) => to(place(frame, body.triangles.subarray(k + j, k + j + 3))));
        context.moveTo(...a);
        context.lineTo(...b);
        context.lineTo(...c);
        context.closePath();
      }
      context.stroke();
    }
  }

  /**
   * @param {Cell} cell
   * @param {Projection} to
   */
  drawTrail(cell, to) {
    const { context, trail, colours } = this;
    for (let k = 0; k < trail.length; k += 6) {
      const [r, g, b] = colours.subarray(k, k + 3).map((x) => Math.round(255 * x));
      context.strokeStyle = `rgb(${r} ${g} ${b})`;
      context.lineWidth = k < 6 * this.done ? 3.5 : 1.2;
      context.beginPath();
      context.moveTo(...to(place(cell.work, trail.subarray(k, k + 3))));
      context.lineTo(...to(place(cell.work, trail.subarray(k + 3, k + 6))));
      context.stroke();
    }
  }

  /**
   * @param {Cell} cell
   * @param {Projection} to
   */
  drawLimbs(cell, to) {
    const { context, paint } = this;
    context.lineCap = "round";
    context.strokeStyle = paint.bodies.link;
    context.lineWidth = 8;
    context.beginPath();
    for (const x of cell.limbs) {
      context.moveTo(...to(place(this.links[x.link], x.from)));
      context.lineTo(...to(place(this.links[x.link], x.to)));
    }
    context.stroke();
    context.fillStyle = paint.ink;
    for (const x of cell.limbs) this.dot(to(place(this.links[x.link], x.from)), 3);
    context.fillStyle = paint.tip;
    if (this.at) this.dot(to([this.at[3], this.at[7], this.at[11]]), 5);
    context.fillStyle = paint.alarm;
    if (this.alarm) this.dot(to(this.alarm), 6);
  }

  /**
   * @param {[number, number]} at
   * @param {number} radius [px]
   */
  dot(at, radius) {
    this.context.beginPath();
    this.context.arc(at[0], at[1], radius, 0, 2 * Math.PI);
    this.context.fill();
  }

  /** Nothing to give back. */
  close() {}
}
