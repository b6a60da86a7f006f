// What tasks there are, and the forms that start them.

import { make } from "./dom.js";
import { ON_LOGS } from "./logs.js";

/**
 * One choice of a form; `kind` says how it is entered. Texts are quantities with a unit, which the server reads.
 * @typedef {object} Field
 * @property {string} name
 * @property {string} label
 * @property {"number" | "text" | "choice" | "tick"} kind
 * @property {string | number | boolean} value at the start
 * @property {[string, string][]} [choices] values and texts
 * @property {number} [min]
 * @property {number} [max]
 * @property {string} [unit]
 */
/**
 * @typedef {object} Task
 * @property {string} task as the server calls it
 * @property {string} title
 * @property {string} what it does, in a sentence
 * @property {Field[]} fields
 * @property {(values: Record<string, any>, sliders: any[]) => Record<string, any>} options for the server
 */

/**
 * Placements that are compared: those of the job's key `placement`, or ranges to both sides of the part's own
 * place.
 */
const PLACE_FIELDS = /** @type {Field[]} */ ([
  { name: "as_job", label: "as in the job (placement)", kind: "tick", value: true },
  { name: "x", label: "x ±", kind: "number", value: 200, min: 0, max: 5000, unit: "mm" },
  { name: "y", label: "y ±", kind: "number", value: 200, min: 0, max: 5000, unit: "mm" },
  { name: "steps", label: "places a side", kind: "number", value: 9, min: 2, max: 60 },
  { name: "yaw", label: "turn ±", kind: "number", value: 0, min: 0, max: 180, unit: "°" },
  {
    name: "objective", label: "best is", kind: "choice", value: "cycle",
    choices: [["cycle", "the shortest cycle"], ["clearance", "the most clearance"], ["manipulability", "the best manipulability"], ["torque", "the most torque to spare"]],
  },
  { name: "every", label: "plan every place", kind: "tick", value: false },
]);

/** @type {[string, string][]} */
const FORMATS = [
  ["urscript", "URScript (.script)"], ["template kuka", "KUKA (.src)"], ["template abb", "ABB (.mod)"], ["csv", "CSV (.csv)"], ["npz", "NumPy (.npz)"],
  ["ros-yaml", "ROS trajectory (.yaml)"], ["mcap", "ROS bag (.mcap)"],
];
/** For which robots a certificate is. @type {[string, string][]} */
const PLANTS = [["", "as in the job"], ["servo", "independent servos"], ["rigid_body", "rigid bodies"]];
/** Points of a sweep. */
const SWEPT = 15;

/** All tasks, in the order of their buttons. @type {Task[]} */
export const TASKS = [
  { task: "check", title: "Check", what: "Looks at every limit of the planned and the executed motion.", fields: [], options: () => ({}) },
  { task: "clearance", title: "Clearance", what: "How near the arm comes to itself and to obstacles, at any time.", fields: [], options: () => ({}) },
  {
    task: "certify", title: "Certify", what: "Finds the fastest plan whose execution is proved to keep the tolerance.",
    fields: [
      { name: "tolerance", label: "tolerance", kind: "number", value: "", min: 0, unit: "mm, or as in the job" },
      { name: "plant", label: "robot", kind: "choice", value: "", choices: PLANTS },
    ],
    options: ({ tolerance, plant }) => ({ ...(tolerance > 0 ? { tolerance: tolerance / 1000 } : {}), ...(plant ? { plant } : {}) }),
  },
  { task: "place", title: "Place", what: "Finds where the part lies best, and maps all places under the drawing.", fields: PLACE_FIELDS, options: placeOptions },
  {
    task: "sweep", title: "Sweep", what: "Cycle time and contour error over the range of one quantity.",
    fields: [{ name: "key", label: "over", kind: "choice", value: "", choices: [] }],
    options: ({ key }, sliders) => {
      const { min, max, log } = sliders.find((x) => x.key === key) ?? {};
      return { key, min, max, log, count: SWEPT };
    },
  },
  {
    task: "export", title: "Export", what: "Set-points for a robot controller, or tables.",
    fields: [
      { name: "format", label: "format", kind: "choice", value: "urscript", choices: FORMATS },
      { name: "of", label: "of", kind: "choice", value: "taught", choices: [["taught", "the set-points"], ["planned", "the plan"], ["learned", "the next set-points, from logs"]] },
    ],
    options: ({ format, of }) => (format.startsWith("template ") ? { format: "template", template: format.slice(9), of } : { format, of }),
  },
  { task: "report", title: "Report", what: "The page with all figures, to keep and to print.", fields: [], options: () => ({}) },
  { task: "measured", title: "Compare", what: "Plan against the last log: contour errors, and the measured tool in the drawing.", fields: [], options: () => ({}) },
  { task: "identify", title: "Identify", what: "Finds the servo of every joint from the logs.", fields: [], options: () => ({}) },
  { task: "learn", title: "Learn", what: "Makes the set-points of the next run, with a smaller error.", fields: [], options: () => ({}) },
];

