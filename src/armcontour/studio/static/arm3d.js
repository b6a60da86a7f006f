// 3D view of the arm in its cell at the posture of the shown time (WebGL).

import { Camera, VIEW_NAMES, steer } from "./camera.js";
import { PAINTS, cellOf, placedAll, pointsOf } from "./cell.js";
import { find, make, say } from "./dom.js";
import { place } from "./kinematics.js";
import { motionOf } from "./motion.js";
import { along, oncePerFrame } from "./state.js";
import { passed, trailOf } from "./trail.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./cell.js").Cell} Cell */
/** @typedef {import("./motion.js").Motion} Motion */

/** So long after the last change the view rests [ms]. */
const REST = 600;
/** Programs that compute WebGL on the processor. */
const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;
const NO_WEBGL = "The arm in space needs WebGL, which this browser does not provide.";
const NOT_LOADED = "The arm could not be loaded: load the page again.";

/** @param {Store} store */
export function init(store) {
  const view = new ArmView(find("#view3d"), store);
  for (const event of ["picture", "executed", "theme", "arm"]) store.on(event, () => view.outdate(event));
  for (const event of ["time", "view", "layout", "refusal", "figures"]) store.on(event, view.draw);
}

/** The 3D view. Nothing is drawn while it is hidden, or while nothing changes. */
class ArmView {
  /**
   * @param {HTMLElement} region
   * @param {Store} store
   */
  constructor(region, store) {
    this.region = region;
    this.store = store;
    this.camera = new Camera();
    /** Null until it is loaded, and without WebGL. @type {import("./scene3d.js").Scene3D | null} */
    this.scene = null;
    this.isLoading = false;
    /** Why there is no scene. */
    this.problem = "";
    /** @type {Cell | null} */
    this.cell = null;
    /** @type {import("./trail.js").Trail | null} */
    this.trail = null;
    this.stale = new Set(["arm", "picture", "theme"]);
    this.fitted = "";
    /** @type {Motion | null} */
    this.motion = null;
    /** Which motion was requested. */
    this.asked = store.options.time;
    this.frames = 0;
    this.draw = oncePerFrame(() => this.drawNow());
    this.canvas = make("canvas", {
      tabindex: 0, role: "img", class: "arm-canvas",
      "aria-label": "The arm and the tool's path in space. Arrow keys turn the view, with Shift they move it, + and - zoom.",
    });
    this.bar = this.makeBar();
    this.note = make("p", { class: "arm-note", role: "status" });
    this.box = make("div", { class: "arm-box" }, [this.canvas, this.bar, this.note]);
    this.region.append(this.box);
    steer(this.canvas, this.camera, this.draw);
    this.canvas.addEventListener("webglcontextrestored", this.draw);
    new ResizeObserver(this.draw).observe(this.box);
  }

  /** Views as buttons. @returns {HTMLElement} */
  makeBar() {
    const buttons = VIEW_NAMES.map((name) =>
      make("button", { type: "button", text: name, "data-view": name, "aria-pressed": "false", onclick: () => this.look(name) }),
    );
    buttons.push(make("button", { type: "button", text: "fit", title: "Show all of the arm and the path", onclick: () => this.look(null) }));
    return make("div", { class: "arm-bar", role: "toolbar", "aria-label": "View of the arm" }, buttons);
  }

  /** Make the scene when the view is first seen: its code is most of the page's. */
  async load() {
    if (this.isLoading) return;
    this.isLoading = true;
    const renderer = rendererName();
    try {
      if (renderer === null) this.problem = NO_WEBGL;
      else this.scene = new (await import("./scene3d.js")).Scene3D(this.canvas, SOFTWARE.test(renderer));
    } catch {
      this.problem = NOT_LOADED;
    }
    this.outdate("arm");
  }

  /**
   * Something that was read from a frame is to be read anew.
   * @param {string} what
   */
  outdate(what) {
    this.stale.add(what);
    this.draw();
  }

  /**
   * Look from a side, at all of the arm and the path.
   * @param {import("./camera.js").View | null} view null: from where it is
   */
  look(view) {
    if (view) this.camera.look(view);
    this.fitted = "";
    this.draw();
  }

  /** Draw more slowly and better once nothing changes any more. */
  drawAtRest() {
    clearTimeout(this.resting);
    this.resting = setTimeout(() => this.drawNow(true), REST);
  }

