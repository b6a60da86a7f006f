// Placement map: rating of each position of the part, below the drawing and in a grid of buttons.

import { heat } from "./colours.js";
import { make, say } from "./dom.js";
import { fixed, mm, percent, rowOf, seconds, short } from "./format.js";
import { movedSince, moveTo } from "./part_motion.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./viewport.js").Viewport} Viewport */
/** @typedef {[number, number, number]} Shift right, up [m] and turn [rad] in the plane of the picture */
/** `value` is not finite without a plan: the place is refused, or cannot be better than others. @typedef {{shift: Shift, value: number, refusal: string}} Cell */

/** Scores, which are small where it is good, as text. */
const SCORES = /** @type {Record<string, {label: string, text: (x: number) => string}>} */ ({
  duration: { label: "cycle time", text: (x) => `${seconds(x)} s` },
  clearance: { label: "clearance", text: (x) => `${mm(-x, 1)} mm` },
  manipulability: { label: "least singular value", text: (x) => short(-x) },
  torque: { label: "torque to spare", text: (x) => `${percent(-x)} %` },
});

/** Stands for no refusal in a result. */
const NOT_REFUSED = 255;
/** Width of places along an axis that was not moved along [m]. */
const NARROW = 0.02;

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
    this.score = SCORES.duration;
    /** @type {[number, number]} */
    this.about = [0, 0];
    this.sides = [0, 0];
    this.columns = 1;
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
    /** @type {Cell | null} between the places of the grid */
    this.best = null;
    const best = make("button", { type: "button", text: "Move to the best place", "data-place": "best", onclick: () => this.best && this.move(this.best) });
    this.element = make("div", { class: "placement-box" }, [
      make("p", { class: "acts" }, [best, make("label", { class: "field" }, [this.shown, " draw the map under the part"])]),
      this.line, make("div", { class: "placement-frame" }, [this.table]), this.scale,
    ]);
    store.underlays.add(this);
    store.on("ground", (/** @type {{uv: [number, number]}} */ { uv }) => this.click(uv));
  }

  /**
   * Take the result of placing.
   * @param {Frame} frame
   */
  show(frame) {
    this.score = SCORES[frame.head.objective] ?? SCORES.duration;
    this.about = frame.head.anchor;
    this.from = this.store.latest("picture");
    const { by, turn } = frame.head.best;
    this.best = { shift: [by[0], by[1], turn], value: rowOf(frame.head.best, "duration")?.value ?? null, refusal: "" };
    this.columns = axisOf(frame, "x").length;
    this.cells = cellsOf(frame);
    const values = this.cells.map((x) => x.value).filter(Number.isFinite);
    this.range = values.length ? [Math.min(...values), Math.max(...values)] : [0, 1];
    this.sides = [stepOf(axisOf(frame, "x")), stepOf(axisOf(frame, "y"))];
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

  /** One button per place, y upwards as in the drawing. */
  fillTable() {
    const rows = this.cells.length / this.columns;
    const row = (/** @type {number} */ k) => make("tr", {}, Array.from({ length: this.columns }, (_, j) => make("td", {}, [this.buttonOf(this.cells[j * rows + k])])));
    this.table.replaceChildren(make("tbody", {}, Array.from({ length: rows }, (_, k) => row(rows - 1 - k))));
    say(this.scale, `Colour: ${this.words}`);
  }

  /** Meaning of colours and crosses. */
  get words() {
    const [low, high] = this.range.map(this.score.text);
    return `${this.score.label}, from ${low} to ${high}; bright is better; crossed: refused; empty: cannot be the best.`;
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
    if (Number.isFinite(cell.value)) button.style.background = heat(this.goodness(cell), this.store.theme);
    return button;
  }

  /**
   * @param {Cell} cell
   * @returns {string}
   */
  textOf({ shift, refusal, value }) {
    const turn = shift[2] ? `, turned by ${fixed((180 * shift[2]) / Math.PI, 1)}°` : "";
    const known = Number.isFinite(value) ? `${this.score.label} ${this.score.text(value)}` : "not planned, as it cannot be the best";
    const what = refusal ? `refused (${refusal})` : known;
    return `${mm(shift[0], 1)} mm, ${mm(shift[1], 1)} mm${turn}: ${what}`;
  }

  /** From 0 to 1. @param {Cell} cell */
  goodness({ value }) {
    const [low, high] = this.range;
    return high > low ? (high - value) / (high - low) : 1;
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

  /** True if the map is under the drawing. */
  get isDrawn() {
    return this.shown.checked && this.element.isConnected && this.cells.length > 0 && this.moved !== null;
  }

  /**
   * Draw the map under the drawing.
   * @param {CanvasRenderingContext2D} context in px
   * @param {Viewport} view
   * @param {"light" | "dark"} theme
   */
  paint(context, view, theme) {
    const centre = this.store.latest("picture")?.head.centre;
    if (!centre || !this.isDrawn) return;
    const [wide, high] = this.sides.map((x) => x * view.scale);
    const [u, v] = [this.about[0] - centre[0], this.about[1] - centre[1]];
    context.save();
    for (const cell of this.cells) {
      const [x, y] = view.toScreen([u + cell.shift[0], v + cell.shift[1]]);
      if (x + wide < 0 || y + high < 0 || x - wide > view.width || y - high > view.height) continue;
      if (cell.refusal) cross(context, x, y, Math.min(wide, high) / 6);
      else if (Number.isFinite(cell.value)) {
        context.globalAlpha = 0.75;
        context.fillStyle = heat(this.goodness(cell), theme);
        context.fillRect(x - wide / 2 + 0.5, y - high / 2 + 0.5, wide - 1, high - 1);
      }
    }
    context.restore();
  }
}

/**
 * The places column by column, of several turns and heights the best one.
 * @param {Frame} frame
 * @returns {Cell[]}
 */
function cellsOf(frame) {
  const { by, turn, score, refusal } = frame.arrays;
  const count = axisOf(frame, "x").length * axisOf(frame, "y").length;
  // The last axis changes fastest: so many places follow each other at one x and y.
  const each = score.length / count;
  return Array.from({ length: count }, (_, k) => {
    let best = k * each;
    for (let j = best; j < (k + 1) * each; j += 1) if (score[j] < score[best]) best = j;
    const refused = !Number.isFinite(score[best]) && refusal[best] !== NOT_REFUSED;
    return { shift: [by[2 * best], by[2 * best + 1], turn[best]], value: score[best], refusal: refused ? frame.head.refusals[refusal[best]] : "" };
  });
}

/** Values of an axis [m]; one that was not moved along has one. @param {Frame} frame @param {string} name @returns {number[]} */
function axisOf(frame, name) {
  return frame.head.axes.find((/** @type {any} */ x) => x.name === name)?.values ?? [0];
}

/** Distance of neighbours [m]. @param {number[]} values @returns {number} */
function stepOf(values) {
  return values.length > 1 ? (values[values.length - 1] - values[0]) / (values.length - 1) : NARROW;
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
