// Handles over the drawing: waypoints, apexes of corners, the middles of lines where a waypoint may be
// inserted. A handle follows the pointer at once; what the server answers is drawn when it comes.

import { along, apexAt, beyond, handledOf, LEAST_TOLERANCE, toleranceEdits, wordsOf } from "./corner.js";
import { draw, mark } from "./dom.js";
import { mm } from "./format.js";
import { Pointer } from "./pointer.js";
import { oncePerFrame } from "./state.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {[number, number]} Point */
/**
 * Something to grab: `at` says where it is (metres in the plane, null: not there).
 * @typedef {Object} Handle
 * @property {SVGGElement} element
 * @property {() => Point | null} at
 * @property {() => void} describe   sets what is read aloud
 * @property {() => any} [corner]    the corner whose apex it is
 * @property {(to: Point) => object[]} [edits]   what its edits are when it is moved to a place
 * @property {number} [inserts]      the waypoint that it inserts
 */

// Beyond this number only handles in view are made.
const MOST_HANDLES = 300;
/** No waypoint that is to have the focus. */
const NOTHING = { index: -1, seq: Infinity, count: 0 };

export class Handles {
  /** @param {Store} store @param {Link} link @param {View2d} view */
  constructor(store, link, view) {
    this.store = store;
    this.link = link;
    this.view = view;
    this.pointer = new Pointer(store, link, view);
    this.polygon = draw("polyline", { class: "polygon", "aria-hidden": "true" });
    this.groups = ["middle", "corner", "waypoint"].map((name) => draw("g", { class: name }));
    view.overlay.append(this.polygon, ...this.groups);
    /** @type {Map<string, Handle>} */
    this.handles = new Map();
    /** Places of handles that were moved and are not yet in the document, by name. @type {Map<string, {at: Point, seq: number}>} */
    this.held = new Map();
    this.inserted = NOTHING;
    store.on("document", (/** @type {any} */ frame) => this.answered(frame));
    store.on("picture", (/** @type {any} */ frame) => this.answered(frame ?? { kind: "picture", seq: null }));
    // What was not made is not shown.
    store.on("link", (/** @type {any} */ link) => {
      if (link.state === "open") return;
      this.held.clear();
      this.place();
    });
    store.on("refusal", (/** @type {any} */ frame) => frame && this.answered(frame));
    view.followers.add(() => this.place());
  }

  /** The server knows of the change: its places are used again. @param {import("./state.js").Frame} frame */
  answered(frame) {
    for (const [name, { seq }] of this.held) {
      const corner = name.startsWith("corner");
      if (frame.kind !== "refusal" && (frame.kind === "picture") !== corner) continue;
      if (frame.seq === null || frame.seq >= seq) this.held.delete(name);
    }
    this.build();
    this.place();
    if (frame.kind !== "document" || frame.seq === null || frame.seq < this.inserted.seq) return;
    const { index, count } = this.inserted;
    if (this.store.document.waypoints.length > count) this.handles.get(`waypoint ${index}`)?.element.focus();
    this.inserted = NOTHING;
  }

  /** A waypoint that is being inserted has the focus once it is there. @param {number} index */
  expect(index) {
    this.inserted = { index, seq: this.link.seq, count: this.store.document.waypoints.length };
  }

  /** The handles of the document and the picture: elements stay, so that the focus stays. */
  build() {
    const wanted = new Set();
    for (const { index, role } of this.waypoints()) {
      wanted.add(this.ensure(`waypoint ${index}`, 2, () => this.waypoint(index)));
      if (isOnPath(role) && insertable(this.store.document, index)) wanted.add(this.ensure(`middle ${index}`, 0, () => this.middle(index)));
    }
    for (const corner of this.corners())
      wanted.add(this.ensure(`corner ${corner.index}`, 1, () => this.corner(corner.index)));
    for (const [name, handle] of this.handles) {
      if (wanted.has(name)) continue;
      handle.element.remove();
      this.handles.delete(name);
    }
    for (const handle of this.handles.values()) handle.describe();
  }

  /** @param {string} name @param {number} group @param {() => Handle} make @returns {string} */
  ensure(name, group, make) {
    if (!this.handles.has(name)) {
      const handle = make();
      this.handles.set(name, handle);
      this.groups[group].append(handle.element);
    }
    return name;
  }

