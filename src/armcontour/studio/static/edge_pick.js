// Edges near the pointer: projected polylines, and whether the part's triangles hide a point.

/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {{edge: number, distance: number, point: number[]}} Found an edge, its distance [px], and its nearest point in the file [m] */

/** Number of nearest edges for which it is computed whether they are hidden. */
const CANDIDATES = 6;
/** Number of triangles of a block, which has one bounding box. */
const BLOCK = 48;
/** A triangle nearer to the point than this share of the distance from the eye does not hide it. */
const TOUCHING = 0.004;

/** Polylines of edges on the screen. */
export class ScreenEdges {
  /** @param {{points: Numbers, breaks: Numbers, triangles: Numbers}} arrays of the frame `model` @param {boolean[]} skipped edges that cannot be picked */
  constructor({ points, breaks, triangles }, skipped) {
    this.points = points;
    this.breaks = breaks;
    this.skipped = skipped;
    this.screen = new Float32Array((2 * points.length) / 3);
    /** Bounding boxes of the edges on the screen [px]: left, top, right, bottom. */
    this.boxes = new Float32Array(4 * (breaks.length - 1));
    this.blocks = blocksOf(triangles);
    this.triangles = triangles;
    /** The projection of the screen points. @type {number[]} */
    this.matrix = [];
  }

  /** Project all points, unless the projection has not changed. @param {number[]} m 4x4 by columns @param {number} width px @param {number} height px */
  project(m, width, height) {
    const key = [...m, width, height];
    if (this.matrix.length && key.every((x, k) => x === this.matrix[k])) return;
    this.matrix = key;
    const { points, screen } = this;
    for (let k = 0, i = 0; i < points.length; k += 2, i += 3) {
      const x = points[i];
      const y = points[i + 1];
      const z = points[i + 2];
      const w = m[3] * x + m[7] * y + m[11] * z + m[15];
      // Points behind the eye are far outside of the screen.
      screen[k] = w > 0 ? (0.5 + (m[0] * x + m[4] * y + m[8] * z + m[12]) / (2 * w)) * width : 1e9;
      screen[k + 1] = w > 0 ? (0.5 - (m[1] * x + m[5] * y + m[9] * z + m[13]) / (2 * w)) * height : 1e9;
    }
    this.bound();
  }

  /** Compute the bounding boxes on the screen. */
  bound() {
    const { boxes, breaks, screen } = this;
    for (let edge = 0; edge + 1 < breaks.length; edge += 1) {
      let [left, top, right, bottom] = [Infinity, Infinity, -Infinity, -Infinity];
      for (let k = 2 * breaks[edge]; k < 2 * breaks[edge + 1]; k += 2) {
        left = Math.min(left, screen[k]);
        right = Math.max(right, screen[k]);
        top = Math.min(top, screen[k + 1]);
        bottom = Math.max(bottom, screen[k + 1]);
      }
      boxes.set([left, top, right, bottom], 4 * edge);
    }
  }

  /**
   * Return the edge at a point of the screen; null if none is near. Edges that the part hides count as farther away.
   * @param {number} x px @param {number} y px @param {number} within px @param {number[]} eye in the file's coordinates [m]
   * @param {number} hidden distance that hidden edges are farther away [px] @returns {Found | null}
   */
  at(x, y, within, eye, hidden) {
    const found = this.nearest(x, y, within);
    for (const each of found) if (hidden > 0 && this.isHidden(each.point, eye)) each.distance += hidden;
    const [best] = found.sort((a, b) => a.distance - b.distance);
    return best && best.distance <= within ? best : null;
  }

