// Charts: tool speed along the path, joint usage, and contour error.

import { Chart, number, withGaps } from "./chart.js";
import { RUN_COLOURS, themed } from "./colours.js";
import { rowOf, textOf } from "./format.js";
import { find } from "./dom.js";
import { errorsOf } from "./motion.js";
import { largest } from "./polylines.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./chart.js").Curve} Curve */
/** @typedef {import("./chart.js").Content} Content */

/** While frames come, charts wait so long between two drawings [ms]. */
const PAUSE = 66;
const LONGEST_PAUSE = 500;
/** For each ms that charts take, others have so many. */
const ROOM = 9;
/** Values at the cursor change so often at most [ms]. */
const READING = 100;
/** A chart over arc length has at least so many places. */
const FEWEST = 600;
/** Dashes of joints: no two joints with the same colour have the same one. */
const DASHES = [[], [9, 3], [3, 3], [9, 3, 3, 3], [1, 3], [14, 4]];
const DEMANDS = /** @type {const} */ ([
  ["velocity", "usage_v", "Joint velocity", "velocity"],
  ["acceleration", "usage_a", "Joint acceleration", "acceleration"],
  ["torque", "usage_torque", "Joint torque", "torque"],
]);

/**
 * Fill the region of the charts.
 * @param {Store} store
 * @param {Link} _link
 */
export function init(store, _link) {
  const charts = new Charts(find("#charts"), store);
  for (const event of ["picture", "executed", "arm"]) store.on(event, () => charts.renew());
  store.on("time", () => charts.pointSoon());
  store.on("theme", () => charts.repaint());
  store.on("refusal", () => charts.grey());
}

class Charts {
  /**
   * @param {HTMLElement} region
   * @param {Store} store
   */
  constructor(region, store) {
    this.region = region;
    this.store = store;
    const overTime = { x: "Time [s]", xUnit: "s" };
    const byTime = (/** @type {number} */ t) => store.setTime(t);
    const byLength = (/** @type {number} */ s) => store.setPlace(s / 1000);
    this.speed = new Chart("speed", { title: "Tool speed along the path", x: "Arc length [mm]", xUnit: "mm", y: "Speed", unit: "mm/s" }, byLength);
    this.demands = DEMANDS.map(([name, , title]) => new Chart(name, { ...overTime, title: `${title} as a share of its limit`, y: "Share", unit: "%" }, byTime));
    this.error = new Chart("error", { ...overTime, title: "Contour error of the executed tool", y: "Error", unit: "µm" }, byTime);
    this.all = [this.speed, ...this.demands, this.error];
    region.append(...this.all.map((x) => x.element));
    /** True if charts are being drawn, and whether something came meanwhile. */
    this.works = false;
    this.again = false;
    this.pause = PAUSE;
    addEventListener("beforeprint", () => this.all.forEach((x) => x.draw()));
  }

  /** Draw what is new, soon. */
  renew() {
    this.again = true;
    if (this.works) return;
    this.works = true;
    setTimeout(() => this.fill(), this.pause);
  }

  repaint() {
    for (const x of this.all) x.repaint();
    this.renew();
  }

  /** One chart after the other, with room between them: charts never delay the drawing above for long. */
  async fill() {
    this.again = false;
    let cost = 0;
    try {
      for (const step of [() => this.fillSpeed(), ...DEMANDS.map((_, k) => () => this.fillDemand(k)), () => this.fillError()]) {
        const start = performance.now();
        step();
        cost += performance.now() - start;
        await new Promise((go) => setTimeout(go));
      }
      this.grey();
      this.point();
    } finally {
      this.works = false;
    }
    this.pause = Math.min(LONGEST_PAUSE, Math.max(PAUSE, ROOM * cost));
    if (this.again) this.renew();
  }

  fillSpeed() {
    const picture = this.store.latest("picture");
    // A long drawing comes without a plan first.
    this.speed.element.hidden = !picture?.arrays.path_s.length;
    if (picture?.arrays.path_s.length) this.speed.show(speedContent(picture));
  }

  /** @param {number} k */
  fillDemand(k) {
    const [, array, , what] = DEMANDS[k];
    const picture = this.store.latest("picture");
    const usage = picture?.arrays[array];
    // Shares of limits that there are not are zero.
    const limited = Boolean(usage?.some((x) => x !== 0));
    this.demands[k].element.hidden = !limited;
    const names = this.store.latest("arm")?.head.joints?.map((/** @type {any} */ x) => x.name) ?? [];
    if (picture && usage && limited) this.demands[k].show(demandContent(picture, usage, names, what));
  }

