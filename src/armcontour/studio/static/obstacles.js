// Obstacles over the drawing: they are moved, boxes are sized, all by drag or by arrow keys.

import { draw, find, mark } from "./dom.js";
import { axesOf, dot, outlineOf, planeOf, standing } from "./footprint.js";
import { mm } from "./format.js";
import { dragged, Gesture, nudged } from "./gesture.js";
import { tellEarly } from "./messages.js";
import { oncePerFrame } from "./state.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {import("./handles.js").Handles} Handles */
/** @typedef {import("./footprint.js").Obstacle} Obstacle */
/** @typedef {[number, number]} Point */
/** What a drag of an obstacle changes. @typedef {"at" | "size"} What */

const NEW_SIDE = 60; // px
const LEAST_SIZE = 1e-3; // m

class Obstacles {
  /** @param {Store} store @param {Link} link @param {View2d} view @param {Handles} handles */
  constructor(store, link, view, handles) {
    this.store = store;
    this.link = link;
    this.view = view;
    this.handles = handles;
    this.group = draw("g", { class: "obstacles" });
    view.overlay.prepend(this.group);
    /** @type {{body: SVGGElement, shape: SVGElement, sizer: SVGGElement}[]} */
    this.elements = [];
    /** The obstacle that is changed now. @type {Obstacle | null} */
    this.held = null;
    find("#add-obstacle").addEventListener("click", () => this.add());
    store.on("document", () => {
      this.held = null;
      this.place();
    });
    store.on("refusal", () => (this.held = null));
    view.followers.add(() => this.place());
    this.follow = oncePerFrame(() => this.place());
  }

  /** The plane of the picture. @returns {any} */
  get plane() {
    return planeOf(this.store);
  }

  /** Obstacles as they are drawn: the one that is held where it is held. @returns {Obstacle[]} */
  list() {
    return standing(this.store).map((x) => (this.held?.kind === x.kind && this.held.index === x.index ? this.held : x));
  }

  /** A box in the middle of the view. */
  add() {
    const { plane } = this;
    if (!plane) return tellEarly("No obstacle can be added yet: no path has been shown.");
    const side = Number((NEW_SIDE / this.view.view.scale).toPrecision(1));
    const { u, v } = this.view.view.place;
    const at = this.lift([u + this.handles.centre[0], v + this.handles.centre[1]], 1e-3);
    this.link.edit([{ do: "obstacle", action: "add", kind: "box", size: [side, side, side], at }]);
  }

  /** A point of the plane in space, on round numbers. @param {Point} uv @param {number} [step] m @returns {number[]} */
  lift([u, v], step = 1e-6) {
    const { origin, x, y } = this.plane;
    return [0, 1, 2]
      .map((k) => step * Math.round((origin[k] + u * x[k] + v * y[k]) / step))
      .map((c) => Number(c.toPrecision(12)));
  }

  place() {
    const { plane } = this;
    const obstacles = plane ? this.list() : [];
    while (this.elements.length > obstacles.length) this.remove();
    while (this.elements.length < obstacles.length) this.elements.push(this.make(this.elements.length));
    obstacles.forEach((obstacle, k) => this.placeOne(obstacle, this.elements[k]));
  }

  remove() {
    const last = this.elements.pop();
    last?.body.remove();
    last?.sizer.remove();
  }

  /** @param {Obstacle} obstacle @param {{body: SVGGElement, shape: SVGElement, sizer: SVGGElement}} element */
  placeOne(obstacle, { body, shape, sizer }) {
    const outline = outlineOf(obstacle, this.plane);
    body.toggleAttribute("hidden", !outline);
    sizer.toggleAttribute("hidden", !outline || obstacle.kind !== "boxes");
    if (!outline) return;
    const points = outline.map((p) => this.handles.screen(p));
    mark(shape, "points", points.map((p) => p.map((x) => x.toFixed(1)).join()).join(" "));
    const corner = points.reduce((best, p) => (p[0] - p[1] > best[0] - best[1] ? p : best));
    mark(sizer, "transform", `translate(${corner[0].toFixed(1)} ${corner[1].toFixed(1)})`);
    const at = obstacle.at ?? [0, 0, 0];
    mark(body, "aria-label", `Obstacle ${obstacle.name ?? obstacle.index + 1}`);
    mark(body, "aria-valuetext", `at ${at.map((x) => mm(x, 1)).join(", ")} mm`);
    mark(body, "aria-valuenow", String(Math.round(1000 * at[0])));
    mark(sizer, "aria-label", `Size of obstacle ${obstacle.name ?? obstacle.index + 1}`);
    mark(sizer, "aria-valuetext", `${(obstacle.size ?? []).map((x) => mm(x, 1)).join(" by ")} mm`);
    mark(sizer, "aria-valuenow", String(Math.round(1000 * (obstacle.size?.[0] ?? 0))));
  }

