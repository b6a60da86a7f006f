// Drawing: a canvas for lines, an SVG over it for handles; pan, zoom, fit.

import { themed } from "./colours.js";
import { draw, find, make, mark } from "./dom.js";
import { rowOf } from "./format.js";
import { Layers } from "./layers.js";
import { measureOf } from "./measure.js";
import { Painter } from "./canvas.js";
import { oncePerFrame } from "./state.js";
import { boxOf, Viewport } from "./viewport.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */

const REST = 130; // ms
// A pointer that moves less than CLICKED is a click, which selects a contour within NEAR.
export const CLICKED = 4; // px
const NEAR = 8; // px
const MAX_MEASURES = 3000;
/** Nearer to the border of the view, a place is not seen well [px]. */
const BORDER = 16;
/** Distance of a box from the pointer [px]. */
const ASIDE = 18;

export class View2d {
  /** @param {Store} store */
  constructor(store) {
    this.store = store;
    this.region = find("#view2d");
    this.canvas = make("canvas", { role: "img", "aria-label": "The path" });
    this.overlay = draw("svg", { "aria-label": "Handles", role: "group" });
    this.region.append(this.canvas, this.overlay);
    this.context = /** @type {CanvasRenderingContext2D} */ (this.canvas.getContext("2d", { alpha: false }));
    this.view = new Viewport();
    this.layers = new Layers(store, this.view);
    this.painter = new Painter(store, this.layers);
    this.fitted = "";
    /** True if everything is shown; it stays so when the region is resized. */
    this.isFitted = false;
    /** True if obstacles are shown as well when everything is. */
    this.showsObstacles = false;
    /** True if a part of the newest picture is in the view. */
    this.isSeen = false;
    /** Centre of the shown picture in the plane [m]. @type {[number, number] | null} */
    this.centre = null;
    /** Bitmap and place of the last full drawing. */
    this.drawn = this.view.place;
    /** @type {{image: HTMLCanvasElement, u: number, v: number, scale: number} | null} */
    this.bitmap = null;
    this.resting = 0;
    /** Pointers that pan and zoom. @type {Map<number, PointerEvent>} */
    this.pointers = new Map();
    this.moving = false;
    /** @type {Set<() => void>} called after every change of the view or the picture */
    this.followers = new Set();
    /** Frames that were measured, by kind. @type {Record<string, Frame | null>} */
    this.measured = {};
    this.measures = 0;
    this.redraw = oncePerFrame(() => this.drawNow());
    /** True if an answer was drawn since the last screen frame. */
    this.isFresh = false;
    this.listen();
  }

  listen() {
    const { store } = this;
    store.on("picture", () => {
      this.stay();
      this.fitOnce();
      this.follow();
    });
    store.on("refusal", () => this.follow());
    for (const event of ["picture", "executed"]) store.on(event, () => this.show());
    for (const event of ["refusal", "theme", "view"]) store.on(event, () => this.rest());
    store.on("fit", () => this.fit(true));
    new ResizeObserver(() => this.resize()).observe(this.region);
    // A dragged handle stays where the pointer is.
    new ResizeObserver(() => this.isFitted && !this.overlay.querySelector(".dragging") && this.fit()).observe(find("#legend"));
    this.overlay.addEventListener("wheel", (event) => this.wheel(event), { passive: false });
    this.overlay.addEventListener("pointerdown", (event) => this.grab(event));
  }

  /** Draw the first answer within a screen frame at once, so that the frame itself has less work. */
  show() {
    if (this.isFresh) return this.rest();
    this.isFresh = true;
    requestAnimationFrame(() => {
      this.isFresh = false;
      this.place();
      this.measure();
    });
    this.moving = false;
    this.bitmap = null;
    this.drawAll();
    this.tell();
  }

  /** Keep the drawing in place although points are relative to a centre that may move with the path. */
  stay() {
    const centre = this.store.latest("picture")?.head.centre ?? [0, 0];
    if (this.centre) {
      this.view.u += this.centre[0] - centre[0];
      this.view.v += this.centre[1] - centre[1];
    }
    this.centre = centre;
  }

