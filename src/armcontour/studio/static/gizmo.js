// Gizmo of the 3D view: arrows along the axes and a ring, which move, raise and turn the part or an obstacle.

import { draw, grip, make, mark, say } from "./dom.js";
import { short } from "./format.js";
import { dragged } from "./gesture.js";
import { lengthUnit } from "./length_unit.js";
import { exact, NAMES, placingOf } from "./placing.js";
import { oncePerFrame } from "./state.js";
import { apply, cross, dot, length, minus, plus, poseOfColumns, rotate, unit } from "./vectors.js";
import { Matrix4, Vector3 } from "./vendor/three.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./viewer.js").Viewer} Viewer */
/** @typedef {import("./vectors.js").Vector} Vector */
/** A value that is dragged: where the drag begins, and the axis, in the frame of the floor [m]. @typedef {{k: number, origin: Vector, axis: Vector, start: number, value: number, reach: number}} Drag */

/** Length of an arrow, and radius of the ring [px]. */
const [ARROW, RING] = [88, 66];
/** Distance from the origin at which an arrow begins, as a share of its length. */
const GAP = 0.16;
const HEAD = 12; // px
/** Number of pieces of the ring. */
const PIECES = 48;
/** Steps of lengths [m] and angles [rad], and with Shift. */
const STEPS = [5e-3, Math.PI / 36];
const FINE = [1e-4, Math.PI / 1800];
/** Smallest sine of the angle between an arrow and the line of sight at which it can be dragged. */
const SLANTED = 0.08;
/** Smallest sine of the angle between the line of sight and the plane of the ring. */
const EDGE_ON = 0.08;
/** Offset of the figure from the pointer [px]. */
const ASIDE = [16, -34];
const SPOKEN = ["Move along X", "Move along Y", "Move along Z", "Turn"];

export class Gizmo {
  /** @param {Store} store @param {Viewer} viewer @param {HTMLElement} host */
  constructor(store, viewer, host) {
    this.store = store;
    this.viewer = viewer;
    this.placing = placingOf();
    /** @type {Drag | null} */
    this.drag = null;
    /** Where the pointer is on the page [px]. */
    this.pointer = [0, 0];
    this.overlay = draw("svg", { class: "gizmo", role: "group", "aria-label": "Gizmo" });
    this.trace = draw("line", { class: "gizmo-trace" });
    this.grips = NAMES.map((name, k) => this.grip(name, k));
    this.overlay.append(this.trace, ...[3, 0, 1, 2].map((k) => this.grips[k].element));
    this.label = make("div", { class: "tip gizmo-figure", hidden: true, "aria-hidden": "true" });
    host.append(this.overlay, this.label);
    this.soon = oncePerFrame(() => this.draw());
    for (const event of ["placing", "view", "document", "refusal"]) store.on(event, this.soon);
    // The answer may come while the pointer rests.
    for (const event of ["refusal", "picture"]) store.on(event, () => this.tell());
  }

  /** @param {string} name @param {number} k */
  grip(name, k) {
    const [reach, seen] = ["target", "seen"].map((look) => draw("path", { class: look }));
    const text = draw("text", { "aria-hidden": "true" });
    const element = grip({ class: `handle gizmo-grip axis-${k}`, "aria-label": SPOKEN[k], "data-axis": k }, [], 0);
    element.replaceChildren(reach, seen, text);
    if (k < 3) say(text, name);
    dragged(element, {
      start: (event) => this.begin(k, event),
      move: (event) => this.move(event),
      end: (cancelled) => this.end(cancelled),
    });
    element.addEventListener("keydown", (event) => this.press(event, k));
    return { element, reach, seen, text };
  }

  /** Pose of the work in the frame of the floor. */
  get work() {
    return poseOfColumns(this.viewer.work.elements);
  }

  /** Origin and axes of the gizmo in the frame of the floor, and the size of a pixel there [m]. */
  get place() {
    const { placing, viewer } = this;
    const frame = placing.frame(this.work);
    const origin = apply(frame, placing.origin);
    const axes = [0, 1, 2].map((k) => rotate(frame, [0, 1, 2].map((j) => Number(j === k))));
    const normal = rotate(frame, placing.target?.normal ?? [0, 0, 1]);
    const away = new Vector3(...origin).sub(viewer.eye.position).length();
    const pixel = (2 * away * Math.tan((viewer.eye.fov * Math.PI) / 360)) / Math.max(1, viewer.host.clientHeight);
    return { origin, axes, normal, pixel };
  }

