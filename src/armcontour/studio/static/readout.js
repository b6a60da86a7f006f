// Joint positions and tool as numbers: what the 3D view shows, for those who cannot see it.

import { make, say } from "./dom.js";
import { fixed, mm, seconds } from "./format.js";

/** @typedef {import("./cell.js").Cell} Cell */
/** @typedef {import("./kinematics.js").Pose} Pose */
/**
 * A posture at a time [s]: joint positions [rad], and the tool's frame in that of the base.
 * @typedef {{cell: Cell, t: number, q: ArrayLike<number>, at: Pose, of: string}} Posture
 */

/** A line of text with a table of joints under it. */
export class Readout {
  constructor() {
    this.line = make("summary", { text: "Posture" });
    this.body = make("tbody");
    const head = make("tr", {}, ["Joint", "Position", "Range"].map((text) => make("th", { scope: "col", text })));
    const table = make("table", {}, [make("thead", {}, [head]), this.body]);
    this.element = make("details", { class: "readout" }, [this.line, table]);
    /** @type {HTMLTableCellElement[]} */
    this.cells = [];
    /** @type {Cell | null} */
    this.cell = null;
  }

  /** @param {Posture} posture */
  show({ cell, t, q, at, of }) {
    if (cell !== this.cell) this.rebuild(cell);
    const tool = [at[3], at[7], at[11]].map((x) => mm(x, 1)).join(", ");
    say(this.line, `${seconds(t)} s ${of} · tool at ${tool} mm from the base`);
    if (!this.element.open) return;
    cell.chain.joints.forEach((joint, k) => say(this.cells[k], degrees(q[k])));
  }

  /** @param {Cell} cell */
  rebuild(cell) {
    this.cell = cell;
    this.cells = cell.chain.joints.map(() => make("td"));
    const rows = cell.chain.joints.map((joint, k) => {
      const [low, high] = joint.limits ?? [null, null];
      const bound = (/** @type {number | null} */ x) => (x === null ? "no limit" : degrees(x));
      const range = low === null && high === null ? "no limit" : `${bound(low)} to ${bound(high)}`;
      return make("tr", {}, [make("th", { scope: "row", text: joint.name }), this.cells[k], make("td", { text: range })]);
    });
    this.body.replaceChildren(...rows);
  }
}

/** @param {number} x [rad] @returns {string} */
function degrees(x) {
  return `${fixed((x * 180) / Math.PI, 3)}°`;
}
