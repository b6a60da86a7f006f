// The placement map: how good every place of the part is, under the drawing and in a grid of buttons.

import { heat } from "./colours.js";
import { make, say } from "./dom.js";
import { mm, seconds, short } from "./format.js";
import { movedSince, moveTo } from "./moved.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./viewport.js").Viewport} Viewport */
/** @typedef {[number, number, number]} Shift right, up [m] and turn [rad] in the plane of the picture */
/** @typedef {{shift: Shift, turns: number, value: number, refusal: string}} Cell `turns`: how many were compared */

/** What is drawn, by objective: its array, its unit, and whether small is good. */
const VALUES = /** @type {Record<string, {array: string, label: string, text: (x: number) => string, small: boolean}>} */ ({
  cycle: { array: "duration", label: "cycle time", text: (x) => `${seconds(x)} s`, small: true },
  clearance: { array: "clearance", label: "clearance", text: (x) => `${mm(x, 1)} mm`, small: false },
  manipulability: { array: "singular", label: "least singular value", text: short, small: false },
  torque: { array: "torque_margin", label: "torque to spare", text: (x) => `${(100 * x).toFixed(1)} %`, small: false },
});

export class PlacementMap {
  /**
   * @param {Store} store
   * @param {Link} link
   */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    /** @type {Cell[]} */
    this.cells = [];
    this.objective = VALUES.cycle;
    /** @type {[number, number]} */
    this.about = [0, 0];
    this.sides = [0, 0];
    /** Ends of the scale. */
    this.range = [0, 1];
    /** @type {Frame | null} the picture when the map was made */
    this.from = null;
    this.line = make("p", { class: "placement-line", role: "status" });
    this.table = make("table", { class: "placement", "aria-label": "Places of the part" });
    this.shown = make("input", { type: "checkbox" });
    this.shown.checked = true;
    this.shown.addEventListener("change", () => this.redraw());
    this.scale = make("p", { class: "placement-scale quiet" });
    this.element = make("div", { class: "placement-box" }, [
      this.line, make("div", { class: "placement-frame" }, [this.table]), this.scale,
      make("label", { class: "field" }, [this.shown, " draw the map under the part"]),
    ]);
    store.underlays?.add((context, view) => this.paint(context, view));
    store.on("ground", (/** @type {{uv: [number, number]}} */ { uv }) => this.click(uv));
  }

  /**
   * Take the result of placing.
   * @param {Frame} frame
   */
  show(frame) {
    this.objective = VALUES[frame.head.objective] ?? VALUES.cycle;
    this.about = frame.head.about;
    this.from = this.store.latest("picture");
    this.cells = cellsOf(frame, this.objective);
    const values = this.cells.map((x) => x.value).filter(Number.isFinite);
    this.range = values.length ? [Math.min(...values), Math.max(...values)] : [0, 1];
    this.sides = [sideOf(this.cells, 0), sideOf(this.cells, 1)];
    this.shown.checked = true;
    this.fillTable();
    this.redraw();
  }

  /** The picture or the theme changed. */
  redraw() {
    if (this.cells.length === 0) return;
    this.element.dataset.cells = String(this.cells.length);
    this.element.classList.toggle("stale", this.moved === null);
    this.store.tell("underlay");
    this.describe(null);
  }

  /** How the part lies compared with when the map was made; null if it is another one now. */
  get moved() {
    const picture = this.store.latest("picture");
    return this.from && picture ? movedSince(this.from, picture) : null;
  }

  /** One button per place, the upper row at the top, as in the drawing. */
  fillTable() {
    const [us, vs] = [0, 1].map((k) => [...new Set(this.cells.map((x) => x.shift[k]))].sort((a, b) => a - b));
    const rows = vs.reverse().map((v) =>
      make("tr", {}, us.map((u) => make("td", {}, this.cells.filter((x) => x.shift[0] === u && x.shift[1] === v).map((x) => this.buttonOf(x))))),
    );
    this.table.replaceChildren(make("tbody", {}, rows));
    const [low, high] = this.range.map(this.objective.text);
    say(this.scale, `Colour: ${this.objective.label}, from ${low} to ${high}; bright is better; crossed: refused.`);
  }

  /**
   * @param {Cell} cell
   * @returns {HTMLElement}
   */
  buttonOf(cell) {
    const button = make("button", {
      type: "button", "aria-label": this.textOf(cell), title: this.textOf(cell), class: cell.refusal ? "refused" : false,
      disabled: Boolean(cell.refusal), onclick: () => this.move(cell), onfocus: () => this.describe(cell), onpointerenter: () => this.describe(cell),
    });
    if (!cell.refusal) button.style.background = heat(this.goodness(cell), this.store.theme);
    return button;
  }

  /**
   * @param {Cell} cell
   * @returns {string}
   */
  textOf({ shift, refusal, value }) {
    const turn = shift[2] ? `, turned by ${((180 * shift[2]) / Math.PI).toFixed(1)}°` : "";
    const what = refusal ? `refused (${refusal})` : `${this.objective.label} ${this.objective.text(value)}`;
    return `${mm(shift[0], 1)} mm, ${mm(shift[1], 1)} mm${turn}: ${what}`;
  }

  /** From 0 to 1. @param {Cell} cell */
  goodness({ value }) {
    const [low, high] = this.range;
    const share = high > low ? (value - low) / (high - low) : 1;
    return this.objective.small && high > low ? 1 - share : share;
  }

  /** @param {Cell | null} cell */
  describe(cell) {
    const moved = this.moved;
    if (moved === null) return say(this.line, "The path has changed since this map was made: place it again to use the map.");
    if (cell) return say(this.line, this.textOf(cell));
    say(this.line, "Click a place, here or in the drawing, to move the part there.");
  }

  /** A click in the drawing. @param {[number, number]} uv */
  click(uv) {
    if (!this.shown.checked || !this.element.isConnected) return;
    const [du, dv] = [uv[0] - this.about[0], uv[1] - this.about[1]];
    const cell = this.cells.find((x) => Math.abs(x.shift[0] - du) <= this.sides[0] / 2 && Math.abs(x.shift[1] - dv) <= this.sides[1] / 2);
    if (cell) this.move(cell);
  }

  /** Move the part to a place of the map. @param {Cell} cell */
  move(cell) {
    const moved = this.moved;
    if (cell.refusal) return say(this.line, `The part cannot lie there: ${cell.refusal}.`);
    if (moved === null) return this.describe(null);
    this.link.edit([moveTo(cell.shift, moved, this.about)]);
  }

  /**
   * Draw the map under the drawing.
   * @param {CanvasRenderingContext2D} context in px
   * @param {Viewport} view
   */
  paint(context, view) {
    const centre = this.store.latest("picture")?.head.centre;
    if (!centre || !this.shown.checked || !this.element.isConnected || this.moved === null) return;
    const [wide, high] = this.sides.map((x) => x * view.scale);
    const [u, v] = [this.about[0] - centre[0], this.about[1] - centre[1]];
    context.save();
    for (const cell of this.cells) {
      const [x, y] = view.toScreen([u + cell.shift[0], v + cell.shift[1]]);
      if (x + wide < 0 || y + high < 0 || x - wide > view.width || y - high > view.height) continue;
      if (cell.refusal) cross(context, x, y, Math.min(wide, high) / 6);
      else {
        context.globalAlpha = 0.55;
        context.fillStyle = heat(this.goodness(cell), this.store.theme);
        context.fillRect(x - wide / 2 + 0.5, y - high / 2 + 0.5, wide - 1, high - 1);
      }
    }
    context.restore();
  }
}

