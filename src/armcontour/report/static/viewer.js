// Arm, cell and tool path in space (three.js), for the Studio and for reports. Drawn only on request.

import { frame } from "./framing.js";
import { Chain, poseOf } from "./kinematics.js";
import {
  BufferAttribute, BufferGeometry, Color, DirectionalLight, EdgesGeometry, Fog, GridHelper, Group, HemisphereLight,
  LineBasicMaterial, LineMaterial, LineSegments, LineSegments2, LineSegmentsGeometry, Matrix4, Mesh, MeshBasicMaterial, MeshLambertMaterial,
  OrbitControls, PCFShadowMap, PerspectiveCamera, PlaneGeometry, Scene, ShadowMaterial, SphereGeometry, toCreasedNormals, Vector3, WebGLRenderer,
} from "./vendor/three.js";

/** @typedef {{head: any, arrays: Record<string, any>}} Frame one of the frames `arm` and `picture` */
/** @typedef {{points: ArrayLike<number>, breaks?: ArrayLike<number>, thin?: boolean, colours: (piece: number) => string}} Lines in the work frame [m] */
/** @typedef {"light" | "dark"} Theme */
/** @typedef {{name: string, solid: Mesh, kind: string, link: number, lines?: LineSegments}} Solid */
/** @typedef {{link: number, points: Vector3[]}} Corners of a body, in the frame of its link [m] */

/** Directions from which the views look: azimuth and elevation [rad]. */
const VIEWS = /** @type {Record<string, [number, number]>} */ ({ Part: [-0.9, 0.75], Cell: [-0.7, 0.45], Top: [-Math.PI / 2, 1.5], Front: [-Math.PI / 2, 0.05], Side: [0, 0.05] });
const LABEL = "The arm and the tool's path in space. Arrow keys turn the view, with Shift they move it, + and - zoom.";
/** Renderers that compute WebGL on the processor. */
const SOFTWARE = /swiftshader|llvmpipe|software|basic render/i;
/** Numbers of pixels in software rendering while something moves, because each pixel takes time; smallest and largest resolution of these. With the last one, moving bodies throw no shadows, which take a third of the time. */
const PIXELS = [200e3, 120e3, 80e3, 50e3];
const [COARSEST, FINEST] = [0.4, 0.75];
/** Mean time that pictures wait above which the next smaller number of pixels is used [ms], and the number of pictures of a mean. */
const [SLOW, PACED] = [24, 8];
/** Depth of the ground in the slab that shows a floor of the scene [m], so that the slab hides it at every resolution. */
const SUNK = 0.01;
/** Width of a shadow's soft edge on the ground [m]. */
const SOFT_EDGE = 0.03;
/** Time after the last change until the picture is drawn with smooth edges [ms]. */
const REST = 600;
/** Vertical field of view [degrees]; largest angle from above, so that the camera stays above the floor; angle of a visible edge [degrees]. */
const [FIELD, LOWEST, EDGE] = [29, 1.52, 32];
/** Free margin around what a view shows, as a share of half the picture; smallest distance from the camera to it [m]. */
const [MARGIN, NEAREST] = [0.06, 0.2];
/** Spacing of the lines on the ground, and the spacing for cells with a larger reach than `WIDE` [m]. */
const [FINE_GRID, COARSE_GRID, WIDE] = [0.1, 0.5, 2.5];
/** Rotation [rad] and translation [px] per key press. */
const [KEY_TURN, KEY_SHIFT] = [0.1, 40];
/** Render order of lines, which are drawn in front of shadows and bodies. */
const BEHIND = { polygonOffset: true, polygonOffsetFactor: 1, polygonOffsetUnits: 2 };
/** Colours by theme; obstacles after Okabe and Ito. */
const PAINTS = {
  light: { ground: "#f4f6f8", grid: "#e1e5e9", edge: "#5d6873", tip: "#1c1f24", alarm: "#b3261e", link: "#e4e9ee", joint: "#8fb3cd", axis: "#93a7ba", tool: "#4a5259", obstacle: "#e69f00", table: "#dde1e5", part: "#b9c0c7", line: "#4a5259", arrow: "#0072b2" },
  dark: { ground: "#14171c", grid: "#2a2f37", edge: "#0d1014", tip: "#ffffff", alarm: "#ff7b72", link: "#97a3b1", joint: "#4f7c9c", axis: "#4d6073", tool: "#c2cad4", obstacle: "#e69f00", table: "#30353c", part: "#69737d", line: "#c2cad4", arrow: "#56b4e9" },
};

