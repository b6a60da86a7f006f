// Picture of the timeline: tool speed over time, contours, rapids, and the strip with the active limits.

import { styleOf, themed } from "./colours.js";
import { contourLabel, mm, short } from "./format.js";
import { contourTimes } from "./motion_places.js";
import { kindAt, largest } from "./polylines.js";
import { indexAt } from "./state.js";
import { timeLabel, timeStep } from "./time_labels.js";
import { shownText } from "./units.js";

/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {import("./time_scale.js").TimeScale} TimeScale */
/** @typedef {{context: CanvasRenderingContext2D, scale: TimeScale, height: number, base: number, most: number}} Sheet `base`: height of speed zero [px]; `most`: the speed at the top [m/s] */

/** Heights of the contours' names, the limit strip and the time labels [px]. */
const [NAMES, STRIP, TIMES] = [17, 9, 16];
/** Minimum distance between time labels [px]. */
const APART = 90;
/** With less room per contour, its speed is a filled area without a line [px]. */
const CROWDED = 14;
/** Free space beside a text [px]. */
const BESIDE = 6;
/** Height of the bar that shows which part is shown [px]. */
const BAR = 3;
/** Steps that differ by less are the same [steps]. */
const SAME = 1e-9;
const FONT = "11px system-ui, sans-serif";

/**
 * Draw the timeline.
 * @param {HTMLCanvasElement} canvas @param {TimeScale} scale @param {import("./state.js").Store} store
 */
export function drawCurve(canvas, scale, store) {
  const { clientWidth: width, clientHeight: height } = canvas;
  canvas.width = Math.round(width * devicePixelRatio);
  canvas.height = Math.round(height * devicePixelRatio);
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.scale(devicePixelRatio, devicePixelRatio);
  context.font = FONT;
  const picture = store.latest("picture");
  if (!picture?.arrays.path_t.length || !scale.duration) return;
  const sheet = { context, scale, height, base: height - STRIP - TIMES, most: topSpeed(picture) };
  const isCrowded = widthOfContours(picture, scale) < CROWDED;
  drawContours(sheet, picture, store.options.contour);
  drawRapids(sheet, picture);
  drawSpeed(sheet, picture, isCrowded);
  drawStrip(sheet, picture, store.theme);
  nameContours(sheet, picture, store.options.contour);
  nameSpeeds(sheet, picture);
  drawTimes(sheet);
  const refused = store.refusal?.head.at?.t;
  if (typeof refused === "number") drawRefusal(sheet, refused);
  if (!scale.isWhole) drawBar(sheet);
}

/** Return the speed at the top: the largest on contours, because rapids are much faster [m/s]. @param {Frame} picture */
const topSpeed = ({ arrays: { speed, assigned } }) => Math.max(largest(speed), largest(assigned)) || 1;

/** Return the mean width of the shown contours [px]. @param {Frame} picture @param {TimeScale} scale */
function widthOfContours(picture, scale) {
  const shown = contourTimes(picture).filter(([begin, end]) => end >= scale.begin && begin <= scale.end);
  return scale.width / Math.max(1, shown.length);
}

/** Return the height of a speed; above the top, it is at the top [px]. @param {Sheet} sheet @param {number} v m/s */
const heightOf = ({ base, most }, v) => base - (Math.min(v, most) / most) * (base - NAMES - 4);

/** Return the first and last shown point of a line, with one more at each side. @param {Sheet} sheet @param {Numbers} times @param {number} first @param {number} last @returns {[number, number]} */
function shownPoints({ scale }, times, first, last) {
  const line = times.subarray(first, last + 1);
  const [from, to] = [indexAt(line, scale.begin), indexAt(line, scale.end) + 1];
  return [first + from, Math.min(last, first + to)];
}

/** Draw the backgrounds of the contours. @param {Sheet} sheet @param {Frame} picture @param {number} selected */
function drawContours({ context, scale, base }, picture, selected) {
  contourTimes(picture).forEach(([begin, end], k) => {
    context.fillStyle = themed(k === selected ? "--pressed" : "--hover");
    const left = scale.xOf(begin);
    context.fillRect(left, BAR, Math.max(1, scale.xOf(end) - left), base - BAR);
  });
}

/** Draw lines of speeds: their areas, and their upper edges if they have a colour. @param {Sheet} sheet @param {Numbers} times @param {Numbers} speeds @param {Numbers} breaks @param {string} area colour @param {string} edge colour; "": none */
function drawLines(sheet, times, speeds, breaks, area, edge) {
  const { context, scale, base } = sheet;
  const [line, ground] = [new Path2D(), new Path2D()];
  for (let k = 0; k + 1 < breaks.length; k++) {
    const [from, to] = shownPoints(sheet, times, breaks[k], breaks[k + 1] - 1);
    if (times[to] < scale.begin || times[from] > scale.end) continue;
    ground.moveTo(scale.xOf(times[from]), base);
    for (let i = from; i <= to; i++) {
      const [x, y] = [scale.xOf(times[i]), heightOf(sheet, speeds[i])];
      ground.lineTo(x, y);
      if (i === from) line.moveTo(x, y);
      else line.lineTo(x, y);
    }
    ground.lineTo(scale.xOf(times[to]), base);
  }
  context.fillStyle = area;
  context.fill(ground);
  if (!edge) return;
  context.strokeStyle = edge;
  context.lineWidth = 1.4;
  context.lineJoin = "round";
  context.stroke(line);
}

/** @param {Sheet} sheet @param {Frame} picture */
function drawRapids(sheet, { arrays: { rapid_t: times, rapid_speed: speeds, rapid_breaks: breaks } }) {
  if (!breaks) return;
  sheet.context.globalAlpha = 0.45;
  drawLines(sheet, times, speeds, breaks, themed("--line"), "");
  sheet.context.globalAlpha = 1;
}

