// Bodies that come too near to each other: their pairs in order of time, and what to do about each.

import { find, make } from "./dom.js";
import { clockOf } from "./format.js";
import { oncePerFrame } from "./state.js";
import { chooseTool, toolBox } from "./tool_strip.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/**
 * A pair of bodies that is too near: at the time `t` [s], the joints are at `q` and the nearest points are `points`, in the frame of the floor [m].
 * @typedef {{first: string, second: string, words: string, t: number, q: number[], points: number[][], sentence: string}} Contact
 */

/** Largest number of pairs that are listed. */
const MOST = 4;
/** Two times are the same within this difference [s]. */
const SAME = 1e-9;

/** Return the pairs of the refusal, in order of time. @param {Store} store @returns {Contact[]} */
export const contactsOf = (store) => store.refusal?.head.contacts ?? [];

/** The pair that was shown last: several pairs can be too near from the same time on. */
let chosen = "";

/** Return the name of a pair in the page. @param {Contact} contact */
const nameOf = ({ first, second }) => `${first},${second}`;

/** Return the pair that is too near from the shown time on, of several the chosen one; null at other times. @param {Store} store @returns {Contact | null} */
export function contactAt(store) {
  const now = contactsOf(store).filter(({ t }) => Math.abs(t - store.time) < SAME);
  return now.find((contact) => nameOf(contact) === chosen) ?? now[0] ?? null;
}

/** Return the names of the bodies to show in red: those of the shown contact, or of the first one. @param {Store} store @returns {string[]} */
export function alarmedBodies(store) {
  const contact = contactAt(store) ?? contactsOf(store)[0];
  return contact ? [contact.first, contact.second] : (store.refusal?.head.bodies ?? []);
}

/** Return whether the job can allow two bodies to touch: one of them is an obstacle or a part of a model. @param {Store} store @param {Contact} contact @returns {boolean} */
function canAllow({ document }, { first, second }) {
  const names = [...(document?.obstacles ?? []).map((/** @type {any} */ x) => x.name), ...(document?.parts ?? [])];
  return names.includes(first) || names.includes(second);
}

/** Return the number of the obstacle of a pair that can be moved; -1 without one. @param {Store} store @param {Contact} contact @returns {number} */
function movableIn({ document }, { first, second }) {
  return (document?.obstacles ?? []).find((/** @type {any} */ x) => (x.name === first || x.name === second) && x.type !== "halfspace")?.index ?? -1;
}

/** The pairs, each with its buttons. @param {{store: Store, link: Link}} props */
function Contacts({ store, link }) {
  const all = contactsOf(store);
  const shown = contactAt(store);
  const allow = (/** @type {Contact} */ { first, second }) => link.edit([{ do: "allow", bodies: [first, second] }]);
  return html`<p class="tool-title"><b class="alarm-title">Collision</b> <span class="quiet">${all.length} ${all.length === 1 ? "pair" : "pairs"} of bodies</span></p>
    <ul>${all.slice(0, MOST).map((contact) => {
      const { words, t, sentence } = contact;
      const obstacle = movableIn(store, contact);
      return html`<li key=${nameOf(contact)} data-pair=${nameOf(contact)}><span title=${sentence}><b>${words}</b> <span class="quiet">${clockOf(t)}</span></span>
        <button type="button" class="go" aria-pressed=${String(shown === contact)} title="Show the posture in which they touch" onClick=${() => goTo(store, contact)}>Go there</button>
        ${shown === contact && html`<span class="acts">${canAllow(store, contact) && html`<button type="button" title=${`Let ${words} touch; other pairs stay forbidden`} onClick=${() => allow(contact)}>Allow this pair</button>`}
          ${obstacle >= 0 && html`<button type="button" onClick=${() => store.setView({ tool: "obstacles", obstacle, pen: "" })}>Move obstacle</button>`}</span>`}</li>`;
    })}</ul>
    ${all.length > MOST && html`<p class="quiet">and ${all.length - MOST} more pairs, in the sentence</p>`}
    <details><summary>Where and how near</summary>${store.refusal?.head.sentence}</details>
    <div class="acts"><button type="button" title="Move, raise and turn the part (G)" onClick=${() => chooseTool(store, "move")}>Move part</button></div>`;
}

/** Show the posture of a contact. @param {Store} store @param {Contact} contact */
export function goTo(store, contact) {
  chosen = nameOf(contact);
  if (store.options.stage === "2d") store.setView({ stage: innerWidth >= 1000 ? "both" : "3d" });
  store.goTo(contact.t);
}

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  const box = make("div", { class: "contacts", role: "group", "aria-label": "Collision", hidden: true });
  toolBox().prepend(box);
  const update = () => {
    box.hidden = contactsOf(store).length === 0;
    if (!box.hidden) render(html`<${Contacts} store=${store} link=${link} />`, box);
  };
  const soon = oncePerFrame(update);
  store.on("refusal", (/** @type {any} */ frame) => {
    const contact = frame && contactsOf(store)[0];
    // The bodies are shown where they touch, unless the motion is playing.
    if (contact && find("#playback").dataset.state !== "playing") store.setTime(contact.t);
    soon();
  });
  for (const event of ["document", "time"]) store.on(event, soon);
}
