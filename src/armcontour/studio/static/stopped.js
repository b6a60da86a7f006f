// What the page says after its server was stopped: what is kept, and how to go on.

import { give } from "./dom.js";
import { html, useSignal } from "./vendor/preact.js";

/** Return the command that opens the document again. @param {any} head of the document, or null @returns {string} */
export function commandFor(head) {
  const { file, on_disk: state } = head ?? {};
  // A job without a file is offered on the start page.
  if (!file || state === "missing" || state === "none") return "armcontour studio";
  return `armcontour studio ${/^[\w./~-]+$/.test(file) ? file : `'${file.replaceAll("'", "'\\''")}'`}`;
}

/** Return a sentence on what is kept of a document. @param {any} head of the document, or null @param {boolean} isChangeLost @returns {string} */
export function keptText(head, isChangeLost) {
  if (!head) return "";
  const name = head.name || "the job";
  const lost = isChangeLost ? " The change that was under way may be lost." : "";
  if (!head.dirty) return `All changes of ${name} are saved in its file.${lost}`;
  const { labels = [], made = 0, first = 0 } = head.steps ?? {};
  const last = labels[made - first - 1];
  const where = commandFor(head) === "armcontour studio" ? "on the start page" : "when it opens the file again";
  return `The unsaved changes of ${name}${last ? ` up to “${last}”` : ""} are kept: the Studio offers them ${where}.${lost}`;
}

/** The message of a page without a server. @param {{head: any, isChangeLost: boolean}} props */
export function Stopped({ head, isChangeLost }) {
  const said = useSignal("");
  const command = commandFor(head);
  const copy = async () => {
    await navigator.clipboard?.writeText(command);
    said.value = "Copied.";
  };
  const save = () => give(new Blob([head.text], { type: "text/yaml" }), `${head.name || "job"}.yaml`);
  return html`<div class="stopped"><p><b>The Studio was stopped, so nothing can be changed here.</b> ${keptText(head, isChangeLost)}</p>
    <p>Start it again with <code>${command}</code> and open the address that it prints; the address may be pasted into this tab. Files of results that you have not downloaded must be made again.</p>
    <p class="acts"><button type="button" onClick=${copy}>Copy the command</button>${head && html`<button type="button" onClick=${save}>Save a copy of the job</button>`}<span class="quiet" role="status">${said}</span></p></div>`;
}
