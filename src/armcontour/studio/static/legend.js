// Legend of the drawing's lines, and its scales.

import { heat, styleOf, themed } from "./colours.js";
import { handledOf } from "./corner.js";
import { headOf } from "./figures.js";
import { mm, short } from "./format.js";
import { scaleOf } from "./polylines.js";
import { inches, shownText } from "./units.js";
import { scaleBar } from "./viewport.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./layers.js").Layers} Layers */
/**
 * A sample of a line and its meaning; with `corners` it is a mark of this shape. All in px.
 * @typedef {{colour: string, dash: number[], width: number, length: number, text: string, corners?: number[][]}} Sample
 */
/** Shades from one text to another. @typedef {{shades: string[], from: string, to: string}} Shades */

const LENGTH = 26; // px
/** Mark of the tool at the time when two bodies are nearest to each other [px]. */
export const NEAREST = [[-7, -5], [7, 5], [7, -5], [-7, 5]];
const SHADES = 24;
/** Maximum lengths of the scale bars of the drawing and of magnified errors [px]. */
const [SCALE_LENGTH, ERROR_LENGTH] = [90, 60];

/** @param {string} colour @param {number[]} dash @param {number} width @param {string} text @param {number} [length] @returns {Sample} */
const sample = (colour, dash, width, text, length = LENGTH) => ({ colour, dash, width, length, text });

/** Return the samples of active limits; their shares are above the drawing. @param {Store} store @returns {Sample[]} */
function kindsOf(store) {
  const { kinds } = headOf(store);
  return (kinds?.length ? kinds : [{ kind: "unknown" }]).map((/** @type {any} */ { kind }) => {
    const { colour, dash, label } = styleOf(kind, store.theme);
    return sample(colour, dash, 3, label);
  });
}

/** Return the samples of the path's colours: limit kinds, or a scale. @param {Store} store @param {Layers} layers @returns {(Sample | Shades)[]} */
function colouringOf(store, layers) {
  const { colour } = store.options;
  const executed = store.refusal ? null : store.latest("executed");
  // Without an execution, errors are unknown, so limits colour the path.
  if (colour === "limit" || (colour === "error" && !executed)) return kindsOf(store);
  const shades = Array.from({ length: SHADES }, (_, k) => heat(k / (SHADES - 1), store.theme));
  if (executed && colour === "error") {
    const { allowed } = executed.head;
    const scale = { shades, from: "off the drawing 0", to: `${shownText(`${short(1000 * scaleOf(executed), 3)} mm`)} ${allowed == null ? "at most" : "allowed"}` };
    const isOver = allowed != null && layers.most("executed", "off") > allowed;
    return [scale, ...(isOver ? [sample(themed("--alarm"), [], 3, "more than allowed")] : [])];
  }
  return [{ shades, from: `${colour} 0`, to: shownText(`${mm(layers.most("picture", "speed"), 1)} mm/s`) }];
}

/**
 * Return the legend of the drawing.
 * @param {Store} store @param {Layers} layers @param {Frame} picture
 * @param {number} magnify factor of the executed tool's error; 0: it is not drawn
 * @returns {(Sample | Shades)[]}
 */
export function legendOf(store, layers, picture, magnify) {
  const found = colouringOf(store, layers);
  if (magnify) found.push(sample(themed("--executed"), [], 1.5, `executed tool, error ×${magnify}`));
  found.push(sample(themed("--faint"), [5, 4], 1, "objective"));
  if (picture.head.kerfs.length) {
    found.push(sample(themed("--ink"), [2, 2], 1, "as drawn"), sample(themed("--kerf"), [], 8, "kerf"));
  }
  if (picture.arrays.rapid?.length && !found.some((x) => "text" in x && x.text.startsWith("rapids"))) found.push(sample(themed("--faint"), [1.5, 4], 1, "rapid"));
  if (picture.arrays.idle?.length) found.push(sample(themed("--ink"), [], 0.8, "process off"));
  if (handledOf(picture).length) found.push({ ...sample(themed("--handle"), [], 1, "corner tolerance", 10), corners: [[0, -5], [5, 0], [0, 5], [-5, 0]] });
  if (headOf(store).nearest) found.push({ ...sample(themed("--refusal"), [], 1, "nearest pair", 14), corners: NEAREST });
  return found;
}

/**
 * Return the scale bars of the drawing, and of magnified errors.
 * @param {number} scale px per m @param {number} magnify factor of errors; 0: they are not drawn
 * @returns {Sample[]}
 */
export function scalesOf(scale, magnify) {
  const found = [scaleSample(scale, SCALE_LENGTH, themed("--quiet"), "")];
  if (magnify > 1) found.push(scaleSample(scale * magnify, ERROR_LENGTH, themed("--executed"), " of error"));
  return found;
}

/** Return a scale bar with a round length in the shown unit. @param {number} scale px per m @param {number} most px @param {string} colour @param {string} meaning @returns {Sample} */
function scaleSample(scale, most, colour, meaning) {
  const [unit, size] = inches.value ? ["in", 0.0254] : ["mm", 0.001];
  const { length, pixels } = scaleBar(scale * size, most);
  return sample(colour, [], 2, `${short(length)} ${unit}${meaning}`, pixels);
}
