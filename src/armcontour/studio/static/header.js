// Top bar: name and state of the file, undo, shown run.

import { show } from "./dialog.js";
import { find, say } from "./dom.js";
import { inches } from "./units.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */

const ON_DISK = /** @type {Record<string, string>} */ ({ changed: "changed on disk", missing: "no job file", none: "no job file" });

/** Return whether unsaved changes exist; a drawing that was only viewed has no job file yet. @param {any} head @returns {boolean} */
export const hasChanges = (head) => Boolean(head?.dirty && (head.on_disk !== "missing" || head.undo_label));

/** @param {any} head @returns {string} */
function stateOf(head) {
  const states = [hasChanges(head) ? "unsaved changes" : "", ON_DISK[head.on_disk] ?? ""];
  return states.filter(Boolean).join(", ");
}

/** Button that gets the focus when another button is disabled; otherwise the focus would be lost. @type {Record<string, string[]>} */
const HEIRS = { undo: ["redo", "save"], redo: ["undo", "save"] };

/** @param {Record<string, HTMLButtonElement>} buttons @param {Record<string, boolean>} dead by name */
function disable(buttons, dead) {
  const focused = document.activeElement?.id ?? "";
  for (const [name, is] of Object.entries(dead)) buttons[name].disabled = is;
  if (dead[focused]) buttons[HEIRS[focused].find((name) => !buttons[name].disabled) ?? "save"].focus();
}

/** Open a tab of the details and start its task; an export first shows its choices. @param {Store} store @param {string} name */
async function open(store, name) {
  store.setView({ tab: name === "runs" ? name : "tasks", dock: true });
  const form = document.querySelector(`#tasks form[data-task="${name}"]`);
  if (!(form instanceof HTMLFormElement)) return;
  form.scrollIntoView({ block: "nearest" });
  // While a task runs, its sentence in the tab says why no other can be started.
  if (document.querySelector("#tasks .task-wait")) return;
  if (name === "export") {
    const choices = [...form.querySelectorAll("label")].map((x) => /** @type {HTMLElement} */ (x.cloneNode(true)));
    const answer = await show("Export to robot", choices, [{ value: "yes", text: "Export" }, { value: "", text: "Cancel" }]);
    if (answer !== "yes") return;
    choices.forEach((x, k) => (form.querySelectorAll("select")[k].value = /** @type {HTMLSelectElement} */ (find("select", x)).value));
  }
  form.requestSubmit();
}

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  for (const button of document.querySelectorAll("[data-opens]"))
    button.addEventListener("click", () => open(store, /** @type {HTMLElement} */ (button).dataset.opens ?? ""));
  const run = /** @type {HTMLSelectElement} */ (find("#run"));
  const buttons = Object.fromEntries(["undo", "redo", "save"].map((id) => [id, /** @type {HTMLButtonElement} */ (find(`#${id}`))]));
  run.addEventListener("change", () => link.send({ op: "select", run: run.value }));
  buttons.undo.addEventListener("click", () => link.send({ op: "undo" }));
  buttons.redo.addEventListener("click", () => link.send({ op: "redo" }));
  const units = find("#units");
  units.addEventListener("click", () => (inches.value = !inches.value));
  inches.subscribe((is) => units.setAttribute("aria-pressed", String(is)));
  store.on("document", (/** @type {any} */ { head }) => {
    say(find("#name"), head.name || "untitled");
    find("#name").title = head.file ?? head.title ?? "";
    say(find("#file-state"), stateOf(head));
    document.title = `${hasChanges(head) ? "• " : ""}${head.name || "untitled"} – armcontour studio`;
    document.body.dataset.dirty = String(hasChanges(head));
    document.body.dataset.rev = String(head.rev);
    disable(buttons, { undo: !head.undo_label, redo: !head.redo_label });
    buttons.undo.title = `Undo${head.undo_label ? `: ${head.undo_label}` : ""} (Ctrl+Z)`;
    buttons.redo.title = `Redo${head.redo_label ? `: ${head.redo_label}` : ""} (Ctrl+Shift+Z)`;
    render(html`${head.runs.map((/** @type {any} */ { name }) => html`<option key=${name} value=${name} selected=${name === head.run}>${name}</option>`)}`, run);
    run.value = head.run;
  });
}
