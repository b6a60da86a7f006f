// Camera of the 3D view: an orbit around a point with parallel projection, so that lengths compare.

/** @typedef {"oblique"|"top"|"front"|"side"} View */

/** Directions from which the views look: azimuth and elevation [rad]. */
const VIEWS = {
  oblique: [-0.9, 0.55],
  top: [-Math.PI / 2, Math.PI / 2],
  front: [-Math.PI / 2, 0],
  side: [0, 0],
};

/** Names of the views, in the order of their buttons. */
export const VIEW_NAMES = /** @type {View[]} */ (Object.keys(VIEWS));

/** What is seen when all is to be seen: so much more; and at most so many times as much. */
const ROOM = 1.12;
const WIDEST = 3;
/** Share of the picture, from its middle, in which something of the scene stays. */
const INSIDE = 0.6;
/** Half of the height that is seen of a path at its nearest, in metres, and of an arm, in parts of its reach. */
const NEAR_PATH = 0.005;
const NEAR_ARM = 0.12;

/** Position of the camera: z is up. It stays above the floor and in sight of the scene. */
export class Camera {
  constructor() {
    /** @type {[number, number, number]} */
    this.target = [0, 0, 0];
    this.azimuth = VIEWS.oblique[0];
    this.elevation = VIEWS.oblique[1];
    /** Half of the height that is seen [m]. */
    this.reach = 1;
    /** @type {View|""} the view that was chosen, "" once it is turned */
    this.view = "oblique";
    /** The largest `reach`. */
    this.widest = 50;
    /** Width of the picture by its height. */
    this.aspect = 1;
    /** The arm's size [m]. */
    this.size = 1;
    /** The tool's path and the joints in the frame of the base [m], (n, 3). @type {ArrayLike<number>} */
    this.path = [];
    /** @type {ArrayLike<number>} */
    this.joints = [];
  }

  /**
   * Look from one of the views.
   * @param {View} view
   */
  look(view) {
    [this.azimuth, this.elevation] = VIEWS[view];
    this.view = view;
  }

  /**
   * Turn around the target.
   * @param {number} right [rad]
   * @param {number} up [rad]
   */
  turn(right, up) {
    this.azimuth -= right;
    this.elevation = Math.min(Math.PI / 2, Math.max(0, this.elevation + up));
    this.view = "";
    this.stay();
  }

  /**
   * Move the target in the picture.
   * @param {number} right [m]
   * @param {number} up [m]
   */
  shift(right, up) {
    this.move(right, up);
    this.stay();
  }

  /** @param {number} right [m] @param {number} up [m] */
  move(right, up) {
    const { across, over } = this.axes();
    for (let k = 0; k < 3; k += 1) this.target[k] += right * across[k] + up * over[k];
  }

  /**
   * See more or less around a place of the picture, which stays; nearer than the arm's parts only where the path is.
   * @param {number} factor above 1 to see more
   * @param {number} [right] of the middle, in parts of half of the height
   * @param {number} [up]
   */
  zoom(factor, right = 0, up = 0) {
    const [x, y] = this.away(this.path);
    const nearest = x || y ? NEAR_ARM * this.size : NEAR_PATH;
    const before = this.reach;
    this.reach = Math.min(this.widest, Math.max(Math.min(before, nearest), before * factor));
    this.move((before - this.reach) * right, (before - this.reach) * up);
    this.stay();
  }

  /** Keep the path or a joint in the picture, from near the path. */
  stay() {
    const all = [this.path, ...(this.reach < NEAR_ARM * this.size ? [] : [this.joints])].map((x) => this.away(x));
    const [x, y] = all.reduce((a, b) => (Math.hypot(...a) <= Math.hypot(...b) ? a : b));
    if (Number.isFinite(x)) this.move(x, y);
  }

  /**
   * How far the nearest of some points is outside of the inner part of the picture.
   * @param {ArrayLike<number>} points (n, 3)
   * @returns {[number, number]} to the right and up [m]; infinite without points
   */
  away(points) {
    const { across, over } = this.axes();
    const [high, wide] = [INSIDE * this.reach, INSIDE * this.reach * this.aspect];
    const [middle, level] = [dot(this.target, across), dot(this.target, over)];
    let [right, up] = [Infinity, Infinity];
    for (let k = 0; k + 2 < points.length; k += 3) {
      const [px, py, pz] = [points[k], points[k + 1], points[k + 2]];
      const x = px * across[0] + py * across[1] + pz * across[2] - middle;
      const y = px * over[0] + py * over[1] + pz * over[2] - level;
      const [dx, dy] = [x - clamp(x, wide), y - clamp(y, high)];
      if (dx * dx + dy * dy < right * right + up * up) [right, up] = [dx, dy];
    }
    return [right, up];
  }

