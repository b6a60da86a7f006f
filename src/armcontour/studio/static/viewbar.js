// The bar over the drawing: what colours the path, how far errors are magnified, fit and zoom; and the legend.

import { draw, find, make, mark, say } from "./dom.js";
import { legendOf, scalesOf } from "./legend.js";
import { nowAndThen, oncePerFrame, READING } from "./state.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {import("./legend.js").Sample} Sample */
/** @typedef {import("./legend.js").Shades} Shades */

const COLOURINGS = { limit: "Limit", speed: "Speed", error: "Error" };
const LEGEND_EVERY = 250; // ms
const CORNERS = { one: "One corner", all: "All" };
const STAGES = { "2d": "2D", both: "Both", "3d": "3D" };

class Viewbar {
  /** @param {Store} store @param {View2d} view */
  constructor(store, view) {
    this.store = store;
    this.view = view;
    this.bar = find("#viewbar");
    this.legend = find("#legend");
    this.scales = make("div", { class: "scales", "aria-hidden": "true" });
    view.region.append(this.scales);
    this.legendAt = -Infinity;
    /** Width of the page for which the legend has its lines [px]. */
    this.wide = 0;
    /** What the legend and the scales show. */
    this.shown = "";
    this.timer = 0;
    this.build();
    const update = oncePerFrame(() => this.updateNow());
    for (const event of ["view", "theme"]) store.on(event, update);
    const follow = nowAndThen(READING, () => this.updateNow());
    for (const event of ["picture", "executed", "figures"]) store.on(event, follow);
    view.followers.add(follow);
    this.updateNow();
  }

  build() {
    const { store, view } = this;
    this.colours = this.choice("Colour by", COLOURINGS, (colour) => store.setView({ colour }));
    this.executed = this.toggle("Executed", "Show the executed tool, its error magnified (E)", () =>
      store.setView({ executed: !store.options.executed }),
    );
    this.factor = make("input", {
      type: "range",
      min: 0,
      max: 3,
      step: 0.05,
      value: 2,
      "aria-label": "Magnification of the error",
      oninput: () => store.setView({ magnify: Math.round(10 ** Number(this.factor?.value)) }),
    });
    this.auto = this.toggle("Auto", "Magnify errors so that they are well seen", () =>
      store.setView({ magnify: store.options.magnify ? 0 : Number(view.region.dataset.magnify) || 100 }),
    );
    this.times = make("span", { class: "times", text: "" });
    this.place = this.toggle("Place part", "Move and turn the part as a whole (M)", () =>
      store.setView({ place: !store.options.place }),
    );
    this.corners = this.choice("A drag of a tolerance changes", CORNERS, (corners) => store.setView({ corners }));
    this.stages = this.choice("View", STAGES, (stage) => store.setView({ stage }));
    const button = (/** @type {string} */ text, /** @type {string} */ title, /** @type {() => void} */ act) =>
      make("button", { type: "button", text, title, "aria-label": `${text}: ${title}`, onclick: act });
    this.bar.append(
      this.colours.element,
      this.executed,
      make("span", { class: "group magnify" }, [this.factor, this.times, this.auto]),
      this.corners.element,
      this.place,
      // Those of regions that are loaded later.
      make("button", {
        type: "button",
        id: "add-obstacle",
        "data-later": true,
        text: "Add obstacle",
        title: "A box beside the part, with a name and a height; drag it or its corner, press F2 to change them",
      }),
      make("span", { class: "spring" }),
      make("span", { class: "group" }, [
        button("−", "Zoom out (−)", () => view.zoomBy(1 / 1.4)),
        button("+", "Zoom in (+)", () => view.zoomBy(1.4)),
        button("Fit", "Show all (F)", () => view.fit()),
      ]),
      this.stages.element,
    );
  }

  /** @param {string} text @param {string} title @param {() => void} act @returns {HTMLButtonElement} */
  toggle(text, title, act) {
    return make("button", { type: "button", text, title, "aria-pressed": "false", onclick: act });
  }

