// Splitter between drawing and dock, by drag or by arrow keys.

import { find, make } from "./dom.js";
import { dragged } from "./gesture.js";

/** @typedef {import("./state.js").Store} Store */

const KEPT_AS = "armcontour-dock";
const STEP = 24; // px
const LEAST = 90;

/** @param {Store} store */
export function init(store) {
  const body = find("#dock-body");
  const edge = make("div", {
    id: "dock-edge",
    role: "separator",
    tabindex: 0,
    "aria-orientation": "horizontal",
    "aria-label": "Height of the details",
    "aria-valuemin": LEAST,
    "aria-controls": "dock-body",
  });
  let start = { y: 0, height: 0 };
  const set = (/** @type {number} */ height) => {
    const most = Math.max(LEAST, Math.round(0.7 * window.innerHeight));
    const chosen = Math.round(Math.min(most, Math.max(LEAST, height)));
    body.style.height = `${chosen}px`;
    edge.setAttribute("aria-valuemax", String(most));
    edge.setAttribute("aria-valuenow", String(chosen));
    localStorage.setItem(KEPT_AS, String(chosen));
    store.tell("layout");
  };
  dragged(edge, {
    start: (event) => {
      start = { y: event.clientY, height: body.offsetHeight };
      return store.options.dock;
    },
    move: (event) => set(start.height + start.y - event.clientY),
    end: () => {},
  });
  edge.addEventListener("keydown", (event) => {
    const steps = event.key === "ArrowUp" ? 1 : event.key === "ArrowDown" ? -1 : 0;
    if (!steps) return;
    event.preventDefault();
    set(body.offsetHeight + steps * STEP);
  });
  find("#dock").prepend(edge);
  const kept = Number(localStorage.getItem(KEPT_AS));
  edge.setAttribute("aria-valuenow", String(body.offsetHeight));
  if (kept >= LEAST) set(kept);
}
