// Light or dark theme, from the system or chosen by the user.

import { find } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */

const KEPT_AS = "armcontour-theme";

/** @param {Store} store */
export function init(store) {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const button = find("#theme");
  const apply = () => {
    const chosen = localStorage.getItem(KEPT_AS);
    const theme = chosen === "dark" || chosen === "light" ? chosen : system.matches ? "dark" : "light";
    document.documentElement.dataset.theme = theme;
    button.setAttribute("aria-pressed", String(theme === "dark"));
    store.setTheme(theme);
  };
  button.addEventListener("click", () => {
    localStorage.setItem(KEPT_AS, store.theme === "dark" ? "light" : "dark");
    apply();
  });
  system.addEventListener("change", apply);
  apply();
}
