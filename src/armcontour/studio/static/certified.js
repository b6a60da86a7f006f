// The plan of a certificate: it is another plan than that of the run, so it is shown and exported by buttons of its own.

import { find, make } from "./dom.js";
import { html, render, signal } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** Starts a task. @typedef {(task: {task: string, title: string}, options: object) => void} Start */

/** The certificate whose plan the page shows; empty for the plan of the run. */
const shown = signal("");
/** Title of the export of a certificate's plan. */
export const CERTIFIED_EXPORT = "Export of the certified plan";
/** Formats of exports for the arm; a controller that keeps the times executes each point at its time. */
export const formats = signal(/** @type {{name: string, label: string, keepsTimes: boolean}[]} */ ([]));

/** Buttons that show and export a plan; `brief`: beside the sentence that says that it is shown. @param {{id: string, isOutdated?: boolean, brief?: boolean, link: Link, start: Start}} props */
export function CertifiedPlan({ id, isOutdated = false, brief = false, link, start }) {
  const isShown = shown.value === id;
  const why = isOutdated ? "The job has changed since: certify again" : "";
  const show = () => isOutdated || link.send(isShown ? { op: "show_run" } : { op: "show_certified", id });
  const exportIt = (/** @type {any} */ event) => {
    event.preventDefault();
    const format = new FormData(event.target).get("format");
    if (!isOutdated) start({ task: "export", title: CERTIFIED_EXPORT }, { format, of: "certified", certificate: id });
  };
  return html`<form class="certified acts" onSubmit=${exportIt}>
    ${brief ? html`<button type="button" onClick=${show}>Back to the plan of the run</button>` : html`<button type="button" aria-pressed=${String(isShown)} aria-disabled=${String(isOutdated)} title=${why || "Show the plan that is proved, instead of the plan of the run"} onClick=${show}>Show this plan</button>`}
    <button type="submit" aria-disabled=${String(isOutdated)} title=${why || "Export the set-points that are proved"}>Export this plan</button>
    <label class="field">as <select name="format">${formats.value.filter((x) => x.keepsTimes).map(({ name, label }) => html`<option value=${name}>${label}</option>`)}</select></label>
  </form>`;
}

/** Say which plan is shown as long as it is that of a certificate. @param {Store} store @param {Link} link @param {Start} start */
export function init(store, link, start) {
  const banner = make("div", { class: "message certified-banner", hidden: true });
  find("#messages").prepend(banner);
  store.on("picture", () => {
    shown.value = store.certificate;
    banner.hidden = !store.certificate;
    document.body.dataset.certified = store.certificate;
    const { run } = store.latest("picture")?.head ?? {};
    render(store.certificate ? html`<p>Shown is the plan that the certificate proves, not the plan of run ${run}.</p>
      <${CertifiedPlan} brief id=${store.certificate} link=${link} start=${start} />` : null, banner);
  });
}
