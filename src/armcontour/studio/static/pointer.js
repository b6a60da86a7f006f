// Values at the pointer: a handle that is dragged, or moved with arrow keys, snaps to round values, which are shown next to it
// with the time that they save. Digits set values exactly.

import { find, make, say } from "./dom.js";
import { rowOf, seconds, short } from "./format.js";
import { dragged, Gesture } from "./gesture.js";
import { coordinateUnit } from "./length_unit.js";
import { notify } from "./messages.js";
import { oncePerFrame } from "./state.js";
import { inches } from "./units.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {[number, number]} Point */
/** A unit of the document, and its size in SI units. @typedef {[string, number]} Unit */
/**
 * Values that a gesture changes, in SI units.
 * @typedef {Object} Movable
 * @property {(event: PointerEvent | KeyboardEvent) => {names: string[], unit: Unit, values: number[] | null}} start   null if it cannot be moved now
 * @property {(by: Point, start: number[], event: PointerEvent | KeyboardEvent) => number[]} moved   by a displacement in the plane [m]
 * @property {(values: number[]) => object[]} edits
 * @property {"picture"} [answer]   the frame with the change, by default the document
 * @property {(edits: object[], cancelled: boolean) => unknown} [end]   empty edits: nothing was changed
 * @property {number} [step]    values are multiples of it; with Alt of step / 100, with Shift of 10 steps
 * @property {number} [least]   smallest value; values below a step have one digit, and an arrow key changes them by half a digit's size
 * @property {(values: number[]) => string} [lacks]   why the values have no effect yet; keys end such a gesture only by Enter or Escape
 */

