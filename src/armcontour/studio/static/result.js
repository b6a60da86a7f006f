// One task: its progress while it works, and what came of it: sentences, tables, charts, files.

import { Chart, number } from "./chart.js";
import { RUN_COLOURS, themed } from "./colours.js";
import { make, say } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {{title?: string, columns: string[], rows: (string | number | null)[][]}} Table */
/** @typedef {{id: string, name: string, size?: number, open?: string}} File */

/** Rows of a table that are shown at once. */
const MOST_ROWS = 200;

export class Result {
  /**
   * @param {string} id
   * @param {string} task
   * @param {string} title
   * @param {Store} store
   * @param {Link} link
   * @param {() => void} cancel
   */
  constructor(id, task, title, store, link, cancel) {
    this.task = task;
    this.store = store;
    this.link = link;
    /** @type {(() => void)[]} */
    this.endings = [];
    this.bar = make("progress", { max: 1, "aria-label": `${title}: progress` });
    this.step = make("span", { class: "quiet", text: "Starting" });
    const stop = make("button", { type: "button", text: "Cancel", onclick: cancel });
    this.head = make("div", { class: "task-progress" }, [this.bar, this.step, stop]);
    this.body = make("div", { class: "task-body" });
    const time = new Date().toLocaleTimeString([], { hour: "2-digit", minute: "2-digit" });
    this.element = make("article", { class: "task-result", "data-task": task, "data-id": id, "data-state": "running" }, [
      make("h3", { text: `${title} ` }, [make("span", { class: "quiet", text: time })]), this.head, this.body,
    ]);
  }

  /** @param {{steps: string[], share: number | null, eta: number | null}} told */
  progress({ steps, share, eta }) {
    if (share === null || share === undefined) this.bar.removeAttribute("value");
    else this.bar.value = share;
    const rest = eta ? `, about ${Math.ceil(eta)} s left` : "";
    say(this.step, `${(steps ?? []).join(", ")}${rest}`);
    this.element.dataset.share = String(share ?? "");
  }

  /** @param {Frame} frame */
  finish(frame) {
    const { ok, sentences = [], tables = [], files = [] } = frame.head;
    this.head.remove();
    this.element.dataset.state = ok === false ? "refused" : "done";
    for (const text of sentences) this.body.append(make("p", { class: "task-sentence", text }));
    if (this.task === "clearance" && frame.arrays.t?.length) this.addClearance(frame);
    for (const x of tables) this.body.append(tableOf(x));
    for (const x of files) this.body.append(this.fileOf(x));
  }

  /**
   * @param {"cancelled" | "failed"} state
   * @param {string} sentence
   */
  end(state, sentence) {
    this.head.remove();
    this.element.dataset.state = state;
    this.body.replaceChildren(make("p", { class: "task-sentence", text: sentence }));
  }

  /** @param {import("./placement.js").PlacementMap} map */
  addMap(map) {
    this.body.prepend(map.element);
  }

  /** Distance over time, with the pair at the cursor. @param {Frame} frame */
  addClearance(frame) {
    const { t, distance, margin, pair } = frame.arrays;
    const chart = new Chart("clearance", { title: "Least distance over time", x: "Time [s]", xUnit: "s", y: "Distance", unit: "mm" }, (at) => {
      if (at === null) return;
      this.store.setCursor({ t: at, source: "charts" });
    });
    const inMm = (/** @type {ArrayLike<number>} */ x) => Array.from(x, (d) => (Number.isFinite(d) ? 1000 * d : null));
    const curves = [{ label: "distance", colour: RUN_COLOURS[1], y: inMm(distance) }];
    if (margin?.length) curves.push(/** @type {any} */ ({ label: "margin", colour: themed("--ink"), dash: [2, 3], y: inMm(margin) }));
    const least = frame.head.least;
    const summary = least ? `Least: ${number(1000 * least.distance)} mm at ${number(least.t)} s, ${least.pair}.` : "";
    chart.show({ x: t, curves, range: [0, 0], summary });
    this.body.append(chart.element);
    const names = frame.head.pairs ?? [];
    this.endings.push(
      this.store.on("cursor", (/** @type {import("./state.js").Cursor} */ cursor) => {
        chart.point(cursor?.t ?? null);
        if (!cursor || !pair) return;
        const k = nearest(t, cursor.t);
        say(chart.summary, `${summary} At ${number(t[k])} s: ${number(1000 * distance[k])} mm, ${names[pair[k]] ?? ""}.`);
      }),
      this.store.on("theme", () => chart.repaint()),
    );
  }

  /** The result goes away. */
  close() {
    for (const end of this.endings) end();
    this.element.remove();
  }

  /**
   * A file to download, and to open where it can be.
   * @param {File} file
   * @returns {HTMLElement}
   */
  fileOf(file) {
    const size = file.size ? ` (${Math.max(1, Math.round(file.size / 1000))} kB)` : "";
    const button = make("button", { type: "button", text: `Download ${file.name}${size}`, "data-file": file.name, onclick: () => this.download(file, said) });
    const said = make("span", { class: "quiet", role: "status" });
    const row = make("p", { class: "task-file" }, [button, " "]);
    if (file.open) row.append(make("a", { href: file.open, target: "_blank", rel: "noopener", class: "button", text: "Open" }), " ");
    row.append(said);
    return row;
  }

  /**
   * @param {File} file
   * @param {HTMLElement} said
   */
  async download(file, said) {
    try {
      const answer = await this.link.request(`/files/${encodeURIComponent(file.id)}`);
      if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
      const address = URL.createObjectURL(await answer.blob());
      make("a", { href: address, download: file.name }).click();
      setTimeout(() => URL.revokeObjectURL(address), 10_000);
      say(said, "Downloaded.");
    } catch (error) {
      say(said, `It could not be downloaded: ${error instanceof Error ? error.message : error}. Start the task again.`);
    }
  }
}

/**
 * @param {ArrayLike<number>} times
 * @param {number} t
 * @returns {number}
 */
function nearest(times, t) {
  let best = 0;
  for (let k = 1; k < times.length; k += 1) if (Math.abs(times[k] - t) < Math.abs(times[best] - t)) best = k;
  return best;
}

/**
 * @param {Table} table
 * @returns {HTMLElement}
 */
function tableOf({ title, columns, rows }) {
  const head = make("tr", {}, columns.map((text) => make("th", { scope: "col", text })));
  const cell = (/** @type {string | number | null} */ x, /** @type {number} */ k) => {
    const text = typeof x === "number" ? number(x) : (x ?? "–");
    return k === 0 ? make("th", { scope: "row", text }) : make("td", { text, class: typeof x === "number" ? "figure" : false });
  };
  const body = rows.slice(0, MOST_ROWS).map((row) => make("tr", {}, row.map(cell)));
  const parts = [make("thead", {}, [head]), make("tbody", {}, body)];
  const caption = title ? [make("caption", { text: title })] : [];
  const found = make("table", {}, [...caption, ...parts]);
  const rest = rows.length > MOST_ROWS ? [make("p", { class: "quiet", text: `And ${rows.length - MOST_ROWS} more rows.` })] : [];
  return make("div", { class: "task-table", tabindex: 0, role: "group", "aria-label": title ?? "Table" }, [found, ...rest]);
}
