// The body and the point of its surface at a place of the 3D view.

import { hit } from "./edge_pick.js";
import { Matrix4, Vector3 } from "./vendor/three.js";

/** @typedef {import("./viewer.js").Viewer} Viewer */

/**
 * Return the nearest body at a place of the canvas, and the point of its surface in the frame of the floor [m]; null without one.
 * @param {Viewer} viewer @param {number} x px @param {number} y px @returns {{name: string, point: number[], away: number} | null}
 */
export function surfaceAt(viewer, x, y) {
  const { from, along } = viewer.rayAt(x, y);
  let best = null;
  for (const { name, solid } of viewer.solids) {
    const back = new Matrix4().copy(solid.matrixWorld).invert();
    const start = from.clone().applyMatrix4(back);
    const way = from.clone().add(along).applyMatrix4(back).sub(start).toArray();
    const points = /** @type {Float32Array} */ (solid.geometry.attributes.position.array);
    const begin = start.toArray();
    for (let i = 0; i + 8 < points.length; i += 9) {
      const away = hit(points, i, begin, way);
      if (away > 0 && (!best || away < best.away)) best = { name, away, point: new Vector3().copy(from).addScaledVector(along, away).toArray() };
    }
  }
  return best;
}
