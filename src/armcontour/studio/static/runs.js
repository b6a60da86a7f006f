// Table of runs, with the differences in duration and errors from the shown run.

import { ask } from "./dialog.js";
import { verdictOf } from "./colours.js";
import { find, whileSeen } from "./dom.js";
import { knownOf, pastOf } from "./figures.js";
import { difference, NONE, textOf, timeText } from "./format.js";
import { Heads } from "./components.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** @typedef {Map<string, import("./figures.js").Row>} Known */

const EVENTS = ["document", "picture", "executed", "figures"];
const COLUMNS = ["(name)", "timing", "compensation", "corners", "verdict", "cycle time", "Δ", "off the drawing", "error RMS", "Δ", "largest", "(actions)"];

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
  /** Keep the figures of the shown run until its keys change. */
  const learn = () => {
    const { document, refusal } = store;
    if (!document) return;
    const { id, run_states: now, run } = document;
    for (const name of known.keys()) if (id !== shownId || states[name] !== now[name]) known.delete(name);
    [shownId, states] = [id, now];
    when = timeText(new Date());
    // Frames of the state or the run before, or of a certified plan, say nothing about this one.
    if (store.certificate || !store.isCurrent(store.latest("picture")) || refusal) return;
    const { exact, rows } = knownOf(store);
    const isWhole = exact || store.isCurrent(store.latest("executed"));
    known.set(run, isWhole ? rows : new Map([...rows].filter(([name]) => name === "duration")));
  };
  const add = async () => {
    const { run } = store.document;
    const name = await ask(`A new run like ${run}`, "Its name", `${run}-2`);
    if (name) link.edit([{ do: "add_run", name }]);
  };
  const row = (/** @type {any} */ { name, timing, compensation, corners }, /** @type {Known | undefined} */ figures = known.get(name)) => {
    const { run, runs } = store.document;
    const isPast = figures !== undefined && figures === pastOf(store)?.before;
    const isShown = name === run;
    const [kept, duration, off, rms, largest] = ["kept", "duration", "off_drawing", "contour_error.rms", "contour_error.max"].map((x) => figures?.get(x));
    const delta = (/** @type {any} */ x) => (isShown ? "" : difference(x, known.get(run)?.get(x?.name)));
    const act = (/** @type {string} */ title, /** @type {() => void} */ does) => html`<button type="button" aria-label=${`${title} run ${name}`} onClick=${does}>${title}</button>`;
    return html`<tr key=${name} aria-current=${isShown && "true"}>
      <th scope="row">${name}</th>${[timing, compensation, corners].map((x) => html`<td class="words">${x}</td>`)}
      <td style=${kept && `color: ${verdictOf(kept.value, store.theme).colour}`}>${kept ? `${verdictOf(kept.value, store.theme).mark} ${kept.text}` : NONE}</td>
      ${[textOf(duration), delta(duration), textOf(off), textOf(rms), delta(rms), textOf(largest)].map((x) => html`<td>${x}</td>`)}
      <td class="acts">${!isShown && !isPast && act("Show", () => link.send({ op: "select", run: name }))}${runs.length > 1 && !isPast && act("Remove", () => link.edit([{ do: "unset", key: ["runs", name] }]))}</td>
    </tr>`;
  };
  for (const event of EVENTS) store.on(event, learn);
  whileSeen(store, region, EVENTS, () => {
    if (!store.document) return;
    const { name: job, hash, run } = store.document;
    const before = pastOf(store)?.before;
    render(html`<p class="acts"><button type="button" onClick=${add}>New run like this one</button>
        <span class="quiet made">${when}, job ${job}, SHA-256 ${hash}. Figures of an earlier state of the job are left out.</span></p>
        <table><caption class="unseen">Runs</caption><${Heads} names=${COLUMNS} words=${4} /><tbody>${store.document.runs.map((/** @type {any} */ run) => row(run))}${before && row({ name: `${run}, before the last change` }, before)}</tbody></table>`, region);
  });
}