  /** Show the part again after it was moved out of the view, by a placement or by typing. */
  follow() {
    // A dragged handle follows the pointer.
    if (this.overlay.querySelector(".dragging")) return;
    const wasSeen = this.isSeen;
    this.isSeen = this.seesPart();
    if (wasSeen && !this.isSeen) this.fit();
  }

  /** Return the smallest box around the part [m], also if it is refused. */
  get box() {
    const picture = this.store.latest("picture");
    if (!picture) return null;
    const { refusal } = this.store;
    const { head, arrays } = refusal?.head.outline ? { ...refusal, head: refusal.head.outline } : picture;
    return this.layers.keep("box", [picture, arrays], () => {
      const [u, v] = [0, 1].map((k) => head.centre[k] - picture.head.centre[k]);
      const { objective, left_out: left = [] } = arrays;
      const box = boxOf(left.length ? [...objective, ...left] : objective) ?? boxOf(picture.arrays.path);
      return box && { left: box.left + u, right: box.right + u, bottom: box.bottom + v, top: box.top + v };
    });
  }

  /** @returns {boolean} */
  seesPart() {
    const { box } = this;
    if (!box) return false;
    const [left, top] = this.view.toScreen([box.left, box.top]);
    const [right, bottom] = this.view.toScreen([box.right, box.bottom]);
    return right >= 0 && bottom >= 0 && left <= this.view.width && top <= this.view.height;
  }

  resize() {
    const { width, height } = this.region.getBoundingClientRect();
    if (width < 2 || height < 2) return;
    const first = this.view.width === 1;
    const isDragged = this.overlay.querySelector(".dragging") !== null;
    const corner = this.view.toPlane([0, 0]);
    this.view.resize({ width, height });
    // A dragged handle stays where the pointer is.
    const [x, y] = this.view.toScreen(corner);
    if (isDragged) this.view.pan(-x, -y);
    this.canvas.width = Math.round(width * devicePixelRatio);
    this.canvas.height = Math.round(height * devicePixelRatio);
    this.bitmap = null;
    if (first) this.fitted = "";
    this.fitOnce();
    if (this.isFitted && !isDragged) this.fit();
    this.isSeen = this.seesPart();
    this.drawNow();
  }

  /** Fit the first picture of a document. */
  fitOnce() {
    const id = this.store.document?.id;
    if (this.fitted === id || this.view.width === 1 || !this.store.latest("picture")) return;
    this.fitted = id;
    this.fit(false);
  }

  /** Show all of the drawing. @param {boolean} [whole] whether obstacles are shown as well; by default as before */
  fit(whole = this.showsObstacles) {
    const { box } = this;
    if (!box) return;
    this.showsObstacles = whole;
    this.view.fit(this.withTouched(whole ? this.withObstacles(box) : box), this.covered);
    this.moved();
    this.isFitted = this.isSeen = true;
  }

  /** Pan so that a point is in the middle, unless it is seen well. @param {[number, number]} point m */
  reveal(point) {
    const { view, covered } = this;
    const [x, y] = view.toScreen(point);
    const [left, right, bottom] = [covered.left, view.width, view.height - covered.below];
    const isSeen = x >= left + BORDER && x <= right - BORDER && y >= BORDER && y <= bottom - BORDER;
    if (isSeen) return;
    view.pan((left + right) / 2 - x, bottom / 2 - y);
    this.moved();
  }

  /** Return the obstacles that the drawing shows. @returns {any[]} */
  get drawnObstacles() {
    const { document, options } = this.store;
    // A body on the part is below the whole drawing, so it is there only while it is selected.
    const isDrawn = (/** @type {any} */ body) => body.outline && (body.fixed_to !== "part" || body.index === options.obstacle);
    return (document?.obstacles ?? []).filter(isDrawn);
  }

  /** Return a box that also contains the drawn obstacles [m]. @param {import("./viewport.js").Box} box @returns {import("./viewport.js").Box} */
  withObstacles(box) {
    const [u, v] = this.store.latest("picture")?.head.centre ?? [0, 0];
    const points = [box.left, box.bottom, box.right, box.top];
    for (const { uv, outline } of this.drawnObstacles)
      for (const [a, b] of outline) points.push(uv[0] + a - u, uv[1] + b - v);
    return boxOf(points) ?? box;
  }

