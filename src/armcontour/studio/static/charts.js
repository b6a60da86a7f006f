// Charts over time: joint usage and contour error; and the tool speed along the path.

import { RUN_COLOURS, themed } from "./colours.js";
import { find, make, mark, say, whileSeen } from "./dom.js";
import { rowOf, short, textOf } from "./format.js";
import { largest } from "./polylines.js";
import { nowAndThen, READING } from "./state.js";
import { lengthUnit } from "./length_unit.js";
import { KNOB } from "./timeline.js";
import { inches, shownRow } from "./units.js";
import { CLICKED } from "./view2d.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {import("./vendor/uplot.js").default} uPlot */
/** @typedef {{label: string, colour: string, dash?: number[], y: ArrayLike<number | null>}} Curve `y` in the unit of the chart */
/** @typedef {{x: ArrayLike<number>, unit: string, curves: Curve[], limits?: number[], summary: string}} Content */

/** Minimum time between two draws of the charts while frames arrive [ms]; the drawing needs the time. */
const EVERY = 500;
const HEIGHT = 122; // px
/** Dashes of joint curves: joints with the same colour have different dashes. */
const DASHES = [[], [9, 3], [3, 3], [9, 3, 3, 3], [1, 3], [14, 4]];
/** A joint limit is drawn if the motion uses at least this share of it [%]. */
const NEAR = 50;
const DEMANDS = /** @type {const} */ ([["velocity", "usage_v"], ["acceleration", "usage_a"], ["torque", "usage_torque"]]);

/**
 * A chart with title, sentence, curves, and a line at the shown time. Their values are those under the pointer, without a pointer those
 * at the line. A click goes to a place, and the line can be dragged; elsewhere, a drag zooms, and a double click shows the whole.
 */
class Chart {
  /** @param {string} name @param {string} title @param {() => string} xUnit unit of the horizontal axis @param {(x: number) => void} choose called with the place to which the user goes */
  constructor(name, title, xUnit, choose) {
    this.xUnit = xUnit;
    this.choose = choose;
    this.summary = make("p", { class: "chart-summary" });
    this.box = make("div", { class: "chart-plot" });
    const head = make("figcaption", {}, [make("h3", { text: title }), this.summary]);
    this.element = make("figure", { class: "chart", "data-chart": name, "aria-label": title }, [head, this.box]);
    /** @type {uPlot | null} */
    this.plot = null;
    this.signature = "";
    /** The shown place, in the unit of the horizontal axis. */
    this.cursor = 0;
    /** Line at the shown place. */
    this.now = make("div", { class: "now" });
    /** Where the button was pressed [px], and whether it holds the line; null while it is up. @type {{from: number, isLine: boolean} | null} */
    this.press = null;
    /** Whether the pointer is in the chart, so that the values are those under it. */
    this.isHovered = false;
    new ResizeObserver(() => this.box.clientWidth && this.plot?.setSize({ width: this.box.clientWidth, height: HEIGHT })).observe(this.box);
  }

  /** @param {Content | null} content null: there is nothing to show */
  async show(content) {
    this.element.hidden = !content;
    if (!content) return;
    const { x, unit, curves, limits = [], summary } = content;
    say(this.summary, summary);
    const { default: Plot } = await import("./vendor/uplot.js");
    const data = /** @type {uPlot.AlignedData} */ (/** @type {unknown} */ ([x, ...curves.map(({ y }) => y)]));
    const signature = JSON.stringify([document.documentElement.dataset.theme, this.xUnit(), unit, limits, curves.map(({ label, colour }) => [label, colour])]);
    if (signature === this.signature) this.plot?.setData(data);
    else {
      this.plot?.destroy();
      this.plot = new Plot(this.options(content, limits), data, this.box);
      this.listen(this.plot.over);
    }
    this.signature = signature;
    this.point(this.cursor);
  }

