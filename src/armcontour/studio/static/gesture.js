// A gesture: all changes of one drag or one held arrow key. It is undone in one step.

/** @typedef {import("./connection.js").Link} Link */

/** Browsers delay "pointermove" until the next screen frame; some also report the same motion at once. */
const MOVED = "onpointerrawupdate" in globalThis ? "pointerrawupdate" : "pointermove";

export class Gesture {
  /** @param {Link} link */
  constructor(link) {
    this.link = link;
    this.number = link.newGesture();
    /** @type {object[]} */
    this.edits = [];
  }

  /** Send all changes of the gesture so far. @param {object[]} edits @param {number} at ms */
  update(edits, at) {
    this.edits = edits;
    this.link.edit(edits, { gesture: this.number, final: false, at });
  }

  /** The gesture ends; without a change nothing is sent. */
  end() {
    if (this.edits.length) this.link.edit(this.edits, { gesture: this.number, final: true });
  }

  /** Cancel the gesture: its changes are discarded. */
  cancel() {
    if (this.edits.length) this.link.cancelGesture();
    this.edits = [];
  }
}

/**
 * Drag an element with any pointer; meanwhile it has the class "dragging". A lost pointer ends the gesture; Escape cancels it.
 * @param {Element} element
 * @param {{start: (event: PointerEvent) => boolean, move: (event: PointerEvent) => void, end: (cancelled: boolean) => void,
 *   key?: (event: KeyboardEvent) => void}} on
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
      if (e.key !== "Escape" && e.key !== "Enter") return on.key?.(e);
      e.preventDefault();
      e.stopPropagation();
      finish(e.key === "Escape");
    });
  });
}