const STEP = 1e-3; // m
const STEP_IN_INCHES = 0.05 * 0.0254; // m
const SAME = 1e-9; // m
// Arrow keys that follow each other within this time are one gesture.
const KEYS_WITHIN = 600; // ms
const TYPED = /^[-\d.,;x ]$/;
/** @type {Record<string, Point>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };

export class Pointer {
  /** @param {Store} store @param {Link} link @param {View2d} view */
  constructor(store, link, view) {
    this.store = store;
    this.link = link;
    this.view = view;
    this.label = make("div", { class: "tip at-pointer", hidden: true, "aria-hidden": "true" });
    view.region.append(this.label);
    /**
     * The active gesture. @type {{what: Movable, names: string[], unit: Unit, start: number[], values: number[], typed: string,
     *   gesture: Gesture, before: import("./state.js").Frame | null} | null}
     */
    this.going = null;
    /** Position of the label. @type {Point} px */
    this.near = [0, 0];
    /** Changes without an answer. @type {Map<Movable, {values: number[], seq: number}>} */
    this.changed = new Map();
    this.follow = oncePerFrame(() => view.place());
    for (const event of ["document", "picture", "refusal"]) store.on(event, (/** @type {any} */ frame) => this.answered(event, frame));
    store.on("command", () => this.end());
    // Discarded changes are not shown.
    store.on("link", (/** @type {any} */ link) => link.state !== "open" && this.changed.size && (this.changed.clear(), this.follow()));
  }

  /** The server has a change, so show its frames again. @param {string} event @param {import("./state.js").Frame | null} frame */
  answered(event, frame) {
    for (const [what, { seq }] of this.changed)
      if ((event === "refusal" ? frame : event === (what.answer ?? "document")) && (frame?.seq ?? Infinity) >= seq) this.changed.delete(what);
    this.tell();
  }

  /** Return changed values until the server has answered. @param {Movable} what @returns {number[] | null} */
  held(what) {
    return this.changed.get(what)?.values ?? null;
  }

  get centre() {
    return this.store.latest("picture")?.head.centre ?? [0, 0];
  }

  /** @param {Point} uv m in the plane @returns {Point} px */
  screen(uv) {
    return this.view.view.toScreen([uv[0] - this.centre[0], uv[1] - this.centre[1]]);
  }

  /** @param {MouseEvent} event @returns {Point} m in the plane */
  plane(event) {
    const [u, v] = this.view.view.toPlane(this.view.within(event));
    return [u + this.centre[0], v + this.centre[1]];
  }

  /** Convert a point in the plane to coordinates of the file. @param {Point} uv m @returns {Point} m */
  local([u, v]) {
    const { origin } = this.store.document.path.axes;
    return this.turned([u - origin[0], v - origin[1]]);
  }

  /** Convert a displacement in the plane to coordinates of the file. @param {Point} by m @returns {Point} m */
  turned([u, v]) {
    const { x, y } = this.store.document.path.axes;
    return [u * x[0] + v * x[1], u * y[0] + v * y[1]];
  }

  /** Convert coordinates of the file to a point in the plane. @param {number[]} xy m @returns {Point} m */
  global([a, b]) {
    const { origin, x, y } = this.store.document.path.axes;
    return [origin[0] + a * x[0] + b * y[0], origin[1] + a * x[1] + b * y[1]];
  }

  /** Let an element change values by drag, arrow keys and digits. @param {SVGElement} element @param {Movable} what @param {(event: PointerEvent) => boolean} [isOther] whether the pointer is for something else */
  movable(element, what, isOther = () => false) {
    /** @type {Point} */
    let from = [0, 0];
    let timer = 0;
    const isHeld = () => this.going?.what === what;
    const end = (cancelled = false) => {
      clearTimeout(timer);
      if (isHeld()) this.end(cancelled);
    };
    dragged(element, {
      start: (event) => {
        if (isOther(event)) return false;
        from = this.plane(event);
        return this.begin(what, this.view.within(event), event);
      },
      move: (event) => {
        const to = this.plane(event);
        this.move([to[0] - from[0], to[1] - from[1]], event, this.view.within(event));
      },
      end,
      key: (event) => this.type(event),
    });
    element.addEventListener("keydown", (event) => {
      const arrow = ARROWS[event.key];
      const ends = isHeld() && (event.key === "Enter" || event.key === "Escape");
      const { left, top, width } = element.getBoundingClientRect();
      const place = this.view.within(new MouseEvent("", { clientX: left + width / 2, clientY: top }));
      if (event.ctrlKey || event.metaKey || element.classList.contains("dragging")) return;
      const isOurs = arrow || event.key === "Enter" || TYPED.test(event.key);
      if (isOurs && !isHeld()) this.end();
      if (isOurs && !isHeld() && this.link.change) {
        event.preventDefault();
        event.stopPropagation();
        return this.link.whenKnown(() => element.isConnected && element.dispatchEvent(new KeyboardEvent("keydown", event)));
      }
      if (!isHeld() && (arrow || /^[\d.]$/.test(event.key))) {
        if (!this.begin(what, place, event)) return;
        from = [0, 0];
      }
      if (!isHeld()) return;
      if (arrow) {
        const step = keyStep(event, this.going?.values[0] ?? 0, what.least);
        from = [from[0] + step * arrow[0], from[1] + step * arrow[1]];
        this.move(from, event, place);
      } else if (ends && event.key === "Enter" && this.lacking) notify(this.lacking);
      else if (ends) end(event.key === "Escape");
      else if (!this.type(event)) return;
      event.preventDefault();
      event.stopPropagation();
      clearTimeout(timer);
      if (arrow && !what.lacks) timer = setTimeout(end, KEYS_WITHIN);
    });
    element.addEventListener("blur", () => element.classList.contains("dragging") || end());
  }

  /** @param {Movable} what @param {Point} place px @param {PointerEvent | KeyboardEvent} event @returns {boolean} */
  begin(what, place, event) {
    this.end();
    const { values, ...rest } = what.start(event);
    if (!values) return false;
    this.going = { what, ...rest, unit: coordinateUnit(rest.unit), start: values, values, typed: "", gesture: new Gesture(this.link), before: this.store.latest("picture") };
    this.near = place;
    return true;
  }

  /** @param {Point} by m @param {PointerEvent | KeyboardEvent} event @param {Point} place px */
  move(by, event, place) {
    if (!this.going || this.going.typed) return;
    const { what, start, values: last } = this.going;
    this.near = place;
    this.view.putBeside(this.label, place);
    const moved = what.moved(by, start, event);
    const round = this.rounded(moved, event, what);
    // Values that do not change are not rounded.
    const values = moved.map((x, k) => (Math.abs(x - start[k]) < SAME ? start[k] : round[k]));
    // Many pointer motions stay within one step, so the values do not change.
    if (!this.changed.has(what) || values.some((x, k) => x !== last[k])) this.set(values, event.timeStamp);
  }

  /** @param {number[]} values @param {PointerEvent | KeyboardEvent} event @param {{step?: number, least?: number}} [how] @returns {number[]} */
  rounded(values, event, { step = inches.value ? STEP_IN_INCHES : STEP, least } = {}) {
    const byKeys = least && event instanceof KeyboardEvent;
    return values.map((x) => snapped(x, byKeys ? keyStep(event, x, least) : step * timesOf(event), least));
  }

  /** @param {number[]} values @param {number} at ms */
  set(values, at) {
    if (!this.going) return;
    this.going.values = values;
    this.changed.set(this.going.what, { values, seq: Infinity });
    this.follow();
    if (!this.lacking) this.going.gesture.update(this.going.what.edits(values), at);
    this.tell();
  }

  /** Handle keys that type a number. @param {KeyboardEvent} event @returns {boolean} true if it was */
  type(event) {
    const { going } = this;
    const isKey = TYPED.test(event.key) && (going?.typed || /[-\d.]/.test(event.key));
    if (!going || !(isKey || (event.key === "Backspace" && going.typed))) return false;
    event.preventDefault();
    event.stopPropagation();
    going.typed = isKey ? going.typed + event.key : going.typed.slice(0, -1);
    const numbers = going.typed.split(/[,;x ]+/).map((x) => (x && x !== "-" ? exact(Number(x) * going.unit[1]) : NaN));
    this.set(going.start.map((_, k) => (Number.isFinite(numbers[k]) ? numbers[k] : going.values[k])), event.timeStamp);
    say(find("#spoken"), `${going.typed} ${going.unit[0]}`);
    return true;
  }

  /** Return why changed values have no effect. */
  get lacking() {
    const { what, values } = this.going ?? {};
    return what && this.changed.has(what) ? (what.lacks?.(values ?? []) ?? "") : "";
  }

  end(cancelled = false) {
    if (!this.going) return;
    const { what, gesture } = this.going;
    const lacking = cancelled ? "" : this.lacking;
    if (lacking) notify(lacking);
    this.going = null;
    if (cancelled || lacking) gesture.cancel();
    else gesture.end();
    this.label.hidden = true;
    const changed = this.changed.get(what);
    if (changed && gesture.edits.length) changed.seq = this.link.seq;
    else this.changed.delete(what);
    what.end?.(gesture.edits, cancelled);
    this.follow();
  }

  /** Text of the label: values and their effect. */
  tell() {
    if (!this.going) return;
    const { names, unit, values, typed, before } = this.going;
    const texts = values.map((x, k) => `${names[k]} ${short(x / unit[1], 6)}`);
    const now = this.store.latest("picture");
    const [old, fresh] = [before, now].map((x) => rowOf(x?.head, "duration")?.value);
    const gained = fresh - old;
    const parts = [make("span", { class: "value", text: `${typed ? `${typed}▏` : texts.join(", ")} ${unit[0] || "m"}` })];
    if (this.store.refusal) parts.push(make("span", { class: "worse", text: "refused" }));
    else if (now !== before && Number.isFinite(gained))
      parts.push(make("span", { class: gained > 0 ? "worse" : "better", text: `${gained > 0 ? "+" : ""}${seconds(gained)} s` }), make("span", { class: "quiet", text: "preview" }));
    this.label.replaceChildren(...parts);
    this.label.hidden = false;
    this.view.putBeside(this.label, this.near);
  }
}

/** Remove rounding errors, and the sign of zero. @param {number} x */
const exact = (x) => Number(x.toPrecision(15)) + 0;

/** @param {MouseEvent | KeyboardEvent} event */
const timesOf = (event) => (event.shiftKey ? 10 : event.altKey ? 0.01 : 1);

/** Return the size of a value's first digit; infinite without `least`. @param {number} value @param {number} [least] */
const digitOf = (value, least) => (least ? 10 ** Math.floor(Math.log10(Math.max(value, least)) + SAME) : Infinity);

/** Return how far an arrow key moves a value. @param {KeyboardEvent} event @param {number} value @param {number} [least] */
const keyStep = (event, value, least) => timesOf(event) * Math.min(STEP, digitOf(value, least) / 2);

/** @param {number} value @param {number} step @param {number} [least] @returns {number} */
function snapped(value, step, least) {
  const fine = Math.min(step, digitOf(value, least));
  return Math.max(least ?? -Infinity, exact(fine * Math.round(value / fine)));
}
