// List of the contours in the order of the motion. The user selects a contour here or in the drawing.

import { styleOf } from "./colours.js";
import { find } from "./dom.js";
import { layers, moveContour, runContour, runLayer } from "./form.js";
import { contourLabel, seconds } from "./format.js";
import { kindAt } from "./polylines.js";
import { orderByDragging } from "./reorder.js";
import { nowAndThen, READING } from "./state.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {{number: number, name: string, layer: string, t?: [number, number]}} Contour */

/** Number of contours on a page of the list; and from which number of contours on they can be searched. */
const [PAGE, SOUGHT_FROM] = [200, 12];

/** Buttons of the selected row, with their keys. @type {[string, string, string, number][]} */
const MOVES = [["ArrowUp", "↑", "earlier", -1], ["ArrowDown", "↓", "later", 1]];

/** Return the limit that is active longest on a contour. @param {import("./state.js").Frame} picture @param {number} k @returns {string} */
function limitOf(picture, k) {
  const { path_breaks: breaks, path_t: t } = picture.arrays;
  const times = /** @type {Record<string, number>} */ ({});
  for (let i = breaks[k]; i < breaks[k + 1] - 1; i++) {
    const kind = kindAt(picture, i);
    times[kind] = (times[kind] ?? 0) + t[i + 1] - t[i];
  }
  return Object.keys(times).sort((a, b) => times[b] - times[a])[0] ?? "unknown";
}

/** Return whether the page knows the contours: they come with the first picture, unless the job has none. @param {Store} store @returns {boolean} */
function isKnown(store) {
  const { path, data } = store.document ?? {};
  const hasNone = path?.kind === "blank" || data?.path?.edges?.length === 0;
  return hasNone || store.latest("picture") !== null || store.refusal !== null;
}

