// Obstacles in the drawing: move and resize them by drag or by arrow keys.

import { ask } from "./dialog.js";
import { draw, grip, mark, say } from "./dom.js";
import { tellEarly } from "./messages.js";
import { askBody, askMesh, showList } from "./obstacle_list.js";
import { lengthText } from "./units.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./pointer.js").Pointer} Pointer */
/**
 * An obstacle, in SI units; the file may have another unit. Its outline and axes in the plane are
 * relative to its position `uv`.
 * @typedef {{type: string, index: number, unit: [string, number], name?: string, at?: number[], size?: number[],
 *   radius?: number, fixed_to: string, uv: Point, outline: Point[], axes: Point[], plane: {x: number[], y: number[]}}} Obstacle `plane` is in the frame of `at`
 */
/** @typedef {[number, number]} Point */
/** What a drag of an obstacle changes. @typedef {"at" | "size"} What */

const NEW_SIDE = 60; // px
const LEAST_SIZE = 1e-3; // m
// Distance from the part to a new obstacle: a usual wrist radius plus the clearance.
const BESIDE = 0.14; // m
/** Remove rounding errors. @param {number} metres */
const round = (metres) => Number(metres.toFixed(9));

/** @param {number[]} a @param {number[]} b */
const dot = (a, b) => a.reduce((sum, x, k) => sum + x * (b[k] ?? 0), 0);

/** Return the corners of the outline in the plane [m]. @param {Obstacle} obstacle @returns {Point[]} */
const cornersOf = ({ uv, outline }) => outline.map(([u, v]) => [uv[0] + u, uv[1] + v]);

/** Return whether a point is inside a convex outline. @param {Point} point @param {Point[]} outline */
function isInside([x, y], outline) {
  const sides = outline.map(([a, b], k) => {
    const [c, d] = outline[(k + 1) % outline.length];
    return Math.sign((c - a) * (y - b) - (d - b) * (x - a));
  });
  return sides.every((side) => side > 0) || sides.every((side) => side < 0);
}

class Obstacles {
  /** @param {Store} store @param {Pointer} pointer */
  constructor(store, pointer) {
    this.store = store;
    this.link = pointer.link;
    this.view = pointer.view;
    this.pointer = pointer;
    this.group = draw("g", { class: "obstacles" });
    this.view.overlay.prepend(this.group);
    /** @type {{body: SVGGElement, shape: SVGElement, sizer: SVGGElement, held: Record<What, import("./pointer.js").Movable>}[]} */
    this.elements = [];
    /** Number of the obstacle that is being added; -1: none. */
    this.expected = -1;
    /** Whether a new obstacle is not in the 3D view yet. */
    this.isNew = false;
    store.on("arm", () => this.showNew());
    showList(store, this.link, { add: (type) => this.add(type), addMesh: (file) => this.addMesh(file) });
    store.on("mesh", (/** @type {File} */ file) => this.addMesh(file));
    store.on("view", () => this.place());
    store.on("document", () => {
      this.place();
      this.selectNew();
    });
    this.view.followers.add(() => this.place());
  }

  /** Return the plane of the picture in the base frame. @returns {any} */
  get plane() {
    return this.store.latest("picture") && this.store.document?.plane;
  }

  /** Return the obstacles as drawn: a dragged one at the pointer. @returns {Obstacle[]} */
  list() {
    return this.view.drawnObstacles.map((/** @type {Obstacle} */ body, /** @type {number} */ k) => {
      const { x, y } = body.plane;
      const { at, size } = this.elements[k]?.held ?? {};
      const held = at && this.pointer.held(at);
      const by = held?.map((value, j) => value - (body.at?.[j] ?? 0)) ?? [0, 0, 0];
      const uv = /** @type {Point} */ ([body.uv[0] + dot(by, x), body.uv[1] + dot(by, y)]);
      return { ...body, uv, at: held ?? body.at, size: (size && this.pointer.held(size)) ?? body.size };
    });
  }

  /** Usual length of a new obstacle [m]. */
  get side() {
    return Number((NEW_SIDE / this.view.view.scale).toPrecision(1));
  }

  /** Ask for an obstacle of a kind, and add it. @param {string} type */
  async add(type) {
    if (!this.isReady()) return;
    this.put(await askBody(type, this.side));
  }

  /** Add the mesh of a file. @param {File} file */
  async addMesh(file) {
    if (!this.isReady()) return;
    this.put(await askMesh(this.link, file));
  }

  /** Return whether obstacles have a plane on which they stand; tells if they have none. */
  isReady() {
    if (this.plane && this.view.box) return true;
    tellEarly("No obstacle can be added yet: no path has been shown.");
    return false;
  }

