// The runs of the job and the pinned variants, with differences of duration and errors to the shown run.

import { ask } from "./ask.js";
import { find, headings, make, whileSeen } from "./dom.js";
import { ERROR_DIGITS, mm, NONE, seconds, signed } from "./format.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {{duration?: number | null, rms?: number | null, max?: number | null}} Known */

const COLUMNS = [
  "(name)",
  "timing",
  "compensation",
  "corners",
  "cycle time s",
  "Δ s",
  "error RMS mm",
  "Δ mm",
  "largest mm",
  "(actions)",
];

class Runs {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    this.body = make("tbody");
    /** Figures of runs of this text, by name. @type {Map<string, Known>} */
    this.known = new Map();
    this.text = "";
    this.shown = "";
    find("#tab-runs").append(
      make("p", { class: "acts" }, [
        this.button("New run like this one", () => this.add()),
        this.button("Pin this variant", () => link.send({ op: "pin" })),
      ]),
      make("table", {}, [
        make("caption", { text: "Runs and pins", class: "unseen" }),
        make("thead", {}, [
          make(
            "tr",
            {},
            headings(COLUMNS, (k) => (k < 4 ? "words" : "")),
          ),
        ]),
        this.body,
      ]),
    );
    const events = ["document", "picture", "executed", "figures", "compare"];
    for (const event of events) store.on(event, () => this.learn());
    whileSeen(store, find("#tab-runs"), events, () => this.update());
  }

  /** @param {string} text @param {() => void} act @param {string} [label] */
  button(text, act, label) {
    return make("button", { type: "button", text, onclick: act, "aria-label": label });
  }

  update() {
    const head = this.store.document;
    if (!head) return;
    const rows = [
      ...head.runs.map((/** @type {any} */ run) => this.run(run, head)),
      ...head.pins.map((/** @type {any} */ pin) => this.pin(pin, head)),
    ];
    const shown = JSON.stringify(rows.map((row) => row.cells));
    if (shown === this.shown) return;
    this.shown = shown;
    this.body.replaceChildren(...rows.map(({ cells, acts, current }) => this.row(cells, acts, current)));
  }

  /** Figures of the shown and the compared run, where they are of this text. */
  learn() {
    const { document } = this.store;
    if (!document) return;
    if (document.text !== this.text) this.known.clear();
    this.text = document.text;
    for (const of of /** @type {("live" | "compare")[]} */ (["live", "compare"])) {
      const picture = this.store.latest("picture", of)?.head;
      if (
        !picture ||
        (of === "live" && this.store.refusal) ||
        (of === "compare" && document.compare?.run !== picture.run)
      )
        continue;
      const executed = this.store.latest("executed", of)?.head;
      const figures =
        of === "live" && this.store.isCurrent(this.store.latest("figures")) ? this.store.latest("figures")?.head : null;
      const errors = figures ?? (executed?.run === picture.run ? executed : {});
      this.known.set(picture.run, {
        duration: figures?.duration ?? picture.duration,
        rms: errors?.rms ?? null,
        max: errors?.max ?? null,
      });
    }
  }

  /** @param {any} run @param {any} head */
  run(run, head) {
    const current = run.name === head.run;
    const figures = this.known.get(run.name) ?? {};
    const words = [run.name, wordOf(run.timing), wordOf(run.compensation), wordOf(run.corners)];
    return {
      current,
      cells: [...words, ...this.numbers(figures, current, head)],
      acts: () =>
        [
          this.button("Show", () => this.link.send({ op: "select", run: run.name }), `Show run ${run.name}`),
          this.button(
            "Compare",
            () => this.link.send({ op: "compare", with: { run: run.name } }),
            `Compare with run ${run.name}`,
          ),
          this.button("Remove", () => this.link.send({ op: "remove_run", name: run.name }), `Remove run ${run.name}`),
        ].slice(current ? 2 : 0),
    };
  }

  /** @param {any} pin @param {any} head */
  pin(pin, head) {
    const to = { pin: pin.pin };
    return {
      current: false,
      cells: [pin.name, `pin of ${pin.run}`, "", "", ...this.numbers(pin, false, head)],
      acts: () => [
        this.button("Compare", () => this.link.send({ op: "compare", with: to }), `Compare with ${pin.name}`),
        this.button("Swap", () => this.link.send({ op: "swap", ...to }), `Swap: work on ${pin.name} again; can be undone`),
        this.button("To run", () => this.pinToRun(pin), `To run: make ${pin.name} a run of the job`),
        this.button("Remove", () => this.link.send({ op: "unpin", ...to }), `Remove ${pin.name}`),
      ],
    };
  }

  /** @param {Known} figures @param {boolean} current @param {any} head @returns {string[]} */
  numbers(figures, current, head) {
    const mine = this.known.get(head.run) ?? {};
    const difference = (/** @type {any} */ a, /** @type {any} */ b, /** @type {number} */ factor, digits = 3) =>
      !current && typeof a === "number" && typeof b === "number" ? signed(factor * (a - b), digits) : "";
    return [
      seconds(figures.duration),
      difference(figures.duration, mine.duration, 1),
      mm(figures.rms, ERROR_DIGITS),
      difference(figures.rms, mine.rms, 1000, ERROR_DIGITS),
      mm(figures.max, ERROR_DIGITS),
    ];
  }

  /** @param {string[]} cells @param {() => HTMLElement[]} acts @param {boolean} current */
  row(cells, acts, current) {
    const [name, ...rest] = cells;
    const numbers = rest.map((text, k) => make("td", { class: k < 3 ? "words" : "", text }));
    return make("tr", { "aria-current": current ? "true" : false }, [
      make("th", { scope: "row", text: name }),
      ...numbers,
      make("td", { class: "acts" }, acts()),
    ]);
  }

  async add() {
    const run = this.store.document.run;
    const name = await ask(`A new run like ${run}`, "Its name", `${run}-2`);
    if (name) this.link.send({ op: "add_run", name, like: run });
  }

  /** @param {any} pin */
  async pinToRun(pin) {
    const name = await ask(`${pin.name} as a run of the job`, "Its name", `${pin.run}-2`);
    if (name) this.link.send({ op: "pin_to_run", pin: pin.pin, name });
  }
}

/** A setting of a run in a word. @param {any} setting @returns {string} */
function wordOf(setting) {
  if (setting === null || setting === undefined) return NONE;
  return typeof setting === "object"
    ? String(setting.method ?? setting.shape ?? JSON.stringify(setting))
    : String(setting);
}

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  new Runs(store, link);
}