  /** @param {HTMLElement} over on which one points */
  listen(over) {
    over.append(this.now);
    const within = (/** @type {MouseEvent} */ event) => event.clientX - over.getBoundingClientRect().left;
    const isNear = (/** @type {PointerEvent} */ event) => Math.abs(within(event) - this.x) <= KNOB;
    const go = (/** @type {MouseEvent} */ event) => this.choose(this.plot?.posToVal(within(event), "x") ?? 0);
    over.addEventListener("pointerdown", (event) => {
      if (event.button > 0) return;
      over.setPointerCapture(event.pointerId);
      this.press = { from: within(event), isLine: isNear(event) };
    });
    over.addEventListener("pointermove", (event) => {
      mark(over, "data-near", String(this.press ? this.press.isLine : isNear(event)));
      if (this.press?.isLine && Math.abs(within(event) - this.press.from) > CLICKED) go(event);
    });
    over.addEventListener("pointerup", (event) => {
      if (this.press && Math.abs(within(event) - this.press.from) <= CLICKED) go(event);
    });
    over.addEventListener("lostpointercapture", () => (this.press = null));
    this.isHovered = false;
    over.addEventListener("mouseenter", () => (this.isHovered = true));
    // uPlot hides its own cursor first.
    over.addEventListener("mouseleave", () => {
      this.isHovered = false;
      this.point(this.cursor);
    });
  }

  /** Where the line is [px]. */
  get x() {
    return this.plot?.valToPos(this.cursor, "x") ?? 0;
  }

  /** Put the line at a place. @param {number} x in the unit of the axis */
  point(x) {
    this.cursor = x;
    if (!this.isHovered) this.plot?.setCursor({ left: this.x, top: 0 }, false);
    this.placeLine();
    this.element.dataset.cursor = String(x);
  }

  placeLine() {
    const { x } = this;
    this.now.hidden = x < 0 || x > (this.plot?.over.clientWidth ?? 0);
    this.now.style.transform = `translateX(${x.toFixed(1)}px)`;
  }

  /** @param {Content} content @param {number[]} limits @returns {uPlot.Options} */
  options({ unit, curves }, limits) {
    const axis = { stroke: themed("--quiet"), grid: { stroke: themed("--line"), width: 1 }, ticks: { stroke: themed("--line"), width: 1, size: 4 }, font: "12px system-ui, sans-serif" };
    const text = (/** @type {string} */ of) => (/** @type {any} */ _u, /** @type {number | null} */ y) => (y == null ? "–" : `${short(Number(y.toFixed(2)), 3).replace("-", "−")} ${of}`);
    return {
      width: this.box.clientWidth,
      height: HEIGHT,
      cursor: { points: { size: 7 }, drag: { x: true, y: false, dist: CLICKED }, y: false, bind: { mousedown: (_u, _over, press) => (event) => this.press?.isLine ? null : press(event) } },
      scales: { x: { time: false }, y: { range: (_u, low, high) => rangeOf([low ?? 0, high ?? 0, 0, ...limits]) } },
      axes: [{ ...axis, size: 26 }, { ...axis, size: 46 }],
      series: [
        { label: "at", value: text(this.xUnit()) },
        ...curves.map(({ label, colour, dash }) => ({ label, dash, stroke: colour, width: 1.6, points: { show: false }, value: text(unit) })),
      ],
      hooks: { drawClear: [(u) => drawLimits(u, limits)], draw: [() => this.placeLine()] },
    };
  }
}

/** Return an axis range that contains all values with a margin. @param {number[]} values @returns {[number, number]} */
function rangeOf(values) {
  const [low, high] = [Math.min(...values), Math.max(...values)];
  const room = 0.06 * (high - low || 1);
  return [low === 0 ? 0 : low - room, high + room];
}

/** @param {uPlot} u @param {number[]} limits */
function drawLimits(u, limits) {
  u.ctx.fillStyle = themed("--ink");
  for (const x of limits) u.ctx.fillRect(u.bbox.left, Math.round(u.valToPos(x, "y", true)), u.bbox.width, devicePixelRatio);
}

/** @param {Frame} picture @returns {Content} */
function speedContent({ arrays: { path_s: s, speed, assigned } }) {
  const { unit: length, factor } = lengthUnit();
  const scaled = (/** @type {Numbers} */ values) => Array.from(values, (x) => (Number.isFinite(x) ? x / factor : null));
  const curves = [{ label: "tool", colour: themed("--executed"), y: scaled(speed) }];
  if (assigned.some(Number.isFinite)) curves.unshift({ label: "assigned", colour: themed("--faint"), y: scaled(assigned) });
  const unit = `${length}/s`;
  return { x: s.map((x) => x / factor), unit, curves, summary: `At most ${short(largest(speed) / factor, 3)} ${unit}.` };
}

