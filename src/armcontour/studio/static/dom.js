// Helpers for elements. Text is always set as text, so that file contents never become markup.

import { oncePerFrame } from "./state.js";

/** How long a file for the browser stays in memory [ms]. */
const KEPT_FOR = 10_000;

/**
 * Find an element that must exist.
 * @template {Element} [T=HTMLElement]
 * @param {string} selector @param {ParentNode} [within] @returns {T}
 */
export function find(selector, within = document) {
  const found = within.querySelector(selector);
  if (!found) throw new Error(`The page has no ${selector}.`);
  return /** @type {T} */ (/** @type {unknown} */ (found));
}

/**
 * Create an element.
 * @template {keyof HTMLElementTagNameMap} K
 * @param {K} tag @param {Record<string, any>} [attributes] "text" is its text, "on..." are listeners, false is omitted
 * @param {(Node | string)[]} [children] @returns {HTMLElementTagNameMap[K]}
 */
export function make(tag, attributes = {}, children = []) {
  const element = document.createElement(tag);
  for (const [name, value] of Object.entries(attributes)) put(element, name, value);
  element.append(...children);
  return element;
}

/**
 * Create an element of a drawing.
 * @template {keyof SVGElementTagNameMap} K
 * @param {K} tag @param {Record<string, any>} [attributes] @returns {SVGElementTagNameMap[K]}
 */
export function draw(tag, attributes = {}) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) put(element, name, value);
  return element;
}

/**
 * Create a draggable element of a drawing, with its parts and a round grip.
 * @param {Record<string, any>} attributes of a slider @param {Element[]} parts @param {number} [radius] px @returns {SVGGElement}
 */
export function grip(attributes, parts, radius = 12) {
  const element = draw("g", { role: "slider", tabindex: 0, "aria-valuenow": 0, ...attributes });
  element.append(draw("circle", { r: radius, class: "target" }), ...parts);
  return element;
}

/** @param {Element} element @param {string} name @param {any} value */
function put(element, name, value) {
  if (value === false || value === null || value === undefined) return;
  if (name === "text") element.textContent = String(value);
  else if (name.startsWith("on")) element.addEventListener(name.slice(2), value);
  else element.setAttribute(name, value === true ? "" : String(value));
}

/**
 * Set an attribute only if it differs, because setting it makes the browser compute layout and paint again.
 * @param {Element} element @param {string} name @param {string} value
 */
export function mark(element, name, value) {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

/** Set text only if it differs, to save work for the browser and for screen readers. @param {Element} element @param {string} text */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Let the browser save a file. @param {Blob} content @param {string} name */
export function give(content, name) {
  const address = URL.createObjectURL(content);
  make("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), KEPT_FOR);
}

/**
 * Run a function after events, but only while its panel is visible; otherwise when it is visible again.
 * @param {import("./state.js").Store} store @param {HTMLElement} panel @param {string[]} events @param {() => void} update
 * @returns {() => void} asks for a run, as an event does
 */
export function whileSeen(store, panel, events, update) {
  let due = false;
  const run = () => {
    due = Boolean(panel.hidden) || !store.options.dock;
    if (!due) update();
  };
  const wish = oncePerFrame(run);
  for (const event of events) store.on(event, wish);
  store.on("view", () => due && wish());
  return wish;
}

/** Call a function at each action of the user: a press of a pointer or a key, or a turn of the wheel. @param {() => void} act */
export function onAction(act) {
  for (const name of ["pointerdown", "keydown", "wheel"]) window.addEventListener(name, act, { capture: true, passive: true });
}
