// Modal dialogs: a name, a choice, or a text.

import { find, make } from "./dom.js";

/**
 * Show a dialog until one of its buttons is pressed.
 * @param {string} title @param {Node[]} content @param {{value: string, text: string}[]} buttons the first is the usual one
 * @returns {Promise<string>} value of the button; "" when it was closed
 */
export function show(title, content, buttons) {
  const dialog = /** @type {HTMLDialogElement} */ (find("#question"));
  if (dialog.open) dialog.close("");
  const actions = buttons.map(({ value, text }, k) => make("button", { value, text, formnovalidate: !value, class: k === 0 ? "usual" : "" }));
  const form = make("form", { method: "dialog" }, [
    make("h2", { id: "question-title", text: title }),
    ...content,
    make("div", { class: "acts" }, actions),
  ]);
  dialog.replaceChildren(form);
  let answer = "";
  form.addEventListener("submit", ({ submitter }) => {
    answer = submitter instanceof HTMLButtonElement ? submitter.value : "";
  });
  dialog.showModal();
  return new Promise((resolve) => {
    const closed = () => {
      // The browser reports late that an earlier dialog was closed; this one may be open by then.
      if (dialog.open && form.isConnected) return;
      dialog.removeEventListener("close", closed);
      resolve(answer);
    };
    dialog.addEventListener("close", closed);
  });
}

/**
 * Ask for a text.
 * @param {string} title @param {string} label @param {string} value what is offered
 * @returns {Promise<string | null>} null when it was closed
 */
export async function ask(title, label, value) {
  const field = make("input", { type: "text", value, "aria-label": label });
  const answer = show(title, [make("label", { class: "field", text: label }, [field])], [{ value: "yes", text: "OK" }, { value: "", text: "Cancel" }]);
  field.select();
  return (await answer) === "yes" ? field.value.trim() : null;
}
