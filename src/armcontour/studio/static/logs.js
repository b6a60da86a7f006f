// Logs of the robot, and the logs that tasks use.

import { find, make } from "./dom.js";
import { html, signal } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */

/** All endings of logs, for pickers. */
export const ENDINGS = ".csv,.txt,.log,.mcap,.db3";
/** Endings of logs, and of tables, which can also be drawings. */
const [LOGS, TABLES] = [/\.(log|mcap|db3)$/i, /\.(csv|txt)$/i];
/** Time column in the first line that is not a comment; waypoints have none. */
const TIMES = /(^|[^a-z])(t|time|timestamp|ipoc)([^a-z0-9]|$)/i;
/** Stored logs, the oldest first; logs that tasks use; column names; topic of a bag. */
const [all, ticked, columns, topic] = [signal(/** @type {string[]} */ ([])), signal(/** @type {string[]} */ ([])), signal(""), signal("")];

/** Return the logs that tasks use. */
export const logs = () => all.value.filter((name) => ticked.value.includes(name));
export const logOptions = () => ({ logs: logs(), columns: columns.value, topic: topic.value });

/** Return whether a file is a robot log. @param {File} file @returns {Promise<boolean>} */
export async function isLog(file) {
  if (!TABLES.test(file.name)) return LOGS.test(file.name);
  const first = (await file.slice(0, 4096).text()).split(/\r?\n/).find((line) => /^\s*[^#\s]/.test(line)) ?? "";
  return /[,;\t]/.test(first) && TIMES.test(first);
}

/** Listen to new logs; tasks use each one. @param {Store} store */
export function init(store) {
  const update = () => (all.value = store.document?.logs ?? []);
  store.on("document", update);
  update();
  store.on("log", (/** @type {string} */ name) => {
    const other = (/** @type {string} */ x) => x !== name;
    all.value = [...all.value.filter(other), name];
    ticked.value = [...ticked.value.filter(other), name];
    store.setView({ tab: "tasks", dock: true });
    // Tasks on logs appear with the first log.
    requestAnimationFrame(() => find(".logs").scrollIntoView());
  });
}

/** The logs, and a button for another one. @param {{store: Store}} props */
export function Logs({ store }) {
  const add = () => {
    const picker = make("input", { type: "file", accept: ENDINGS, multiple: true, onchange: () => store.tell("add logs", [...(picker.files ?? [])]) });
    picker.click();
  };
  const tick = (/** @type {string} */ name, /** @type {boolean} */ on) => (ticked.value = [...ticked.value.filter((x) => x !== name), ...(on ? [name] : [])]);
  return html`<section class="task logs" aria-label="Logs of the robot">
    <div class="task-head"><button type="button" onClick=${add}>Add logs</button>
      <p class="quiet">A table of time and joint positions that your robot recorded, or a bag of ROS 2. Identify measures its servo with all ticked logs. Learn corrects the next run: there, the ticked logs are of successive runs.</p></div>
    ${all.value.length > 0 && html`<div class="task-fields" role="group" aria-label="Logs that are used">
      ${all.value.map((name) => html`<label class="field" key=${name}><input type="checkbox" checked=${ticked.value.includes(name)} onChange=${(/** @type {any} */ e) => tick(name, e.target.checked)} /> ${name}</label>`)}
      <label class="field" title="Names of the columns, # is the number of a joint: u# are commands, q# are measured. Empty if the log names them as usual">columns <input type="text" size="16" placeholder="u#=command_#,q#=actual_#" onChange=${(/** @type {any} */ e) => (columns.value = e.target.value.trim())} /></label>
      <label class="field" title="Topic of a bag of ROS 2, if several have joints">topic <input type="text" size="16" placeholder="/joint_states" onChange=${(/** @type {any} */ e) => (topic.value = e.target.value.trim())} /></label></div>`}
  </section>`;
}
