// Measuring tool: two clicks in the drawing or in the 3D view. The first one measures a shape, the second one a distance.

import { draw, make, mark } from "./dom.js";
import { short } from "./format.js";
import { lengthUnit } from "./length_unit.js";
import { oncePerFrame } from "./state.js";
import { circleShape, circleThrough, lineShape, measure, pointShape, shapesOfSegments } from "./shapes.js";
import { toolBox } from "./tool_strip.js";
import { inches } from "./units.js";
import { apply, column, compose, dot, IDENTITY, inverse, length, minus, plus, rotate, unit } from "./vectors.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./shapes.js").Shape} Shape */
/** @typedef {import("./vectors.js").Vector} Vector */
/** A view in which one measures: its overlay, and the projection of points of the work frame [px]. @typedef {{name: string, overlay: SVGElement, see: (points: Vector[]) => number[][], isShown: () => boolean, marks: Record<string, SVGElement>, label: HTMLElement, shapes: () => Shape[], surface?: (x: number, y: number) => Vector | null}} View */

/** Distance within which a point, and a shape, is found, by a mouse and by a finger [px]. */
const [NEAR_POINT, NEAR_SHAPE] = [9, 10];
const FINGER = 2.2;
/** With more shapes than this, none lights up at the pointer; clicks find them. */
const MOST_HOVERED = 3000;
/** Decimals of a length, by the shown unit: clicks in a view are not more precise. @type {Record<string, number>} */
const DECIMALS = { mm: 2, in: 4 };
/** Shorter lengths are 0 [m]. */
const ZERO = 1e-9;
const ASIDE = [14, -40]; // px
/** Radii of the marks of a measured point: a dot in a ring, unlike any line of the drawing [px]. */
const [DOT, RING] = [3, 8];
/** Half the width of the cross that shows a centre [px]. */
const CROSS = 8;

