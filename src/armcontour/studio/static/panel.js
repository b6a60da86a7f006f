// The sliders: one row per quantity that the server lists, in groups. Text is sent as it is written; the
// server reads units and refuses what makes no sense.

import { find, make, say } from "./dom.js";
import { isPlain, quantity, withUnit } from "./format.js";
import { Ghost } from "./ghost.js";
import { Gesture } from "./gesture.js";
import { positionOf, STEPS, valueAt } from "./scales.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./scales.js").Slider} Slider */

/** Groups of the server in this order, with their titles. @type {Record<string, string>} */
const GROUPS = {
  path: "Speed and corners",
  joints: "Joint limits",
  servo: "Servo and set-points",
  run: "Run",
  part: "Part",
};
/** Where a value is written: a mark beside it, and a sentence. @type {Record<string, [string, string]>} */
const FROM = {
  job: ["", "Written for all runs of the job"],
  run: ["run", "Written for this run alone"],
  arm: ["arm", "Of the arm; not written in the job"],
  default: ["", "The default; not written in the job"],
};

/** The joint at the end of a key. */
const OF_JOINT = /\.\d+$/;
const GAIN = "A compensation makes up for the gains: to see what they do, choose none as Compensation.";
/** What quantities and choices mean, by key. @type {Record<string, string>} */
const MEANING = {
  "corners.shape": "sharp: corners as drawn; arc: rounded by arcs; free: the fastest path within the tolerance.",
  "servo.kp": GAIN,
  "servo.kv": GAIN,
  "servo.ki": GAIN,
  "compensation.method": "How set-points make up for what the servo does to the motion; none: they are those of the plan.",
};

/** One row: name, text, slider. */
class Row {
  /** @param {Slider} slider @param {Link} link @param {Ghost} ghost */
  constructor(slider, link, ghost) {
    this.slider = slider;
    this.link = link;
    /** @type {Gesture | null} */
    this.gesture = null;
    /** Text that the document gave, or that was sent. */
    this.known = "";
    const id = `slider-${slider.key.replace(/[^\w]/g, "-")}`;
    this.text = make("input", { id, type: "text", autocomplete: "off", spellcheck: "false" });
    this.range = make("input", { type: "range", min: 0, max: STEPS, "aria-label": `${slider.label}, slider` });
    this.select = make("select", { id: `${id}-choice`, "aria-label": slider.label, hidden: true });
    this.from = make("span", { class: "from" });
    this.unset = make("button", {
      type: "button",
      class: "unset",
      text: "↺",
      title: "Leave it out of the file again",
      "aria-label": `Leave ${slider.label} out of the file again`,
      onclick: () => link.edit([{ do: "unset", key: this.slider.key }]),
    });
    this.element = make("div", { class: "slider", "data-key": slider.key }, [
      make("label", { for: id, text: sentenceCase(slider.label) }),
      this.from,
      this.unset,
      this.text,
      this.select,
      this.range,
    ]);
    this.listen(ghost);
    this.show(slider);
  }

  /** @param {Ghost} ghost */
  listen(ghost) {
    this.range.addEventListener("input", (event) => this.slide(event));
    this.range.addEventListener("change", () => this.endGesture());
    this.text.addEventListener("change", () => {
      this.known = this.text.value;
      this.set(this.text.value.trim());
    });
    this.text.addEventListener("keydown", (event) => {
      if (event.key !== "Escape") return;
      this.text.value = this.written;
      this.text.select();
    });
    this.select.addEventListener("change", () => this.set(this.select.value));
    this.element.addEventListener("pointerenter", () => ghost.wish(this.slider, this.element));
    this.element.addEventListener("pointerleave", () => ghost.leave());
    this.range.addEventListener("pointerdown", () => ghost.hold(true));
    for (const event of ["pointerup", "pointercancel", "lostpointercapture"])
      this.range.addEventListener(event, () => {
        ghost.hold(false);
        if (this.element.matches(":hover")) ghost.wish(this.slider, this.element);
      });
  }

  /** @param {Event} event */
  slide(event) {
    this.gesture ??= new Gesture(this.link);
    const value = valueAt(this.slider, Number(this.range.value));
    const text = quantity(value, this.slider);
    this.text.value = text;
    this.range.setAttribute("aria-valuetext", text);
    this.gesture.update([{ do: "set", key: this.slider.key, value }], event.timeStamp);
  }

  endGesture() {
    this.gesture?.end();
    this.gesture = null;
  }

