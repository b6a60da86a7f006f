// Verdict and its figures: contour error, cycle time, clearance, saturation.

import { styleOf, verdictOf } from "./colours.js";
import { Changes } from "./components.js";
import { find, say } from "./dom.js";
import { difference, fixed, NONE, whole } from "./format.js";
import { worstTime } from "./motion.js";
import { timeOf } from "./polylines.js";
import { nowAndThen, oncePerFrame, READING } from "./state.js";
import { inches, shownRow, shownText } from "./units.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {{name: string, label: string, value: any, text: string, unit: string, note?: string}} Row As Python says it. */
/** @typedef {Map<string, Row>} Rows */

const SPOKEN_EVERY = 1000; // ms
const MOST_ADVISED = 2;
/** The timing method that knows which limit is active. */
const OPTIMAL = "optimal";
/** A limit with a smaller share of the time has no name next to the bar [%]. */
const LEAST = 1;
/** Figures in display order; the duration of a run is between them. */
const [FIRST, LAST] = [["kept", "off_drawing", "duration"], ["obstacle", "own_links", "clearance.low", "unknown_gains.max", "contour_error.rms", "saturated"]];
/** Names of figures that are shown before their values are known, or for a refused job. @type {Record<string, string>} */
const NAMES = { kept: "verdict", duration: "motion" };
/** For each figure, whether a value is an alarm. @type {Record<string, (value: any) => boolean>} */
const ALARMS = { saturated: (share) => share > 0, "clearance.low": (low) => low <= 0, obstacle: (low) => low <= 0, own_links: (low) => low <= 0 };
/** Figures that can show their place in the motion: the times of the largest error and the nearest pair. @type {Record<string, ((store: Store) => number | undefined) | undefined>} */
const PLACES = {
  off_drawing: worstTime,
  kept: (store) => store.refusal?.head.at?.t,
  "clearance.low": (store) => headOf(store).nearest?.t,
  obstacle: (store) => headOf(store).obstacle_t,
  own_links: (store) => headOf(store).own_links_t,
};
/** Last exact figures of a run, and those before the change of the job that led to them, in the units of the server; and the keys that applied to the run. @typedef {{rev: number, rows: Rows, values: Record<string, string>, before: {rev: number, rows: Rows, values: Record<string, string>} | null}} Past */
/** Past figures by the name of the run. @type {Map<string, Past>} */
const past = new Map();

/** Return the past figures of the chosen run. @param {Store} store @returns {Past | undefined} */
export const pastOf = (store) => past.get(store.document?.run);

/** @param {Store} store */
function remember(store) {
  const figures = store.latest("figures");
  const last = pastOf(store);
  // The figures of a certified plan are not those of the run.
  if (!figures || store.certificate || !store.isCurrent(figures) || figures.rev === last?.rev) return;
  const before = last ? { rev: last.rev, rows: last.rows, values: last.values } : null;
  past.set(figures.head.run, { rev: figures.rev, rows: rowsOf(store).rows, values: store.document.run_values, before });
}

/**
 * Return the last exact figures of the chosen run before the present state of the job, its keys, and how many changes of the job came
 * since; null if there are none. Of a change that the next one follows soon, no exact figures are known.
 * @param {Store} store @returns {{rows: Rows, values: Record<string, string>, changes: number} | null}
 */
export function stateBefore(store) {
  const last = pastOf(store);
  const { rev } = store.document;
  const before = last && last.rev !== rev ? last : last?.before;
  return before ? { rows: before.rows, values: before.values, changes: rev - before.rev } : null;
}

