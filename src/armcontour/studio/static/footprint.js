// Projection of obstacles onto the plane of the drawing: the hull of their corners.

/** @typedef {[number, number]} Point */
/** @typedef {[number, number, number]} Vector */
/**
 * An obstacle of the job, in SI units; the file has another unit.
 * @typedef {{type: string, index: number, unit: [string, number], name?: string, at?: number[], rpy?: number[], quaternion?: number[],
 *   size?: number[], radius?: number, length?: number, fixed_to?: string}} Obstacle
 */
/** @typedef {{origin: number[], x: number[], y: number[]}} Plane */

/** @typedef {import("./state.js").Store} Store */

const ROUND = 24;

/** The plane of the picture in the frame of the base, which obstacles are given in. @param {Store} store @returns {Plane | undefined} */
export function planeOf(store) {
  const plane = store.latest("picture")?.head.plane;
  const work = store.latest("arm")?.head.work;
  if (!plane || !work) return plane;
  const turned = (/** @type {number[]} */ axis) => [0, 1, 2].map((k) => dot(work[k], axis));
  return { origin: turned(plane.origin).map((x, k) => x + work[k][3]), x: turned(plane.x), y: turned(plane.y) };
}

/** Obstacles of the job that stand on the base. @param {Store} store @returns {Obstacle[]} */
export function standing(store) {
  return (store.document?.obstacles ?? []).filter((/** @type {Obstacle} */ x) => (x.fixed_to ?? "base") === "base");
}

/** @param {number[]} a @param {number[]} b */
export const dot = (a, b) => a[0] * b[0] + a[1] * b[1] + (a[2] ?? 0) * (b[2] ?? 0);

/** The axes of an obstacle. @param {Obstacle} obstacle @returns {[Vector, Vector, Vector]} */
export function axesOf({ rpy, quaternion }) {
  if (quaternion) return fromQuaternion(/** @type {any} */ (quaternion));
  const [r, p, y] = rpy ?? [0, 0, 0];
  const [cr, sr, cp, sp, cy, sy] = [Math.cos(r), Math.sin(r), Math.cos(p), Math.sin(p), Math.cos(y), Math.sin(y)];
  return [
    [cy * cp, sy * cp, -sp],
    [cy * sp * sr - sy * cr, sy * sp * sr + cy * cr, cp * sr],
    [cy * sp * cr + sy * sr, sy * sp * cr - cy * sr, cp * cr],
  ];
}

/** @param {[number, number, number, number]} q x, y, z, w @returns {[Vector, Vector, Vector]} */
function fromQuaternion([x, y, z, w]) {
  return [
    [1 - 2 * (y * y + z * z), 2 * (x * y + z * w), 2 * (x * z - y * w)],
    [2 * (x * y - z * w), 1 - 2 * (x * x + z * z), 2 * (y * z + x * w)],
    [2 * (x * z + y * w), 2 * (y * z - x * w), 1 - 2 * (x * x + y * y)],
  ];
}

/**
 * The outline of an obstacle in the plane [m], in order; null for those without an outline.
 * @param {Obstacle} obstacle @param {Plane} plane @returns {Point[] | null}
 */
export function outlineOf(obstacle, plane) {
  const corners = cornersOf(obstacle);
  if (!corners) return null;
  const at = obstacle.at ?? [0, 0, 0];
  const axes = axesOf(obstacle);
  const points = corners.map(([a, b, c]) => {
    const from = [0, 1, 2].map(
      (k) => (at[k] ?? 0) + a * axes[0][k] + b * axes[1][k] + c * axes[2][k] - plane.origin[k],
    );
    return /** @type {Point} */ ([dot(from, plane.x), dot(from, plane.y)]);
  });
  return hull(points);
}

/** Corners in the obstacle's own axes, enough to draw it. @param {Obstacle} obstacle @returns {Vector[] | null} */
function cornersOf({ type, size, radius = 0, length = 0 }) {
  const signs = [-0.5, 0.5];
  if (type === "box" && size)
    return signs.flatMap((a) => signs.flatMap((b) => signs.map((c) => /** @type {Vector} */ ([a * size[0], b * size[1], c * (size[2] ?? 0)]))));
  if (type !== "sphere" && type !== "cylinder" && type !== "capsule") return null;
  const angles = Array.from({ length: ROUND }, (_, k) => (2 * Math.PI * k) / ROUND);
  const circle = (/** @type {number} */ z) =>
    angles.map((a) => /** @type {Vector} */ ([radius * Math.cos(a), radius * Math.sin(a), z]));
  if (type === "cylinder") return [...circle(-length / 2), ...circle(length / 2)];
  const middle = type === "sphere" ? [0] : [-length / 2, length / 2];
  return middle.flatMap((z) =>
    [-1, -0.7, 0, 0.7, 1].flatMap((s) =>
      angles.map((a) => {
        const r = radius * Math.sqrt(1 - s * s);
        return /** @type {Vector} */ ([r * Math.cos(a), r * Math.sin(a), z + s * radius]);
      }),
    ),
  );
}

/** The convex hull of points, counter-clockwise. @param {Point[]} points @returns {Point[]} */
function hull(points) {
  const sorted = [...points].sort((p, q) => p[0] - q[0] || p[1] - q[1]);
  const half = (/** @type {Point[]} */ all) => {
    /** @type {Point[]} */
    const kept = [];
    for (const p of all) {
      while (kept.length > 1 && turn(kept[kept.length - 2], kept[kept.length - 1], p) <= 0) kept.pop();
      kept.push(p);
    }
    return kept.slice(0, -1);
  };
  return [...half(sorted), ...half(sorted.reverse())];
}

/** @param {Point} a @param {Point} b @param {Point} c */
const turn = (a, b, c) => (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
