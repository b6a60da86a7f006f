// The arm in its cell: shows the posture at the cursor, in WebGL, or as lines where there is none.

import { Camera, VIEW_NAMES, steer } from "./camera.js";
import { PAINTS, cellOf, pointsOf } from "./cell.js";
import { find, make, say } from "./dom.js";
import { seconds } from "./format.js";
import { place } from "./kinematics.js";
import { jointsAt, motionOf } from "./motion.js";
import { Rate } from "./rate.js";
import { Readout } from "./readout.js";
import { oncePerFrame } from "./state.js";
import { Stick2D } from "./stick2d.js";
import { passed, trailOf } from "./trail.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./cell.js").Cell} Cell */
/** @typedef {import("./motion.js").Motion} Motion */
/** @typedef {import("./scene3d.js").Scene3D} Scene3D */

/** Times closer than this are the same [s]. */
const SAME_TIME = 1e-9;
/** Starts that differ by more are in different configurations [rad]. */
const SAME_POSTURE = 0.01;
/** So long after the last change the view rests [ms]. */
const REST = 600;
/** Numbers change so often at most [ms]. */
const READING = 80;

/**
 * Fill the region of the 3D view.
 * @param {Store} store
 * @param {Link} _link
 * @returns {ArmView}
 */
export function init(store, _link) {
  const view = new ArmView(find("#view3d"), store);
  for (const event of ["picture", "executed", "theme", "arm"]) store.on(event, () => view.outdate(event));
  for (const event of ["cursor", "view", "layout", "refusal", "figures"]) store.on(event, view.draw);
  store.on("pose", (/** @type {Frame} */ frame) => view.takePose(frame));
  return view;
}