  /** Return a box that also contains the touched points [m]. @param {import("./viewport.js").Box} box @returns {import("./viewport.js").Box} */
  withTouched({ left, right, bottom, top }) {
    const [u, v] = this.store.latest("picture")?.head.centre ?? [0, 0];
    const points = this.store.touched?.uv ?? [];
    const [us, vs] = [points.map((point) => point[0] - u), points.map((point) => point[1] - v)];
    return { left: Math.min(left, ...us), right: Math.max(right, ...us), bottom: Math.min(bottom, ...vs), top: Math.max(top, ...vs) };
  }

  /** Return what the legend and the tools cover of the drawing [px]. */
  get covered() {
    const [legend, region] = [find("#legend"), this.region].map((x) => x.getBoundingClientRect());
    const tools = document.querySelector("#viewbar .tools")?.getBoundingClientRect();
    const below = Math.max(0, region.bottom - Math.max(legend.top, region.top)) * Number(legend.width > 0 && legend.top < region.bottom);
    // In narrow pages, the tools are above the drawing.
    const isOver = tools && tools.bottom > region.top + 1 && tools.top < region.bottom;
    return { below, left: isOver ? Math.max(0, tools.right - region.left) : 0 };
  }

  /** Draw after a change of the view. */
  moved() {
    this.isFitted = false;
    this.isSeen = this.seesPart();
    clearTimeout(this.resting);
    if (this.layers.large) {
      if (!this.moving) this.bitmap = this.copy();
      this.moving = true;
      this.resting = setTimeout(() => this.rest(), REST);
    }
    this.redraw();
  }

  rest() {
    this.moving = false;
    this.bitmap = null;
    this.redraw();
  }

  drawNow() {
    if (this.moving && this.bitmap) this.drawBitmap(this.bitmap);
    else this.drawAll();
    this.place();
    this.tell();
    this.measure();
  }

  /** Move everything over the picture to its place. */
  place() {
    for (const follow of this.followers) follow();
  }

  drawAll() {
    this.context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    this.painter.paint(this.context, this.view);
    this.drawn = this.view.place;
  }

  /** Store the canvas with its place. */
  copy() {
    const image = make("canvas", { width: this.canvas.width, height: this.canvas.height });
    image.getContext("2d")?.drawImage(this.canvas, 0, 0);
    return { image, ...this.drawn };
  }

  /** Draw the last full picture at its new place. @param {{image: HTMLCanvasElement, u: number, v: number, scale: number}} bitmap */
  drawBitmap({ image, u, v, scale }) {
    const { context, view } = this;
    const factor = view.scale / scale;
    const [x, y] = view.toScreen([u, v]);
    context.setTransform(devicePixelRatio, 0, 0, devicePixelRatio, 0, 0);
    context.fillStyle = themed("--ground");
    context.fillRect(0, 0, view.width, view.height);
    const [wide, high] = [view.width * factor, view.height * factor];
    context.drawImage(image, x - wide / 2, y - high / 2, wide, high);
  }

  /** Describe the drawn content, for tests and measurements. */
  tell() {
    const { store, region } = this;
    const picture = store.latest("picture");
    const executed = store.refusal ? null : store.latest("executed");
    const told = {
      seq: picture?.seq ?? "",
      rev: picture?.rev ?? "",
      run: picture?.head.run ?? "",
      duration: rowOf(picture?.head, "duration")?.value ?? "",
      tier: store.isCurrent(executed) ? 2 : picture ? 1 : 0,
      "executed-seq": executed?.seq ?? "",
      magnify: executed ? this.layers.magnification(this.view.scale) : "",
      stale: store.refusal?.head.tier === 1,
      scale: this.view.scale,
    };
    for (const [name, value] of Object.entries(told)) mark(region, `data-${name}`, String(value));
  }

  /** Measure how long new answers took until the screen frame that shows them. */
  measure() {
    const { store } = this;
    for (const frame of [store.latest("picture"), store.refusal ? null : store.latest("executed")]) {
      if (!frame || this.measured[frame.kind] === frame) continue;
      this.measured[frame.kind] = frame;
      if (!frame.asked) continue;
      performance.measure(`drawn ${frame.kind}`, { start: frame.asked, detail: frame.seq });
      this.measures += 1;
      if (this.measures % MAX_MEASURES === 0) performance.clearMeasures();
    }
  }

