// Arm and bodies of its cell, from the frame `arm`.

import { Chain, compose, place, poseOf } from "./kinematics.js";

/** @typedef {import("./kinematics.js").Pose} Pose */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {[number, number, number]} Point */
/**
 * @typedef {object} Body
 * @property {string} name
 * @property {number} link 0 is the base, and what stands still
 * @property {string} colour "link", "tool", "obstacle", "part" or "table"
 * @property {Numbers} triangles corners in the body's frame [m], 9 numbers a triangle
 * @property {Pose} at the body's frame in the frame of the link
 */
/** @typedef {{link: number, from: Point, to: Point}} Stick a straight piece of a link, in its frame [m] */
/**
 * @typedef {object} Paint
 * @property {string} ground
 * @property {string} ink
 * @property {string} grid
 * @property {string} axis
 * @property {string} tip
 * @property {string} alarm
 * @property {Record<string, string>} bodies
 */
/**
 * @typedef {object} Cell
 * @property {string} name
 * @property {boolean} planar
 * @property {Chain} chain
 * @property {Pose} work the work frame in the frame of the base
 * @property {Body[]} bodies
 * @property {Stick[]} limbs straight lines through the joints
 * @property {Stick[] | null} sticks the same, where links have no shapes
 * @property {number} size about the arm's reach [m]
 */

/** Colours by theme; bodies after Okabe and Ito where they mean something. */
export const PAINTS = /** @type {Record<string, Paint>} */ ({
  light: {
    ground: "#f4f5f7", ink: "#1c1f24", grid: "#d5d9df", axis: "#aab1bb", tip: "#1c1f24", alarm: "#b3261e",
    bodies: { link: "#b9c3d0", tool: "#7b8794", obstacle: "#e69f00", table: "#d9d3c8", part: "#c7d6c9" },
  },
  dark: {
    ground: "#14171c", ink: "#e8eaee", grid: "#2a2f37", axis: "#4a525e", tip: "#ffffff", alarm: "#ff7b72",
    bodies: { link: "#8593a6", tool: "#c2cad4", obstacle: "#e69f00", table: "#3a3730", part: "#4f6354" },
  },
});

/**
 * Read the frame `arm`.
 * @param {Frame} frame
 * @returns {Cell}
 */
export function cellOf(frame) {
  const { name, planar, joints, bodies, tool, work } = frame.head;
  const chain = new Chain(joints, tool);
  const solid = bodies.map((/** @type {any} */ x) => ({
    ...x, triangles: frame.arrays[x.triangles], at: poseOf(x.at),
  }));
  const limbs = limbsOf(chain);
  const hulls = solid.some((/** @type {Body} */ x) => x.colour === "link");
  return {
    name, planar, chain, work: poseOf(work), bodies: solid, limbs,
    sticks: hulls ? null : limbs, size: sizeOf(limbs),
  };
}

/**
 * From every joint to the next, and from the last one to the tool.
 * @param {Chain} chain
 * @returns {Stick[]}
 */
function limbsOf(chain) {
  const found = /** @type {Stick[]} */ ([]);
  const zero = /** @type {Point} */ ([0, 0, 0]);
  chain.joints.forEach((joint, k) => {
    found.push({ link: joint.parent, from: zero, to: at(chain.origins[k]) });
  });
  found.push({ link: chain.joints.length, from: zero, to: at(chain.tool) });
  return found;
}

/**
 * @param {Pose} pose
 * @returns {Point}
 */
function at(pose) {
  return [pose[3], pose[7], pose[11]];
}

/**
 * @param {Stick[]} limbs
 * @returns {number} [m]
 */
function sizeOf(limbs) {
  const sum = limbs.reduce((all, x) => all + Math.hypot(...x.to), 0);
  return Math.max(0.05, sum);
}

/** Number of sampled points of each body and of the path. */
const FEW = 150;

/**
 * Points of the arm in a posture, of the path and of obstacles, in the frame of the base.
 * @param {Cell} cell
 * @param {Pose[]} links
 * @param {Numbers} trail tool points in the work frame [m], (n, 3)
 * @returns {Point[]}
 */
export function pointsOf(cell, links, trail) {
  const found = cell.limbs.flatMap((x) => [x.from, x.to].map((p) => place(links[x.link], p)));
  found.push(...sampled(trail, cell.work));
  for (const body of cell.bodies) {
    if (body.colour !== "table") found.push(...sampled(body.triangles, compose(links[body.link], body.at)));
  }
  return found;
}

/** Points of a frame in that of the base. @param {Pose} frame @param {Numbers} points (n, 3) @returns {Float32Array} (n, 3) */
export function placedAll(frame, points) {
  const found = new Float32Array(points.length);
  for (let k = 0; k + 2 < points.length; k += 3) found.set(place(frame, points.subarray(k, k + 3)), k);
  return found;
}

/**
 * @param {Numbers} points (n, 3)
 * @param {Pose} frame
 * @returns {Point[]}
 */
function sampled(points, frame) {
  const step = 3 * Math.max(1, Math.floor(points.length / 3 / FEW));
  const found = /** @type {Point[]} */ ([]);
  for (let k = 0; k + 2 < points.length; k += step) found.push(place(frame, points.subarray(k, k + 3)));
  return found;
}