  /**
   * See all of some points.
   * @param {ArrayLike<number>[]} points (n, 3)
   */
  fit(points) {
    const { across, over, eye } = this.axes();
    const [x, y, z] = [across, over, eye].map((axis) => rangeOf(points.map((p) => dot(p, axis))));
    for (let k = 0; k < 3; k += 1) this.target[k] = x.middle * across[k] + y.middle * over[k] + z.middle * eye[k];
    this.reach = Math.max(NEAR_PATH, ROOM * Math.max(y.half, x.half / this.aspect));
    this.widest = WIDEST * this.reach;
  }

  /**
   * Unit vectors to the right and up in the picture, and from the target to the eye.
   * @returns {{across: number[], over: number[], eye: number[]}}
   */
  axes() {
    const [ca, sa] = [Math.cos(this.azimuth), Math.sin(this.azimuth)];
    const [ce, se] = [Math.cos(this.elevation), Math.sin(this.elevation)];
    return { across: [-sa, ca, 0], over: [-se * ca, -se * sa, ce], eye: [ce * ca, ce * sa, se] };
  }

}

/** @param {number[]} values @returns {{middle: number, half: number}} */
function rangeOf(values) {
  const low = values.reduce((a, b) => Math.min(a, b), Infinity);
  const high = values.reduce((a, b) => Math.max(a, b), -Infinity);
  return { middle: (low + high) / 2, half: (high - low) / 2 };
}

/**
 * @param {ArrayLike<number>} a
 * @param {ArrayLike<number>} b
 * @returns {number}
 */
function dot(a, b) {
  return a[0] * b[0] + a[1] * b[1] + a[2] * b[2];
}

/** @param {number} x @param {number} most @returns {number} */
const clamp = (x, most) => Math.min(most, Math.max(-most, x));

/** How far a key turns [rad]. */
const KEY_TURN = 0.1;

/**
 * Turn, move and zoom a camera by pointer, wheel and keys.
 * @param {HTMLElement} element takes the focus
 * @param {Camera} camera
 * @param {() => void} changed
 */
export function steer(element, camera, changed) {
  /** @type {Map<number, {x: number, y: number}>} */
  const held = new Map();
  const metres = () => (2 * camera.reach) / Math.max(1, element.clientHeight);

  element.addEventListener("pointerdown", (event) => {
    element.setPointerCapture(event.pointerId);
    held.set(event.pointerId, { x: event.clientX, y: event.clientY });
  });
  for (const end of ["pointerup", "pointercancel", "lostpointercapture"]) {
    element.addEventListener(end, (event) => {
      held.delete(/** @type {PointerEvent} */ (event).pointerId);
    });
  }
  element.addEventListener("pointermove", (event) => {
    const from = held.get(event.pointerId);
    if (!from) return;
    const [dx, dy] = [event.clientX - from.x, event.clientY - from.y];
    const moves = event.shiftKey || event.buttons > 1 || held.size > 1;
    if (held.size > 1) pinch(held, event, camera);
    if (moves) camera.shift((-dx * metres()) / held.size, (dy * metres()) / held.size);
    else camera.turn(dx * 0.008, dy * 0.008);
    from.x = event.clientX;
    from.y = event.clientY;
    changed();
  });
  element.addEventListener("contextmenu", (event) => event.preventDefault());
  element.addEventListener(
    "wheel",
    (event) => {
      event.preventDefault();
      const { left, top, width, height } = element.getBoundingClientRect();
      const [x, y] = [event.clientX - left - width / 2, top + height / 2 - event.clientY];
      camera.zoom(Math.exp(clamp(event.deltaY * 0.0015, 1)), (2 * x) / height, (2 * y) / height);
      changed();
    },
    { passive: false },
  );
  element.addEventListener("keydown", (event) => {
    if (!pressKey(event, camera)) return;
    event.preventDefault();
    changed();
  });
}

/**
 * Zoom by two fingers.
 * @param {Map<number, {x: number, y: number}>} held before this event
 * @param {PointerEvent} event
 * @param {Camera} camera
 */
function pinch(held, event, camera) {
  const [a, b] = [...held.values()];
  const old = Math.hypot(a.x - b.x, a.y - b.y);
  const other = held.get(event.pointerId) === a ? b : a;
  const now = Math.hypot(event.clientX - other.x, event.clientY - other.y);
  if (old > 0 && now > 0) camera.zoom(old / now);
}

/**
 * Handle a key: arrows turn, with Shift they move; + and - zoom.
 * @param {KeyboardEvent} event
 * @param {Camera} camera
 * @returns {boolean} true if it did something
 */
function pressKey(event, camera) {
  if (event.ctrlKey || event.metaKey || event.altKey) return false;
  const arrows = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
  const arrow = arrows[/** @type {keyof typeof arrows} */ (event.key)];
  if (arrow && event.shiftKey) camera.shift((arrow[0] * camera.reach) / 8, (arrow[1] * camera.reach) / 8);
  else if (arrow) camera.turn(arrow[0] * KEY_TURN, arrow[1] * KEY_TURN);
  else if (event.key === "+" || event.key === "=") camera.zoom(0.87);
  else if (event.key === "-") camera.zoom(1.15);
  else return false;
  return true;
}
