// Drawing layers of the newest frames, cached until the frame, the theme or an option changes.

import { largest, magnified, PieceGrid, polyline, scaleOf, startsOf, strokesByHeat, strokesByLimit } from "./polylines.js";
import { indexAt } from "./state.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */

const FACTORS = [1, 2, 5, 10, 20, 50, 100, 200, 500, 1000, 2000, 5000, 10_000, 20_000, 50_000, 100_000];
// Wished size of the magnified error on the screen; the factor changes if the size leaves the range.
const WISHED = 34; // px
const TOO_SMALL = 13;
const TOO_LARGE = 70;

// A picture with more coordinates is drawn without invisible details, and moved as a bitmap until the view rests.
const MANY = 12_000;
const LEAST = 1.5; // px
// Largest distance between a line and the part that it marks.
const ASIDE = 8; // px

export class Layers {
  /** @param {Store} store @param {import("./viewport.js").Viewport} view */
  constructor(store, view) {
    this.store = store;
    this.view = view;
    /** @type {Map<string, {keys: any[], value: any}>} */
    this.kept = new Map();
    this.factor = 1;
  }

  /**
   * Return a cached value, which is made again only if one of its keys has changed.
   * @template T
   * @param {string} name @param {any[]} keys @param {() => T} make @returns {T}
   */
  keep(name, keys, make) {
    const found = this.kept.get(name);
    if (found && found.keys.every((key, i) => key === keys[i])) return found.value;
    const value = make();
    this.kept.set(name, { keys, value });
    return value;
  }

  /**
   * Return lines by name: the objective, contours with a kerf as drawn, contours that are not run, or rapids.
   * @param {Frame} picture @param {"objective" | "drawn" | "rapid" | "left_out"} name @returns {Path2D}
   */
  lines(picture, name) {
    const { [name]: points = new Float32Array(0), [`${name}_breaks`]: breaks } = picture.arrays;
    const { part } = this;
    return this.keep(name, [points, part], () => polyline(points, breaks, part));
  }

  /** True if the picture takes long to draw. */
  get large() {
    const arrays = this.store.latest("picture")?.arrays;
    return arrays ? arrays.path.length + arrays.objective.length > MANY : false;
  }

  /** Return the drawn part of a large picture; null: all of it. @returns {import("./polylines.js").Part | null} */
  get part() {
    const { width, height, u, v, scale } = this.view;
    if (!this.large) return null;
    return this.keep("part", [width, height, u, v, scale], () => {
      const [left, top] = this.view.toPlane([-ASIDE, -ASIDE]);
      const [right, bottom] = this.view.toPlane([width + ASIDE, height + ASIDE]);
      return { left, right, bottom, top, least: LEAST / scale };
    });
  }

  /** Return the index of the path piece nearest to a point, or -1. @param {Frame} picture @param {[number, number]} uv m @param {number} near m */
  nearest(picture, [u, v], near) {
    return this.keep("grid", [picture], () => new PieceGrid(picture.arrays.path, startsOf(picture))).nearest(u, v, near);
  }

  /** Return a refused path, and its refused contour. @param {Frame} refusal @returns {{path: Path2D, contour: Path2D}} */
  refused(refusal) {
    const { part } = this;
    const isPlaced = String(refusal.head.outline.centre) === String(this.store.latest("picture")?.head.centre);
    return this.keep("refused", [refusal, part, isPlaced], () => {
      const { objective: points, objective_breaks: breaks } = refusal.arrays;
      const { at, outline } = refusal.head;
      const place = at.uv?.map((/** @type {number} */ x, /** @type {number} */ k) => x - outline.centre[k]);
      const piece = place ? new PieceGrid(points, new Set(breaks)).nearest(place[0], place[1], Infinity) : -1;
      const line = indexAt(breaks, Math.max(0, piece));
      const contour = points.subarray(2 * breaks[line], piece < 0 ? 0 : 2 * breaks[line + 1]);
      return { path: polyline(points, breaks, isPlaced ? part : null), contour: polyline(contour) };
    });
  }

  /** Return the cut parts of the tool path, by kerf. @param {Frame} picture @returns {{kerf: number, path: Path2D}[]} */
  cuts(picture) {
    const { cut, cut_breaks: breaks } = picture.arrays;
    return this.keep("cuts", [picture], () =>
      picture.head.kerfs.map((/** @type {number} */ kerf, /** @type {number} */ k) => ({
        kerf,
        path: polyline(cut.subarray(2 * breaks[k], 2 * breaks[k + 1]), []),
      })),
    );
  }

  /** Return the path in its colours. @param {Frame} picture @param {Frame | null} executed */
  strokes(picture, executed) {
    const { theme, options } = this.store;
    const errors = options.colour === "error" ? executed : null;
    const { part } = this;
    return this.keep("strokes", [picture, errors, theme, options.colour, part], () => {
      if (errors) {
        const { base, off, breaks } = errors.arrays;
        return strokesByHeat(base, off, scaleOf(errors), theme, new Set(breaks), null);
      }
      if (options.colour !== "speed") return strokesByLimit(picture, theme, part);
      return strokesByHeat(picture.arrays.path, picture.arrays.speed, this.most("picture", "speed"), theme, startsOf(picture), part);
    });
  }

  /** Return a contour of the path, or an empty path. @param {Frame} picture @param {number} k */
  contour(picture, k) {
    const { path, path_breaks: breaks } = picture.arrays;
    return this.keep("contour", [picture, k], () => polyline(path.subarray(2 * breaks[k], 2 * breaks[k + 1]), []));
  }

  /** Return the tool path of an executed motion. @param {Frame} moved @param {number} factor */
  executed(moved, factor) {
    return this.keep(moved.kind, [moved, factor], () => magnified(moved, factor));
  }

  /** Return the largest value of an array in the newest frame of a kind. @param {string} kind @param {string} name @returns {number} */
  most(kind, name) {
    const frame = this.store.latest(kind);
    return this.keep(`most ${kind} ${name}`, [frame], () => largest(frame?.arrays[name] ?? []));
  }

  /**
   * Return the factor by which errors are magnified, so that the largest is well visible.
   * @param {number} scale px per m @returns {number}
   */
  magnification(scale) {
    this.factor = magnificationOf(this.most("executed", "error") * scale, this.factor);
    return this.factor;
  }
}

/**
 * Return the factor by which errors are magnified, so that the largest is well visible; it stays while it is good enough.
 * @param {number} most largest error on the screen [px] @param {number} now the factor until now @returns {number}
 */
export function magnificationOf(most, now) {
  if (most * now >= TOO_SMALL && most * now <= TOO_LARGE) return now;
  return FACTORS.findLast((factor) => most * factor <= WISHED) ?? 1;
}
