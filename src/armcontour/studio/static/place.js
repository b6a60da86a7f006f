// The handle that moves and turns the part as a whole.

import { draw, mark } from "./dom.js";
import { short } from "./format.js";
import { oncePerFrame } from "./state.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {import("./pointer.js").Pointer} Pointer */
/** @typedef {[number, number]} Point */

const ARM = 64; // px from the middle of the part to the handle that turns it
const TURN_STEP = Math.PI / 180;

class PlaceHandle {
  /** @param {Store} store @param {Link} link @param {View2d} view @param {Pointer} pointer */
  constructor(store, link, view, pointer) {
    this.store = store;
    this.link = link;
    this.view = view;
    this.pointer = pointer;
    this.group = draw("g", { class: "place", hidden: true });
    this.stem = draw("line", { class: "stem" });
    this.mover = this.shape("Place of the part", [
      draw("path", {
        class: "seen",
        d: "M0-11V11M-11 0H11M-3.5-8 0-12 3.5-8M-3.5 8 0 12 3.5 8M-8-3.5-12 0-8 3.5M8-3.5 12 0 8 3.5",
      }),
    ]);
    this.turner = this.shape("Turn of the part", [
      draw("path", { class: "seen", d: "M-6 2.5A6.5 6.5 0 1 1 0 6.5M-3 3.5 0 6.5-3 9.5" }),
    ]);
    this.group.append(this.stem, this.mover, this.turner);
    view.overlay.append(this.group);
    /** @type {{about: Point, by: Point, turn: number, seq: number} | null} */
    this.held = null;
    store.on("view", () => this.put());
    for (const event of ["picture", "refusal"]) store.on(event, (/** @type {any} */ frame) => this.answered(frame));
    view.followers.add(() => this.put());
    this.follow = oncePerFrame(() => {
      if (this.held) this.describe(this.held);
      this.put();
    });
    this.listen();
  }

  /** @param {string} label @param {SVGElement[]} parts */
  shape(label, parts) {
    const element = draw("g", {
      class: "handle",
      role: "slider",
      tabindex: 0,
      "aria-label": label,
      "aria-valuenow": 0,
      "aria-valuetext": "as it was",
    });
    element.append(draw("circle", { r: 14, class: "target" }), ...parts);
    return element;
  }

  listen() {
    const end = (/** @type {object[]} */ edits) => {
      if (this.held && edits.length) this.held.seq = this.link.seq;
      else this.held = null;
      this.put();
    };
    this.pointer.movable(this.mover, {
      start: () => ({ names: ["right", "up"], unit: this.store.document.path.unit, values: [0, 0] }),
      moved: (by) => by,
      edits: ([u, v]) => this.edits([u, v], 0),
      end,
    });
    this.pointer.movable(this.turner, {
      step: TURN_STEP,
      start: () => ({ names: ["turned"], unit: ["°", TURN_STEP], values: [0] }),
      moved: ([du, dv], start, event) => [event instanceof KeyboardEvent ? 1000 * (dv - du) * TURN_STEP : this.turnTo(event)],
      edits: ([turn]) => this.edits([0, 0], turn),
      end,
    });
  }

  /** Angle from the handle's rest, straight up, to the pointer. @param {PointerEvent} event @returns {number} rad */
  turnTo(event) {
    const [x, y] = this.pointer.screen(this.held?.about ?? this.pointer.centre);
    const [px, py] = this.view.within(event);
    const turn = Math.atan2(-(py - y), px - x) - Math.PI / 2;
    return Math.atan2(Math.sin(turn), Math.cos(turn));
  }

  /** @param {Point} by @param {number} turn @returns {object[]} */
  edits(by, turn) {
    const about = this.held?.about ?? this.pointer.centre;
    this.held = { about, by, turn, seq: Infinity };
    this.follow();
    return [{ do: "place", by, turn, about }];
  }

  /** What is read aloud. @param {{by: Point, turn: number}} held */
  describe({ by, turn }) {
    const text = `moved by ${short(1000 * by[0])} and ${short(1000 * by[1])} mm, turned by ${short((turn * 180) / Math.PI)}°`;
    for (const element of [this.mover, this.turner]) element.setAttribute("aria-valuetext", text);
    mark(this.mover, "aria-valuenow", String(Math.round(1000 * Math.hypot(...by))));
    mark(this.turner, "aria-valuenow", String(Math.round((turn * 180) / Math.PI)));
  }

  /** @param {import("./state.js").Frame | null} frame */
  answered(frame) {
    if (frame && this.held && (frame.seq === null || frame.seq >= this.held.seq)) this.held = null;
    this.put();
  }

  put() {
    const shown = this.store.options.place && this.store.latest("picture") !== null;
    this.group.toggleAttribute("hidden", !shown);
    if (!shown) return;
    const { about, by, turn } = this.held ?? { about: this.pointer.centre, by: [0, 0], turn: 0 };
    const [x, y] = this.pointer.screen([about[0] + by[0], about[1] + by[1]]);
    const [tx, ty] = [x - ARM * Math.sin(turn), y - ARM * Math.cos(turn)];
    mark(this.mover, "transform", `translate(${x} ${y})`);
    mark(this.turner, "transform", `translate(${tx} ${ty})`);
    for (const [name, value] of Object.entries({ x1: x, y1: y, x2: tx, y2: ty })) mark(this.stem, name, String(value));
  }
}

/** @param {Store} store @param {Link} link @param {View2d} view @param {Pointer} pointer */
export function init(store, link, view, pointer) {
  new PlaceHandle(store, link, view, pointer);
}
