// Obstacles in the drawing: move and resize them by drag or by arrow keys.

import { show } from "./dialog.js";
import { draw, find, grip, make, mark, say } from "./dom.js";
import { mm } from "./format.js";
import { tellEarly } from "./messages.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./pointer.js").Pointer} Pointer */
/**
 * An obstacle on the base, in SI units; the file may have another unit. Its outline and axes in the plane are
 * relative to its position `uv`.
 * @typedef {{type: string, index: number, unit: [string, number], name?: string, at?: number[], size?: number[],
 *   uv: Point, outline: Point[], axes: Point[]}} Obstacle
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
    find("#add-obstacle").addEventListener("click", () => this.add());
    store.on("document", () => this.place());
    this.view.followers.add(() => this.place());
  }

  /** Return the plane of the picture in the base frame. @returns {any} */
  get plane() {
    return this.store.latest("picture") && this.store.document?.plane;
  }

  /** Return the obstacles as drawn: a dragged one at the pointer. @returns {Obstacle[]} */
  list() {
    const { x, y } = this.plane;
    const all = this.store.document.obstacles.filter((/** @type {Obstacle} */ body) => body.outline);
    return all.map((/** @type {Obstacle} */ body, /** @type {number} */ k) => {
      const { at, size } = this.elements[k]?.held ?? {};
      const held = at && this.pointer.held(at);
      const by = held?.map((value, j) => value - (body.at?.[j] ?? 0)) ?? [0, 0, 0];
      const uv = [body.uv[0] + dot(by, x), body.uv[1] + dot(by, y)];
      return { ...body, uv, at: held ?? body.at, size: (size && this.pointer.held(size)) ?? body.size };
    });
  }

  /** Add a box that stands on the plane next to the part, where no other obstacle is. */
  async add() {
    const { box, view } = this.view;
    if (!this.plane || !box) return tellEarly("No obstacle can be added yet: no path has been shown.");
    const side = Number((NEW_SIDE / view.scale).toPrecision(1));
    const answer = await this.ask("Add an obstacle", "box", side);
    if (!answer) return;
    const { name, height = side } = answer;
    const spot = this.spotBeside(box, side);
    this.link.edit([{ do: "obstacle", action: "add", type: "box", name, size: [side, side, height], at: this.lift(spot, height / 2, 1e-3) }]);
    const [u, v] = spot.map((x, k) => x - this.pointer.centre[k]);
    view.fit({ left: Math.min(box.left, u - side), right: Math.max(box.right, u + side), bottom: Math.min(box.bottom, v - side), top: Math.max(box.top, v + side) });
    this.view.moved();
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

  /**
   * Ask for the name and height of an obstacle. @param {string} title @param {string} name @param {number} [height] m
   * @returns {Promise<{name: string, height?: number} | null>} null: cancelled
   */
  async ask(title, name, height) {
    const field = (/** @type {string} */ text, /** @type {Record<string, any>} */ how) => make("label", { class: "field", text }, [make("input", how)]);
    const fields = [field("Name", { type: "text", value: name, required: true })];
    if (height !== undefined) fields.push(field("Height [mm]", { type: "number", min: 1, step: "any", value: mm(height, 2).replace(/\.?0+$/, "") }));
    const answer = await show(title, fields, [{ value: "ok", text: "OK" }, { value: "", text: "Cancel" }]);
    const [named, high] = fields.map((x) => /** @type {HTMLInputElement} */ (x.lastChild).value);
    if (answer !== "ok") return null;
    return { name: named.trim() || name, ...(high && { height: Number((Number(high) / 1000).toPrecision(12)) }) };
  }

  /** Ask for another name and height of an obstacle; its bottom stays. @param {Obstacle} obstacle */
  async change({ type, index, name = "", size, at = [0, 0, 0] }) {
    const answer = await this.ask("Obstacle", name, type === "box" ? size?.[2] : undefined);
    if (!answer) return;
    const { height } = answer;
    const grown = height !== undefined && size ? { size: [size[0], size[1], height], at: [at[0], at[1], round(at[2] + (height - size[2]) / 2)] } : {};
    this.link.edit([{ do: "obstacle", action: "change", index, name: answer.name, ...grown }]);
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
    const points = cornersOf(obstacle).map((p) => this.pointer.screen(p));
    mark(shape, "points", points.map((p) => p.map((x) => x.toFixed(1)).join()).join(" "));
    const corner = points.reduce((best, p) => (p[0] - p[1] > best[0] - best[1] ? p : best));
    mark(sizer, "transform", `translate(${corner[0].toFixed(1)} ${corner[1].toFixed(1)})`);
    const at = obstacle.at ?? [0, 0, 0];
    const label = /** @type {Element} */ (body.lastElementChild);
    say(label, obstacle.name ?? "");
    mark(label, "transform", `translate(${points[0][0].toFixed(1)} ${(Math.max(...points.map((p) => p[1])) + 14).toFixed(1)})`);
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
    this.pointer.movable(body, held.at);
    this.pointer.movable(sizer, held.size);
    body.addEventListener("dblclick", () => this.change(this.list()[k]));
    body.addEventListener("keydown", (event) => {
      const obstacle = this.list()[k];
      if (event.key === "F2") this.change(obstacle);
      else if (event.key === "Delete" || event.key === "Backspace") this.link.edit([{ do: "obstacle", action: "remove", index: obstacle.index }]);
      else return;
      event.preventDefault();
    });
    return { body, shape, sizer, held };
  }

  /** @param {Obstacle} from @param {number} du @param {number} dv @returns {number[]} m */
  moved({ at = [0, 0, 0] }, du, dv) {
    const { x, y } = this.plane;
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
