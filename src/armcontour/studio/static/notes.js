// What the server says beside figures: warnings, notes, slow places, where the time goes.

import { find, headings, make, say } from "./dom.js";
import { headOf } from "./figures.js";
import { nowAndThen, READING } from "./state.js";

/** @typedef {import("./state.js").Store} Store */

/** @param {string} title @param {Node[]} parts @returns {HTMLElement[]} */
const section = (title, parts) => (parts.length ? [make("section", {}, [make("h2", { text: title }), ...parts])] : []);

/** @param {string[]} sentences */
const list = (sentences) =>
  sentences.length
    ? [
        make(
          "ul",
          {},
          sentences.map((text) => make("li", { text })),
        ),
      ]
    : [];

/** Cells of a row, the first one its head. @param {string[]} texts */
const cellsOf = (texts) => texts.map((text, k) => make(k ? "td" : "th", k ? { text } : { text, scope: "row" }));

/** @param {Store} store */
export function init(store) {
  const region = find("#tab-notes");
  const tab = find("#tab-button-notes");
  let shown = "";
  const update = nowAndThen(READING, () => {
    const picture = store.latest("picture")?.head ?? {};
    const figures = store.isCurrent(store.latest("figures")) ? store.latest("figures")?.head : null;
    const warnings = [...new Set([...(picture.warnings ?? []), ...(figures?.warnings ?? [])])];
    const notes = [...new Set([...(picture.notes ?? []), ...(figures?.notes ?? [])])];
    tab.dataset.count = String(warnings.length || "");
    say(tab, warnings.length ? `Notes (${warnings.length})` : "Notes");
    if (region.hidden) return;
    const [head = [], ...shares] = headOf(store).time ?? [];
    const slow = (picture.shortfalls ?? []).map((/** @type {any} */ x) => x.sentence);
    const all = JSON.stringify([warnings, notes, shares, slow]);
    if (all === shown) return;
    shown = all;
    const rows = shares.map((/** @type {string[]} */ cells) => make("tr", {}, cellsOf(cells)));
    region.replaceChildren(
      ...section("Warnings", list(warnings)),
      ...section(
        "What takes the time",
        rows.length
          ? [
              make("table", {}, [
                make("thead", {}, [make("tr", {}, headings(head))]),
                make("tbody", {}, rows),
              ]),
            ]
          : [],
      ),
      ...section("Where it is slower than wished", list(slow)),
      ...section("Notes", list(notes)),
    );
  });
  for (const event of ["picture", "figures", "view"]) store.on(event, update);
}
