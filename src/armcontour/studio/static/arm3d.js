// 3D view of the arm in its cell at the posture of the shown time.

import { alarmedBodies, contactAt, contactsOf } from "./collision.js";
import { heat, shadeOf, styleOf, themed } from "./colours.js";
import { draw, find, make, mark, say } from "./dom.js";
import { EdgeTool } from "./edge_tool.js";
import { headOf, knownOf } from "./figures.js";
import { short, textOf } from "./format.js";
import { comparedExecution, motionOf, shownMotion } from "./motion.js";
import { kindAt, largest, PieceGrid, scaleOf, startsOf } from "./polylines.js";
import { measureOf, modelShapes, obstacleShapes } from "./measure.js";
import { placingOf } from "./placing.js";
import { along, indexAt, nowAndThen, oncePerFrame, READING } from "./state.js";
import { shownText } from "./units.js";
import { apply, compose, inverse, poseOfColumns } from "./vectors.js";
import { CLICKED } from "./view2d.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./motion.js").Motion} Motion */
/** @typedef {import("./viewer.js").Lines} Lines */

const NO_WEBGL = "The arm in space needs WebGL, which this browser does not provide.";
const NOT_LOADED = "The arm could not be loaded: load the page again.";
/** Length of the time intervals that have one colour, as a share of the duration. */
const FINEST = 1 / 4000;
/** Within this distance a click selects a contour. */
const NEAR = 6; // px
/** Height of the note at the bottom. */
const NOTE = 44; // px
/** Smaller errors are not described [m]. */
const SMALLEST_ERROR = 1e-9;

/** @param {Store} store @param {import("./connection.js").Link} link */
export function init(store, link) {
  const view = new ArmView(find("#view3d"), store, link);
  for (const event of ["picture", "executed", "theme", "arm", "model", "document", "view"]) store.on(event, () => view.outdate(event));
  store.on("fit", () => view.look(""));
  store.on("look", (/** @type {number} */ number) => view.look(view.viewer?.views[number - 1] ?? ""));
  for (const event of ["time", "layout", "refusal", "figures", "touched", "placing"]) store.on(event, view.draw);
}

/** The 3D view. It draws only while it is visible and something changes. */
class ArmView {
  /** @param {HTMLElement} region @param {Store} store @param {import("./connection.js").Link} link */
  constructor(region, store, link) {
    this.region = region;
    this.store = store;
    this.link = link;
    /** Picks edges; null until the viewer is loaded. @type {EdgeTool | null} */
    this.edgeTool = null;
    /** Finds the body at a place. @type {typeof import("./surface.js").surfaceAt} */
    this.surfaceAt = () => null;
    /** View from which the next picture looks; null: as it is. @type {string | null} */
    this.lookNext = null;
    /** The executed tool; null until the viewer is loaded. @type {import("./ghost.js").Ghost | null} */
    this.ghost = null;
    /** Document for which the tool was offered. */
    this.offered = "";
    /** Null until the viewer is loaded, or if the browser has no WebGL. @type {import("./viewer.js").Viewer | null} */
    this.viewer = null;
    this.isLoading = false;
    /** Why there is no viewer. */
    this.problem = "";
    this.stale = new Set(["arm", "picture"]);
    this.fitted = "";
    /** @type {Motion | null} */
    this.motion = null;
    /** Drawn content, for tests and measurements. @type {Record<string, string>} */
    this.told = {};
    this.draw = oncePerFrame(() => this.drawNow());
    // Texts and attributes take longer than the posture, so they are not written in every screen frame.
    this.describe = nowAndThen(READING, () => this.describeNow());
    this.note = make("p", { class: "arm-note", role: "status" });
    this.box = make("div", { class: "arm-box" }, [this.note]);
    this.region.append(this.box);
    new ResizeObserver(this.draw).observe(this.box);
  }

