// List of the obstacles, and buttons that add one of every kind.

import { show } from "./dialog.js";
import { make } from "./dom.js";
import { lengthUnit } from "./length_unit.js";
import { notify } from "./messages.js";
import { oncePerFrame } from "./state.js";
import { toolBox } from "./tool_strip.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/** What a dialog asks for a new obstacle. @typedef {{type: string, name: string, size?: number[], radius?: number, length?: number, file?: string, unit?: string, high: number}} Body `high`: height of its origin above its foot [m] */

/** Kinds of obstacles with their lengths: label, and default as a factor of the usual side. @type {Record<string, {name: string, fields: [string, number][]}>} */
export const KINDS = {
  box: { name: "Box", fields: [["Size x", 1], ["Size y", 1], ["Size z", 1]] },
  cylinder: { name: "Cylinder", fields: [["Radius", 0.5], ["Length", 1]] },
  sphere: { name: "Sphere", fields: [["Radius", 0.5]] },
  capsule: { name: "Capsule", fields: [["Radius", 0.25], ["Length without the ends", 1]] },
  mesh: { name: "Mesh", fields: [] },
};
const MESH_UNITS = ["mm", "m", "in"];
export const MESH_FILES = ".stl,.obj";

/** Return the keys of a body of a kind. @param {string} type @param {number[]} lengths m @returns {Omit<Body, "name">} */
export function bodyOf(type, lengths) {
  const [a, b, c] = lengths;
  if (type === "box") return { type, size: [a, b, c], high: c / 2 };
  if (type === "cylinder") return { type, radius: a, length: b, high: b / 2 };
  if (type === "sphere") return { type, radius: a, high: a };
  if (type === "capsule") return { type, radius: a, length: b, high: b / 2 + a };
  return { type, high: 0 };
}

/** Ask for the name and the lengths of an obstacle. @param {string} type @param {number} side usual length [m] @param {string} [title] @returns {Promise<Body | null>} null: cancelled */
export async function askBody(type, side, title = `Add a ${type}`) {
  const field = (/** @type {string} */ text, /** @type {Record<string, any>} */ how) => make("label", { class: "field", text }, [make("input", how)]);
  const { unit, factor: metres } = lengthUnit();
  const fields = [field("Name", { type: "text", value: type, required: true })];
  for (const [label, factor] of KINDS[type].fields) fields.push(field(`${label} [${unit}]`, { type: "number", min: 1e-3, step: "any", value: Number(((side * factor) / metres).toPrecision(3)), required: true }));
  const answer = await show(title, fields, [{ value: "ok", text: "OK" }, { value: "", text: "Cancel" }]);
  if (answer !== "ok") return null;
  const [name, ...texts] = fields.map((x) => /** @type {HTMLInputElement} */ (x.lastChild).value);
  const lengths = texts.map((text) => Number((Number(text) * metres).toPrecision(12)));
  return { ...bodyOf(type, lengths), name: name.trim() || type };
}

/** Store the file of a mesh, and ask for its unit. @param {Link} link @param {File} file @returns {Promise<Body | null>} null: cancelled or refused */
export async function askMesh(link, file) {
  const units = make("select", {}, MESH_UNITS.map((value) => make("option", { value, text: value })));
  const stem = file.name.replace(/\.[^.]*$/, "");
  const named = make("input", { type: "text", value: stem, required: true });
  const fields = [make("label", { class: "field", text: "Name" }, [named]), make("label", { class: "field", text: "Unit of its lengths" }, [units])];
  const answer = await show(`Add ${file.name}`, fields, [{ value: "ok", text: "OK" }, { value: "", text: "Cancel" }]);
  if (answer !== "ok") return null;
  try {
    const reply = await link.request(`/open?${new URLSearchParams({ name: file.name, mesh: "1" })}`, { method: "POST", body: file });
    const { name, sentence } = await reply.json();
    if (reply.ok) return { type: "mesh", name: named.value.trim() || stem, file: name, unit: units.value, high: 0 };
    notify(sentence, "alarm");
  } catch {
    notify("The server does not answer, so the mesh was not added.", "alarm");
  }
  return null;
}

/**
 * Show the list while its tool is used.
 * @param {Store} store @param {Link} link
 * @param {{add: (type: string) => void, addMesh: (file: File) => void}} acts
 */
export function showList(store, link, { add, addMesh }) {
  const box = make("div", { class: "obstacle-list", role: "group", "aria-label": "Obstacles", hidden: true });
  toolBox().prepend(box);
  const picker = make("input", { type: "file", accept: MESH_FILES, hidden: true, "aria-label": "File of the mesh" });
  box.after(picker);
  picker.addEventListener("change", () => {
    const file = picker.files?.[0];
    picker.value = "";
    if (file) addMesh(file);
  });
  const remove = (/** @type {number} */ index) => {
    store.setView({ obstacle: -1 });
    link.edit([{ do: "obstacle", action: "remove", index }]);
  };
  store.on("remove obstacle", remove);
  const update = () => {
    const { options, document } = store;
    box.hidden = options.tool !== "obstacles" || !document;
    if (box.hidden) return;
    const bodies = /** @type {{name: string, type: string, index: number}[]} */ (document.obstacles);
    render(
      html`<p class="tool-title"><b>Obstacles</b></p>
        ${bodies.length > 0 && html`<ul>${bodies.map(({ name, type, index }) => html`<li key=${index} onKeyDown=${(/** @type {KeyboardEvent} */ event) => {
          if (event.key !== "Delete") return;
          event.preventDefault();
          remove(index);
        }}>
          <button type="button" class="pick" aria-pressed=${String(options.obstacle === index)} onClick=${() => store.setView({ obstacle: options.obstacle === index ? -1 : index })}>${name} <span class="quiet">${type === name ? "" : type}</span></button>
          <button type="button" aria-label=${`Remove ${name}`} title="Remove (Delete)" onClick=${() => remove(index)}>×</button></li>`)}</ul>`}
        <div class="acts">${Object.entries(KINDS).map(([type, { name }]) => html`<button type="button" data-kind=${type} title=${`Add a ${type}`} onClick=${() => (type === "mesh" ? picker.click() : add(type))}>+ ${name}</button>`)}</div>`,
      box,
    );
  };
  const soon = oncePerFrame(update);
  for (const event of ["view", "document"]) store.on(event, soon);
}
