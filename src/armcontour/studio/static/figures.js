// The figures on top: cycle time, errors, saturation, clearance.

import { find, make, mark, say } from "./dom.js";
import { ERROR_DIGITS, mm, NONE, percent, seconds } from "./format.js";
import { nowAndThen, oncePerFrame, READING } from "./state.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {{value: number | null, text: string, exact: boolean, alarm?: boolean, title?: string}} Shown */

const SPOKEN_EVERY = 1000; // ms
/** Figures by name: label, unit, explanation. @type {Record<string, [string, string, string]>} */
const FIGURES = {
  duration: ["Cycle time", "s", "Duration of the planned motion"],
  rms: ["Contour error RMS", "mm", "Of the executed tool from the path, simulated with the servo"],
  max: ["Largest error", "mm", "Of the executed tool from the path, simulated with the servo"],
  demand: ["Joint demand", "%", "Largest share of a joint's limit that the executed motion takes"],
  saturated: ["Saturated", "", "Joints whose drives saturate in the execution"],
  clearance: ["Clearance", "mm", "Proven least distance to obstacles and of the arm to itself"],
  settled: ["Settled", "s", "When the tool stays at its goal"],
};

class Figures {
  /** @param {Store} store */
  constructor(store) {
    this.store = store;
    this.region = find("#figures");
    /** @type {Record<string, {box: HTMLElement, value: HTMLElement}>} */
    this.boxes = Object.fromEntries(Object.entries(FIGURES).map(([name, told]) => [name, this.box(name, ...told)]));
    this.state = make("span", { class: "exactness" });
    find(".label", this.boxes.duration.box).append(this.state);
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

  /** @param {string} name @param {string} label @param {string} unit @param {string} title */
  box(name, label, unit, title) {
    const value = make("span", { class: "value", text: NONE });
    const box = make("div", { class: "figure", "data-figure": name, title }, [
      make("span", { class: "label", text: label }),
      make("span", { class: "number" }, [value, make("span", { class: "unit", text: unit })]),
    ]);
    this.region.append(box);
    return { box, value };
  }

  update() {
    for (const [name, shown] of Object.entries(this.values())) this.show(name, shown);
    this.updateState();
  }

  /** The cycle time, with each picture. */
  updateFirst() {
    this.show("duration", this.duration());
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

  /** What is shown now: exact figures where they belong to the picture, else those of the preview. @returns {Record<string, Shown>} */
  values() {
    const { exact, executed, ...errors } = knownOf(this.store);
    const error = (/** @type {number | null} */ value) => ({ value, text: mm(value, ERROR_DIGITS), exact: Boolean(exact) });
    return {
      duration: this.duration(),
      rms: error(errors.rms),
      max: error(errors.max),
      ...this.others(exact, executed),
    };
  }

  /** @returns {Shown} */
  duration() {
    const { exact, duration } = knownOf(this.store);
    return { value: duration, text: seconds(duration), exact: Boolean(exact) };
  }

  /** @param {any} exact @param {any} executed @returns {Record<string, Shown>} */
  others(exact, executed) {
    const shares = exact?.demand ?? executed?.demand;
    const demand = shares?.length ? Math.max(...shares.map(Number)) : null;
    const joints = exact?.saturated ?? executed?.saturated ?? null;
    const low = exact?.clearance?.low ?? null;
    const settled = exact?.settled ?? executed?.settled ?? null;
    const known = joints !== null;
    return {
      demand: { value: demand, text: percent(demand), exact: Boolean(exact), alarm: demand !== null && demand > 1.0005 },
      saturated: {
        value: known ? joints.length : null,
        text: known ? (joints.length ? countOf(joints) : "none") : NONE,
        title: known ? joints.map(nameOf).join(", ") : "",
        exact: Boolean(exact),
        alarm: known && joints.length > 0,
      },
      clearance: { value: low, text: mm(low, 1), exact: Boolean(exact), alarm: low !== null && low <= 0 },
      settled: { value: settled, text: seconds(settled), exact: Boolean(exact) },
    };
  }

  /** @param {string} name @param {Shown} shown */
  show(name, { value, text, exact, alarm = false, title }) {
    const { box, value: place } = this.boxes[name];
    box.classList.toggle("alarm", alarm);
    mark(box, "data-value", value === null ? "" : String(value));
    mark(box, "data-exact", String(exact && !this.store.isOffline));
    say(place, text);
    if (title !== undefined) box.title = [FIGURES[name][2], title].filter(Boolean).join(": ");
  }

  /** The cycle time for screen readers, at most once a second, when it rests. */
  speak() {
    const { duration, rms } = this.values();
    const refusal = this.store.refusal?.head.sentence;
    const sentence =
      refusal ??
      (duration.value === null ? "" : `Cycle time ${duration.text} seconds, contour error ${rms.text} millimetres`);
    if (sentence === this.spoken) return;
    this.spoken = sentence;
    say(find("#spoken"), sentence);
  }
}

/**
 * What is known of the shown motion: exact figures where they belong to the picture, else those of the preview.
 * @param {Store} store @returns {{exact: any, executed: any, duration: number | null, rms: number | null, max: number | null}}
 */
export function knownOf(store) {
  const figures = store.latest("figures");
  const exact = store.isCurrent(figures) ? figures?.head : null;
  const executed = store.refusal ? null : store.latest("executed")?.head;
  const duration = exact?.duration ?? store.latest("picture")?.head.duration ?? null;
  const error = (/** @type {string} */ name) => exact?.[name] ?? executed?.[name] ?? null;
  return { exact, executed, duration, rms: error("rms"), max: error("max") };
}

/** Whether a motion is shown, be it the last good one. @param {Store} store @returns {boolean} */
export function hasMotion(store) {
  const picture = store.latest("picture");
  return picture !== null && picture.head.planned !== false;
}

/** How true the figures are, in a word. @param {Store} store @returns {string} */
export function exactnessOf(store) {
  if (store.isOffline) return "not connected";
  if (store.refusal?.head.tier === 1) return hasMotion(store) ? "refused, the last" : "refused";
  if (store.latest("picture")?.head.planned !== true && !hasMotion(store)) return "not planned yet";
  return store.isCurrent(store.latest("figures")) ? "exact" : "preview";
}

/** @param {any[]} joints */
const countOf = (joints) => `${joints.length} joint${joints.length > 1 ? "s" : ""}`;

/** A joint that saturates, with the time for which it does. @param {any} joint @returns {string} */
const nameOf = (joint) => `${joint.joint ?? joint}${joint.time ? ` for ${seconds(joint.time)} s` : ""}`;

/** @param {Store} store */
export function init(store) {
  new Figures(store);
}
