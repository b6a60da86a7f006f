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
  let shown = "";
  const changed = () => area.value !== shown;
  const update = () => {
    apply.disabled = back.disabled = !changed();
    const newer = changed() && store.document?.text !== shown;
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
    shown = area.value;
    link.edit([{ do: "text", text: area.value }]);
    update();
  };
  apply.addEventListener("click", send);
  back.addEventListener("click", () => {
    shown = area.value = store.document?.text ?? "";
    update();
  });
  area.addEventListener("input", update);
  area.addEventListener("keydown", (event) => {
    if (event.key === "Enter" && (event.ctrlKey || event.metaKey)) send();
  });
  store.on("document", (/** @type {any} */ frame) => {
    if (!changed() && frame.head.text !== shown) shown = area.value = frame.head.text;
    update();
  });
  find("#tab-text").append(area, make("p", { class: "acts" }, [apply, back, state]));
}
