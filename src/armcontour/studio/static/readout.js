// Joint positions and tool as numbers: what the 3D view shows, for those who cannot see it.

import { make, say } from "./dom.js";
import { mm, seconds } from "./format.js";

/** @typedef {import("./cell.js").Cell} Cell */
/** @typedef {import("./kinematics.js").Pose} Pose */

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

  /**
   * Show a posture.
   * @param {Cell} cell
   * @param {number} t [s]
   * @param {ArrayLike<number>} q
   * @param {Pose} tool in the frame of the base
   * @param {string} of "planned" or "executed"
   */
  show(cell, t, q, tool, of) {
    if (cell !== this.cell) this.rebuild(cell);
    const at = [tool[3], tool[7], tool[11]].map((x) => mm(x, 1)).join(", ");
    say(this.line, `${seconds(t)} s ${of} · tool at ${at} mm from the base`);
    if (!this.element.open) return;
    cell.chain.joints.forEach((joint, k) => say(this.cells[k], positionText(joint.type, q[k])));
  }

  /** @param {Cell} cell */
  rebuild(cell) {
    this.cell = cell;
    this.cells = cell.chain.joints.map(() => make("td"));
    const rows = cell.chain.joints.map((joint, k) => {
      const [low, high] = joint.limits ?? [null, null];
      const bound = (/** @type {number | null} */ x) => (x === null ? "no limit" : positionText(joint.type, x));
      const range = low === null && high === null ? "no limit" : `${bound(low)} to ${bound(high)}`;
      return make("tr", {}, [make("th", { scope: "row", text: joint.name }), this.cells[k], make("td", { text: range })]);
    });
    this.body.replaceChildren(...rows);
  }
}

/**
 * @param {string} type of the joint
 * @param {number} x [rad or m]
 * @returns {string}
 */
function positionText(type, x) {
  if (type === "prismatic") return `${mm(x, 3)} mm`;
  return `${((x * 180) / Math.PI).toFixed(3).replace("-", "−")}°`;
}
