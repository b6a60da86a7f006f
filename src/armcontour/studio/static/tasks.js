// Tasks by button: certificate, export, report, logs. Their results are in results.js.

import { CERTIFIED_EXPORT, formats, init as showCertified } from "./certified.js";
import { find, mark, say } from "./dom.js";
import { known } from "./form.js";
import { timeText } from "./format.js";
import { lengthUnit } from "./length_unit.js";
import { init as hear, logOptions, Logs, logs } from "./logs.js";
import { addResult, markOutdated, Outcome, results } from "./results.js";
import { touchOptions, TouchTable } from "./touches.js";
import { html, render, signal, useComputed } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./connection.js").Link} Link */
/**
 * One choice of a task; text and numbers by default. Texts are quantities with a unit, which the server reads.
 * @typedef {{name: string, label: string, value?: string | number, choices?: [string, string][], min?: number,
 *   max?: number, unit?: string}} Choice
 */
/** @typedef {{task: string, title: string, what: string, onLogs?: boolean, table?: any, choices?: Choice[], options?: (values: Record<string, any>) => object}} Task */
/** @typedef {import("./results.js").Result} Result */

/** Formats of exports, with the number of joints that each needs. @type {[string, string, number | null, boolean][]} */
let allFormats = [];
/** Whether the server is connected. */
const isOpen = signal(false);

/** All tasks, in the order of their buttons. @returns {Task[]} */
const tasks = () => [
  {
    task: "certify", title: "Certify", what: "Finds the fastest plan whose execution is proved to keep the tolerance.",
    choices: [{ name: "tolerance", label: "tolerance", value: "", min: 0, unit: `${lengthUnit().unit}, or as in the job` }],
    options: ({ tolerance }) => (tolerance > 0 ? { tolerance: tolerance * lengthUnit().factor } : {}),
  },
  {
    task: "export", title: "Export", what: "Set-points for a robot controller, or tables.",
    choices: [
      { name: "format", label: "format", choices: formats.value.map(({ name, label }) => [name, label]) },
      { name: "of", label: "of", choices: [["set_points", "the set-points"], ["planned", "the plan"], ...(logs().length ? [/** @type {[string, string]} */ (["learned", "the next set-points, by logs"])] : [])] },
    ],
    // A controller that plans the motion between the points gets the plan.
    options: ({ format, of }) => (formats.value.some((x) => x.name === format && x.keepsTimes) ? { format, of, ...(of === "learned" && logOptions()) } : { format, of: "planned" }),
  },
  { task: "changes", title: "Improve", what: "Finds changes that save time, or that make the run keep its accuracy." },
  { task: "report", title: "Report", what: "The page with all figures, to keep and to print." },
  {
    task: "measure", title: "Measure", table: TouchTable, options: ({ noise, accept }) => ({ ...touchOptions(), noise, accept }),
    what: "Finds where the part is: joint positions at points that the tool touched, with the coordinates of the points in the drawing. Without coordinates: the origin, a point on the x axis, and one on the side of the y axis. Tables can be pasted.",
  },
  { task: "identify", title: "Identify", what: "Finds kp, kv and the dead time of your robot's servo from the logs.", onLogs: true, options: logOptions },
  { task: "learn", title: "Learn", what: "Corrects the set-points of the next run by the errors of this one.", onLogs: true, options: logOptions },
];

/** Return the task that runs. @returns {Result | undefined} */
const running = () => results.value.find((x) => x.state === "running");

/** Return why no task can be started now; empty if one can. @returns {string} */
function whyBusy() {
  const now = running();
  if (!isOpen.value) return "There is no connection to the server.";
  return now ? `${now.title} is running, and tasks run one at a time: wait, or cancel it.` : "";
}

/** A task's button, sentence and choices. @param {Task & {start: (task: Task, options: object) => void}} props */
function Form({ start, ...task }) {
  const { title, what, table, choices = [], options = () => ({}) } = task;
  const isBusy = useComputed(() => !isOpen.value || running() !== undefined);
  const submit = (/** @type {any} */ event) => {
    event.preventDefault();
    if (isBusy.value) return;
    const numbers = new Set(choices.filter((x) => !x.choices).map((x) => x.name));
    const entries = [...new FormData(event.target)].map(([name, x]) => [name, numbers.has(name) ? Number(x) : x]);
    start(task, options(Object.fromEntries(entries)));
  };
  const choice = (/** @type {Choice} */ { name, label, value = "", choices, unit, ...more }) => {
    if (choices) return html`<label class="field">${label} <select name=${name}>${choices.map(([key, text]) => html`<option value=${key}>${text}</option>`)}</select></label>`;
    return html`<label class="field">${label} <input type="number" name=${name} defaultValue=${value} step="any" size="8" ...${more} />${unit && ` ${unit}`}</label>`;
  };
  // A disabled button keeps the focus.
  return html`<form class="task" data-task=${task.task} aria-label=${title} onSubmit=${submit}>
    <div class="task-head"><button type="submit" aria-disabled=${String(isBusy.value)} title=${whyBusy()}>${title}</button><p class="quiet">${what}</p></div>
    ${choices.length > 0 && html`<div class="task-fields">${choices.map(choice)}</div>`}
    ${table && html`<${table} />`}
  </form>`;
}

