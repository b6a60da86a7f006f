// The view as a file: the drawing as SVG or PNG, the arm as PNG.

import { show } from "./ask.js";
import { find, give, make } from "./dom.js";
import { Layers } from "./layers.js";
import { notify, tellEarly } from "./messages.js";
import { armSheet, drawingSheet } from "./sheet.js";
import { SvgContext, Trace } from "./svg.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {import("./arm3d.js").ArmView} ArmView */
/** @typedef {import("./sheet.js").Sheet} Sheet */

// Files may be looked at closely: shorter pieces of lines stay than on the screen.
const SHORTEST = 0.15; // px
const RATIO = 2;
const CHOICES = {
  svg: { text: "Drawing as SVG", of: ["2d", "both"] },
  png: { text: "Drawing as PNG", of: ["2d", "both"] },
  arm: { text: "Arm as PNG", of: ["both", "3d"] },
};

class Pictures {
  /** @param {Store} store @param {View2d} view @param {ArmView} arm */
  constructor(store, view, arm) {
    this.store = store;
    this.view = view;
    this.arm = arm;
    this.measuring = /** @type {CanvasRenderingContext2D} */ (make("canvas").getContext("2d"));
    find("#picture").addEventListener("click", () => this.ask());
  }

  async ask() {
    const { store } = this;
    if (!store.latest("picture")) return tellEarly("There is nothing to take a picture of yet: no path has been shown.");
    const { stage } = store.options;
    const choices = Object.entries(CHOICES).filter(([, { of }]) => of.includes(stage));
    const light = make("input", { type: "checkbox" });
    const content = [make("p", { text: "What is shown, with title, legend and scales." })];
    if (store.theme === "dark") content.push(make("p", {}, [make("label", { class: "field" }, [light, " in light colours, to print"])]));
    const kind = await show("Take a picture", content, [
      ...choices.map(([value, { text }]) => ({ value, text })),
      { value: "", text: "Cancel" },
    ]);
    if (!kind) return;
    try {
      await this.take(/** @type {keyof typeof CHOICES} */ (kind), light.checked ? inLight(store) : store);
    } catch (error) {
      notify(`The picture could not be made: ${error instanceof Error ? error.message : error}`, "alarm");
    }
  }

  /** @param {keyof typeof CHOICES} kind @param {Store} store */
  async take(kind, store) {
    const name = nameOf(store) + (kind === "arm" ? "-arm.png" : `.${kind}`);
    const content = kind === "svg" ? this.svg(store) : await bitmap(kind === "png" ? this.drawing(store) : this.seen(store));
    give(content, name);
    notify(`${name} was given to the browser to save.`);
  }

  /** @param {Store} store @returns {Blob} */
  svg(store) {
    const sheet = this.drawing(store, /** @type {any} */ (Trace));
    const context = new SvgContext(sheet.width, sheet.height, (text, font) => {
      this.measuring.font = font;
      return this.measuring.measureText(text).width;
    });
    sheet.paint(/** @type {any} */ (context));
    return new Blob([context.file(sheet.title)], { type: "image/svg+xml" });
  }

  /** @param {Store} store @param {import("./strokes.js").Way} [Way] @returns {Sheet} */
  drawing(store, Way) {
    const layers = new Layers(store, Way, SHORTEST);
    // Errors are magnified as on the screen.
    layers.factor = this.view.layers.factor;
    return drawingSheet(store, layers, this.view.view, this.measuring);
  }

  /** @param {Store} store @returns {Sheet} */
  seen(store) {
    const seen = this.arm.still(store.theme, RATIO);
    if (!seen) throw new Error("the arm is not shown yet.");
    return armSheet(store, seen, this.measuring);
  }
}

/** The same, as it looks in light colours. @param {Store} store @returns {Store} */
function inLight(store) {
  return Object.create(store, { theme: { value: "light" } });
}

/** Name of the file, without its ending. @param {Store} store @returns {string} */
function nameOf(store) {
  const parts = [store.document?.name || "untitled", store.latest("picture")?.head.run];
  return parts.filter(Boolean).join("-").replace(/[^\p{L}\p{N}._-]+/gu, "-");
}

/** @param {Sheet} sheet @returns {Promise<Blob>} */
async function bitmap(sheet) {
  const canvas = make("canvas", { width: RATIO * sheet.width, height: RATIO * sheet.height });
  const context = canvas.getContext("2d", { alpha: false });
  if (!context) throw new Error("the browser gives no canvas.");
  context.scale(RATIO, RATIO);
  sheet.paint(context);
  const blob = await new Promise((/** @type {(found: Blob | null) => void} */ resolve) => canvas.toBlob(resolve));
  if (!blob) throw new Error("the browser has no room for it.");
  return blob;
}

/** @param {Store} store @param {View2d} view @param {ArmView} arm */
export function init(store, view, arm) {
  new Pictures(store, view, arm);
}
