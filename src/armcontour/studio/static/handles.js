// Handles over the drawing: waypoints, corner apexes, and line middles at which a waypoint can be
// inserted. A handle follows the pointer at once; the server's answer is drawn when it arrives.

import { along, apexAt, beyond, handledOf, LEAST_TOLERANCE, wordsOf } from "./corner.js";
import { draw, grip, mark } from "./dom.js";
import { mm } from "./format.js";
import { Pointer } from "./pointer.js";
import { lengthText } from "./units.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {[number, number]} Point */
/** @typedef {import("./pointer.js").Movable} Movable */
/**
 * A draggable handle; `at` returns its place (metres in the plane), or null if it is not shown.
 * @typedef {Movable & {element: SVGGElement, at: () => Point | null, describe: () => void, corner?: () => any}} Handle
 *   `describe` sets the text for screen readers; `corner` is the corner whose apex it is
 */

// With more handles than this, only those in view are created.
const MAX_HANDLES = 300;
/** Least distance between the marks of corners; zooming in shows more of them [px]. */
const CORNERS_APART = 24;
/** Keys that go to the next handle of the same kind, or the one before. @type {Record<string, number>} */
const TO_OTHERS = { PageDown: 1, PageUp: -1 };
/** Value for: no waypoint shall get the focus. */
const NOTHING = { index: -1, seq: Infinity, count: 0 };

