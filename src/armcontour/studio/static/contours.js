// List of the contours, in the order of the motion; one may be selected, here or in the drawing.

import { styleOf } from "./colours.js";
import { find } from "./dom.js";
import { layers, runLayer } from "./form.js";
import { contourLabel, seconds } from "./format.js";
import { kindAt } from "./polylines.js";
import { nowAndThen, READING } from "./state.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {{number: number, name: string, layer: string, t?: [number, number]}} Contour */

/** So many are listed; the others are selected in the drawing. */
const MOST = 500;

/** The limit that takes most of the time of a contour. @param {import("./state.js").Frame} picture @param {number} k @returns {string} */
function limitOf(picture, k) {
  const { path_breaks: breaks, path_t: t } = picture.arrays;
  const times = /** @type {Record<string, number>} */ ({});
  for (let i = breaks[k]; i < breaks[k + 1] - 1; i++) {
    const kind = kindAt(picture, i);
    times[kind] = (times[kind] ?? 0) + t[i + 1] - t[i];
  }
  return Object.keys(times).sort((a, b) => times[b] - times[a])[0] ?? "unknown";
}

/** @param {Store} store */
export function init(store) {
  const region = find("#tab-contours");
  const select = (/** @type {number} */ k) => {
    const [begin] = store.latest("picture")?.head.contours[k]?.t ?? [];
    store.setView({ contour: store.options.contour === k ? -1 : k });
    if (begin !== undefined) store.setTime(begin);
  };
  const row = (/** @type {Contour} */ { number, name, layer, t }, /** @type {number} */ k) => {
    const picture = /** @type {import("./state.js").Frame} */ (store.latest("picture"));
    const { colour } = styleOf(t ? limitOf(picture, k) : "unknown", store.theme);
    return html`<li><button type="button" aria-pressed=${String(store.options.contour === k)} onClick=${() => select(k)}>
      <span class="dot" style=${`background: ${colour}`} /><span class="name">${contourLabel({ number, name })}</span>
      <small>${!name.startsWith(`${layer}-`) && layer}</small><span class="time">${t ? `${seconds(t[1] - t[0])} s` : ""}</span></button></li>`;
  };
  /** Arrow keys go from row to row. @param {KeyboardEvent} event */
  const walk = (event) => {
    const { key, target } = event;
    const row = /** @type {Element} */ (target).closest("li");
    const next = { ArrowDown: row?.nextElementSibling, ArrowUp: row?.previousElementSibling }[key]?.firstElementChild;
    if (!(next instanceof HTMLElement)) return;
    event.preventDefault();
    next.focus();
  };
  const update = nowAndThen(READING, () => {
    const contours = /** @type {Contour[]} */ (store.latest("picture")?.head.contours ?? []);
    if (region.hidden) return;
    const more = contours.length - MOST;
    const all = layers();
    render(
      html`${all.length > 1 && html`<div class="layers" role="group" aria-label="Layers that are run">${all.map(([name, is]) =>
        html`<label class="field"><input type="checkbox" checked=${is} onChange=${(/** @type {any} */ e) => runLayer(name, e.target.checked)} />${name}${!is && html` <small>not run</small>`}</label>`)}</div>`}
        <ol class="contours" onKeyDown=${walk}>${contours.slice(0, MOST).map(row)}</ol>
        ${!contours.length && html`<p class="quiet">No contour yet: draw one, or open a drawing.</p>`}
        ${more > 0 && html`<p class="quiet">${more} more: click them in the drawing.</p>`}`,
      region,
    );
  });
  for (const event of ["document", "picture", "view", "theme"]) store.on(event, update);
  let shown = -1;
  /** A contour that is selected elsewhere comes into sight: the list is scrolled, and not the page. */
  const reveal = () => {
    const [list, row] = ["ol", "[aria-pressed=true]"].map((x) => /** @type {HTMLElement | null} */ (region.querySelector(x)));
    if (!list || !row) return;
    const top = row.offsetTop - list.offsetTop;
    list.scrollTop = Math.min(top, Math.max(list.scrollTop, top + row.offsetHeight - list.clientHeight));
  };
  store.on("view", () => {
    if (store.options.contour !== shown) setTimeout(reveal, 2 * READING);
    shown = store.options.contour;
  });
}
