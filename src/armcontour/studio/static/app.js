// The page: the store, the connection, and one module per region.

import { init as arm3d } from "./arm3d.js";
import { init as charts } from "./charts.js";
import { init as dock } from "./dock.js";
import { init as figures } from "./figures.js";
import { init as files } from "./files.js";
import { init as handles } from "./handles.js";
import { init as header } from "./header.js";
import { init as keys } from "./keys.js";
import { Link } from "./link.js";
import { init as marks } from "./marks.js";
import { init as messages } from "./messages.js";
import { init as notes } from "./notes.js";
import { init as obstacles } from "./obstacles.js";
import { init as panel } from "./panel.js";
import { init as picture } from "./picture.js";
import { init as place } from "./place.js";
import { init as playback } from "./playback.js";
import { init as runs } from "./runs.js";
import { init as splitter } from "./splitter.js";
import { Store } from "./state.js";
import { init as tables } from "./tables.js";
import { init as tasks } from "./tasks.js";
import { init as textpane } from "./textpane.js";
import { init as theme } from "./theme.js";
import { View2d } from "./view2d.js";
import { init as viewbar } from "./viewbar.js";

const store = new Store();
const link = new Link(store);
messages(store);
theme(store);
const view = new View2d(store);
/** What makes the regions; one that fails does not take the others with it. @type {(() => unknown)[]} */
const regions = [
  () => dock(store),
  () => splitter(store),
  () => header(store, link),
  () => figures(store),
  () => viewbar(store, view),
  () => {
    const grabbed = handles(store, link, view);
    obstacles(store, link, view, grabbed);
    place(store, link, view, grabbed);
  },
  () => marks(store, view),
  () => panel(store, link),
  () => tables(store, link),
  () => runs(store, link),
  () => files(store, link),
  () => textpane(store, link),
  () => notes(store),
  () => picture(store, view, arm3d(store, link)),
  () => charts(store, link),
  () => playback(store, link),
  () => tasks(store, link),
  () => keys(store, link, view),
];
for (const make of regions) {
  try {
    make();
  } catch (error) {
    console.error(error);
  }
}
link.open();
