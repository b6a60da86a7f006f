// Played motion: joint positions and tool points of the shown run over time.

import { rowOf } from "./format.js";
import { indexAt } from "./state.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {"planned" | "executed"} Which */
/** @typedef {import("./state.js").Frame} Frame */
/**
 * @typedef {object} Motion
 * @property {Which} of
 * @property {Numbers} t times [s], (m,)
 * @property {Numbers} q joint positions [rad], (m, dof)
 * @property {number} dof
 * @property {number} duration [s]
 * @property {Numbers} trail tool points in the work frame [m], (n, 3)
 * @property {Numbers} trailTimes when the tool is there [s], (n,)
 */

/**
 * Return the planned or the executed motion; null if it is not known yet, or belongs to another plan.
 * @param {Store} store
 * @param {Which} of
 * @returns {Motion | null}
 */
export function motionOf(store, of) {
  const frame = store.latest(of === "planned" ? "picture" : "executed");
  if (!frame || (of === "executed" && !store.isCurrent(frame))) return null;
  const { q, xyz, path_t: pathTimes, t: planned, pose_t: t = planned } = frame.arrays;
  if (!t?.length || !q?.length) return null;
  const dof = q.length / t.length;
  const trailTimes = of === "planned" ? pathTimes : t;
  // The last time has single precision, so it can be after the end.
  const duration = of === "planned" ? rowOf(frame.head, "duration")?.value : t[t.length - 1];
  return { of, t, q, dof, duration, trail: xyz, trailTimes };
}

/** Return the played motion; without the executed one, the planned one. @param {Store} store @returns {Motion | null} */
export const shownMotion = (store) => (store.options.time === "executed" ? motionOf(store, "executed") : null) ?? motionOf(store, "planned");

/** Return the execution whose tool is shown beside the planned one; null for none. @param {Store} store @returns {Frame | null} */
export function comparedExecution(store) {
  const { options, refusal } = store;
  const executed = store.latest("executed");
  const isWished = options.time !== "planned" || options.colour === "error";
  return isWished && !refusal && store.isCurrent(executed) ? executed : null;
}

/**
 * Return the time of the largest distance from the drawing [s]; undefined while the execution belongs to another plan,
 * in which this time can be on another contour.
 * @param {Store} store @returns {number | undefined}
 */
export function worstTime(store) {
  // The execution of a long motion is not drawn, but its exact figures are known.
  const known = [store.latest("executed"), store.latest("figures")].find((x) => store.isCurrent(x));
  return known?.head.off_t ?? undefined;
}

/** Return whether the tool is on a contour at a time; between contours, no deviation is known. @param {Frame} executed @param {number} t s */
export const isWorking = ({ arrays: { t: times, breaks } }, t) => t >= times[0] && t <= times[times.length - 1] && !breaks.includes(indexAt(times, t) + 1);