class Handles {
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
    this.inserted = NOTHING;
    for (const event of ["document", "picture", "refusal"]) store.on(event, (/** @type {any} */ frame) => this.answered(frame));
    view.followers.add(() => this.place());
    view.overlay.addEventListener("focusin", () => this.settle());
    view.overlay.addEventListener("keydown", (event) => this.goToOther(event));
  }

  /** Update the handles, because a new frame may have other ones or other places. @param {import("./state.js").Frame | null} frame */
  answered(frame) {
    this.build();
    this.place();
    if (frame?.kind !== "document" || frame.seq === null || frame.seq < this.inserted.seq) return;
    const { index, count } = this.inserted;
    if (this.store.document.waypoints.length > count) this.handles.get(`waypoint ${index}`)?.element.focus();
    this.inserted = NOTHING;
  }

  /** Give the focus to a new waypoint once it exists. @param {number} index */
  expect(index) {
    this.inserted = { index, seq: this.link.seq, count: this.store.document.waypoints.length };
  }

  /** Create and remove handles; existing elements stay, so that the focus stays. */
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

  /** Waypoints that can be moved. @returns {{index: number, uv: Point, written: string[], role: string, why_not?: string}[]} */
  waypoints() {
    const found = this.store.document;
    if (!found?.path?.editable) return [];
    // Before the view is fitted to the first picture, a handle would be in a wrong place.
    if (!this.store.latest("picture") && !this.store.refusal) return [];
    const movable = found.waypoints.filter((/** @type {any} */ x) => !x.why_not);
    return movable.length <= MAX_HANDLES ? movable : movable.filter((/** @type {any} */ x) => this.inView(x.uv)).slice(0, MAX_HANDLES);
  }

  /** Rounded corners. @returns {any[]} */
  corners() {
    const seen = handledOf(this.store.latest("picture"));
    return seen.length <= MAX_HANDLES ? seen : seen.filter((/** @type {any} */ x) => this.inView(x.apex)).slice(0, MAX_HANDLES);
  }

  /** @param {Point} uv @returns {boolean} */
  inView(uv) {
    const [x, y] = this.pointer.screen(uv);
    return x > 0 && y > 0 && x < this.view.view.width && y < this.view.view.height;
  }

  /** Where a waypoint is shown. @param {number} index @returns {Point | null} */
  waypointAt(index) {
    return this.handles.get(`waypoint ${index}`)?.at() ?? this.store.document?.waypoints[index]?.uv ?? null;
  }

  /** @param {number} index @returns {Handle} */
  waypoint(index) {
    const element = this.shape("waypoint", index, [draw("circle", { r: 6, class: "seen" })]);
    element.addEventListener("keydown", (event) => this.waypointKey(event, index));
    return this.movable({
      element,
      at: () => this.store.document?.waypoints[index]?.uv ?? null,
      edits: (values) => [{ do: "move_waypoint", index, to: this.pointer.global(values) }],
      describe: () => {
        const at = this.waypointAt(index);
        if (!at) return;
        mark(element, "aria-valuenow", String(Math.round(1000 * at[0] * 10) / 10));
        mark(element, "aria-valuetext", `x ${lengthText(at[0], 1)}, y ${lengthText(at[1], 1)}`);
      },
    });
  }

  /** Insert after, or remove. @param {KeyboardEvent} event @param {number} index */
  waypointKey(event, index) {
    const insert = event.key === "Insert" || event.key === "+";
    if (!insert && event.key !== "Delete" && event.key !== "Backspace") return;
    event.preventDefault();
    event.stopPropagation();
    this.link.whenKnown(() => {
      if (insert) this.insertAfter(index);
      else if (this.store.document.waypoints[index]?.removable) this.link.edit([{ do: "remove_waypoint", index }]);
    });
  }

  /** @param {number} index */
  insertAfter(index) {
    const [from, to] = [this.waypointAt(index), this.waypointAt(index + 1) ?? this.waypointAt(index - 1)];
    const before = this.waypointAt(index + 1) ? index + 1 : index;
    if (from && to && insertable(this.store.document, before)) {
      this.link.edit([{ do: "insert_waypoint", index: before, at: [(from[0] + to[0]) / 2, (from[1] + to[1]) / 2] }]);
      this.expect(before);
    }
  }

  /** Make the handle in the middle of the line that ends at a waypoint. @param {number} index @returns {Handle} */
  middle(index) {
    const name = `Insert a waypoint before waypoint ${index + 1}`;
    const plus = draw("path", { d: "M-4 0H4M0-4V4", class: "seen" });
    const element = grip({ class: "handle middle", "data-index": index, role: "button", tabindex: -1, "aria-label": name, "aria-valuenow": null }, [plus]);
    const insert = (/** @type {Point | null} */ at) => [{ do: "insert_waypoint", index, at }];
    const middle = () => {
      const [a, b] = [this.waypointAt(index - 1), this.waypointAt(index)];
      return a && b ? /** @type {Point} */ ([(a[0] + b[0]) / 2, (a[1] + b[1]) / 2]) : null;
    };
    return this.movable({
      element,
      at: middle,
      edits: (values) => insert(this.pointer.global(values)),
      end: (made, cancelled) => {
        if (cancelled) return;
        // A click inserts as well.
        if (!made.length) this.link.edit(insert(middle()));
        this.expect(index);
      },
      describe: () => {},
    });
  }

  /** The apex of a rounded corner. @param {number} index @returns {Handle} */
  corner(index) {
    const element = this.shape("corner", index, [draw("path", { class: "stem" }), draw("path", { d: "M0-6 6 0 0 6-6 0Z", class: "seen" })]);
    const corner = () => this.store.latest("picture")?.head.corners.find((/** @type {any} */ x) => x.index === index);
    /** Tolerance in the file, which the corner may not use completely. */
    const tolerance = () => this.store.document.values["corners.tolerance"]?.value ?? corner().error;
    /** Drawn error, at which the pointer grabs. */
    const drawn = () => this.pointer.held(handle)?.[0] ?? corner().error;
    const handle = this.movable({
      element,
      corner,
      answer: "picture",
      least: LEAST_TOLERANCE,
      at: () => corner()?.apex ?? null,
      shown: ([value]) => apexAt(corner(), value),
      start: (event) => ({
        names: ["tolerance of all corners"],
        unit: this.store.document.path.tolerance_unit,
        values: [event instanceof KeyboardEvent ? tolerance() : drawn()],
      }),
      moved: (by, [value], event) => [value + along(corner(), by, event instanceof KeyboardEvent)],
      edits: ([value]) => [{ do: "set", key: "corners.tolerance", value }],
      describe: () => {
        if (!corner()) return;
        mark(element, "aria-valuenow", mm(corner().error));
        mark(element, "aria-valuetext", wordsOf(corner()));
      },
    });
    return handle;
  }

  /** @param {string} kind @param {number} index @param {SVGElement[]} parts @returns {SVGGElement} */
  shape(kind, index, parts) {
    const name = kind === "waypoint" ? `Waypoint ${index + 1}` : `Tolerance of corner ${index + 1}`;
    return grip({ class: `handle ${kind}`, "data-index": index, "aria-label": name }, parts);
  }

  /**
   * Make a handle for pointer and keys; by default its values are its place along the axes of the file.
   * @param {Partial<Handle> & Pick<Handle, "element" | "at" | "edits" | "describe"> & {shown?: (values: number[]) => Point}} given @returns {Handle}
   */
  movable({ at, shown = (values) => this.pointer.global(values), ...given }) {
    const { pointer, store } = this;
    /** @type {Handle} */
    const handle = {
      start: () => {
        const [{ axes, unit }, place] = [store.document.path, handle.at()];
        return { names: axes.names, unit, values: place && pointer.local(place) };
      },
      moved: (by, start) => pointer.turned(by).map((x, k) => start[k] + x),
      ...given,
      at: () => {
        const values = pointer.held(handle);
        return values ? shown(values) : at();
      },
    };
    pointer.movable(handle.element, handle);
    return handle;
  }

  /** Move every handle to its place on the screen. */
  place() {
    if ((this.store.document?.waypoints?.length ?? 0) > MAX_HANDLES) this.build();
    const points = this.waypoints().map(({ role, index }) => isOnPath(role) && this.waypointAt(index));
    const corners = points.flatMap((p) => (p ? [this.pointer.screen(p).map((x) => x.toFixed(1)).join()] : []));
    mark(this.polygon, "points", corners.join(" "));
    const marked = /** @type {Point[]} */ ([]);
    for (const handle of this.handles.values()) {
      const at = handle.at();
      handle.element.toggleAttribute("hidden", !at);
      if (!at) continue;
      if (handle === this.pointer.going?.what) handle.describe();
      const corner = handle.corner?.();
      const apex = this.pointer.screen(at);
      const [x, y] = corner ? beyond(corner, apex) : apex;
      if (corner) {
        const isUsed = handle.element.matches(":focus, .dragging");
        const isShown = isUsed || marked.every(([a, b]) => Math.hypot(a - x, b - y) >= CORNERS_APART);
        handle.element.toggleAttribute("hidden", !isShown);
        if (!isShown) continue;
        marked.push([x, y]);
      }
      mark(handle.element, "transform", `translate(${x.toFixed(1)} ${y.toFixed(1)})`);
      // The handle is beyond the apex, so a line connects them.
      if (corner) mark(handle.element.children[1], "d", `M0 0L${(apex[0] - x).toFixed(1)} ${(apex[1] - y).toFixed(1)}`);
    }
    this.settle();
  }

  /** Return the handles of a group that are in the view, in the order of the path. @param {SVGGElement} group @returns {SVGGElement[]} */
  seenOf(group) {
    const seen = [...this.handles.values()].filter(({ element, at }) => {
      const place = element.parentNode === group ? at() : null;
      return place !== null && this.inView(place);
    });
    return seen.map((x) => x.element).sort((a, b) => Number(a.dataset.index) - Number(b.dataset.index));
  }

  /** Let one waypoint and one corner be a stop of the Tab key: the one with the focus, else the same as before, else the first in the view. */
  settle() {
    const [, ...groups] = this.groups;
    for (const group of groups) {
      const seen = this.seenOf(group);
      const stop = seen.find((x) => x === document.activeElement) ?? seen.find((x) => x.getAttribute("tabindex") === "0") ?? seen[0];
      for (const element of group.children) mark(element, "tabindex", element === stop ? "0" : "-1");
    }
  }

  /** Give the focus to another handle of the same kind. Arrow keys move a handle, so other keys lead to the next one. @param {KeyboardEvent} event */
  goToOther(event) {
    const way = TO_OTHERS[event.key];
    const element = event.target instanceof SVGGElement ? event.target : null;
    const group = this.groups.find((x) => x === element?.parentNode);
    if (!way || !element || !group) return;
    const seen = this.seenOf(group);
    const next = seen[(seen.indexOf(element) + way + seen.length) % seen.length];
    event.preventDefault();
    next?.focus();
  }
}

/**
 * Return whether a waypoint can be inserted before a waypoint, or as the last one.
 * @param {any} document @param {number} index @returns {boolean}
 */
export function insertable({ waypoints }, index) {
  const ends = waypoints.filter((/** @type {any} */ x) => isOnPath(x.role));
  return index > 0 && index <= ends.length && (ends[index]?.divisible ?? true);
}

/** Return whether the path passes through a waypoint; other waypoints shape an arc. @param {string} role */
export const isOnPath = (role) => role === "point" || role === "end";

/** @param {Store} store @param {Link} link @param {View2d} view @returns {Handles} */
export function init(store, link, view) {
  return new Handles(store, link, view);
}
