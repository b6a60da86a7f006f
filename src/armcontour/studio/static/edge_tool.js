// Tool of the 3D view that picks edges of a CAD model, and turns the tool axis along them.

import { Entry } from "./components.js";
import { draw, find, grip, make, mark } from "./dom.js";
import { ScreenEdges } from "./edge_pick.js";
import { Gesture, dragged } from "./gesture.js";
import { oncePerFrame } from "./state.js";
import { shownText } from "./units.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {import("./viewer.js").Viewer} Viewer */
/** @typedef {{kind: string, fold: string, length: number, radius: number, seam: string[] | null, group: number, covered: boolean}} Edge */

/** Within this distance an edge is picked, by a mouse and by a finger [px]. */
const [NEAR, NEAR_FINGER] = [12, 22];
/** Hidden edges count as farther away by this [px]. */
const HIDDEN = 8;
/** Steps of the angle, and with Shift [degrees]. */
const [STEP, FINE] = [5, 1];
/** Small angle at which the direction of the knob on the screen is measured [rad]. */
const SMALL = 0.01;
/** Smallest speed of the knob, for an arrow that turns in the line of sight [px/rad]. */
const SLOWEST = 40;
const ANGLES = { work: "Work angle", travel: "Travel angle" };

/** @param {number} length m @returns {string} */
const mm = (length) => shownText(`${Number((1000 * length).toPrecision(4))} mm`);

/** @param {Edge} edge @returns {string} */
function nameOf({ kind, fold, length, radius, seam }) {
  if (seam) return `seam ${seam.join("/")}, ${mm(length)}`;
  return [fold, kind, radius ? `radius ${mm(radius)}` : "", mm(length)].filter(Boolean).join(", ");
}

export class EdgeTool {
  /** @param {Store} store @param {Link} link @param {Viewer} viewer @param {HTMLElement} host */
  constructor(store, link, viewer, host) {
    this.store = store;
    this.link = link;
    this.viewer = viewer;
    /** @type {ScreenEdges | null} */
    this.edges = null;
    /** Edge at the pointer, and clicked edge; -1: none. */
    this.hovered = this.picked = -1;
    /** Whether all edges like the clicked one are shown. */
    this.showsLike = false;
    /** Largest time of a pointer event [ms]. */
    this.slowest = 0;
    this.drawSoon = oncePerFrame(() => this.draw());
    this.overlay = draw("svg", { class: "edge-overlay", role: "group", "aria-label": "Tool axis" });
    this.lines = Object.fromEntries(["selected", "like", "hover"].map((name) => [name, draw("path", { class: `edge-${name}` })]));
    this.stem = draw("line", { class: "edge-stem" });
    this.knob = grip({ class: "handle edge-knob", "aria-label": "Work angle of the tool", "aria-valuemin": -85, "aria-valuemax": 85 }, [draw("circle", { r: 6 })]);
    this.overlay.append(...Object.values(this.lines), this.stem, this.knob);
    this.box = make("div", { class: "edge-box", role: "group", "aria-label": "Edges" });
    host.append(this.overlay, this.box);
    this.listen();
  }

  get isOn() {
    return this.store.options.tool === "edges" && Boolean(this.model);
  }

  /** Header of the frame `model`, if its edges are known. @returns {any} */
  get model() {
    const head = this.store.latest("model")?.head;
    return this.store.document?.model && head && !head.sentence ? head : null;
  }

  /** Selected edges, with the numbers of their rules. @returns {Map<number, number>} */
  get selected() {
    return new Map(this.store.document?.model?.selected ?? []);
  }

  /** The knob of the selected contour, or of the first one. @returns {{tip: number[], tail: number[], turn: number[]} | null} */
  get shownKnob() {
    const knobs = this.store.latest("picture")?.head.knobs ?? [];
    return knobs[Math.max(0, this.store.options.contour)] ?? null;
  }

  listen() {
    const { canvas } = this.viewer;
    canvas.addEventListener("pointermove", (event) => {
      if (!this.isOn || event.buttons) return;
      const begin = performance.now();
      this.hover(this.find(event.offsetX, event.offsetY, event.pointerType === "touch" ? NEAR_FINGER : NEAR));
      this.slowest = Math.max(this.slowest, performance.now() - begin);
      mark(this.box, "data-slowest", this.slowest.toFixed(2));
    });
    canvas.addEventListener("pointerleave", () => this.hover(-1));
    this.store.on("command", () => this.pick(-1));
    this.store.on("escape", (/** @type {{taken: boolean}} */ key) => {
      if (this.picked < 0 || key.taken) return;
      key.taken = true;
      this.pick(-1);
    });
    this.turnByDrag();
    this.knob.addEventListener("keydown", (event) => {
      const sign = { ArrowUp: 1, ArrowRight: 1, ArrowDown: -1, ArrowLeft: -1 }[event.key];
      if (!sign) return;
      event.preventDefault();
      event.stopPropagation();
      this.link.edit(this.turned(this.work + sign * (event.shiftKey ? FINE : STEP)));
    });
  }

