// The job file as text: it can be changed by hand, and is sent when it is applied.

import { find, make, say } from "./dom.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  const area = make("textarea", { spellcheck: "false", autocomplete: "off", wrap: "off", "aria-label": "Job file" });
  const state = make("span", { class: "quiet", role: "status" });
  const apply = make("button", { type: "button", text: "Apply (Ctrl+Enter)", disabled: true });
  const back = make("button", { type: "button", text: "Discard", disabled: true });
  // The document's text, and how the area had it before somebody typed.
  let text = "";
  let shown = "";
  /** What was sent and is not answered. @type {string | null} */
  let sent = null;
  const changed = () => area.value !== shown;
  const take = (/** @type {string} */ fresh) => {
    text = fresh;
    area.value = fresh;
    shown = area.value;
  };
  const update = () => {
    apply.disabled = back.disabled = !changed();
    const newer = changed() && sent === null && store.document?.text !== text;
    say(
      state,
      newer
        ? "The job was changed elsewhere meanwhile; applying takes this text."
        : changed()
          ? "Not yet applied."
          : "",
    );
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
  });
  // What was refused stays, so that it can be mended.
  store.on("dropped", (/** @type {any} */ frame) => {
    if (sent === null) return;
    sent = null;
    update();
    say(state, `Not applied: ${frame.head.sentence}`);
  });
  find("#tab-text").append(area, make("p", { class: "acts" }, [apply, back, state]));
}