/** Return the name of the WebGL renderer; null without WebGL. @returns {string | null} */
export function rendererName() {
  const gl = document.createElement("canvas").getContext("webgl2");
  if (!gl) return null;
  const known = gl.getExtension("WEBGL_debug_renderer_info");
  const name = known ? String(gl.getParameter(known.UNMASKED_RENDERER_WEBGL)) : "";
  gl.getExtension("WEBGL_lose_context")?.loseContext();
  return name;
}

/**
 * A viewer in a host element, with its own canvas.
 * @param {HTMLElement} host
 * @param {Frame} arm
 * @param {Theme} theme
 */
export const createViewer = (host, arm, theme) => new Viewer(host, arm, theme);

export class Viewer {
  /** @param {HTMLElement} host @param {Frame} arm @param {Theme} theme */
  constructor(host, arm, theme) {
    this.host = host;
    this.software = SOFTWARE.test(rendererName() ?? "");
    this.renderer = new WebGLRenderer({ antialias: !this.software, powerPreference: "low-power" });
    this.canvas = this.renderer.domElement;
    Object.assign(this.canvas, { tabIndex: 0, role: "img", ariaLabel: LABEL });
    host.prepend(this.canvas);
    /** Buttons for the views, which the host places. */
    this.bar = Object.assign(document.createElement("span"), { role: "group", ariaLabel: "View of the arm" });
    this.bar.append(...Object.keys(VIEWS).map((name) => this.button(name)));
    this.renderer.shadowMap.enabled = true;
    this.renderer.shadowMap.type = PCFShadowMap;
    // Shadows are drawn again only after the arm moves, not after the camera moves.
    this.renderer.shadowMap.autoUpdate = false;
    this.scene = new Scene();
    this.scene.fog = new Fog("", 1, 2);
    this.eye = new PerspectiveCamera(FIELD, 1, 0.01, 100);
    this.eye.up.set(0, 0, 1);
    this.controls = new OrbitControls(this.eye, this.canvas);
    Object.assign(this.controls, { maxPolarAngle: LOWEST, zoomToCursor: true, minDistance: 0.03 });
    this.controls.addEventListener("change", () => {
      // The target is not below the ground, so the camera is not either.
      this.controls.target.z = Math.max(this.ground, this.controls.target.z);
      this.draw();
    });
    this.controls.addEventListener("start", () => this.name(""));
    this.canvas.addEventListener("keydown", (event) => this.press(event));
    this.canvas.addEventListener("webglcontextrestored", () => {
      this.renderer.shadowMap.needsUpdate = true;
      this.draw();
    });
    this.sun = new DirectionalLight("#fff6e8", 2.2);
    this.sun.castShadow = true;
    this.sun.shadow.mapSize.setScalar(this.software ? 512 : 2048);
    this.sun.shadow.bias = -0.002;
    this.floor = new Mesh(new PlaneGeometry(1, 1), new ShadowMaterial({ opacity: 0.2 }));
    this.floor.receiveShadow = true;
    /** Whether a body can throw a shadow on the ground. */
    this.hasFloor = false;
    this.tip = dot();
    this.alarm = dot();
    /** Lines by whether they are thin: the path, and rapids, which do not hide it. */
    this.paths = [3, 1].map((linewidth) => new LineSegments2(new LineSegmentsGeometry(), new LineMaterial({ vertexColors: true, linewidth })));
    /** The same lines with a width of one pixel, for software rendering while something moves: wide lines take three times the whole rest. */
    this.thinPaths = this.paths.map(() => new LineSegments(new BufferGeometry(), new LineBasicMaterial({ vertexColors: true })));
    /** Whether there are such lines. */
    this.hasLines = this.paths.map(() => false);
    this.gap = new LineSegments2(new LineSegmentsGeometry(), new LineMaterial({ linewidth: 2, depthTest: false, transparent: true }));
    for (const x of [...this.paths, ...this.thinPaths, this.gap]) x.frustumCulled = false;
    // The frame of the path; a positioner moves it.
    /** Dots at touched points. */
    this.touched = new Group();
    /** CAD model of the part: its solids, and the lines of its edges. */
    this.model = new Group();
    this.model.matrixAutoUpdate = false;
    /** Arrows along the tool axis. */
    this.axes = new LineSegments2(new LineSegmentsGeometry(), new LineMaterial({ linewidth: 1.5 }));
    this.axes.frustumCulled = this.axes.visible = false;
    this.onWork = new Group().add(...this.paths, ...this.thinPaths, this.alarm, this.touched, this.model, this.axes);
    this.onWork.matrixAutoUpdate = false;
    this.gap.visible = this.alarm.visible = false;
    this.scene.add(new HemisphereLight("#ffffff", "#b9bfc6", 1.5), this.sun, this.sun.target, this.floor, this.tip, this.onWork, this.gap);
    /** Height of the ground; size of the arm without external axes [m]. */
    this.ground = 0;
    this.armSize = 1;
    /** Space that the host covers at the top and at the bottom of the picture [px]. */
    this.covered = { top: 0, bottom: 0 };
    /** @type {Corners[]} */
    this.corners = [];
    /** @type {(Group | GridHelper)[]} one group per link, the base first, and the grid */
    this.groups = [];
    /** @type {Map<string, MeshLambertMaterial | LineBasicMaterial>} */
    this.materials = new Map();
    /** Bodies by name, each with the name of its usual colour. @type {Solid[]} */
    this.solids = [];
    /** Solids of the model. @type {Solid[]} */
    this.modelSolids = [];
    /** Corners of the model's parts in the frame of the path [m]. @type {Vector3[]} */
    this.modelBox = [];
    /** The shown frame `model`. @type {Frame | null} */
    this.shownModel = null;
    /** Called after each picture. */
    this.drawn = () => {};
    /** The marked nearest points and the marked refused point. @type {(number[][] | number[] | null)[]} */
    this.marked = [null, null];
    /** Names of the bodies that are shown in red. */
    this.alarmed = "";
    this.theme = theme;
    this.chain = new Chain(arm.head.joints, arm.head.tool);
    /** Frames of the links at the shown posture, the base first. @type {Matrix4[]} */
    this.links = [];
    this.work = this.onPart = poseOf(arm.head.part.at);
    this.part = 0;
    this.reach = 1;
    this.points = /** @type {Vector3[]} */ ([]);
    this.pieces = this.frames = this.waits = this.resting = 0;
    /** Index of the number of pixels while something moves; how long the last pictures waited [ms], and their number. */
    this.coarseness = this.waited = this.paced = 0;
    this.size = this.view = "";
    this.setArm(arm);
    new ResizeObserver(() => {
      if (this.view) this.look(this.view);
      this.draw();
    }).observe(host);
  }