  /** A model is new. */
  read() {
    const frame = this.store.latest("model");
    this.hovered = this.picked = -1;
    const skipped = this.model?.edges.map((/** @type {Edge} */ x) => x.covered) ?? [];
    this.edges = frame && this.model ? new ScreenEdges(/** @type {any} */ (frame.arrays), skipped) : null;
  }

  /** Return the edge at a point of the canvas; -1 without one. @param {number} x px @param {number} y px @param {number} within px */
  find(x, y, within) {
    const { edges, store } = this;
    if (!edges) return -1;
    this.project();
    return edges.at(x, y, within, this.viewer.eyeInModel(), store.options.transparent ? 0 : HIDDEN)?.edge ?? -1;
  }

  project() {
    const { matrix, width, height } = this.viewer.projectionOfModel();
    this.edges?.project(matrix, width, height);
  }

  /** @param {number} edge */
  hover(edge) {
    if (edge === this.hovered) return;
    this.hovered = edge;
    mark(this.box, "data-hovered", String(edge));
    mark(this.box, "data-kind", this.model?.edges[edge]?.kind ?? "");
    this.viewer.canvas.style.cursor = edge >= 0 ? "pointer" : "";
    this.drawSoon();
  }

  /** Handle a click; returns whether the tool is in use. @param {number} x px @param {number} y px @param {boolean} isTouch @returns {boolean} */
  click(x, y, isTouch) {
    if (!this.isOn) return false;
    this.pick(this.find(x, y, isTouch ? NEAR_FINGER : NEAR));
    return true;
  }

  /** @param {number} edge -1: none */
  pick(edge) {
    this.picked = edge;
    this.showsLike = false;
    this.draw();
  }

  /** Pick the next edge that can be picked. @param {number} by 1 or -1 */
  step(by) {
    const all = this.model.edges;
    let edge = this.picked < 0 && by < 0 ? 0 : this.picked;
    for (let k = 0; k < all.length; k += 1) {
      edge = (edge + by + all.length) % all.length;
      if (!all[edge].covered) break;
    }
    this.pick(edge);
  }

  /** @param {string} what "pick" or "unpick" @param {boolean} like */
  send(what, like) {
    this.link.edit([{ do: what, edge: this.picked, like }]);
    this.pick(-1);
    find(".edge-box button").focus();
  }

  /** Work angle in the job [degrees]. */
  get work() {
    return this.store.document?.model?.axis?.work ?? 0;
  }

  /** Return the edits that set the work angle. @param {number} angle degrees @returns {object[]} */
  turned(angle) {
    return [{ do: "set", key: `path.orientation.${this.store.document.model.axis.form}.work`, value: `${Math.round(angle)} deg` }];
  }

  turnByDrag() {
    let [x, y, work, sent] = [0, 0, 0, 0];
    let speed = [0, 0];
    /** @type {Gesture | null} */
    let gesture = null;
    dragged(this.knob, {
      start: (event) => {
        const knob = this.shownKnob;
        if (!knob) return false;
        const moved = knob.tail.map((value, k) => value + SMALL * knob.turn[k]);
        const [ax, ay, bx, by] = this.viewer.project([...knob.tail, ...moved]);
        speed = [(bx - ax) / SMALL, (by - ay) / SMALL];
        [x, y, work, sent] = [event.clientX, event.clientY, this.work, this.work];
        gesture = new Gesture(this.link);
        return true;
      },
      move: (event) => {
        const square = Math.max(SLOWEST ** 2, speed[0] ** 2 + speed[1] ** 2);
        const turn = ((event.clientX - x) * speed[0] + (event.clientY - y) * speed[1]) / square;
        const step = event.shiftKey ? FINE : STEP;
        const angle = step * Math.round((work + (turn * 180) / Math.PI) / step);
        if (angle === sent || Math.abs(angle) > 85) return;
        sent = angle;
        this.box.dataset.turned = String(angle);
        gesture?.update(this.turned(angle), event.timeStamp);
      },
      end: (cancelled) => (cancelled ? gesture?.cancel() : gesture?.end()),
    });
  }

  /** Draw what is above the canvas. */
  draw() {
    const { isOn, overlay } = this;
    overlay.toggleAttribute("hidden", !isOn);
    this.drawBox();
    if (!isOn || !this.edges) return;
    this.project();
    const like = this.picked >= 0 && this.showsLike ? this.model.groups[this.model.edges[this.picked].group].edges : [this.picked];
    mark(this.lines.selected, "d", this.shape([...this.selected.keys()]));
    mark(this.lines.like, "d", this.shape(like));
    mark(this.lines.hover, "d", this.shape([this.hovered]));
    this.drawKnob();
  }

