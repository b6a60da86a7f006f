// Tables of waypoints and corners: every drag has a way without dragging.

import { toleranceEdits } from "./corner.js";
import { find, headings, make, say, whileSeen } from "./dom.js";
import { mm, withUnit } from "./format.js";
import { insertable } from "./handles.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */

const MOST_ROWS = 500;
const AXES = ["x", "y", "z"];

/**
 * A table whose rows are kept as long as they can be, so that a field keeps the focus.
 * @param {HTMLElement} region @param {string} caption @param {string[]} columns
 */
function table(region, caption, columns) {
  const body = make("tbody");
  const note = make("p", { class: "quiet" });
  const head = make("tr", {}, headings(columns));
  region.append(
    note,
    make("table", {}, [make("caption", { text: caption, class: "unseen" }), make("thead", {}, [head]), body]),
  );
  return { body, note, head };
}

/** @param {HTMLElement} body @param {number} count @param {(index: number) => HTMLElement} make */
function resize(body, count, make) {
  while (body.childElementCount > count) body.lastChild?.remove();
  while (body.childElementCount < count) body.append(make(body.childElementCount));
  /** @type {HTMLElement} */ (body.parentElement).hidden = count === 0;
}

/** What the document has, unless somebody types something else. @param {HTMLInputElement} field @param {string} value */
function fill(field, value) {
  const typing = document.activeElement === field && field.value !== (field.dataset.sent ?? field.dataset.written);
  field.dataset.written = value;
  delete field.dataset.sent;
  if (!typing) field.value = value;
}

/** No waypoint that is to have the focus once the document has it. */
const NOTHING = { index: -1, count: Infinity };

class Waypoints {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    this.dimension = 0;
    this.inserted = NOTHING;
    this.region = find("#tab-waypoints");
    this.convert = make("button", {
      type: "button",
      text: "Make waypoints of the drawing",
      hidden: true,
      onclick: () => link.edit([{ do: "to_waypoints" }]),
    });
    whileSeen(store, this.region, ["document"], () => store.document && this.show(store.document));
  }

  /** @param {any} document */
  show({ waypoints = [], path = {} }) {
    const dimension = waypoints[0]?.written.length ?? 2;
    if (dimension !== this.dimension) {
      this.dimension = dimension;
      this.region.replaceChildren(this.convert);
      this.table = table(this.region, "Waypoints", ["(number)", ...AXES.slice(0, dimension), "(actions)"]);
    }
    if (!this.table) return;
    const shown = waypoints.slice(0, MOST_ROWS);
    this.convert.hidden = !path.convertible;
    say(this.table.note, this.noteOf(path, waypoints));
    resize(this.table.body, shown.length, (index) => this.row(index));
    shown.forEach((/** @type {any} */ point, /** @type {number} */ index) => this.fillRow(index, point, path.editable));
    const { index, count } = this.inserted;
    if (waypoints.length <= count) return;
    this.inserted = NOTHING;
    this.table.body.children[index]?.querySelector("input")?.focus();
  }

  /** @param {any} path @param {any[]} waypoints @returns {string} */
  noteOf(path, waypoints) {
    const few = waypoints.length > MOST_ROWS ? `The first ${MOST_ROWS} of ${waypoints.length} waypoints. ` : "";
    const units = waypoints.length ? "Plain numbers are metres; 350 mm can be typed as well." : "";
    return few + [path.editable ? units : (path.why_not ?? ""), ...(path.notes ?? [])].filter(Boolean).join(" ");
  }

  /** @param {number} index @returns {HTMLElement} */
  row(index) {
    const fields = AXES.slice(0, this.dimension).map((axis) => {
      const field = make("input", {
        type: "text",
        "aria-label": `Waypoint ${index + 1}, ${axis}`,
        autocomplete: "off",
        spellcheck: "false",
      });
      field.addEventListener("change", () => this.set(index, fields));
      return field;
    });
    const act = (/** @type {string} */ text, /** @type {string} */ title, /** @type {() => void} */ does) =>
      make("button", { type: "button", text, title, "aria-label": `${title} ${index + 1}`, onclick: does });
    const buttons = [
      act("+", "Insert a waypoint after", () => this.insert(index)),
      act("×", "Remove waypoint", () => this.link.edit([{ do: "remove_waypoint", index }])),
    ];
    return make("tr", {}, [
      make("th", { scope: "row", text: String(index + 1) }),
      ...fields.map((f) => make("td", {}, [f])),
      make("td", { class: "acts" }, buttons),
    ]);
  }

  /** @param {number} index @param {{written: string[], removable: boolean}} point @param {boolean} editable */
  fillRow(index, point, editable) {
    const row = /** @type {HTMLElement} */ (this.table?.body.children[index]);
    row.querySelectorAll("input").forEach((field, k) => {
      fill(field, point.written[k] ?? "");
      field.disabled = !editable;
    });
    const [insert, remove] = row.querySelectorAll("button");
    insert.hidden = !editable || !insertable(this.store.document, index + 1);
    remove.hidden = !editable || !point.removable;
  }

  /** @param {number} index @param {HTMLInputElement[]} fields */
  set(index, fields) {
    const value = fields.map((f) => f.value.trim());
    for (const f of fields) f.dataset.sent = f.value;
    if (fields.some((f, k) => value[k] !== f.dataset.written)) this.link.edit([{ do: "set_waypoint", index, value }]);
  }

  /** Between a waypoint and its neighbour. @param {number} index */
  insert(index) {
    const points = this.store.document.waypoints;
    const a = points[index]?.uv;
    const b = points[index + 1]?.uv;
    const last = points[index - 1]?.uv ?? a;
    // After the last waypoint the path goes on by half of its last line.
    const at = b ? [(a[0] + b[0]) / 2, (a[1] + b[1]) / 2] : [a[0] + (a[0] - last[0]) / 2, a[1] + (a[1] - last[1]) / 2];
    this.inserted = { index: index + 1, count: points.length };
    this.link.edit([{ do: "insert_waypoint", index: index + 1, at }]);
  }
}