  /** Waypoints that can be moved. @returns {{index: number, uv: Point, written: string[], role?: string, why_not?: string}[]} */
  waypoints() {
    const found = this.store.document;
    if (!found?.path?.editable) return [];
    // The view is fitted to the first picture: until then a handle would be elsewhere.
    if (!this.store.latest("picture") && !this.store.refusal) return [];
    const movable = found.waypoints.filter((/** @type {any} */ x) => !x.why_not);
    return movable.length <= MOST_HANDLES
      ? movable
      : movable.filter((/** @type {any} */ x) => this.inView(x.uv)).slice(0, MOST_HANDLES);
  }

  /** Rounded corners. @returns {any[]} */
  corners() {
    const seen = handledOf(this.store.latest("picture"));
    return seen.length <= MOST_HANDLES
      ? seen
      : seen.filter((/** @type {any} */ x) => this.inView(x.apex)).slice(0, MOST_HANDLES);
  }

  /** @param {Point} uv @returns {boolean} */
  inView(uv) {
    const [x, y] = this.pointer.screen(uv);
    return x > 0 && y > 0 && x < this.view.view.width && y < this.view.view.height;
  }

  /** Where a waypoint is shown. @param {number} index @returns {Point | null} */
  waypointAt(index) {
    const held = this.held.get(`waypoint ${index}`);
    return held?.at ?? this.store.document?.waypoints[index]?.uv ?? null;
  }

  /** @param {number} index @returns {Handle} */
  waypoint(index) {
    const element = this.shape("waypoint", index, [draw("circle", { r: 6, class: "seen" })]);
    const handle = {
      element,
      at: () => this.waypointAt(index),
      edits: (/** @type {Point} */ to) => [{ do: "move_waypoint", index, to }],
      describe: () => this.describeWaypoint(element, index),
    };
    element.addEventListener("keydown", (event) => this.waypointKey(event, index));
    return this.movable(`waypoint ${index}`, handle);
  }

  /** @param {SVGGElement} element @param {number} index */
  describeWaypoint(element, index) {
    const at = this.waypointAt(index);
    if (!at) return;
    mark(element, "aria-valuenow", String(Math.round(1000 * at[0] * 10) / 10));
    mark(element, "aria-valuetext", `x ${mm(at[0], 1)} mm, y ${mm(at[1], 1)} mm`);
  }

  /** Insert after, or remove. @param {KeyboardEvent} event @param {number} index */
  waypointKey(event, index) {
    const insert = event.key === "Insert" || event.key === "+";
    if (!insert && event.key !== "Delete" && event.key !== "Backspace") return;
    event.preventDefault();
    event.stopPropagation();
    const { waypoints } = this.store.document;
    if (!insert) return waypoints[index].removable && this.link.edit([{ do: "remove_waypoint", index }]);
    const [from, to] = [this.waypointAt(index), this.waypointAt(index + 1) ?? this.waypointAt(index - 1)];
    const before = this.waypointAt(index + 1) ? index + 1 : index;
    if (from && to && insertable(this.store.document, before)) {
      this.link.edit([{ do: "insert_waypoint", index: before, at: [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2] }]);
      this.expect(before);
    }
  }

  /** The middle of the line that ends at a waypoint. @param {number} index @returns {Handle} */
  middle(index) {
    const element = draw("g", {
      class: "handle middle",
      "data-index": index,
      role: "button",
      tabindex: -1,
      "aria-label": `Insert a waypoint before waypoint ${index + 1}`,
    });
    element.append(draw("circle", { r: 12, class: "target" }), draw("path", { d: "M-4 0H4M0-4V4", class: "seen" }));
    /** @type {Handle} */
    const handle = {
      element,
      inserts: index,
      at: () => {
        const [a, b] = [this.waypointAt(index - 1), this.waypointAt(index)];
        return a && b ? [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] : null;
      },
      edits: (to) => [{ do: "insert_waypoint", index, at: to }],
      describe: () => {},
    };
    return this.movable(`middle ${index}`, handle);
  }

  /** The apex of a rounded corner. @param {number} index @returns {Handle} */
  corner(index) {
    const element = this.shape("corner", index, [draw("path", { class: "stem" }), draw("path", { d: "M0-6 6 0 0 6-6 0Z", class: "seen" })]);
    const told = () => this.store.latest("picture")?.head.corners.find((/** @type {any} */ x) => x.index === index);
    /** @type {Handle} */
    const handle = {
      element,
      at: () => this.held.get(`corner ${index}`)?.at ?? told()?.apex ?? null,
      corner: told,
      describe: () => {
        const corner = told();
        if (!corner) return;
        mark(element, "aria-valuenow", mm(corner.error));
        mark(element, "aria-valuetext", wordsOf(corner));
      },
    };
    return this.movable(`corner ${index}`, handle);
  }

