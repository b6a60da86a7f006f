// The figures on top: verdict, cycle time, errors, saturation, clearance.

import { find, make, mark, say } from "./dom.js";
import { NONE } from "./format.js";
import { nowAndThen, oncePerFrame, READING } from "./state.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {{name: string, label: string, value: any, text: string, unit: string, note?: string}} Row As Python says it. */
/** @typedef {{box: HTMLElement, label: HTMLElement, value: HTMLElement, unit: HTMLElement}} Box */

const SPOKEN_EVERY = 1000; // ms
/** Explanations of figures by their names, in their order. @type {Record<string, string>} */
const FIGURES = {
  off_drawing: "Largest distance of the executed tool from the drawing: rounding of corners and servo",
  kept: "Whether corners and contour error are within what the job allows",
  duration: "Duration of the planned motion",
  "contour_error.rms": "Of the executed tool from the path, simulated with the servo",
  "contour_error.max": "Of the executed tool from the path, simulated with the servo",
  demand_ratio: "Largest share of a joint's limit that the executed motion takes",
  saturated: "Joints whose drives saturate in the execution",
  "clearance.low": "Proven least distance to obstacles and of the arm to itself",
  settled: "When the tool stays at its goal",
};
/** From which values on a figure is an alarm. @type {Record<string, (value: any) => boolean>} */
const ALARMS = {
  kept: (kept) => !kept,
  demand_ratio: (share) => share > 1.0005,
  saturated: (share) => share > 0,
  "clearance.low": (low) => low <= 0,
};

class Figures {
  /** @param {Store} store */
  constructor(store) {
    this.store = store;
    this.region = find("#figures");
    /** @type {Record<string, Box>} */
    this.boxes = Object.fromEntries(Object.keys(FIGURES).map((name) => [name, this.box(name)]));
    this.state = make("span", { class: "exactness" });
    this.boxes.duration.label.after(this.state);
    this.spoken = "";
    const update = oncePerFrame(() => this.update());
    for (const event of ["figures", "refusal", "document", "link"]) store.on(event, update);
    const others = nowAndThen(READING, () => this.update());
    store.on("executed", others);
    store.on("picture", () => {
      this.updateFirst();
      others();
    });
    setInterval(() => this.speak(), SPOKEN_EVERY);
  }

  /** @param {string} name @returns {Box} */
  box(name) {
    const [label, value, unit] = [make("span"), make("span", { class: "value", text: NONE }), make("span", { class: "unit" })];
    const box = make("div", { class: "figure", "data-figure": name, hidden: name !== "duration" }, [
      make("span", { class: "label" }, [label]),
      make("span", { class: "number" }, [value, unit]),
    ]);
    this.region.append(box);
    return { box, label, value, unit };
  }

  update() {
    const { exact, rows } = knownOf(this.store);
    for (const name of Object.keys(FIGURES)) this.show(name, rows.get(name), exact);
    this.updateState();
  }

  /** The cycle time, with each picture. */
  updateFirst() {
    const { exact, rows } = knownOf(this.store);
    this.show("duration", rows.get("duration"), exact);
    this.updateState();
  }

  /** How true the figures are. */
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
    const { box, label, value, unit } = this.boxes[name];
    box.classList.toggle("alarm", row !== undefined && Boolean(ALARMS[name]?.(row.value)));
    mark(box, "data-value", row === undefined ? "" : String(row.value));
    mark(box, "data-exact", String(isExact && !this.store.isOffline));
    say(value, row?.text ?? NONE);
    // A figure that is not known for a moment leaves its place.
    if (!row) return;
    box.hidden = false;
    say(label, row.label);
    say(unit, row.unit);
    mark(box, "title", [FIGURES[name], row.note].filter(Boolean).join(": "));
  }

  /** The cycle time for screen readers, at most once a second, when it rests. */
  speak() {
    const { rows } = knownOf(this.store);
    const told = ["duration", "contour_error.rms"].map((name) => rows.get(name)).filter((x) => x !== undefined);
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

/** Whether a motion is shown, be it the last good one. @param {Store} store @returns {boolean} */
export function hasMotion(store) {
  const picture = store.latest("picture");
  return picture !== null && picture.head.tier !== "outline";
}

/** How true the figures are, in a word. @param {Store} store @returns {string} */
export function exactnessOf(store) {
  if (store.isOffline) return "not connected";
  if (store.refusal?.head.tier === 1) return hasMotion(store) ? "refused, the last" : "refused";
  if (!hasMotion(store)) return "not planned yet";
  return store.isCurrent(store.latest("figures")) ? "exact" : "preview";
}

/** @param {Store} store */
export function init(store) {
  new Figures(store);
}