/** A figure; while its value is unknown, its place stays empty. @param {{name: string, row?: Row, seen?: Row, store: Store, exact: boolean}} props */
function Figure({ name, row, seen, store, exact }) {
  const place = name === "kept" && PLACES.kept?.(store) === undefined ? undefined : PLACES[name];
  const isRefused = name === "kept" && store.refusal !== null;
  const refused = store.refusal?.head.error === "Collision" ? "✗ COLLISION" : "✗ refused";
  let looks = { colour: "", mark: "" };
  if (name === "kept") looks = row && exact ? verdictOf(row.value, store.theme) : { colour: "var(--quiet)", mark: "" };
  const isChecking = !store.isOffline && (hasMotion(store) || store.latest("executed") !== null);
  const { accuracy } = store.document?.data ?? {};
  const limit = name === "off_drawing" && typeof accuracy === "string" ? shownText(accuracy) : "";
  const isRepeated = Boolean(row?.unit) && limit.endsWith(` ${row?.unit}`);
  const last = name === "duration" ? (exact ? pastOf(store)?.before?.rows : pastOf(store)?.rows)?.get(name) : undefined;
  const old = last && shownRow(last);
  const gain = old && row && old.text !== row.text ? [difference(row, old), `was ${whole(old.text)} ${old.unit}`].filter(Boolean).join(", ") : "";
  const text = row?.unit ? whole(row.text) : row?.text;
  const content = html`<span class="label"><span>${seen?.label ?? NAMES[name]}</span>${name === "duration" && html`<span class="exactness" title=${exact ? "As `armcontour run` of this job gives it" : "Exact figures follow when nothing changes"}>${exactnessOf(store)}</span>`}</span>
    <span class="number"><span class="value">${isRefused ? refused : `${looks.mark} ${text ?? (name === "kept" && isChecking ? "checking" : NONE)}`.trim()}</span><span class="unit"><span class=${isRepeated ? "repeated" : ""}>${row?.unit}</span>${limit && html`<span class="of"> of ${limit}</span>`}${exact && html`<${Margin} name=${name} store=${store} />`}</span></span>
    <span class=${gain ? `note ${row?.value > old?.value ? "worse" : "better"}` : "note"} title=${row?.note}>${gain || row?.note}</span>`;
  const shared = {
    class: `figure ${row && ALARMS[name]?.(row.value) ? "alarm" : ""}`, "data-figure": name, "data-value": row ? String(row.value) : "", "data-exact": String(exact),
    hidden: !seen && !NAMES[name], style: `color: ${isRefused ? "var(--refusal)" : looks.colour}`,
  };
  if (!place) return html`<div ...${shared}>${content}</div>`;
  const t = place(store);
  const title = t === undefined ? "Its place follows with the figures of this plan" : "Show its place";
  return html`<button type="button" title=${title} aria-disabled=${String(t === undefined)} onClick=${() => store.goTo(place(store) ?? store.time)} ...${shared}>${content}</button>`;
}

/** The least allowed distance of a clearance. @param {{name: string, store: Store}} props */
function Margin({ name, store }) {
  const margin = headOf(store).margins?.[name];
  if (margin === undefined) return null;
  return html`<span class="of margin">${margin ? ` of at least ${shownText(margin)}` : ", without a least distance"}</span>`;
}

/** Time per limit: a bar, and the largest ones in words. @param {{store: Store}} props */
function Shares({ store }) {
  const kinds = /** @type {{kind: string, share: string}[]} */ (headOf(store).kinds ?? []);
  const look = (/** @type {string} */ kind) => styleOf(kind, store.theme);
  const shares = kinds.map(({ kind, share }) => `${look(kind).label} ${share}`);
  const show = (/** @type {string} */ kind) => {
    const picture = store.latest("picture");
    const { rapid_t: times, rapid_breaks: breaks } = picture?.arrays ?? {};
    const t = picture && (timeOf(picture, kind) ?? (breaks && (times[breaks[0]] + times[breaks[1] - 1]) / 2));
    if (t !== null && t !== undefined) store.goTo(t);
  };
  const { runs = [], run } = store.document ?? {};
  const timing = runs.find((/** @type {any} */ x) => x.name === run)?.timing ?? OPTIMAL;
  if (!kinds.length && timing !== OPTIMAL && hasMotion(store))
    return html`<div class="figure shares unknown"><span class="label">Where the time goes</span>
      <span class="note">Not known with the timing ${timing}: only the timing ${OPTIMAL} tells which limit is active when.</span></div>`;
  return html`<div class="figure shares" hidden=${!kinds.length}><span class="label">Where the time goes</span>
    <span class="bar" aria-hidden="true">${kinds.map(({ kind, share }) => html`<span style=${`flex-grow: ${parseFloat(share)}; background: ${look(kind).colour}`} />`)}</span>
    <span class="note" title=${shares.join(", ")}>${kinds.filter(({ share }) => parseFloat(share) >= LEAST).map(({ kind, share }) => html`<button type="button" title="Show where that is longest" onClick=${() => show(kind)}><span class="key" style=${`background: ${look(kind).colour}`} />${look(kind).label} ${fixed(parseFloat(share), 0)} %</button>`)}</span></div>`;
}

/** Changes that save time. @param {{store: Store, link: import("./connection.js").Link, changes?: any[] | null}} props changes: null while they are searched, none before */
function Advice({ store, link, changes }) {
  const search = () => /** @type {HTMLFormElement} */ (find("#tasks form[data-task=changes]")).requestSubmit();
  const state = changes === null ? "Searching for savings …" : changes && "No change saves time";
  return html`<div class="figure advice" hidden=${!hasMotion(store)}>${changes?.length
    ? html`<${Changes} brief changes=${changes.slice(0, MOST_ADVISED)} link=${link} />`
    : html`<span class="label">Faster</span>${state ? html`<span>${state}</span>` : html`<button type="button" title="Computes what changes of speed, order or tolerance save" onClick=${search}>Find savings</button>`}`}</div>`;
}

