// One chart: a figure with title, curves of uPlot, a legend with values at the cursor, and a sentence.

import { themed } from "./colours.js";
import { make, say } from "./dom.js";
import { fixed } from "./format.js";

/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {import("./vendor/uplot.js").default} uPlot */
/** @typedef {import("./vendor/uplot.js").default.AlignedData} AlignedData */
/** @typedef {import("./vendor/uplot.js").default.Options} Options */
/**
 * @typedef {object} Curve
 * @property {string} label
 * @property {string} colour
 * @property {number[]} [dash]
 * @property {number} [width] [px]
 * @property {ArrayLike<number | null>} y in the unit of the axis
 */
/**
 * @typedef {object} Content
 * @property {ArrayLike<number>} x increasing, in the unit of the axis
 * @property {Curve[]} curves
 * @property {number[]} [limits] values at which lines are drawn
 * @property {[number, number]} [range] that the vertical axis shows at least
 * @property {string} summary content as a sentence
 * @property {string} [yUnit] unit of the values, if it changes
 */
/**
 * @typedef {object} Axes
 * @property {string} title
 * @property {string} x label of the horizontal axis, with its unit
 * @property {string} y label of the vertical axis, without unit
 * @property {string} unit of the vertical axis
 * @property {string} xUnit
 */

const HEIGHT = 152; // px

/** Library for curves, loaded when there is something to draw. @type {typeof import("./vendor/uplot.js").default | null} */
let Plot = null;

/** A chart; it is drawn only while it is in sight. */
export class Chart {
  /**
   * @param {string} name for `data-chart`
   * @param {Axes} axes
   * @param {(x: number) => void} hovered with the place under the pointer
   */
  constructor(name, axes, hovered) {
    this.axes = axes;
    this.hovered = hovered;
    this.plotBox = make("div", { class: "chart-plot" });
    this.title = make("h3", { text: axes.title });
    this.summary = make("p", { class: "chart-summary" });
    const head = make("figcaption", {}, [this.title, this.summary]);
    this.element = make("figure", { class: "chart", "data-chart": name, "aria-label": axes.title }, [head, this.plotBox]);
    /** @type {uPlot | null} */
    this.plot = null;
    this.signature = "";
    /** @type {Content | null} */
    this.content = null;
    this.fresh = false;
    this.inSight = false;
    this.loads = false;
    /** Place of the cursor, in the unit of the horizontal axis. */
    this.cursor = 0;
    new IntersectionObserver((seen) => this.see(seen.at(-1)?.isIntersecting ?? false)).observe(this.element);
    new ResizeObserver(() => this.resize()).observe(this.plotBox);
  }

  /**
   * Replace the content.
   * @param {Content} content
   */
  show(content) {
    this.content = content;
    this.fresh = false;
    if (this.inSight) this.draw();
  }

  /** Draw again in the colours of the theme. */
  repaint() {
    this.signature = "";
    if (this.content) this.show(this.content);
  }

  /** Put the cursor at a place. @param {number} x in the unit of the axis */
  point(x) {
    this.cursor = x;
    const { plot } = this;
    if (!plot || !this.inSight) return;
    plot.setCursor({ left: plot.valToPos(x, "x"), top: 0 }, false);
    this.element.dataset.cursor = String(x);
  }

  /** @param {boolean} inSight */
  see(inSight) {
    this.inSight = inSight;
    if (!inSight) return;
    if (!this.fresh) this.draw();
    this.point(this.cursor);
  }

  draw() {
    const { content } = this;
    if (!content) return;
    if (!Plot) return void this.load();
    const started = performance.now();
    // The width of a chart that is there is known: asking makes the browser lay out the page.
    const width = this.plot?.width ?? this.plotBox.clientWidth;
    if (width < 40) return;
    const signature = JSON.stringify([content.curves.map((c) => [c.label, c.colour, c.dash, c.width]), content.limits, content.range, content.yUnit]);
    const data = /** @type {AlignedData} */ (/** @type {unknown} */ ([content.x, ...content.curves.map((c) => c.y)]));
    if (this.plot && signature === this.signature) this.plot.setData(data);
    else this.rebuild(content, data, width);
    this.signature = signature;
    this.fresh = true;
    say(this.summary, content.summary);
    this.point(this.cursor);
    this.element.dataset.points = String(content.x.length);
    this.element.dataset.ms = (performance.now() - started).toFixed(1);
  }