  /** @param {number} k @param {PointerEvent} event @returns {boolean} */
  begin(k, event) {
    const { placing } = this;
    if (!placing.target) return false;
    const { origin, axes, normal } = this.place;
    const drag = { k, origin, axis: k < 3 ? axes[k] : normal, start: 0, value: placing.values[k], reach: 0 };
    const at = this.along(drag, event);
    if (at === null) return false;
    drag.start = at;
    this.drag = drag;
    this.viewer.controls.enabled = false;
    placing.begin();
    this.pointer = [event.clientX, event.clientY];
    this.tell();
    return true;
  }

  /** @param {PointerEvent} event */
  move(event) {
    const { drag, placing } = this;
    const at = drag && this.along(drag, event);
    if (!drag || at === null) return;
    const by = drag.k < 3 ? at - drag.start : Math.atan2(Math.sin(at - drag.start), Math.cos(at - drag.start));
    const step = (event.shiftKey ? FINE : STEPS)[Number(drag.k === 3)];
    const value = exact(step * Math.round((drag.value + by) / step));
    if (value !== placing.values[drag.k]) placing.set(drag.k, value, event.timeStamp);
    this.pointer = [event.clientX, event.clientY];
    this.tell();
  }

  /** @param {boolean} cancelled */
  end(cancelled) {
    this.drag = null;
    this.label.hidden = true;
    this.viewer.controls.enabled = true;
    this.placing.end(cancelled);
  }

  /** Move by one step with an arrow key. @param {KeyboardEvent} event @param {number} k */
  press(event, k) {
    const { placing } = this;
    const sign = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
    if (!sign || !placing.target) return;
    event.preventDefault();
    event.stopPropagation();
    placing.link.whenKnown(() => {
      const step = (event.shiftKey ? FINE : STEPS)[Number(k === 3)];
      placing.begin();
      placing.set(k, exact(step * Math.round(placing.values[k] / step + sign)));
      placing.end(false);
    });
  }

  /**
   * Return where the pointer is along the axis of a drag [m], or its angle about it [rad]; null if that cannot be seen.
   * @param {Drag} drag @param {PointerEvent} event @returns {number | null}
   */
  along({ k, origin, axis }, event) {
    const { left, top } = this.viewer.canvas.getBoundingClientRect();
    const ray = this.viewer.rayAt(event.clientX - left, event.clientY - top);
    const [from, way] = [ray.from.toArray(), ray.along.toArray()];
    const toward = dot(axis, way);
    const apart = minus(from, origin);
    if (k < 3) {
      // The point of the axis that is nearest to the ray; an arrow in the line of sight has none.
      const square = 1 - toward * toward;
      return square < SLANTED ** 2 ? null : (dot(axis, apart) - toward * dot(way, apart)) / square;
    }
    if (Math.abs(toward) < EDGE_ON) return null;
    const on = plus(apart, way, -dot(apart, axis) / toward);
    const [x, y] = sidesOf(axis);
    return length(on) === 0 ? null : Math.atan2(dot(on, y), dot(on, x));
  }

  /** Show the figure at the pointer. */
  tell() {
    const { drag, label, placing, store } = this;
    if (!drag) return;
    const { factor, unit: lengths } = lengthUnit();
    const by = exact(placing.values[drag.k] - drag.value);
    const number = short(drag.k < 3 ? by / factor : (by * 180) / Math.PI, 5);
    const text = `${NAMES[drag.k]} ${by > 0 ? "+" : ""}${number.replace("-", "−")} ${drag.k < 3 ? lengths : "°"}`;
    const isOut = store.refusal?.head.error === "Unreachable";
    label.replaceChildren(make("b", { text }), make("span", { class: isOut ? "worse" : "quiet", text: isOut ? "out of reach" : "Shift: 0.1" }));
    label.hidden = false;
    label.dataset.out = String(isOut);
    const { left, top, width } = this.viewer.canvas.getBoundingClientRect();
    const x = Math.min(this.pointer[0] - left + ASIDE[0], width - label.offsetWidth - 4);
    const y = Math.max(4, this.pointer[1] - top + ASIDE[1]);
    label.style.transform = `translate(${x.toFixed(0)}px, ${y.toFixed(0)}px)`;
  }