  /** As typed; nothing, or "none", lifts a quantity. @param {string} text */
  set(text) {
    if (text === this.written) return;
    const { key, choices, unit } = this.slider;
    const lifts = !choices && (text === "" || text === "none");
    const value = lifts ? null : choices ? text : withUnit(text, this.written, unit);
    this.link.edit([{ do: "set", key, value }]);
  }

  get written() {
    const { written, value, from } = this.slider;
    // What nobody wrote has as many digits as a computer gives.
    if (typeof value === "number" && (from === "arm" || from === "default")) return quantity(value, this.slider);
    if (written !== null && written !== undefined && written !== "") return String(written);
    return typeof value === "number" ? quantity(value, this.slider) : String(value ?? "none");
  }

  /** The document's value, unless it is being changed. @param {Slider} slider */
  show(slider) {
    this.slider = slider;
    const { value, choices, from, min, max } = slider;
    const numeric = typeof min === "number" && typeof max === "number" && min < max;
    this.text.hidden = Boolean(choices);
    this.select.hidden = !choices;
    this.range.hidden = Boolean(choices) || !numeric;
    this.unset.hidden = Boolean(choices) || (from !== "job" && from !== "run");
    const [mark, title] = FROM[from] ?? [from ?? "", ""];
    // A plain number of the file stays one; its unit is told beside it.
    say(this.from, [isPlain(this.written) ? slider.unit : "", mark].filter(Boolean).join(" · "));
    this.element.dataset.from = from;
    this.text.title = this.select.title = [MEANING[slider.key.replace(OF_JOINT, "")], title].filter(Boolean).join(" ");
    if (choices) this.showChoices(choices, value);
    if (this.gesture) return;
    // What somebody is typing stays; what was sent is shown as the document has it.
    const typing = document.activeElement === this.text && this.text.value !== this.known;
    if (!typing) this.text.value = this.known = this.written;
    this.range.value = String(typeof value === "number" && numeric ? positionOf(slider, value) : STEPS);
    this.range.setAttribute("aria-valuetext", this.written);
  }

  /** @param {(string | number)[]} choices @param {any} value */
  showChoices(choices, value) {
    const wanted = choices.map(String);
    if (wanted.join() !== [...this.select.options].map((o) => o.value).join())
      this.select.replaceChildren(...wanted.map((x) => make("option", { value: x, text: x.replaceAll("_", " ") })));
    this.select.value = String(value);
  }
}

/** @param {string} text */
const sentenceCase = (text) => text.charAt(0).toUpperCase() + text.slice(1);

class Panel {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    this.ghost = new Ghost(store, link);
    this.region = find("#panel");
    /** @type {Map<string, Row>} */
    this.rows = new Map();
    /** @type {Map<string, HTMLElement>} */
    this.groups = new Map();
    store.on("document", (/** @type {any} */ frame) => this.show(frame.head.sliders ?? []));
  }

  /** @param {Slider[]} sliders */
  show(sliders) {
    const keys = new Set(sliders.map((s) => s.key));
    for (const [key, row] of this.rows) {
      if (keys.has(key)) continue;
      row.element.remove();
      this.rows.delete(key);
    }
    const order = new Set([...Object.keys(GROUPS), ...sliders.map((s) => s.group)]);
    const wanted = [...order].filter((name) => sliders.some((s) => s.group === name)).map((name) => this.group(name));
    // What is put elsewhere loses the focus: that is done only where the order is another one.
    const there = [...this.region.children].filter((x) => wanted.includes(/** @type {HTMLElement} */ (x)));
    if (wanted.some((group, k) => group !== there[k])) this.region.append(...wanted);
    for (const slider of sliders) this.showOne(slider);
    for (const [name, group] of this.groups) group.hidden = !sliders.some((s) => s.group === name);
  }

  /** @param {Slider} slider */
  showOne(slider) {
    const row = this.rows.get(slider.key);
    if (row) return row.show(slider);
    const fresh = new Row(slider, this.link, this.ghost);
    this.rows.set(slider.key, fresh);
    this.group(slider.group).append(fresh.element);
  }

  /** @param {string} name @returns {HTMLElement} */
  group(name) {
    let found = this.groups.get(name);
    if (!found) {
      found = make("details", { class: "group", open: true }, [make("summary", { text: GROUPS[name] ?? name })]);
      this.groups.set(name, found);
    }
    return found;
  }
}

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  new Panel(store, link);
}
