// Tasks by button: certificate, export, report, logs; and their results.

import { verdictOf } from "./colours.js";
import { find, give, say } from "./dom.js";
import { known } from "./form.js";
import { whole } from "./format.js";
import { init as hear, logOptions, Logs, logs } from "./logs.js";
import { Changes, Tabular } from "./components.js";
import { touchOptions, TouchTable } from "./touches.js";
import { html, render, signal, useComputed, useSignal } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./connection.js").Link} Link */
/**
 * One choice of a task; text and numbers by default. Texts are quantities with a unit, which the server reads.
 * @typedef {{name: string, label: string, value?: string | number, choices?: [string, string][], min?: number,
 *   max?: number, unit?: string}} Choice
 */
/** @typedef {{task: string, title: string, what: string, onLogs?: boolean, table?: any, choices?: Choice[], options?: (values: Record<string, any>) => object}} Task */
/**
 * Result of a task.
 * @typedef {{id: string, task: string, title: string, time: string, state: "running" | "done" | "refused" | "cancelled" | "failed",
 *   text?: string, progress?: {steps: string[], share: number | null, eta: number | null}, frame?: Frame, sentence?: string}} Result
 */
/** A file that the server stores for a while; `open` is an address at which a browser shows it. @typedef {{file: string, name: string, bytes: number, open?: string, label?: string}} Kept */

/** A table as Python gives it; the first row has the columns. @typedef {{title: string, cells: string[][]}} Table */

/** Maximum numbers: kept results, shown table rows, letters per figure. */
const [MAX_RESULTS, MAX_ROWS, LONG] = [12, 200, 24];

const formats = signal(/** @type {[string, string, number | null][]} */ ([]));
/** Joints of the arm, whether the server is connected, and the text of the job. */
const [joints, isOpen, newest] = [signal(0), signal(false), signal("")];
/** Tasks whose results apply to the job at that time. */
const OF_JOB = new Set(["certify", "export", "changes", "report", "learn", "measure"]);
/** Result whose change was sent last: a measured frame also applies to the job that has it. */
let used = "";
/** Results, the newest first. */
const results = signal(/** @type {Result[]} */ ([]));

/** All tasks, in the order of their buttons. @returns {Task[]} */
const tasks = () => [
  {
    task: "certify", title: "Certify", what: "Finds the fastest plan whose execution is proved to keep the tolerance.",
    choices: [{ name: "tolerance", label: "tolerance", value: "", min: 0, unit: "mm, or as in the job" }],
    options: ({ tolerance }) => (tolerance > 0 ? { tolerance: tolerance / 1000 } : {}),
  },
  {
    task: "export", title: "Export", what: "Set-points for a robot controller, or tables.",
    choices: [
      { name: "format", label: "format", choices: formats.value.filter((x) => [null, joints.value].includes(x[2])).map(([name, label]) => [name, label]) },
      { name: "of", label: "of", choices: [["set_points", "the set-points"], ["planned", "the plan"], ...(logs().length ? [/** @type {[string, string]} */ (["learned", "the next set-points, by logs"])] : [])] },
    ],
    options: ({ format, of }) => ({ format, of, ...(of === "learned" && logOptions()) }),
  },
  { task: "changes", title: "Improve", what: "Finds changes that save time, or that make the run keep its accuracy." },
  { task: "report", title: "Report", what: "The page with all figures, to keep and to print." },
  {
    task: "measure", title: "Measure", table: TouchTable, options: ({ noise }) => ({ ...touchOptions(), noise }),
    what: "Finds where the part is: joint positions at points that the tool touched, with the coordinates of the points in the drawing. Without coordinates: the origin, a point on the x axis, and one on the side of the y axis. Tables can be pasted.",
  },
  { task: "identify", title: "Identify", what: "Finds kp, kv and the dead time of your robot's servo from the logs.", onLogs: true, options: logOptions },
  { task: "learn", title: "Learn", what: "Corrects the set-points of the next run by the errors of this one.", onLogs: true, options: logOptions },
];