  /** Return the nearest edges. @param {number} x px @param {number} y px @param {number} within px @returns {Found[]} */
  nearest(x, y, within) {
    const { boxes, breaks, screen, skipped, points } = this;
    const found = /** @type {{edge: number, distance: number, at: number, share: number}[]} */ ([]);
    for (let edge = 0; edge + 1 < breaks.length; edge += 1) {
      const box = 4 * edge;
      if (skipped[edge] || x < boxes[box] - within || y < boxes[box + 1] - within || x > boxes[box + 2] + within || y > boxes[box + 3] + within) continue;
      let [least, at, share] = [within * within, -1, 0];
      for (let k = breaks[edge]; k + 1 < breaks[edge + 1]; k += 1) {
        const ax = screen[2 * k];
        const ay = screen[2 * k + 1];
        const dx = screen[2 * k + 2] - ax;
        const dy = screen[2 * k + 3] - ay;
        const along = ((x - ax) * dx + (y - ay) * dy) / (dx * dx + dy * dy || 1);
        const t = along < 0 ? 0 : along > 1 ? 1 : along;
        const ex = ax + t * dx - x;
        const ey = ay + t * dy - y;
        const square = ex * ex + ey * ey;
        if (square < least) [least, at, share] = [square, k, t];
      }
      if (at >= 0) found.push({ edge, distance: Math.sqrt(least), at, share });
    }
    found.sort((a, b) => a.distance - b.distance);
    return found.slice(0, CANDIDATES).map(({ edge, distance, at, share }) => {
      const point = [0, 1, 2].map((j) => points[3 * at + j] + share * (points[3 * at + 3 + j] - points[3 * at + j]));
      return { edge, distance, point };
    });
  }

  /** Return whether a triangle is between the eye and a point. @param {number[]} point @param {number[]} eye @returns {boolean} */
  isHidden(point, eye) {
    const ray = point.map((x, k) => x - eye[k]);
    const { blocks, triangles } = this;
    for (let block = 0; block * BLOCK * 9 < triangles.length; block += 1) {
      if (!crosses(blocks, 6 * block, eye, ray)) continue;
      const end = Math.min(triangles.length, (block + 1) * BLOCK * 9);
      for (let i = block * BLOCK * 9; i < end; i += 9) {
        const t = hit(triangles, i, eye, ray);
        if (t > 0 && t < 1 - TOUCHING) return true;
      }
    }
    return false;
  }
}

/** Return the bounding boxes of blocks of triangles: smallest, then largest coordinates. @param {Numbers} triangles @returns {Float32Array} */
function blocksOf(triangles) {
  const size = BLOCK * 9;
  const boxes = new Float32Array(6 * Math.ceil(triangles.length / size));
  for (let block = 0; block * size < triangles.length; block += 1) {
    boxes.fill(Infinity, 6 * block, 6 * block + 3).fill(-Infinity, 6 * block + 3, 6 * block + 6);
    for (let i = block * size; i < Math.min(triangles.length, (block + 1) * size); i += 1) {
      const axis = 6 * block + (i % 3);
      boxes[axis] = Math.min(boxes[axis], triangles[i]);
      boxes[axis + 3] = Math.max(boxes[axis + 3], triangles[i]);
    }
  }
  return boxes;
}

/** Return whether a ray crosses a box. @param {Float32Array} boxes @param {number} at @param {number[]} from @param {number[]} ray @returns {boolean} */
function crosses(boxes, at, from, ray) {
  let [begin, end] = [0, 1];
  for (let k = 0; k < 3; k += 1) {
    const inverse = 1 / ray[k];
    const a = (boxes[at + k] - from[k]) * inverse;
    const b = (boxes[at + k + 3] - from[k]) * inverse;
    begin = Math.max(begin, Math.min(a, b));
    end = Math.min(end, Math.max(a, b));
  }
  return begin <= end;
}

/** Return the fraction of a ray at which it hits a triangle; -1 if it does not (Möller and Trumbore). @param {Numbers} p @param {number} i @param {number[]} from @param {number[]} ray @returns {number} */
export function hit(p, i, from, [dx, dy, dz]) {
  const [ax, ay, az] = [p[i + 3] - p[i], p[i + 4] - p[i + 1], p[i + 5] - p[i + 2]];
  const [bx, by, bz] = [p[i + 6] - p[i], p[i + 7] - p[i + 1], p[i + 8] - p[i + 2]];
  const [hx, hy, hz] = [dy * bz - dz * by, dz * bx - dx * bz, dx * by - dy * bx];
  const size = ax * hx + ay * hy + az * hz;
  if (size === 0) return -1;
  const [sx, sy, sz] = [from[0] - p[i], from[1] - p[i + 1], from[2] - p[i + 2]];
  const u = (sx * hx + sy * hy + sz * hz) / size;
  if (u < 0 || u > 1) return -1;
  const [qx, qy, qz] = [sy * az - sz * ay, sz * ax - sx * az, sx * ay - sy * ax];
  const v = (dx * qx + dy * qy + dz * qz) / size;
  return v < 0 || u + v > 1 ? -1 : (bx * qx + by * qy + bz * qz) / size;
}