  /** @param {string} view a name in `VIEWS`, "" for none of them */
  name(view) {
    this.view = view;
    for (const x of this.bar.children) x.ariaPressed = String(x.textContent === view);
  }

  /** Names of the views. */
  get views() {
    return Object.keys(VIEWS);
  }

  /** @param {string} view */
  button(view) {
    const found = Object.assign(document.createElement("button"), { type: "button", textContent: view, ariaPressed: "false" });
    found.dataset.view = view;
    found.addEventListener("click", () => this.look(view));
    return found;
  }

  /** Show an arm and its cell. @param {Frame} frame */
  setArm({ head, arrays }) {
    for (const x of this.groups) x.traverse((y) => /** @type {Mesh} */ (y).geometry?.dispose());
    this.scene.remove(...this.groups);
    this.solids = [];
    this.alarmed = "";
    this.chain = new Chain(head.joints, head.tool);
    this.onPart = poseOf(head.part.at);
    this.part = head.part.link;
    this.reach = Math.max(0.05, head.reach);
    this.armSize = head.size;
    this.ground = head.ground;
    this.corners = [];
    this.groups = [new Group(), ...head.joints.map(() => new Group())];
    for (const x of this.groups) x.matrixAutoUpdate = false;
    const inModel = new Set(this.modelSolids.map((x) => x.name));
    for (const body of head.bodies) if (body.colour !== "part" || !inModel.has(body.name)) this.addBody(body, arrays[body.triangles]);
    this.solids.push(...this.modelSolids);
    const wide = Math.ceil(4 * this.reach);
    const grid = new GridHelper(wide, wide / (this.reach > WIDE ? COARSE_GRID : FINE_GRID));
    grid.rotateX(Math.PI / 2).position.z = this.ground - SUNK;
    this.groups.push(grid);
    this.scene.add(...this.groups);
    this.setJoints(head.joints.map(() => 0));
    this.placeSun();
    this.tip.scale.setScalar(0.005 * this.armSize);
    this.alarm.scale.setScalar(0.01 * this.armSize);
    for (const x of this.touchedDots) x.scale.setScalar(TOUCHED * this.armSize);
    this.controls.maxDistance = 8 * this.reach;
    // The target stays visible.
    this.controls.maxTargetRadius = 1.2 * this.reach;
    this.setTheme(this.theme);
  }

