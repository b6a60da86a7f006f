// Groups of buttons are one stop of the Tab key; arrow keys go from button to button in a group.

import { mark } from "./dom.js";
import { nowAndThen, READING } from "./state.js";

/** Groups with one stop. */
const GROUPS = "#bar .group, #viewbar .tools, #viewbar .group, .arm-bar, #playback .jumps, .shares .note, #panel .choice";
const MOVES = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowDown: 1, ArrowLeft: -1, ArrowUp: -1 });

/** Buttons of a group that can have the focus. @param {Element} group @returns {HTMLButtonElement[]} */
const buttonsOf = (group) => [.../** @type {NodeListOf<HTMLButtonElement>} */ (group.querySelectorAll("button:not(:disabled)"))].filter((x) => x.checkVisibility());

/** Let one button of a group be its stop: the one with the focus, else the same as before, else the pressed one or the first. @param {Element} group */
function settle(group) {
  const all = buttonsOf(group);
  const stop = all.find((x) => x === document.activeElement) ?? all.find((x) => x.tabIndex === 0 && x.hasAttribute("tabindex")) ?? all.find((x) => x.ariaPressed === "true") ?? all[0];
  for (const button of all) mark(button, "tabindex", button === stop ? "0" : "-1");
}

const settleAll = () => document.querySelectorAll(GROUPS).forEach(settle);

/** @param {import("./state.js").Store} store */
export function init(store) {
  const soon = nowAndThen(READING, settleAll);
  for (const event of ["document", "view", "arm", "picture", "figures", "layout", "refusal"]) store.on(event, soon);
  document.addEventListener("focusin", ({ target }) => {
    const group = target instanceof Element && target.closest(GROUPS);
    if (group) settle(group);
    else soon();
  });
  document.addEventListener(
    "keydown",
    (event) => {
      const { target, key } = event;
      const group = target instanceof HTMLButtonElement && target.closest(GROUPS);
      if (!group || !(key in MOVES) || event.ctrlKey || event.metaKey || event.altKey) return;
      const all = buttonsOf(group);
      const next = all[(all.indexOf(target) + MOVES[key] + all.length) % all.length];
      event.preventDefault();
      event.stopPropagation();
      next.focus();
    },
    { capture: true },
  );
  soon();
}
