// Verdict and its figures: contour error, cycle time, clearance, saturation.

import { styleOf, verdictOf } from "./colours.js";
import { Changes } from "./components.js";
import { find, make, mark, say } from "./dom.js";
import { fixed, NONE, textOf } from "./format.js";
import { largest, timeOf } from "./polylines.js";
import { nowAndThen, oncePerFrame, READING } from "./state.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {{name: string, label: string, value: any, text: string, unit: string, note?: string}} Row As Python says it. */
/** @typedef {Record<"box" | "label" | "value" | "unit" | "note", HTMLElement>} Box */

const SPOKEN_EVERY = 1000; // ms
const MOST_ADVISED = 2;
/** Limits with smaller shares of the time have no name next to the bar [%]. */
const LEAST = 1;
/** Names of figures in their order. */
const FIGURES = ["kept", "off_drawing", "duration", "clearance.low", "contour_error.rms", "saturated"];
/** From which values on a figure is an alarm. @type {Record<string, (value: any) => boolean>} */
const ALARMS = {
  saturated: (share) => share > 0,
  "clearance.low": (low) => low <= 0,
};

/** Figures that show their place: the time of the largest error, and of the nearest pair. @type {Record<string, ((store: Store) => number | undefined) | undefined>} */
const PLACES = {
  off_drawing: (store) => {
    const { t, error } = store.latest("executed")?.arrays ?? {};
    return t?.[error.indexOf(largest(error))];
  },
  "clearance.low": (store) => headOf(store).nearest?.t,
};

class Figures {
  /** @param {Store} store @param {import("./connection.js").Link} link */
  constructor(store, link) {
    this.store = store;
    this.region = find("#figures");
    this.row = make("div", { class: "row" });
    /** @type {Record<string, Box>} */
    this.boxes = Object.fromEntries(FIGURES.map((name) => [name, this.box(name)]));
    this.state = make("span", { class: "exactness" });
    this.boxes.duration.label.after(this.state);
    this.shares = make("div", { class: "figure shares", hidden: true });
    this.boxes.duration.box.after(this.shares);
    const advice = make("div", { class: "figure advice", hidden: true });
    this.row.append(advice);
    this.region.append(this.row);
    /** Changes of the shown job; null while they are searched, none before. @param {any[] | null} [changes] */
    const advise = (changes) => {
      const press = () => /** @type {HTMLFormElement} */ (find("#tasks form[data-task=changes]")).requestSubmit();
      const state = changes === null ? "Searching for savings …" : changes && "No change saves time";
      render(
        changes?.length
          ? html`<${Changes} brief changes=${changes.slice(0, MOST_ADVISED)} link=${link} />`
          : html`<span class="label">Faster</span>${state ? html`<span>${state}</span>` : html`<button type="button" title="Computes what changes of speed, order or tolerance save" onClick=${press}>Find savings</button>`}`,
        advice,
      );
    };
    advise();
    store.on("advice", advise);
    let rev = -1;
    store.on("document", (/** @type {any} */ frame) => {
      if (frame.rev !== rev) advise();
      rev = frame.rev;
    });
    this.spoken = "";
    /** Exact cycle times: of the newest state, and of the one before. @type {{rev: number | undefined, row: Row} | undefined} */
    this.last = undefined;
    /** @type {Row | undefined} */
    this.before = undefined;
    store.on("reset", () => (this.last = this.before = undefined));
    const showEverything = () => {
      this.showAll(FIGURES);
      this.showShares();
      advice.hidden = !hasMotion(store);
    };
    const update = oncePerFrame(showEverything);
    for (const event of ["figures", "refusal", "document", "link", "theme"]) store.on(event, update);
    const others = nowAndThen(READING, showEverything);
    store.on("executed", others);
    // The cycle time is shown with each picture.
    store.on("picture", () => {
      this.showAll(["duration"]);
      others();
    });
    setInterval(() => this.speak(), SPOKEN_EVERY);
  }

  /** @param {string} name @returns {Box} */
  box(name) {
    const [label, unit, note] = ["", "unit", "note"].map((x) => make("span", { class: x }));
    const value = make("span", { class: "value", text: NONE });
    const place = PLACES[name];
    const box = make(place ? "button" : "div", { class: "figure", "data-figure": name, hidden: name !== "duration", ...(place && { type: "button", title: "Show its place" }) }, [
      make("span", { class: "label" }, [label]),
      make("span", { class: "number" }, [value, unit]),
      note,
    ]);
    if (place) box.addEventListener("click", () => this.store.setTime(place(this.store) ?? this.store.time));
    this.row.append(box);
    return { box, label, value, unit, note };
  }

  /** @param {string[]} names */
  showAll(names) {
    const { exact, rows } = knownOf(this.store);
    for (const name of names) this.show(name, rows.get(name), exact);
    this.updateState();
  }

