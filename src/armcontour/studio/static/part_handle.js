// Handle that moves and rotates the whole part.

import { draw, grip, mark } from "./dom.js";
import { short } from "./format.js";
import { lengthText } from "./units.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./pointer.js").Pointer} Pointer */
/** @typedef {[number, number]} Point */

const ARM = 64; // px from the middle of the part to the handle that turns it
const TURN_STEP = Math.PI / 180;

class PlaceHandle {
  /** @param {Store} store @param {Pointer} pointer */
  constructor(store, pointer) {
    this.store = store;
    this.view = pointer.view;
    this.pointer = pointer;
    this.group = draw("g", { class: "place", hidden: true });
    this.stem = draw("line", { class: "stem" });
    const shape = (/** @type {string} */ label, /** @type {string} */ d) =>
      grip({ class: "handle", "aria-label": label, "aria-valuetext": "as it was" }, [draw("path", { class: "seen", d })], 14);
    this.mover = shape("Place of the part", "M0-11V11M-11 0H11M-3.5-8 0-12 3.5-8M-3.5 8 0 12 3.5 8M-8-3.5-12 0-8 3.5M8-3.5 12 0 8 3.5");
    this.turner = shape("Turn of the part", "M-6 2.5A6.5 6.5 0 1 1 0 6.5M-3 3.5 0 6.5-3 9.5");
    this.group.append(this.stem, this.mover, this.turner);
    this.view.overlay.append(this.group);
    /** Centre of the rotation, at the start of a gesture. @type {Point} */
    this.about = [0, 0];
    store.on("view", () => this.put());
    this.view.followers.add(() => this.put());
    const start = (/** @type {string[]} */ names, /** @type {import("./pointer.js").Unit} */ unit) => {
      this.about = pointer.centre;
      return { names, unit, values: names.map(() => 0) };
    };
    // The server rotates the part about its centre in the file, which may be newer than the picture.
    const edit = (/** @type {Point} */ by, /** @type {number} */ turn) => [{ do: "place", by, turn }];
    /** @type {import("./pointer.js").Movable} */
    this.moving = {
      answer: "picture",
      start: () => start(["right", "up"], store.document.path.unit),
      moved: (by) => by,
      edits: ([u, v]) => edit([u, v], 0),
    };
    /** @type {import("./pointer.js").Movable} */
    this.turning = {
      answer: "picture",
      step: TURN_STEP,
      start: () => start(["turned"], ["°", TURN_STEP]),
      moved: ([du, dv], _, event) => [event instanceof KeyboardEvent ? 1000 * (dv - du) * TURN_STEP : this.turnTo(event)],
      edits: ([turn]) => edit([0, 0], turn),
    };
    pointer.movable(this.mover, this.moving);
    pointer.movable(this.turner, this.turning);
  }

  /** Return the angle from straight up, where the handle rests, to the pointer. @param {PointerEvent} event @returns {number} rad */
  turnTo(event) {
    const [x, y] = this.pointer.screen(this.about);
    const [px, py] = this.view.within(event);
    const turn = Math.atan2(-(py - y), px - x) - Math.PI / 2;
    return Math.atan2(Math.sin(turn), Math.cos(turn));
  }

  /** Text for screen readers. @param {number[]} by @param {number} turn */
  describe(by, turn) {
    const text = `moved by ${lengthText(by[0], 2)} and ${lengthText(by[1], 2)}, turned by ${short((turn * 180) / Math.PI)}°`;
    for (const element of [this.mover, this.turner]) mark(element, "aria-valuetext", text);
    mark(this.mover, "aria-valuenow", String(Math.round(1000 * Math.hypot(...by))));
    mark(this.turner, "aria-valuenow", String(Math.round((turn * 180) / Math.PI)));
  }

  put() {
    const shown = this.store.options.tool === "move" && this.store.options.obstacle < 0 && this.store.latest("picture") !== null;
    this.group.toggleAttribute("hidden", !shown);
    if (!shown) return;
    const [moved, turned] = [this.pointer.held(this.moving), this.pointer.held(this.turning)];
    const [by, [turn]] = [moved ?? [0, 0], turned ?? [0]];
    if (moved || turned) this.describe(by, turn);
    const about = moved || turned ? this.about : this.pointer.centre;
    const [x, y] = this.pointer.screen([about[0] + by[0], about[1] + by[1]]);
    const [tx, ty] = [x - ARM * Math.sin(turn), y - ARM * Math.cos(turn)];
    mark(this.mover, "transform", `translate(${x} ${y})`);
    mark(this.turner, "transform", `translate(${tx} ${ty})`);
    for (const [name, value] of Object.entries({ x1: x, y1: y, x2: tx, y2: ty })) mark(this.stem, name, String(value));
  }
}

/** @param {Store} store @param {import("./connection.js").Link} _link @param {Pointer} pointer */
export function init(store, _link, pointer) {
  new PlaceHandle(store, pointer);
}