  /** Draw the gizmo over the canvas, and dragged bodies in it. */
  draw() {
    const { placing, overlay, viewer } = this;
    const { target } = placing;
    overlay.toggleAttribute("hidden", !target);
    if (!target) return;
    const body = placing.bodyPose(this.work);
    if (body && target.body) viewer.placeBody(target.body, new Matrix4().fromArray(body.flat()).transpose());
    const { origin, axes, normal, pixel } = this.place;
    const see = (/** @type {Vector[]} */ points) => viewer.toScreen(points.map((p) => new Vector3(...p)));
    const away = unit(minus(origin, viewer.eye.position.toArray()));
    for (const [k, axis] of axes.entries()) {
      const [begin, end] = see([plus(origin, axis, GAP * ARROW * pixel), plus(origin, axis, ARROW * pixel)]);
      const isSeen = (k < 2 || target.rises) && Math.abs(dot(axis, away)) < 1 - SLANTED ** 2;
      this.drawArrow(this.grips[k], begin, end, isSeen);
    }
    const [x, y] = sidesOf(normal);
    const ring = Array.from({ length: PIECES }, (_, k) => plus(plus(origin, x, RING * pixel * Math.cos((2 * Math.PI * k) / PIECES)), y, RING * pixel * Math.sin((2 * Math.PI * k) / PIECES)));
    const { element, reach, seen } = this.grips[3];
    const round = see(ring);
    const isRound = target.turns && Math.abs(dot(normal, away)) > EDGE_ON && round.every(([u]) => Number.isFinite(u));
    element.toggleAttribute("hidden", !isRound);
    if (isRound) for (const path of [reach, seen]) mark(path, "d", `M${round.map(textOf).join("L")}Z`);
    this.drawTrace(see, origin);
    this.describe();
  }

  /** @param {{element: SVGElement, reach: SVGElement, seen: SVGElement, text: SVGElement}} grip @param {number[]} begin px @param {number[]} end px @param {boolean} isSeen */
  drawArrow({ element, reach, seen, text }, begin, end, isSeen) {
    const way = minus(end, begin);
    // A point behind the eye has no place.
    const isThere = isSeen && Number.isFinite(length(way));
    element.toggleAttribute("hidden", !isThere);
    if (!isThere) return;
    const [u, v] = unit(way);
    const [bx, by] = plus(end, [u, v], -HEAD);
    const side = HEAD / 2.4;
    mark(reach, "d", `M${textOf(begin)}L${textOf(end)}`);
    mark(seen, "d", `M${textOf(begin)}L${textOf([bx, by])}M${textOf(end)}L${textOf([bx - side * v, by + side * u])}L${textOf([bx + side * v, by - side * u])}Z`);
    const [tx, ty] = plus(end, [u, v], 12);
    mark(text, "x", tx.toFixed(1));
    mark(text, "y", (ty + 4).toFixed(1));
  }

  /** The line to the place before the gesture. @param {(points: Vector[]) => number[][]} see @param {Vector} origin */
  drawTrace(see, origin) {
    const { drag, trace } = this;
    const [[x1, y1], [x2, y2]] = see([drag?.origin ?? origin, origin]);
    const isShown = Boolean(drag) && Number.isFinite(x1 + x2);
    trace.toggleAttribute("hidden", !isShown);
    if (!isShown) return;
    for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) mark(trace, name, value.toFixed(1));
  }

  describe() {
    const { factor, unit: lengths } = lengthUnit();
    this.placing.values.forEach((x, k) => {
      const number = short(exact(k < 3 ? x / factor : (x * 180) / Math.PI), 6);
      mark(this.grips[k].element, "aria-valuenow", number);
      mark(this.grips[k].element, "aria-valuetext", `${number} ${k < 3 ? lengths : "°"}`);
    });
  }
}

/** Return two unit vectors across a unit vector, which make a right-handed frame with it; for the vertical, x and y. @param {Vector} normal @returns {[Vector, Vector]} */
function sidesOf(normal) {
  const across = Math.abs(normal[0]) < 0.9 ? [1, 0, 0] : [0, 1, 0];
  const x = unit(plus(across, normal, -dot(across, normal)));
  return [x, cross(normal, x)];
}

/** @param {number[]} point px @returns {string} */
const textOf = ([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`;