/** @param {Store} store */
export function init(store) {
  const region = find("#tab-contours");
  const all = () => /** @type {Contour[]} */ (store.latest("picture")?.head.contours ?? []);
  let isMoved = false;
  /** True if a contour was selected whose row is not yet drawn. */
  let isAwaited = false;
  /** What the user searches among the contours; and the first row of the shown page. */
  let [sought, first] = ["", 0];
  /** Contours that the search finds: those that are run with their place in the motion, then the others. @returns {{contour: Contour, k: number}[]} */
  const found = () => {
    const left = /** @type {Contour[]} */ (store.latest("picture")?.head.left_out ?? []);
    const rows = [...all().map((contour, k) => ({ contour, k })), ...left.map((contour) => ({ contour, k: -1 }))];
    const words = sought.toLowerCase();
    // A number is that of a contour; other words are in its name or layer.
    const isFound = (/** @type {Contour} */ { number, name, layer }) => (/^\d+$/.test(words) ? String(number).startsWith(words) : `${name} ${layer}`.toLowerCase().includes(words));
    return words ? rows.filter((x) => isFound(x.contour)) : rows;
  };
  const select = (/** @type {number} */ k) => {
    isMoved = false;
    store.selectContour(store.options.contour === k ? -1 : k);
  };
  const row = (/** @type {Contour} */ { number, name, layer, t }, /** @type {number} */ k) => {
    const picture = /** @type {import("./state.js").Frame} */ (store.latest("picture"));
    const { colour } = styleOf(t ? limitOf(picture, k) : "unknown", store.theme);
    return html`<li data-row=${k}><button type="button" aria-pressed=${String(store.options.contour === k)} onClick=${() => select(k)}>
      <span class="grip" aria-hidden="true" title="Drag to run it earlier or later">⠿</span>
      <span class="dot" style=${`background: ${colour}`} /><span class="name">${contourLabel({ number, name })}</span>
      <small>${!name.startsWith(`${layer}-`) && layer}</small><span class="time">${t ? `${seconds(t[1] - t[0])} s` : ""}</span></button>${store.options.contour === k && MOVES.map(([key, text, when, by]) => html`<button type="button" class="move" title=${`Run it ${when} (Alt+${text})`} aria-label=${`Run contour ${number} ${when}`} aria-keyshortcuts=${`Alt+${key}`} onClick=${() => move(k, k + by)}>${text}</button>`)}</li>`;
  };
  const move = (/** @type {number} */ k, /** @type {number} */ to) => {
    store.setView({ contour: k });
    isMoved = true;
    moveContour(all(), k, to);
  };
  /** Go from row to row by arrow keys; with Alt, move the row. @param {KeyboardEvent} event */
  const walk = (event) => {
    const { key, target } = event;
    const row = /** @type {Element} */ (target).closest("li");
    const next = { ArrowDown: row?.nextElementSibling, ArrowUp: row?.previousElementSibling }[key]?.firstElementChild;
    if (!(next instanceof HTMLElement)) return;
    event.preventDefault();
    const [k, to] = [row, next.parentElement].map((x) => Number(/** @type {HTMLElement} */ (x).dataset.row));
    if (event.altKey && Number.isInteger(k) && Number.isInteger(to)) return move(k, to);
    isMoved = false;
    next.focus();
  };
  orderByDragging(region, move);
  const update = nowAndThen(READING, () => {
    const contours = all();
    if (region.hidden) return;
    const known = layers();
    const rows = found();
    first = Math.min(first, PAGE * Math.floor(Math.max(0, rows.length - 1) / PAGE));
    const shown = rows.slice(first, first + PAGE);
    const count = contours.length + (store.latest("picture")?.head.left_out ?? []).length;
    const page = (/** @type {number} */ by, /** @type {string} */ text) => html`<button type="button" disabled=${first + by < 0 || first + by >= rows.length} onClick=${() => turn(first + by)}>${text}</button>`;
    render(
      html`${known.length > 1 && html`<div class="layers" role="group" aria-label="Layers that are run">${known.map(([name, is]) =>
        html`<label class="field"><input type="checkbox" checked=${is} onChange=${(/** @type {any} */ e) => runLayer(name, e.target.checked)} />${name}${!is && html` <small>not run</small>`}</label>`)}</div>`}
        ${(count > SOUGHT_FROM || sought) && html`<input type="search" class="seek-contour" aria-label="Search contours" placeholder="Number, name or layer" value=${sought} onInput=${(/** @type {any} */ e) => seek(e.target.value.trim())} />`}
        <ol class="contours" start=${first + 1} onKeyDown=${walk}>${shown.map(({ contour: x, k }) => (k >= 0 ? row(x, k) : html`<li><button type="button" class="left-out" title="Run it again" onClick=${() => runContour(x)}>
          <span class="grip" /><span class="dot" /><span class="name">${contourLabel(x)}</span><small>${x.layer}</small><span class="time">not run +</span></button></li>`))}</ol>
        ${sought && !rows.length && html`<p class="quiet" role="status">No contour matches "${sought}".</p>`}
        ${rows.length > PAGE && html`<p class="acts pages">${page(-PAGE, "Earlier")}<span role="status">${first + 1} to ${first + shown.length} of ${rows.length}</span>${page(PAGE, "Later")}</p>`}
        ${!contours.length && isKnown(store) && html`<p class="quiet">No contour yet: ${store.document?.model ? "click an edge of the part in the 3D view." : "draw one, or open a drawing."}</p>`}`,
      region,
    );
    // The focus goes with a moved row.
    if (isMoved && region.contains(document.activeElement)) /** @type {HTMLElement | null} */ (region.querySelector("[aria-pressed=true]"))?.focus();
    if (isAwaited) reveal();
    isAwaited = false;
  });
  const turn = (/** @type {number} */ row) => {
    first = row;
    update();
    region.querySelector("ol")?.scrollTo(0, 0);
  };
  const seek = (/** @type {string} */ words) => {
    sought = words;
    turn(0);
  };
  for (const event of ["document", "picture", "refusal", "view", "theme"]) store.on(event, update);
  store.on("reset", () => ([sought, first] = ["", 0]));
  /** Show the page on which the selected contour is, without a search that does not find it. */
  const turnToSelected = () => {
    const { contour } = store.options;
    if (contour < 0) return;
    if (!found().some((x) => x.k === contour)) sought = "";
    first = PAGE * Math.floor(found().findIndex((x) => x.k === contour) / PAGE);
    update();
  };
  let shown = -1;
  /** Scroll the list, but not the page, to a contour that was selected elsewhere. */
  const reveal = () => {
    const [list, row] = ["ol", "[aria-pressed=true]"].map((x) => /** @type {HTMLElement | null} */ (region.querySelector(x)));
    if (!list || !row) return;
    const top = list.scrollTop + row.getBoundingClientRect().top - list.getBoundingClientRect().top;
    list.scrollTop = Math.min(top, Math.max(list.scrollTop, top + row.offsetHeight - list.clientHeight));
  };
  store.on("view", () => {
    if (store.options.contour !== shown) {
      isAwaited = true;
      turnToSelected();
    }
    shown = store.options.contour;
  });
}