/**
 * @param {Record<string, any>} values
 * @returns {Record<string, any>}
 */
function placeOptions({ as_job, x, y, yaw, steps, objective, every }) {
  if (as_job) return {};
  /** @type {Record<string, [number, number, number]>} */
  const over = {};
  if (x > 0) over.x = [-x / 1000, x / 1000, steps];
  if (y > 0) over.y = [-y / 1000, y / 1000, steps];
  const turn = (yaw * Math.PI) / 180;
  if (turn > 0) over.yaw = [-turn, turn, Math.min(steps, 13)];
  return { as_job, over, objective, every };
}

/** A task's button, sentence and choices. */
export class Form {
  /**
   * @param {Task} task
   * @param {(options: Record<string, any>) => void} start
   */
  constructor(task, start) {
    this.task = task;
    /** @type {Map<string, HTMLInputElement | HTMLSelectElement>} */
    this.inputs = new Map();
    this.button = make("button", { type: "submit", text: task.title });
    const fields = task.fields.map((x) => this.field(x));
    const rows = [make("div", { class: "task-head" }, [this.button, make("p", { class: "quiet", text: task.what })])];
    if (fields.length) rows.push(make("div", { class: "task-fields" }, fields));
    this.element = make("form", { class: "task", "data-task": task.task, "aria-label": task.title }, rows);
    this.element.addEventListener("submit", (event) => {
      event.preventDefault();
      start(task.options(this.values(), this.sliders));
    });
    this.known = "";
    /** Whether the button had the focus when a task began. */
    this.wasFocused = false;
    /** @type {any[]} */
    this.sliders = [];
  }

  /**
   * @param {Field} field
   * @returns {HTMLElement}
   */
  field(field) {
    const { name, label, kind, value, choices = [], min, max, unit } = field;
    const input = kind === "choice"
      ? make("select", { name }, choices.map(([key, text]) => make("option", { value: key, text })))
      : make("input", { name, type: kind === "tick" ? "checkbox" : kind, min, max, step: "any", size: 8 });
    if (kind === "tick") /** @type {HTMLInputElement} */ (input).checked = Boolean(value);
    else input.value = String(value);
    this.inputs.set(name, input);
    const words = kind === "tick" ? [input, ` ${label}`] : [`${label} `, input, unit ? ` ${unit}` : ""];
    return make("label", { class: "field" }, words);
  }

  /** What was entered. @returns {Record<string, any>} */
  values() {
    const found = /** @type {Record<string, any>} */ ({});
    for (const { name, kind } of this.task.fields) {
      const input = /** @type {HTMLInputElement} */ (this.inputs.get(name));
      if (kind === "tick") found[name] = input.checked && !input.disabled;
      else found[name] = kind === "number" ? Number(input.value) : input.value.trim();
    }
    return found;
  }

  /** @param {{open: boolean, busy: boolean, sliders: any[], placement: boolean, logs: boolean}} state */
  renew({ open, busy, sliders, placement, logs }) {
    this.element.hidden = !logs && ON_LOGS.includes(this.task.task);
    // The focus comes back to the button, unless it has gone elsewhere meanwhile.
    this.wasFocused ||= document.activeElement === this.button;
    this.button.disabled = !open || busy;
    if (!this.button.disabled && this.wasFocused) {
      if (document.activeElement === document.body) this.button.focus({ preventScroll: true });
      this.wasFocused = false;
    }
    this.button.title = busy ? "One task at a time: wait, or cancel it" : "";
    this.sliders = sliders;
    if (this.task.task === "place") this.setAsJob(placement);
    if (this.task.task === "sweep") this.setKeys(sliders.filter((x) => !x.choices && x.min < x.max).map((x) => [x.key, x.label]));
  }

  /** Whether the job itself says what to do; then other choices are off. @param {boolean} known */
  setAsJob(known) {
    const tick = /** @type {HTMLInputElement} */ (this.inputs.get("as_job"));
    tick.disabled = !known;
    tick.closest("label")?.toggleAttribute("hidden", !known);
    for (const [name, input] of this.inputs) if (name !== "as_job") input.disabled = known && tick.checked;
    tick.onchange = () => this.setAsJob(!tick.disabled);
  }

  /** @param {[string, string][]} keys and their labels */
  setKeys(keys) {
    const known = JSON.stringify(keys);
    if (known === this.known) return;
    this.known = known;
    const input = /** @type {HTMLSelectElement} */ (this.inputs.get("key"));
    const chosen = input.value;
    input.replaceChildren(...keys.map(([value, text]) => make("option", { value, text })));
    if (keys.some(([value]) => value === chosen)) input.value = chosen;
  }
}
