// A picture that is taken along: its title above, the view, its legend and scales below. Drawn on a canvas,
// or on what writes SVG.

import { exactnessOf, hasMotion, knownOf } from "./figures.js";
import { outlineOf, planeOf, standing } from "./footprint.js";
import { mm, seconds } from "./format.js";
import { bandsOf, kindsOf, legendOf, scalesOf } from "./legend.js";
import { CROSS, SLOW, slowPlaces } from "./marks.js";
import { inksOf, Painter } from "./paint.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./layers.js").Layers} Layers */
/** @typedef {import("./viewport.js").Viewport} Viewport */
/** @typedef {import("./legend.js").Sample} Sample */
/** @typedef {import("./legend.js").Shades} Shades */
/** @typedef {CanvasRenderingContext2D} Context */
/** A line of words. @typedef {{text: string, font: string, ink: string}} Line */
/** An entry of the legend and its width [px]. @typedef {{entry: Sample | Shades, wide: number}} Entry */
/**
 * A picture [px]: `paint` draws it all.
 * @typedef {{title: string, width: number, height: number, paint: (context: Context) => void}} Sheet
 */
/** What goes around a view. @typedef {{lines: Line[], legend: (Sample | Shades)[], captions: string[]}} Told */

const MARGIN = 12; // px
const ROW = 18;
const GAP = 18;
const SHADES = 96;
const FAMILY = "system-ui, sans-serif";
const FONT = `12px ${FAMILY}`;
const TITLE = `600 15px ${FAMILY}`;

/**
 * The drawing with all that is over and under it, but nothing to grab.
 * @param {Store} store @param {Layers} layers @param {Viewport} view @param {Context} context measures texts
 * @returns {Sheet}
 */
export function drawingSheet(store, layers, view, context) {
  const picture = store.latest("picture");
  if (!picture) throw new Error("There is no picture yet.");
  layers.setScale(view.scale);
  const executed = store.refusal || !store.options.executed ? null : store.latest("executed");
  const magnify = executed ? layers.magnification(executed, view.scale) : 0;
  const { theme } = store;
  const legend = [...legendOf(store, layers, picture, magnify), ...bandsOf(picture, theme, view.scale)];
  const told = {
    lines: linesOf(store),
    legend: [...legend, ...scalesOf(view.scale, magnify, theme)],
    captions: [...store.underlays].map((x) => x.caption()).filter(Boolean),
  };
  const painter = new Painter(store, layers);
  return arrange(store, told, view, context, (on) => {
    painter.paint(on, view);
    obstacles(on, store, view);
    marks(on, store, view);
  });
}

/**
 * The arm as it is seen.
 * @param {Store} store @param {{image: HTMLCanvasElement, width: number, height: number, scale: number, posture: string}} seen
 *   `scale` in px per m, `width` and `height` in px of the page
 * @param {Context} context measures texts @returns {Sheet}
 */
export function armSheet(store, { image, width, height, scale, posture }, context) {
  const picture = store.latest("picture");
  const [first, ...rest] = linesOf(store);
  const lines = [first, ...rest, { text: posture, font: FONT, ink: inksOf(store.theme).quiet }];
  const kinds = picture ? kindsOf(picture, store.theme) : [];
  const legend = [...kinds.map((x) => ({ ...x, dash: [] })), ...scalesOf(scale, 0, store.theme)];
  return arrange(store, { lines, legend, captions: [] }, { width, height }, context, (on) =>
    on.drawImage(image, 0, 0, width, height),
  );
}

/** What the picture is of, and how good it is. @param {Store} store @returns {Line[]} */
function linesOf(store) {
  const inks = inksOf(store.theme);
  const { run } = store.latest("picture")?.head ?? {};
  const name = store.document?.name || "untitled";
  const lines = [{ text: run ? `${name}, run ${run}` : name, font: TITLE, ink: inks.ink }];
  const { duration, rms, max } = knownOf(store);
  const facts = factsOf({ duration, rms, max }).join(" · ");
  const word = store.refusal?.head.tier === 1 && hasMotion(store) ? "of the last motion that was possible" : exactnessOf(store);
  lines.push({ text: facts ? `${facts}\u00a0(${word})` : word, font: FONT, ink: inks.quiet });
  const compared = comparedOf(store);
  if (compared) lines.push({ text: compared, font: FONT, ink: inks.compared });
  if (store.refusal) lines.push({ text: `Refused: ${store.refusal.head.sentence}`, font: FONT, ink: inks.refusal });
  return lines;
}