  /**
   * One of several: buttons of which one is pressed.
   * @param {string} label @param {Record<string, string>} names @param {(name: any) => void} choose
   */
  choice(label, names, choose) {
    const buttons = Object.entries(names).map(([name, text]) =>
      make("button", {
        type: "button",
        text,
        "data-name": name,
        title: `${label}: ${text.toLowerCase()}`,
        onclick: () => choose(name),
      }),
    );
    const element = make("span", { class: "group choice", role: "group", "aria-label": label }, buttons);
    const show = (/** @type {string} */ chosen) =>
      buttons.forEach((b) => mark(b, "aria-pressed", String(b.dataset.name === chosen)));
    return { element, show };
  }

  updateNow() {
    const { options } = this.store;
    const { magnify } = this.view.region.dataset;
    this.colours?.show(options.colour);
    this.stages?.show(options.stage);
    const corners = this.store.latest("picture")?.head.corners ?? [];
    const single = corners.some((/** @type {any} */ x) => x.waypoint !== null);
    this.corners?.show(single ? options.corners : "all");
    if (this.corners) {
      this.corners.element.hidden = !corners.length;
      const one = /** @type {HTMLButtonElement} */ (this.corners.element.firstChild);
      one.disabled = !single;
      one.title = single ? "A drag changes the tolerance of its corner" : "Corners of several contours have one tolerance: corners.tolerance, or that of a layer";
    }
    const pressed = [[this.executed, options.executed], [this.place, options.place], [this.auto, options.magnify === 0]];
    for (const [button, is] of /** @type {[HTMLElement | undefined, boolean][]} */ (pressed))
      if (button) mark(button, "aria-pressed", String(is));
    if (this.times) say(this.times, magnify ? `×${magnify}` : "");
    if (this.factor && magnify && document.activeElement !== this.factor)
      this.factor.value = String(Math.log10(Number(magnify)));
    this.updateLegend();
  }

  /** Lines that the legend has needed stay: the drawing above does not change its size with every limit that binds. */
  keepLines() {
    const { legend } = this;
    if (innerWidth !== this.wide) legend.style.minHeight = "";
    this.wide = innerWidth;
    legend.style.minHeight = `${legend.offsetHeight}px`;
  }

  /** The legend is not made again at every move. */
  updateLegend() {
    clearTimeout(this.timer);
    const wait = this.legendAt + LEGEND_EVERY - performance.now();
    if (wait > 0) {
      this.timer = setTimeout(() => this.updateLegend(), wait);
      return;
    }
    this.legendAt = performance.now();
    const picture = this.store.latest("picture");
    if (!picture) return;
    const { layers, region } = this.view;
    const magnify = this.store.options.executed ? Number(region.dataset.magnify) : 0;
    const { scale } = this.view.view;
    const entries = legendOf(this.store, layers, picture, magnify);
    const scales = scalesOf(scale, magnify);
    const shown = JSON.stringify([entries, scales]);
    if (shown === this.shown) return;
    this.shown = shown;
    this.legend.replaceChildren(...entries.map((x) => make("span", {}, partsOf(x))));
    this.keepLines();
    this.scales.replaceChildren(...scales.map((x) => make("span", { class: "scale" }, partsOf(x))));
  }
}

/** A sample with its text, or shades between theirs. @param {Sample | Shades} entry @returns {(Node | string)[]} */
function partsOf(entry) {
  if (!("shades" in entry)) return [line(entry), ` ${entry.text}`];
  const { shades, from, to } = entry;
  const canvas = make("canvas", { width: 96, height: 8, "aria-hidden": "true" });
  const context = canvas.getContext("2d");
  shades.forEach((shade, k) => {
    if (!context) return;
    context.fillStyle = shade;
    context.fillRect((96 * k) / shades.length, 0, 96 / shades.length, 8);
  });
  return [`${from} `, canvas, ` ${to}`];
}

/** @param {Sample} sample @returns {SVGElement} */
function line({ colour, dash, width, length, corners }) {
  const svg = draw("svg", { width: Math.round(length), height: corners ? 12 : 8, "aria-hidden": "true" });
  if (corners) {
    const transform = `translate(${length / 2} 6)`;
    svg.append(draw("polygon", { points: corners.join(" "), fill: colour, transform }));
    return svg;
  }
  const looks = {
    d: `M0 4H${length}`,
    stroke: colour,
    "stroke-width": width,
    "stroke-dasharray": dash.join(" ") || "none",
  };
  svg.append(draw("path", looks));
  return svg;
}

/** @param {Store} store @param {View2d} view */
export function init(store, view) {
  new Viewbar(store, view);
}