  /** Polylines of edges as the attribute `d`. @param {number[]} edges -1: none */
  shape(edges) {
    const { breaks, screen } = /** @type {ScreenEdges} */ (this.edges);
    const parts = [];
    for (const edge of edges) {
      if (edge < 0) continue;
      for (let k = breaks[edge]; k < breaks[edge + 1]; k += 1)
        if (screen[2 * k] < 1e8) parts.push(`${k === breaks[edge] ? "M" : "L"}${screen[2 * k].toFixed(1)} ${screen[2 * k + 1].toFixed(1)}`);
    }
    return parts.join("").replace(/^L/, "M");
  }

  drawKnob() {
    const knob = this.store.document?.model?.axis ? this.shownKnob : null;
    for (const x of [this.knob, this.stem]) x.toggleAttribute("hidden", !knob);
    if (!knob) return;
    const [x1, y1, x2, y2] = this.viewer.project([...knob.tail, ...knob.tip]);
    mark(this.knob, "transform", `translate(${x1} ${y1})`);
    for (const [name, value] of Object.entries({ x1, y1, x2, y2 })) mark(this.stem, name, String(value));
    mark(this.knob, "aria-valuenow", String(this.work));
    mark(this.knob, "aria-valuetext", `${this.work}°`);
  }

  drawBox() {
    const { store } = this;
    const { model: placed } = store.document ?? {};
    const sentence = store.latest("model")?.head.sentence;
    this.box.toggleAttribute("hidden", !placed || !(store.options.tool === "edges" || sentence));
    mark(this.box, "data-state", sentence ? "failed" : this.model ? "ready" : "reading");
    if (!placed || this.box.hasAttribute("hidden")) return;
    mark(this.box, "data-selected", String(placed.selected.length));
    mark(this.box, "data-picked", String(this.picked));
    const isReady = Boolean(this.model);
    const axis = placed.selected.length > 0 ? placed.axis : null;
    render(
      html`<p class=${sentence ? "alarm" : "edge-name"} role="status">${sentence ?? (isReady ? this.title() : "Reading the edges of the part …")}</p>
        ${isReady && html`<div class="acts"><button type="button" aria-label="Edge before" onClick=${() => this.step(-1)}>‹</button><button type="button" aria-label="Next edge" onClick=${() => this.step(1)}>›</button>${this.picked >= 0 && this.acts()}</div>
        <div class="acts">${axis && Object.entries(ANGLES).map(([name, text]) => html`<label class="field">${text} <${Entry} value=${`${axis[name]} deg`} size="7" send=${(/** @type {string} */ value) => this.link.edit([{ do: "set", key: `path.orientation.${axis.form}.${name}`, value }])} /></label>`)}</div>
        <button type="button" title="See hidden edges (X)" aria-pressed=${String(store.options.transparent)} onClick=${() => store.setView({ transparent: !store.options.transparent })}>Transparent</button>`}`,
      this.box,
    );
  }

  /** What is at the pointer, or clicked. */
  title() {
    const edge = this.picked >= 0 ? this.picked : this.hovered;
    const count = this.store.document.model.selected.length;
    if (edge < 0) return count ? `${count} ${count === 1 ? "edge" : "edges"} selected` : "Click an edge of the part.";
    return nameOf(this.model.edges[edge]);
  }

  /** Buttons for the clicked edge. */
  acts() {
    const { model, picked, selected } = this;
    const like = model.groups[model.edges[picked].group];
    const show = (/** @type {boolean} */ is) => () => {
      this.showsLike = is;
      // A button loses the focus while it is removed, so it must not be drawn at once.
      this.drawSoon();
    };
    const number = selected.get(picked);
    const same = [...selected.values()].filter((x) => x === number).length;
    const all = like.edges.some((/** @type {number} */ x) => !selected.has(x));
    return html`${number === undefined && html`<button type="button" class="primary" onClick=${() => this.send("pick", false)}>Add</button>`}
      ${like.edges.length > 1 && all && html`<button type="button" title=${like.rule} onPointerEnter=${show(true)} onPointerLeave=${show(false)} onFocus=${show(true)} onBlur=${show(false)} onClick=${() => this.send("pick", true)}>All ${like.edges.length} like this</button>`}
      ${number !== undefined && html`<button type="button" onClick=${() => this.send("unpick", false)}>Remove</button>`}
      ${number !== undefined && same > 1 && html`<button type="button" title=${this.store.document.model.rules[number]} onClick=${() => this.send("unpick", true)}>Remove all ${same}</button>`}`;
  }
}