  fillError() {
    const executed = this.store.latest("executed");
    this.error.element.hidden = !executed;
    if (executed) this.error.show(errorContent(executed));
  }

  /** Values at the cursor are text, which costs more than a line: not in every frame. */
  pointSoon() {
    if (this.pointing) return;
    this.pointing = setTimeout(() => {
      this.pointing = undefined;
      this.point();
    }, READING);
  }

  point() {
    this.speed.point(1000 * this.store.place);
    for (const x of [...this.demands, this.error]) x.point(this.store.time);
  }

  /** Under a refusal the last good curves stay, greyed. */
  grey() {
    const { store } = this;
    this.region.classList.toggle("stale", store.refusal !== null);
    this.error.element.classList.toggle("stale", !store.isCurrent(store.latest("executed")));
  }
}

/** @param {Frame} picture @returns {Content} */
function speedContent(picture) {
  const { path_s: places } = picture.arrays;
  const s = refined(places);
  const [speed, assigned] = [picture.arrays.speed, picture.arrays.assigned].map((y) => resampled(places, y, s, 1000));
  const x = s.map((y) => 1000 * y);
  const curves = /** @type {Curve[]} */ ([]);
  if (assigned.some((y) => y !== null)) curves.push({ label: "assigned", colour: themed("--ink"), dash: [2, 3], width: 1.2, y: assigned });
  curves.push({ label: "tool", colour: RUN_COLOURS[1], width: 1.8, y: speed });
  return {
    x, curves, range: [0, 0],
    summary: `At most ${number(largest(speed))} mm/s.`,
  };
}

/**
 * @param {Frame} picture
 * @param {Numbers} usage (m, dof)
 * @param {string[]} names of the joints
 * @param {string} what
 * @returns {Content}
 */
function demandContent(picture, usage, names, what) {
  const { t } = picture.arrays;
  const dof = usage.length / t.length;
  const most = { share: 0, joint: 0 };
  const curves = Array.from({ length: dof }, (_, j) => {
    const y = new Float64Array(t.length);
    for (let k = 0; k < t.length; k += 1) y[k] = 100 * usage[k * dof + j];
    const share = largest(y.map(Math.abs));
    if (share > most.share) Object.assign(most, { share, joint: j });
    const name = names[j] ?? `joint ${j + 1}`;
    return { label: name, colour: RUN_COLOURS[j % RUN_COLOURS.length], dash: DASHES[j % DASHES.length], y: [...y].some(Number.isNaN) ? withGaps(y, 1) : y };
  });
  const name = curves[most.joint]?.label ?? "";
  return {
    x: t, curves, limits: [-100, 100],
    summary: `At most ${most.share.toFixed(1)} % of the ${what} limit, ${name}.`,
  };
}

/** @param {Frame} executed @returns {Content} */
function errorContent(executed) {
  const { t, error } = errorsOf(executed);
  const [max, rms] = ["max", "rms"].map((x) => rowOf(executed.head, `contour_error.${x}`));
  const [factor, unit] = max.value >= 1e-3 ? [1e3, "mm"] : [1e6, "µm"];
  return {
    x: t, range: [0, 0], yUnit: unit,
    curves: [{ label: "executed", colour: RUN_COLOURS[1], width: 1.6, y: withGaps(error, factor) }],
    summary: `At most ${textOf(max)}, root mean square ${textOf(rms)}.`,
  };
}

/**
 * Places with others between them, so that the cursor has a value everywhere.
 * @param {Numbers} places increasing
 * @returns {Float64Array}
 */
function refined(places) {
  const end = places[places.length - 1];
  const found = [...places];
  for (let k = 1; k < FEWEST && places.length < FEWEST; k += 1) found.push((end * k) / FEWEST);
  return Float64Array.from(found).sort();
}

/**
 * Values of a curve at other places; null beyond its ends and where there is none.
 * @param {Numbers} from increasing
 * @param {Numbers} values
 * @param {Numbers} at increasing
 * @param {number} factor
 * @returns {(number | null)[]}
 */
function resampled(from, values, at, factor) {
  const found = /** @type {(number | null)[]} */ ([]);
  let k = 0;
  for (const x of at) {
    while (k + 2 < from.length && from[k + 1] <= x) k += 1;
    const span = from[k + 1] - from[k];
    const share = span > 0 ? (x - from[k]) / span : 0;
    const inside = x >= from[0] && x <= from[from.length - 1];
    const y = values[k] + share * (values[k + 1] - values[k]);
    found.push(inside && Number.isFinite(y) ? factor * y : null);
  }
  return found;
}
