// The store: the newest frames of the server, the shown time, and the view options.
// Modules read it and listen to it; they do not communicate in any other way.
//
// A picture always has the arrays of a plan; they are empty for a long drawing without one (head.tier "outline").
//
// Events (`store.on(event, listener)` returns a function that ends the listening):
//   document, arm, model, picture, executed, figures    a new frame of the shown run: listener(frame)
//   refusal                 the newest edit is refused (frame), or no longer (null): listener(frame | null)
//   dropped                 an edit is refused and was not made: listener(frame)
//   started, progress, result, cancelled, failed, saved, conflict, download, notice, start    listener(frame)
//   time                    listener()                the shown time changed
//   place                   listener()                the place of the shown time must be in the view of the drawing
//   view                    listener(options)         an option changed, see `ViewOptions`
//   theme                   listener("light" | "dark")
//   link                    listener(link state)      see connection.js
//   reset                   another job or drawing is opened; frames of a run, the arm and the model become null
//   command                 a key such as Ctrl+Z or Ctrl+S follows, so gestures end
//   add logs                the user adds robot logs: listener(files)
//   log                     a robot log is stored: listener(its name)
//   advice                  listener(changes)         changes of the shown job that save time
//   layout                  listener()                the size of a region may have changed
//   remove obstacle         listener(index)           the user removes an obstacle
//   placing                 listener()                what is placed has other values
//   mesh                    the user opens the file of an obstacle: listener(file)
//   fit                     listener()                show all, also obstacles
//   look                    listener(number)          look from the side of this number in the 3D view
//   segments                the segments of the drawing came: listener(frame)
//   escape                  Escape is pressed: listener({taken}); who deselects something sets `taken`

/** @typedef {Float32Array | Float64Array | Uint8Array | Uint16Array | Uint32Array | Int32Array} Numbers */
/**
 * One frame of the server. `head` is its JSON header; `arrays` are views into the frame, row by row.
 * @typedef {{kind: string, seq: number | null, rev: number, head: any, arrays: Record<string, Numbers>,
 *   asked: number}} Frame
 */
/** A tool: select a contour, pick edges, move the part, measure, place obstacles. @typedef {"select" | "edges" | "move" | "measure" | "obstacles"} Tool */
/**
 * @typedef {Object} ViewOptions
 * @property {"limit" | "speed" | "error"} colour   what colours the path
 * @property {string} pen          the shape that is drawn; "" for none
 * @property {Tool} tool          what a click or a drag does; a pen replaces it
 * @property {number} obstacle      the selected obstacle, by its number in the job file; -1: none
 * @property {"both" | "planned" | "executed"} time   which motion is played; both: the planned one, and the executed tool beside it
 * @property {"2d" | "both" | "3d"} stage
 * @property {string} tab           the open tab of the dock: name of its panel without "tab-"
 * @property {boolean} dock         whether the dock is open
 * @property {"contours" | "process" | "robot" | "notes"} side   the open tab of the settings
 * @property {boolean} transparent  whether its parts are transparent
 * @property {number} contour       the selected contour, in the order of the motion; -1: none
 */

/** Minimum time between changes of texts while answers arrive [ms]. */
export const READING = 100;
const OF_A_RUN = new Set(["picture", "executed", "figures"]);
/** Arrays that a picture of a drawing without a plan lacks. */
const PLANNED_ARRAYS = ["path", "path_breaks", "path_s", "path_t", "speed", "assigned", "binding", "xyz", "t"];
const STARTING_OPTIONS = /** @type {ViewOptions} */ ({
  colour: "limit",
  pen: "",
  tool: "select",
  obstacle: -1,
  time: "both",
  // Side by side, the views need a wide page.
  stage: globalThis.innerWidth >= 1000 ? "both" : "2d",
  tab: "charts",
  dock: false,
  side: "contours",
  contour: -1,
  transparent: false,
});

export class Store {
  constructor() {
    /** @type {Map<string, Set<Function>>} */
    this.listeners = new Map();
    /** @type {Map<string, Frame>} newest frame by kind */
    this.frames = new Map();
    /** @type {Frame | null} refusal of the newest edit */
    this.refusal = null;
    /** Touched points of the last measurement, in the drawing and in the frame of the path [m]. @type {{uv: number[][], xyz: number[][]} | null} */
    this.touched = null;
    /** Time of the shown run that all views show [s]. */
    this.time = 0;
    /** @type {ViewOptions} */
    this.options = { ...STARTING_OPTIONS };
    /** @type {"light" | "dark"} */
    this.theme = "light";
    /** Order of the newest frame with a result, as (revision, seq). */
    this.newest = { rev: -1, seq: -1 };
    /** True if there is no connection, so that nothing shown can be called exact. */
    this.isOffline = false;
  }