/** Facts; a line ends between them, not within. @param {{duration?: number | null, rms?: number | null, max?: number | null}} known @returns {string[]} */
function factsOf({ duration, rms, max }) {
  const known = (/** @type {number | null | undefined} */ x) => x !== null && x !== undefined;
  return [
    known(duration) ? `cycle time ${seconds(duration)} s` : "",
    known(rms) ? `contour error ${mm(rms, 4)} mm RMS` : "",
    known(max) ? `at most ${mm(max, 4)} mm` : "",
  ]
    .filter(Boolean)
    .map((x) => x.replaceAll(" ", "\u00a0"));
}

/** The variant that is drawn beneath, with its figures. @param {Store} store @returns {string} */
function comparedOf(store) {
  const compare = store.document?.compare;
  if (!compare || !store.latest("picture", "compare")) return "";
  const heads = ["picture", "executed", "figures"].map((kind) => store.latest(kind, "compare")?.head ?? {});
  return [`compared with ${store.comparedPin?.name ?? `run ${compare.run}`}`, ...factsOf(Object.assign({}, ...heads))].join(" · ");
}

/**
 * Find the place of everything.
 * @param {Store} store @param {Told} told @param {{width: number, height: number}} size of the view
 * @param {Context} context measures texts @param {(context: Context) => void} draw the view, from 0, 0
 * @returns {Sheet}
 */
function arrange(store, { lines, legend, captions }, { width, height }, context, draw) {
  const inks = inksOf(store.theme);
  const room = width - 2 * MARGIN;
  const above = lines.flatMap((line) => wrap(line, room, context));
  const below = captions.flatMap((text) => wrap({ text, font: FONT, ink: inks.quiet }, room, context));
  const rows = flow(legend, room, context);
  const top = above.length * ROW + MARGIN;
  const bottom = (rows.length + below.length) * ROW + MARGIN;
  // Views need not be of whole pixels; pictures are, or their edges are half empty.
  const size = { width: Math.ceil(width), height: Math.ceil(top + height + bottom) };
  const paint = (/** @type {Context} */ on) => {
    on.fillStyle = inks.ground;
    on.fillRect(0, 0, size.width, size.height);
    write(on, above, MARGIN / 2);
    on.save();
    on.translate(0, top);
    on.beginPath();
    on.rect(0, 0, width, height);
    on.clip();
    draw(on);
    on.restore();
    edges(on, inks.line, size.width, [top, top + height]);
    rows.forEach((row, k) => writeRow(on, row, inks.quiet, top + height + MARGIN / 2 + (k + 0.5) * ROW));
    write(on, below, top + height + MARGIN / 2 + rows.length * ROW);
  };
  return { title: lines.map((x) => x.text).join("\n"), ...size, paint };
}

/** Words in as many lines as they need. @param {Line} line @param {number} room px @param {Context} context @returns {Line[]} */
function wrap({ text, font, ink }, room, context) {
  context.font = font;
  /** @type {string[]} */
  const found = [];
  for (const word of text.split(" ")) {
    const longer = found.length ? `${found[found.length - 1]} ${word}` : word;
    if (found.length && context.measureText(longer).width <= room) found[found.length - 1] = longer;
    else found.push(word);
  }
  return found.map((part) => ({ text: part, font, ink }));
}

/** Entries of the legend in rows. @param {(Sample | Shades)[]} legend @param {number} room px @param {Context} context @returns {Entry[][]} */
function flow(legend, room, context) {
  context.font = FONT;
  const wide = (/** @type {string} */ text) => context.measureText(text).width;
  /** @type {Entry[][]} */
  const rows = [];
  let left = Infinity;
  for (const entry of legend) {
    const own = "shades" in entry ? wide(entry.from) + SHADES + 12 + wide(entry.to) : entry.length + 6 + wide(entry.text);
    if (left + own > room) {
      rows.push([]);
      left = 0;
    }
    rows[rows.length - 1].push({ entry, wide: own });
    left += own + GAP;
  }
  return rows;
}

/** @param {Context} context @param {Line[]} lines @param {number} top px */
function write(context, lines, top) {
  context.textAlign = "left";
  context.textBaseline = "middle";
  lines.forEach(({ text, font, ink }, k) => {
    context.font = font;
    context.fillStyle = ink;
    context.fillText(text, MARGIN, top + (k + 0.5) * ROW);
  });
}

