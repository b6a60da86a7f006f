// Drag rows of a list to another place.

/** Distance after which a press on a row is a drag [px]. */
const DRAGGED = 5;
/** Height at both ends of the list at which a drag scrolls it, and the step of the scrolling [px]. */
const [SCROLLED, STEP] = [28, 12];

/**
 * Let the user drag rows of the list: with a mouse anywhere, on a touch screen by the grip. A line shows the new place; Escape ends it.
 * @param {HTMLElement} region @param {(from: number, to: number) => void} move
 */
export function orderByDragging(region, move) {
  const rowOf = (/** @type {any} */ target) => /** @type {HTMLElement | null} */ (target.closest?.("li[data-row]"));
  region.addEventListener("pointerdown", (first) => {
    const row = rowOf(first.target);
    const isGrip = /** @type {Element} */ (first.target).closest(".grip") !== null;
    if (!row || first.button !== 0 || (first.pointerType !== "mouse" && !isGrip)) return;
    const list = /** @type {HTMLElement} */ (row.parentElement);
    const rows = () => /** @type {HTMLElement[]} */ ([...list.querySelectorAll("li[data-row]")]);
    // Places are those of the shown rows, of which a page or a search shows a part.
    const from = rows().indexOf(row);
    const ends = new AbortController();
    /** Row before which it is dropped; -1 while nothing is dragged. */
    let place = -1;
    const show = () => {
      for (const [k, x] of rows().entries()) {
        x.classList.toggle("dragged", place >= 0 && k === from);
        x.classList.toggle("drop-before", place === k);
        x.classList.toggle("drop-after", place === k + 1 && k === rows().length - 1);
      }
    };
    const drag = (/** @type {PointerEvent} */ event) => {
      if (place < 0 && Math.abs(event.clientY - first.clientY) < DRAGGED) return;
      event.preventDefault();
      list.setPointerCapture(event.pointerId);
      const { top, bottom } = list.getBoundingClientRect();
      if (event.clientY < top + SCROLLED) list.scrollTop -= STEP;
      if (event.clientY > bottom - SCROLLED) list.scrollTop += STEP;
      const boxes = rows().map((x) => x.getBoundingClientRect());
      place = boxes.filter((x) => x.top + x.height / 2 < event.clientY).length;
      show();
    };
    const finish = (/** @type {boolean} */ isDropped) => {
      ends.abort();
      const to = place > from ? place - 1 : place;
      const isMoved = isDropped && place >= 0 && to !== from;
      const [moved, other] = [row, rows()[to]].map((x) => Number(x?.dataset.row));
      // The click that ends a drag selects nothing; after a capture the browser may send none.
      const ignored = new AbortController();
      if (place >= 0) addEventListener("click", (event) => event.stopPropagation(), { capture: true, signal: ignored.signal });
      setTimeout(() => ignored.abort());
      place = -1;
      show();
      if (isMoved) move(moved, other);
    };
    const listen = (/** @type {string} */ name, /** @type {(event: any) => void} */ what) => addEventListener(name, what, { signal: ends.signal, capture: true });
    listen("pointermove", drag);
    listen("pointerup", () => finish(true));
    listen("pointercancel", () => finish(false));
    listen("keydown", (event) => {
      if (event.key !== "Escape") return;
      event.stopPropagation();
      finish(false);
    });
  });
}