/** Fill the region of the tasks. @param {Store} store @param {Link} link */
export function init(store, link) {
  const region = find("#tasks");
  /** @param {string} id @param {Partial<Result>} more */
  const renew = (id, more) => {
    const old = results.value.find((x) => x.id === id);
    if (!old || old.state !== "running") return;
    results.value = results.value.map((x) => (x === old ? { ...x, ...more } : x));
    if (more.progress) return;
    tell();
    if (old.task === "changes" && !store.document?.outdated[id]) store.tell("advice", more.frame?.head.changes);
    if (old.isOwn && results.value.every((x) => x.state !== "running")) say(find("#spoken"), region.querySelector(".task-sentence, .tiles")?.textContent ?? "");
  };
  const tell = () => {
    region.dataset.running = results.value.filter((x) => x.state === "running").map((x) => x.id).join(" ");
    markBusy();
  };
  /** @param {{task: string, title: string}} task @param {object} options */
  const start = ({ task, title }, options) => {
    // Several pages may start tasks at the same time.
    const id = `t${crypto.randomUUID().slice(0, 8)}`;
    const time = timeText(new Date());
    const isSent = link.send({ op: "task", id, task, options }) >= 0;
    const how = /** @type {Partial<Result>} */ (isSent ? { state: "running" } : { state: "failed", sentence: "There is no connection to the server." });
    addResult(/** @type {Result} */ ({ id, task, title, time, options, isOwn: true, ...how }));
    tell();
    if (isSent && task === "changes") store.tell("advice", null);
    // In a narrow page the results are below the forms.
    requestAnimationFrame(() => region.querySelector(".task-result")?.scrollIntoView({ block: "nearest" }));
  };
  /** Add a task that another page has started, or this one before it was loaded again. @param {Frame} frame */
  const join = ({ head: { id, task, options, made } }) => {
    const known = results.value.find((x) => x.id === id);
    if (known?.state === "running" || known?.frame) return;
    const title = options.certificate ? CERTIFIED_EXPORT : tasks().find((x) => x.task === task)?.title;
    results.value = results.value.filter((x) => x !== known);
    addResult(/** @type {Result} */ ({ id, task, title, time: made.time, made, options, isOwn: false, state: "running" }));
    tell();
  };
  store.on("started", join);
  store.on("progress", (/** @type {Frame} */ { head }) => renew(head.id, { progress: /** @type {any} */ (head) }));
  store.on("result", (/** @type {Frame} */ frame) => {
    const { id, kept } = frame.head;
    renew(id, { state: kept === false ? "refused" : "done", frame });
  });
  store.on("cancelled", (/** @type {Frame} */ x) => renew(x.head.id, { state: "cancelled", sentence: "Cancelled." }));
  store.on("failed", (/** @type {Frame} */ x) => renew(x.head.id, { state: "failed", sentence: x.head.sentence }));
  store.on("reset", () => {
    results.value = [];
    tell();
  });
  const update = () => {
    const joints = store.latest("arm")?.head.joints.length ?? 0;
    formats.value = allFormats.filter((x) => [null, joints].includes(x[2])).map(([name, label, , keepsTimes]) => ({ name, label, keepsTimes }));
    isOpen.value = link.state.state === "open" && store.document !== null;
    if (!isOpen.value) for (const { id } of results.value) renew(id, { state: "failed", sentence: "The connection was lost, and this work with it." });
  };
  for (const event of ["document", "arm", "link"]) store.on(event, update);
  update();
  known.then((form) => {
    allFormats = form.formats;
    update();
  });
  showCertified(store, link, start);
  hear(store);
  markOutdated(store);
  render(html`<${Page} store=${store} link=${link} start=${start} />`, region);
}

/** The buttons of the top bar that start a task, with their usual titles. @type {Map<HTMLElement, string>} */
const barButtons = new Map();

/** Grey the buttons of the top bar while a task runs, and say why. */
function markBusy() {
  for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("#bar [data-opens]:not([data-opens=runs])"))) {
    if (!barButtons.has(button)) barButtons.set(button, button.title);
    mark(button, "aria-disabled", String(running() !== undefined));
    button.title = whyBusy() || (barButtons.get(button) ?? "");
  }
}

/** The task that runs, and that the others wait for it. @param {{link: Link}} props */
function Waiting({ link }) {
  const now = running();
  if (!now) return null;
  return html`<p class="task-wait" role="status">${whyBusy()} <button type="button" onClick=${() => link.send({ op: "cancel", id: now.id })}>Cancel ${now.title.toLowerCase()}</button></p>`;
}

/** @param {{store: Store, link: Link, start: import("./certified.js").Start}} props */
const Page = ({ start, ...more }) => html`<div class="task-list" role="group" aria-label="Tasks"><${Waiting} ...${more} />${tasks().map((x) => html`${x.task === "identify" && html`<${Logs} ...${more} />`}${(!x.onLogs || logs().length > 0) && html`<${Form} key=${x.task} ...${x} start=${start} />`}`)}</div>
  <div class="task-results" role="log" aria-label="Results">${results.value.map((x) => html`<${Outcome} key=${x.id} result=${x} start=${start} ...${more} />`)}
    ${!results.value.length && html`<p class="quiet">Results of tasks appear here: sentences, tables, and files to download.</p>`}</div>`;
