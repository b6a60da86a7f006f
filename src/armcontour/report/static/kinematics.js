// Forward kinematics of a chain of joints, in double precision, as in robot/chain.py.

/**
 * A joint, which turns or slides. Link 0 is the base, link k comes after the k-th joint.
 * @typedef {object} Joint
 * @property {string} name
 * @property {"revolute" | "prismatic"} type
 * @property {number} parent the link that carries the joint
 * @property {number[]} axis unit vector, in the joint's frame
 * @property {number[][]} origin the joint's frame at zero in the frame of `parent`, 4x4
 * @property {[number | null, number | null]} [limits] [rad or m], null where there is none
 */

/**
 * A position and an orientation: 12 numbers, the upper 3 rows of a 4x4 matrix.
 * @typedef {Float64Array} Pose
 */

/**
 * The upper 3 rows of a 4x4 matrix.
 * @param {number[][]} rows
 * @returns {Pose}
 */
export function poseOf(rows) {
  return Float64Array.from([...rows[0], ...rows[1], ...rows[2]]);
}

/**
 * One pose after another: `b` given in the frame of `a`.
 * @param {Pose} a
 * @param {Pose} b
 * @returns {Pose}
 */
export function compose(a, b) {
  const found = new Float64Array(12);
  for (let row = 0; row < 12; row += 4) {
    const [x, y, z] = [a[row], a[row + 1], a[row + 2]];
    for (let k = 0; k < 4; k += 1) found[row + k] = x * b[k] + y * b[4 + k] + z * b[8 + k];
    found[row + 3] += a[row + 3];
  }
  return found;
}

/**
 * A point of a frame.
 * @param {Pose} pose
 * @param {ArrayLike<number>} p (3,)
 * @returns {[number, number, number]}
 */
export function place(pose, p) {
  const row = (/** @type {number} */ k) =>
    pose[k] * p[0] + pose[k + 1] * p[1] + pose[k + 2] * p[2] + pose[k + 3];
  return [row(0), row(4), row(8)];
}

/**
 * The motion of a joint in its own frame. Rodrigues' formula: I + sin q K + (1 - cos q) K².
 * @param {Joint} joint
 * @param {number} q position [rad or m]
 * @returns {Pose}
 */
function jointMotion(joint, q) {
  const [x, y, z] = joint.axis;
  if (joint.type === "prismatic") return Float64Array.of(1, 0, 0, q * x, 0, 1, 0, q * y, 0, 0, 1, q * z);
  const [s, c] = [Math.sin(q), 1 - Math.cos(q)];
  return Float64Array.of(
    1 - c * (y * y + z * z), c * x * y - s * z, c * x * z + s * y, 0,
    c * x * y + s * z, 1 - c * (x * x + z * z), c * y * z - s * x, 0,
    c * x * z - s * y, c * y * z + s * x, 1 - c * (x * x + y * y), 0,
  );
}

/** A chain of joints, with its constant poses read once. */
export class Chain {
  /**
   * @param {Joint[]} joints
   * @param {number[][]} tool the tool's frame in the frame of the last link, 4x4
   */
  constructor(joints, tool) {
    this.joints = joints;
    this.origins = joints.map((x) => poseOf(x.origin));
    this.tool = poseOf(tool);
  }

  /**
   * The frames of the base and of all links, in the frame of the base.
   * @param {ArrayLike<number>} q joint positions [rad]
   * @returns {Pose[]}
   */
  links(q) {
    const found = /** @type {Pose[]} */ ([Float64Array.of(1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1, 0)]);
    this.joints.forEach((joint, k) => {
      const carried = compose(found[joint.parent], this.origins[k]);
      found.push(compose(carried, jointMotion(joint, q[k])));
    });
    return found;
  }

  /**
   * The frame of the tool.
   * @param {Pose[]} links as of `links`
   * @returns {Pose}
   */
  toolOf(links) {
    return compose(links[links.length - 1], this.tool);
  }
}
