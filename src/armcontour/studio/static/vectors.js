// Vectors and poses as plain arrays, for computations that need no 3D view.

/** @typedef {number[]} Vector */
/** Rows of a homogeneous transform, 4x4. @typedef {number[][]} Pose */

/** @param {Vector} a @param {Vector} b @returns {number} */
export const dot = (a, b) => a.reduce((sum, x, k) => sum + x * (b[k] ?? 0), 0);

/** Return a + factor b. @param {Vector} a @param {Vector} b @param {number} [factor] @returns {Vector} */
export const plus = (a, b, factor = 1) => a.map((x, k) => x + factor * b[k]);

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const minus = (a, b) => plus(a, b, -1);

/** @param {Vector} a @returns {number} */
export const length = (a) => Math.hypot(...a);

/** @param {Vector} a @returns {Vector} */
export const unit = (a) => a.map((x) => x / (length(a) || 1));

/** @param {Vector} a @param {Vector} b @returns {Vector} */
export const cross = ([a, b, c], [x, y, z]) => [b * z - c * y, c * x - a * z, a * y - b * x];

/** Return a vector turned about a unit axis (Rodrigues). @param {Vector} v @param {Vector} axis @param {number} angle rad @returns {Vector} */
export function turned(v, axis, angle) {
  const [c, s] = [Math.cos(angle), Math.sin(angle)];
  const side = cross(axis, v);
  const along = dot(axis, v) * (1 - c);
  return v.map((x, k) => c * x + s * side[k] + along * axis[k]);
}

/** Return a column of a pose: 0 to 2 are its axes, 3 its origin. @param {Pose} pose @param {number} k @returns {Vector} */
export const column = (pose, k) => [0, 1, 2].map((row) => pose[row][k]);

/** Return a direction of the pose's frame in the outer frame. @param {Pose} pose @param {Vector} v @returns {Vector} */
export const rotate = (pose, v) => [0, 1, 2].map((row) => dot(pose[row].slice(0, 3), v));

/** Return a point of the pose's frame in the outer frame. @param {Pose} pose @param {Vector} p @returns {Vector} */
export const apply = (pose, p) => plus(rotate(pose, p), column(pose, 3));

/** Return the inverse of a pose without scale. @param {Pose} pose @returns {Pose} */
export function inverse(pose) {
  const rows = [0, 1, 2].map((k) => column(pose, k));
  const at = column(pose, 3);
  return [...rows.map((row) => [...row, -dot(row, at)]), [0, 0, 0, 1]];
}

/** @param {Pose} a @param {Pose} b @returns {Pose} */
export const compose = (a, b) => a.map((row) => [0, 1, 2, 3].map((k) => row.reduce((sum, x, j) => sum + x * b[j][k], 0)));

/** Return a pose from the elements of a matrix, by columns. @param {ArrayLike<number>} elements @returns {Pose} */
export const poseOfColumns = (elements) => [0, 1, 2, 3].map((row) => [0, 1, 2, 3].map((k) => elements[4 * k + row]));

/** @type {Pose} */
export const IDENTITY = [[1, 0, 0, 0], [0, 1, 0, 0], [0, 0, 1, 0], [0, 0, 0, 1]];
