// Measured points: the table in which touches are typed or pasted, and the touched points in the drawing.

import { draw, mark, say } from "./dom.js";
import { html, signal } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {{name: string, label: string, unit: string}} Column */

/** Number of rows of an empty table: as many as the three-point method needs. */
const FIRST_ROWS = 3;
/** Distance of a number from its point [px]. */
const BESIDE = [7, -7];

/** Names of doubts about a measurement, which can be accepted. */
const DOUBTS = ["turned_over", "mirrored", "scaled", "order", "touch"];

const columns = signal(/** @type {Column[]} */ ([]));
/** Texts of the cells. */
const rows = signal(/** @type {string[][]} */ ([]));

const isFilled = (/** @type {string[]} */ row) => row.some((text) => text.trim());
const emptyRow = () => columns.value.map(() => "");
const emptyTable = () => Array.from({ length: FIRST_ROWS }, emptyRow);

/** Options of the task: the rows that are filled. Rows without any text are removed, so that numbers of touches are those of rows. */
export function touchOptions() {
  const filled = rows.value.filter(isFilled);
  rows.value = filled.length > 0 ? filled : emptyTable();
  return { rows: filled };
}

/** Set a cell. @param {number} i @param {number} k @param {string} text */
const put = (i, k, text) => (rows.value = rows.value.map((row, n) => (n === i ? row.map((x, m) => (m === k ? text : x)) : row)));

/** Split a pasted table into cells; a row without digits has titles. @param {string} text @returns {string[][]} */
export function cellsOf(text) {
  const separator = ["\t", ";", ","].find((x) => text.includes(x)) ?? "\n";
  const lines = text.split(/\r?\n/).filter((line) => line.trim());
  const cells = lines.map((line) => line.split(separator).map((x) => x.trim()));
  return cells.filter((row, k) => k > 0 || row.some((x) => /^[-+.\d]/.test(x)));
}

/** Fill the table from a cell on with pasted cells. @param {string[][]} pasted @param {number} i @param {number} k */
function fill(pasted, i, k) {
  const count = Math.max(rows.value.length, i + pasted.length);
  const all = Array.from({ length: count }, (_, n) => [...(rows.value[n] ?? emptyRow())]);
  for (const [n, cells] of pasted.entries()) {
    for (const [m, cell] of cells.entries()) if (k + m < columns.value.length) all[i + n][k + m] = cell;
  }
  rows.value = all;
}

/** Paste a table of several cells; a single text is pasted as usual. @param {ClipboardEvent} event @param {number} i @param {number} k */
function paste(event, i, k) {
  const pasted = cellsOf(event.clipboardData?.getData("text") ?? "");
  if (pasted.length < 2 && (pasted[0]?.length ?? 0) < 2) return;
  event.preventDefault();
  fill(pasted, i, k);
}

/** The table, as fields of the task's form. */
export function TouchTable() {
  const cell = (/** @type {string} */ text, /** @type {number} */ i, /** @type {number} */ k) => html`<td><input type="text" inputmode="decimal" autocomplete="off" spellcheck=${false}
    value=${text} aria-label=${`Touch ${i + 1}, ${columns.value[k].name} [${columns.value[k].unit}]`} onInput=${(/** @type {any} */ e) => put(i, k, e.target.value)} onPaste=${(/** @type {any} */ e) => paste(e, i, k)} /></td>`;
  const remove = (/** @type {number} */ i) => (rows.value = rows.value.filter((_, n) => n !== i));
  return html`<div class="touch-table" tabindex="0" role="group" aria-label="Touches">
      <table><caption class="unseen">Touches</caption>
        <thead><tr><th scope="col"><span class="unseen">number</span></th>${columns.value.map(({ name, label, unit }) => html`<th scope="col" title=${name}>${label} <span class="quiet">[${unit}]</span></th>`)}<th scope="col"><span class="unseen">actions</span></th></tr></thead>
        <tbody>${rows.value.map((row, i) => html`<tr key=${i}><th scope="row">${i + 1}</th>${row.map((text, k) => cell(text, i, k))}
          <td class="acts"><button type="button" aria-label=${`Remove touch ${i + 1}`} title=${`Remove touch ${i + 1}`} onClick=${() => remove(i)}>×</button></td></tr>`)}</tbody></table></div>
    <div class="task-fields"><button type="button" onClick=${() => (rows.value = [...rows.value, emptyRow()])}>Add a touch</button>
      <label class="field" title="Standard deviation of each coordinate of a touch">noise of a touch <input type="text" name="noise" size="8" placeholder="0.1 mm" /></label>
      <label class="field" title="If a measurement is refused because of a doubt, and is right all the same">accept the doubt <select name="accept"><option value="">none</option>${DOUBTS.map((name) => html`<option value=${name}>${name}</option>`)}</select></label></div>`;
}

/** Numbered dots at the touched points. */
class Dots {
  /** @param {Store} store @param {View2d} view */
  constructor(store, view) {
    this.store = store;
    this.view = view;
    this.group = draw("g", { class: "touched", "aria-hidden": "true" });
    view.overlay.prepend(this.group);
    view.followers.add(() => this.place());
    store.on("touched", () => this.place());
  }

  place() {
    const points = this.store.touched?.uv ?? [];
    const [u, v] = this.store.latest("picture")?.head.centre ?? [0, 0];
    while (this.group.childElementCount > points.length) this.group.lastElementChild?.remove();
    points.forEach((/** @type {number[]} */ point, /** @type {number} */ k) => {
      const [x, y] = this.view.view.toScreen([point[0] - u, point[1] - v]);
      const dot = this.group.children[k] ?? this.group.appendChild(numbered());
      mark(dot, "transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
      say(/** @type {Element} */ (dot.lastElementChild), String(k + 1));
    });
  }
}

/** Make a dot with a place for its number. */
function numbered() {
  const dot = draw("g");
  dot.append(draw("circle", { r: 4 }), draw("text", { x: BESIDE[0], y: BESIDE[1] }));
  return dot;
}

/** @param {Store} store @param {import("./connection.js").Link} _link @param {import("./pointer.js").Pointer} pointer */
export function init(store, _link, { view }) {
  new Dots(store, view);
  const show = (/** @type {{uv: number[][], xyz: number[][]} | null} */ touched) => {
    store.touched = touched;
    store.tell("touched", touched);
    if (touched) view.fit();
  };
  store.on("result", (/** @type {any} */ { head }) => head.touched && show(head.touched));
  store.on("reset", () => {
    rows.value = emptyTable();
    show(null);
  });
  store.on("document", () => {
    const fresh = /** @type {Column[]} */ (store.document?.touch_columns ?? []);
    if (fresh.length === 0 || JSON.stringify(fresh) === JSON.stringify(columns.value)) return;
    // Another arm has other joints.
    columns.value = fresh;
    rows.value = emptyTable();
    show(null);
  });
}
