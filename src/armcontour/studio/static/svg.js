// A canvas that writes SVG: as many of a canvas's methods as the drawing needs, so that one code draws both.

/** @typedef {[number, number, number, number, number, number]} Matrix as of a canvas's transform */

const NAMESPACE = "http://www.w3.org/2000/svg";
const SAME = /** @type {Matrix} */ ([1, 0, 0, 1, 0, 0]);
const STARTING = {
  fillStyle: "#000000",
  strokeStyle: "#000000",
  lineWidth: 1,
  lineJoin: "miter",
  lineCap: "butt",
  globalAlpha: 1,
  font: "10px sans-serif",
  textAlign: "start",
  textBaseline: "alphabetic",
};
const ANCHORS = /** @type {Record<string, string>} */ ({ center: "middle", right: "end", end: "end" });

/** A line that is read again as the text of a path; a Path2D keeps its points to itself. */
export class Trace {
  constructor() {
    /** @type {number[]} pairs */
    this.points = [];
    /** Where lines begin. @type {Set<number>} */
    this.first = new Set();
    /** Where lines go back to their beginning. @type {Set<number>} */
    this.closed = new Set();
  }

  /** @param {number} x @param {number} y */
  moveTo(x, y) {
    this.first.add(this.points.length);
    this.points.push(x, y);
  }

  /** @param {number} x @param {number} y */
  lineTo(x, y) {
    this.points.push(x, y);
  }

  closePath() {
    this.closed.add(this.points.length);
  }

  /** Text of the path [px]; points that are the same there are written once. @param {Matrix} matrix @returns {string} */
  text(matrix) {
    const { points, first, closed } = this;
    const parts = [];
    let last = "";
    for (let i = 0; i < points.length; i += 2) {
      const [x, y] = moved(matrix, points[i], points[i + 1]);
      const at = `${number(x)} ${number(y)}`;
      if (first.has(i)) parts.push(`M${at}`);
      else if (at !== last) parts.push(`L${at}`);
      if (closed.has(i + 2)) parts.push("Z");
      last = at;
    }
    return parts.join("");
  }
}

export class SvgContext {
  /**
   * @param {number} width [px] @param {number} height [px]
   * @param {(text: string, font: string) => number} measure width of a text [px]
   */
  constructor(width, height, measure) {
    Object.assign(this, STARTING);
    this.width = width;
    this.height = height;
    this.measure = measure;
    this.matrix = SAME;
    /** @type {number[]} */
    this.dash = [];
    /** @type {string[]} */
    this.parts = [];
    /** @type {{names: any, matrix: Matrix, dash: number[], groups: number}[]} */
    this.saved = [];
    /** Groups that were opened since the last `save`. */
    this.groups = 0;
    this.clips = 0;
    this.current = new Trace();
  }

  save() {
    const names = Object.fromEntries(Object.keys(STARTING).map((name) => [name, this.state[name]]));
    this.saved.push({ names, matrix: this.matrix, dash: this.dash, groups: this.groups });
    this.groups = 0;
  }

  restore() {
    const last = this.saved.pop();
    if (!last) return;
    this.parts.push("</g>".repeat(this.groups));
    Object.assign(this, last.names);
    Object.assign(this, { matrix: last.matrix, dash: last.dash, groups: last.groups });
  }

  /** What a canvas has as properties. @returns {Record<string, any>} */
  get state() {
    return /** @type {any} */ (this);
  }

  /** @param {Matrix} by */
  transform(...by) {
    const [a, b, c, d, e, f] = this.matrix;
    const [p, q, r, s, t, u] = by;
    const turned = [a * p + c * q, b * p + d * q, a * r + c * s, b * r + d * s, a * t + c * u + e, b * t + d * u + f];
    this.matrix = /** @type {Matrix} */ (turned);
  }

  /** @param {number} x @param {number} y */
  translate(x, y) {
    this.transform(1, 0, 0, 1, x, y);
  }

  /** px of lengths, which are the same in all directions. */
  get scale() {
    const [a, b, c, d] = this.matrix;
    return Math.sqrt(Math.abs(a * d - b * c));
  }

  /** @param {number[]} dash */
  setLineDash(dash) {
    this.dash = dash;
  }

  beginPath() {
    this.current = new Trace();
  }

  /** @param {number} x @param {number} y */
  moveTo(x, y) {
    this.current.moveTo(...moved(this.matrix, x, y));
  }

  /** @param {number} x @param {number} y */
  lineTo(x, y) {
    this.current.lineTo(...moved(this.matrix, x, y));
  }

  closePath() {
    this.current.closePath();
  }

  /** @param {number} x @param {number} y @param {number} wide @param {number} high */
  rect(x, y, wide, high) {
    this.moveTo(x, y);
    for (const [u, v] of [[x + wide, y], [x + wide, y + high], [x, y + high]]) this.lineTo(u, v);
    this.closePath();
  }

