// The page: store, connection, and one module per region.

import { init as handles } from "./handles.js";
import { Link } from "./connection.js";
import { Store } from "./state.js";
import { View2d } from "./view2d.js";

/** Regions, in the order in which they receive events. */
const REGIONS = [
  "messages", "collision", "theme", "dock", "header", "steps", "figures", "contours", "tool_strip", "placing", "measure", "viewbar", "pen", "markers", "form", "files", "start_page", "keyboard",
  "obstacles", "part_handle", "tables", "runs", "textpane", "notes", "arm3d", "charts", "playback", "touches", "tasks", "roving",
];
const modules = await Promise.all(REGIONS.map((name) => import(`./${name}.js`)));
const store = new Store();
const link = new Link(store);
const { pointer } = handles(store, link, new View2d(store));
// If one region fails, the others still start.
for (const { init } of modules) {
  try {
    init(store, link, pointer);
  } catch (error) {
    console.error(error);
  }
}
document.body.dataset.regions = "all";
addEventListener("hashchange", () => link.renew());
link.open();
