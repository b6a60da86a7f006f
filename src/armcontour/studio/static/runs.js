// The runs of the job in a table, with differences of duration and errors to the shown run.

import { ask } from "./ask.js";
import { find, headings, make, whileSeen } from "./dom.js";
import { knownOf } from "./figures.js";
import { difference, textOf } from "./format.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {Map<string, import("./figures.js").Row>} Known */

const EVENTS = ["document", "picture", "executed", "figures"];
const COLUMNS = [
  "(name)",
  "timing",
  "compensation",
  "corners",
  "cycle time",
  "Δ",
  "error RMS",
  "Δ",
  "largest",
  "(actions)",
];

class Runs {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    this.body = make("tbody");
    /** Figures of the runs that were shown with this text, by name. @type {Map<string, Known>} */
    this.known = new Map();
    this.text = "";
    this.shown = "";
    const head = headings(COLUMNS, (k) => (k < 4 ? "words" : ""));
    find("#tab-runs").append(
      make("p", { class: "acts" }, [this.button("New run like this one", () => this.add())]),
      make("table", {}, [
        make("caption", { text: "Runs", class: "unseen" }),
        make("thead", {}, [make("tr", {}, head)]),
        this.body,
      ]),
    );
    for (const event of EVENTS) store.on(event, () => this.learn());
    whileSeen(store, find("#tab-runs"), EVENTS, () => this.update());
  }

  /** @param {string} text @param {() => void} act @param {string} [label] */
  button(text, act, label) {
    return make("button", { type: "button", text, onclick: act, "aria-label": label });
  }

  update() {
    const head = this.store.document;
    if (!head) return;
    const rows = head.runs.map((/** @type {any} */ run) => this.cells(run, head.run));
    const shown = JSON.stringify([head.run, rows]);
    if (shown === this.shown) return;
    this.shown = shown;
    this.body.replaceChildren(...rows.map((/** @type {string[]} */ cells) => this.row(cells, head.run)));
  }

  /** Keep the figures of the shown run until the text changes. */
  learn() {
    const { document, refusal } = this.store;
    if (!document) return;
    if (document.text !== this.text) this.known.clear();
    this.text = document.text;
    const run = this.store.latest("picture")?.head.run;
    if (run === undefined || refusal) return;
    const { exact, executed, rows } = knownOf(this.store);
    const isWhole = exact || executed?.run === run;
    this.known.set(run, isWhole ? rows : new Map([...rows].filter(([name]) => name === "duration")));
  }

  /** @param {any} run @param {string} current @returns {string[]} */
  cells({ name, timing, compensation, corners }, current) {
    const [its, mine] = [name, current].map((x) => this.known.get(x));
    const [duration, rms, largest] = ["duration", "contour_error.rms", "contour_error.max"].map((x) => its?.get(x));
    const delta = (/** @type {any} */ row) => (name === current ? "" : difference(row, mine?.get(row?.name)));
    return [
      ...[name, timing, compensation, corners],
      ...[textOf(duration), delta(duration), textOf(rms), delta(rms), textOf(largest)],
    ];
  }

  /** @param {string[]} cells @param {string} current */
  row([name, ...rest], current) {
    const act = (/** @type {string} */ text, /** @type {string} */ op, /** @type {object} */ more) =>
      this.button(text, () => this.link.send({ op, ...more }), `${text} run ${name}`);
    const acts = [
      ...(name === current ? [] : [act("Show", "select", { run: name })]),
      ...(this.store.document.runs.length > 1 ? [act("Remove", "remove_run", { name })] : []),
    ];
    return make("tr", { "aria-current": name === current ? "true" : false }, [
      make("th", { scope: "row", text: name }),
      ...rest.map((text, k) => make("td", { class: k < 3 ? "words" : "", text })),
      make("td", { class: "acts" }, acts),
    ]);
  }

  async add() {
    const run = this.store.document.run;
    const name = await ask(`A new run like ${run}`, "Its name", `${run}-2`);
    if (name) this.link.send({ op: "add_run", name, like: run });
  }
}

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  new Runs(store, link);
}
