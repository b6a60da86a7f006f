// A gesture: what one drag, or one held arrow key, changes. It is undone in one step.

/** @typedef {import("./link.js").Link} Link */
/** @typedef {{x: number, y: number, alt: boolean, shift: boolean, at: number}} Place  px within the region; `at` ms */

// Arrow keys that follow each other within this time are one gesture.
const KEYS_WITHIN = 600; // ms
/** @type {Record<string, [number, number]>} */
const ARROWS = { ArrowLeft: [-1, 0], ArrowRight: [1, 0], ArrowUp: [0, 1], ArrowDown: [0, -1] };
/** Browsers hold "pointermove" back for the next frame of the screen; some tell the same at once, too. */
const MOVED = "onpointerrawupdate" in globalThis ? "pointerrawupdate" : "pointermove";

export class Gesture {
  /** @param {Link} link */
  constructor(link) {
    this.link = link;
    this.number = link.newGesture();
    /** @type {object[]} */
    this.edits = [];
  }

  /** What the gesture has changed so far. @param {object[]} edits @param {number} at ms */
  update(edits, at) {
    this.edits = edits;
    this.link.edit(edits, { gesture: this.number, final: false, at });
  }

  /** The gesture ends; without a change nothing is sent. */
  end() {
    if (this.edits.length) this.link.edit(this.edits, { gesture: this.number, final: true });
  }

  /** As if the gesture had not been. */
  cancel() {
    if (this.edits.length) this.link.cancelGesture();
    this.edits = [];
  }
}

/**
 * Drag an element with any pointer; meanwhile it has the class "dragging". A lost pointer ends the gesture; Escape cancels it.
 * @param {Element} element
 * @param {{start: (event: PointerEvent) => boolean, move: (event: PointerEvent) => void, end: (cancelled: boolean) => void}} on
 *   `start` returns whether it is a drag; `move` may be called many times in a frame of the screen
 */
export function dragged(element, on) {
  element.addEventListener("pointerdown", (first) => {
    const event = /** @type {PointerEvent} */ (first);
    if (event.button !== 0 || !on.start(event)) return;
    event.preventDefault();
    event.stopPropagation();
    /** @type {HTMLElement} */ (element).focus({ preventScroll: true });
    element.setPointerCapture(event.pointerId);
    element.classList.add("dragging");
    const ends = new AbortController();
    const finish = (/** @type {boolean} */ cancelled) => {
      if (ends.signal.aborted) return;
      ends.abort();
      element.classList.remove("dragging");
      on.end(cancelled);
    };
    const listen = (/** @type {EventTarget} */ to, /** @type {string} */ name, /** @type {(e: any) => void} */ what) =>
      to.addEventListener(name, what, { signal: ends.signal, capture: true });
    listen(element, MOVED, (e) => on.move(e));
    listen(element, "lostpointercapture", () => finish(false));
    listen(element, "pointercancel", () => finish(false));
    listen(window, "blur", () => finish(false));
    listen(window, "keydown", (e) => {
      if (e.key !== "Escape") return;
      e.preventDefault();
      e.stopPropagation();
      finish(true);
    });
  });
}

/**
 * Move something with the arrow keys: 1 mm, with Alt 0.1 mm, with Shift 10 mm.
 * @param {Element} element
 * @param {{start: () => void, move: (du: number, dv: number, event: KeyboardEvent) => void, end: () => void}} on metres since the start
 */
export function nudged(element, on) {
  let timer = 0;
  let total = [0, 0];
  const end = () => {
    if (!timer) return;
    clearTimeout(timer);
    timer = 0;
    on.end();
  };
  element.addEventListener("keydown", (first) => {
    const event = /** @type {KeyboardEvent} */ (first);
    const arrow = ARROWS[event.key];
    if (!arrow || event.ctrlKey || event.metaKey) return;
    event.preventDefault();
    event.stopPropagation();
    if (!timer) {
      total = [0, 0];
      on.start();
    }
    clearTimeout(timer);
    timer = setTimeout(end, KEYS_WITHIN);
    const step = event.shiftKey ? 0.01 : event.altKey ? 0.0001 : 0.001;
    total = [total[0] + step * arrow[0], total[1] + step * arrow[1]];
    on.move(total[0], total[1], event);
  });
  element.addEventListener("blur", end);
}
