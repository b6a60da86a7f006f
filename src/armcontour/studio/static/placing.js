// What is moved in space: the part, or the selected obstacle. Its fields are in one fixed place, and the gizmo of the 3D view drags it.

import { Entry } from "./components.js";
import { find, make } from "./dom.js";
import { Gesture } from "./gesture.js";
import { short } from "./format.js";
import { lengthUnit } from "./length_unit.js";
import { oncePerFrame } from "./state.js";
import { toolBox } from "./tool_strip.js";
import { inches } from "./units.js";
import { column, compose, dot, IDENTITY, inverse, minus, plus, turned } from "./vectors.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./vectors.js").Vector} Vector */
/** @typedef {import("./vectors.js").Pose} Pose */
/** A change: the edits, and the values then. @typedef {{edits: object[], values: number[]}} Change */
/**
 * What is placed. Its reference frame is that of the work or of the floor, times `reference`.
 * @typedef {Object} Target
 * @property {string} key
 * @property {string} title
 * @property {boolean} inWork      whether the reference frame moves with the work
 * @property {Pose} reference
 * @property {Vector} origin       where the gizmo is, in the reference frame [m]
 * @property {Vector} normal       axis of the ring, in the reference frame
 * @property {boolean} rises       whether it can be raised
 * @property {boolean} turns       whether it can be turned
 * @property {number[]} values     x, y, z [m] and the angle [rad]
 * @property {Size[]} sizes
 * @property {(k: number, value: number, typed: boolean) => Change} change   of one value
 * @property {string} [body]       name of the body that is dragged, with its pose in the reference frame
 * @property {Pose} [pose]
 */
/** A length of an obstacle. @typedef {{label: string, value: number, edits: (value: number) => object[]}} Size */

const DEGREE = Math.PI / 180;
/** Names of the values: three lengths, and the angle. */
export const NAMES = ["X", "Y", "Z", "↻"];
const SPOKEN = ["X", "Y", "Z", "Angle"];
/** Names of the lengths of an obstacle, by key. @type {Record<string, string[]>} */
const SIZES = { size: ["Size x", "Size y", "Size z"], radius: ["Radius"], length: ["Length"] };
/** Smallest length of an obstacle [m]. */
const LEAST = 1e-4;
const UNITS = /** @type {Record<string, number>} */ ({ mm: 1e-3, cm: 1e-2, m: 1, in: 0.0254, '"': 0.0254 });
const ANGLES = /** @type {Record<string, number>} */ ({ deg: DEGREE, "°": DEGREE, rad: 1 });

/** Remove rounding errors. @param {number} x */
export const exact = (x) => Number(x.toPrecision(15)) + 0;

/** Return the angle of a pose about the z axis: its yaw [rad]. @param {Pose} pose */
const yawOf = (pose) => Math.atan2(pose[1][0], pose[0][0]);

/**
 * Read a typed number with an optional unit; NaN if it is none.
 * @param {string} text @param {Record<string, number>} units by name, the first one is the usual one @param {number} [usual] factor without a unit
 */
