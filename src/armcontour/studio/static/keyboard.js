// Keyboard control of everything that the mouse can do. In a field, keys belong to the field.

import { find } from "./dom.js";
import { shownMotion } from "./motion.js";
import { chooseTool, toggleTool, toggleTransparent } from "./tool_strip.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./view2d.js").View2d} View2d */

/** Return whether keys belong to the element, because text is typed there. @param {EventTarget | null} target */
const isField = (target) => target instanceof Element && target.matches("textarea, select, input:not([type=range], [type=checkbox], [type=radio], [type=button])");

/** @param {KeyboardEvent} event @returns {string} such as "ctrl+shift+z" */
function nameOf(event) {
  const { key, metaKey, shiftKey } = event;
  // AltGr, which some keyboards need for brackets, is reported as Ctrl and Alt.
  const isAltGr = event.getModifierState("AltGraph");
  const ctrl = (event.ctrlKey && !isAltGr) || metaKey;
  const altKey = event.altKey && !isAltGr;
  // Shift alone is part of the character.
  const shift = shiftKey && (ctrl || key.length > 1);
  return [ctrl && "ctrl", altKey && "alt", shift && "shift", key.toLowerCase()].filter(Boolean).join("+");
}

/** @param {Store} store @param {View2d} view @returns {Record<string, () => void>} */
function actions(store, view) {
  const click = (/** @type {string} */ id) => () => find(`#${id}`).click();
  const pan = (/** @type {number} */ x, /** @type {number} */ y) => () => {
    view.view.pan(x, y);
    view.moved();
  };
  const jump = (/** @type {string} */ name) => () => /** @type {HTMLElement} */ (find(`#playback [data-jump=${name}]`)).click();
  const stages = /** @type {const} */ (["2d", "both", "3d"]);
  return {
    "ctrl+z": click("undo"),
    "ctrl+shift+z": click("redo"),
    "ctrl+y": click("redo"),
    "ctrl+s": click("save"),
    "ctrl+o": click("open"),
    " ": () => /** @type {HTMLElement} */ (find("#playback .play")).click(),
    "[": jump("contour-before"),
    "]": jump("contour-after"),
    "{": jump("stop-before"),
    "}": jump("stop-after"),
    ".": jump("slowest"),
    home: () => store.setTime(0),
    end: () => store.setTime(shownMotion(store)?.duration ?? 0),
    f: () => store.tell("fit"),
    "+": () => view.zoomBy(1.4),
    "=": () => view.zoomBy(1.4),
    "-": () => view.zoomBy(1 / 1.4),
    "shift+arrowleft": pan(60, 0),
    "shift+arrowright": pan(-60, 0),
    "shift+arrowup": pan(0, 60),
    "shift+arrowdown": pan(0, -60),
    v: () => chooseTool(store, "select"),
    e: () => toggleTool(store, "edges"),
    g: () => toggleTool(store, "move"),
    m: () => toggleTool(store, "measure"),
    o: () => toggleTool(store, "obstacles"),
    x: () => toggleTransparent(store),
    b: () => store.setView({ stage: stages[(stages.indexOf(store.options.stage) + 1) % 3] }),
    ...Object.fromEntries([1, 2, 3, 4, 5].map((number) => [String(number), () => store.tell("look", number)])),
    d: () => store.setView({ dock: !store.options.dock }),
    delete: () => {
      const { obstacle } = store.options;
      if (obstacle >= 0) store.tell("remove obstacle", obstacle);
    },
    "?": click("help-open"),
  };
}

/** @param {Store} store @param {Link} link @param {import("./pointer.js").Pointer} pointer */
export function init(store, link, { view }) {
  const act = actions(store, view);
  const help = /** @type {HTMLDialogElement} */ (find("#help"));
  find("#help-open").addEventListener("click", () => help.showModal());
  find(".skip").addEventListener("click", (event) => {
    event.preventDefault();
    find(store.options.stage === "3d" ? "#view3d canvas" : "#view2d").focus();
  });
  window.addEventListener("keydown", (event) => {
    if (event.defaultPrevented || document.querySelector("dialog[open]")) return;
    const name = nameOf(event);
    const everywhere = name === "ctrl+s" || name === "ctrl+o";
    if (!act[name] || (isField(event.target) && !everywhere)) return;
    // On sliders and buttons, letters and signs are free, but keys that move a slider are not. Panels scroll with Home and End.
    const isEnd = event.key === "Home" || event.key === "End";
    if (event.target instanceof HTMLInputElement && (isEnd || event.key.startsWith("Arrow"))) return;
    if (isEnd && event.target instanceof Element && event.target.matches("[role=tabpanel], [role=tabpanel] *")) return;
    if (name === " " && event.target instanceof Element && event.target.matches("button, summary, a, input, [role]:not(.scrub)")) return;
    event.preventDefault();
    if (!store.document && name !== "?") return;
    if (!name.startsWith("ctrl+")) return act[name]();
    // The command applies to the job after the earlier keys.
    link.whenKnown(() => {
      store.tell("command");
      link.whenKnown(act[name]);
    });
  });
}
