// Triangles of a body as geometry: corners that look alike are shared, which is what drawing costs
// where the processor computes WebGL.

import { BufferAttribute, BufferGeometry } from "./vendor/three.js";

/** @typedef {import("./state.js").Numbers} Numbers */

/** Faces that meet at a larger angle have an edge between them: cosine of 30 degrees. */
const SMOOTH = Math.cos(Math.PI / 6);
/** Corners nearer than this are one [m]. */
const SAME = 1e-5;

/**
 * A geometry whose faces are smooth where they meet at small angles.
 * @param {Numbers} triangles corners [m], 9 numbers a triangle
 * @returns {BufferGeometry}
 */
export function solidOf(triangles) {
  const normals = faceNormals(triangles);
  /** @type {Map<string, number[]>} corners of triangles by place */
  const places = new Map();
  for (let k = 0; k < triangles.length; k += 3) {
    const key = [0, 1, 2].map((j) => Math.round(triangles[k + j] / SAME)).join(" ");
    const there = places.get(key);
    if (there) there.push(k / 3);
    else places.set(key, [k / 3]);
  }
  const found = { positions: /** @type {number[]} */ ([]), normals: /** @type {number[]} */ ([]), index: new Uint32Array(triangles.length / 3) };
  for (const corners of places.values()) share(corners, triangles, normals, found);
  const shape = new BufferGeometry();
  shape.setAttribute("position", new BufferAttribute(Float32Array.from(found.positions), 3));
  shape.setAttribute("normal", new BufferAttribute(Float32Array.from(found.normals), 3));
  shape.setIndex(new BufferAttribute(found.index, 1));
  return shape;
}

/**
 * Make the corners at one place into few: one for all faces that are smooth there.
 * @param {number[]} corners
 * @param {Numbers} triangles
 * @param {Float64Array} faces normals, as long as twice the areas
 * @param {{positions: number[], normals: number[], index: Uint32Array}} found
 */
function share(corners, triangles, faces, found) {
  /** @type {{sum: number[], corners: number[]}[]} */
  const groups = [];
  for (const corner of corners) {
    const face = 3 * Math.floor(corner / 3);
    const normal = [faces[face], faces[face + 1], faces[face + 2]];
    const group = groups.find((x) => cosine(x.sum, normal) > SMOOTH);
    if (!group) groups.push({ sum: normal, corners: [corner] });
    else {
      group.sum = group.sum.map((x, j) => x + normal[j]);
      group.corners.push(corner);
    }
  }
  for (const { sum, corners: those } of groups) {
    const size = Math.hypot(...sum) || 1;
    for (const corner of those) found.index[corner] = found.positions.length / 3;
    found.positions.push(...triangles.subarray(3 * those[0], 3 * those[0] + 3));
    found.normals.push(...sum.map((x) => x / size));
  }
}

/**
 * @param {Numbers} p corners
 * @returns {Float64Array} one normal a triangle
 */
function faceNormals(p) {
  const found = new Float64Array(p.length / 3);
  for (let k = 0; k < p.length; k += 9) {
    const [ax, ay, az] = [p[k + 3] - p[k], p[k + 4] - p[k + 1], p[k + 5] - p[k + 2]];
    const [bx, by, bz] = [p[k + 6] - p[k], p[k + 7] - p[k + 1], p[k + 8] - p[k + 2]];
    found.set([ay * bz - az * by, az * bx - ax * bz, ax * by - ay * bx], k / 3);
  }
  return found;
}

/** @param {number[]} a @param {number[]} b @returns {number} */
function cosine(a, b) {
  const size = Math.hypot(...a) * Math.hypot(...b);
  return size > 0 ? (a[0] * b[0] + a[1] * b[1] + a[2] * b[2]) / size : 1;
}