class Corners {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    this.table = table(find("#tab-corners"), "Corners", ["(number)", "place mm", "error", "allowed", "radius", "what bounds it"]);
    whileSeen(store, find("#tab-corners"), ["picture"], () => this.show(store.latest("picture")?.head.corners ?? []));
  }

  /** @param {any[]} corners */
  show(corners) {
    say(
      this.table.note,
      corners.length ? "" : "This run has no rounded corners: the tool stops at corners, or there are none.",
    );
    const shown = corners.slice(0, MOST_ROWS);
    resize(this.table.body, shown.length, (k) => this.row(k));
    shown.forEach((corner, k) => this.fillRow(k, corner));
    this.shown = shown;
  }

  /** @param {number} k @returns {HTMLElement} */
  row(k) {
    const field = make("input", { type: "text", autocomplete: "off", spellcheck: "false" });
    field.addEventListener("change", () => {
      field.dataset.sent = field.value;
      if (field.value.trim() !== field.dataset.written)
        this.link.edit(
          toleranceEdits(/** @type {any} */ (this.shown?.[k]), withUnit(field.value.trim(), field.dataset.written ?? "", "mm")),
        );
    });
    return make("tr", {}, [
      make("th", { scope: "row" }),
      make("td"),
      make("td"),
      make("td", {}, [field]),
      make("td"),
      make("td", { class: "words" }),
    ]);
  }

  /** @param {number} k @param {any} corner */
  fillRow(k, corner) {
    const cells = this.table.body.children[k].children;
    const at = corner.waypoint === null ? "" : String(corner.waypoint + 1);
    say(cells[0], at);
    say(cells[1], corner.corner.map((/** @type {number} */ x) => mm(x, 2)).join(", "));
    say(cells[2], `${mm(corner.error)} mm`);
    const field = /** @type {HTMLInputElement} */ (cells[3].firstChild);
    field.setAttribute("aria-label", at ? `Tolerance of the corner at waypoint ${at}` : "Tolerance of all corners");
    fill(
      field,
      corner.allowed === null || corner.allowed === undefined
        ? ""
        : `${Number((1000 * corner.allowed).toPrecision(6))} mm`,
    );
    say(cells[4], `${mm(corner.radius, 2)} mm`);
    say(cells[5], corner.reason ?? "");
  }
}

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  new Waypoints(store, link);
  new Corners(store, link);
}
