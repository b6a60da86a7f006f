// Cycle time and contour error over the range of a slider, from a sweep in the background.

import { find, make } from "./dom.js";
import { mm, quantity, seconds } from "./format.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./state.js").Numbers} Numbers */
/**
 * A quantity with a usual range, as `fields.py` gives it, with its key and label.
 * @typedef {{key: string, label: string, value: number | string | null, written: string | null, unit: string,
 *   factor: number, min: number, max: number, log: boolean, from: string}} Slider
 */
/** @typedef {{values: Numbers, duration: Numbers, rms: Numbers}} Sweep */

const AFTER = 450; // ms
const COUNT = 15;
const [WIDE, HIGH] = [100, 30];
/** Positions of a slider are whole numbers from 0 to this. */
export const STEPS = 1000;

/** @param {Slider} slider @param {number} value SI @returns {number} */
export function positionOf({ min, max, log }, value) {
  const share = log ? Math.log(value / min) / Math.log(max / min) : (value - min) / (max - min);
  return Math.round(STEPS * Math.min(1, Math.max(0, share)));
}

/** Value at a position, with three digits in the slider's unit. @param {Slider} slider @param {number} position @returns {number} SI */
export function valueAt({ min, max, log, factor }, position) {
  const share = position / STEPS;
  const value = log ? min * (max / min) ** share : min + share * (max - min);
  return Number((Number((value / factor).toPrecision(3)) * factor).toPrecision(12));
}

export class Ghost {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    this.timer = 0;
    this.tasks = 0;
    this.isHeld = false;
    /** @type {{slider: Slider, element: HTMLElement, id: string} | null} */
    this.wished = null;
    /** Sweeps of this text and run, by key. @type {Map<string, Sweep>} */
    this.known = new Map();
    this.text = "";
    this.box = make("div", { class: "ghost", "aria-hidden": "true" });
    store.on("document", () => this.forget());
    store.on("result", (/** @type {import("./state.js").Frame} */ frame) => this.answered(frame));
  }

  /** Another text or run has other sweeps. */
  forget() {
    const { text, run } = this.store.document;
    if (this.text === run + text) return;
    this.text = run + text;
    this.known.clear();
    this.box.remove();
  }

  /** The pointer rests on a slider. @param {Slider} slider @param {HTMLElement} element */
  wish(slider, element) {
    this.leave();
    if (this.isHeld) return;
    const known = this.known.get(slider.key);
    if (known) return this.show(slider, element, known);
    this.timer = setTimeout(() => {
      const id = `ghost-${++this.tasks}`;
      this.wished = { slider, element, id };
      const { key, min, max, log } = slider;
      this.link.send({ op: "task", id, task: "sweep", options: { key, min, max, log, count: COUNT } });
    }, AFTER);
  }

  /** While a slider is held no sweep begins: it would take a processor from what the user is waiting for. @param {boolean} isHeld */
  hold(isHeld) {
    this.isHeld = isHeld;
    if (isHeld) clearTimeout(this.timer);
  }

  leave() {
    clearTimeout(this.timer);
    if (this.wished) this.link.send({ op: "cancel", id: this.wished.id });
    this.wished = null;
    this.box.remove();
  }

  /** @param {import("./state.js").Frame} frame */
  answered(frame) {
    if (!this.wished || frame.head.id !== this.wished.id) return;
    const { slider, element } = this.wished;
    this.wished = null;
    const { values, duration, rms } = frame.arrays;
    this.known.set(slider.key, { values, duration, rms });
    this.show(slider, element, { values, duration, rms });
  }

  /** @param {Slider} slider @param {HTMLElement} element @param {Sweep} sweep */
  show(slider, element, { values, duration, rms }) {
    const range = (/** @type {Numbers} */ x, /** @type {(value: number) => string} */ text) => {
      const known = [...x].filter(Number.isFinite);
      return known.length ? `${text(Math.min(...known))} … ${text(Math.max(...known))}` : "refused";
    };
    render(
      html`<svg viewBox=${`0 0 ${WIDE} ${HIGH}`} preserveAspectRatio="none"><path class="time" d=${curve(slider, values, duration)} /><path class="error" d=${curve(slider, values, rms)} /></svg>
        <span class="ends">${[values[0], values[values.length - 1]].map((value) => html`<span>${quantity(value, slider)}</span>`)}</span>
        <span class="time">cycle time ${range(duration, seconds)} s</span><span class="error">error RMS ${range(rms, (x) => mm(x))} mm</span>`,
      this.box,
    );
    find("main").append(this.box);
    // Next to its slider: nothing moves under the pointer.
    const { top, left } = element.getBoundingClientRect();
    this.box.style.top = `${Math.round(Math.min(top, window.innerHeight - this.box.offsetHeight - 8))}px`;
    this.box.style.left = `${Math.round(Math.max(8, left - this.box.offsetWidth - 16))}px`;
  }
}

/**
 * A curve over the range of a slider; refused values leave gaps.
 * @param {Slider} slider @param {Numbers} values @param {Numbers} y @returns {string} for `d` of a path
 */
function curve(slider, values, y) {
  const known = [...y].filter(Number.isFinite);
  const [least, most] = [Math.min(...known), Math.max(...known)];
  let line = "";
  y.forEach((value, k) => {
    if (!Number.isFinite(value)) return;
    const at = [
      (WIDE * positionOf(slider, values[k])) / STEPS,
      HIGH - 3 - ((value - least) / (most - least || 1)) * (HIGH - 6),
    ];
    line += `${k > 0 && Number.isFinite(y[k - 1]) ? "L" : "M"}${at.map((x) => x.toFixed(1)).join(" ")}`;
  });
  return line;
}