  /** Light the volume in which bodies can be: around the base, or around a cell that is smaller than the reach of its axes. */
  placeSun() {
    const { sun } = this;
    const [low, high] = [new Vector3(Infinity, Infinity, Infinity), new Vector3(-Infinity, -Infinity, -Infinity)];
    for (const x of this.shownPoints(true)) {
      low.min(x);
      high.max(x);
    }
    const around = low.distanceTo(high) / 2 + this.armSize;
    const radius = Math.min(this.reach, around);
    const middle = around < this.reach ? low.add(high).multiplyScalar(0.5) : new Vector3();
    sun.target.position.copy(middle);
    sun.position.set(0.7 * radius, -0.9 * radius, 1.7 * radius).add(middle);
    Object.assign(sun.shadow.camera, { left: -radius, right: radius, top: radius, bottom: -radius, near: 0.1 * radius, far: 4 * radius });
    sun.shadow.camera.updateProjectionMatrix();
    this.placeFloor();
  }

  /** Draw the ground only where bodies can throw shadows, because each pixel of it takes time. */
  placeFloor() {
    const rays = this.sun.position.clone().sub(this.sun.target.position);
    const [low, high, point] = [new Vector3(Infinity, Infinity, 0), new Vector3(-Infinity, -Infinity, 0), new Vector3()];
    const shade = (/** @type {Vector3} */ corner, /** @type {Matrix4} */ pose) => {
      point.copy(corner).applyMatrix4(pose);
      point.addScaledVector(rays, (this.ground - point.z) / rays.z);
      low.min(point);
      high.max(point);
    };
    for (const { link, points } of this.corners) for (const x of points) shade(x, this.groups[link].matrix);
    for (const x of this.modelBox) shade(x, this.work);
    this.hasFloor = low.x < high.x;
    this.floor.position.set((low.x + high.x) / 2, (low.y + high.y) / 2, this.ground - SUNK);
    this.floor.scale.set(high.x - low.x + SOFT_EDGE, high.y - low.y + SOFT_EDGE, 1);
  }

  /** @param {{name: string, link: number, colour: string, at: number[][]}} body @param {Float32Array} triangles [m] */
  addBody({ name, link, colour, at }, triangles) {
    const shape = new BufferGeometry().setAttribute("position", new BufferAttribute(triangles, 3));
    const kind = colour === "link" && /wrist|shoulder|[357]$/.test(name) ? "joint" : colour;
    const solid = new Mesh(toCreasedNormals(shape, 0.55), this.material(kind));
    solid.castShadow = colour !== "table";
    solid.receiveShadow = !this.software || colour === "table" || colour === "part";
    // A table is larger than the cell.
    if (colour !== "table") this.corners.push({ link, points: cornersOf(shape, poseOf(at)) });
    const edges = new LineSegments(new EdgesGeometry(shape, EDGE), this.material("edge"));
    for (const x of [solid, edges]) {
      x.matrixAutoUpdate = false;
      setMatrix(x, poseOf(at));
      this.groups[link].add(x);
    }
    this.solids.push({ name, solid, kind, link, lines: edges });
  }

  /** @param {string} name of a colour */
  material(name) {
    let found = this.materials.get(name);
    if (!found) {
      if (name === "line") found = new LineBasicMaterial();
      else found = name === "edge" ? new LineBasicMaterial({ transparent: true, opacity: 0.28 }) : new MeshLambertMaterial(BEHIND);
      if (name === "obstacle") Object.assign(found, { transparent: true, opacity: 0.7 });
      const paint = /** @type {Record<string, string>} */ (PAINTS[this.theme]);
      found.color.set(paint[name] ?? paint.link);
      this.materials.set(name, found);
    }
    return found;
  }

  /** @param {"light" | "dark"} theme */
  setTheme(theme) {
    this.theme = theme;
    const paint = /** @type {Record<string, string>} */ (PAINTS[theme]);
    this.scene.background = new Color(paint.ground);
    this.scene.fog?.color.set(paint.ground);
    for (const [name, x] of this.materials) x.color.set(paint[name] ?? paint.link);
    this.tip.material.color.set(paint.tip);
    for (const x of [this.alarm, this.gap]) x.material.color.set(paint.alarm);
    for (const x of this.touchedDots) x.material.color.set(paint.tip);
    this.axes.material.color.set(paint.arrow);
    const grid = /** @type {GridHelper} */ (this.groups.at(-1));
    grid.material.vertexColors = false;
    grid.material.color.set(paint.grid);
    grid.material.needsUpdate = true;
    this.draw();
  }

