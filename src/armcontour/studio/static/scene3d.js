// Arm, cell and tool trail in three.js. Drawn only on request.

import {
  AxesHelper, BufferAttribute, BufferGeometry, Color, CylinderGeometry, DoubleSide, FrontSide, GridHelper, Group,
  LineBasicMaterial, LineMaterial, LineSegments, LineSegments2, LineSegmentsGeometry, Matrix4, Mesh, MeshBasicMaterial, OrthographicCamera, Scene, SphereGeometry, Vector3, WebGLRenderer,
} from "./vendor/three.js";

/** @typedef {import("./kinematics.js").Pose} Pose */
/** @typedef {import("./camera.js").Camera} Camera */
/** @typedef {import("./cell.js").Cell} Cell */
/** @typedef {import("./cell.js").Body} Body */
/** @typedef {import("./cell.js").Paint} Paint */

/** How far behind the target the camera stands [m]; what is nearer than that by more is cut off. */
const AWAY = 60;

/** Draws on a canvas by WebGL. */
export class Scene3D {
  /**
   * @param {HTMLCanvasElement} canvas
   * @param {boolean} software whether the processor computes WebGL: smooth edges then cost three times as much
   */
  constructor(canvas, software) {
    this.software = software;
    this.renderer = new WebGLRenderer({ canvas, antialias: !software, powerPreference: "low-power" });
    this.size = [1, 1, 0];
    this.scene = new Scene();
    this.eye = new OrthographicCamera(-1, 1, 1, -1, 0.01, 2 * AWAY);
    this.eye.matrixAutoUpdate = false;
    this.still = new Group();
    /** @type {Group[]} one per link, the base first */
    this.links = [];
    this.tip = dot();
    this.alarm = dot();
    this.alarm.visible = false;
    // The part ahead of the tool is also seen through the arm.
    this.ahead = new LineSegments(
      new BufferGeometry(),
      new LineBasicMaterial({ vertexColors: true, depthTest: false, transparent: true, opacity: 0.55 }),
    );
    this.ahead.renderOrder = 1;
    this.passed = new LineSegments2(new LineSegmentsGeometry(), new LineMaterial({ vertexColors: true, linewidth: 4 }));
    for (const x of [this.ahead, this.passed]) x.frustumCulled = false;
    this.trail = new Group();
    this.trail.matrixAutoUpdate = false;
    this.trail.add(this.ahead, this.passed);
    this.scene.add(this.still, this.trail, this.tip, this.alarm);
    /** @type {Map<string, MeshBasicMaterial>} */
    this.materials = new Map();
  }

  /**
   * Show an arm and its cell.
   * @param {Cell} cell
   * @param {Paint} paint
   */
  setCell(cell, paint) {
    for (const x of [...this.links, ...this.still.children]) dispose(x);
    this.scene.remove(...this.links);
    this.still.clear();
    this.links = cell.chain.joints.map(() => new Group());
    this.links.unshift(new Group());
    for (const x of this.links) x.matrixAutoUpdate = false;
    this.scene.add(...this.links);
    for (const body of cell.bodies) this.links[body.link].add(this.solid(body, paint));
    if (cell.sticks) addSticks(cell, this.links, this.material("link", paint));
    setMatrix(this.trail, cell.work);
    this.addFloor(cell, paint);
    const size = cell.size;
    this.tip.scale.setScalar(size * 0.008);
    this.alarm.scale.setScalar(size * 0.011);
    this.repaint(paint);
  }

  /**
   * The colours of a theme.
   * @param {Paint} paint
   */
  repaint(paint) {
    this.renderer.setClearColor(new Color(paint.ground), 1);
    for (const [name, material] of this.materials) material.color.set(paint.bodies[name] ?? paint.bodies.link);
    this.tip.material.color.set(paint.tip);
    this.alarm.material.color.set(paint.alarm);
  }

  /**
   * Show the tool's path, in the work frame.
   * @param {Float32Array} ends of its pieces [m], (n, 6)
   * @param {Float32Array} colours of these ends, (n, 6)
   */
  setTrail(ends, colours) {
    this.ahead.geometry.dispose();
    this.ahead.geometry.setAttribute("position", new BufferAttribute(ends, 3));
    this.ahead.geometry.setAttribute("color", new BufferAttribute(colours, 3));
    this.passed.geometry.dispose();
    this.passed.geometry.setPositions(ends).setColors(colours);
  }

  /**
   * Show a posture.
   * @param {Pose[]} links
   * @param {Pose} at the tool's frame
   * @param {number} done how many pieces of the trail are behind the tool
   */
  pose(links, at, done) {
    links.forEach((x, k) => setMatrix(this.links[k], x));
    this.tip.position.set(at[3], at[7], at[11]);
    this.passed.geometry.instanceCount = done;
  }

  /**
   * Show where something is refused.
   * @param {import("./cell.js").Point | null} at in the frame of the base [m]
   */
  mark(at) {
    this.alarm.visible = at !== null;
    if (at) this.alarm.position.set(...at);
  }

