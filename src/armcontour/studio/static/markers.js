// Small marks over the drawing: the tool at the shown time, the place of a refusal, and the sentence under the pointer.

import { draw, make, mark, onAction, say } from "./dom.js";
import { contourLabel, mm, seconds } from "./format.js";
import { headOf } from "./figures.js";
import { NEAREST } from "./legend.js";
import { comparedExecution, isWorking, worstTime } from "./motion.js";
import { along, indexAt } from "./state.js";
import { shownText } from "./units.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {import("./view2d.js").View2d} View2d */

// Largest distance from the pointer to a point whose values are shown.
const NEAR = 14; // px
// Distance at which a slow point shows its text.
const BESIDE = 0.002; // m
/** Cross at a refusal, and at the largest error. */
const CROSS = "M-9-9 9 9M-9 9 9-9";

class Marks {
  /** @param {Store} store @param {View2d} view */
  constructor(store, view) {
    this.store = store;
    this.view = view;
    this.dot = draw("circle", { class: "cursor", r: 5, hidden: true, "aria-hidden": "true" });
    this.tool = draw("circle", { class: "cursor tool", r: 4, hidden: true, "aria-hidden": "true" });
    /** The place under the pointer, of which the tip tells. */
    this.hovered = draw("circle", { class: "hovered", r: 5, hidden: true, "aria-hidden": "true" });
    const shape = (/** @type {string} */ name, d = CROSS) => draw("path", { class: name, d, hidden: true, "aria-hidden": "true" });
    this.refused = shape("refused");
    this.largest = shape("largest");
    this.nearest = shape("nearest", `M${NEAREST.join("L")}Z`);
    view.overlay.append(this.hovered, this.nearest, this.dot, this.tool, this.refused, this.largest);
    this.tip = make("div", { class: "tip", role: "tooltip", hidden: true });
    view.region.append(this.tip);
    store.on("time", () => this.place());
    store.on("place", () => this.reveal());
    view.followers.add(() => this.place());
    view.overlay.addEventListener("pointermove", (event) => this.hover(event));
    view.overlay.addEventListener("pointerleave", () => this.leave());
    onAction(() => this.leave());
  }

  /** Move all marks to their places on the screen. */
  place() {
    const picture = this.store.latest("picture");
    if (!picture) return;
    const centre = picture.head.centre;
    this.placeCursor(picture);
    this.placeRefusal(centre);
  }

  /** Pan the drawing if the place of the shown time is outside of the view. */
  reveal() {
    const picture = this.store.latest("picture");
    if (picture?.arrays.path_t.length) this.view.reveal(pointOf(picture, this.store.time, this.store.place));
  }

  /** @param {Frame} picture */
  placeCursor(picture) {
    const { time, place } = this.store;
    const isPlanned = picture.arrays.path_t.length > 0;
    this.dot.toggleAttribute("hidden", !isPlanned);
    if (isPlanned) move(this.dot, this.view.view.toScreen(pointOf(picture, time, place)));
    const near = isPlanned && headOf(this.store).nearest?.t;
    this.nearest.toggleAttribute("hidden", typeof near !== "number");
    if (typeof near === "number") move(this.nearest, this.view.view.toScreen(pointOf(picture, near, this.store.placeAt(near))));
    const executed = comparedExecution(this.store);
    const isShown = executed && isWorking(executed, time);
    this.tool.toggleAttribute("hidden", !isShown);
    const worst = this.store.options.colour === "error" ? worstTime(this.store) : undefined;
    this.largest.toggleAttribute("hidden", !executed || worst === undefined);
    if (executed && worst !== undefined) move(this.largest, this.view.view.toScreen(this.toolAt(executed, worst)));
    if (isShown) move(this.tool, this.view.view.toScreen(this.toolAt(executed, time)));
  }

