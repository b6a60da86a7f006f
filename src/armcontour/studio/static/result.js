// One task: its progress while it works, and what came of it: sentences, tables, charts, a file.

import { answerOf } from "./answers.js";
import { Chart } from "./chart.js";
import { give, make, say } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./link.js").Link} Link */
/** A file of the server, which is kept for a while; `open` is an address at which a browser shows it. */
/** @typedef {{file: string, name: string, bytes: number, open?: string, label?: string}} Kept */

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
    /** Revision of the document that it is asked for. */
    this.rev = store.latest("document")?.rev ?? -1;
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
    const { head } = frame;
    const { sentences, tables = [], graphs = [] } = answerOf(this.task, frame, this.store);
    this.head.remove();
    const refused = head.kept === false || head.verdict === "violated";
    this.element.dataset.state = refused ? "refused" : "done";
    for (const text of sentences) this.body.append(make("p", { class: "task-sentence", text }));
    if (head.file) this.body.append(this.fileOf(head));
    for (const { label, edits } of head.fixes ?? []) this.body.append(make("p", { class: "task-file" }, [make("button", { type: "button", text: label, onclick: () => this.link.edit(edits) })]));
    for (const x of graphs) if (x.content.x.length) this.addGraph(x);
    for (const x of tables) if (x.rows.length) this.body.append(tableOf(x, (t) => this.store.setTime(t)));
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
    this.body.append(map.element);
  }

  /** A chart; one over time has the cursor of all. @param {import("./answers.js").Graph} graph */
  addGraph({ name, axes, content, time }) {
    const chart = new Chart(name, axes, (t) => time && this.store.setTime(t));
    chart.show(content);
    this.body.append(chart.element);
    this.endings.push(this.store.on("theme", () => chart.repaint()));
    if (!time) return;
    this.endings.push(this.store.on("time", () => chart.point(this.store.time)));
  }

  /** The result goes away. */
  close() {
    for (const end of this.endings) end();
    this.element.remove();
  }

  /**
   * A file to download, and to open where it can be.
   * @param {Kept} file
   * @returns {HTMLElement}
   */
  fileOf(file) {
    const size = `${Math.max(1, Math.round(file.bytes / 1000))} kB`;
    const said = make("span", { class: "quiet", role: "status" });
    const button = make("button", { type: "button", text: file.label ?? `Download ${file.name}`, title: `${file.name}, ${size}`, "data-file": file.name, onclick: () => this.download(file, said) });
    const row = make("p", { class: "task-file" }, [button]);
    if (file.open) row.append(make("a", { href: file.open, target: "_blank", rel: "noopener", class: "button", text: "Open" }));
    row.append(make("span", { class: "quiet", text: size }), said);
    return row;
  }

  /**
   * @param {Kept} file
   * @param {HTMLElement} said
   */
  async download(file, said) {
    try {
      const answer = await this.link.request(`/files/${encodeURIComponent(file.file)}`);
      if (!answer.ok) throw new Error(`the server answers ${answer.status}`);
      give(await answer.blob(), file.name);
      say(said, "Downloaded.");
    } catch (error) {
      say(said, `It could not be downloaded: ${error instanceof Error ? error.message : error}. Start the task again.`);
    }
  }
}

/**
 * @param {import("./answers.js").Table} table
 * @param {(t: number) => void} goTo shows a time
 * @returns {HTMLElement}
 */
function tableOf({ title, columns, rows, times }, goTo) {
  const head = make("tr", {}, columns.map((text) => make("th", { scope: "col", text })));
  const cell = (/** @type {string} */ text, /** @type {number} */ k) => make(k === 0 ? "th" : "td", { text, scope: k === 0 ? "row" : false });
  const body = rows.slice(0, MOST_ROWS).map((row, k) => {
    const shown = make("tr", {}, row.map(cell));
    if (times) shown.cells[0].replaceChildren(make("button", { type: "button", text: row[0], title: "Show the time of its largest error", onclick: () => goTo(times[k]) }));
    return shown;
  });
  const parts = [make("thead", {}, [head]), make("tbody", {}, body)];
  const caption = title ? [make("caption", { text: title })] : [];
  const found = make("table", {}, [...caption, ...parts]);
  const rest = rows.length > MOST_ROWS ? [make("p", { class: "quiet", text: `And ${rows.length - MOST_ROWS} more rows.` })] : [];
  return make("div", { class: "task-table", tabindex: 0, role: "group", "aria-label": title ?? "Table" }, [found, ...rest]);
}
