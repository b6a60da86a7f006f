// The regions that are loaded later: they show a plan, or are seen once they are opened.

import { init as arm3d } from "./arm3d.js";
import { init as charts } from "./charts.js";
import { init as notes } from "./notes.js";
import { init as obstacles } from "./obstacles.js";
import { init as place } from "./place.js";
import { init as playback } from "./playback.js";
import { init as runs } from "./runs.js";
import { init as tables } from "./tables.js";
import { init as tasks } from "./tasks.js";
import { init as textpane } from "./textpane.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./view2d.js").View2d} View2d */
/** @typedef {import("./pointer.js").Pointer} Pointer */

/**
 * What makes them.
 * @param {Store} store @param {Link} link @param {View2d} view @param {Pointer} pointer
 * @returns {(() => unknown)[]}
 */
export const regionsOf = (store, link, view, pointer) => [
  () => obstacles(store, link, view, pointer),
  () => place(store, link, view, pointer),
  () => tables(store, link),
  () => runs(store, link),
  () => textpane(store, link),
  () => notes(store),
  () => arm3d(store),
  () => charts(store, link),
  () => playback(store, link),
  () => tasks(store, link),
];