  /** Show the tool's path. @param {Lines[]} lines */
  setPath(lines) {
    this.points = lines.flatMap(({ points }) => sampled(points));
    this.pieces = 0;
    const colour = new Color();
    this.paths.forEach((path, k) => {
      const [ends, colours] = [/** @type {number[]} */ ([]), /** @type {number[]} */ ([])];
      for (const { points, breaks = [0, points.length / 3], thin, colours: of } of lines) {
        if (Number(thin ?? false) !== k) continue;
        for (let line = 0; line + 1 < breaks.length; line += 1)
          for (let i = breaks[line]; i + 1 < breaks[line + 1]; i += 1) {
            for (let j = 0; j < 6; j += 1) ends.push(points[3 * i + j]);
            const { r, g, b } = colour.set(of(i));
            colours.push(r, g, b, r, g, b);
          }
      }
      for (const x of [path, this.thinPaths[k]]) x.geometry.dispose();
      path.geometry = new LineSegmentsGeometry();
      this.hasLines[k] = ends.length > 0;
      if (ends.length) path.geometry.setPositions(ends).setColors(colours);
      const [positions, shades] = [ends, colours].map((x) => new BufferAttribute(new Float32Array(x), 3));
      this.thinPaths[k].geometry = new BufferGeometry().setAttribute("position", positions).setAttribute("color", shades);
      this.pieces += ends.length / 6;
    });
    this.draw();
  }

  get touchedDots() {
    return /** @type {ReturnType<typeof dot>[]} */ (this.touched.children);
  }

  /** Show touched points in the frame of the path [m]. @param {number[][]} points */
  touch(points) {
    if (this.touched.children.length === 0 && points.length === 0) return;
    while (this.touched.children.length > points.length) this.touched.remove(this.touchedDots[points.length]);
    points.forEach((point, k) => {
      if (k === this.touched.children.length) this.touched.add(this.newTouch());
      this.touchedDots[k].position.fromArray(point);
    });
    this.draw();
  }

  newTouch() {
    const made = dot();
    made.material.color.set(/** @type {Record<string, string>} */ (PAINTS[this.theme]).tip);
    made.scale.setScalar(TOUCHED * this.armSize);
    return made;
  }

  /** Show a CAD model; returns whether it was not shown before. @param {Frame | null} frame @returns {boolean} */
  setModel(frame) {
    if (frame === this.shownModel) return false;
    this.shownModel = frame;
    this.model.traverse((x) => /** @type {Mesh} */ (x).geometry?.dispose());
    this.model.clear();
    this.modelSolids = [];
    this.boxModel();
    if (!frame) return true;
    const { points, breaks, triangles, part_breaks: ends } = frame.arrays;
    frame.head.parts.forEach((/** @type {string} */ name, /** @type {number} */ k) => {
      const shape = new BufferGeometry().setAttribute("position", new BufferAttribute(triangles.slice(3 * ends[k], 3 * ends[k + 1]), 3));
      const solid = new Mesh(toCreasedNormals(shape, 0.55), this.material("part"));
      solid.castShadow = true;
      solid.receiveShadow = true;
      this.modelSolids.push({ name, solid, kind: "part", link: -1 });
      this.model.add(solid);
    });
    const lines = new BufferGeometry().setAttribute("position", new BufferAttribute(segmentsOf(points, breaks), 3));
    this.model.add(new LineSegments(lines, this.material("line")));
    this.boxModel();
    return true;
  }

  boxModel() {
    this.modelBox = this.modelSolids.flatMap(({ solid }) => cornersOf(solid.geometry, this.model.matrix));
  }

  /** Place the model in the frame of the path. @param {number[][]} at 4x4 */
  placeModel(at) {
    setMatrix(this.model, poseOf(at));
    this.boxModel();
    this.placeFloor();
    this.renderer.shadowMap.needsUpdate = true;
  }

  /** Show what is behind parts. @param {boolean} is */
  setTransparent(is) {
    const material = this.material("part");
    if (material.transparent === is) return;
    Object.assign(material, { transparent: is, opacity: is ? 0.3 : 1, depthWrite: !is, needsUpdate: true });
    this.draw();
  }

  /** Show arrows in the frame of the path. @param {ArrayLike<number>} strokes their ends [m], (n, 2, 3) */
  setAxes(strokes) {
    this.axes.visible = strokes.length > 0;
    this.axes.geometry.dispose();
    this.axes.geometry = new LineSegmentsGeometry();
    if (strokes.length) this.axes.geometry.setPositions(/** @type {any} */ (strokes));
    this.draw();
  }