/** @param {Context} context @param {Entry[]} row @param {string} ink @param {number} y px */
function writeRow(context, row, ink, y) {
  context.textAlign = "left";
  context.textBaseline = "middle";
  context.font = FONT;
  let x = MARGIN;
  for (const { entry, wide } of row) {
    context.fillStyle = ink;
    if ("shades" in entry) {
      context.fillText(entry.from, x, y);
      context.fillText(entry.to, x + wide - context.measureText(entry.to).width, y);
      shades(context, entry.shades, x + context.measureText(entry.from).width + 6, y);
    } else {
      context.fillText(entry.text, x + entry.length + 6, y);
      sample(context, entry, x, y);
    }
    x += wide + GAP;
  }
}

/** @param {Context} context @param {string[]} all @param {number} x @param {number} y px */
function shades(context, all, x, y) {
  const step = SHADES / all.length;
  all.forEach((shade, k) => {
    context.fillStyle = shade;
    // Each reaches to the end, so that there are no gaps between them.
    context.fillRect(x + k * step, y - 4, SHADES - k * step, 8);
  });
}

/** @param {Context} context @param {Sample} entry @param {number} x @param {number} y px */
function sample(context, { colour, dash, width, length, corners }, x, y) {
  if (corners) {
    polygon(context, corners.map(([u, v]) => [x + length / 2 + u, y + v]));
    context.fillStyle = colour;
    return context.fill();
  }
  context.strokeStyle = colour;
  context.lineWidth = width;
  context.setLineDash(dash);
  context.beginPath();
  context.moveTo(x, y);
  context.lineTo(x + length, y);
  context.stroke();
  context.setLineDash([]);
}

/** @param {Context} context @param {string} ink @param {number} width @param {number[]} heights px */
function edges(context, ink, width, heights) {
  context.strokeStyle = ink;
  context.lineWidth = 1;
  context.beginPath();
  for (const y of heights) {
    context.moveTo(0, y);
    context.lineTo(width, y);
  }
  context.stroke();
}

/** Outlines of what stands around. @param {Context} context @param {Store} store @param {Viewport} view */
function obstacles(context, store, view) {
  const plane = planeOf(store);
  const inks = inksOf(store.theme);
  if (!plane) return;
  for (const obstacle of standing(store)) {
    const outline = outlineOf(obstacle, plane)?.map((uv) => onScreen(store, view, uv));
    if (!outline) continue;
    polygon(context, outline);
    context.globalAlpha = 0.22;
    context.fillStyle = inks.faint;
    context.fill();
    context.globalAlpha = 1;
    context.strokeStyle = inks.quiet;
    context.lineWidth = 1.2;
    context.stroke();
  }
}

/** Slow places, and the place of a refusal. @param {Context} context @param {Store} store @param {Viewport} view */
function marks(context, store, view) {
  const inks = inksOf(store.theme);
  context.lineWidth = 1;
  for (const { uv } of slowPlaces(store.latest("picture"))) {
    const [x, y] = onScreen(store, view, uv);
    polygon(context, SLOW.map(([u, v]) => [x + u, y + v]));
    context.fillStyle = inks.alarm;
    context.fill();
    context.strokeStyle = inks.ground;
    context.stroke();
  }
  const at = store.refusal?.head.at?.uv;
  if (!at) return;
  const [x, y] = onScreen(store, view, at);
  context.strokeStyle = inks.refusal;
  context.lineWidth = 3;
  context.beginPath();
  for (const [from, to] of CROSS) {
    context.moveTo(x + from[0], y + from[1]);
    context.lineTo(x + to[0], y + to[1]);
  }
  context.stroke();
}

/** @param {Context} context @param {number[][]} points px */
function polygon(context, points) {
  context.beginPath();
  points.forEach(([x, y], k) => (k ? context.lineTo(x, y) : context.moveTo(x, y)));
  context.closePath();
}

/** @param {Store} store @param {Viewport} view @param {[number, number]} uv m @returns {[number, number]} px */
function onScreen(store, view, [u, v]) {
  const [cu, cv] = store.latest("picture")?.head.centre ?? [0, 0];
  return view.toScreen([u - cu, v - cv]);
}
