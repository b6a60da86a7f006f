// Bodies that come too near to each other: their pairs in order of time, and what to do about each.

import { clockOf } from "./format.js";
import { chooseTool } from "./tool_strip.js";
import { html } from "./vendor/preact.js";

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

/** Return the pair that is too near from the shown time on; null at other times. @param {Store} store @returns {Contact | null} */
export const contactAt = (store) => contactsOf(store).find(({ t }) => Math.abs(t - store.time) < SAME) ?? null;

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
export function Contacts({ store, link }) {
  const all = contactsOf(store);
  const allow = (/** @type {Contact} */ { first, second }) => link.edit([{ do: "allow", bodies: [first, second] }]);
  return html`<ul class="contacts">${all.slice(0, MOST).map((contact) => {
    const { first, second, words, t } = contact;
    const obstacle = movableIn(store, contact);
    return html`<li key=${`${first} ${second}`} data-pair=${`${first},${second}`}><span><b>${words}</b> <span class="quiet">${clockOf(t)}</span></span>
      <span class="acts"><button type="button" class="go" aria-pressed=${String(contactAt(store) === contact)} title="Show this posture in the 3D view" onClick=${() => goTo(store, contact)}>Go there</button>
      ${obstacle >= 0 && html`<button type="button" onClick=${() => store.setView({ tool: "obstacles", obstacle, pen: "" })}>Move obstacle</button>`}
      ${canAllow(store, contact) && html`<button type="button" title=${`Let ${words} touch; other pairs stay forbidden`} onClick=${() => allow(contact)}>Allow</button>`}</span></li>`;
  })}</ul>
    ${all.length > MOST && html`<span class="quiet">and ${all.length - MOST} more pairs</span>`}
    <button type="button" title="Move, raise and turn the part (G)" onClick=${() => chooseTool(store, "move")}>Move part</button>`;
}

/** Show the posture of a contact. @param {Store} store @param {Contact} contact */
export function goTo(store, { t }) {
  if (store.options.stage === "2d") store.setView({ stage: innerWidth >= 1000 ? "both" : "3d" });
  store.setTime(t);
}

/** @param {Store} store */
export function init(store) {
  store.on("refusal", (/** @type {any} */ frame) => {
    const contact = frame && contactsOf(store)[0];
    // The bodies are shown where they touch, unless the motion is playing.
    if (contact && document.querySelector("#playback")?.getAttribute("data-state") !== "playing") store.setTime(contact.t);
  });
}