  /** Add an obstacle that stands on the plane next to the part, where no other obstacle is. @param {import("./obstacle_list.js").Body | null} body null: cancelled */
  put(body) {
    const { box } = this.view;
    if (!body || !box) return;
    const { high, ...keys } = body;
    const [wide = 2 * (body.radius ?? this.side / 2), deep = wide] = body.size ?? [];
    const side = Math.max(wide, deep);
    const spot = this.spotBeside(box, side);
    // The new obstacle is selected, so that it can be placed.
    this.expected = this.store.document.obstacles.length;
    this.link.edit([{ do: "obstacle", action: "add", ...keys, at: this.lift(spot, high, 1e-3) }]);
  }

  /** Select a new obstacle when the document has it, and none that is no longer there. */
  selectNew() {
    const { options, document } = this.store;
    const count = document?.obstacles?.length ?? 0;
    if (this.expected >= 0 && count > this.expected) {
      const obstacle = this.expected;
      this.expected = -1;
      this.isNew = true;
      return this.store.setView({ obstacle, tool: "obstacles", pen: "" });
    }
    if (options.obstacle >= count) this.store.setView({ obstacle: -1 });
  }

  /** Show a new obstacle in both views. */
  showNew() {
    if (!this.isNew) return;
    this.isNew = false;
    this.store.tell("fit");
  }

  /**
   * Return a free place next to the part, far from the base, because the arm has most room there.
   * @param {import("./viewport.js").Box} box of the part, from its middle @param {number} side m @returns {Point} m
   */
  spotBeside({ left, right, bottom, top }, side) {
    const [u, v] = this.pointer.centre;
    const { origin, x, y } = this.plane;
    const away = side / 2 + BESIDE;
    const far = (/** @type {Point} */ [a, b]) => Math.hypot(dot(origin, x) + a, dot(origin, y) + b);
    const spots = [[1, 0], [-1, 0], [0, 1], [0, -1]].map(
      ([a, b]) => /** @type {Point} */ ([u + (left + right) / 2 + a * ((right - left) / 2 + away), v + (bottom + top) / 2 + b * ((top - bottom) / 2 + away)]),
    );
    spots.sort((p, q) => far(q) - far(p));
    const others = this.list().flatMap(cornersOf);
    return spots.find(([a, b]) => others.every((p) => Math.abs(p[0] - a) > side || Math.abs(p[1] - b) > side)) ?? spots[0];
  }

  /** Ask for another name of an obstacle. @param {Obstacle} obstacle */
  async rename({ index, name = "" }) {
    const answer = await ask("Obstacle", "Name", name);
    if (answer && answer !== name) this.link.edit([{ do: "obstacle", action: "change", index, name: answer }]);
  }

  /** Return the point in space of a point in the plane, with round coordinates. @param {Point} uv @param {number} above m @param {number} step m @returns {number[]} */
  lift([u, v], above, step) {
    const { origin, x, y, normal } = this.plane;
    return [0, 1, 2].map((k) => round(step * Math.round((origin[k] + u * x[k] + v * y[k]) / step) + above * normal[k]));
  }

  place() {
    const { plane } = this;
    const obstacles = plane ? this.list() : [];
    for (const { body, sizer } of this.elements.splice(obstacles.length)) for (const x of [body, sizer]) x.remove();
    while (this.elements.length < obstacles.length) this.elements.push(this.make(this.elements.length));
    obstacles.forEach((obstacle, k) => this.placeOne(obstacle, this.elements[k]));
  }

  /** @param {Obstacle} obstacle @param {{body: SVGGElement, shape: SVGElement, sizer: SVGGElement}} element */
  placeOne(obstacle, { body, shape, sizer }) {
    sizer.toggleAttribute("hidden", obstacle.type !== "box");
    body.classList.toggle("selected", obstacle.index === this.store.options.obstacle);
    const points = cornersOf(obstacle).map((p) => this.pointer.screen(p));
    mark(shape, "points", points.map((p) => p.map((x) => x.toFixed(1)).join()).join(" "));
    const corner = points.reduce((best, p) => (p[0] - p[1] > best[0] - best[1] ? p : best));
    mark(sizer, "transform", `translate(${corner[0].toFixed(1)} ${corner[1].toFixed(1)})`);
    const at = obstacle.at ?? [0, 0, 0];
    const label = /** @type {Element} */ (body.lastElementChild);
    say(label, obstacle.name ?? "");
    mark(label, "transform", `translate(${points[0][0].toFixed(1)} ${(Math.max(...points.map((p) => p[1])) + 14).toFixed(1)})`);
    // What is out of view is no stop of the Tab key; the list of obstacles has it.
    const { width, height } = this.view.view;
    const isInView = points.some(([x, y]) => x > 0 && y > 0 && x < width && y < height);
    const { options } = this.store;
    // Around the whole part, a body is ground: a drag there pans. The tool Obstacles and the list select it.
    const isGround = options.tool !== "obstacles" && obstacle.index !== options.obstacle && this.surroundsPart(points);
    body.classList.toggle("ground", isGround);
    for (const grip of [body, sizer]) mark(grip, "tabindex", isInView ? "0" : "-1");
    mark(body, "aria-label", `Obstacle ${obstacle.name ?? obstacle.index + 1}`);
    mark(body, "aria-valuetext", `at ${at.map((x) => lengthText(x, 1)).join(", ")}`);
    mark(body, "aria-valuenow", String(Math.round(1000 * at[0])));
    mark(sizer, "aria-label", `Size of obstacle ${obstacle.name ?? obstacle.index + 1}`);
    mark(sizer, "aria-valuetext", (obstacle.size ?? []).map((x) => lengthText(x, 1)).join(" by "));
    mark(sizer, "aria-valuenow", String(Math.round(1000 * (obstacle.size?.[0] ?? 0))));
  }

