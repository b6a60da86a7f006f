// Tabs below the drawing, and visibility of the views.

import { find, say } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */

const MOVES = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowLeft: -1 });

/** @param {Store} store */
export function init(store) {
  const tabs = /** @type {HTMLElement[]} */ ([...document.querySelectorAll('#tabs [role="tab"]')]);
  const nameOf = (/** @type {HTMLElement} */ tab) => tab.id.replace("tab-button-", "");
  const toggle = find("#dock-toggle");
  for (const tab of tabs) {
    tab.addEventListener("click", () => store.setView({ tab: nameOf(tab), dock: true }));
    tab.addEventListener("keydown", (event) => {
      const next = tabs[(tabs.indexOf(tab) + (MOVES[event.key] ?? 0) + tabs.length) % tabs.length];
      if (next === tab) return;
      event.preventDefault();
      event.stopPropagation();
      store.setView({ tab: nameOf(next), dock: true });
      next.focus();
    });
  }
  toggle.addEventListener("click", () => store.setView({ dock: !store.options.dock }));
  const show = () => {
    const { tab: chosen, dock, stage } = store.options;
    for (const tab of tabs) {
      const selected = nameOf(tab) === chosen;
      tab.setAttribute("aria-selected", String(selected));
      tab.tabIndex = selected ? 0 : -1;
      find(`#tab-${nameOf(tab)}`).hidden = !selected;
    }
    find("#dock-body").hidden = !dock;
    toggle.setAttribute("aria-expanded", String(dock));
    say(toggle, dock ? "Hide" : "Show");
    find("#view2d").hidden = stage === "3d";
    find("#view3d").hidden = stage === "2d";
    find("#views").dataset.stage = stage;
  };
  store.on("view", show);
  show();
}