  /** Return the executed tool position, with its error magnified as drawn. @param {Frame} executed @param {number} t @returns {[number, number]} m */
  toolAt(executed, t) {
    const factor = this.view.layers.magnification(this.view.view.scale);
    const [base, offset] = [executed.arrays.base, executed.arrays.offset].map((points) => along(executed.arrays.t, points, t, 2));
    return [base[0] + factor * offset[0], base[1] + factor * offset[1]];
  }

  /** @param {[number, number]} centre */
  placeRefusal(centre) {
    const refusal = this.store.refusal;
    const at = refusal?.head.at?.uv;
    this.refused.toggleAttribute("hidden", !at);
    if (at) move(this.refused, this.view.view.toScreen([at[0] - centre[0], at[1] - centre[1]]));
  }

  /** @param {PointerEvent} event */
  hover(event) {
    const picture = this.store.latest("picture");
    const measures = this.store.options.tool === "measure";
    if (!picture || measures || event.buttons || event.pointerType === "touch") return this.leave();
    const [x, y] = this.view.within(event);
    const { view, layers } = this.view;
    const i = layers.nearest(picture, view.toPlane([x, y]), NEAR / view.scale);
    if (i < 0) return this.leave();
    this.hovered.toggleAttribute("hidden", false);
    const { path } = picture.arrays;
    move(this.hovered, view.toScreen([path[2 * i], path[2 * i + 1]]));
    say(this.tip, shownText(sentenceAt(picture, i)));
    this.tip.hidden = false;
    this.view.putBeside(this.tip, [x, y]);
  }

  leave() {
    this.tip.hidden = true;
    this.hovered.toggleAttribute("hidden", true);
  }
}

/** List the places where the speed is lowest relative to the assigned velocity. @param {Frame | null} picture @returns {{s: number, uv: [number, number]}[]} */
const slowest = (picture) => (picture?.head.shortfalls ?? []).filter((/** @type {any} */ x) => x.kind === "slowest");

/** @param {SVGElement} element @param {[number, number]} place px */
function move(element, [x, y]) {
  mark(element, "transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
}

/** Return the tool position at a time, on a rapid or at an arc length of the path [m]. @param {Frame} picture @param {number} t @param {number} s @returns {[number, number]} */
function pointOf(picture, t, s) {
  const { rapid, rapid_t: times, rapid_breaks: breaks } = picture.arrays;
  const k = breaks ? indexAt(breaks, indexAt(times, t)) : 0;
  const [from, to] = breaks ? [breaks[k], breaks[k + 1]] : [0, 0];
  const inside = breaks && t > times[from] && t < times[to - 1];
  const { path_s: places, path } = picture.arrays;
  const [xs, points, x] = inside ? [times.subarray(from, to), rapid.subarray(2 * from, 2 * to), t] : [places, path, s];
  return /** @type {[number, number]} */ (along(xs, points, x, 2));
}

/**
 * Values at a point of the path: position, time, speed, active limit.
 * @param {Frame} picture @param {number} i @returns {string}
 */
function sentenceAt(picture, i) {
  const { path_s: s, path_t: t, speed, assigned, binding } = picture.arrays;
  const limit = picture.head.limits[binding[i]];
  const wished = Number.isFinite(assigned[i]) ? ` of ${mm(assigned[i], 1)} mm/s` : "";
  const why = limit && (limit.kind === "assigned velocity" ? "; the assigned speed is reached" : `; held back by: ${limit.name}`);
  const isSlow = slowest(picture).some((x) => Math.abs(x.s - s[i]) < BESIDE);
  const slow = isSlow ? ", the slowest around here" : "";
  const contour = contourLabel(picture.head.contours[indexAt(picture.arrays.path_breaks, i)]);
  return `${contour}, t = ${seconds(t[i])} s: ${mm(speed[i], 1)} mm/s${wished}${slow}${why ?? ""}.`;
}

/** @param {Store} store @param {import("./connection.js").Link} _link @param {import("./pointer.js").Pointer} pointer */
export function init(store, _link, { view }) {
  new Marks(store, view);
}