/**
 * The places, of several turns the best one.
 * @param {Frame} frame
 * @param {{array: string, small: boolean}} objective
 * @returns {Cell[]}
 */
function cellsOf(frame, { array, small }) {
  const { shift, refusal } = frame.arrays;
  const values = frame.arrays[array] ?? frame.arrays.duration;
  /** @type {Map<string, Cell>} */
  const found = new Map();
  for (let k = 0; k < refusal.length; k += 1) {
    const at = /** @type {Shift} */ ([...shift.subarray(3 * k, 3 * k + 3)]);
    const why = refusal[k] === 255 ? "" : frame.head.refusals[refusal[k]];
    const known = Number.isFinite(values[k]);
    const cell = { shift: at, turns: 1, value: values[k], refusal: known ? "" : why || "not planned" };
    const key = `${at[0]} ${at[1]}`;
    const old = found.get(key);
    if (!old || (known && (old.refusal || (small ? values[k] < old.value : values[k] > old.value)))) found.set(key, cell);
  }
  return [...found.values()];
}

/**
 * Distance of neighbours along an axis [m].
 * @param {Cell[]} cells
 * @param {0 | 1} axis
 * @returns {number}
 */
function sideOf(cells, axis) {
  const all = [...new Set(cells.map((x) => x.shift[axis]))].sort((a, b) => a - b);
  return all.length > 1 ? (all[all.length - 1] - all[0]) / (all.length - 1) : 0.02;
}

/**
 * @param {CanvasRenderingContext2D} context
 * @param {number} x
 * @param {number} y
 * @param {number} size [px]
 */
function cross(context, x, y, size) {
  context.globalAlpha = 0.5;
  context.strokeStyle = "#888888";
  context.lineWidth = 1;
  context.beginPath();
  context.moveTo(x - size, y - size);
  context.lineTo(x + size, y + size);
  context.moveTo(x + size, y - size);
  context.lineTo(x - size, y + size);
  context.stroke();
}