  /** Return the projection from the model to the screen, by columns, and the size of the canvas [px]. */
  projectionOfModel() {
    const { clientWidth: width, clientHeight: height } = this.host;
    this.eye.updateMatrixWorld();
    const all = new Matrix4().multiplyMatrices(this.eye.projectionMatrix, this.eye.matrixWorldInverse).multiply(this.work).multiply(this.model.matrix);
    return { matrix: all.elements, width, height };
  }

  /** Return the position of the eye in the coordinates of the model [m]. @returns {number[]} */
  eyeInModel() {
    const pose = this.work.clone().multiply(this.model.matrix);
    return this.eye.position.clone().applyMatrix4(pose.invert()).toArray();
  }

  /** Show the nearest points of two bodies in the base frame [m], and a refused point. @param {number[][] | null} nearest @param {number[] | null} refused */
  mark(nearest, refused) {
    if (this.marked[0] === nearest && this.marked[1] === refused) return;
    this.marked = [nearest, refused];
    this.gap.visible = nearest !== null;
    if (nearest) this.gap.geometry.setPositions(nearest.flat());
    this.alarm.visible = refused !== null;
    if (refused) this.alarm.position.fromArray(refused);
    this.draw();
  }

  /** Show bodies that touch each other in red. @param {string[]} names */
  alert(names) {
    const alarmed = names.join("\n");
    if (alarmed === this.alarmed) return;
    this.alarmed = alarmed;
    for (const { name, solid, kind } of this.solids) solid.material = this.material(names.includes(name) ? "alarm" : kind);
    this.draw();
  }

  /** Place a body that is dragged. @param {string} name @param {Matrix4} pose in the frame of the floor */
  placeBody(name, pose) {
    const found = this.solids.find((x) => x.name === name && x.link >= 0);
    if (!found) return;
    const inLink = this.groups[found.link].matrix.clone().invert().multiply(pose);
    for (const x of [found.solid, found.lines]) if (x) setMatrix(x, inLink);
    this.renderer.shadowMap.needsUpdate = true;
    this.draw();
  }

  /** Return points of the floor's frame on the canvas [px], as pairs; NaN behind the eye. @param {Vector3[]} points */
  toScreen(points) {
    const { clientWidth: width, clientHeight: height } = this.host;
    this.eye.updateMatrixWorld();
    return points.map((point) => {
      const { x, y, z } = point.clone().project(this.eye);
      return z > 1 ? [NaN, NaN] : [((1 + x) / 2) * width, ((1 - y) / 2) * height];
    });
  }

  /** Return the ray through a point of the canvas, in the floor's frame. @param {number} x px @param {number} y px @returns {{from: Vector3, along: Vector3}} `along` has length 1 */
  rayAt(x, y) {
    const { clientWidth: width, clientHeight: height } = this.host;
    this.eye.updateMatrixWorld();
    const along = new Vector3((2 * x) / width - 1, 1 - (2 * y) / height, 0.5).unproject(this.eye).sub(this.eye.position).normalize();
    return { from: this.eye.position.clone(), along };
  }

  /** Show a posture. @param {ArrayLike<number>} q joint positions [rad] @returns {number[]} tool position in the base frame [m] */
  setJoints(q) {
    const links = this.chain.links(q);
    this.links = links;
    const tool = this.chain.toolOf(links);
    links.forEach((x, k) => setMatrix(this.groups[k], x));
    this.work = links[this.part].clone().multiply(this.onPart);
    setMatrix(this.onWork, this.work);
    this.placeFloor();
    this.tip.position.copy(originOf(tool));
    this.renderer.shadowMap.needsUpdate = true;
    this.draw();
    return this.tip.position.toArray();
  }

  /** Return path points on the canvas [px], as pairs. @param {ArrayLike<number>} points (n, 3) */
  project(points) {
    const { clientWidth: width, clientHeight: height } = this.host;
    const found = new Float32Array((2 * points.length) / 3);
    for (let k = 0; 3 * k < points.length; k += 1) {
      const { x, y } = new Vector3().fromArray(points, 3 * k).applyMatrix4(this.work).project(this.eye);
      found.set([((1 + x) / 2) * width, ((1 - y) / 2) * height], 2 * k);
    }
    return found;
  }

  /** Points that are in the picture: the path and the model, for the whole cell also all bodies. @param {boolean} whole @returns {Vector3[]} */
  shownPoints(whole) {
    const points = [...this.points, ...this.modelBox].map((x) => x.clone().applyMatrix4(this.work));
    if (!whole && points.length) return points;
    for (const { link, points: corners } of this.corners) points.push(...corners.map((x) => x.clone().applyMatrix4(this.groups[link].matrix)));
    return [...points, this.tip.position];
  }

