// Results of tasks: figures, sentences, tables and files; when and of what they were made, and what has changed since.

import { CertifiedPlan } from "./certified.js";
import { Changes, Tabular } from "./components.js";
import { verdictOf } from "./colours.js";
import { find, give } from "./dom.js";
import { html, render, signal, useSignal } from "./vendor/preact.js";
import { shownRow, shownText } from "./units.js";
import { whole } from "./format.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./connection.js").Link} Link */
/**
 * Result of a task; `options` are those with which it was started, and `isOwn` says that this page started it.
 * @typedef {{id: string, task: string, title: string, time: string, options: object,
 *   state: "running" | "done" | "refused" | "cancelled" | "failed",
 *   isOwn: boolean, made?: Made,
 *   progress?: {steps: string[], share: number | null, eta: number | null}, frame?: Frame, sentence?: string}} Result
 */
/** A file that the server stores for a while; `open` is an address at which a browser shows it. @typedef {{file: string, name: string, bytes: number, open?: string, label?: string}} Kept */
/** A table as Python gives it; the first row has the columns. @typedef {{title: string, cells: string[][]}} Table */
/** When and of what a result was made. @typedef {{time: string, job: string, run: string, files: string}} Made */

/** Maximum numbers: kept results, shown table rows, letters per figure, listed changes. */
const [MAX_RESULTS, MAX_ROWS, LONG, MAX_CHANGES] = [12, 200, 24, 4];
/** Tasks whose results apply to the job at that time. */
const OF_JOB = new Set(["certify", "export", "changes", "report", "learn", "measure"]);

/** Results, the newest first. */
export const results = signal(/** @type {Result[]} */ ([]));
/** What has changed since results were made, by their identifier; without those that are up to date. */
const outdated = signal(/** @type {Record<string, string[]>} */ ({}));

/** Add a result. @param {Result} result */
export const addResult = (result) => (results.value = [result, ...results.value].slice(0, MAX_RESULTS));

/** Return what has changed since a result was made; empty if it is up to date. @param {Result} result @returns {string[]} */
const changesSince = ({ id, task, state }) => (state !== "running" && OF_JOB.has(task) ? (outdated.value[id] ?? []) : []);

/** Return when and of what a result was made. @param {Made} made @returns {string} */
export const madeText = ({ time, job, run, files }) => `${time}, job ${job}, run ${run}. SHA-256: ${files}`;

/** @param {{result: Result, store: Store, link: Link, start: import("./certified.js").Start}} props */
export function Outcome({ result, store, link, start }) {
  const { id, task, title, time, state, progress, frame, sentence } = result;
  const { steps = [], share, eta } = progress ?? {};
  const { sentence: said = sentence, rows = [], tables = [], changes = [], notes = [], warnings = [], file, made = result.made } = frame?.head ?? {};
  const since = changesSince(result);
  const isOutdated = since.length > 0;
  const step = progress ? `${steps.join(", ")}${eta ? `, about ${Math.ceil(eta)} s left` : ""}` : "Starting";
  return html`<article class="task-result" data-task=${task} data-id=${id} data-state=${state} data-share=${share ?? ""} data-outdated=${String(isOutdated)}>
    <h3>${title} ${isOutdated && html`<span class="chip">outdated</span>`}</h3>
    <p class="quiet made">${made ? madeText(made) : time}</p>
    ${state === "running" && html`<div class="task-progress"><progress key=${typeof share} max="1" value=${share ?? undefined} aria-label=${`${title}: progress`} /><span class="quiet">${step}</span>
      <button type="button" onClick=${() => link.send({ op: "cancel", id })}>Cancel</button></div>`}
    <div class="task-body">
      ${isOutdated && html`<div class="outdated"><p>Since then: ${shownText(listed(since))}.</p> <button type="button" onClick=${() => start(result, result.options)}>Make again</button></div>`}
      ${rows.length > 0 && html`<${Tiles} rows=${rows} theme=${store.theme} />`}
      ${said && html`<p class="task-sentence">${shownText(said)}</p>`}
      ${changes.length > 0 && !isOutdated && html`<p class="task-file"><${Changes} changes=${changes} link=${link} result=${task === "measure" ? id : undefined} /></p>`}
      ${frame?.head.has_plan && html`<${CertifiedPlan} id=${id} isOutdated=${isOutdated} link=${link} start=${start} />`}
      ${file && html`<${Download} file=${frame?.head} link=${link} />`}
      ${tables.map((/** @type {Table} */ { title: of, cells: [columns, ...all] }) => all.length > 0 && html`<div class="task-table" tabindex="0" role="group" aria-label=${of}>
        <table><caption>${of}</caption><${Tabular} columns=${columns} rows=${all.slice(0, MAX_ROWS).map((cells) => cells.map(shownText))} /></table>
        ${all.length > MAX_ROWS && html`<p class="quiet">And ${all.length - MAX_ROWS} more rows.</p>`}</div>`)}
      ${[...notes, ...warnings].map((text) => html`<p>${shownText(text)}</p>`)}
    </div>
  </article>`;
}

/** Join changes in one sentence. @param {string[]} changes @returns {string} */
function listed(changes) {
  const more = changes.length - MAX_CHANGES;
  return [...changes.slice(0, MAX_CHANGES), ...(more > 0 ? [`${more} more`] : [])].join(", ");
}

/** Figures; long ones as text. @param {{rows: any[], theme: "light" | "dark"}} props */
const Tiles = ({ rows, theme }) => html`<dl class="tiles">${rows.map((row) => {
  const { name, label, value, text, unit, note } = shownRow(row);
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

/** Mark the buttons of the top bar whose newest result is outdated. @param {Store} store */
export function markOutdated(store) {
  const update = () => {
    for (const button of /** @type {NodeListOf<HTMLElement>} */ (document.querySelectorAll("#bar [data-opens]"))) {
      const newest = results.value.find((x) => x.task === button.dataset.opens && x.frame);
      const since = newest ? changesSince(newest) : [];
      render(since.length ? html`<span class="chip" title=${`Since then: ${listed(since)}`}>outdated</span>` : null, find(".state", button));
    }
  };
  store.on("document", (/** @type {Frame} */ { head }) => {
    outdated.value = head.outdated ?? {};
    update();
  });
  results.subscribe(update);
}
