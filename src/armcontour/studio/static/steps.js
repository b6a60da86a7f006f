// List of the undo steps with their names; a click goes there.

import { find } from "./dom.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */

/** Space between the button and its list [px]. */
const GAP = 4;
const MOVES = /** @type {Record<string, number>} */ ({ ArrowDown: 1, ArrowUp: -1 });

/** @param {Store} store @param {import("./connection.js").Link} link */
export function init(store, link) {
  const button = /** @type {HTMLButtonElement} */ (find("#steps-open"));
  const list = find("#steps");
  const go = (/** @type {number} */ to) => {
    link.send({ op: "undo", to });
    list.hidePopover();
  };
  /** A state of the job: after `to` steps. @param {number} to @param {string} label @param {number} made */
  const row = (to, label, made) => html`<li key=${to}><button type="button" data-step=${to} class=${to > made ? "undone" : ""} aria-current=${to === made ? "step" : undefined}
    title=${to > made ? "Undone: click to make it again" : ""} onClick=${() => go(to)}>${label}</button></li>`;
  const update = () => {
    const { first, labels, made } = store.document?.steps ?? { first: 0, labels: [], made: 0 };
    button.disabled = !labels.length && !first;
    const begin = first ? `Before these, ${first} earlier steps` : "As opened";
    render(html`<ol aria-label="Steps">${row(first, begin, made)}${labels.map((/** @type {string} */ label, /** @type {number} */ k) => row(first + k + 1, label, made))}</ol>`, list);
    list.dataset.made = String(made);
  };
  list.addEventListener("toggle", (event) => {
    if (/** @type {ToggleEvent} */ (event).newState !== "open") return;
    const { left, bottom } = button.getBoundingClientRect();
    list.style.top = `${bottom + GAP}px`;
    list.style.left = `${Math.max(GAP, Math.min(left, innerWidth - list.offsetWidth - GAP))}px`;
    const now = /** @type {HTMLElement | null} */ (list.querySelector("[aria-current]"));
    now?.scrollIntoView({ block: "nearest" });
    now?.focus();
  });
  list.addEventListener("keydown", (event) => {
    const all = /** @type {HTMLElement[]} */ ([...list.querySelectorAll("button")]);
    const next = all[all.indexOf(/** @type {HTMLElement} */ (document.activeElement)) + (MOVES[event.key] ?? 0)];
    if (!(event.key in MOVES) || !next) return;
    event.preventDefault();
    event.stopPropagation();
    next.focus();
  });
  store.on("document", update);
  update();
}
