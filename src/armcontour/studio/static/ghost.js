// What a slider would be worth: the cycle time over its range, from a sweep in the background.

import { draw, make } from "./dom.js";
import { quantity, seconds } from "./format.js";
import { positionOf, STEPS } from "./scales.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./scales.js").Slider} Slider */
/** @typedef {{value: number, duration: number | null}} Point */

const AFTER = 450; // ms
const [WIDE, HIGH] = [100, 26];

export class Ghost {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    this.timer = 0;
    this.tasks = 0;
    /** @type {{slider: Slider, element: HTMLElement, id: string} | null} */
    this.wished = null;
    /** Curves of this text, by key. @type {Map<string, Point[]>} */
    this.known = new Map();
    this.box = make("div", { class: "ghost", "aria-hidden": "true" });
    store.on("document", () => this.forget());
    store.on("result", (/** @type {any} */ frame) => this.answered(frame.head));
  }

  forget() {
    this.known.clear();
    this.box.remove();
  }

  /** The pointer rests on a slider. @param {Slider} slider @param {HTMLElement} element */
  wish(slider, element) {
    this.leave();
    if (slider.choices || typeof slider.value !== "number" || !(slider.min < slider.max)) return;
    const known = this.known.get(slider.key);
    if (known) return this.show(slider, element, known);
    this.timer = setTimeout(() => {
      const id = `ghost-${++this.tasks}`;
      this.wished = { slider, element, id };
      this.link.send({ op: "task", id, task: "sweep", options: { key: slider.key, low: slider.min, high: slider.max, log: slider.log, points: 15 } });
    }, AFTER);
  }

  leave() {
    clearTimeout(this.timer);
    if (this.wished) this.link.send({ op: "cancel", id: this.wished.id });
    this.wished = null;
    this.box.remove();
  }

  /** @param {any} result */
  answered(result) {
    if (!this.wished || result.id !== this.wished.id) return;
    const { slider, element } = this.wished;
    this.wished = null;
    const points = pointsOf(result);
    this.known.set(slider.key, points);
    this.show(slider, element, points);
  }

  /** @param {Slider} slider @param {HTMLElement} element @param {Point[]} points */
  show(slider, element, points) {
    const good = points.filter((p) => p.duration !== null);
    if (good.length < 2) return;
    const times = good.map((p) => Number(p.duration));
    const [least, most] = [Math.min(...times), Math.max(...times)];
    const line = good.map((p, i) => {
      const x = (WIDE * positionOf(slider, p.value)) / STEPS;
      const y = HIGH - 3 - ((times[i] - least) / (most - least || 1)) * (HIGH - 6);
      return `${x.toFixed(1)},${y.toFixed(1)}`;
    });
    const svg = draw("svg", { viewBox: `0 0 ${WIDE} ${HIGH}`, preserveAspectRatio: "none" });
    svg.append(draw("polyline", { points: line.join(" ") }));
    const [first, last] = [good[0], good[good.length - 1]].map((p) => `${seconds(p.duration)} s at ${quantity(p.value, slider)}`);
    this.box.replaceChildren(svg, make("span", { text: `${first} … ${last}` }));
    element.append(this.box);
  }
}

/** Points of a sweep. @param {any} result @returns {Point[]} */
function pointsOf(result) {
  return result.points ?? (result.values ?? []).map((/** @type {number} */ value, /** @type {number} */ i) => ({ value, duration: result.durations[i] }));
}
