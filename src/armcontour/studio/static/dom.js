// Helpers for elements. Text is set as text, so that no content of a file becomes markup.

import { oncePerFrame } from "./state.js";

/** A file that was given to the browser is kept so long [ms]. */
const KEPT_FOR = 10_000;

/**
 * An element that must be there.
 * @template {Element} [T=HTMLElement]
 * @param {string} selector @param {ParentNode} [within] @returns {T}
 */
export function find(selector, within = document) {
  const found = within.querySelector(selector);
  if (!found) throw new Error(`The page has no ${selector}.`);
  return /** @type {T} */ (/** @type {unknown} */ (found));
}

/**
 * A new element.
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
 * A new element of a drawing.
 * @template {keyof SVGElementTagNameMap} K
 * @param {K} tag @param {Record<string, any>} [attributes] @returns {SVGElementTagNameMap[K]}
 */
export function draw(tag, attributes = {}) {
  const element = document.createElementNS("http://www.w3.org/2000/svg", tag);
  for (const [name, value] of Object.entries(attributes)) put(element, name, value);
  return element;
}

/**
 * Something to drag in a drawing, with its parts and the round place where it is grabbed.
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
 * Set an attribute only where it differs: setting one makes the browser lay out and paint again.
 * @param {Element} element @param {string} name @param {string} value
 */
export function mark(element, name, value) {
  if (element.getAttribute(name) !== value) element.setAttribute(name, value);
}

/** Set text only where it differs: no work for the browser, none for screen readers. @param {Element} element @param {string} text */
export function say(element, text) {
  if (element.textContent !== text) element.textContent = text;
}

/** Give a file to the browser, to save it. @param {Blob} content @param {string} name */
export function give(content, name) {
  const address = URL.createObjectURL(content);
  make("a", { href: address, download: name }).click();
  setTimeout(() => URL.revokeObjectURL(address), KEPT_FOR);
}

/**
 * Run something when it is due, but only while its panel is seen; else when it is seen again.
 * @param {import("./state.js").Store} store @param {HTMLElement} panel @param {string[]} events @param {() => void} update
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
}
