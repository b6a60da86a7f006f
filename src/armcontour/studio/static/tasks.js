// Long work by buttons: check, clearance, certificate, placement, sweep, export, report.

import { find, make, say } from "./dom.js";
import { PlacementMap } from "./placement.js";
import { Result } from "./result.js";
import { TASKS, Form } from "./taskforms.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./link.js").Link} Link */

/** So many results are kept. */
const MOST_RESULTS = 12;

/**
 * Fill the region of the tasks.
 * @param {Store} store
 * @param {Link} link
 */
export function init(store, link) {
  const tasks = new Tasks(find("#tasks"), store, link);
  store.on("progress", (/** @type {Frame} */ x) => tasks.progress(x.head));
  store.on("result", (/** @type {Frame} */ x) => tasks.finish(x));
  store.on("cancelled", (/** @type {Frame} */ x) => tasks.end(x.head.id, "cancelled", "Cancelled."));
  store.on("failed", (/** @type {Frame} */ x) => tasks.end(x.head.id, "failed", x.head.sentence));
  for (const event of ["document", "arm"]) store.on(event, () => tasks.renew());
  store.on("picture", () => tasks.map.redraw());
  store.on("link", () => tasks.renew());
  store.on("reset", () => tasks.clear());
}

/** The buttons, the work under way and the results. */
class Tasks {
  /**
   * @param {HTMLElement} region
   * @param {Store} store
   * @param {Link} link
   */
  constructor(region, store, link) {
    this.region = region;
    this.store = store;
    this.link = link;
    /** @type {Map<string, Result>} */
    this.running = new Map();
    /** @type {Result[]} the newest first */
    this.kept = [];
    this.map = new PlacementMap(store, link);
    this.forms = TASKS.map((task) => new Form(task, (options) => this.start(task.task, task.title, options)));
    this.hint = make("p", { class: "quiet", text: "Results of tasks appear here: sentences, tables, and files to download." });
    this.results = make("div", { class: "task-results", role: "log", "aria-label": "Results" }, [this.hint]);
    const list = make("div", { class: "task-list", role: "group", "aria-label": "Tasks" }, this.forms.map((x) => x.element));
    region.append(list, this.results);
    this.renew();
  }

  /** Results of another job go. */
  clear() {
    for (const old of this.kept.splice(0)) old.close();
    this.running.clear();
    this.tell();
  }

  /** What can be chosen may have changed. */
  renew() {
    const head = this.store.document;
    const open = this.link.state.state === "open" && head !== null;
    const known = { sliders: Object.entries(head?.values ?? {}).map(([key, x]) => ({ key, label: key.split(".").slice(-2).join(" ").replaceAll("_", " "), ...x })), placement: head?.placement ?? false };
    for (const form of this.forms) form.renew({ open, busy: this.running.size > 0, ...known });
    if (!open) for (const id of [...this.running.keys()]) this.end(id, "failed", "The connection was lost, and this work with it.");
  }

  /**
   * Start a task.
   * @param {string} task
   * @param {string} title
   * @param {Record<string, any>} options
   */
  start(task, title, options) {
    // Several pages may ask at once.
    const id = `t${crypto.randomUUID().slice(0, 8)}`;
    const result = new Result(id, task, title, this.store, this.link, () => this.link.send({ op: "cancel", id }));
    this.hint.remove();
    this.results.prepend(result.element);
    // In a narrow page the results are below the forms.
    result.element.scrollIntoView({ block: "nearest" });
    this.kept.unshift(result);
    for (const old of this.kept.splice(MOST_RESULTS)) old.close();
    if (this.link.send({ op: "task", id, task, options }) < 0) {
      result.end("failed", "There is no connection to the server.");
      return;
    }
    this.running.set(id, result);
    this.tell();
  }

  /** @param {{id: string, steps: string[], share: number | null, eta: number | null}} told */
  progress(told) {
    this.running.get(told.id)?.progress(told);
  }

  /** @param {Frame} frame */
  finish(frame) {
    const { id, task } = frame.head;
    const result = this.running.get(id);
    if (!result) return;
    result.finish(frame);
    if (task === "place") {
      this.map.show(frame);
      result.addMap(this.map);
    }
    this.remove(id);
  }

  /**
   * @param {string} id
   * @param {"cancelled" | "failed"} state
   * @param {string} sentence
   */
  end(id, state, sentence) {
    this.running.get(id)?.end(state, sentence);
    this.remove(id);
  }

  /** @param {string} id */
  remove(id) {
    this.running.delete(id);
    this.tell();
  }

  tell() {
    this.region.dataset.running = [...this.running.keys()].join(" ");
    const spoken = document.getElementById("spoken");
    if (spoken && this.running.size === 0) say(spoken, this.results.querySelector(".task-sentence")?.textContent ?? "");
    this.renew();
  }
}
