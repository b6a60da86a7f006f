// Components that several regions render.

import { shownText } from "./units.js";
import { html, useLayoutEffect, useRef } from "./vendor/preact.js";

/**
 * A text field that sends its text as typed. Typed text stays when the document changes; sent text is shown as
 * the document contains it. Escape restores the document's text. Enter sends a refused text again.
 * @param {{value: string, send: (text: string) => void, [attribute: string]: any}} props
 */
export function Entry({ value, send, ...more }) {
  const field = useRef(/** @type {HTMLInputElement | null} */ (null));
  /** Text from the document, or sent text. */
  const known = useRef(value);
  useLayoutEffect(() => {
    const { current } = field;
    if (current && (document.activeElement !== current || current.value === known.current)) current.value = known.current = value;
  });
  const change = () => {
    const text = field.current?.value ?? "";
    known.current = text;
    if (text.trim() !== value) send(text.trim());
  };
  const key = (/** @type {KeyboardEvent} */ event) => {
    // A refused value is tried again, although its text is the same.
    const isRefused = more["aria-invalid"] === "true" && field.current?.value === known.current;
    if (event.key === "Enter" && isRefused) send(known.current.trim());
    if (event.key !== "Escape" || !field.current) return;
    field.current.value = value;
    field.current.select();
  };
  return html`<input type="text" autocomplete="off" spellcheck=${false} ref=${field} onChange=${change} onKeyDown=${key} ...${more} />`;
}

/** Buttons for the remedies of a refusal; each sends all edits of a remedy, the first two of which are its label. @param {{all?: {key: (string | number)[], value: any}[][], take: (edits: object[]) => void}} props */
export const Remedies = ({ all = [], take }) => all.map((edits) => {
  const texts = edits.map(({ key, value }) => `${value === null ? "Remove" : "Set"} ${key.slice(-2).join(" ").replaceAll("_", " ")}${value === null ? "" : `: ${value}`}`);
  return html`<button type="button" title=${edits.map(({ key }) => key.join(".")).join(", ")} onClick=${() => take(edits)}>${texts.slice(0, 2).join(", ").replaceAll(", Set", ",")}</button> `;
});

/**
 * Buttons for changes of the job; brief buttons have their sentences as tooltips. `result` is the result that also applies to the changed job.
 * @param {{changes: {label: string, short: string, condition?: string, edits: object[]}[], brief?: boolean, link: import("./connection.js").Link, result?: string}} props
 */
export const Changes = ({ changes, brief, link, result }) => changes.map(({ label, short, condition, edits }) =>
  html`<button type="button" title=${brief && label} onClick=${() => link.edit(edits, { result })}>${shownText(brief ? short : label)}${condition && `, if ${condition}`}</button>`);

/** Column heads; a name in brackets is for screen readers only. @param {{names: string[], words?: number}} props */
export function Heads({ names, words = 0 }) {
  return html`<thead><tr>${names.map((name, k) => {
    const unseen = name.startsWith("(") ? name.slice(1, -1) : "";
    return html`<th scope="col" class=${k < words ? "words" : ""}>${unseen ? html`<span class="unseen">${unseen}</span>` : name}</th>`;
  })}</tr></thead>`;
}

/** Head and body of a table; the first cell of a row is its head. @param {{columns: string[], rows: any[][]}} props */
export const Tabular = ({ columns, rows }) => html`<${Heads} names=${columns} />
  <tbody>${rows.map((row) => html`<tr>${row.map((x, k) => (k ? html`<td>${x}</td>` : html`<th scope="row">${x}</th>`))}</tr>`)}</tbody>`;