  /** Look from a side at the part or at the whole cell, which fills the picture. @param {string} view "" for the side from which it is */
  look(view) {
    const { controls, eye, host, covered } = this;
    const { clientWidth: width, clientHeight: height } = host;
    if (width < 2 || height < 2) {
      this.name(view);
      return;
    }
    const azimuth = view ? VIEWS[view][0] : controls.getAzimuthalAngle() - Math.PI / 2;
    const elevation = view ? VIEWS[view][1] : Math.PI / 2 - controls.getPolarAngle();
    const back = new Vector3(Math.cos(elevation) * Math.cos(azimuth), Math.cos(elevation) * Math.sin(azimuth), Math.sin(elevation));
    const right = new Vector3(-Math.sin(azimuth), Math.cos(azimuth), 0);
    const up = back.clone().cross(right);
    const points = this.shownPoints(view !== "Part").flatMap((x) => [x.dot(right), x.dot(up), x.dot(back)]);
    const field = Math.tan((FIELD * Math.PI) / 360);
    const edge = 1 - MARGIN;
    const [x, y, z] = frame(points, {
      ...{ right: (field * width) / height, up: field, nearest: NEAREST },
      ...{ across: [-edge, edge], along: [-edge + (2 * covered.bottom) / height, edge - (2 * covered.top) / height] },
    });
    eye.position.set(0, 0, 0).addScaledVector(right, x).addScaledVector(up, y).addScaledVector(back, z);
    // The camera turns about the middle of what it shows, above the ground.
    const depths = points.filter((_, k) => k % 3 === 2);
    const middle = z - (Math.min(...depths) + Math.max(...depths)) / 2;
    const away = Math.min(middle, Math.max(NEAREST, (eye.position.z - this.ground) / Math.max(1e-3, back.z)));
    controls.target.copy(eye.position).addScaledVector(back, -away);
    controls.cursor.copy(controls.target);
    controls.maxDistance = Math.max(8 * this.reach, 2 * away);
    controls.update();
    this.name(view);
    this.tellCamera(width / height);
    this.draw();
  }

  /** Write the projection from the floor's frame to the picture, by columns, into the host's data. @param {number} aspect */
  tellCamera(aspect) {
    this.eye.aspect = aspect;
    this.eye.updateProjectionMatrix();
    this.eye.updateMatrixWorld();
    const { elements } = new Matrix4().multiplyMatrices(this.eye.projectionMatrix, this.eye.matrixWorldInverse);
    this.host.dataset.camera = elements.join(",");
  }

  /** Handle keys: arrows rotate, with Shift they move; + and - zoom. @param {KeyboardEvent} event */
  press(event) {
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    const arrows = /** @type {Record<string, [number, number]>} */ ({ ArrowLeft: [1, 0], ArrowRight: [-1, 0], ArrowUp: [0, -1], ArrowDown: [0, 1] });
    const arrow = arrows[event.key];
    const { controls } = this;
    if (arrow && event.shiftKey) controls.pan(KEY_SHIFT * arrow[0], -KEY_SHIFT * arrow[1]);
    else if (arrow) {
      controls.rotateLeft(-KEY_TURN * arrow[0]);
      controls.rotateUp(-KEY_TURN * arrow[1]);
    } else if (event.key === "+" || event.key === "=") controls.dollyIn(1.15);
    else if (event.key === "-") controls.dollyOut(1.15);
    else return;
    event.preventDefault();
    this.name("");
  }

  /** Draw in the next screen frame; once nothing changes any more, with smooth edges. */
  draw() {
    if (this.waits) return;
    const asked = performance.now();
    this.waits = requestAnimationFrame(() => {
      this.waits = 0;
      this.pace(performance.now() - asked);
      this.render(false);
      clearTimeout(this.resting);
      if (this.software) this.resting = setTimeout(() => this.rest(), REST);
    });
  }

  /** Draw with smooth edges, unless another picture follows. */
  rest() {
    if (this.waits) return;
    this.render(true);
    // The next motion begins with finer pictures: the machine may have more time then.
    this.waited = this.paced = 0;
    this.coarseness = Math.max(0, this.coarseness - 1);
  }

  /** Choose the number of pixels by how long pictures wait for the ones before them. @param {number} wait [ms] */
  pace(wait) {
    this.waited += wait;
    this.paced += 1;
    if (this.paced < PACED) return;
    if (this.waited > PACED * SLOW) this.coarseness = Math.min(PIXELS.length - 1, this.coarseness + 1);
    this.waited = this.paced = 0;
  }

