// Further information from the server: warnings, notes, slow points, time per limit.

import { find, say } from "./dom.js";
import { headOf } from "./figures.js";
import { Tabular } from "./components.js";
import { contourLabel } from "./format.js";
import { nowAndThen, READING } from "./state.js";
import { inches, shownText } from "./units.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */

/** A titled list of sentences; nothing if it is empty. @param {{title: string, sentences: any[]}} props */
const Sentences = ({ title, sentences }) => html`${sentences.length > 0 && html`<section><h2>${title}</h2><ul>${sentences.map((text) => html`<li>${typeof text === "string" ? shownText(text) : text}</li>`)}</ul></section>`}`;

/**
 * Return the slowest place of each contour and limit, and at how many places this limit makes the contour slow.
 * @param {any[]} places @returns {{place: any, count: number}[]}
 */
function slowestOf(places) {
  /** @type {Map<string, {place: any, count: number}>} */
  const groups = new Map();
  for (const place of places) {
    const key = JSON.stringify([place.contour, place.reason]);
    const known = groups.get(key);
    if (!known) groups.set(key, { place, count: 1 });
    else {
      known.count += 1;
      if (place.share < known.place.share) known.place = place;
    }
  }
  return [...groups.values()];
}

/** @param {Store} store */
export function init(store) {
  const region = find("#tab-notes");
  const tab = find("#tab-button-notes");
  const update = nowAndThen(READING, () => {
    const picture = store.latest("picture")?.head ?? {};
    const figures = store.isCurrent(store.latest("figures")) ? store.latest("figures")?.head : {};
    const arm = store.latest("arm")?.head ?? {};
    const all = (/** @type {string} */ name) => [...new Set([picture, figures, arm].flatMap((x) => x[name] ?? []))];
    const warnings = all("warnings");
    tab.dataset.count = String(warnings.length || "");
    say(tab, warnings.length ? `Notes (${warnings.length})` : "Notes");
    if (region.hidden) return;
    // The panel has room for the limit, its time and its share.
    const [head = [], ...shares] = (headOf(store).time ?? []).map((/** @type {string[]} */ row) => row.slice(0, 3).map(shownText));
    const slow = slowestOf(picture.shortfalls ?? []).map(({ place: { contour, t, sentence }, count }) => {
      const others = count > 1 ? `, and at ${count - 1} more ${count > 2 ? "places" : "place"}` : "";
      return html`<button type="button" class="link" title="Show its place" onClick=${() => store.goTo(t)}>${contourLabel(picture.contours[contour])}</button>: ${shownText(sentence)}${others}`;
    });
    render(
      html`<${Sentences} title="Warnings" sentences=${warnings} />
        ${shares.length > 0 && html`<section><h2>Time by limit</h2><table><${Tabular} columns=${head} rows=${shares} /></table></section>`}
        <${Sentences} title="Slower than assigned" sentences=${slow} />
        <${Sentences} title="Notes" sentences=${all("notes")} />`,
      region,
    );
  });
  for (const event of ["arm", "picture", "figures", "view"]) store.on(event, update);
  inches.subscribe(update);
}