  /** @param {number} k */
  make(k) {
    const body = draw("g", { class: "handle obstacle", role: "slider", tabindex: 0, "aria-valuenow": 0 });
    const shape = draw("polygon", { class: "seen" });
    body.append(shape);
    const sizer = draw("g", { class: "handle sizer", role: "slider", tabindex: 0, "aria-valuenow": 0 });
    sizer.append(
      draw("circle", { r: 12, class: "target" }),
      draw("rect", { x: -4, y: -4, width: 8, height: 8, class: "seen" }),
    );
    this.group.append(body, sizer);
    this.movable(body, k, "at");
    this.movable(sizer, k, "size");
    body.addEventListener("keydown", (event) => {
      if (event.key !== "Delete" && event.key !== "Backspace") return;
      event.preventDefault();
      const { kind, index } = this.list()[k];
      this.link.edit([{ do: "obstacle", action: "remove", kind, index }]);
    });
    return { body, shape, sizer };
  }

  /** @param {SVGGElement} element @param {number} k @param {What} what */
  movable(element, k, what) {
    /** @type {{gesture: Gesture, from: Obstacle, grip: Point} | null} */
    let under = null;
    const start = (/** @type {Point} */ grip) => {
      under = { gesture: new Gesture(this.link), from: this.list()[k], grip };
      return true;
    };
    const by = (/** @type {number} */ du, /** @type {number} */ dv, /** @type {Event} */ event) => {
      if (!under) return;
      const { kind, index } = under.from;
      const value = what === "at" ? this.moved(under.from, du, dv) : this.sized(under.from, du, dv);
      this.held = { ...under.from, [what]: value };
      under.gesture.update([{ do: "obstacle", action: "change", kind, index, [what]: value }], event.timeStamp);
      this.follow();
    };
    const end = (cancelled = false) => {
      if (cancelled) under?.gesture.cancel();
      else under?.gesture.end();
      if (cancelled) this.held = null;
      under = null;
      this.place();
    };
    dragged(element, {
      start: (event) => start(this.handles.plane(event)),
      move: (event) => {
        const at = this.handles.plane(event);
        if (under) by(at[0] - under.grip[0], at[1] - under.grip[1], event);
      },
      end,
    });
    nudged(element, { start: () => start([0, 0]), move: by, end });
  }

  /** @param {Obstacle} from @param {number} du @param {number} dv @returns {number[]} m */
  moved({ at = [0, 0, 0] }, du, dv) {
    const { x, y } = this.plane;
    return [0, 1, 2].map((k) => Number(((at[k] ?? 0) + du * x[k] + dv * y[k]).toFixed(6)));
  }

  /** The middle stays where it is. @param {Obstacle} from @param {number} du @param {number} dv @returns {number[]} m */
  sized(from, du, dv) {
    const { x, y } = this.plane;
    const by = [0, 1, 2].map((k) => du * x[k] + dv * y[k]);
    // The grip is at the corner that is farthest to the right and below.
    const grip = [0, 1, 2].map((k) => x[k] - y[k]);
    return axesOf(from).map((axis, k) => {
      const grown = 2 * dot(by, axis) * Math.sign(dot(grip, axis));
      return Number(Math.max(LEAST_SIZE, (from.size?.[k] ?? 0) + grown).toFixed(6));
    });
  }
}

/** @param {Store} store @param {Link} link @param {View2d} view @param {Handles} handles */
export function init(store, link, view, handles) {
  new Obstacles(store, link, view, handles);
}
