// Forward kinematics of joint chains, in double precision, as in robot/chain.py.

import { Matrix4, Vector3 } from "./vendor/three.js";

/**
 * A revolute or prismatic joint. Link 0 is the base, or the floor; link k is after the k-th joint.
 * @typedef {object} Joint
 * @property {string} name
 * @property {"revolute" | "prismatic"} type
 * @property {number} parent the link that carries the joint
 * @property {number} column index of its position in a posture
 * @property {number} [factor] factor of this position, of a joint that follows another one
 * @property {number[]} axis unit vector, in the joint's frame
 * @property {number[][]} origin the joint's frame at zero in the frame of `parent`, 4x4
 * @property {[number | null, number | null]} [limits] [rad or m], null where there is none
 */

/** Make a matrix from its rows. @param {number[][]} rows 4x4 */
export const poseOf = (rows) => new Matrix4().fromArray(rows.flat()).transpose();

/** Return the motion of a joint in its own frame. @param {Joint} joint @param {number} q position [rad or m] */
function jointMotion({ type, axis: [x, y, z] }, q) {
  if (type === "prismatic") return new Matrix4().makeTranslation(q * x, q * y, q * z);
  return new Matrix4().makeRotationAxis(new Vector3(x, y, z), q);
}

/** A joint chain; its constant poses are read once. */
export class Chain {
  /** @param {Joint[]} joints @param {number[][]} tool the tool's frame in the frame of the last link, 4x4 */
  constructor(joints, tool) {
    this.joints = joints;
    this.origins = joints.map((x) => poseOf(x.origin));
    this.tool = poseOf(tool);
  }

  /** Return the base and link frames in the base frame. @param {ArrayLike<number>} q joint positions [rad or m] */
  links(q) {
    const found = [new Matrix4()];
    this.joints.forEach((joint, k) => {
      found.push(found[joint.parent].clone().multiply(this.origins[k]).multiply(jointMotion(joint, (joint.factor ?? 1) * q[joint.column])));
    });
    return found;
  }

  /** Return the tool frame. @param {Matrix4[]} links as of `links` */
  toolOf(links) {
    return links[links.length - 1].clone().multiply(this.tool);
  }
}