  /** Draw inside of the path only, until `restore`. */
  clip() {
    const name = `clip${(this.clips += 1)}`;
    this.parts.push(`<clipPath id="${name}"><path d="${this.current.text(SAME)}"/></clipPath><g clip-path="url(#${name})">`);
    this.groups += 1;
  }

  /** @param {Trace} [trace] without: the path */
  stroke(trace) {
    const d = trace ? trace.text(this.matrix) : this.current.text(SAME);
    if (!d) return;
    const { strokeStyle, lineWidth, lineJoin, lineCap } = this.state;
    const looks = { ...colour("stroke", strokeStyle, this.state.globalAlpha), "stroke-width": number(lineWidth * this.scale) };
    const rest = {
      "stroke-dasharray": this.dash.map((x) => number(x * this.scale)).join(" "),
      "stroke-linejoin": lineJoin === "miter" ? "" : lineJoin,
      "stroke-linecap": lineCap === "butt" ? "" : lineCap,
    };
    this.put("path", { d, fill: "none", ...looks, ...rest });
  }

  fill() {
    const d = this.current.text(SAME);
    if (d) this.put("path", { d, ...colour("fill", this.state.fillStyle, this.state.globalAlpha) });
  }

  /** @param {number} x @param {number} y @param {number} wide @param {number} high */
  fillRect(x, y, wide, high) {
    const [left, top] = moved(this.matrix, x, y);
    const size = { width: number(wide * this.scale), height: number(high * this.scale) };
    this.put("rect", { x: number(left), y: number(top), ...size, ...colour("fill", this.state.fillStyle, this.state.globalAlpha) });
  }

  /** @param {string} text @param {number} x @param {number} y */
  fillText(text, x, y) {
    const { font, textAlign, textBaseline, fillStyle, globalAlpha } = this.state;
    const [, weight = "", size, family] = /^(?:(\w+) )?([\d.]+)px (.*)$/.exec(font) ?? [];
    const [left, base] = moved(this.matrix, x, y);
    // Not every program knows of baselines in the middle.
    const down = textBaseline === "middle" ? 0.35 * Number(size) : 0;
    const looks = { "font-size": size, "font-weight": weight, "font-family": family, "text-anchor": ANCHORS[textAlign] ?? "" };
    this.put("text", { x: number(left), y: number(base + down), ...looks, ...colour("fill", fillStyle, globalAlpha) }, text);
  }

  /** @param {string} text @returns {{width: number}} */
  measureText(text) {
    return { width: this.measure(text, this.state.font) };
  }

  /** @param {string} tag @param {Record<string, string>} looks those that are "" are left out @param {string} [text] */
  put(tag, looks, text) {
    const attributes = Object.entries(looks).map(([name, value]) => (value === "" ? "" : ` ${name}="${escaped(value)}"`));
    this.parts.push(`<${tag}${attributes.join("")}${text === undefined ? "/>" : `>${escaped(text)}</${tag}>`}`);
  }

  /** The file. @param {string} title @returns {string} */
  file(title) {
    const size = `width="${this.width}" height="${this.height}" viewBox="0 0 ${this.width} ${this.height}"`;
    const begin = `<?xml version="1.0" encoding="UTF-8"?>\n<svg xmlns="${NAMESPACE}" ${size} role="img">`;
    return [begin, `<title>${escaped(title)}</title>`, ...this.parts.filter(Boolean), "</svg>", ""].join("\n");
  }
}

/** @param {Matrix} matrix @param {number} x @param {number} y @returns {[number, number]} */
function moved([a, b, c, d, e, f], x, y) {
  return [a * x + c * y + e, b * x + d * y + f];
}

/** A hundredth of a pixel is enough. @param {number} x @returns {string} */
function number(x) {
  return String(Math.round(100 * x) / 100);
}

/**
 * A colour and its opacity apart, as not every program reads `rgba`.
 * @param {"fill" | "stroke"} what @param {string} value @param {number} alpha @returns {Record<string, string>}
 */
function colour(what, value, alpha) {
  const found = /^rgba\((.*),\s*([\d.]+)\)$/.exec(value);
  const opacity = alpha * Number(found?.[2] ?? 1);
  return { [what]: found ? `rgb(${found[1]})` : value, [`${what}-opacity`]: opacity < 1 ? number(opacity) : "" };
}

/** @param {string} text @returns {string} */
function escaped(text) {
  const signs = /** @type {Record<string, string>} */ ({ "&": "&amp;", "<": "&lt;", ">": "&gt;", '"': "&quot;" });
  // Signs that XML cannot have are left out.
  return text.replace(/[\u0000-\u0008\u000b\u000c\u000e-\u001f\ufffe\uffff]/g, "").replace(/[&<>"]/g, (x) => signs[x]);
}
