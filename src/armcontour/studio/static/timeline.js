// The timeline: the tool speed over time, in which the user goes to a time, and zooms.
//
// A click goes to a time; the knob of the line can be dragged. A dragged range is zoomed, a double click shows the whole motion. The wheel
// zooms, with Shift it moves. On touch, a drag moves the time.

import { make, mark, onAction, say } from "./dom.js";
import { contourLabel, mm, seconds } from "./format.js";
import { speedAt } from "./motion_places.js";
import { kindAt } from "./polylines.js";
import { drawCurve } from "./speed_curve.js";
import { indexAt, nowAndThen, oncePerFrame, READING } from "./state.js";
import { TimeScale } from "./time_scale.js";
import { inches, shownText } from "./units.js";
import { CLICKED } from "./view2d.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {{from: number, to: number, isScrub: boolean, isRange: boolean}} Drag places [px] */

/** The line is grabbed within this distance [px]. */
export const KNOB = 9;
/** Wheel movement that makes the shown part longer by a factor of e, and that moves it by its length [px]. */
const [ZOOM, SHIFT] = [400, 800];
/** Factor of the keys + and -. */
const KEY_ZOOM = 1.5;
/** Step of the arrow keys [share of the shown part]; with Shift ten times as long. */
const STEP = 0.005;
const WAYS = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 });
/** Distance of the tip from the pointer, and its margin to the right end [px]. */
const [ASIDE, MARGIN] = [12, 4];

export class Timeline {
  /** @param {Store} store @param {(t: number) => void} scrub called with the time to which the user goes [s] */
  constructor(store, scrub) {
    this.store = store;
    this.scrub = scrub;
    this.scale = new TimeScale();
    /** @type {Drag | null} */
    this.drag = null;
    /** Time that the tip is about, until another time is shown; -1 without one [s]. */
    this.tipTime = -1;
    this.canvas = make("canvas", { role: "img", "aria-label": "Tool speed over time, and the limits that determine it" });
    this.line = make("div", { class: "now" });
    this.range = make("div", { class: "range", hidden: true });
    this.slider = make("div", { class: "scrub", role: "slider", tabindex: 0, "aria-label": "Time", "aria-valuemin": 0, "aria-valuenow": 0, "aria-valuemax": 0 }, [this.range, this.line]);
    this.tip = make("div", { class: "tip", role: "tooltip", hidden: true });
    this.whole = make("button", { type: "button", class: "whole", hidden: true, text: "Whole motion", title: "Show the whole motion (double click)", onclick: () => this.showAll() });
    this.element = make("div", { class: "track" }, [this.canvas, this.slider, this.tip, this.whole]);
    this.draw = oncePerFrame(() => this.drawNow());
    /** Tell the time to screen readers. */
    this.tell = nowAndThen(READING, () => this.tellNow());
    this.listen();
  }

  listen() {
    const { slider } = this;
    slider.addEventListener("pointerdown", (event) => this.grab(event));
    slider.addEventListener("pointermove", (event) => this.move(event));
    slider.addEventListener("pointerup", (event) => this.release(event));
    slider.addEventListener("lostpointercapture", () => this.forget());
    slider.addEventListener("pointerleave", () => this.hideTip());
    slider.addEventListener("dblclick", () => this.showAll());
    slider.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    slider.addEventListener("keydown", (event) => this.press(event));
    onAction(() => this.hideTip());
    new ResizeObserver(() => this.draw()).observe(this.element);
    inches.subscribe(() => this.draw());
    let rev = -1;
    this.store.on("document", (/** @type {import("./state.js").Frame} */ frame) => {
      // The tip is about the motion before the edit.
      if (frame.rev !== rev) this.hideTip();
      rev = frame.rev;
    });
  }

  /** Show the motion as it is now. @param {number} duration s; 0: there is none */
  fit(duration) {
    this.scale.fit(duration);
    mark(this.slider, "aria-disabled", String(!duration));
    mark(this.slider, "aria-valuemax", String(duration));
    this.draw();
  }

  drawNow() {
    const { scale, store, element } = this;
    scale.width = Math.max(1, this.canvas.clientWidth);
    drawCurve(this.canvas, scale, store);
    this.whole.hidden = scale.isWhole;
    Object.assign(element.dataset, { begin: String(scale.begin), end: String(scale.end) });
    this.placeLine();
  }

  /** Show the time of the store. */
  point() {
    // While the user drags, the shown part stays.
    if (!this.drag && this.scale.follow(this.store.time)) this.draw();
    this.placeLine();
    this.tell();
    if (this.tipTime >= 0 && this.tipTime !== this.store.time) this.hideTip();
  }

  /** Tell of the shown time: speed, contour and limit. */
  tellPlace() {
    this.showTip(this.scale.xOf(this.store.time));
    this.tipTime = this.store.time;
  }

  hideTip() {
    this.tip.hidden = true;
    this.tipTime = -1;
  }

  placeLine() {
    const x = this.scale.xOf(this.store.time);
    this.line.hidden = x < 0 || x > this.scale.width;
    this.line.style.transform = `translateX(${x.toFixed(1)}px)`;
  }