  /** Load the viewer when the view is shown first, because it is most of the page's code. @param {Frame} arm */
  async load(arm) {
    if (this.isLoading) return;
    this.isLoading = true;
    try {
      const [{ createViewer, rendererName }, { Ghost }] = await Promise.all([import("./viewer.js"), import("./ghost.js")]);
      if (rendererName() === null) this.problem = NO_WEBGL;
      else {
        this.viewer = createViewer(this.box, arm, this.store.theme);
        this.viewer.canvas.className = "arm-canvas";
        this.viewer.bar.className = "arm-bar";
        this.note.before(this.viewer.bar);
        this.listen(this.viewer.canvas);
        const tool = new EdgeTool(this.store, this.link, this.viewer, this.box);
        this.edgeTool = tool;
        const [{ Gizmo }, { surfaceAt }] = await Promise.all([import("./gizmo.js"), import("./surface.js")]);
        this.surfaceAt = surfaceAt;
        const gizmo = new Gizmo(this.store, this.viewer, this.box);
        this.addMeasure(this.viewer);
        this.ghost = new Ghost(this.viewer);
        this.viewer.drawn = () => {
          tool.draw();
          gizmo.draw();
          measureOf().soon();
        };
      }
    } catch (error) {
      console.error(error);
      this.problem = NOT_LOADED;
    }
    this.outdate("arm");
    this.outdate("model");
  }

  /** Measure in this view. @param {import("./viewer.js").Viewer} viewer */
  addMeasure(viewer) {
    const { store } = this;
    const overlay = draw("svg", { class: "gizmo" });
    this.box.append(overlay);
    const work = () => poseOfColumns(viewer.work.elements);
    const measure = measureOf();
    measure.add(
      {
        name: "3d",
        overlay,
        see: (points) => pairsOf(viewer.project(points.flat())),
        isShown: () => store.options.stage !== "2d",
        shapes: () => [...measure.drawn.shapes, ...modelShapes(store), ...obstacleShapes(store, work())],
        surface: (x, y) => {
          const found = this.surfaceAt(viewer, x, y);
          return found && apply(inverse(work()), found.point);
        },
      },
      this.box,
      viewer.canvas,
    );
  }

  /** A click selects the contour or the obstacle at the pointer. @param {HTMLElement} canvas */
  listen(canvas) {
    let [x, y] = [0, 0];
    canvas.addEventListener("pointerdown", (event) => ([x, y] = [event.offsetX, event.offsetY]));
    canvas.addEventListener("click", (event) => {
      const { offsetX, offsetY } = event;
      const isClick = Math.hypot(offsetX - x, offsetY - y) <= CLICKED;
      if (isClick && this.edgeTool?.click(offsetX, offsetY, /** @type {PointerEvent} */ (event).pointerType === "touch")) return;
      if (!isClick || measureOf().click("3d", offsetX, offsetY, /** @type {PointerEvent} */ (event).pointerType === "touch")) return;
      this.select(offsetX, offsetY);
    });
  }

  /** Select the contour or the obstacle at a place. @param {number} x px @param {number} y px */
  select(x, y) {
    const { store, viewer } = this;
    const [picture, motion] = [store.latest("picture"), motionOf(store, "planned")];
    const piece = picture && motion && viewer ? new PieceGrid(viewer.project(motion.trail), startsOf(picture)).nearest(x, y, NEAR) : -1;
    const name = piece < 0 && viewer ? this.surfaceAt(viewer, x, y)?.name : undefined;
    const body = store.document?.obstacles.find((/** @type {any} */ found) => found.name === name);
    // In front of a body on the part, a click belongs to the path.
    const isMeant = body && body.type !== "halfspace" && (body.fixed_to !== "part" || store.options.tool === "obstacles");
    if (isMeant) store.setView({ obstacle: body.index, contour: -1 });
    else store.selectAt(piece);
  }

  /** Read a value from its frame again at the next draw. @param {string} what */
  outdate(what) {
    this.stale.add(what);
    this.draw();
  }

  /** Look from a side. @param {string} name of the view; "" for all from where it is */
  look(name) {
    this.lookNext = name;
    this.draw();
  }