/** @param {Sheet} sheet @param {Frame} picture @param {boolean} isCrowded */
function drawSpeed(sheet, { arrays: { path_t: times, speed, path_breaks: breaks } }, isCrowded) {
  sheet.context.globalAlpha = isCrowded ? 0.6 : 1;
  drawLines(sheet, times, speed, breaks, themed(isCrowded ? "--executed" : "--band"), isCrowded ? "" : themed("--executed"));
  sheet.context.globalAlpha = 1;
}

/** Draw the colours of the active limits; neighbours with one colour are one piece. @param {Sheet} sheet @param {Frame} picture @param {"light" | "dark"} theme */
function drawStrip(sheet, picture, theme) {
  const { context, scale, base } = sheet;
  const { path_t: times, path_breaks: breaks } = picture.arrays;
  context.fillStyle = themed("--faint");
  context.fillRect(scale.xOf(0), base, scale.xOf(scale.duration) - scale.xOf(0), STRIP);
  for (let k = 0; k + 1 < breaks.length; k++) {
    const [from, to] = shownPoints(sheet, times, breaks[k], breaks[k + 1] - 1);
    if (times[to] < scale.begin || times[from] > scale.end) continue;
    for (let i = from; i < to;) {
      const kind = kindAt(picture, i);
      const first = i;
      while (i < to && kindAt(picture, i) === kind) i++;
      context.fillStyle = styleOf(kind, theme).colour;
      context.fillRect(scale.xOf(times[first]), base, scale.xOf(times[i]) - scale.xOf(times[first]), STRIP);
    }
  }
}

/** Write a text that is readable over lines. @param {Sheet} sheet @param {string} text @param {number} x px @param {number} y px @param {"left" | "center" | "right"} [align] */
function write({ context }, text, x, y, align = "left") {
  context.textAlign = align;
  context.strokeStyle = themed("--surface");
  context.lineWidth = 3;
  context.lineJoin = "round";
  context.strokeText(text, x, y);
  context.fillText(text, x, y);
}

/** Write number and name of each contour that has room for them. @param {Sheet} sheet @param {Frame} picture @param {number} selected */
function nameContours(sheet, picture, selected) {
  const { context, scale } = sheet;
  let free = 0;
  picture.head.contours.forEach((/** @type {any} */ contour, /** @type {number} */ k) => {
    if (!contour.t) return;
    const [begin, end] = contour.t.map((/** @type {number} */ t) => scale.xOf(t));
    const left = Math.max(begin, 0) + 3;
    if (end < BESIDE || begin > scale.width || left < free) return;
    const whole = contourLabel(contour);
    const text = context.measureText(whole).width < end - left ? whole : String(contour.number);
    const right = left + context.measureText(text).width;
    if (right > scale.width) return;
    context.fillStyle = themed(k === selected ? "--accent" : "--quiet");
    write(sheet, text, left, NAMES - 3);
    free = right + BESIDE;
  });
}

/** Write the speed at the top, and the largest speed of each rapid that is faster and has room. @param {Sheet} sheet @param {Frame} picture */
function nameSpeeds(sheet, { arrays: { rapid_t: times, rapid_most: most, rapid_breaks: breaks } }) {
  const { context, scale } = sheet;
  context.fillStyle = themed("--quiet");
  const top = shownText(`${mm(sheet.most, 0)} mm/s`);
  const room = scale.width - context.measureText(top).width - 2 * BESIDE;
  write(sheet, top, scale.width - BESIDE, NAMES + 13, "right");
  for (let k = 0; breaks && k + 1 < breaks.length; k++) {
    const left = Math.max(0, scale.xOf(times[breaks[k]]));
    const right = Math.min(room, scale.xOf(times[breaks[k + 1] - 1]));
    if (most[k] <= sheet.most) continue;
    const whole = `↑ ${shownText(`${short(1000 * most[k], 3)} mm/s`)}`;
    // Without room for the unit, it is at the right end.
    const text = [whole, whole.slice(0, whole.lastIndexOf(" "))].find((x) => context.measureText(x).width + BESIDE < right - left);
    if (text) write(sheet, text, (left + right) / 2, NAMES + 13, "center");
  }
}

/** @param {Sheet} sheet */
function drawTimes(sheet) {
  const { context, scale, height } = sheet;
  context.fillStyle = themed("--quiet");
  const step = timeStep((APART / scale.width) * scale.span, scale.duration);
  for (let k = Math.ceil(scale.begin / step - SAME); k * step <= scale.end; k++) {
    const text = timeLabel(k * step, step, scale.duration);
    const left = scale.xOf(k * step) + 1;
    if (left + context.measureText(text).width <= scale.width) write(sheet, text, left, height - 3);
  }
}

/** Mark the time of a refusal. @param {Sheet} sheet @param {number} t s */
function drawRefusal({ context, scale, base }, t) {
  const x = scale.xOf(t);
  context.fillStyle = themed("--refusal");
  context.fillRect(x - 1, BAR, 2, base - BAR);
  context.beginPath();
  context.moveTo(x - 6, BAR);
  context.lineTo(x + 6, BAR);
  context.lineTo(x, BAR + 9);
  context.fill();
}

/** Show which part of the motion is shown. @param {Sheet} sheet */
function drawBar({ context, scale }) {
  const { width, duration, begin, span } = scale;
  context.fillStyle = themed("--line");
  context.fillRect(0, 0, width, BAR);
  context.fillStyle = themed("--accent");
  context.fillRect((begin / duration) * width, 0, Math.max(BESIDE, (span / duration) * width), BAR);
}
