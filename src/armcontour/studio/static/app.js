// The page: the store, the connection, and one module per region. Each module has `init(store, link)`.

import { Link } from "./link.js";
import { Store } from "./state.js";

/** @typedef {import("./state.js").Store} TheStore */
/** @typedef {(store: TheStore, link: Link) => void} Init */

/** In this order; a module that fails does not take the others with it. @type {Init[]} */
const MODULES = [];

const store = new Store();
const link = new Link(store);
for (const init of MODULES) {
  try {
    init(store, link);
  } catch (error) {
    console.error(error);
  }
}
link.open();