  /**
   * Draw.
   * @param {Camera} camera
   * @param {number} width [px]
   * @param {number} height [px]
   * @param {boolean} rests whether nothing moves, so that time does not matter
   */
  render(camera, width, height, rests) {
    this.resize(width, height, this.software ? (rests ? 2 : 1) : Math.min(2, devicePixelRatio));
    const { across, over, eye } = camera.axes();
    const reach = camera.reach;
    const wide = (reach * width) / height;
    Object.assign(this.eye, { left: -wide, right: wide, top: reach, bottom: -reach });
    this.eye.updateProjectionMatrix();
    const at = camera.target.map((x, k) => x + AWAY * eye[k]);
    this.eye.matrix.set(
      across[0], over[0], eye[0], at[0],
      across[1], over[1], eye[1], at[1],
      across[2], over[2], eye[2], at[2],
      0, 0, 0, 1,
    );
    this.eye.matrixWorldNeedsUpdate = true;
    this.renderer.render(this.scene, this.eye);
  }

  /**
   * @param {number} width [px]
   * @param {number} height [px]
   * @param {number} ratio pixels per px
   */
  resize(width, height, ratio) {
    if (String([width, height, ratio]) === String(this.size)) return;
    this.size = [width, height, ratio];
    this.renderer.setPixelRatio(ratio);
    this.renderer.setSize(width, height, false);
  }

  /**
   * A body from its triangles.
   * @param {Body} body
   * @param {Paint} paint
   * @returns {Mesh}
   */
  solid(body, paint) {
    const shape = new BufferGeometry();
    shape.setAttribute("position", new BufferAttribute(body.triangles, 3));
    shape.computeVertexNormals();
    const found = new Mesh(shape, this.material(body.colour, paint));
    found.matrixAutoUpdate = false;
    setMatrix(found, body.at);
    return found;
  }

  /**
   * @param {string} name "link", "tool", "obstacle", "part" or "table"
   * @param {Paint} paint
   * @returns {MeshBasicMaterial}
   */
  material(name, paint) {
    let found = this.materials.get(name);
    if (!found) {
      found = new MeshBasicMaterial({ color: paint.bodies[name] ?? paint.bodies.link, side: this.software ? FrontSide : DoubleSide });
      found.onBeforeCompile = addLight;
      if (name === "obstacle") Object.assign(found, { transparent: true, opacity: 0.7 });
      this.materials.set(name, found);
    }
    return found;
  }

  /**
   * A grid under the arm, and the axes of base and part.
   * @param {Cell} cell
   * @param {Paint} paint
   */
  addFloor(cell, paint) {
    const wide = Math.ceil(2 * cell.size) / 1;
    const grid = new GridHelper(wide, Math.round(wide / 0.1), paint.axis, paint.grid);
    grid.rotateX(Math.PI / 2);
    const base = new AxesHelper(0.12 * cell.size);
    const part = new AxesHelper(0.1 * cell.size);
    part.matrixAutoUpdate = false;
    setMatrix(part, cell.work);
    this.still.add(grid, base, part);
  }
}

/**
 * Light from the upper left of the eye, at corners only: computed for every pixel it costs twice as much.
 * @param {{vertexShader: string, fragmentShader: string}} shader
 */
function addLight(shader) {
  const light = "vLight = 0.42 + 0.58 * max(0.0, dot(normalize(normalMatrix * normal), vec3(-0.4, 0.5, 0.77)));";
  const [position, colour] = ["#include <project_vertex>", "#include <opaque_fragment>"];
  shader.vertexShader = `varying float vLight;\n${shader.vertexShader.replace(position, `${position}\n${light}`)}`;
  shader.fragmentShader = `varying float vLight;\n${shader.fragmentShader.replace(colour, `outgoingLight *= vLight;\n${colour}`)}`;
}

/** A dot that is seen through all. @returns {Mesh<SphereGeometry, MeshBasicMaterial>} */
function dot() {
  const found = new Mesh(new SphereGeometry(1, 12, 8), new MeshBasicMaterial({ depthTest: false, transparent: true }));
  found.renderOrder = 2;
  return found;
}

/**
 * Links without a shape, as sticks between the joints.
 * @param {Cell} cell
 * @param {Group[]} groups
 * @param {MeshBasicMaterial} material
 */
function addSticks(cell, groups, material) {
  const thick = 0.018 * cell.size;
  for (const { link, from, to } of cell.sticks ?? []) {
    const way = new Vector3(...to).sub(new Vector3(...from));
    const ball = new Mesh(new SphereGeometry(1.5 * thick, 12, 8), material);
    ball.position.set(...from);
    groups[link].add(ball);
    if (way.length() < 1e-6) continue;
    const stick = new Mesh(new CylinderGeometry(thick, thick, way.length(), 12), material);
    stick.position.set(...from).addScaledVector(way, 0.5);
    stick.quaternion.setFromUnitVectors(new Vector3(0, 1, 0), way.normalize());
    groups[link].add(stick);
  }
}

/**
 * @param {import("./vendor/three.js").Object3D} object
 * @param {Pose} p
 */
function setMatrix(object, p) {
  object.matrix.copy(new Matrix4().set(...ofRow(p, 0), ...ofRow(p, 4), ...ofRow(p, 8), 0, 0, 0, 1));
  object.matrixWorldNeedsUpdate = true;
}

/**
 * @param {Pose} p
 * @param {number} k
 * @returns {[number, number, number, number]}
 */
function ofRow(p, k) {
  return [p[k], p[k + 1], p[k + 2], p[k + 3]];
}

/** @param {import("./vendor/three.js").Object3D} root */
function dispose(root) {
  root.traverse((x) => /** @type {Mesh} */ (x).geometry?.dispose());
}
