// Tabs of details and settings, and visibility of the views.

import { find, say } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */

const MOVES = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowLeft: -1 });
/** Panels that show fields of the form. */
const FIELDS = new Set(["contours", "process", "robot"]);

/** Tabs of a list, by the name of their panel. @param {string} list @param {(name: string) => void} choose */
function listen(list, choose) {
  const tabs = /** @type {HTMLElement[]} */ ([...document.querySelectorAll(`${list} [role="tab"]`)]);
  const nameOf = (/** @type {HTMLElement} */ tab) => tab.id.replace("tab-button-", "");
  for (const tab of tabs) {
    tab.addEventListener("click", () => choose(nameOf(tab)));
    tab.addEventListener("keydown", (event) => {
      const next = tabs[(tabs.indexOf(tab) + (MOVES[event.key] ?? 0) + tabs.length) % tabs.length];
      if (next === tab) return;
      event.preventDefault();
      event.stopPropagation();
      choose(nameOf(next));
      next.focus();
    });
  }
  return (/** @type {string} */ chosen) => {
    for (const tab of tabs) {
      const selected = nameOf(tab) === chosen;
      tab.setAttribute("aria-selected", String(selected));
      tab.tabIndex = selected ? 0 : -1;
      const panel = document.getElementById(`tab-${nameOf(tab)}`);
      if (panel) panel.hidden = !selected;
    }
  };
}

/** The settings as a drawer, in pages that are too narrow for them beside the drawing. @param {Store} store */
function drawer(store) {
  const [panel, button] = [find("#panel"), find("#panel-open")];
  const show = (/** @type {boolean} */ is) => {
    document.body.dataset.drawer = is ? "open" : "closed";
    button.setAttribute("aria-expanded", String(is));
    if (is) find("[role=tab][aria-selected=true]", panel).focus();
    else if (panel.contains(document.activeElement)) button.focus();
  };
  show(false);
  // The drawer begins below the header and the figures.
  const place = () => document.documentElement.style.setProperty("--head", `${find("#figures").getBoundingClientRect().bottom}px`);
  for (const above of ["#bar", "#figures"]) new ResizeObserver(place).observe(find(above));
  button.addEventListener("click", () => show(document.body.dataset.drawer !== "open"));
  find("#panel-close").addEventListener("click", () => show(false));
  // Without a connection nothing can be set, and the message says how to go on.
  store.on("link", (/** @type {any} */ { state }) => (state === "lost" || state === "refused") && show(false));
  // The ground beside the drawer closes it.
  addEventListener("pointerdown", ({ target }) => {
    const isBeside = target === document.body || !(/** @type {Element} */ (target).closest("#panel, #hint, #panel-open, dialog, [popover]"));
    if (document.body.dataset.drawer === "open" && isBeside) show(false);
  });
  panel.addEventListener("keydown", (event) => {
    // In a field, Escape gives up what was typed.
    const isField = /** @type {Element} */ (event.target).matches("input, textarea");
    if (event.key !== "Escape" || isField || document.body.dataset.drawer !== "open") return;
    // This key leaves neither the selected contour nor the tool.
    event.preventDefault();
    show(false);
  });
}

/** @param {Store} store */
export function init(store) {
  drawer(store);
  const showTabs = listen("#tabs", (tab) => store.setView({ tab, dock: true }));
  const showSides = listen("#sides", (side) => store.setView({ side: /** @type {any} */ (side) }));
  const toggle = find("#dock-toggle");
  toggle.addEventListener("click", () => store.setView({ dock: !store.options.dock }));
  const show = () => {
    const { tab, side, dock, stage } = store.options;
    showTabs(tab);
    showSides(side);
    find("#form").hidden = !FIELDS.has(side);
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