  /** Offer to pick edges if a model without selected edges is opened. */
  offer() {
    const { document, options } = this.store;
    if (!document || document.id === this.offered) return;
    this.offered = document.id;
    const isNew = Boolean(document.model) && hasNoEdges(document.data.path);
    if (isNew) this.store.setView({ tool: "edges", ...(options.stage === "2d" && { stage: "3d" }) });
    else if (options.tool !== "select") this.store.setView({ tool: "select" });
  }

  drawNow() {
    this.offer();
    // Check `hidden` first, because reading a height makes the browser compute the layout.
    const arm = this.store.latest("arm");
    // The cell of another job is not shown while a job is opened.
    mark(this.region, "data-cell", arm ? arm.head.name : "");
    if (this.region.hidden || this.region.clientHeight === 0) return;
    if (!arm) return this.describe();
    this.load(arm);
    this.read(arm);
    this.pose(arm);
    if (this.lookNext !== null) this.viewer?.look(this.lookNext);
    this.lookNext = null;
    this.describe();
  }

  /** Read new frames. @param {Frame} arm */
  read(arm) {
    const { stale, store, viewer } = this;
    const placed = store.document?.model ?? null;
    if (stale.has("model") || stale.has("document")) {
      const model = placed ? store.latest("model") : null;
      if (viewer?.setModel(model?.head.sentence ? null : model)) stale.add("arm");
      if (stale.has("model")) this.edgeTool?.read();
    }
    if (stale.has("arm")) {
      viewer?.setArm(arm);
      this.ghost?.readArm();
    }
    if (placed) this.placeModel(placed.at);
    this.region.dataset.model = viewer?.shownModel?.head.source ?? "";
    viewer?.setTransparent(store.options.transparent && placed !== null);
    if (stale.has("theme")) viewer?.setTheme(store.theme);
    if (stale.size > 0) {
      const picture = store.latest("picture");
      this.motion = shownMotion(store);
      viewer?.setPath(this.motion && picture ? this.lines(this.motion, picture) : []);
      viewer?.setAxes(placed ? (picture?.arrays.tool_axes ?? []) : []);
    }
    stale.clear();
  }

  /** Place the model, also while the part is dragged. @param {number[][]} at its pose in the document */
  placeModel(at) {
    const motion = placingOf().partMotion;
    this.viewer?.placeModel(motion ? compose(motion, at) : at);
  }

  /** The path with the colours of the drawing, and rapids. @param {Motion} motion @param {Frame} picture @returns {Lines[]} */
  lines({ of, trail, trailTimes, duration }, picture) {
    const { theme, options } = this.store;
    const { path_breaks, path_t: times, speed, rapid_xyz = [], rapid_breaks = [] } = picture.arrays;
    const errors = this.store.latest("executed")?.arrays;
    const [fastest, farthest] = [largest(speed), scaleOf(this.store.latest("executed"))];
    const colourAt = (/** @type {number} */ t) => {
      if (options.colour === "error" && errors?.t.length) return shadeOf(along(errors.t, errors.off, t)[0] / farthest, theme);
      const k = indexAt(times, t);
      return options.colour === "speed" ? heat(speed[k] / (fastest || 1), theme) : styleOf(kindAt(picture, k), theme).colour;
    };
    const [rapids, known] = [styleOf("rapids between contours", theme).colour, /** @type {Map<number, string>} */ (new Map())];
    const [begin, end] = path_breaks.subarray(options.contour, options.contour < 0 ? 0 : options.contour + 2);
    const colours = (/** @type {number} */ k) => {
      if (k >= begin && k < end && of === "planned") return themed("--accent");
      const key = Math.floor(trailTimes[k] / (FINEST * (duration || 1)));
      const found = known.get(key) ?? colourAt(trailTimes[k]);
      known.set(key, found);
      return found;
    };
    if (of === "executed") return [{ points: trail, colours }];
    return [{ points: trail, breaks: path_breaks, colours }, { points: rapid_xyz, breaks: rapid_breaks, thin: true, colours: () => rapids }];
  }