  /**
   * Listen to an event.
   * @param {string} event @param {Function} listener
   * @returns {() => void} ends it
   */
  on(event, listener) {
    const all = this.listeners.get(event) ?? new Set();
    this.listeners.set(event, all.add(listener));
    return () => all.delete(listener);
  }

  /** Tell an event. @param {string} event @param {any} [detail] */
  tell(event, detail) {
    for (const listener of this.listeners.get(event) ?? []) listener(detail);
  }

  /**
   * The newest frame of a kind, or null.
   * @param {string} kind @returns {Frame | null}
   */
  latest(kind) {
    return this.frames.get(kind) ?? null;
  }

  /** Header of the document, or null before the first. @returns {any} */
  get document() {
    return this.latest("document")?.head ?? null;
  }

  /** The certificate whose plan is shown; empty for the plan of the run. @returns {string} */
  get certificate() {
    return this.latest("picture")?.head.certificate ?? "";
  }

  /** Accept a frame from the server; a frame older than the shown one is dropped. @param {Frame} frame */
  put(frame) {
    if (frame.kind === "picture") for (const name of PLANNED_ARRAYS) frame.arrays[name] ??= new Float32Array(0);
    if (OF_A_RUN.has(frame.kind) || frame.kind === "refusal" || frame.kind === "document") {
      if (this.isOld(frame)) return;
      // If the document is sent again because its draft was dropped, its picture stays valid.
      if (frame.kind !== "document" || frame.rev !== this.newest.rev) this.advance(frame);
    }
    if (frame.kind === "refusal") {
      // The document has not changed, so the shown frames stay valid.
      if (frame.head.dropped) return this.tell("dropped", frame);
      // A refused plan stays refused, whatever the exact figures are.
      if (frame.head.tier === 3 && this.refusal?.head.tier === 1) return;
      return this.setRefusal(frame);
    }
    if (this.clearsRefusal(frame)) this.setRefusal(null);
    if (frame.kind === "document" && this.document && this.document.id !== frame.head.id) this.reset();
    if (frame.kind === "picture") this.keepContour(frame);
    this.frames.set(frame.kind, frame);
    this.tell(frame.kind, frame);
  }

  /** Return whether a frame shows that a refusal no longer applies. @param {Frame} frame */
  clearsRefusal(frame) {
    const { refusal } = this;
    if (!refusal) return false;
    // If the full run is refused, for example for a collision, a later preview does not remove the refusal.
    const isSame = refusal.head.tier === 3 && refusal.rev === frame.rev && refusal.seq === frame.seq;
    if (frame.kind === "picture") return !isSame;
    return frame.kind === "executed" && refusal.head.tier === 2;
  }

  /** Return whether a newer frame is already shown. @param {Frame} frame @returns {boolean} */
  isOld(frame) {
    if (frame.rev !== this.newest.rev) return frame.rev < this.newest.rev;
    return frame.seq !== null && frame.seq < this.newest.seq;
  }

  /** @param {Frame} frame */
  advance(frame) {
    const same = frame.rev === this.newest.rev;
    // If the document is sent again, for example after saving, its picture stays valid.
    const seq = frame.kind === "document" ? null : frame.seq;
    this.newest = { rev: frame.rev, seq: seq ?? (same ? this.newest.seq : -1) };
  }

  /** Forget everything, because another job or drawing is opened. */
  reset() {
    for (const kind of [...OF_A_RUN, "arm", "model", "segments"]) this.frames.delete(kind);
    this.setView({ obstacle: -1, contour: -1 });
    this.setTime(0);
    this.setRefusal(null);
    for (const event of [...OF_A_RUN, "arm", "model", "reset"]) this.tell(event, null);
  }

  /** Accept frame numbers from the start again, because the connection is new. */
  restart() {
    this.newest = { rev: -1, seq: -1 };
  }

  /** @param {Frame | null} refusal */
  setRefusal(refusal) {
    if (refusal === null && this.refusal === null) return;
    this.refusal = refusal;
    this.tell("refusal", refusal);
  }

  /**
   * Return whether a frame answers the same edit as the shown path (a refused edit has no path), and both are of the
   * chosen run.
   * @param {Frame | null} frame @returns {boolean}
   */
  isCurrent(frame) {
    const picture = this.latest("picture");
    if (!frame || !picture || this.refusal?.head.tier === 1) return false;
    const now = this.latest("document")?.rev ?? picture.rev;
    const run = this.document?.run ?? picture.head.run;
    // After another run is chosen, the frames of the one before stay until its own come.
    const isOfRun = picture.head.run === run && frame.head.run === run;
    return isOfRun && picture.rev === now && frame.rev === now && (frame.seq ?? -1) >= (picture.seq ?? -1);
  }