  tellNow() {
    mark(this.slider, "aria-valuenow", String(this.store.time));
    mark(this.slider, "aria-valuetext", `${seconds(this.store.time)} s of ${seconds(this.scale.duration)} s`);
  }

  showAll() {
    this.scale.showAll();
    this.draw();
  }

  /** @param {PointerEvent} event */
  grab(event) {
    if (event.button > 0 || !this.scale.duration || this.drag) return;
    this.slider.setPointerCapture(event.pointerId);
    const x = this.within(event);
    const isNear = Math.abs(x - this.scale.xOf(this.store.time)) <= KNOB;
    this.drag = { from: x, to: x, isScrub: isNear || event.pointerType === "touch", isRange: false };
    mark(this.slider, "data-drag", this.drag.isScrub ? "time" : "range");
  }

  /** @param {PointerEvent} event */
  move(event) {
    const { drag, scale } = this;
    if (!scale.duration) return;
    const x = this.within(event);
    mark(this.slider, "data-near", String(Math.abs(x - scale.xOf(this.store.time)) <= KNOB));
    if (drag) {
      drag.to = x;
      if (drag.isScrub) this.scrub(scale.timeAt(x));
      else drag.isRange ||= Math.abs(x - drag.from) > CLICKED;
      this.showRange(drag);
    }
    if (event.pointerType !== "touch") this.showTip(x);
  }

  /** @param {Drag} drag */
  showRange({ from, to, isRange }) {
    this.range.hidden = !isRange;
    this.range.style.transform = `translateX(${Math.min(from, to)}px)`;
    this.range.style.width = `${Math.abs(to - from)}px`;
  }

  /** @param {PointerEvent} event */
  release(event) {
    const { drag, scale } = this;
    if (!drag) return;
    this.forget();
    const x = this.within(event);
    if (!drag.isRange) return this.scrub(scale.timeAt(x));
    const [begin, end] = [drag.from, x].map((at) => scale.timeAt(at)).sort((a, b) => a - b);
    scale.show(begin, end);
    this.draw();
    // What is played next is what is shown.
    if (this.store.time < begin || this.store.time > end) this.scrub(begin);
  }

  forget() {
    this.drag = null;
    this.range.hidden = true;
    // The tip tells of the drag.
    this.hideTip();
    this.slider.removeAttribute("data-drag");
  }

  /** Return where an event is [px]. @param {MouseEvent} event */
  within(event) {
    return event.clientX - this.slider.getBoundingClientRect().left;
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    const { scale } = this;
    if (!scale.duration) return;
    event.preventDefault();
    const lines = event.deltaMode === 1 ? 16 : 1;
    const [x, y] = [event.deltaX * lines, event.deltaY * lines];
    // With Shift, some browsers report the wheel as a horizontal one.
    if (event.shiftKey || Math.abs(x) > Math.abs(y)) scale.shift(((x || y) / SHIFT) * scale.span);
    else scale.zoom(Math.exp(y / ZOOM), scale.timeAt(this.within(event)));
    this.draw();
  }

  /** Handle keys on the time: arrows move it, + and - zoom about it. @param {KeyboardEvent} event */
  press(event) {
    const { scale, store } = this;
    if (!scale.duration || event.ctrlKey || event.metaKey || event.altKey) return;
    const way = WAYS[event.key];
    const isIn = event.key === "+" || event.key === "=";
    if (way) this.scrub(store.time + way * STEP * scale.span * (event.shiftKey ? 10 : 1));
    else if (isIn || event.key === "-") {
      scale.zoom(isIn ? 1 / KEY_ZOOM : KEY_ZOOM, store.time);
      this.draw();
    } else return;
    event.preventDefault();
  }

  /** Say what is at a place. @param {number} x px */
  showTip(x) {
    const { tip, scale, drag } = this;
    const picture = this.store.latest("picture");
    if (!picture?.arrays.path_t.length) return;
    tip.hidden = false;
    say(tip, drag?.isRange ? `${seconds(Math.abs(scale.timeAt(drag.to) - scale.timeAt(drag.from)))} s: release to zoom` : shownText(sentenceAt(picture, scale.timeAt(x))));
    const right = x + ASIDE + tip.offsetWidth < scale.width - MARGIN;
    tip.style.transform = `translateX(${Math.max(0, right ? x + ASIDE : x - ASIDE - tip.offsetWidth)}px)`;
  }
}

/** Time, speed, contour and active limit. @param {import("./state.js").Frame} picture @param {number} t s @returns {string} */
function sentenceAt(picture, t) {
  const { speed, contour } = speedAt(picture, t);
  const now = `${seconds(t)} s: `;
  if (Number.isNaN(speed)) return `${now}the tool waits`;
  if (contour < 0) return `${now}${mm(speed, 0)} mm/s, rapid`;
  const kind = kindAt(picture, indexAt(picture.arrays.path_t, t));
  return `${now}${mm(speed, 1)} mm/s, contour ${contourLabel(picture.head.contours[contour])}, ${kind}`;
}