/** A task's button, sentence and choices. @param {Task & {start: (task: Task, options: object) => void}} props */
function Form({ start, ...task }) {
  const { title, what, table, choices = [], options = () => ({}) } = task;
  const isBusy = useComputed(() => !isOpen.value || results.value.some((x) => x.state === "running"));
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
    <div class="task-head"><button type="submit" aria-disabled=${String(isBusy.value)} title=${isBusy.value ? "One task at a time: wait, or cancel it" : ""}>${title}</button><p class="quiet">${what}</p></div>
    ${choices.length > 0 && html`<div class="task-fields">${choices.map(choice)}</div>`}
    ${table && html`<${table} />`}
  </form>`;
}

/** @param {{result: Result, store: Store, link: Link}} props */
function Outcome({ result: { id, task, title, time, state, progress, frame, sentence, text }, store, link }) {
  const { steps = [], share, eta } = progress ?? {};
  const { sentence: said = sentence, rows = [], tables = [], changes = [], notes = [], warnings = [], file } = frame?.head ?? {};
  const isOutdated = state !== "running" && OF_JOB.has(task) && text !== newest.value;
  const step = progress ? `${steps.join(", ")}${eta ? `, about ${Math.ceil(eta)} s left` : ""}` : "Starting";
  return html`<article class="task-result" data-task=${task} data-id=${id} data-state=${state} data-share=${share ?? ""} data-outdated=${String(isOutdated)}>
    <h3>${title} <span class="quiet">${time}</span></h3>
    ${state === "running" && html`<div class="task-progress"><progress key=${typeof share} max="1" value=${share ?? undefined} aria-label=${`${title}: progress`} /><span class="quiet">${step}</span>
      <button type="button" onClick=${() => link.send({ op: "cancel", id })}>Cancel</button></div>`}
    <div class="task-body">
      ${isOutdated && html`<p class="outdated">Outdated: the job has changed since. ${title} again for the job as it is now.</p>`}
      ${rows.length > 0 && html`<${Tiles} rows=${rows} theme=${store.theme} />`}
      ${said && html`<p class="task-sentence">${said}</p>`}
      ${changes.length > 0 && !isOutdated && html`<p class="task-file"><${Changes} changes=${changes} link=${link} taken=${() => (used = task === "measure" ? id : "")} /></p>`}
      ${file && html`<${Download} file=${frame?.head} link=${link} />`}
      ${tables.map((/** @type {Table} */ { title: of, cells: [columns, ...all] }) => all.length > 0 && html`<div class="task-table" tabindex="0" role="group" aria-label=${of}>
        <table><caption>${of}</caption><${Tabular} columns=${columns} rows=${all.slice(0, MAX_ROWS)} /></table>
        ${all.length > MAX_ROWS && html`<p class="quiet">And ${all.length - MAX_ROWS} more rows.</p>`}</div>`)}
      ${[...notes, ...warnings].map((text) => html`<p>${text}</p>`)}
    </div>
  </article>`;
}

/** Figures; long ones as text. @param {{rows: any[], theme: "light" | "dark"}} props */
const Tiles = ({ rows, theme }) => html`<dl class="tiles">${rows.map(({ name, label, value, text, unit, note }) => {
  const { colour = "", mark = "" } = name === "kept" ? verdictOf(value, theme) : {};
  return html`<div class=${text.length > LONG ? "long" : ""}><dt>${label}</dt> <dd style=${`color: ${colour}`}>${mark} ${unit ? whole(text) : text} <small>${unit}</small></dd> ${note && html`<dd class="quiet">${note}</dd>`}</div>`;
})}</dl>`;

/** A file to download or, if possible, to open. @param {{file: Kept, link: Link}} props */
function Download({ file: { file, name, bytes, open, label = `Download ${name}` }, link }) {
  const said = useSignal("");
  const size = `${Math.max(1, Math.round(bytes / 1000))} kB`;
  const download = async () => {
    try {
      const answer = await link.request(`/files/${encodeURIComponent(file)}`);
      if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
      give(await answer.blob(), name);
      said.value = "Downloaded.";
    } catch (error) {
      said.value = `It could not be downloaded: ${error instanceof Error ? error.message : error}. Start the task again.`;
    }
  };
  return html`<p class="task-file"><button type="button" title=${size} data-file=${name} onClick=${download}>${label}</button>
    ${open && html`<a href=${open} target="_blank" rel="noopener" class="button">Open</a>`}<span class="quiet">${size}</span><span class="quiet" role="status">${said}</span></p>`;
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
    if (old.task === "changes" && old.text === store.document?.text) store.tell("advice", more.frame?.head.changes);
    if (results.value.every((x) => x.state !== "running")) say(find("#spoken"), region.querySelector(".task-sentence, .tiles")?.textContent ?? "");
  };
  const tell = () => (region.dataset.running = results.value.filter((x) => x.state === "running").map((x) => x.id).join(" "));
  /** @param {Task} task @param {object} options */
  const start = ({ task, title }, options) => {
    // Several pages may start tasks at the same time.
    const id = `t${crypto.randomUUID().slice(0, 8)}`;
    const time = new Date().toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
    const isSent = link.send({ op: "task", id, task, options }) >= 0;
    const how = /** @type {Partial<Result>} */ (isSent ? { state: "running" } : { state: "failed", sentence: "There is no connection to the server." });
    results.value = /** @type {Result[]} */ ([{ id, task, title, time, text: store.document?.text, ...how }, ...results.value].slice(0, MAX_RESULTS));
    tell();
    if (isSent && task === "changes") store.tell("advice", null);
    // In a narrow page the results are below the forms.
    requestAnimationFrame(() => region.querySelector(".task-result")?.scrollIntoView({ block: "nearest" }));
  };
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
    joints.value = store.latest("arm")?.head.joints.length ?? 0;
    newest.value = store.document?.text ?? "";
    const text = newest.value;
    if (used && results.value.some((x) => x.id === used && x.text !== text)) {
      results.value = results.value.map((x) => (x.id === used ? { ...x, text } : x));
      used = "";
    }
    isOpen.value = link.state.state === "open" && store.document !== null;
    if (!isOpen.value) for (const { id } of results.value) renew(id, { state: "failed", sentence: "The connection was lost, and this work with it." });
  };
  for (const event of ["document", "arm", "link"]) store.on(event, update);
  update();
  known.then((form) => (formats.value = form.formats));
  hear(store);
  render(html`<${Page} store=${store} link=${link} start=${start} />`, region);
}

/** @param {{store: Store, link: Link, start: (task: Task, options: object) => void}} props */
const Page = ({ start, ...more }) => html`<div class="task-list" role="group" aria-label="Tasks">${tasks().map((x) => html`${x.task === "identify" && html`<${Logs} ...${more} />`}${(!x.onLogs || logs().length > 0) && html`<${Form} key=${x.task} ...${x} start=${start} />`}`)}</div>
  <div class="task-results" role="log" aria-label="Results">${results.value.map((x) => html`<${Outcome} key=${x.id} result=${x} ...${more} />`)}
    ${!results.value.length && html`<p class="quiet">Results of tasks appear here: sentences, tables, and files to download.</p>`}</div>`;