export class Measure {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    /** Clicked shapes: none, one or two. @type {Shape[]} */
    this.clicked = [];
    /** @type {Shape | null} */
    this.hovered = null;
    /** @type {View[]} */
    this.views = [];
    /** Shapes of the drawing, and the frame from which they are. @type {{frame: any, shapes: Shape[]}} */
    this.drawn = { frame: null, shapes: [] };
    /** Revision for which the shapes were asked. */
    this.asked = -1;
    this.box = make("div", { class: "measure-box", role: "status", "aria-label": "Measured", hidden: true });
    toolBox().append(this.box);
    this.soon = oncePerFrame(() => this.draw());
    store.on("view", () => this.update());
    store.on("document", () => {
      this.clicked = [];
      this.hovered = null;
      this.update();
    });
    store.on("segments", (/** @type {any} */ frame) => {
      this.drawn = { frame, shapes: frame ? shapesOfSegments(frame.arrays, frame.head.count) : [] };
      this.soon();
    });
    store.on("reset", () => (this.drawn = { frame: null, shapes: [] }));
    for (const event of ["picture", "time", "theme"]) store.on(event, this.soon);
    inches.subscribe(this.soon);
    store.on("escape", (/** @type {{taken: boolean}} */ key) => {
      if (key.taken || !this.isOn || this.clicked.length === 0) return;
      key.taken = true;
      this.clicked = [];
      this.soon();
    });
  }

  get isOn() {
    return this.store.options.tool === "measure" && !this.store.options.pen;
  }

  /** Ask for the shapes of the drawing when they are needed. */
  update() {
    const rev = this.store.document?.rev ?? this.store.latest("document")?.rev ?? -1;
    if (this.isOn && rev !== this.asked) {
      this.asked = rev;
      this.link.send({ op: "segments" });
    }
    this.soon();
  }

  /** Measure in a view. @param {Omit<View, "marks" | "label">} view @param {HTMLElement} host of its label @param {HTMLElement | SVGElement} ground on which one points */
  add(view, host, ground) {
    const marks = { hover: draw("path", { class: "measured-hover" }), halo: draw("path", { class: "measured-halo" }), rings: draw("path", { class: "measured-rings" }), dots: draw("path", { class: "measured-dots" }) };
    const group = draw("g", { class: "measured", "aria-hidden": "true" });
    group.append(...Object.values(marks));
    view.overlay.append(group);
    const label = make("div", { class: "tip measured-label", hidden: true, "aria-hidden": "true" });
    host.append(label);
    const added = { ...view, marks, label };
    this.views.push(added);
    let [x, y] = [0, 0];
    const seek = oncePerFrame(() => this.hover(this.isOn && added.shapes().length < MOST_HOVERED ? this.nearest(added, x, y, 1, true) : null));
    ground.addEventListener("pointermove", (event) => {
      if (!this.isOn || /** @type {PointerEvent} */ (event).buttons) return;
      [x, y] = placeIn(ground, /** @type {PointerEvent} */ (event));
      seek();
    });
    ground.addEventListener("pointerleave", () => this.hover(null));
    return added;
  }

  /** @param {Shape | null} shape */
  hover(shape) {
    if (shape === this.hovered) return;
    this.hovered = shape;
    this.soon();
  }

  /** Take a click; returns whether the tool is in use. @param {string} name of the view @param {number} x px @param {number} y px @param {boolean} finger @returns {boolean} */
  click(name, x, y, finger) {
    const view = this.views.find((found) => found.name === name);
    if (!this.isOn || !view) return false;
    const shape = this.shownCentre(view, x, y) ?? this.nearest(view, x, y, finger ? FINGER : 1) ?? surfacePoint(view, x, y);
    this.clicked = shape ? [...(this.clicked.length < 2 ? this.clicked : []), shape] : [];
    this.soon();
    return true;
  }

  /** Return the centre that is shown at a place; no other centre is taken, because a click would go to a place where nothing is. @param {View} view @param {number} x px @param {number} y px @returns {Shape | null} */
  shownCentre(view, x, y) {
    const { hovered } = this;
    if (!hovered?.round) return null;
    const [[u, v]] = view.see(hovered.points);
    return Math.hypot(u - x, v - y) < NEAR_POINT ? hovered : null;
  }

  /** Return the shape at a place: a point if one is near, else a line or a circle. @param {View} view @param {number} x px @param {number} y px @param {number} factor of the distances within which it is found @param {boolean} [withCentres] @returns {Shape | null} */
  nearest(view, x, y, factor, withCentres = false) {
    let [nearest, away] = [/** @type {Shape | null} */ (null), NEAR_SHAPE * factor];
    let [point, least] = [/** @type {Shape | null} */ (null), NEAR_POINT * factor];
    for (const shape of view.shapes()) {
      const seen = view.see(shape.points);
      const distance = distanceTo(seen, x, y);
      if (distance < away) [nearest, away] = [shape, distance];
      for (const snap of [...snapPoints(shape), ...(withCentres ? centresOf(shape) : [])]) {
        const [[u, v]] = view.see(snap.points);
        const far = Math.hypot(u - x, v - y);
        if (far < least) [point, least] = [snap, far];
      }
    }
    if (point) return point;
    if (nearest?.kind !== "curve") return nearest;
    return pointShape(onCurve(view, nearest, x, y), "point of a curve");
  }

  /** Draw in all views what is measured. */
  draw() {
    const { isOn, clicked, views } = this;
    if (!isOn && this.box.hidden) return;
    const found = clicked.length === 2 ? measure(clicked[0], clicked[1]) : null;
    const [big, small] = this.textsOf(found);
    for (const view of views) {
      const { marks, label, see } = view;
      const isShown = isOn && view.isShown();
      mark(marks.hover, "d", isShown && this.hovered ? hoverPath(this.hovered, see) : "");
      const ends = found ? see(found.ends) : [];
      const places = !isShown ? [] : found ? ends : see(clicked.flatMap(marksOf));
      const rings = dotsOf(places, RING);
      mark(marks.halo, "d", rings);
      mark(marks.rings, "d", rings);
      mark(marks.dots, "d", dotsOf(places, DOT));
      const at = found ? plus(ends[0], minus(ends[1], ends[0]), 0.5) : clicked.length ? see([middleOf(clicked[0])])[0] : null;
      const { clientWidth: width, clientHeight: height } = /** @type {HTMLElement} */ (label.parentElement);
      const isInside = at !== null && at[0] >= 0 && at[1] >= 0 && at[0] <= width && at[1] <= height;
      label.hidden = !isShown || !isInside;
      if (label.hidden || !at) continue;
      label.replaceChildren(make("b", { text: big }));
      const [left, top] = [[at[0] + ASIDE[0], width - label.offsetWidth], [at[1] + ASIDE[1], height - label.offsetHeight]].map(([x, most]) => Math.max(4, Math.min(x, most - 4)));
      label.style.transform = `translate(${left.toFixed(0)}px, ${top.toFixed(0)}px)`;
    }
    this.box.hidden = !isOn;
    if (!isOn) return;
    this.box.dataset.distance = found ? String(found.distance) : "";
    this.box.dataset.angle = found?.angle == null ? "" : String(found.angle);
    this.box.dataset.kinds = clicked.map(({ kind }) => kind).join(" ");
    this.box.dataset.hovered = this.hovered ? pickedName(this.hovered) : "";
    this.box.dataset.picks = clicked.map(pickedName).join(", ");
    render(html`<p class="tool-title"><b>Measure</b></p>
      ${big ? html`<p class="measured-big">${big}</p><p>${small}</p>` : html`<p class="quiet">Click a point, a line or a circle, then a second one.</p>`}
      ${clicked.length > 0 && html`<p>Picked: ${clicked.map(pickedName).join(", ")}</p>`}
      ${clicked.length === 1 && html`<p class="quiet">Click a second one for the distance.</p>`}`, this.box);
  }

  /** @param {number} x m @returns {string} */
  long(x) {
    const { factor, unit: name } = lengthUnit();
    const smallest = 10 ** -DECIMALS[name];
    const size = Math.abs(x) / factor;
    if (Math.abs(x) > ZERO && size < smallest / 2) return `< ${smallest} ${name}`;
    const text = String(Number(size.toFixed(DECIMALS[name])));
    return `${x < -ZERO ? "−" : ""}${text} ${name}`;
  }

  /** @param {Vector} v m @returns {string} */
  components(v) {
    return v.map((x, k) => `${"xyz"[k]} ${this.long(x)}`).join(", ");
  }

  /** Return the measured figure, and what belongs to it. @param {import("./shapes.js").Measured | null} found @returns {[string, string]} */
  textsOf(found) {
    const [first] = this.clicked;
    if (found) {
      const [a, b] = this.clicked;
      const centres = ["", "from the centre", "centre to centre"][found.fromCentres];
      const angle = found.angle === null ? "" : `angle ${short((found.angle * 180) / Math.PI, 5)}°`;
      const radii = [...new Set([a, b].flatMap(({ radius }) => (radius === undefined ? [] : [this.long(radius)])))];
      const sizes = radii.length ? `radius ${radii.join(" and ")}` : "";
      return [this.long(found.distance), [centres, this.components(found.components), angle, sizes].filter(Boolean).join("; ")];
    }
    if (!first) return ["", ""];
    if (first.radius !== undefined) return [`⌀ ${this.long(2 * first.radius)}`, `radius ${this.long(first.radius)}, length ${this.long(first.length)}`];
    if (first.kind === "point") return ["Point", this.components(first.points[0])];
    return [this.long(first.length), `length; ${this.components(minus(/** @type {Vector} */ (first.points.at(-1)), first.points[0]))}`];
  }
}