  /** @param {string} kind @param {number} index @param {SVGElement[]} parts @returns {SVGGElement} */
  shape(kind, index, parts) {
    const name = kind === "waypoint" ? `Waypoint ${index + 1}` : `Tolerance of corner ${index + 1}`;
    const element = draw("g", {
      class: `handle ${kind}`,
      "data-index": index,
      role: "slider",
      tabindex: 0,
      "aria-label": name,
      "aria-valuenow": 0,
    });
    element.append(draw("circle", { r: 12, class: "target" }), ...parts);
    return element;
  }

  /** By pointer and by keys. @param {string} name @param {Handle} handle @returns {Handle} */
  movable(name, handle) {
    const { pointer } = this;
    const { corner, edits, inserts } = handle;
    const follow = oncePerFrame(() => {
      this.place();
      handle.describe();
    });
    const hold = (/** @type {Point} */ at, seq = Infinity) => {
      this.held.set(name, { at, seq });
      follow();
    };
    /** @type {Point | null} */
    let place = null;
    const end = (/** @type {object[]} */ made, /** @type {boolean} */ cancelled) => {
      // A click inserts as well.
      if (inserts && place && !made.length && !cancelled) this.link.edit(edits?.(place) ?? []);
      else if (!made.length) place = null;
      if (place && inserts) this.expect(inserts);
      if (place) hold(place, this.link.seq);
      else this.held.delete(name);
      this.place();
    };
    const { path } = this.store.document;
    pointer.movable(
      handle.element,
      corner
        ? {
            least: LEAST_TOLERANCE,
            start: () => ({ names: [this.isOfAll(corner()) ? "tolerance of all corners" : "tolerance"], unit: path.tolerance_unit, values: [corner().error] }),
            moved: (by, [value], event) => [value + along(corner(), by, event instanceof KeyboardEvent)],
            edits: ([value]) => {
              hold((place = apexAt(corner(), value)));
              return toleranceEdits(corner(), value, this.isOfAll(corner()));
            },
            end,
          }
        : {
            start: () => {
              place = handle.at();
              return { names: path.axes.names, unit: path.unit, values: place && pointer.local(place) };
            },
            moved: (by, start) => {
              const [u, v] = pointer.global(start);
              return pointer.local([u + by[0], v + by[1]]);
            },
            edits: (values) => {
              hold((place = pointer.global(values)));
              return edits?.(place) ?? [];
            },
            end,
          },
    );
    return handle;
  }

  /** Whether the tolerance of a corner is that of all: it has none of its own, or all are to be changed. @param {import("./corner.js").Corner} corner */
  isOfAll(corner) {
    return corner.waypoint === null || this.store.options.corners === "all";
  }

  /** Every handle at its place on the screen. */
  place() {
    if ((this.store.document?.waypoints?.length ?? 0) > MOST_HANDLES) this.build();
    const points = this.waypoints()
      .filter(({ role }) => isOnPath(role))
      .map(({ index }) => this.waypointAt(index));
    const corners = points
      .filter((p) => p !== null)
      .map((p) =>
        this.pointer.screen(p)
          .map((x) => x.toFixed(1))
          .join(),
      );
    mark(this.polygon, "points", corners.join(" "));
    for (const handle of this.handles.values()) {
      const at = handle.at();
      handle.element.toggleAttribute("hidden", !at);
      if (!at) continue;
      const corner = handle.corner?.();
      const apex = this.pointer.screen(at);
      const [x, y] = corner ? beyond(corner, apex) : apex;
      mark(handle.element, "transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
      // It belongs to the corner that it does not lie on.
      if (corner) mark(handle.element.children[1], "d", `M0 0L${(apex[0] - x).toFixed(1)} ${(apex[1] - y).toFixed(1)}`);
    }
  }
}

/**
 * Whether a waypoint can be inserted before that with a number, be it a new last one.
 * @param {any} document @param {number} index @returns {boolean}
 */
export function insertable({ waypoints }, index) {
  const ends = waypoints.filter((/** @type {any} */ x) => isOnPath(x.role));
  return index > 0 && index <= ends.length && (ends[index]?.divisible ?? true);
}

/** Whether the path goes through a point; others shape an arc. @param {string | undefined} role */
const isOnPath = (role) => role === undefined || role === "point" || role === "end";

/** @param {Store} store @param {Link} link @param {View2d} view @returns {Handles} */
export function init(store, link, view) {
  return new Handles(store, link, view);
}