  /** Show the posture at the shown time. @param {Frame} arm */
  pose(arm) {
    const { motion, viewer, store } = this;
    const t = Math.min(store.time, motion?.duration ?? 0);
    const contact = contactAt(store);
    const q = contact?.q ?? (motion ? along(motion.t, motion.q, t, motion.dof) : arm.head.joints.map(() => 0));
    const refused = store.refusal?.head.at?.xyz ?? null;
    const tool = viewer?.setJoints(q) ?? [];
    // The executed motion has its own tool.
    this.ghost?.show(motion?.of === "planned" && !contact ? comparedExecution(store) : null, t);
    viewer?.mark(contact?.points ?? headOf(store).nearest?.points ?? null, contact ? null : refused);
    viewer?.touch(store.touched?.xyz ?? []);
    const alarmed = alarmedBodies(store);
    viewer?.alert(alarmed);
    // A model without selected edges is shown alone, and stays in view while its edges are picked.
    const hasModel = Boolean(viewer?.shownModel);
    // The arm and the bodies of a new job come after its motion.
    const key = `${store.document?.id} ${arm.head.document} ${arm.head.name} ${hasModel || motion !== null} ${hasModel}`;
    if (viewer && key !== this.fitted) {
      this.fitted = key;
      // The buttons of the views, and the note, cover parts of the picture.
      viewer.covered = { top: viewer.bar.offsetTop + viewer.bar.offsetHeight, bottom: NOTE };
      viewer.look(hasModel && store.options.tool === "edges" ? "Part" : "Cell");
    }
    this.told = {
      ghost: this.ghost?.factor ? this.ghost.tip.position.toArray().join(",") : "", magnify: String(this.ghost?.factor ?? 0),
      time: String(t), of: motion?.of ?? "none", joints: q.join(","), tool: tool.join(","), refused: refused?.join(",") ?? "", alarmed: alarmed.join(","), pieces: String(viewer?.pieces ?? 0),
    };
  }

  /** Write the note, and describe the drawn content for tests and measurements. */
  describeNow() {
    say(this.note, this.noteText(this.motion));
    Object.assign(this.region.dataset, this.told, { frames: String(this.viewer?.frames ?? 0) });
  }

  /** @param {Motion | null} motion @returns {string} */
  noteText(motion) {
    if (this.problem) return this.problem;
    if (!this.store.latest("arm")) return this.viewer ? "The cell of the job that is opened follows." : "";
    // Next to the drawing, the drawing or the messages show the sentence.
    if (contactsOf(this.store).length > 0) return "";
    if (this.store.refusal) return this.store.options.stage === "3d" ? this.store.refusal.head.sentence : "";
    const { nearest, obstacle_t: toObstacle, own_links_t: ownLinks } = headOf(this.store);
    const times = { obstacle: toObstacle, own_links: ownLinks, "clearance.low": nearest?.t };
    const [name = ""] = Object.entries(times).find(([, t]) => t === this.store.time) ?? [];
    const pair = knownOf(this.store).rows.get(name);
    if (pair) return `Nearest here: ${pair.note}, ${textOf(pair)}`;
    if (!motion) return "No motion yet: the arm is at zero.";
    if (this.store.options.time === "executed" && motion.of === "planned") return "The executed motion is not there yet: this is the planned one.";
    const { factor = 0, error = 0 } = this.ghost ?? {};
    const off = error < SMALLEST_ERROR ? `< ${1e6 * SMALLEST_ERROR}` : short(1e6 * error, 3);
    return factor ? shownText(`Blue: the executed tool, ${off} µm off the path, error ×${factor}`) : "";
  }
}

/** Return pairs of numbers. @param {Float32Array} numbers @returns {number[][]} */
const pairsOf = (numbers) => Array.from({ length: numbers.length / 2 }, (_, k) => [numbers[2 * k], numbers[2 * k + 1]]);

/** Return whether no edge of a model is selected; a path without rules has all its edges. @param {any} path @returns {boolean} */
const hasNoEdges = (path) => Array.isArray(path?.edges) && path.edges.length === 0;
