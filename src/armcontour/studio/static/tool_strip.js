// Strip of tools at the left of the stage: one tool at a time, the same in the drawing and in the 3D view.

import { find, make } from "./dom.js";
import { canDraw } from "./pen.js";
import { html } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Tool} Tool */

/** Shapes of the pen, each with its picture. */
const PEN = { Line: "M3 13L13 3", Arc: "M2 12A6.3 6.3 0 0 1 14 12", Circle: "M8 2a6 6 0 1 0 .1 0z", Rectangle: "M2 4h12v8H2z" };
/**
 * Tools with their keys and pictures.
 * @type {{tool: Tool, name: string, key: string, title: string, d: string}[]}
 */
const TOOLS = [
  { tool: "select", name: "Select", key: "V", title: "Click a contour or an obstacle", d: "M4 2l9 6-4 1-2 4z" },
  { tool: "edges", name: "Pick edges", key: "E", title: "Click edges of the part in the 3D view", d: "M2 5l6-3 6 3v7l-6 3-6-3zM2 5l6 3 6-3M8 8v7" },
  { tool: "move", name: "Move part", key: "G", title: "Move, raise and turn the part as a whole", d: "M8 1v14M1 8h14M6 3l2-2 2 2M6 13l2 2 2-2M3 6 1 8l2 2M13 6l2 2-2 2" },
  { tool: "measure", name: "Measure", key: "M", title: "Two clicks: distance, angle, radius", d: "M2 10L10 2l4 4-8 8zM5 7l2 2M7 5l2 2M9 3l2 2" },
  { tool: "obstacles", name: "Obstacles", key: "O", title: "Add, move and remove obstacles", d: "M8 1l6 3v8l-6 3-6-3V4zM2 4l6 3 6-3M8 7v8" },
];
const TRANSPARENT = "M8 1l6 3v8l-6 3-6-3V4zM5 6l6 5M5 10l4 3M8 4l5 4";

/** Use a tool; it replaces the pen and another tool. @param {Store} store @param {Tool} tool */
export function chooseTool(store, tool) {
  const { options, document } = store;
  if (tool === "edges" && !document?.model) return;
  const stage = tool === "edges" && options.stage === "2d" ? "3d" : options.stage;
  const obstacle = tool === "obstacles" ? options.obstacle : -1;
  store.setView({ tool, pen: "", obstacle, ...(stage !== options.stage && { stage }) });
}

/** Use a tool, or stop using it. @param {Store} store @param {Tool} tool */
export const toggleTool = (store, tool) => chooseTool(store, store.options.tool === tool ? "select" : tool);

/** Show hidden edges, or no longer. @param {Store} store */
export const toggleTransparent = (store) => {
  if (store.document?.model) store.setView({ transparent: !store.options.transparent });
};

/** Leave what is selected; if nothing is, the tool. @param {Store} store */
export function escape(store) {
  const key = { taken: false };
  store.tell("escape", key);
  if (key.taken) return;
  const { tool, pen, contour, obstacle } = store.options;
  if (obstacle >= 0) store.setView({ obstacle: -1 });
  else if (contour >= 0) store.setView({ contour: -1 });
  else if (tool !== "select" || pen) chooseTool(store, "select");
}

/** A button with a picture. @param {{name: string, d: string, title: string, is: boolean, act: () => void, tool?: string}} props */
const Button = ({ name, d, title, is, act, tool }) => html`<button type="button" data-tool=${tool} title=${title} aria-label=${name} aria-pressed=${String(is)} onClick=${act}>
  <svg viewBox="0 0 16 16" aria-hidden="true"><path d=${d} /></svg><span>${name.split(" ").at(-1)}</span></button>`;

/** @param {{store: Store}} props */
export function ToolStrip({ store }) {
  const { options, document } = store;
  const draws = canDraw(store) && options.stage !== "3d";
  const draw = (/** @type {string} */ name) => store.setView({ pen: options.pen === name ? "" : name, tool: "select", obstacle: -1 });
  return html`<span class="tools" role="group" aria-label="Tools">
    ${TOOLS.filter(({ tool }) => tool !== "edges" || document?.model).map(({ tool, name, key, title, d }) =>
      html`<${Button} key=${tool} name=${name} d=${d} tool=${tool} title=${`${title} (${key})`} is=${options.tool === tool && !options.pen} act=${() => toggleTool(store, tool)} />`)}
    ${document?.model && html`<${Button} key="transparent" name="Transparent" d=${TRANSPARENT} title="See hidden edges of the part (X)" is=${options.transparent} act=${() => toggleTransparent(store)} />`}
    ${draws && Object.entries(PEN).map(([name, d]) =>
      html`<${Button} key=${name} name=${name} d=${d} title=${`${name}: drag in the drawing, or type values; Escape puts the pen away`} is=${options.pen === name} act=${() => draw(name)} />`)}</span>`;
}

/** Return the box beside the drawing in which tools show their fields. @returns {HTMLElement} */
export function toolBox() {
  const found = document.querySelector("#tool-box");
  if (found) return /** @type {HTMLElement} */ (found);
  const box = make("div", { id: "tool-box" });
  find("#messages").before(box);
  return box;
}

/** @param {Store} store */
export function init(store) {
  toolBox();
  window.addEventListener("keydown", (event) => {
    const isOurs = event.key === "Escape" && !event.defaultPrevented && !document.querySelector("dialog[open], [popover]:popover-open, [data-drawer=open]");
    if (!isOurs || (event.target instanceof Element && event.target.matches("textarea, select, input:not([type=range])"))) return;
    event.preventDefault();
    escape(store);
  });
}