  /** Where the time goes: a bar of the limits, and the largest in words. */
  showShares() {
    const kinds = /** @type {{kind: string, share: string}[]} */ (headOf(this.store).kinds ?? []);
    this.shares.hidden = !kinds.length;
    const look = (/** @type {string} */ kind) => styleOf(kind, this.store.theme);
    const told = kinds.map(({ kind, share }) => `${look(kind).label} ${share}`);
    const large = kinds.filter(({ share }) => parseFloat(share) >= LEAST);
    render(
      html`<span class="label">Where the time goes</span>
        <span class="bar" aria-hidden="true">${kinds.map(({ kind, share }) => html`<span style=${`flex-grow: ${parseFloat(share)}; background: ${look(kind).colour}`} />`)}</span>
        <span class="note" title=${told.join(", ")}>${large.map(({ kind, share }) => html`<button type="button" title="Show where that is longest" onClick=${() => this.showLimit(kind)}><span class="key" style=${`background: ${look(kind).colour}`} />${look(kind).label} ${fixed(parseFloat(share), 0)} %</button>`)}</span>`,
      this.shares,
    );
  }

  /** @param {string} kind of a limit */
  showLimit(kind) {
    const picture = this.store.latest("picture");
    const { rapid_t: times, rapid_breaks: breaks } = picture?.arrays ?? {};
    const t = picture && (timeOf(picture, kind) ?? (breaks && (times[breaks[0]] + times[breaks[1] - 1]) / 2));
    if (t !== null && t !== undefined) this.store.setTime(t);
  }

  /** Accuracy of the figures. */
  updateState() {
    const { store } = this;
    this.region.classList.toggle("stale", store.refusal?.head.tier === 1);
    const exact = !store.isOffline && store.isCurrent(store.latest("figures"));
    say(this.state, exactnessOf(store));
    mark(this.state, "title", exact ? "As `armcontour run` of this job gives it" : "Exact figures follow when nothing changes");
    mark(this.region, "data-exact", String(exact));
  }

  /** @param {string} name @param {Row | undefined} row @param {boolean} isExact */
  show(name, row, isExact) {
    const { box, label, value, unit, note } = this.boxes[name];
    box.classList.toggle("alarm", row !== undefined && Boolean(ALARMS[name]?.(row.value)));
    mark(box, "data-value", row === undefined ? "" : String(row.value));
    mark(box, "data-exact", String(isExact && !this.store.isOffline));
    const looks = name === "kept" && row ? verdictOf(row.value, this.store.theme) : null;
    box.style.color = looks?.colour ?? "";
    const isRefused = name === "kept" && this.store.refusal?.head.tier === 1;
    if (isRefused) box.style.color = "var(--refusal)";
    say(value, isRefused ? "✗ refused" : looks ? `${looks.mark} ${row?.text}` : (row?.text ?? NONE));
    // A figure that is not known for a moment leaves its place.
    if (!row) return;
    box.hidden = false;
    const { accuracy } = this.store.document?.data ?? {};
    say(label, row.label);
    say(unit, name === "off_drawing" && typeof accuracy === "string" ? `${row.unit} of ${accuracy}` : row.unit);
    say(note, name === "duration" ? this.was(row, isExact) : (row.note ?? ""));
    mark(note, "title", row.note ?? "");
  }

  /** The cycle time before the last change. @param {Row} row @param {boolean} isExact @returns {string} */
  was(row, isExact) {
    const rev = this.store.latest("figures")?.rev;
    if (isExact && rev !== this.last?.rev) [this.before, this.last] = [this.last?.row, { rev, row }];
    const old = isExact ? this.before : this.last?.row;
    return old && old.text !== row.text ? `was ${textOf(old)}` : "";
  }

  /** The cycle time for screen readers, at most once a second, when it rests. */
  speak() {
    const { rows } = knownOf(this.store);
    const told = ["kept", "off_drawing", "duration"].map((name) => rows.get(name)).filter((x) => x !== undefined);
    const sentence = this.store.refusal?.head.sentence ?? told.map((x) => `${x.label} ${x.text} ${x.unit}`).join(", ");
    if (sentence === this.spoken) return;
    this.spoken = sentence;
    say(find("#spoken"), sentence);
  }
}

/**
 * What is known of the shown motion: exact figures where they belong to the picture, else those of the preview.
 * @param {Store} store @returns {{exact: boolean, executed: any, rows: Map<string, Row>}}
 */
export function knownOf(store) {
  const figures = store.latest("figures");
  const exact = store.isCurrent(figures);
  const executed = store.refusal ? null : store.latest("executed")?.head;
  const known = exact ? [figures?.head] : [store.latest("picture")?.head, executed];
  return { exact, executed, rows: new Map(known.flatMap((head) => head?.rows ?? []).map((row) => [row.name, row])) };
}

/** What is known of where the time goes: exact where that belongs to the picture. @param {Store} store @returns {any} */
export function headOf(store) {
  const figures = store.latest("figures");
  return (store.isCurrent(figures) ? figures : store.latest("picture"))?.head ?? {};
}

/** True if a motion is shown, be it the last good one. @param {Store} store @returns {boolean} */
export function hasMotion(store) {
  const picture = store.latest("picture");
  return picture !== null && picture.head.tier !== "outline";
}

/** Accuracy of the figures in one word. @param {Store} store @returns {string} */
function exactnessOf(store) {
  if (store.isOffline) return "not connected";
  if (store.refusal?.head.tier === 1) return hasMotion(store) ? "refused, the last" : "refused";
  if (!hasMotion(store)) return "not planned yet";
  return store.isCurrent(store.latest("figures")) ? "exact" : "preview";
}

/** @param {Store} store @param {import("./connection.js").Link} link */
export function init(store, link) {
  new Figures(store, link);
}