  /** @param {boolean} rests true if nothing moves, so that drawing may take longer */
  render(rests) {
    const { clientWidth: width, clientHeight: height } = this.host;
    if (width < 2 || height < 2) return;
    const isCoarse = this.software && !rests;
    this.hasLines.forEach((has, k) => {
      this.paths[k].visible = has && !isCoarse;
      this.thinPaths[k].visible = has && isCoarse;
    });
    const coarse = Math.sqrt(PIXELS[this.coarseness] / (width * height));
    const ratio = isCoarse ? Math.min(FINEST, Math.max(COARSEST, coarse)) : this.software ? 2 : Math.min(2, devicePixelRatio);
    if (String([width, height, ratio]) !== this.size) {
      this.size = String([width, height, ratio]);
      this.renderer.setPixelRatio(ratio);
      this.renderer.setSize(width, height);
      this.eye.aspect = width / height;
    }
    const hasShadows = !isCoarse || this.coarseness < PIXELS.length - 1;
    this.sun.castShadow = hasShadows;
    this.floor.visible = hasShadows && this.hasFloor;
    const away = this.controls.getDistance();
    Object.assign(this.eye, { near: Math.max(0.005, away / 100), far: away + 6 * this.reach });
    Object.assign(/** @type {Fog} */ (this.scene.fog), { near: away + this.reach, far: away + 2.5 * this.reach });
    this.eye.updateProjectionMatrix();
    // While something moves, the shadow is at most one picture old.
    const { shadowMap } = this.renderer;
    const isShadowDue = shadowMap.needsUpdate;
    if (isCoarse) shadowMap.needsUpdate = isShadowDue && hasShadows && this.frames % 2 === 0;
    const isShadowDrawn = shadowMap.needsUpdate;
    this.renderer.render(this.scene, this.eye);
    if (isCoarse) shadowMap.needsUpdate = isShadowDue && !isShadowDrawn;
    this.frames += 1;
    this.host.dataset.frames = String(this.frames);
    this.drawn();
  }

  dispose() {
    cancelAnimationFrame(this.waits);
    clearTimeout(this.resting);
    this.controls.dispose();
    this.renderer.dispose();
    this.canvas.remove();
  }
}

/** Radius of a dot at a touched point, as a share of the arm's size. */
const TOUCHED = 0.0075;

/** Make a dot that is visible through all bodies. @returns {Mesh<SphereGeometry, MeshBasicMaterial>} */
function dot() {
  const found = new Mesh(new SphereGeometry(1, 12, 8), new MeshBasicMaterial({ depthTest: false, transparent: true }));
  found.renderOrder = 2;
  return found;
}

/** Return the pieces of polylines, each with both ends. @param {ArrayLike<number>} points (n, 3) @param {ArrayLike<number>} breaks @returns {Float32Array} */
function segmentsOf(points, breaks) {
  const ends = [];
  for (let line = 0; line + 1 < breaks.length; line += 1)
    for (let i = 3 * breaks[line]; i + 3 < 3 * breaks[line + 1]; i += 3) for (let j = 0; j < 6; j += 1) ends.push(points[i + j]);
  return new Float32Array(ends);
}

/** Return the corners of the box around a geometry, in the frame in which it has a pose. @param {BufferGeometry} geometry @param {Matrix4} pose @returns {Vector3[]} */
function cornersOf(geometry, pose) {
  geometry.computeBoundingBox();
  const { min, max } = /** @type {{ min: Vector3, max: Vector3 }} */ (geometry.boundingBox);
  const found = [];
  for (const x of [min.x, max.x]) for (const y of [min.y, max.y]) for (const z of [min.z, max.z]) found.push(new Vector3(x, y, z).applyMatrix4(pose));
  return found;
}

/** @param {Matrix4} pose */
const originOf = (pose) => new Vector3().setFromMatrixPosition(pose);

/** Select some of the points, with both ends. @param {ArrayLike<number>} points (n, 3) @returns {Vector3[]} */
function sampled(points) {
  const last = points.length / 3 - 1;
  const count = Math.min(150, last + 1);
  return Array.from({ length: count }, (_, k) => new Vector3().fromArray(points, 3 * Math.round((k * last) / Math.max(1, count - 1))));
}

/** @param {import("./vendor/three.js").Object3D} object @param {Matrix4} p */
function setMatrix(object, p) {
  object.matrix.copy(p);
  object.matrixWorldNeedsUpdate = true;
}