/** Return the ends of a line, an arc or a curve, and the middle of a line. @param {Shape} shape @returns {Shape[]} */
function snapPoints({ kind, points }) {
  if (kind === "circle") return [];
  const [first, last] = [points[0], /** @type {Vector} */ (points.at(-1))];
  const ends = [first, last].map((at) => pointShape(at, `end of a${kind === "arc" ? "n" : ""} ${kind}`));
  return kind === "line" ? [...ends, pointShape(plus(first, minus(last, first), 0.5), "middle of a line")] : ends;
}

/** Return the centre of a circle or an arc. @param {Shape} shape @returns {Shape[]} */
function centresOf(shape) {
  const { kind, centre } = shape;
  return centre ? [{ ...pointShape(centre, `centre of a${kind === "arc" ? "n" : ""} ${kind}`), round: shape }] : [];
}

/** Return the mark of a shape under the pointer: its line, or its dot; of a centre a cross, and the line of its circle. @param {Shape} shape @param {(points: Vector[]) => number[][]} see */
function hoverPath({ kind, points, round }, see) {
  if (round) return crossOf(see(points), CROSS) + pathOf(see(round.points));
  return kind === "point" ? dotsOf(see(points), DOT) : pathOf(see(points));
}

/** Return in words what was picked. @param {Shape} shape */
const pickedName = ({ kind, of }) => of ?? kind;
/** Return the points that mark a clicked shape: its centre, or else its ends. @param {Shape} shape @returns {Vector[]} */
const marksOf = ({ kind, centre, points }) => (centre ? [centre] : kind === "point" ? points : [points[0], /** @type {Vector} */ (points.at(-1))]);

