// The page: store, connection, and one module per region. Regions that are visible first are created before the connection;
// the others (LATER) are loaded after the first picture, or when the user does something.

import { init as contours } from "./contours.js";
import { init as dock } from "./dock.js";
import { find } from "./dom.js";
import { init as figures } from "./figures.js";
import { init as form } from "./form.js";
import { init as files } from "./files.js";
import { init as handles } from "./handles.js";
import { init as header } from "./header.js";
import { init as keys } from "./keyboard.js";
import { Link } from "./connection.js";
import { init as marks } from "./markers.js";
import { init as messages, notify } from "./messages.js";
import { init as pen } from "./pen.js";
import { init as start } from "./start_page.js";
import { Store } from "./state.js";
import { init as theme } from "./theme.js";
import { View2d } from "./view2d.js";
import { init as viewbar } from "./viewbar.js";

/** Regions that show a plan, or are seen once they are opened. */
const LATER = ["obstacles", "part_handle", "tables", "runs", "textpane", "notes", "arm3d", "charts", "playback", "tasks"];
const store = new Store();
const link = new Link(store);
messages(store, link);
theme(store);
const view = new View2d(store);
const { pointer } = handles(store, link, view);
/** Buttons of regions not loaded yet that were pressed. @type {Set<HTMLElement>} */
const pressed = new Set();

/** Make regions; one that fails does not take the others with it. @param {(() => unknown)[]} regions */
function makeAll(regions) {
  for (const make of regions) {
    try {
      make();
    } catch (error) {
      console.error(error);
    }
  }
}

/** Load the other regions, then press the buttons again that were pressed meanwhile. */
async function makeRest() {
  try {
    const regions = await Promise.all(LATER.map((name) => import(`./${name}.js`)));
    store.catchUp(() => makeAll(regions.map(({ init }) => () => init(store, link, pointer))));
  } catch (error) {
    console.error(error);
    notify("Charts, tables and tasks did not load: load the page again.", "alarm");
    return;
  }
  document.removeEventListener("click", keepPressed);
  document.body.dataset.regions = "all";
  for (const button of pressed) button.click();
}

/** @param {Event} event */
function keepPressed({ target }) {
  const button = target instanceof Element ? target.closest("[data-later]") : null;
  if (button) pressed.add(/** @type {HTMLElement} */ (button));
}

makeAll([
  () => dock(store),
  () => header(store, link),
  () => figures(store, link),
  () => contours(store),
  () => viewbar(store, view),
  () => pen(store, link, pointer),
  () => marks(store, view),
  () => form(store, link),
  () => files(store, link),
  () => start(store, link),
  () => keys(store, link, view),
]);
document.addEventListener("click", keepPressed);
// Before the first picture they would have nothing to show; whoever does something may need them at once.
const waiting = new AbortController();
const wish = () => {
  if (waiting.signal.aborted) return;
  waiting.abort();
  requestAnimationFrame(() => setTimeout(makeRest));
};
for (const event of ["picture", "refusal", "view"]) store.on(event, wish);
for (const event of ["pointerdown", "click", "keydown"])
  document.addEventListener(event, wish, { capture: true, signal: waiting.signal });
addEventListener("hashchange", () => link.renew());
find(".skip").addEventListener("click", (event) => {
  event.preventDefault();
  find(store.options.stage === "3d" ? "#view3d canvas" : "#view2d").focus();
});
link.open();
