// Tools of the drawing: colour of the path, pen, fit, zoom and legend.

import { find, make } from "./dom.js";
import { legendOf, scalesOf } from "./legend.js";
import { comparedExecution } from "./motion.js";
import { nowAndThen, oncePerFrame, READING } from "./state.js";
import { ToolStrip } from "./tool_strip.js";
import { inches } from "./units.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./legend.js").Sample} Sample */
/** @typedef {import("./legend.js").Shades} Shades */

const COLOURINGS = { limit: "Limit", speed: "Speed", error: "Error" };
const STAGES = { "2d": "2D", both: "Both", "3d": "3D" };
const LEGEND_EVERY = 250; // ms

/**
 * A choice of one option: buttons of which one is pressed.
 * @param {{label: string, names: Record<string, string>, now: string, choose: (name: any) => void}} props
 */
const Choice = ({ label, names, now, choose }) => html`<span class="group choice" role="group" aria-label=${label}>
  ${Object.entries(names).map(([name, text]) => html`<button type="button" data-name=${name} title=${`${label}: ${text.toLowerCase()}`} aria-pressed=${String(now === name)} onClick=${() => choose(name)}>${text}</button>`)}</span>`;

/** A sample with its text, or shades between two texts. @param {{entry: Sample | Shades}} props */
function Entry({ entry }) {
  if ("shades" in entry) {
    const { shades, from, to } = entry;
    return html`${from} <span class="shades" aria-hidden="true" style=${`background: linear-gradient(to right, ${shades.join()})`} /> ${to}`;
  }
  const { colour, dash, width, length, corners, text } = entry;
  const shape = corners
    ? html`<polygon points=${corners.join(" ")} fill=${colour} transform=${`translate(${length / 2} 6)`} />`
    : html`<path d=${`M0 4H${length}`} stroke=${colour} stroke-width=${width} stroke-dasharray=${dash.join(" ") || "none"} />`;
  return html`<svg width=${Math.round(length)} height=${corners ? 12 : 8} aria-hidden="true">${shape}</svg> ${text}`;
}

/** @param {Store} store @param {import("./connection.js").Link} _link @param {import("./pointer.js").Pointer} pointer */
export function init(store, _link, { view }) {
  const bar = find("#viewbar");
  const legend = find("#legend");
  const scales = make("div", { class: "scales", "aria-hidden": "true" });
  view.region.append(scales);
  /** Page width for which the legend's lines were counted [px], and what it shows. */
  let [wide, shown] = [0, ""];
  /** Update the legend, but not at every move. */
  const updateLegend = nowAndThen(LEGEND_EVERY, () => {
    const picture = store.latest("picture");
    if (!picture) return;
    const magnify = comparedExecution(store) ? Number(view.region.dataset.magnify) : 0;
    const [entries, lengths] = [legendOf(store, view.layers, picture, magnify), scalesOf(view.view.scale, magnify)];
    const now = JSON.stringify([entries, lengths]);
    if (now === shown) return;
    shown = now;
    render(html`${entries.map((entry) => html`<span><${Entry} entry=${entry} /></span>`)}`, legend);
    render(html`${lengths.map((entry) => html`<span class="scale"><${Entry} entry=${entry} /></span>`)}`, scales);
    // The legend keeps its number of lines, so that the drawing does not change its size with every active limit.
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
      html`<${ToolStrip} store=${store} />
        <span class="looks"><${Choice} label="Colour by" names=${COLOURINGS} now=${options.colour} choose=${set("colour")} />
          <span class="group zoom">${button("−", "Zoom out (−)", () => view.zoomBy(1 / 1.4))}${button("+", "Zoom in (+)", () => view.zoomBy(1.4))}${button("Fit", "Show all (F)", () => store.tell("fit"))}</span></span>
        <${Choice} label="View" names=${STAGES} now=${options.stage} choose=${set("stage")} />`,
      bar,
    );
    bar.dataset.stage = options.stage;
    updateLegend();
  };
  const soon = oncePerFrame(update);
  for (const event of ["document", "view", "theme"]) store.on(event, soon);
  const follow = nowAndThen(READING, update);
  for (const event of ["picture", "executed"]) store.on(event, follow);
  view.followers.add(follow);
  inches.subscribe(updateLegend);
  update();
}
