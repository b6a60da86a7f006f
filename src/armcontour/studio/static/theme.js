// Light or dark theme of the system.

/** @typedef {import("./state.js").Store} Store */

/** @param {Store} store */
export function init(store) {
  const system = matchMedia("(prefers-color-scheme: dark)");
  const apply = () => {
    const theme = system.matches ? "dark" : "light";
    document.documentElement.dataset.theme = theme;
    store.setTheme(theme);
  };
  system.addEventListener("change", apply);
  apply();
}