export function readTyped(text, units, usual = Object.values(units)[0]) {
  const found = /^\s*([-+−]?(?:\d+[.,]?\d*|[.,]\d+))\s*([a-z"°]*)\s*$/i.exec(text);
  const factor = found?.[2] ? units[found[2].toLowerCase()] : usual;
  return found ? exact(Number(found[1].replace(",", ".").replace("−", "-")) * (factor ?? NaN)) : NaN;
}

/** Return the part as a target; null if the job has none yet. @param {Store} store @returns {Target | null} */
export function partOf({ document }) {
  const part = document?.part;
  if (!part) return null;
  const { at, centre, plane } = part;
  const position = column(at, 3);
  const isUpright = Math.abs(plane.normal[2]) === 1;
  const angle = isUpright ? yawOf(at) : 0;
  // A model without selected edges has no path, whose middle could be used.
  const isBlank = Boolean(document.sentence);
  const middle = isBlank ? position : plus(plus(plane.origin, plane.x, centre[0]), plane.y, centre[1]);
  const values = [...position, angle];
  /** @type {Target["change"]} */
  const change = (k, value, typed) => {
    if (k < 3) {
      const by = [0, 0, 0];
      by[k] = value - values[k];
      const edit = { do: "place", by: [dot(by, plane.x), dot(by, plane.y)], rise: dot(by, plane.normal) };
      return { edits: [edit], values: values.map((x, j) => (j === k ? value : x)) };
    }
    // The angle is about the z axis; the normal of the picture may point down.
    const turn = (value - angle) * (isUpright ? Math.sign(plane.normal[2]) : 1);
    const away = minus(position, plane.origin);
    // The ring turns the part about its middle, as in the drawing; a typed angle is that of its frame, whose position stays.
    const about = typed || isBlank ? { about: [dot(away, plane.x), dot(away, plane.y)] } : {};
    const pivot = typed || isBlank ? position : middle;
    return { edits: [{ do: "place", turn, ...about }], values: [...plus(pivot, turned(minus(position, pivot), plane.normal, turn)), value] };
  };
  return {
    ...{ key: "part", title: "Part on the table", inWork: true, reference: IDENTITY, origin: middle },
    // The part of a planar arm has no height.
    ...{ normal: isUpright ? [0, 0, 1] : plane.normal, rises: part.dimension === 3, turns: true, values, sizes: [], change },
  };
}

/** Return an obstacle as a target; null if there is none. @param {Store} store @param {number} index in the job file @returns {Target | null} */
export function obstacleOf({ document }, index) {
  const body = document?.obstacles?.[index];
  if (!body) return null;
  const isOnPart = body.fixed_to === "part";
  const reference = isOnPart ? document.part.at : IDENTITY;
  const pose = compose(inverse(reference), body.place);
  const at = body.at ?? [0, 0, 0];
  const values = [...at, yawOf(pose)];
  const edit = (/** @type {object} */ more) => [{ do: "obstacle", action: "change", index, ...more }];
  /** @type {Target["change"]} */
  const change = (k, value) => {
    const next = values.map((x, j) => (j === k ? value : x));
    return { edits: edit(k < 3 ? { at: next.slice(0, 3) } : { turn: value - values[3] }), values: next };
  };
  const sizes = Object.entries(SIZES).flatMap(([key, labels]) => {
    const lengths = [body[key] ?? []].flat();
    return lengths.map((/** @type {number} */ value, /** @type {number} */ k) => ({
      label: labels[k],
      value,
      edits: (/** @type {number} */ x) => edit({ [key]: lengths.length > 1 ? lengths.map((/** @type {number} */ old, /** @type {number} */ j) => (j === k ? x : old)) : x }),
    }));
  });
  const turns = !body.normal && body.type !== "sphere";
  return { key: `obstacle ${index}`, title: body.name, inWork: isOnPart, reference, origin: at, normal: [0, 0, 1], rises: true, turns, values, sizes, change, body: body.name, pose };
}

/** Moves the target, by the gizmo or by typed values. */
export class Placing {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    /** Values of the target before the server has answered, and the target at the start. @type {{target: Target, values: number[]} | null} */
    this.held = null;
    /** @type {Gesture | null} */
    this.gesture = null;
    this.box = make("div", { class: "place-box", role: "group", "aria-label": "Place" });
    toolBox().append(this.box);
    // The keys of the tools work again after a value was typed.
    this.box.addEventListener("keyup", (event) => {
      const isDone = event.key === "Enter" || event.key === "Escape";
      if (isDone && event.target instanceof HTMLInputElement) find(store.options.stage === "2d" ? "#view2d" : "#view3d canvas").focus();
    });
    this.show = oncePerFrame(() => this.showNow());
    for (const event of ["document", "dropped", "link", "reset"]) store.on(event, () => this.answered());
    for (const event of ["view", "refusal", "picture"]) store.on(event, this.show);
    inches.subscribe(this.show);
  }

  /** What is placed: the selected obstacle, or the part with its tool. @returns {Target | null} */
  get target() {
    const { options } = this.store;
    if (this.gesture && this.held) return this.held.target;
    if (options.obstacle >= 0) return obstacleOf(this.store, options.obstacle);
    return options.tool === "move" && this.store.latest("picture") ? partOf(this.store) : null;
  }

  /** Values of the target as shown: those of a gesture, or those of the document. @returns {number[]} */
  get values() {
    return this.held?.values ?? this.target?.values ?? [];
  }

  /** The document has the change, or refuses it. */
  answered() {
    if (!this.gesture) this.held = null;
    this.show();
  }

  /** Change one value of the target; without a gesture, at once. @param {number} k @param {number} value @param {number} [at] ms */
  set(k, value, at = performance.now()) {
    const { target, gesture } = this;
    if (!target) return;
    const { edits, values } = target.change(k, value, !gesture);
    this.held = { target, values };
    if (gesture) gesture.update(edits, at);
    else this.link.edit(edits);
    this.store.tell("placing");
    this.show();
  }

  begin() {
    const { target } = this;
    if (!target) return;
    this.held = { target, values: target.values };
    this.gesture = new Gesture(this.link);
  }

  /** End a gesture. @param {boolean} cancelled */
  end(cancelled) {
    const { gesture } = this;
    this.gesture = null;
    if (cancelled) gesture?.cancel();
    else gesture?.end();
    if (cancelled || !gesture?.edits.length) this.held = null;
    this.store.tell("placing");
    this.show();
  }

  /** Take a typed value. @param {number} k @param {string} text */
  type(k, text) {
    const value = k < 3 ? readTyped(text, UNITS, lengthUnit().factor) : readTyped(text, ANGLES);
    if (Number.isFinite(value)) this.set(k, value);
    else this.store.tell("dropped", { head: { sentence: `${text} is not ${k < 3 ? "a length such as 12.5 or 12.5 mm" : "an angle such as 30 or 30 deg"}.` } });
  }

  /** @param {Size} size @param {string} text */
  resize(size, text) {
    const value = readTyped(text, UNITS, lengthUnit().factor);
    if (value >= LEAST) this.link.edit(size.edits(value));
    else this.store.tell("dropped", { head: { sentence: `${text} is not a length above 0, such as 12.5 or 12.5 mm.` } });
  }

  showNow() {
    const { target, box, store } = this;
    box.hidden = !target;
    store.tell("placing");
    if (!target) return;
    const { factor, unit } = lengthUnit();
    const texts = this.values.map((x, k) => short(exact(k < 3 ? x / factor : x / DEGREE), 7));
    const shown = [0, 1, ...(target.rises ? [2] : []), ...(target.turns ? [3] : [])];
    const outOfReach = this.gesture && store.refusal?.head.error === "Unreachable";
    render(
      html`<p class="tool-title"><b>${target.title}</b> <span class="quiet">${outOfReach ? "out of reach" : `${unit}, °; steps 5 mm, 5°; Shift 0.1`}</span></p>
        <div class="tool-fields">${shown.map((k) => html`<label key=${k} class="axis-${k}"><span>${NAMES[k]}</span><${Entry} key=${`${target.key} ${k}`} value=${texts[k]} aria-label=${SPOKEN[k]} inputmode="text" send=${(/** @type {string} */ text) => this.type(k, text)} /><span class="quiet">${k < 3 ? unit : "°"}</span></label>`)}
        ${target.sizes.map((size) => html`<label key=${size.label} class="size"><span>${size.label}</span><${Entry} key=${`${target.key} ${size.label}`} value=${short(exact(size.value / factor), 7)} aria-label=${size.label} send=${(/** @type {string} */ text) => this.resize(size, text)} /><span class="quiet">${unit}</span></label>`)}</div>`,
      box,
    );
    box.dataset.values = this.values.join(",");
    box.dataset.target = target.key;
  }

  /** Pose of the target's reference frame, in the frame of the floor. @param {Pose} work pose of the work @returns {Pose} */
  frame(work) {
    const { target } = this;
    if (!target) return IDENTITY;
    return target.inWork ? compose(work, target.reference) : target.reference;
  }

  /** Where the gizmo is, in the reference frame [m]. @returns {Vector} */
  get origin() {
    const { target, values } = this;
    if (!target) return [0, 0, 0];
    // A turn about the middle of the part moves its frame, but not its middle.
    const isTurned = values[3] !== target.values[3];
    if (isTurned) return target.origin;
    return plus(target.origin, minus(values.slice(0, 3), target.values.slice(0, 3)));
  }

  /** Pose of a dragged body in the frame of the floor; null for the part. @param {Pose} work @returns {Pose | null} */
  bodyPose(work) {
    const { target, values } = this;
    if (!target?.pose || !this.held) return null;
    const turn = values[3] - target.values[3];
    const axes = [0, 1, 2].map((k) => turned(column(/** @type {Pose} */ (target.pose), k), target.normal, turn));
    const pose = [0, 1, 2].map((row) => [...axes.map((axis) => axis[row]), values[row]]);
    return compose(this.frame(work), [...pose, [0, 0, 0, 1]]);
  }

  /** Motion of the part that a gesture makes, in the work frame; null without one. @returns {Pose | null} */
  get partMotion() {
    const { target, values } = this;
    if (!this.held || target?.key !== "part") return null;
    const turn = values[3] - target.values[3];
    const axes = [0, 1, 2].map((k) => turned(column(IDENTITY, k), target.normal, turn));
    const about = minus(values.slice(0, 3), [0, 1, 2].map((row) => axes.reduce((sum, axis, k) => sum + axis[row] * target.values[k], 0)));
    return [...[0, 1, 2].map((row) => [...axes.map((axis) => axis[row]), about[row]]), [0, 0, 0, 1]];
  }
}

/** @type {Placing | null} */
let placing = null;

/** Return what moves the part and obstacles. @returns {Placing} */
export function placingOf() {
  if (!placing) throw new Error("The region placing has not started.");
  return placing;
}

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  placing = new Placing(store, link);
}

