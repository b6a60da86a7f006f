// Files: open by picker or drop, save, resolve conflicts with the disk, drafts.

import { show } from "./dialog.js";
import { find, give, make, mark } from "./dom.js";
import { known } from "./form.js";
import { hasChanges } from "./header.js";
import { ENDINGS, isLog } from "./logs.js";
import { notify } from "./messages.js";
import { chosenArm } from "./start_page.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */

const LARGEST = 64 * 2 ** 20; // bytes, as the server's limit

class Files {
  /** @param {Store} store @param {Link} link */
  constructor(store, link) {
    this.store = store;
    this.link = link;
    this.picker = /** @type {HTMLInputElement} */ (find("#picker"));
    known.then(({ drawings, jobs }) => (this.picker.accept = [...drawings, ...jobs, ENDINGS].join()));
    /** Document whose draft was offered. */
    this.offered = "";
    find("#open").addEventListener("click", () => this.picker.click());
    find("#save").addEventListener("click", () => link.send({ op: "save" }));
    this.picker.addEventListener("change", () => {
      const file = this.picker.files?.[0];
      this.picker.value = "";
      if (file) this.open(file);
    });
    this.listenToDrops();
    store.on("add logs", (/** @type {File[]} */ files) => this.addLogs(files));
    store.on("saved", (/** @type {any} */ frame) => notify(`Saved ${frame.head.file}.`));
    store.on("download", (/** @type {any} */ frame) => this.download(frame.head));
    store.on("conflict", (/** @type {any} */ frame) => this.conflict(frame.head));
    store.on("document", (/** @type {any} */ frame) => this.offerDraft(frame.head));
  }

  listenToDrops() {
    const over = (/** @type {DragEvent} */ event) => {
      if (!event.dataTransfer?.types.includes("Files")) return;
      event.preventDefault();
      document.body.classList.toggle("dropping", event.type === "dragover");
    };
    for (const name of /** @type {("dragover" | "dragleave")[]} */ (["dragover", "dragleave"])) window.addEventListener(name, over);
    window.addEventListener("drop", (event) => {
      over(event);
      this.openDropped([...(event.dataTransfer?.files ?? [])]);
    });
  }

  /** Open a dropped file, or all dropped logs. @param {File[]} files */
  async openDropped(files) {
    if (files.length === 1) return this.open(files[0]);
    const are = await Promise.all(files.map(isLog));
    if (are.every(Boolean)) return this.addLogs(files);
    notify("Several files can be dropped at once only if all are logs of the robot: drop the others one by one.", "alarm");
  }

  /** Store logs, in their order. @param {File[]} files */
  async addLogs(files) {
    for (const file of files) await this.open(file, true);
  }

  /** @param {File} file @param {boolean} [log] whether it is a log of the robot; by its name and first line otherwise */
  async open(file, log) {
    if (file.size > LARGEST)
      return notify(`${file.name} has ${Math.round(file.size / 2 ** 20)} MB; at most 64 MB can be opened here.`, "alarm");
    if (!this.store.document) return notify("The Studio is starting: open the file in a moment.", "alarm");
    // A mesh is an obstacle of the open job.
    if (/\.(stl|obj)$/i.test(file.name)) return this.store.tell("mesh", file);
    const { drawings, cells } = await known;
    const isDrawing = drawings.some((/** @type {string} */ ending) => file.name.toLowerCase().endsWith(ending));
    log ??= await isLog(file);
    const how = log ? { log: "1" } : await this.askHow(file.name, isDrawing ? cells : null);
    if (how === null) return;
    const query = new URLSearchParams({ name: file.name, ...how });
    document.body.dataset.opening = "true";
    try {
      const answer = await this.link.request(`/open?${query}`, { method: "POST", body: file });
      if (!answer.ok) notify(await sentenceOf(answer), "alarm");
      else if (log) this.store.tell("log", (await answer.json()).name);
    } catch {
      notify("The server does not answer, so the file was not opened.", "alarm");
    } finally {
      document.body.dataset.opening = "false";
    }
  }

  /**
   * Ask in which cell a drawing is cut, and what happens to unsaved changes.
   * @param {string} name @param {string[] | null} names of cells for a drawing @returns {Promise<Record<string, string> | null>}
   */
  async askHow(name, names) {
    const loses = hasChanges(this.store.document);
    if (!names && !loses) return {};
    const content = [];
    if (loses)
      content.push(make("p", { text: "The changes of the open job are not saved; they are offered when it is opened again." }));
    const options = ["", ...(names ?? [])].map((cell) => make("option", { value: cell, text: cell || "this job's arm and limits" }));
    const cells = make("select", {}, options);
    cells.value = chosenArm();
    const skips = make("input", { type: "checkbox" });
    if (names) {
      content.push(make("label", { class: "field", text: "Cell: arm, limits and servo " }, [cells]));
      content.push(make("label", { class: "field" }, [skips, " Leave out what cannot be read (unknown: skip)"]));
    }
    const answer = await show(`Open ${name}`, content, [{ value: "open", text: "Open" }, { value: "", text: "Cancel" }]);
    if (answer !== "open") return null;
    return { ...(names && cells.value && { cell: cells.value }), ...(skips.checked && { unknown: "skip" }) };
  }

  /** Let the browser save a job that has no file. @param {{file: string, name: string}} head */
  async download({ file, name }) {
    const answer = await this.link.request(`/files/${encodeURIComponent(file)}`);
    if (!answer.ok) return notify(await sentenceOf(answer), "alarm");
    give(await answer.blob(), name);
    notify(`${name} was given to the browser to save.`);
  }

  /** @param {{sentence: string}} head */
  async conflict({ sentence }) {
    const answer = await show("The file has changed on disk", [make("p", { text: sentence })], [
      { value: "", text: "Keep both for now" },
      { value: "reload", text: "Take the file's" },
      { value: "force", text: "Overwrite the file" },
    ]);
    if (answer === "reload") this.link.send({ op: "reload" });
    if (answer === "force") this.link.send({ op: "save", force: true });
  }

  /** Offer the changes of an earlier session that ended without saving. @param {any} head */
  async offerDraft(head) {
    mark(document.body, "data-draft", head.draft ?? "");
    if (!head.draft || this.offered === head.id) return;
    this.offered = head.id;
    const content = [make("p", { text: `Changes of ${head.draft} from an earlier session were kept, but not saved.` })];
    const answer = await show("Unsaved changes were found", content, [
      { value: "restore_draft", text: "Take them up" },
      { value: "discard_draft", text: "Throw them away" },
      { value: "", text: "Decide later" },
    ]);
    if (answer) this.link.send({ op: answer });
  }
}

/** @param {Response} answer @returns {Promise<string>} */
async function sentenceOf(answer) {
  const text = await answer.text();
  try {
    return JSON.parse(text).sentence ?? text;
  } catch {
    return text || `The server refused the file (${answer.status}).`;
  }
}

/** @param {Store} store @param {Link} link @returns {Files} */
export function init(store, link) {
  return new Files(store, link);
}
