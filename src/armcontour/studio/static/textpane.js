// Text of the job file, which is sent when the user applies it.

import { find, make, say } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  const area = make("textarea", { spellcheck: "false", autocomplete: "off", wrap: "off", "aria-label": "Job file" });
  const state = make("span", { class: "quiet", role: "status" });
  const apply = make("button", { type: "button", text: "Apply (Ctrl+Enter)", disabled: true });
  const back = make("button", { type: "button", text: "Discard", disabled: true });
  // The document's text, and the text of the area before the user typed.
  let text = "";
  let shown = "";
  /** Sent text that has no answer yet. @type {string | null} */
  let sent = null;
  // The job whose refusal was shown at its line.
  let marked = "";
  const changed = () => area.value !== shown;
  const take = (/** @type {string} */ fresh) => {
    text = fresh;
    area.value = fresh;
    shown = area.value;
  };
  const update = () => {
    apply.disabled = back.disabled = !changed();
    const newer = changed() && sent === null && store.document?.text !== text;
    const { line, sentence } = store.document ?? {};
    const unsent = newer ? "The job was changed elsewhere meanwhile; applying takes this text." : changed() ? "Not yet applied." : "";
    say(state, unsent || (line ? `Line ${line}: ${sentence}` : ""));
  };
  /** When a refused job is opened, select the refused line, so that the user can correct it. @param {any} head */
  const show = ({ id, line }) => {
    if (!line || marked === id) return;
    marked = id;
    store.setView({ tab: "text", dock: true });
    const lines = area.value.split("\n");
    const begin = lines.slice(0, line - 1).join("\n").length + (line > 1 ? 1 : 0);
    // The selection is visible only with the focus.
    if (document.activeElement === document.body) area.focus({ preventScroll: true });
    area.setSelectionRange(begin, begin + lines[line - 1].length);
    area.scrollTop = (area.scrollHeight / lines.length) * Math.max(0, line - 4);
  };
  const send = () => {
    if (!changed()) return;
    sent = area.value;
    link.edit([{ do: "text", text: sent }]);
    update();
  };
  apply.addEventListener("click", send);
  back.addEventListener("click", () => {
    take(store.document?.text ?? "");
    update();
  });
  area.addEventListener("input", update);
  area.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) send();
  });
  store.on("document", (/** @type {any} */ frame) => {
    const applied = sent !== null && area.value === sent && frame.head.text.trimEnd() === sent.trimEnd();
    if (applied || (!changed() && frame.head.text !== text)) take(frame.head.text);
    if (applied) sent = null;
    update();
    if (!changed()) show(frame.head);
  });
  // Refused text stays, so that the user can correct it.
  store.on("dropped", (/** @type {any} */ frame) => {
    if (sent === null) return;
    sent = null;
    update();
    say(state, `Not applied: ${frame.head.sentence}`);
  });
  find("#tab-text").append(area, make("p", { class: "acts" }, [apply, back, state]));
}
