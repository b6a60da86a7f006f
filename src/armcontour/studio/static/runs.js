// Table of runs: the keys in which they differ, and the differences in duration and errors from the shown run.

import { ask } from "./dialog.js";
import { verdictOf } from "./colours.js";
import { find, whileSeen } from "./dom.js";
import { rowsOf, stateBefore } from "./figures.js";
import { difference, NONE, textOf, timeText } from "./format.js";
import { Heads } from "./components.js";
import { inches, shownRow, shownText } from "./units.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {Map<string, import("./figures.js").Row>} Known */

const EVENTS = ["document", "picture", "executed", "figures"];
const FIGURES = ["verdict", "cycle time", "Δ", "off the drawing", "error RMS", "Δ", "largest", "(actions)"];
/** Maximum number of keys in which the runs differ that have a column. */
const MAX_KEYS = 8;
/** Task that plans runs which are not shown. */
const COMPARE = "compare";

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  const region = find("#tab-runs");
  /** Figures of runs that were shown in their present state, by name. @type {Map<string, Known>} */
  const known = new Map();
  /** State of each run's keys, by name. @type {Record<string, string>} */
  let states = {};
  let shownId = "";
  /** When the newest figure came. */
  let when = "";
  /** Why runs have no figures, by name. @type {Map<string, string>} */
  const refused = new Map();
  /** The task that plans the runs: its identifier, the states of the runs at its start, and its step. @type {{id: string, states: Record<string, string>, step: string} | null} */
  let planning = null;
  /** Keep the figures of the shown run until its keys change. */
  const learn = () => {
    const { document, refusal } = store;
    if (!document) return;
    const { id, run_states: now, run } = document;
    for (const name of [...known.keys(), ...refused.keys()]) {
      if (id === shownId && states[name] === now[name]) continue;
      known.delete(name);
      refused.delete(name);
    }
    [shownId, states] = [id, now];
    when = timeText(new Date());
    // Frames of the state or the run before, or of a certified plan, say nothing about this one.
    if (store.certificate || !store.isCurrent(store.latest("picture")) || refusal) return;
    const { exact, rows } = rowsOf(store);
    const isWhole = exact || store.isCurrent(store.latest("executed"));
    known.set(run, isWhole ? rows : new Map([...rows].filter(([name]) => name === "duration")));
  };
  const add = async () => {
    const { run } = store.document;
    const name = await ask(`A new run like ${run}`, "Its name", `${run}-2`);
    if (name) link.edit([{ do: "add_run", name }]);
  };
  /** Runs without exact figures; the shown one gets its own. @returns {string[]} */
  const unplanned = () => {
    const { runs, run } = store.document;
    return runs.map((/** @type {any} */ x) => x.name).filter((/** @type {string} */ name) => name !== run && !known.get(name)?.has("kept") && !refused.has(name));
  };
  /** Plan the runs that have no figures. */
  const plan = () => {
    const runs = store.document ? unplanned() : [];
    if (planning || !runs.length) return;
    const id = `t${crypto.randomUUID().slice(0, 8)}`;
    if (link.send({ op: "task", id, task: COMPARE, options: { runs } }) < 0) return;
    planning = { id, states: store.document.run_states, step: "" };
    update();
  };
  /** End the planning of the runs, with their figures. @param {any} head of the frame that ends it */
  const finish = ({ id, runs = [] }) => {
    if (id !== planning?.id) return;
    const { states: begun } = /** @type {NonNullable<typeof planning>} */ (planning);
    planning = null;
    for (const { run, rows, sentence } of runs) {
      // A run that was changed meanwhile has other figures.
      if (begun[run] !== store.document.run_states[run]) continue;
      if (sentence) refused.set(run, sentence);
      else known.set(run, new Map(rows.map((/** @type {any} */ row) => [row.name, row])));
    }
    update();
  };
  const verdict = (/** @type {string} */ name, /** @type {any} */ kept) => {
    if (kept) return html`<td style=${`color: ${verdictOf(kept.value, store.theme).colour}`}>${verdictOf(kept.value, store.theme).mark} ${kept.text}</td>`;
    const why = refused.get(name);
    return html`<td title=${why}>${why ? html`<span class="refused">✗ refused: ${shownText(why)}</span>` : NONE}</td>`;
  };
  const row = (/** @type {any} */ { name }, /** @type {any[]} */ keys, /** @type {Known | undefined} */ figures = known.get(name)) => {
    const { run, runs } = store.document;
    const before = stateBefore(store);
    const isPast = figures !== undefined && figures === before?.rows;
    const isShown = name === run;
    const valueOf = (/** @type {any} */ { key, values }) => (isPast ? before?.values[key] : values[name]) ?? NONE;
    const shown = (/** @type {Known | undefined} */ of, /** @type {string} */ x) => of?.get(x) && shownRow(/** @type {any} */ (of.get(x)));
    const [kept, duration, off, rms, largest] = ["kept", "duration", "off_drawing", "contour_error.rms", "contour_error.max"].map((x) => shown(figures, x));
    const delta = (/** @type {any} */ x) => (isShown ? "" : difference(x, shown(known.get(run), x?.name)));
    const act = (/** @type {string} */ title, /** @type {() => void} */ does) => html`<button type="button" aria-label=${`${title} run ${name}`} onClick=${does}>${title}</button>`;
    return html`<tr key=${name} data-run=${name} aria-current=${isShown && "true"}>
      <th scope="row">${name}</th>${keys.map((x) => html`<td class="words">${shownText(valueOf(x))}</td>`)}
      ${verdict(name, kept)}
      ${[textOf(duration), delta(duration), textOf(off), textOf(rms), delta(rms), textOf(largest)].map((x) => html`<td>${x}</td>`)}
      <td class="acts">${!isShown && !isPast && act("Show", () => link.send({ op: "select", run: name }))}${runs.length > 1 && !isPast && act("Remove", () => link.edit([{ do: "unset", key: ["runs", name] }]))}</td>
    </tr>`;
  };
  for (const event of EVENTS) store.on(event, learn);
  store.on("progress", (/** @type {any} */ { head }) => {
    if (!planning || head.id !== planning.id) return;
    planning.step = head.steps.join(", ");
    update();
  });
  for (const event of ["result", "failed", "cancelled"]) store.on(event, (/** @type {any} */ { head }) => finish(head));
  // A new connection has no tasks of the one before.
  store.on("link", (/** @type {any} */ { state }) => state !== "open" && planning && finish({ id: planning.id }));
  for (const button of document.querySelectorAll("#bar [data-opens=runs]")) button.addEventListener("click", plan);
  const draw = () => {
    if (!store.document) return;
    const { name: job, hash, run, runs, run_keys: all } = store.document;
    const before = stateBefore(store);
    const changes = before?.changes === 1 ? "change" : `${before?.changes} changes`;
    const keys = all.slice(0, MAX_KEYS);
    // The last name of a key is enough, unless another key has it as well.
    const lastOf = (/** @type {string} */ key) => key.split(".").at(-1) ?? key;
    const called = (/** @type {any} */ { key }) => (keys.filter((/** @type {any} */ x) => lastOf(x.key) === lastOf(key)).length > 1 ? key : lastOf(key)).replaceAll("_", " ");
    const missing = unplanned();
    const work = planning
      ? html`<span role="status">Planning the runs${planning.step && `: ${planning.step}`} …</span> <button type="button" onClick=${() => link.send({ op: "cancel", id: planning?.id })}>Cancel</button>`
      : missing.length > 0 && html`<button type="button" onClick=${plan}>Plan ${missing.length === 1 ? `run ${missing[0]}` : `the ${missing.length} runs without figures`}</button>`;
    const same = runs.length > 1 && !all.length ? "All runs have the same keys. " : all.length > MAX_KEYS ? `The runs differ in ${all.length} keys; the first ${MAX_KEYS} have a column. ` : "";
    render(html`<p class="acts"><button type="button" onClick=${add}>New run like this one</button> ${work}
        <span class="quiet made">${same}${when}, job ${job}, SHA-256 ${hash}. Figures of an earlier state of the job are left out.</span></p>
        <table><caption class="unseen">Runs</caption><${Heads} names=${["(name)", ...keys.map(called), ...FIGURES]} words=${keys.length + 1} /><tbody>${runs.map((/** @type {any} */ x) => row(x, keys))}${before && row({ name: `${run}, before the last ${changes}` }, keys, before.rows)}</tbody></table>`, region);
  };
  const update = whileSeen(store, region, EVENTS, draw);
  inches.subscribe(update);
}