  /** @param {WheelEvent} event */
  wheel(event) {
    event.preventDefault();
    const { left, top } = this.region.getBoundingClientRect();
    // A pinch on a touchpad is reported as a wheel with Ctrl, in smaller steps.
    const lines = event.deltaMode === 1 ? 16 : 1;
    const factor = Math.exp(-event.deltaY * lines * (event.ctrlKey ? 0.01 : 0.0016));
    this.view.zoom(factor, [event.clientX - left, event.clientY - top]);
    this.moved();
  }

  /** Pan with one pointer, zoom with two. @param {PointerEvent} event */
  grab(event) {
    if (event.defaultPrevented || event.button > 1) return;
    this.pointers.set(event.pointerId, event);
    this.overlay.setPointerCapture(event.pointerId);
    this.region.classList.add("panning");
    if (this.pointers.size > 1) return;
    const move = (/** @type {PointerEvent} */ e) => this.drag(e);
    const end = (/** @type {PointerEvent} */ e) => {
      this.pointers.delete(e.pointerId);
      if (this.pointers.size) return;
      if (Math.hypot(e.clientX - event.clientX, e.clientY - event.clientY) < CLICKED) this.select(e);
      this.region.classList.remove("panning");
      this.overlay.removeEventListener("pointermove", move);
      this.overlay.removeEventListener("lostpointercapture", end);
    };
    this.overlay.addEventListener("pointermove", move);
    this.overlay.addEventListener("lostpointercapture", end);
  }

  /** Select the contour at the pointer, or none. @param {PointerEvent} event */
  select(event) {
    if (measureOf().click("2d", ...this.within(event), event.pointerType === "touch")) return;
    if (this.store.latest("picture")?.arrays.path.length) this.store.selectAt(this.pathAt(event));
  }

  /** Return the index of the path piece at the pointer, or -1. @param {MouseEvent} event */
  pathAt(event) {
    const picture = this.store.latest("picture");
    if (!picture?.arrays.path.length) return -1;
    return this.layers.nearest(picture, this.view.toPlane(this.within(event)), NEAR / this.view.scale);
  }

  /** @param {PointerEvent} event */
  drag(event) {
    const before = this.pointers.get(event.pointerId);
    if (!before) return;
    const share = 1 / this.pointers.size;
    this.view.pan(share * (event.clientX - before.clientX), share * (event.clientY - before.clientY));
    const other = [...this.pointers.values()].find((p) => p.pointerId !== event.pointerId);
    if (other) {
      const apart = (/** @type {PointerEvent} */ p) =>
        Math.max(1, Math.hypot(p.clientX - other.clientX, p.clientY - other.clientY));
      this.view.zoom(apart(event) / apart(before), this.within(other));
    }
    this.pointers.set(event.pointerId, event);
    this.moved();
  }

  /** Return where an event is in the region [px]. @param {MouseEvent} event @returns {[number, number]} */
  within(event) {
    const { left, top } = this.region.getBoundingClientRect();
    return [event.clientX - left, event.clientY - top];
  }

  /** Place a box next to a point, within the region and beside the tools. @param {HTMLElement} box @param {[number, number]} place px */
  putBeside(box, place) {
    const free = this.toolsEnd();
    const [left, top] = [[this.view.width, box.offsetWidth, free], [this.view.height, box.offsetHeight, 0]].map(
      ([room, size, least], k) => Math.max(least, place[k] + ASIDE + size < room ? place[k] + ASIDE : Math.min(place[k] - ASIDE, room) - size),
    );
    box.style.transform = `translate(${left}px, ${top}px)`;
  }

  /** Return where the tools end that lie over the left end of the drawing; 0 if they are elsewhere [px]. */
  toolsEnd() {
    const tools = document.querySelector("#viewbar .tools")?.getBoundingClientRect();
    const { left, top } = this.region.getBoundingClientRect();
    const isOver = tools !== undefined && tools.bottom > top && tools.right > left && tools.width < this.view.width / 2;
    return isOver ? tools.right - left + ASIDE / 2 : 0;
  }

  /** Zoom about the middle. @param {number} factor */
  zoomBy(factor) {
    this.view.zoom(factor);
    this.moved();
  }
}