  /** Show a time. @param {number} time [s] */
  setTime(time) {
    this.time = time;
    this.tell("time");
  }

  /** Show a time, and have its place in the view of the drawing. @param {number} time [s] */
  goTo(time) {
    this.setTime(time);
    this.tell("place");
  }

  /** Show the planned time at an arc length. @param {number} s [m] */
  setPlace(s) {
    const arrays = this.latest("picture")?.arrays;
    if (arrays?.path_s.length) this.setTime(along(arrays.path_s, arrays.path_t, s)[0]);
  }

  /** Planned arc length at the shown time [m]. */
  get place() {
    return this.placeAt(this.time);
  }

  /** Return the planned arc length at a time [m]. @param {number} t [s] */
  placeAt(t) {
    const arrays = this.latest("picture")?.arrays;
    return arrays?.path_t.length ? along(arrays.path_t, arrays.path_s, t)[0] : 0;
  }

  /** Keep the contour selected if the order of the contours changes. @param {Frame} next */
  keepContour(next) {
    const [selected, old] = [this.options.contour, this.latest("picture")?.head.contours];
    if (selected < 0 || !old) return;
    const is = (/** @type {any} */ x) => x.number === old[selected]?.number && x.name === old[selected].name;
    this.options = { ...this.options, contour: next.head.contours.findIndex(is) };
  }

  /** Select a contour, and show its beginning. @param {number} contour -1: none */
  selectContour(contour) {
    const [begin] = this.latest("picture")?.head.contours[contour]?.t ?? [];
    this.setView({ contour, side: "contours" });
    if (begin !== undefined) this.goTo(begin);
  }

  /** Select the contour that contains a path piece, and show when the tool is there. @param {number} piece its first point; -1: none */
  selectAt(piece) {
    const { path_breaks: breaks, path_t: times } = this.latest("picture")?.arrays ?? {};
    const contour = breaks && piece >= 0 ? indexAt(breaks, piece) : -1;
    if (contour >= 0 && times) this.setTime(times[piece]);
    if (contour === this.options.contour && this.options.obstacle < 0) return;
    this.setView({ contour, obstacle: -1, ...(contour >= 0 && { side: "contours" }) });
  }

  /** Change view options. @param {Partial<ViewOptions>} changes */
  setView(changes) {
    this.options = { ...this.options, ...changes };
    this.tell("view", this.options);
    if (changes.stage || changes.tab || changes.dock !== undefined) this.tell("layout");
  }

  /** @param {"light" | "dark"} theme */
  setTheme(theme) {
    this.theme = theme;
    this.tell("theme", theme);
  }
}

/**
 * Return the index of the last increasing number that is not above a value; 0 below all numbers.
 * @param {Numbers} increasing @param {number} value @returns {number}
 */
export function indexAt(increasing, value) {
  let low = 0;
  let high = increasing.length - 1;
  while (low < high) {
    const middle = (low + high + 1) >> 1;
    if (increasing[middle] <= value) low = middle;
    else high = middle - 1;
  }
  return low;
}

/**
 * Interpolate a table linearly; outside, return its first or last row.
 * @param {Numbers} xs increasing @param {Numbers} rows @param {number} x @param {number} [width] numbers of a row
 * @returns {number[]}
 */
export function along(xs, rows, x, width = 1) {
  const i = indexAt(xs, x);
  const next = Math.min(i + 1, xs.length - 1);
  const span = xs[next] - xs[i];
  const share = span > 0 ? Math.min(1, Math.max(0, (x - xs[i]) / span)) : 0;
  return Array.from({ length: width }, (_, k) => rows[width * i + k] + share * (rows[width * next + k] - rows[width * i + k]));
}

/**
 * Return a function that runs another one once in the next animation frame, however often it is called.
 * @param {() => void} draw @returns {() => void}
 */
export function oncePerFrame(draw) {
  let waits = false;
  return () => {
    if (waits) return;
    waits = true;
    requestAnimationFrame(() => {
      waits = false;
      draw();
    });
  };
}

/**
 * Return a function that runs another one at most every so many ms, for content that is too slow for every frame. The last
 * state is always drawn.
 * @param {number} every ms @param {() => void} draw @returns {() => void}
 */
export function nowAndThen(every, draw) {
  let last = -Infinity;
  let timer = 0;
  const run = oncePerFrame(() => {
    last = performance.now();
    draw();
  });
  return () => {
    if (timer) return;
    const wait = last + every - performance.now();
    if (wait <= 0) return run();
    timer = setTimeout(() => {
      timer = 0;
      run();
    }, wait);
  };
}
