// The trail as a ribbon that faces the camera: thick lines of three.js are drawn one by one where the
// processor computes WebGL, which is ten times slower.

import {
  BufferAttribute, BufferGeometry, Color, DoubleSide, LineBasicMaterial, LineSegments, Mesh, MeshBasicMaterial,
} from "./vendor/three.js";
import { place } from "./kinematics.js";

/** @typedef {import("./kinematics.js").Pose} Pose */
/** @typedef {import("./camera.js").Camera} Camera */

/** Width of the part behind the tool [px]. */
const WIDTH = 4;
/** The trail lies on parts: so far it is drawn before them [share of what is seen]. */
const BEFORE = 0.01;

export class Ribbon {
  constructor() {
    this.thick = new Mesh(new BufferGeometry(), new MeshBasicMaterial({ vertexColors: true, side: DoubleSide }));
    this.thin = new LineSegments(new BufferGeometry(), new LineBasicMaterial({ vertexColors: true, depthTest: false, transparent: true, opacity: 0.55 }));
    // What is before the tool is seen through the arm.
    this.thin.renderOrder = 1;
    for (const x of [this.thick, this.thin]) x.frustumCulled = false;
    /** Ends of the pieces in the frame of the base [m]. */
    this.ends = new Float32Array();
    this.seen = "";
  }

  /** How many pieces there are. */
  get pieces() {
    return this.ends.length / 6;
  }

  /**
   * Take other pieces.
   * @param {Float32Array} ends in the work frame [m], (n, 6)
   * @param {Float32Array} colours red green blue, (n, 6)
   * @param {Pose} work
   */
  set(ends, colours, work) {
    this.ends = new Float32Array(ends.length);
    for (let k = 0; k < ends.length; k += 3) this.ends.set(place(work, ends.subarray(k, k + 3)), k);
    const linear = linearOf(colours);
    const four = new Float32Array(2 * linear.length);
    for (let k = 0; k < linear.length; k += 6) {
      four.set(linear.subarray(k, k + 6), 2 * k);
      four.set(linear.subarray(k, k + 6), 2 * k + 6);
    }
    this.replace(this.thin, linear.length / 3, linear);
    this.replace(this.thick, four.length / 3, four);
    const index = new Uint32Array(6 * this.pieces);
    for (let k = 0; k < this.pieces; k += 1) index.set([0, 1, 2, 2, 1, 3].map((x) => 4 * k + x), 6 * k);
    this.thick.geometry.setIndex(new BufferAttribute(index, 1));
    this.seen = "";
  }

  /**
   * @param {Mesh | LineSegments} object
   * @param {number} count of corners
   * @param {Float32Array} colours
   */
  replace(object, count, colours) {
    object.geometry.dispose();
    object.geometry = new BufferGeometry();
    object.geometry.setAttribute("position", new BufferAttribute(new Float32Array(3 * count), 3));
    object.geometry.setAttribute("color", new BufferAttribute(colours, 3));
  }

  /**
   * How much of it is behind the tool.
   * @param {number} pieces
   */
  reach(pieces) {
    this.thick.visible = pieces > 0;
    this.thin.visible = this.pieces > 0;
    this.thick.geometry.setDrawRange(0, 6 * pieces);
  }

  /**
   * Turn the ribbon to the camera, if it is another view.
   * @param {Camera} camera
   * @param {number} height of the picture [px]
   */
  face(camera, height) {
    const seen = [camera.azimuth, camera.elevation, camera.reach, height].join(" ");
    if (seen === this.seen || this.pieces === 0) return;
    this.seen = seen;
    const { across, over, eye } = camera.axes();
    const half = (WIDTH * camera.reach) / height;
    const near = eye.map((x) => x * BEFORE * camera.reach);
    const [thin, thick] = [this.thin, this.thick].map((x) => x.geometry.getAttribute("position"));
    const { ends } = this;
    for (let k = 0; k < this.pieces; k += 1) {
      const [a, b] = [6 * k, 6 * k + 3];
      const d = [0, 1, 2].map((j) => ends[b + j] - ends[a + j]);
      const x = d[0] * across[0] + d[1] * across[1] + d[2] * across[2];
      const y = d[0] * over[0] + d[1] * over[1] + d[2] * over[2];
      const size = Math.hypot(x, y) || 1;
      for (let j = 0; j < 3; j += 1) {
        const side = (half * (x * over[j] - y * across[j])) / size;
        // A little longer than the piece, so that there are no gaps at bends.
        const more = size > 1e-9 ? (0.4 * half * (x * across[j] + y * over[j])) / size : 0;
        const [from, to] = [ends[a + j] + near[j], ends[b + j] + near[j]];
        thin.array[a + j] = from;
        thin.array[b + j] = to;
        thick.array[12 * k + j] = from + side - more;
        thick.array[12 * k + 3 + j] = from - side - more;
        thick.array[12 * k + 6 + j] = to + side + more;
        thick.array[12 * k + 9 + j] = to - side + more;
      }
    }
    thin.needsUpdate = true;
    thick.needsUpdate = true;
  }
}

/**
 * Colours as three.js computes with them.
 * @param {Float32Array} colours as in style sheets, from 0 to 1
 * @returns {Float32Array}
 */
function linearOf(colours) {
  const found = new Float32Array(colours.length);
  const colour = new Color();
  for (let k = 0; k < colours.length; k += 3) {
    colour.setRGB(colours[k], colours[k + 1], colours[k + 2]).convertSRGBToLinear().toArray(found, k);
  }
  return found;
}