/**
 * Return the figures of the shown motion: the exact ones if they belong to the picture, otherwise the preview's, which has
 * no verdict. Their texts are in the units of the server.
 * @param {Store} store @returns {{exact: boolean, executed: any, rows: Rows}}
 */
export function rowsOf(store) {
  const figures = store.latest("figures");
  const exact = store.isCurrent(figures);
  const executed = store.refusal ? null : store.latest("executed")?.head;
  const known = exact ? [figures?.head] : [store.latest("picture")?.head, executed];
  const rows = new Map(known.flatMap((head) => head?.rows ?? []).map((row) => [row.name, row]));
  // A preview checks no collisions, and its grid is coarse.
  if (!exact) rows.delete("kept");
  return { exact, executed, rows };
}

/** Return the figures of the shown motion as they are shown, see `rowsOf`. @param {Store} store @returns {{exact: boolean, executed: any, rows: Rows}} */
export function knownOf(store) {
  const { rows, ...more } = rowsOf(store);
  return { ...more, rows: new Map([...rows].map(([name, row]) => [name, shownRow(row)])) };
}

/** Return the time per limit: the exact one if it belongs to the picture. @param {Store} store @returns {any} */
export function headOf(store) {
  const figures = store.latest("figures");
  return (store.isCurrent(figures) ? figures : store.latest("picture"))?.head ?? {};
}

/** Return whether a motion is shown, even if it is the last valid one. @param {Store} store @returns {boolean} */
export function hasMotion(store) {
  const picture = store.latest("picture");
  return picture !== null && picture.head.tier !== "outline";
}

/** Return the accuracy of the figures in one word. @param {Store} store @returns {string} */
function exactnessOf(store) {
  if (store.isOffline) return "not connected";
  if (store.refusal?.head.tier === 1) return hasMotion(store) ? "before the refusal" : "refused";
  if (!hasMotion(store)) return "not planned yet";
  if (store.certificate) return "certified";
  return store.isCurrent(store.latest("figures")) ? "exact" : "preview";
}

/** @param {Store} store @param {import("./connection.js").Link} link */
export function init(store, link) {
  const region = find("#figures");
  /** The newest row of each figure. @type {Rows} */
  const seen = new Map();
  let changes = /** @type {any[] | null | undefined} */ (undefined);
  const update = () => {
    remember(store);
    const { exact: isCurrent, rows } = knownOf(store);
    const exact = !store.isOffline && isCurrent;
    for (const [name, row] of rows) seen.set(name, row);
    // Distances to obstacles and between own links are shown apart; without obstacles there is one distance.
    const absent = rows.has("obstacle") ? ["clearance.low"] : ["obstacle", "own_links"];
    if (exact) for (const name of absent) seen.delete(name);
    region.classList.toggle("stale", !exact);
    region.dataset.exact = String(exact);
    const figure = (/** @type {string} */ name) => html`<${Figure} key=${name} name=${name} row=${rows.get(name)} seen=${seen.get(name)} store=${store} exact=${exact} />`;
    render(html`<div class="row">${FIRST.map(figure)}<${Shares} store=${store} />${LAST.map(figure)}<${Advice} store=${store} link=${link} changes=${changes} /></div>`, region);
  };
  const soon = oncePerFrame(update);
  store.on("advice", (/** @type {any} */ found) => {
    changes = found;
    soon();
  });
  let rev = -1;
  store.on("document", (/** @type {any} */ frame) => {
    if (frame.rev !== rev) changes = undefined;
    rev = frame.rev;
  });
  store.on("reset", () => {
    past.clear();
    seen.clear();
  });
  for (const event of ["figures", "refusal", "document", "link", "theme"]) store.on(event, soon);
  for (const event of ["picture", "executed"]) store.on(event, nowAndThen(READING, update));
  inches.subscribe(soon);
  /** Tell screen readers the verdict when it no longer changes, at most once a second. */
  const speak = () => {
    const { rows } = knownOf(store);
    const main = FIRST.flatMap((name) => rows.get(name) ?? []);
    const sentence = store.refusal?.head.sentence ?? main.map((x) => `${x.label} ${x.text} ${x.unit}`).join(", ");
    if (sentence !== region.dataset.spoken) say(find("#spoken"), sentence);
    region.dataset.spoken = sentence;
  };
  setInterval(speak, SPOKEN_EVERY);
}