  /** Return whether an outline surrounds the whole part. @param {Point[]} outline px */
  surroundsPart(outline) {
    const { box, view } = this.view;
    if (!box) return false;
    const { left, right, bottom, top } = box;
    const corners = /** @type {Point[]} */ ([[left, bottom], [right, bottom], [right, top], [left, top]]);
    return corners.every((corner) => isInside(view.toScreen(corner), outline));
  }

  /** @param {number} k */
  make(k) {
    const body = draw("g", { class: "handle obstacle", role: "slider", tabindex: 0, "aria-valuenow": 0 });
    const shape = draw("polygon", { class: "seen" });
    const name = draw("text", { class: "obstacle-name", "aria-hidden": "true" });
    body.append(shape, name);
    const sizer = grip({ class: "handle sizer" }, [draw("rect", { x: -4, y: -4, width: 8, height: 8, class: "seen" })]);
    this.group.append(body, sizer);
    /** @type {Obstacle} obstacle when it was grabbed */
    let from;
    const movable = (/** @type {What} */ what, /** @type {string[]} */ names, /** @type {number} */ least, /** @type {(du: number, dv: number) => number[]} */ moved) => ({
      ...(least && { least }),
      start: () => {
        from = this.list()[k];
        return { names, unit: from.unit, values: from[what] ?? (what === "at" ? [0, 0, 0] : null) };
      },
      moved: (/** @type {Point} */ by) => moved(...by),
      edits: (/** @type {number[]} */ values) => [{ do: "obstacle", action: "change", index: from.index, [what]: values }],
    });
    const held = {
      at: movable("at", ["x", "y", "z"], 0, (du, dv) => this.moved(from, du, dv)),
      size: movable("size", ["size", "by", "by"], LEAST_SIZE, (du, dv) => this.sized(from, du, dv)),
    };
    // A contour over a body is selected first: the drawing gets the click.
    const isPath = (/** @type {MouseEvent} */ event) => this.view.pathAt(event) >= 0;
    this.pointer.movable(body, held.at, isPath);
    body.addEventListener("mousedown", (event) => isPath(event) && event.preventDefault());
    this.pointer.movable(sizer, held.size);
    body.addEventListener("dblclick", () => this.rename(this.list()[k]));
    body.addEventListener("focus", () => this.store.setView({ obstacle: this.list()[k].index, contour: -1 }));
    body.addEventListener("keydown", (event) => {
      const obstacle = this.list()[k];
      if (event.key === "F2") this.rename(obstacle);
      else if (event.key === "Delete" || event.key === "Backspace") this.store.tell("remove obstacle", obstacle.index);
      else return;
      event.preventDefault();
    });
    return { body, shape, sizer, held };
  }

  /** @param {Obstacle} from @param {number} du @param {number} dv @returns {number[]} m */
  moved({ at = [0, 0, 0], plane }, du, dv) {
    const { x, y } = plane;
    return [0, 1, 2].map((k) => round((at[k] ?? 0) + du * x[k] + dv * y[k]));
  }

  /** Return the size for a moved grip; the middle stays. @param {Obstacle} from @param {number} du @param {number} dv @returns {number[]} m */
  sized(from, du, dv) {
    // The grip is at the corner farthest to the lower right.
    return from.axes.map(([u, v], k) => (from.size?.[k] ?? 0) + 2 * (du * u + dv * v) * Math.sign(u - v));
  }
}

/** @param {Store} store @param {import("./connection.js").Link} _link @param {Pointer} pointer */
export function init(store, _link, pointer) {
  new Obstacles(store, pointer);
}
