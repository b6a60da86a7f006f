// The bar over the drawing: what colours the path, how far errors are magnified, fit and zoom; and the legend.

import { heat, styleOf, themed } from "./colours.js";
import { draw, find, make, say } from "./dom.js";
import { mm, short } from "./format.js";
import { kindAt } from "./strokes.js";
import { oncePerFrame } from "./state.js";
import { scaleBar } from "./viewport.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./view2d.js").View2d} View2d */

const COLOURINGS = { limit: "Limit", speed: "Speed", error: "Error" };
const LEGEND_EVERY = 250; // ms
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
    this.timer = 0;
    this.build();
    this.update = oncePerFrame(() => this.updateNow());
    for (const event of ["view", "theme", "picture", "executed", "compare"]) store.on(event, this.update);
    view.followers.add(this.update);
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
    this.stages = this.choice("View", STAGES, (stage) => store.setView({ stage }));
    const button = (/** @type {string} */ text, /** @type {string} */ title, /** @type {() => void} */ act) =>
      make("button", { type: "button", text, title, "aria-label": `${text}: ${title}`, onclick: act });
    this.bar.append(
      this.colours.element,
      this.executed,
      make("span", { class: "group magnify" }, [this.factor, this.times, this.auto]),
      this.place,
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
      buttons.forEach((b) => b.setAttribute("aria-pressed", String(b.dataset.name === chosen)));
    return { element, show };
  }

  updateNow() {
    const { options } = this.store;
    const { magnify } = this.view.region.dataset;
    this.colours?.show(options.colour);
    this.stages?.show(options.stage);
    this.executed?.setAttribute("aria-pressed", String(options.executed));
    this.place?.setAttribute("aria-pressed", String(options.place));
    this.auto?.setAttribute("aria-pressed", String(options.magnify === 0));
    if (this.times) say(this.times, magnify ? `×${magnify}` : "");
    if (this.factor && magnify && document.activeElement !== this.factor)
      this.factor.value = String(Math.log10(Number(magnify)));
    this.updateLegend();
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
    const { colour } = this.store.options;
    const entries = colour === "limit" ? this.kinds(picture) : [this.scale(picture, colour)];
    this.legend.replaceChildren(...entries, ...this.lines());
    this.scales.replaceChildren(...this.bars());
  }

  /** Kinds of limits on the path. @param {import("./state.js").Frame} picture @returns {HTMLElement[]} */
  kinds(picture) {
    const kinds = new Set();
    for (let i = 0; i < picture.arrays.binding.length; i++) kinds.add(kindAt(picture, i));
    return [...kinds].map((kind) => {
      const { colour, dash, label } = styleOf(kind, this.store.theme);
      return entry(colour, dash, label, 3);
    });
  }

  /** A scale of heat. @param {import("./state.js").Frame} picture @param {string} colour @returns {HTMLElement} */
  scale(picture, colour) {
    const executed = this.store.latest("executed");
    const [unit, most, digits] =
      colour === "speed"
        ? ["mm/s", this.view.layers.mostSpeed(picture), 1]
        : ["mm", executed ? this.view.layers.mostError(executed) : 0, 3];
    const canvas = make("canvas", { width: 96, height: 8, "aria-hidden": "true" });
    const context = canvas.getContext("2d");
    for (let x = 0; x < 96 && context; x++) {
      context.fillStyle = heat(x / 95, this.store.theme);
      context.fillRect(x, 0, 1, 8);
    }
    return make("span", {}, [`${colour} 0 `, canvas, ` ${mm(Number(most), Number(digits))} ${unit}`]);
  }

  /** Lines beside the path. @returns {HTMLElement[]} */
  lines() {
    const found = [entry(themed("--faint"), [5, 4], "objective", 1)];
    if (this.view.region.dataset.magnify && this.store.options.executed)
      found.push(entry(themed("--executed"), [], `executed tool, error ×${this.view.region.dataset.magnify}`, 1.5));
    if (this.store.latest("picture", "compare")) found.push(entry(themed("--compared"), [8, 4], "compared", 1.6));
    return found;
  }

  /** Lengths on the screen: of the drawing, and of magnified errors. @returns {HTMLElement[]} */
  bars() {
    const { length, pixels } = scaleBar(this.view.view.scale);
    const parts = [
      make("span", { class: "scale" }, [line("currentColor", [], 2, pixels), ` ${short(1000 * length)} mm`]),
    ];
    const magnify = Number(this.view.region.dataset.magnify);
    if (magnify > 1 && this.store.options.executed) {
      const error = scaleBar(this.view.view.scale * magnify, 60);
      parts.push(
        make("span", { class: "scale" }, [
          line(themed("--executed"), [], 2, error.pixels),
          ` ${short(1000 * error.length)} mm of error`,
        ]),
      );
    }
    return parts;
  }
}

/** @param {string} colour @param {number[]} dash @param {string} label @param {number} width @returns {HTMLElement} */
function entry(colour, dash, label, width) {
  return make("span", {}, [line(colour, dash, width, 26), ` ${label}`]);
}

/**
 * A sample of a line.
 * @param {string} colour @param {number[]} dash @param {number} width @param {number} length px @returns {SVGElement}
 */
function line(colour, dash, width, length) {
  const svg = draw("svg", { width: Math.round(length), height: 8, "aria-hidden": "true" });
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