  /** Load the library, then draw the current content. */
  async load() {
    if (this.loads) return;
    this.loads = true;
    try {
      ({ default: Plot } = await import("./vendor/uplot.js"));
      if (this.inSight && !this.fresh) this.draw();
    } catch {
      say(this.summary, "The chart could not be loaded: reload the page.");
    }
    this.loads = false;
  }

  /**
   * @param {Content} content
   * @param {AlignedData} data
   * @param {number} width [px]
   */
  rebuild(content, data, width) {
    this.plot?.destroy();
    if (!Plot) return;
    this.plot = new Plot(this.options(content, width), data, this.plotBox);
    const over = this.plot.over;
    over.addEventListener("pointermove", (event) => {
      const left = event.clientX - over.getBoundingClientRect().left;
      if (this.plot) this.hovered(this.plot.posToVal(left, "x"));
    });
    // uPlot hides its own cursor first.
    over.addEventListener("mouseleave", () => this.point(this.cursor));
  }

  /**
   * @param {Content} content
   * @param {number} width [px]
   * @returns {Options}
   */
  options(content, width) {
    const { axes } = this;
    const unit = content.yUnit ?? axes.unit;
    const axis = { stroke: themed("--quiet"), grid: { stroke: themed("--line"), width: 1 }, ticks: { stroke: themed("--line"), width: 1, size: 4 }, font: "12px system-ui, sans-serif", labelFont: "12px system-ui, sans-serif" };
    return {
      width,
      height: HEIGHT,
      legend: { live: true },
      cursor: { points: { size: 7 }, drag: { x: true, y: false }, y: false },
      scales: { x: { time: false }, y: { range: (_u, low, high) => rangeOf(content, low, high) } },
      axes: [
        { ...axis, label: axes.x, labelSize: 18, size: 30 },
        { ...axis, label: unit ? `${axes.y} [${unit}]` : axes.y, labelSize: 18, size: 52 },
      ],
      series: [
        { label: axes.x, value: (_u, x) => (x === null ? "–" : `${number(x)} ${axes.xUnit}`) },
        ...content.curves.map((c) => ({
          label: c.label, stroke: c.colour, width: c.width ?? 1.6, dash: c.dash, points: { show: false },
          value: (/** @type {uPlot} */ _u, /** @type {number | null} */ y) => (y === null || y === undefined ? "–" : `${number(y)} ${unit}`),
        })),
      ],
      hooks: { drawClear: [(u) => drawLimits(u, content.limits ?? [])] },
    };
  }

  resize() {
    const width = this.plotBox.clientWidth;
    if (!this.inSight || width < 40) return;
    if (!this.plot) this.draw();
    else if (width !== this.plot.width) this.plot.setSize({ width, height: HEIGHT });
  }
}

/**
 * The vertical range: the data, and at least the wanted one.
 * @param {Content} content
 * @param {number | null} low
 * @param {number | null} high
 * @returns {[number, number]}
 */
function rangeOf({ range, limits }, low, high) {
  const all = [...(range ?? []), ...(limits ?? [])];
  const least = Math.min(low ?? Infinity, ...all);
  const most = Math.max(high ?? -Infinity, ...all);
  if (!Number.isFinite(least) || !Number.isFinite(most)) return [0, 1];
  const room = 0.06 * (most - least || Math.abs(most) || 1);
  return [least === 0 ? 0 : least - room, most + room];
}

/**
 * @param {uPlot} u
 * @param {number[]} limits
 */
function drawLimits(u, limits) {
  if (limits.length === 0) return;
  const { ctx, bbox } = u;
  const ratio = devicePixelRatio;
  ctx.save();
  ctx.strokeStyle = themed("--ink");
  ctx.lineWidth = ratio;
  ctx.setLineDash([6 * ratio, 4 * ratio]);
  ctx.beginPath();
  for (const x of limits) {
    const y = Math.round(u.valToPos(x, "y", true)) + 0.5;
    ctx.moveTo(bbox.left, y);
    ctx.lineTo(bbox.left + bbox.width, y);
  }
  ctx.stroke();
  ctx.restore();
}

/**
 * A number with four digits that matter.
 * @param {number} x
 * @returns {string}
 */
export function number(x) {
  const digits = Math.abs(x) < 1e-6 ? 0 : Math.max(0, 3 - Math.floor(Math.log10(Math.abs(x))));
  return fixed(x, Math.min(6, digits));
}

/**
 * Values times a factor; null where there is none, which uPlot leaves out.
 * @param {ArrayLike<number>} values
 * @param {number} factor
 * @returns {(number | null)[]}
 */
export function withGaps(values, factor) {
  return Array.from(values, (x) => (Number.isFinite(x) ? factor * x : null));
}
