// Table of waypoints, as an alternative to dragging.

import { find, whileSeen } from "./dom.js";
import { insertable } from "./handles.js";
import { Entry, Heads } from "./components.js";
import { inches, shownField, typedField } from "./units.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */

const MAX_ROWS = 500;
const AXES = ["x", "y", "z"];

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  const region = find("#tab-waypoints");
  /** Waypoint that gets the focus once there are more waypoints than this. */
  let inserted = { index: -1, count: Infinity };
  /** Insert one between a waypoint and its neighbour. @param {number} index */
  const insert = (index) => {
    const { waypoints: points } = store.document;
    const [last, a, b] = [index - 1, index, index + 1].map((k) => points[k]?.uv);
    const before = last ?? a;
    // After the last waypoint, the path is extended by half of its last line.
    const at = b ? [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] : [a[0] + (a[0] - before[0]) / 2, a[1] + (a[1] - before[1]) / 2];
    inserted = { index: index + 1, count: points.length };
    link.edit([{ do: "insert_waypoint", index: index + 1, at }]);
  };
  const act = (/** @type {string} */ text, /** @type {string} */ title, /** @type {() => void} */ does) =>
    html`<button type="button" title=${title} aria-label=${title} onClick=${does}>${text}</button>`;
  const update = whileSeen(store, region, ["document"], () => {
    if (!store.document) return;
    const { waypoints: points = [], path = {} } = store.document;
    const few = points.length > MAX_ROWS ? `The first ${MAX_ROWS} of ${points.length} waypoints.` : "";
    const units = points.length ? `Plain numbers are ${inches.value ? "inches" : "metres"}; 350 mm can be typed as well.` : "";
    const note = [few, path.editable ? units : path.why_not, ...(path.notes ?? [])].filter(Boolean).join(" ");
    const row = (/** @type {{written: any[], removable: boolean}} */ { written, removable }, /** @type {number} */ index) => {
      const set = (/** @type {number} */ k) => (/** @type {string} */ text) => link.edit([{ do: "set_waypoint", index, value: written.map((x, j) => (j === k ? typedField(text, "m") : String(x))) }]);
      return html`<tr key=${index}><th scope="row">${index + 1}</th>
        ${written.map((x, k) => html`<td><${Entry} value=${shownField(String(x), "m")} send=${set(k)} disabled=${!path.editable} aria-label=${`Waypoint ${index + 1}, ${AXES[k]}`} /></td>`)}
        <td class="acts">${path.editable && insertable(store.document, index + 1) && act("+", `Insert a waypoint after ${index + 1}`, () => insert(index))}
          ${path.editable && removable && act("×", `Remove waypoint ${index + 1}`, () => link.edit([{ do: "remove_waypoint", index }]))}</td></tr>`;
    };
    const columns = ["(number)", ...AXES.slice(0, points[0]?.written.length), "(actions)"];
    render(
      html`<p class="quiet">${note}</p>
        ${points.length > 0 && html`<table><caption class="unseen">Waypoints</caption><${Heads} names=${columns} /><tbody>${points.slice(0, MAX_ROWS).map(row)}</tbody></table>`}`,
      region,
    );
    if (points.length <= inserted.count) return;
    region.querySelectorAll("tbody tr")[inserted.index]?.querySelector("input")?.focus();
    inserted = { index: -1, count: Infinity };
  });
  inches.subscribe(update);
}
