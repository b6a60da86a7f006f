// The position of a camera from which all points are in the picture.

/**
 * @typedef {object} Picture
 * @property {number} right tangent of half the horizontal field of view
 * @property {number} up tangent of half the vertical field of view
 * @property {[number, number]} across usable part of the picture from left to right, from -1 to 1
 * @property {[number, number]} along usable part from bottom to top, from -1 to 1
 * @property {number} nearest smallest distance from the camera to a point, towards the eye [m]
 */

/**
 * Return where the camera must be, along its own axes, so that it sees all points in the usable part of the picture and is as near as
 * possible. A point (x, y, z) appears at ((x - cx) / (cz - z) / right, (y - cy) / (cz - z) / up). Each bound of the picture is therefore
 * linear in cx and cz, or in cy and cz: the lower bounds of cx must not exceed its upper bounds, which gives the smallest cz.
 * @param {ArrayLike<number>} points along the axes of the camera: right, up, towards the eye [m], (n, 3)
 * @param {Picture} picture
 * @returns {[number, number, number]} [m]
 */
export function frame(points, { right, up, across, along, nearest }) {
  const [x0, x1, wide] = bounds(points, 0, right, across);
  const [y0, y1, high] = bounds(points, 1, up, along);
  const [, front] = bounds(points, 2, 0, across);
  const z = Math.max((x1 - x0) / wide, (y1 - y0) / high, front + nearest);
  const between = (/** @type {number} */ low, /** @type {number} */ high, /** @type {[number, number]} */ ends, /** @type {number} */ field) =>
    (low - ends[0] * field * z + high - ends[1] * field * z) / 2;
  return [between(x0, x1, across, right), between(y0, y1, along, up), z];
}

/** @param {ArrayLike<number>} points @param {number} axis @param {number} field @param {[number, number]} ends @returns {[number, number, number]} */
function bounds(points, axis, field, [low, high]) {
  let [least, most] = [Infinity, -Infinity];
  for (let k = 0; k < points.length; k += 3) {
    least = Math.min(least, points[k + axis] + low * field * points[k + 2]);
    most = Math.max(most, points[k + axis] + high * field * points[k + 2]);
  }
  return [least, most, (high - low) * field];
}