  /** @param {boolean} [rests] */
  drawNow(rests = false) {
    // Hidden first: asking for a height makes the browser compute the layout.
    const shown = !this.region.hidden && this.region.clientHeight > 0;
    const frame = this.store.latest("arm");
    if (!shown || !frame) return;
    const { clientWidth: width, clientHeight: height } = this.box;
    if (width < 2 || height < 2) return;
    this.load();
    this.read(frame);
    this.pose(width / height);
    for (const x of this.bar.querySelectorAll("[data-view]")) {
      x.setAttribute("aria-pressed", String(x.getAttribute("data-view") === this.camera.view));
    }
    if (!this.scene) return;
    this.scene.render(this.camera, width, height, rests);
    if (this.scene.software && !rests) this.drawAtRest();
    this.frames += 1;
    this.region.dataset.frames = String(this.frames);
  }

  /**
   * Read what is new of the frames.
   * @param {Frame} frame
   */
  read(frame) {
    const { stale, store } = this;
    if (stale.has("arm") || stale.has("theme")) {
      this.cell = cellOf(frame);
      this.scene?.setCell(this.cell, PAINTS[store.theme]);
    }
    const which = store.options.time;
    if (stale.size > 0 || this.asked !== which) {
      this.asked = which;
      const picture = store.latest("picture");
      this.motion = motionOf(store, which) ?? motionOf(store, "planned");
      this.trail = this.motion && picture ? trailOf(this.motion, picture, store.theme) : null;
      this.camera.path = this.motion && this.cell ? placedAll(this.cell.work, this.motion.trail) : [];
      this.scene?.setTrail(this.trail?.ends ?? new Float32Array(), this.trail?.colours ?? new Float32Array());
    }
    stale.clear();
  }

  /**
   * Show the posture at the shown time.
   * @param {number} aspect width by height
   */
  pose(aspect) {
    const { cell, motion, scene, trail, store, region } = this;
    if (!cell) return;
    const t = Math.min(store.time, motion?.duration ?? 0);
    const q = motion ? along(motion.t, motion.q, t, motion.dof) : cell.chain.joints.map(() => 0);
    const links = cell.chain.links(q);
    const at = cell.chain.toolOf(links);
    scene?.pose(links, at, trail ? passed(trail, t) : 0);
    const refused = store.refusal?.head.at?.xyz;
    scene?.mark(refused ? place(cell.work, refused) : null);
    Object.assign(this.camera, { aspect, size: cell.size, joints: cell.limbs.flatMap((x) => place(links[x.link], x.to)) });
    this.fitOnce(cell, links);
    region.dataset.time = String(t);
    region.dataset.of = motion?.of ?? "none";
    region.dataset.joints = q.join(",");
    region.dataset.elevation = String(this.camera.elevation);
    region.dataset.tool = [at[3], at[7], at[11]].join(",");
    region.dataset.refused = refused ? refused.join(",") : "";
    region.dataset.pieces = String(trail?.times.length ?? 0);
    say(this.note, this.noteText(motion));
  }

  /**
   * See all when the document or the arm is another one, or when it was requested.
   * @param {Cell} cell
   * @param {import("./kinematics.js").Pose[]} links
   */
  fitOnce(cell, links) {
    const key = `${this.store.document?.id} ${cell.name} ${this.motion !== null}`;
    if (key === this.fitted) return;
    this.fitted = key;
    this.camera.fit(pointsOf(cell, links, this.motion?.trail ?? new Float32Array()));
  }

  /**
   * @param {Motion | null} motion
   * @returns {string}
   */
  noteText(motion) {
    if (this.problem) return this.problem;
    // Next to the drawing, the sentence is there or in the messages.
    if (this.store.refusal) return this.store.options.stage === "3d" ? this.store.refusal.head.sentence : "";
    if (!motion) return "No motion yet: the arm is at zero.";
    if (this.asked !== motion.of) return "The executed motion is not there yet: this is the planned one.";
    return "";
  }
}

/** Name of what computes WebGL; null without WebGL. @returns {string | null} */
function rendererName() {
  const gl = make("canvas").getContext("webgl2");
  if (!gl) return null;
  const known = gl.getExtension("WEBGL_debug_renderer_info");
  const name = known ? String(gl.getParameter(known.UNMASKED_RENDERER_WEBGL)) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}
