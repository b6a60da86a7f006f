// Strip of active limits below a chart over arc length.

import { BETWEEN, styleOf, themed } from "./colours.js";

/** @typedef {import("./state.js").Numbers} Numbers */
/** @typedef {import("./vendor/uplot.js").default} uPlot */
/** @typedef {{from: number, to: number, kind: string, label: string}} Part from and to: arc length [m] */

const HEIGHT = 9; // px

/**
 * Parts of the path along which one limit is active.
 * @param {Numbers} s arc lengths [m], (n,)
 * @param {Numbers} binding index among the limits, (n,)
 * @param {{name: string, kind: string}[]} limits
 * @returns {Part[]}
 */
export function stripOf(s, binding, limits) {
  const found = /** @type {Part[]} */ ([]);
  for (let k = 0; k < binding.length - 1; k += 1) {
    const limit = limits[binding[k]];
    const [kind, label] = [limit?.kind ?? BETWEEN, limit?.name ?? ""];
    const last = found.at(-1);
    if (last && last.kind === kind && last.label === label) last.to = s[k + 1];
    else found.push({ from: s[k], to: s[k + 1], kind, label });
  }
  return found;
}

/**
 * Draw the strip at the lower edge of a chart: colours, and dashes for those who do not see them.
 * @param {uPlot} u with an axis x in mm
 * @param {Part[]} parts
 * @param {"light" | "dark"} theme
 */
export function drawStrip(u, parts, theme) {
  const { ctx, bbox } = u;
  const ratio = devicePixelRatio;
  const high = HEIGHT * ratio;
  const top = bbox.top + bbox.height - high;
  ctx.save();
  ctx.beginPath();
  ctx.rect(bbox.left, bbox.top, bbox.width, bbox.height);
  ctx.clip();
  ctx.fillStyle = themed("--ground");
  ctx.fillRect(bbox.left, top - ratio, bbox.width, high + ratio);
  for (const part of parts) {
    const { colour, dash } = styleOf(part.kind, theme);
    const left = u.valToPos(1000 * part.from, "x", true);
    const right = u.valToPos(1000 * part.to, "x", true);
    ctx.strokeStyle = colour;
    ctx.lineWidth = high;
    ctx.setLineDash(dash.map((x) => x * ratio));
    ctx.globalAlpha = 1;
    ctx.beginPath();
    ctx.moveTo(left, top + high / 2);
    ctx.lineTo(right, top + high / 2);
    ctx.stroke();
  }
  ctx.restore();
}