/** The 3D view. Nothing is drawn while it is hidden, or while nothing changes. */
export class ArmView {
  /**
   * @param {HTMLElement} region
   * @param {Store} store
   */
  constructor(region, store) {
    this.region = region;
    this.store = store;
    this.camera = new Camera();
    /** @type {Scene3D | Stick2D | null} */
    this.scene = null;
    /** What draws by WebGL is most of the page's code, and is loaded when the view is first seen. @type {typeof import("./scene3d.js").Scene3D | null} */
    this.Scene3D = null;
    this.isLoading = false;
    /** @type {Cell | null} */
    this.cell = null;
    /** @type {import("./trail.js").Trail | null} */
    this.trail = null;
    this.stale = new Set(["arm", "picture", "theme"]);
    this.fitted = "";
    /** @type {Motion | null} */
    this.motion = null;
    /** Of a picture, while it is taken. @type {"light" | "dark" | null} */
    this.theme = null;
    /** Which motion was asked for. */
    this.asked = store.options.time;
    /** @type {Frame | null} the newest answer to a question for a posture */
    this.exact = null;
    this.time = 0;
    this.frames = new Rate();
    /** @type {import("./readout.js").Posture | null} */
    this.told = null;
    /** @type {number | undefined} */
    this.telling = undefined;
    this.draw = oncePerFrame(() => this.drawNow());
    this.canvas = make("canvas", {
      tabindex: 0, role: "img", class: "arm-canvas",
      "aria-label": "The arm and the tool's path in space. Arrow keys turn the view, with Shift they move it, + and - zoom.",
    });
    this.bar = this.makeBar();
    this.note = make("p", { class: "arm-note", role: "status" });
    this.box = make("div", { class: "arm-box" }, [this.canvas, this.bar, this.note]);
    this.readout = new Readout();
    this.readout.element.addEventListener("toggle", this.draw);
    this.region.append(this.box, this.readout.element);
    this.hold(this.canvas);
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

  /** @param {HTMLCanvasElement} canvas */
  hold(canvas) {
    steer(canvas, this.camera, this.draw);
    canvas.addEventListener("webglcontextlost", (event) => {
      event.preventDefault();
      this.replaceScene();
    });
  }

  /** Load what draws by WebGL; without it there are lines. */
  async load() {
    if (this.isLoading) return;
    this.isLoading = true;
    try {
      ({ Scene3D: this.Scene3D } = await import("./scene3d.js"));
    } catch {
      this.region.dataset.renderer = "stick";
    }
    this.draw();
  }

  /** The scene: made when the view is first seen; null while what it needs is being loaded. */
  ensureScene() {
    if (this.Scene3D || this.region.dataset.renderer === "stick") this.scene ??= this.makeScene();
    else this.load();
    return this.scene;
  }

  /** A scene by WebGL, or by lines. @returns {Scene3D | Stick2D} */
  makeScene() {
    let scene;
    try {
      if (!this.Scene3D || this.region.dataset.renderer === "stick") throw new Error("There is no WebGL.");
      scene = new this.Scene3D(this.canvas);
    } catch {
      // A canvas that was asked for WebGL may give no other context.
      const plain = /** @type {HTMLCanvasElement} */ (this.canvas.cloneNode());
      this.canvas.replaceWith(plain);
      this.canvas = plain;
      this.hold(plain);
      scene = new Stick2D(plain);
    }
    this.region.dataset.renderer = scene.kind;
    return scene;
  }

  /** WebGL was taken away: go on with lines. */
  replaceScene() {
    this.scene = null;
    this.region.dataset.renderer = "stick";
    this.outdate("arm");
  }

  /**
   * Something that was read from a frame is to be read anew.
   * @param {string} what
   */
  outdate(what) {
    this.stale.add(what);
    this.exact = null;
    this.draw();
  }

  /**
   * The server's joint positions for a time; they are of the motion that is shown until that changes.
   * @param {Frame} frame
   */
  takePose(frame) {
    this.exact = frame;
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
    const scene = this.ensureScene();
    if (!scene) return;
    this.read(scene, frame);
    this.pose(scene, width / height);
    scene.render(this.camera, width, height, rests);
    if (!rests && scene.software) this.drawAtRest();
    for (const x of this.bar.querySelectorAll("[data-view]")) {
      x.setAttribute("aria-pressed", String(x.getAttribute("data-view") === this.camera.view));
    }
    if (!rests) this.frames.count();
    this.region.dataset.frames = String(this.frames.all);
    this.region.dataset.frameRate = this.frames.rate.toFixed(1);
  }

  /**
   * The arm as it is seen now, drawn once more for a picture.
   * @param {"light" | "dark"} theme
   * @param {number} ratio pixels of the image per px of the page
   * @returns {{image: HTMLCanvasElement, width: number, height: number, scale: number, posture: string} | null} the image is
   *   there until the browser draws again; `scale` in px per m; null while nothing is seen
   */
  still(theme, ratio) {
    this.theme = theme;
    this.stale.add("theme");
    this.drawNow(true);
    const { clientWidth: width, clientHeight: height } = this.box;
    // Before the motion begins, all of its path is of interest.
    if (this.told?.t === 0 && this.cell) {
      const links = this.cell.chain.links(this.told.q);
      this.scene?.pose(links, this.told.at, this.trail?.times.length ?? 0);
    }
    this.scene?.render(this.camera, width, height, true, ratio);
    this.theme = null;
    this.stale.add("theme");
    this.draw();
    if (!this.scene || !this.told) return null;
    const posture = `the arm at ${seconds(this.told.t)} s of the ${this.told.of} motion`;
    return { image: this.canvas, width, height, scale: height / 2 / this.camera.reach, posture };
  }

  /**
   * Read what is new of the frames.
   * @param {Scene3D | Stick2D} scene
   * @param {import("./state.js").Frame} frame
   */
  read(scene, frame) {
    const { stale, store } = this;
    if (stale.has("arm") || stale.has("theme")) {
      this.cell = cellOf(frame);
      scene.setCell(this.cell, PAINTS[this.theme ?? store.theme]);
    }
    const which = store.options.time;
    if (stale.size > 0 || this.asked !== which) {
      this.asked = which;
      const picture = store.latest("picture");
      this.motion = motionOf(store, which) ?? motionOf(store, "planned");
      this.trail = this.motion && picture ? trailOf(this.motion, picture, this.theme ?? store.theme) : null;
      scene.setTrail(this.trail?.ends ?? new Float32Array(), this.trail?.colours ?? new Float32Array());
    }
    stale.clear();
  }

  /**
   * Show the posture at the cursor.
   * @param {Scene3D | Stick2D} scene
   * @param {number} aspect width by height
   */
  pose(scene, aspect) {
    const { cell, motion, trail, store, region } = this;
    if (!cell) return;
    // Without a cursor the arm stays where it was.
    this.time = store.cursor?.t ?? this.time;
    const t = Math.min(this.time, motion?.duration ?? 0);
    const exact = this.exactPose(t);
    const q = exact ?? (motion ? jointsAt(motion, t) : cell.chain.joints.map(() => 0));
    const links = cell.chain.links(q);
    const at = cell.chain.toolOf(links);
    scene.pose(links, at, trail ? passed(trail, t) : 0);
    const refused = store.refusal?.head.at?.xyz;
    scene.mark(refused ? place(cell.work, refused) : null);
    this.fitOnce(cell, links, aspect);
    this.told = { cell, t, q, at, of: motion?.of ?? "planned" };
    this.tellSoon();
    region.dataset.time = String(t);
    region.dataset.of = motion?.of ?? "none";
    region.dataset.exact = String(exact !== null);
    region.dataset.joints = q.join(",");
    region.dataset.tool = [at[3], at[7], at[11]].join(",");
    region.dataset.refused = refused ? refused.join(",") : "";
    region.dataset.pieces = String(trail?.times.length ?? 0);
    say(this.note, this.noteText(motion));
  }

  /** Numbers are for reading: not in every frame. */
  tellSoon() {
    this.telling ??= setTimeout(() => {
      this.telling = undefined;
      if (this.told) this.readout.show(this.told);
    }, READING);
  }

  /**
   * The server's joint positions, if they are those of the cursor.
   * @param {number} t [s]
   * @returns {number[] | null}
   */
  exactPose(t) {
    const { exact, motion } = this;
    if (!exact || exact.head.of !== motion?.of || Math.abs(exact.head.t - t) > SAME_TIME) return null;
    return [...(exact.arrays.q ?? exact.head.q)];
  }

  /**
   * See all when the arm is another one, or when it was asked for.
   * @param {Cell} cell
   * @param {import("./kinematics.js").Pose[]} links
   * @param {number} aspect
   */
  fitOnce(cell, links, aspect) {
    const key = `${cell.name} ${cell.chain.joints.length}`;
    if (key === this.fitted) return;
    this.fitted = key;
    this.camera.fit(pointsOf(cell, links, this.motion?.trail ?? new Float32Array()), aspect);
  }

  /**
   * @param {Motion | null} motion
   * @returns {string}
   */
  noteText(motion) {
    // Beside the drawing, the sentence is there or in the messages.
    if (this.store.refusal) return this.store.options.stage === "3d" ? this.store.refusal.head.sentence : "";
    if (!motion) return "No motion yet: the arm is at zero.";
    if (this.asked !== motion.of) return "The executed motion is not there yet: this is the planned one.";
    if (isElsewhere(motion, this.store.latest("figures")?.head.start)) {
      return "The full run has the arm in another configuration than this preview.";
    }
    if (this.scene?.kind === "stick") return "This browser has no WebGL: the arm is drawn as lines.";
    return "";
  }
}

/**
 * Whether a full run starts in another configuration.
 * @param {Motion} motion
 * @param {number[] | undefined} start joint positions of the full run [rad]
 * @returns {boolean}
 */
function isElsewhere({ q }, start) {
  return Boolean(start?.some((x, k) => Math.abs(x - q[k]) > SAME_POSTURE));
}