/** @param {Shape} shape @returns {Vector} */
const middleOf = ({ centre, points }) => centre ?? plus(points[0], minus(/** @type {Vector} */ (points.at(-1)), points[0]), 0.5);

/** Return the point of a surface at a place of a view. @param {View} view @param {number} x px @param {number} y px @returns {Shape | null} */
function surfacePoint(view, x, y) {
  const point = view.surface?.(x, y);
  return point ? pointShape(point, "free point of a surface") : null;
}

/** Return the point of a curve that is nearest on the screen. @param {View} view @param {Shape} shape @param {number} x px @param {number} y px @returns {Vector} */
function onCurve(view, { points }, x, y) {
  const seen = view.see(points);
  let [best, least] = [points[0], Infinity];
  for (let k = 0; k + 1 < points.length; k += 1) {
    const [share, away] = nearestOf(seen[k], seen[k + 1], x, y);
    if (away < least) [best, least] = [plus(points[k], minus(points[k + 1], points[k]), share), away];
  }
  return best;
}

/** Return the share of a piece at which it is nearest to a place, and the distance [px]. @param {number[]} a @param {number[]} b @param {number} x @param {number} y @returns {[number, number]} */
function nearestOf([ax, ay], [bx, by], x, y) {
  const [dx, dy] = [bx - ax, by - ay];
  const square = dx * dx + dy * dy;
  const share = square > 0 ? Math.min(1, Math.max(0, ((x - ax) * dx + (y - ay) * dy) / square)) : 0;
  return [share, Math.hypot(ax + share * dx - x, ay + share * dy - y)];
}

/** @param {number[][]} seen px @param {number} x @param {number} y @returns {number} px; infinite for a point */
function distanceTo(seen, x, y) {
  let least = Infinity;
  for (let k = 0; k + 1 < seen.length; k += 1) {
    const away = nearestOf(seen[k], seen[k + 1], x, y)[1];
    // A piece behind the eye has no place.
    if (away < least) least = away;
  }
  return least;
}

/** @param {number[][]} seen px @returns {string} */
const pathOf = (seen) => (seen.length > 1 && seen.every(([x]) => Number.isFinite(x)) ? `M${seen.map(([x, y]) => `${x.toFixed(1)} ${y.toFixed(1)}`).join("L")}` : "");

/** @param {number[][]} seen px @param {number} size half its width [px] @returns {string} */
const crossOf = (seen, size) => seen.filter(([x]) => Number.isFinite(x)).map(([x, y]) => `M${(x - size).toFixed(1)} ${y.toFixed(1)}h${2 * size}M${x.toFixed(1)} ${(y - size).toFixed(1)}v${2 * size}`).join("");

/** @param {number[][]} seen px @param {number} radius px @returns {string} */
const dotsOf = (seen, radius) => seen.filter(([x]) => Number.isFinite(x)).map(([x, y]) => `M${(x - radius).toFixed(1)} ${y.toFixed(1)}a${radius} ${radius} 0 1 0 ${2 * radius} 0a${radius} ${radius} 0 1 0 ${-2 * radius} 0`).join("");

/** @param {Element} ground @param {PointerEvent} event @returns {[number, number]} px */
function placeIn(ground, event) {
  const { left, top } = ground.getBoundingClientRect();
  return [event.clientX - left, event.clientY - top];
}

/** @type {Measure | null} */
let tool = null;

/** Return the measuring tool. @returns {Measure} */
export function measureOf() {
  if (!tool) throw new Error("The region measure has not started.");
  return tool;
}

/** Shapes of the last model, and from which frame and pose they are. @type {{frame: any, at: any, shapes: Shape[]}} */
let ofModel = { frame: null, at: null, shapes: [] };

/**
 * Return the shapes of the edges of a CAD model in the work frame.
 * @param {Store} store @returns {Shape[]}
 */
