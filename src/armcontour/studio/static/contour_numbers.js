// Places of the contours' numbers in the drawing, so that no number lies over another one.

/** Width of a digit and height of a number [px]. */
const [DIGIT, HEIGHT] = [7, 13];
/** Size of a contour below which its number is in its middle [px]. */
const SMALL = 80;
/** Distance of a number from the start of its contour, and the least distance between numbers [px]. */
const [AWAY, GAP] = [9, 2];
/** Size below which a contour is covered by its number, and the least distance between such numbers [px]. */
const [COVERED, SPARSE] = [26, 44];

/**
 * Start and size of a contour, see `marksOf`.
 * @typedef {{at: [number, number], out: number[], centre: [number, number], size: number, number: string}} Mark
 * A number with its middle in the drawing [px].
 * @typedef {{number: string, x: number, y: number, index: number}} Placed
 */

/**
 * Place numbers in the middles of small contours, or else outside their starts; numbers without room are left out. Where
 * contours are so small that numbers cover them, only a few are shown; zooming in shows more.
 * The selected contour's number comes first.
 * @param {Mark[]} marks @param {import("./viewport.js").Viewport} view @param {number} selected -1: none @returns {Placed[]}
 */
export function placeNumbers(marks, view, selected) {
  const found = /** @type {Placed[]} */ ([]);
  const taken = /** @type {Map<string, Placed[]>} */ (new Map());
  const order = marks.map((_, k) => k);
  if (marks[selected]) order.unshift(...order.splice(selected, 1));
  for (const index of order) {
    const { number, size } = marks[index];
    const gap = size * view.scale < COVERED ? SPARSE : GAP;
    const place = candidatesOf(marks[index], view).find(([x, y]) => isInside(x, y, view) && isFree(taken, x, y, number, gap));
    if (!place) continue;
    const placed = { number, x: place[0], y: place[1], index };
    found.push(placed);
    const cell = cellOf(placed.x, placed.y);
    taken.set(cell, [...(taken.get(cell) ?? []), placed]);
  }
  return found;
}

/** Return the width of a number [px]. @param {string} number */
const widthOf = (number) => DIGIT * number.length;

/** Return the places at which a number may be, the best first [px]. @param {Mark} mark @param {import("./viewport.js").Viewport} view @returns {[number, number][]} */
function candidatesOf({ at, out, centre, number, size }, view) {
  const [x, y] = view.toScreen(at);
  const beside = /** @type {[number, number]} */ ([x + (AWAY + widthOf(number) / 2) * out[0], y - (AWAY + HEIGHT / 3) * out[1]]);
  // In the middle of a large contour are others.
  const [hasRoom, isSmall] = [size * view.scale > widthOf(number), size * view.scale < SMALL];
  if (!hasRoom) return [beside];
  return isSmall ? [view.toScreen(centre), beside] : [beside, view.toScreen(centre)];
}

/** @param {number} x @param {number} y @param {import("./viewport.js").Viewport} view */
const isInside = (x, y, view) => x > 0 && y > 0 && x < view.width && y < view.height;

/** Side of the cells in which placed numbers are searched [px]: a number of six digits and the largest distance. */
const CELL = 6 * DIGIT + SPARSE;

/** @param {number} x @param {number} y */
const cellOf = (x, y) => `${Math.floor(x / CELL)} ${Math.floor(y / CELL)}`;

/** Return whether a number is away from all placed ones. @param {Map<string, Placed[]>} taken @param {number} x @param {number} y @param {string} number @param {number} gap px */
function isFree(taken, x, y, number, gap) {
  for (const dx of [-CELL, 0, CELL])
    for (const dy of [-CELL, 0, CELL])
      for (const other of taken.get(cellOf(x + dx, y + dy)) ?? []) {
        const room = (widthOf(number) + widthOf(other.number)) / 2 + gap;
        if (Math.abs(x - other.x) < room && Math.abs(y - other.y) < HEIGHT + gap) return false;
      }
  return true;
}
