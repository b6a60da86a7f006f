// Start page: arms, new jobs, files, and recent files.

import { find, make } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */

/** Location text for an unsaved job from an earlier session. */
const UNSAVED = "not saved";

/** Return the chosen arm, while the start page is shown. @returns {string} */
export const chosenArm = () => /** @type {HTMLInputElement | null} */ (document.querySelector("#start[open] input:checked"))?.value ?? "";

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  const dialog = /** @type {HTMLDialogElement} */ (find("#start"));
  /** Documents for which the start page was shown automatically. */
  let shown = "";
  find("#new").addEventListener("click", () => link.send({ op: "start" }));
  store.on("document", (/** @type {any} */ { head }) => {
    if ((head.id !== shown || head.undo_label) && dialog.open) dialog.close();
    if (head.start && head.id !== shown && !head.undo_label) link.send({ op: "start" });
    shown = head.id;
  });
  store.on("start", (/** @type {any} */ { head }) => {
    const before = chosenArm() || "ur5e";
    const arms = head.arms.map((/** @type {string} */ name) =>
      make("label", {}, [make("input", { type: "radio", name: "arm", value: name, checked: name === before, autofocus: name === before }), name]),
    );
    find(".arms", dialog).replaceChildren(...arms);
    const [drafts, opened] = [find(".drafts", dialog), find(".opened", dialog)];
    for (const place of [drafts, opened]) place.replaceChildren();
    for (const { id, name, where } of head.recent) {
      const button = make("button", { type: "button", "data-recent": id }, [make("b", { text: name }), make("span", { class: "quiet", text: where })]);
      (where.startsWith(UNSAVED) ? drafts : opened).append(button);
    }
    find("#recent-title").hidden = !opened.hasChildNodes();
    const question = /** @type {HTMLDialogElement} */ (find("#question"));
    const open = () => dialog.open || dialog.showModal();
    // An open question is answered first.
    if (question.open) question.addEventListener("close", open, { once: true });
    else open();
  });
  dialog.addEventListener("click", ({ target }) => {
    const { card, recent: id } = /** @type {HTMLElement | null} */ (/** @type {Element} */ (target).closest("[data-card], [data-recent]"))?.dataset ?? {};
    if (card) link.send({ op: "new", card, arm: chosenArm() });
    if (id) link.send({ op: "open_recent", id });
    if (card || id) dialog.close();
  });
  find("#start-open").addEventListener("click", () => find("#picker").click());
}
