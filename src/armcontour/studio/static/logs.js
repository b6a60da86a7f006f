// Logs of the robot: which there are, and which of them tasks take.

import { make } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */

/** Endings of logs, and of those that may be drawings as well. */
const [BAGS, TABLES, ENDINGS] = [/\.(log|mcap|db3)$/i, /\.(csv|txt)$/i, ".csv,.txt,.log,.mcap,.db3"];
/** A column of times, in the first line that is no comment; waypoints have none. */
const TIMES = /(^|[^a-z])(t|time|timestamp|zeit|ipoc|sec)([^a-z0-9]|$)/i;
const HELP = "Or drop it: time and joint positions of a robot, as a table or a bag of ROS 2. Ticked logs are of successive runs.";
/** Tasks that need logs. */
export const ON_LOGS = ["measured", "identify", "learn"];

/** Whether a file is a log of a robot. @param {File} file @returns {Promise<boolean>} */
export async function isLog(file) {
  if (!TABLES.test(file.name)) return BAGS.test(file.name);
  const first = (await file.slice(0, 4096).text()).split(/\r?\n/).find((line) => /^\s*[^#\s]/.test(line)) ?? "";
  return /[,;\t]/.test(first) && TIMES.test(first);
}

export class Logs {
  /** @param {Store} store @param {() => void} compare called for a new log */
  constructor(store, compare) {
    this.store = store;
    /** Logs that tasks take. @type {Set<string>} */
    this.ticked = new Set();
    /** Whether set-points were learned since the last log: the next one is of their run. */
    this.learned = false;
    this.list = make("div", { class: "task-fields", role: "group", "aria-label": "Logs that are used" });
    this.columns = make("input", { type: "text", size: 16, placeholder: "u#=command_#,q#=actual_#", "aria-label": "Names of columns" });
    const picker = make("input", { type: "file", hidden: true, accept: ENDINGS, "aria-label": "Log to add" });
    picker.addEventListener("change", () => {
      if (picker.files?.[0]) store.tell("open", { file: picker.files[0], log: true });
      picker.value = "";
    });
    const button = make("button", { type: "button", text: "Add a log", onclick: () => picker.click() });
    const head = make("div", { class: "task-head" }, [button, make("p", { class: "quiet", text: HELP })]);
    this.element = make("section", { class: "task logs", "aria-label": "Logs of the robot" }, [head, this.list, picker]);
    store.on("document", () => this.renew());
    store.on("result", (/** @type {any} */ { head: { task } }) => (this.learned ||= task === "learn"));
    store.on("log", (/** @type {string} */ name) => {
      if (!this.learned) this.ticked.clear();
      this.learned = false;
      this.ticked.add(name);
      this.renew();
      store.setView({ tab: "tasks", dock: true });
      this.element.scrollIntoView();
      compare();
    });
    this.renew();
  }

  /** Options of tasks that take logs, the oldest first. */
  get options() {
    const all = new Set([...(this.store.document?.logs ?? []), ...this.ticked]);
    return { logs: [...all].filter((name) => this.ticked.has(name)), columns: this.columns.value.trim() };
  }

  renew() {
    const boxes = (this.store.document?.logs ?? []).map((/** @type {string} */ name) => {
      const box = make("input", { type: "checkbox", name, checked: this.ticked.has(name) });
      box.addEventListener("change", () => {
        this.ticked[box.checked ? "add" : "delete"](name);
        this.store.tell("logs");
      });
      return make("label", { class: "field" }, [box, ` ${name}`]);
    });
    this.list.replaceChildren(...boxes, ...(boxes.length ? ["columns ", this.columns] : []));
    this.store.tell("logs");
  }
}