/** @param {Frame} picture @param {Numbers} usage (m, dof) @param {string[]} names of the joints @returns {Content | null} */
function demandContent({ arrays: { t } }, usage, names) {
  const dof = usage.length / t.length;
  const curves = Array.from({ length: dof }, (_, j) => ({
    label: jointLabel(j, names[j] ?? ""),
    colour: RUN_COLOURS[j % RUN_COLOURS.length],
    dash: DASHES[j % DASHES.length],
    y: Array.from(t, (_, k) => (Number.isFinite(usage[k * dof + j]) ? 100 * usage[k * dof + j] : null)),
  }));
  const most = curves.map(({ y }) => largest(y.map((x) => x && Math.abs(x))));
  const share = Math.max(...most);
  // Without a limit, its share is zero.
  if (!share) return null;
  return { x: t, unit: "%", curves, limits: share > NEAR ? [-100, 100] : [], summary: `At most ${share.toFixed(1)} %, by joint ${curves[most.indexOf(share)].label}.` };
}

/** Return a joint's number, and its name without the word joint. @param {number} k @param {string} name */
const jointLabel = (k, name) => `${k + 1} ${name.replace(/_?joint_?\d*$/, "").replaceAll("_", " ")}`.trim();

/** @param {Frame} executed @returns {Content} */
function errorContent({ head, arrays: { t, error, breaks } }) {
  const [max, rms] = ["max", "rms"].map((x) => rowOf(head, `contour_error.${x}`));
  const [perMetre, metric] = max.value >= 1e-3 ? [1e3, "mm"] : [1e6, "µm"];
  // In inches, small errors are in thousandths of an inch.
  const [factor, unit] = inches.value ? (max.value >= 1e-3 ? [1 / 0.0254, "in"] : [1 / 2.54e-5, "mil"]) : [perMetre, metric];
  // Between contours the error is not defined, so no line is drawn there.
  const y = Array.from(error, (x, k) => (breaks.includes(k) ? null : factor * x));
  return { x: t, unit, curves: [{ label: "executed", colour: themed("--executed"), y }], summary: `At most ${textOf(shownRow(max))}, root mean square ${textOf(shownRow(rms))}.` };
}

/** @param {Store} store */
export function init(store) {
  const byTime = (/** @type {number} */ t) => store.setTime(t);
  const speed = new Chart("speed", "Tool speed along the path", () => lengthUnit().unit, (s) => store.setPlace(s * lengthUnit().factor));
  const demands = DEMANDS.map(([name]) => new Chart(name, `Joint ${name} as a share of its limit`, () => "s", byTime));
  const error = new Chart("error", "Contour error of the executed tool", () => "s", byTime);
  const region = find("#charts");
  region.append(...[speed, ...demands, error].map((x) => x.element));
  const update = () => {
    const [picture, executed] = [store.latest("picture"), store.latest("executed")];
    // An arm lists its joints from the floor; a motion has them by column.
    const names = /** @type {string[]} */ ([]);
    for (const { name, column } of store.latest("arm")?.head.joints ?? []) names[column] = name;
    // A long drawing first arrives without a plan.
    speed.show(picture?.arrays.path_s.length ? speedContent(picture) : null);
    DEMANDS.forEach(([, array], k) => {
      const usage = picture?.arrays[array];
      demands[k].show(picture && usage?.length ? demandContent(picture, usage, names) : null);
    });
    error.show(executed && errorContent(executed));
    // After a refusal, the last valid curves stay in grey.
    region.classList.toggle("stale", store.refusal !== null);
    error.element.classList.toggle("stale", !store.isCurrent(executed));
  };
  inches.subscribe(whileSeen(store, find("#tab-charts"), ["picture", "executed", "arm", "theme", "refusal"], nowAndThen(EVERY, update)));
  const point = nowAndThen(READING, () => {
    speed.point(store.place / lengthUnit().factor);
    for (const x of [...demands, error]) x.point(store.time);
  });
  store.on("time", point);
}