export function modelShapes(store) {
  const frame = store.latest("model");
  const at = store.document?.model?.at;
  if (!frame || !at || frame.head.sentence) return [];
  if (ofModel.frame === frame && ofModel.at === at) return ofModel.shapes;
  const { points, breaks } = frame.arrays;
  const shapes = frame.head.edges.map((/** @type {any} */ edge, /** @type {number} */ k) => {
    const line = [];
    for (let i = breaks[k]; i < breaks[k + 1]; i += 1) line.push(apply(at, Array.from(points.subarray(3 * i, 3 * i + 3))));
    return edgeShape(edge.kind, line);
  });
  ofModel = { frame, at, shapes };
  return shapes;
}

/** @param {string} kind @param {Vector[]} points @returns {Shape} */
function edgeShape(kind, points) {
  const last = /** @type {Vector} */ (points.at(-1));
  if (kind === "line") return lineShape(points[0], last);
  const lengths = points.slice(1).map((p, k) => length(minus(p, points[k])));
  const total = lengths.reduce((sum, x) => sum + x, 0);
  const third = Math.floor((points.length - 1) / 3);
  const round = kind === "circle" && third > 0 ? circleThrough(points[0], points[third], points[2 * third]) : null;
  if (!round) return { kind: "curve", points, length: total };
  const isWhole = length(minus(last, points[0])) < 1e-6 * round.radius;
  const angle = points.slice(1).reduce((sum, p, k) => sum + 2 * Math.asin(Math.min(1, length(minus(p, points[k])) / (2 * round.radius))), 0);
  return { kind: isWhole ? "circle" : "arc", points, length: round.radius * angle, ...round };
}

/** Signs of the corners of a box. */
const CORNERS = [[-1, -1], [1, -1], [1, 1], [-1, 1]];

/**
 * Return the edges of the obstacles in the work frame.
 * @param {Store} store @param {import("./vectors.js").Pose} work pose of the work in the frame of the floor @returns {Shape[]}
 */
export function obstacleShapes(store, work) {
  const back = inverse(work);
  return (store.document?.obstacles ?? []).flatMap((/** @type {any} */ body) => {
    const pose = compose(body.fixed_to === "part" ? IDENTITY : back, body.place);
    const at = (/** @type {Vector} */ p) => apply(pose, p);
    if (body.type === "box") return boxEdges(body.size).map(([a, b]) => lineShape(at(a), at(b)));
    const axis = unit(rotate(pose, [0, 0, 1]));
    if (body.type === "sphere") return [0, 1, 2].map((k) => circleShape(column(pose, 3), unit(column(pose, k)), body.radius));
    if (body.type !== "cylinder") return [];
    return [-1, 1].map((side) => circleShape(at([0, 0, (side * body.length) / 2]), axis, body.radius));
  });
}

/** @param {number[]} size m @returns {[Vector, Vector][]} */
function boxEdges(size) {
  const half = size.map((x) => x / 2);
  return [0, 1, 2].flatMap((k) => CORNERS.map(([a, b]) => {
    const [i, j] = [(k + 1) % 3, (k + 2) % 3];
    const end = (/** @type {number} */ side) => {
      const p = [0, 0, 0];
      [p[i], p[j], p[k]] = [a * half[i], b * half[j], side * half[k]];
      return p;
    };
    return /** @type {[Vector, Vector]} */ ([end(-1), end(1)]);
  }));
}

/** Return the projection of a point of the work frame to the plane of the picture [m]. @param {any} plane @param {Vector} p @returns {[number, number]} */
const toPlane = ({ origin, x, y }, p) => [dot(minus(p, origin), x), dot(minus(p, origin), y)];

/** @param {Store} store @param {Link} link @param {import("./pointer.js").Pointer} pointer */
export function init(store, link, pointer) {
  const { view } = pointer;
  const found = new Measure(store, link);
  tool = found;
  const plane = () => store.document?.part?.plane;
  found.add(
    {
      name: "2d",
      overlay: view.overlay,
      see: (points) => points.map((p) => (plane() ? pointer.screen(toPlane(plane(), p)) : [NaN, NaN])),
      isShown: () => store.options.stage !== "3d",
      shapes: () => found.drawn.shapes,
    },
    view.region,
    view.overlay,
  );
  view.followers.add(found.soon);
}

