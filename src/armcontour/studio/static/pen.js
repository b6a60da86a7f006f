// The pen: lines, arcs, circles and rectangles that are drawn at the end of the path, or on an empty plane.

import { draw, find, make, mark, say } from "./dom.js";
import { isOnPath } from "./handles.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./pointer.js").Pointer} Pointer */
/** @typedef {[number, number]} Point */
/**
 * A shape in coordinates of the file [m]: the names of its values, which are the coordinates of a point if `isPoint`; its start
 * and segments, computed from the pressed point and the values; and the radius with which it is drawn before the answer.
 * @typedef {{names: string[], isPoint?: boolean, start?: (from: Point, values: number[]) => Point,
 *   segments: (from: Point, values: number[]) => Record<string, Point>[], radius?: (from: Point, values: number[]) => number}} Shape
 */

// A shape that starts this near to the end of the path starts at the end.
const NEAR = 14; // px
/** Shorter segments and sides are not drawn. */
const LEAST = 1e-6; // m
/** Height of a new arc divided by its chord; the user changes it with the middle waypoint. */
const BULGE = 1 / 4;
/** @type {Record<string, Shape>} */
const SHAPES = {
  Line: { names: ["x", "y"], isPoint: true, segments: (_, [x, y]) => [{ to: [x, y] }] },
  Arc: {
    names: ["x", "y"],
    isPoint: true,
    segments: ([a, b], [x, y]) => [{ via: [(a + x) / 2 + BULGE * (y - b), (b + y) / 2 - BULGE * (x - a)], to: [x, y] }],
    radius: ([a, b], [x, y]) => ((1 + 4 * BULGE ** 2) / (8 * BULGE)) * Math.hypot(x - a, y - b),
  },
  Circle: { names: ["radius"], start: ([a, b], [radius]) => [a + radius, b], segments: (center) => [{ center }], radius: (_, [radius]) => radius },
  Rectangle: { names: ["width", "height"], segments: ([a, b], [wide, high]) => [{ to: [a + wide, b] }, { to: [a + wide, b + high] }, { to: [a, b + high] }, { to: [a, b] }] },
};

/** Return whether shapes can be added to the path. @param {Store} store @returns {boolean} */
export const canDraw = ({ document }) => Boolean(document?.path?.editable);

/** @param {Store} store @param {import("./connection.js").Link} _link @param {Pointer} pointer */
export function init(store, _link, pointer) {
  const { view } = pointer;
  const ground = draw("rect", { class: "pen", width: "100%", height: "100%", tabindex: 0, role: "slider", "aria-valuenow": 0 });
  const trace = draw("path", { class: "pen-trace" });
  const hint = make("p", { class: "hint quiet" });
  view.region.append(hint);
  view.overlay.append(trace, ground);
  /** The shape being drawn, and its start. */
  let shape = SHAPES.Line;
  /** @type {Point} */
  let from = [0, 0];
  const startOf = (/** @type {number[]} */ values) => shape.start?.(from, values) ?? from;

  /** Return the end of the path if it is near, or with keys; otherwise a round position. @param {PointerEvent | KeyboardEvent} event @returns {Point} */
  const placeOf = (event) => {
    const last = store.document.waypoints.findLast((/** @type {any} */ x) => isOnPath(x.role))?.uv;
    const uv = event instanceof KeyboardEvent ? (last ?? pointer.centre) : pointer.plane(event);
    const away = last ? pointer.screen(last).map((x, k) => x - pointer.screen(uv)[k]) : [Infinity];
    return Math.hypot(...away) < NEAR ? pointer.local(last) : /** @type {Point} */ (pointer.rounded(pointer.local(uv), event));
  };

  /** Return a shape as a path on the screen. @param {number[]} values */
  const outline = (values) => {
    const at = (/** @type {Point} */ xy) => pointer.screen(pointer.global(xy)).join(" ");
    const radius = (shape.radius?.(from, values) ?? 0) * view.view.scale;
    const [a, b] = from;
    const lines = shape.segments(from, values).map(({ to, via, center }) => {
      const arc = (/** @type {Point} */ end, /** @type {0 | 1} */ long = 0) => `A${radius} ${radius} 0 ${long} 0 ${at(end)}`;
      return center ? arc([a - values[0], b], 1) + arc([a + values[0], b], 1) : via ? arc(to) : `L${at(to)}`;
    });
    return `M${at(startOf(values))}${lines.join("")}`;
  };

  /** @type {import("./pointer.js").Movable} */
  const pen = {
    start: (event) => {
      const unit = store.document?.path.unit;
      if (!store.options.pen) return { names: [], unit, values: null };
      shape = SHAPES[store.options.pen];
      from = placeOf(event);
      const { names, isPoint } = shape;
      return { names, unit, values: isPoint ? from : names.map(() => 0) };
    },
    lacks: (values) => {
      const { names, isPoint } = shape;
      if (isPoint) return Math.hypot(values[0] - from[0], values[1] - from[1]) > LEAST ? "" : "The segment ends where it starts: move its end, or type x, y.";
      const missing = names.filter((_, k) => Math.abs(values[k]) <= LEAST).join(" and ");
      return missing && `The ${names.length > 1 ? "rectangle" : "circle"} has no ${missing} yet: use more arrow keys, or type ${names.join(", ")}.`;
    },
    moved: (by, start) => {
      const way = pointer.turned(by);
      return start.length === 1 ? [Math.hypot(...way)] : start.map((x, k) => x + way[k]);
    },
    edits: (values) => {
      const segments = shape.segments(from, values).map((segment) => Object.fromEntries(Object.entries(segment).map(([key, xy]) => [key, pointer.global(xy)])));
      return [{ do: "draw", start: pointer.global(startOf(values)), segments }];
    },
    // A path may continue; after a complete shape, the user needs its handles.
    end: (edits) => edits.length && !shape.isPoint && store.setView({ pen: "" }),
  };
  pointer.movable(ground, pen);
  view.followers.add(() => {
    const values = pointer.held(pen);
    mark(trace, "d", values ? outline(values) : "");
  });

  let id = "";
  const update = () => {
    const { path = {}, sentence, id: now = "" } = store.document ?? {};
    const isBlank = path.kind === "blank";
    if (now !== id || !canDraw(store)) {
      id = now;
      // On an empty plane, the user needs the pen first.
      const first = isBlank ? "Rectangle" : "";
      if (first !== store.options.pen) return store.setView({ pen: first });
    }
    const chosen = store.options.pen;
    hint.hidden = !isBlank;
    say(hint, sentence ?? "");
    // When the pen is switched off, its button keeps the focus.
    const name = Object.keys(SHAPES).find((x) => SHAPES[x] === shape);
    if (!chosen && document.activeElement === ground) find(`#viewbar [aria-label=${name}]`).focus();
    ground.toggleAttribute("hidden", !chosen);
    mark(ground, "aria-label", `Pen: ${chosen}`);
  };
  for (const event of ["document", "view"]) store.on(event, update);
}
