// Toolbar of the drawing: colour of the path, pen, fit, zoom and legend.

import { find, make } from "./dom.js";
import { legendOf, scalesOf } from "./legend.js";
import { canDraw } from "./pen.js";
import { nowAndThen, oncePerFrame, READING } from "./state.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {import("./legend.js").Sample} Sample */
/** @typedef {import("./legend.js").Shades} Shades */

const COLOURINGS = { limit: "Limit", speed: "Speed", error: "Error" };
const STAGES = { "2d": "2D", both: "Both", "3d": "3D" };
/** Shapes of the pen, each with its picture. */
const PEN = { Line: "M3 13L13 3", Arc: "M2 12A6.3 6.3 0 0 1 14 12", Circle: "M8 2a6 6 0 1 0 .1 0z", Rectangle: "M2 4h12v8H2z" };
const LEGEND_EVERY = 250; // ms

/**
 * One of several: buttons of which one is pressed.
 * @param {{label: string, names: Record<string, string>, now: string, choose: (name: any) => void}} props
 */
const Choice = ({ label, names, now, choose }) => html`<span class="group choice" role="group" aria-label=${label}>
  ${Object.entries(names).map(([name, text]) => html`<button type="button" data-name=${name} title=${`${label}: ${text.toLowerCase()}`} aria-pressed=${String(now === name)} onClick=${() => choose(name)}>${text}</button>`)}</span>`;

/** @param {{text: string, title: string, is: boolean, act: () => void}} props */
const Toggle = ({ text, title, is, act }) => html`<button type="button" title=${title} aria-pressed=${String(is)} onClick=${act}>${text}</button>`;

/** Shapes that can be drawn, of which one may be chosen. @param {{now: string, can: boolean, choose: (name: string) => void}} props */
const Pen = ({ now, can, choose }) => html`<span class="group choice" role="group" aria-label="Pen">
  ${Object.entries(PEN).map(([name, d]) => html`<button type="button" aria-label=${name} title=${`${name}: drag in the drawing, or type values; Escape puts the pen away`} disabled=${!can} aria-pressed=${String(now === name)} onClick=${() => choose(name)}><svg viewBox="0 0 16 16" aria-hidden="true"><path d=${d} /></svg></button>`)}</span>`;

/** A sample with its text, or shades between theirs. @param {{entry: Sample | Shades}} props */
function Entry({ entry }) {
  if ("shades" in entry) {
    const { shades, from, to } = entry;
    const paint = (/** @type {HTMLCanvasElement | null} */ canvas) => {
      const context = canvas?.getContext("2d");
      shades.forEach((shade, k) => {
        if (!context) return;
        context.fillStyle = shade;
        context.fillRect((96 * k) / shades.length, 0, 96 / shades.length, 8);
      });
    };
    return html`${from} <canvas width="96" height="8" aria-hidden="true" ref=${paint} /> ${to}`;
  }
  const { colour, dash, width, length, corners, text } = entry;
  const shape = corners
    ? html`<polygon points=${corners.join(" ")} fill=${colour} transform=${`translate(${length / 2} 6)`} />`
    : html`<path d=${`M0 4H${length}`} stroke=${colour} stroke-width=${width} stroke-dasharray=${dash.join(" ") || "none"} />`;
  return html`<svg width=${Math.round(length)} height=${corners ? 12 : 8} aria-hidden="true">${shape}</svg> ${text}`;
}

/** @param {Store} store @param {View2d} view */
export function init(store, view) {
  const bar = find("#viewbar");
  const legend = find("#legend");
  const scales = make("div", { class: "scales", "aria-hidden": "true" });
  view.region.append(scales);
  /** Width of the page for which the legend has its lines [px], and what it shows. */
  let [wide, shown] = [0, ""];
  /** The legend is not made again at every move. */
  const updateLegend = nowAndThen(LEGEND_EVERY, () => {
    const picture = store.latest("picture");
    if (!picture) return;
    const magnify = store.options.executed ? Number(view.region.dataset.magnify) : 0;
    const [entries, lengths] = [legendOf(store, view.layers, picture, magnify), scalesOf(view.view.scale, magnify)];
    const now = JSON.stringify([entries, lengths]);
    if (now === shown) return;
    shown = now;
    render(html`${entries.map((entry) => html`<span><${Entry} entry=${entry} /></span>`)}`, legend);
    render(html`${lengths.map((entry) => html`<span class="scale"><${Entry} entry=${entry} /></span>`)}`, scales);
    // Lines that the legend has needed stay: the drawing above does not change its size with every limit that is active.
    if (innerWidth !== wide) legend.style.minHeight = "";
    wide = innerWidth;
    legend.style.minHeight = `${legend.offsetHeight}px`;
  });
  const update = () => {
    const { options } = store;
    const set = (/** @type {string} */ name) => (/** @type {any} */ value) => store.setView({ [name]: value });
    const button = (/** @type {string} */ text, /** @type {string} */ title, /** @type {() => void} */ act) =>
      html`<button type="button" title=${title} aria-label=${`${text}: ${title}`} onClick=${act}>${text}</button>`;
    render(
      html`<${Choice} label="Colour by" names=${COLOURINGS} now=${options.colour} choose=${set("colour")} />
        <${Toggle} text="Executed" title="Show the executed tool, its error magnified (E)" is=${options.executed} act=${() => set("executed")(!store.options.executed)} />
        <${Toggle} text="Place part" title="Move and turn the part as a whole (M)" is=${options.place} act=${() => set("place")(!store.options.place)} />
        <${Pen} now=${options.pen} can=${canDraw(store)} choose=${(/** @type {string} */ name) => set("pen")(store.options.pen === name ? "" : name)} />
        <button type="button" id="add-obstacle" data-later title="A box beside the part, with a name and a height; drag it or its corner, press F2 to change them">Add obstacle</button>
        <span class="spring" />
        <span class="group">${button("−", "Zoom out (−)", () => view.zoomBy(1 / 1.4))}${button("+", "Zoom in (+)", () => view.zoomBy(1.4))}${button("Fit", "Show all (F)", () => view.fit())}</span>
        <${Choice} label="View" names=${STAGES} now=${options.stage} choose=${set("stage")} />`,
      bar,
    );
    updateLegend();
  };
  const soon = oncePerFrame(update);
  for (const event of ["document", "view", "theme"]) store.on(event, soon);
  const follow = nowAndThen(READING, update);
  for (const event of ["picture", "executed"]) store.on(event, follow);
  view.followers.add(follow);
  update();
}
