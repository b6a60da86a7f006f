// Joint positions and tool position as numbers, as an alternative to the 3D view.

import { make } from "./dom.js";
import { fixed, mm, seconds } from "./format.js";
import { Tabular } from "./components.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./cell.js").Cell} Cell */
/** @typedef {import("./kinematics.js").Pose} Pose */
/**
 * A posture at a time [s]: joint positions [rad], and the tool's frame in that of the base.
 * @typedef {{cell: Cell, t: number, q: ArrayLike<number>, at: Pose, of: string}} Posture
 */

/** A line of text with a table of joints under it. */
export class Readout {
  constructor() {
    this.element = make("details", { class: "readout" });
    render(html`<summary>Posture</summary>`, this.element);
  }

  /** @param {Posture} posture */
  show({ cell, t, q, at, of }) {
    const tool = [at[3], at[7], at[11]].map((x) => mm(x, 1)).join(", ");
    const bound = (/** @type {number | null} */ x) => (x === null ? "no limit" : degrees(x));
    const rows = cell.chain.joints.map(({ name, limits }, k) => {
      const [low, high] = limits ?? [null, null];
      return [name, degrees(q[k]), low === null && high === null ? "no limit" : `${bound(low)} to ${bound(high)}`];
    });
    render(
      html`<summary>${seconds(t)} s ${of} · tool at ${tool} mm from the base</summary>
        ${this.element.open && html`<table><${Tabular} columns=${["Joint", "Position", "Range"]} rows=${rows} /></table>`}`,
      this.element,
    );
  }
}

/** @param {number} x [rad] @returns {string} */
function degrees(x) {
  return `${fixed((x * 180) / Math.PI, 3)}°`;
}
