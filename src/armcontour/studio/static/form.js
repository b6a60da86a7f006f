// The form of the job: groups of fields from form.json, which Python makes of the job's schema. Text is sent as it is
// written; the server reads units and refuses what makes no sense, and the refusal stays at its field.

import { find } from "./dom.js";
import { isPlain, quantity } from "./format.js";
import { Gesture } from "./gesture.js";
import { Ghost, positionOf, STEPS, valueAt } from "./ghost.js";
import { Entry } from "./parts.js";
import { html, render, signal, useComputed, useRef, useSignal } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./link.js").Link} Link */
/** @typedef {import("./ghost.js").Slider} Slider */
/** @typedef {(string | number)[]} Key */
/**
 * A field, see `io/job_form.py`; `at` is the key of those that are in a group.
 * @typedef {{name: string, at?: string, label?: string, text?: string, unit?: string, example?: string, default?: any, choices?: any[],
 *   open?: boolean, tick?: boolean, plain?: boolean, list?: boolean, needed?: boolean, usual?: [number, number], fields?: Field[],
 *   each?: Field, items?: Field[]}} Field
 */
/** @typedef {{f: Field, at: Key, label?: string, row?: Slider}} Props */

/** Where a value is written: a mark beside it, and a sentence. @type {Record<string, [string, string]>} */
const FROM = {
  job: ["", "Written for all runs of the job."],
  run: ["run", "Written for this run alone."],
  arm: ["arm", "Of the arm; not written in the job."],
  default: ["", "The default; not written in the job."],
};
/** Keys of which a layer that is left out is not run, and of layers. */
const [READ, BY_LAYER] = ["path.layers", "process.by_layer"];

const head = signal(/** @type {any} */ (null));
const everything = signal(false);
const wanted = signal("");
const forRun = signal(false);
const help = signal("");
/** Sentences of refused edits, by key. */
const refusals = signal(/** @type {Record<string, string>} */ ({}));
/** Edits that were refused: they are made with the next one of their mapping. @type {any[]} */
let waiting = [];
/** Key of the edit that has no answer. */
let sent = "";
/** @type {any} */
let form = null;
/** @type {Link} */
let link;
/** @type {Ghost} */
let ghost;

/** @param {any} data @param {Key} key @returns {any} */
const valueIn = (data, key) => key.reduce((x, name) => (x !== null && typeof x === "object" ? x[name] : undefined), data);

/** A key of the run that is shown, or of the job, as written. @param {Key} key @returns {{written: any, from: string}} */
function writtenAt(key) {
  const { data, run } = head.value;
  const own = data.runs?.[run]?.[key[0]];
  const hides = form.merged.includes(key[0]) && key.length > 1 ? own?.[key[1]] : own;
  if (form.in_run.includes(key[0]) && (hides !== undefined || !form.shared.includes(key[0])))
    return { written: valueIn(data.runs?.[run], key), from: "run" };
  return { written: valueIn(data, key), from: "job" };
}

/** @param {Key} key @returns {Slider | undefined} */
const rowAt = (key) => head.value.values[key.join(".")];

/** @param {Key} key @returns {Key[]} keys of joints that have values of their own */
const jointsAt = (key) =>
  Object.keys(head.value.values).filter((x) => x.startsWith(`${key.join(".")}.`) && /\.\d+$/.test(x)).map((x) => [...key, Number(x.split(".").at(-1))]);

/** A value as text. @param {any} x @returns {string} */
function textOf(x) {
  if (x === undefined) return "";
  if (x === null) return "none";
  if (Array.isArray(x) && !x.some((y) => typeof y === "object")) return x.join(", ");
  return typeof x === "object" ? JSON.stringify(x) : String(x);
}

/** What is typed into a field, as it is written in the job. @param {Field} f @param {string} text @returns {any} */
function readAs(f, text) {
  if (text === "none") return null;
  try {
    if (/^[[{]/.test(text)) return JSON.parse(text);
  } catch {
    return text;
  }
  const one = (/** @type {string} */ x) => (f.plain && isPlain(x) ? Number(x) : x);
  if (f.list && text.includes(",")) return text.split(",").map((x) => one(x.trim()));
  if (typeof f.default === "boolean") return /^(true|false)$/.test(text) ? text === "true" : isPlain(text) ? Number(text) : text;
  return f.list && !f.open ? [one(text)] : one(text);
}

/** Send edits of a key, with those of its mapping that were refused before. @param {Key} key @param {object[]} edits */
function send(key, edits) {
  const outer = key.slice(0, -1).join(".");
  const kept = waiting.filter((x) => x.outer === outer && x.key !== key.join("."));
  waiting = [...kept, ...edits.map((edit) => ({ edit, outer, key: key.join(".") }))];
  sent = key.join(".");
  refusals.value = {};
  link.edit(waiting.map((x) => x.edit));
}

/** @param {Key} key @param {any} value */
function set(key, value) {
  const own = forRun.value && form.in_run.includes(key[0]);
  send(key, value === "" ? [{ do: "unset", key }] : [{ do: "set", key, value, run: own }]);
}

/** @param {Key} key */
const unset = (key) => send(key, [{ do: "unset", key }]);

/**
 * Show a refusal at its field. @param {import("./state.js").Frame} frame
 * @returns {boolean} whether there is such a field
 */
export function refuseAt({ head: { key, sentence } }) {
  const place = [key, sent].find((x) => sent && x && find("#panel").querySelector(`[data-key="${CSS.escape(x)}"]`));
  if (place) refusals.value = { [place]: sentence };
  sent = "";
  return place !== undefined;
}

/** @param {string} text */
const words = (text) => text.charAt(0).toUpperCase() + text.slice(1).replaceAll("_", " ");

/** @param {Field} f @returns {boolean} whether a search finds it */
function isFound(f) {
  const text = wanted.value.toLowerCase();
  const own = `${f.name.replaceAll("_", " ")} ${f.name} ${f.label ?? ""} ${f.text ?? ""}`.toLowerCase();
  return own.includes(text) || [...(f.fields ?? []), ...(f.items ?? []), ...(f.each ? [f.each] : [])].some(isFound);
}

/** Whether a field is written, or usual. @param {Field} f @param {Key} key */
const isSet = (f, key) => writtenAt(key).written !== undefined || rowAt(key) !== undefined || jointsAt(key).length > 0;

/** @param {{at: Key}} props */
const Refusal = ({ at }) => {
  const sentence = useComputed(() => refusals.value[at.join(".")] ?? "");
  return html`${sentence.value && html`<p class="refused" role="alert">${sentence}</p>`}`;
};

/** A field with one value, or one for each joint. @param {Props} props */
function Leaf({ f, at, label = f.label ?? f.name }) {
  const joints = useComputed(() => JSON.stringify(jointsAt(at)));
  const all = /** @type {Key[]} */ (JSON.parse(joints.value));
  if (!all.length) return html`<${One} f=${f} at=${at} label=${label} />`;
  return all.map((key) => html`<${One} key=${key} f=${f} at=${key} label=${`${label} ${Number(key.at(-1)) + 1}`} />`);
}

/** @param {Props} props */
function One({ f, at, label = f.name }) {
  const key = at.join(".");
  // Only a field whose own state differs is rendered again.
  const state = useComputed(() => JSON.stringify([writtenAt(at), rowAt(at)]));
  const [{ written, from }, row] = JSON.parse(state.value);
  const place = useRef(/** @type {HTMLElement | null} */ (null));
  const is = row?.from ?? (written === undefined ? "default" : from);
  const [mark, where] = FROM[is];
  const isChosen = f.choices && !f.open;
  const given = row?.written ?? textOf(written);
  const value = typeof row?.value === "number" && (is === "arm" || is === "default") ? quantity(row.value, row) : given;
  const id = `set-${key.replace(/[^\w]/g, "-")}`;
  const title = [f.text, where].filter(Boolean).join(" ");
  const name = words(label);
  const more = { id, title };
  let control = html`<${Entry} ...${more} value=${value} placeholder=${hintOf(f)} list=${f.choices && `${id}-known`} send=${(/** @type {string} */ text) => set(at, text === "" ? "" : readAs(f, text))} />`;
  if (f.choices && !isChosen)
    control = html`${control}<datalist id=${`${id}-known`}>${f.choices.map((x) => html`<option value=${String(x)} />`)}</datalist>`;
  if (f.tick) control = html`<input type="checkbox" ...${more} checked=${written ?? f.default ?? false} onChange=${(/** @type {any} */ e) => set(at, e.target.checked)} />`;
  if (isChosen) {
    const now = row?.value ?? written ?? "";
    const none = row || f.needed ? [] : [html`<option value="">${f.default === undefined ? "none" : `${f.default} (default)`}</option>`];
    control = html`<select ...${more} value=${String(now)} onChange=${(/** @type {any} */ e) => set(at, e.target.value)}>${none}${f.choices?.map(
      (x) => html`<option value=${String(x)} selected=${String(x) === String(now)}>${String(x).replaceAll("_", " ")}</option>`,
    )}</select>`;
  }
  const slider = row && typeof row.min === "number" && row.min < row.max ? { ...row, key, label: name } : null;
  // A plain number of the file stays one; its unit is told beside it.
  const unit = isPlain(value) || (f.list && !row) ? (row?.unit ?? f.unit) : "";
  return html`<div class="setting" ref=${place} data-key=${key} data-from=${is} onFocusIn=${() => (help.value = title)}
      onPointerEnter=${() => slider && place.current && ghost.wish(slider, place.current)} onPointerLeave=${() => ghost.leave()}>
    <label for=${id} title=${title}>${name}</label>
    <span class="from">${[unit, mark].filter(Boolean).join(" · ")}</span>
    ${(is === "job" || is === "run") && !f.needed && !(isChosen && row) && html`<${Without} at=${at} name=${name} />`}
    ${control}
    ${slider && html`<${Range} slider=${slider} at=${at} written=${value} place=${place} />`}
    <${Refusal} at=${at} />
  </div>`;
}

/** @param {Field} f @returns {string} */
function hintOf(f) {
  const example = f.example ? `e.g. ${f.example}` : "";
  return f.default === undefined ? (f.needed ? example : ["none", example].filter(Boolean).join(", ")) : String(f.default);
}

/** @param {{at: Key, name: string}} props */
const Without = ({ at, name }) =>
  html`<button type="button" class="unset" title="Leave it out of the file again" aria-label=${`Leave ${name.toLowerCase()} out of the file again`} onClick=${() => unset(at)}>↺</button>`;

/** @param {{slider: Slider, at: Key, written: string, place: {current: HTMLElement | null}}} props */
function Range({ slider, at, written, place }) {
  const gesture = useRef(/** @type {Gesture | null} */ (null));
  const range = useRef(/** @type {HTMLInputElement | null} */ (null));
  const slide = (/** @type {any} */ { target, timeStamp }) => {
    gesture.current ??= new Gesture(link);
    const value = valueAt(slider, Number(target.value));
    const field = place.current?.querySelector("input");
    if (field) field.value = quantity(value, slider);
    target.setAttribute("aria-valuetext", quantity(value, slider));
    gesture.current.update([{ do: "set", key: at, value, run: forRun.value && form.in_run.includes(at[0]) }], timeStamp);
  };
  const end = () => {
    gesture.current?.end();
    gesture.current = null;
  };
  const free = () => {
    ghost.hold(false);
    if (place.current?.matches(":hover")) ghost.wish(slider, place.current);
  };
  const position = typeof slider.value === "number" ? positionOf(slider, slider.value) : STEPS;
  return html`<input type="range" ref=${range} min="0" max=${STEPS} value=${gesture.current ? undefined : position} aria-label=${`${slider.label}, slider`} aria-valuetext=${written}
    onInput=${slide} onChange=${end} onPointerDown=${() => ghost.hold(true)} onPointerUp=${free} onPointerCancel=${free} onLostPointerCapture=${free} />`;
}

/** A mapping, opened where something is written. @param {Props & {more?: any}} props */
function Part({ f, at, label = f.label ?? f.name, more = null }) {
  const count = useComputed(() => {
    const { written } = writtenAt(at);
    return written !== null && typeof written === "object" ? Object.keys(written).length : Number(written !== undefined);
  });
  const open = useSignal(count.peek() > 0);
  const isOpen = open.value || Boolean(wanted.value);
  const needed = f.needed || !count.value;
  return html`<details class="part" data-key=${at.join(".")} open=${isOpen} onToggle=${(/** @type {any} */ e) => (open.value = e.target.open)}>
    <summary title=${f.text}>${words(label)}${count.value > 0 && html` <small>${count.value} set</small>`}</summary>
    <${Refusal} at=${at} />
    ${isOpen && html`${more}<${Fields} fields=${f.fields ?? []} at=${at} />${!needed && html`<p class="acts"><button type="button" onClick=${() => unset(at)}>Leave ${label.replaceAll("_", " ")} out</button></p>`}`}
  </details>`;
}

/** @param {{fields: Field[], at: Key}} props */
const Fields = ({ fields, at }) =>
  html`${fields.filter((f) => !wanted.value || isFound(f)).map((f) => html`<${Any} key=${f.name} f=${f} at=${[...at, f.name]} />`)}`;

/** @param {Props} props */
function Any({ f, at, label }) {
  const isWhole = useComputed(() => Array.isArray(writtenAt(at).written));
  if (f.items && !f.fields) return html`<${List} f=${f} at=${at} />`;
  if (f.fields && !isWhole.value) return html`<${Part} f=${f} at=${at} label=${label} />`;
  if (f.each?.fields || (f.each && !f.list && !f.choices)) return html`<${Named} f=${f} at=${at} />`;
  return html`<${Leaf} f=${f} at=${at} label=${label} />`;
}

/** A list of mappings. @param {Props} props */
function List({ f, at }) {
  const count = useComputed(() => writtenAt(at).written?.length ?? 0);
  const open = useSignal(count.peek() > 0);
  const isOpen = open.value || Boolean(wanted.value);
  const inner = f.items ?? [];
  // What an item must have gets an example, which is then changed.
  const fresh = Object.fromEntries(inner.filter((x) => x.needed).map((x) => [x.name, x.choices?.[0] ?? x.example ?? (x.list ? [x.example ?? "100 mm", "100 mm", "100 mm"] : `${f.name.replace(/(es|s)$/, "")} ${count.value + 1}`)]));
  return html`<details class="part" data-key=${at.join(".")} open=${isOpen} onToggle=${(/** @type {any} */ e) => (open.value = e.target.open)}>
    <summary title=${f.text}>${words(f.name)}${count.value > 0 && html` <small>${count.value}</small>`}</summary>
    <${Refusal} at=${at} />
    ${isOpen && html`${Array.from({ length: count.value }, (_, k) => html`<${Part} key=${k} f=${{ ...f, fields: inner, needed: false }} at=${[...at, k]} label=${`${f.name.replace(/(es|s)$/, "")} ${k + 1}`} />`)}
      <p class="acts"><button type="button" onClick=${() => send(at, [{ do: "set", key: [...at, count.value], value: fresh, insert: true }])}>Add</button></p>`}
  </details>`;
}

/** A mapping by names, such as of layers. @param {Props} props */
function Named({ f, at }) {
  const key = at.join(".");
  const isOfLayers = key === READ || key === BY_LAYER;
  const state = useComputed(() => JSON.stringify([writtenAt(at).written, isOfLayers ? head.value.layers : []]));
  const [written, layers] = JSON.parse(state.value);
  const added = useSignal(/** @type {string[]} */ ([]));
  const given = Array.isArray(written) ? written : Object.keys(written ?? {});
  const names = [...new Set([...layers, ...given, ...added.value])].map(String);
  const open = useSignal(given.length > 0);
  const isOpen = open.value || Boolean(wanted.value);
  const each = f.each ?? f;
  const entry = (/** @type {string} */ name) => {
    if (!each.fields) return html`<${Leaf} key=${name} f=${{ ...each, unit: f.unit, text: f.text }} at=${[...at, name]} label=${name} />`;
    const isRun = written === undefined || given.includes(name);
    const tick = html`<label class="field"><input type="checkbox" checked=${isRun} onChange=${() => setRun(written, layers, name, !isRun)} /> run this layer</label>`;
    return html`<${Part} key=${name} f=${{ ...each, needed: key === READ, text: f.text }} at=${[...at, name]} label=${name} more=${key === READ && tick} />`;
  };
  const add = (/** @type {any} */ event) => {
    event.preventDefault();
    const field = event.target.querySelector("input");
    if (field.value.trim()) added.value = [...added.value, field.value.trim()];
    field.value = "";
    open.value = true;
  };
  return html`<details class="part" data-key=${key} open=${isOpen} onToggle=${(/** @type {any} */ e) => (open.value = e.target.open)}>
    <summary title=${f.text}>${words(f.name)}${given.length > 0 && html` <small>${given.length} set</small>`}</summary>
    <${Refusal} at=${at} />
    ${isOpen && html`${names.map(entry)}${!layers.length && html`<form class="acts" onSubmit=${add}><input type="text" aria-label=${`New name of ${words(f.name).toLowerCase()}`} placeholder="name" /><button type="submit">Add</button></form>`}`}
  </details>`;
}

/** Run a layer or not, when all are listed. @param {any} written @param {string[]} layers @param {string} name @param {boolean} isRun */
function setRun(written, layers, name, isRun) {
  const at = READ.split(".");
  if (written && !Array.isArray(written)) return isRun ? set([...at, name], {}) : unset([...at, name]);
  const all = Object.fromEntries((written ?? layers).map((/** @type {string} */ x) => [x, {}]));
  if (isRun) all[name] = {};
  else delete all[name];
  set(at, all);
}

/** The tilt of the tool, which follows from the orientation. */
function Tilt() {
  const state = useComputed(() => JSON.stringify(head.value.tilt));
  const tilt = JSON.parse(state.value);
  if (!tilt) return null;
  const texts = {
    angle: ["Tilt of the tool", "Angle of the tool axis from the perpendicular into the drawing, or into the surface if the tool follows the tangent."],
    towards: ["Tilt towards", "Direction in which the tip of the tool axis leans: 0 is x of the drawing, or the direction of travel if the tool follows the tangent; 90 is y."],
  };
  return html`${Object.entries(texts).map(([name, [label, text]]) => html`<div class="setting" data-key=${name === "angle" ? "tilt" : "tilt-towards"} onFocusIn=${() => (help.value = text)}>
    <label for=${`tilt-${name}`} title=${text}>${label}</label><span class="from">deg</span>
    <${Entry} id=${`tilt-${name}`} title=${text} value=${String(Number(tilt[name].toFixed(6)))} send=${(/** @type {string} */ value) => send(["tilt"], [{ do: "tilt", [name]: value }])} />
    ${name === "angle" && html`<${Refusal} at=${["tilt"]} />`}
  </div>`)}`;
}

/** @param {{title: string, fields: Field[]}} props */
function Group({ title, fields }) {
  const isUsual = (/** @type {Field} */ f) => rowAt(/** @type {string} */ (f.at).split(".")) !== undefined;
  const open = useSignal(fields.some((f) => f.usual || isUsual(f)));
  const more = useSignal(false);
  const all = everything.value || more.value || Boolean(wanted.value);
  const shown = useComputed(() => {
    const some = fields.filter((f) => isSet(f, /** @type {string} */ (f.at).split(".")));
    return some.map((f) => f.at).join(" ");
  });
  const set = shown.value.split(" ").filter(Boolean);
  // A group in which nothing is written has all its fields.
  const listed = fields.filter((f) => (wanted.value ? isFound(f) : all || !set.length || set.includes(f.at ?? "")));
  if (!listed.length) return null;
  const isOpen = open.value || Boolean(wanted.value);
  const rest = fields.length - listed.length;
  const isTilted = fields.some((f) => f.at === "path.orientation") && !wanted.value;
  return html`<details class="group" data-group=${title} open=${isOpen} onToggle=${(/** @type {any} */ e) => (open.value = e.target.open)}>
    <summary>${title}</summary>
    ${isOpen && html`${isTilted && html`<${Tilt} />`}${listed.map((f) => html`<${Any} key=${f.at} f=${f} at=${f.at?.split(".")} label=${f.label} />`)}
      ${rest > 0 && html`<button type="button" class="rest" onClick=${() => (more.value = true)}>${rest} more</button>`}`}
  </details>`;
}

function Form() {
  const isThere = useComputed(() => Boolean(head.value && Object.keys(head.value.values).length));
  if (!isThere.value) return null;
  const choice = (/** @type {{value: boolean}} */ of, /** @type {boolean} */ is, /** @type {string} */ text, /** @type {string} */ title) =>
    html`<button type="button" title=${title} aria-pressed=${String(of.value === is)} onClick=${() => (of.value = is)}>${text}</button>`;
  return html`<div class="seek">
      <input type="search" aria-label="Search settings" placeholder="Search settings" value=${wanted} onInput=${(/** @type {any} */ e) => (wanted.value = e.target.value.trim())} />
      <span class="group choice" role="group" aria-label="Settings that are shown">${choice(everything, false, "Set", "Only what is set or usual")}${choice(everything, true, "All", "All settings of the job")}</span>
      <span class="group choice" role="group" aria-label="Changes are for">${choice(forRun, false, "Job", "Changes are for all runs that have no value of their own")}${choice(forRun, true, "Run", "Changes are for the shown run alone")}</span>
    </div>
    ${form.groups.map((/** @type {any} */ x) => html`<${Group} key=${x.title} ...${x} />`)}
    <p class="help quiet">${help}</p>`;
}

/** What the page knows of jobs: fields, cells, formats, endings. @type {Promise<any>} */
export const known = fetch("/static/form.json").then((answer) => answer.json());

/** @param {Store} store @param {Link} to */
export async function init(store, to) {
  link = to;
  ghost = new Ghost(store, link);
  let rev = -1;
  store.on("document", (/** @type {any} */ frame) => {
    if (frame.rev !== rev) {
      rev = frame.rev;
      waiting = [];
      sent = "";
      if (Object.keys(refusals.value).length) refusals.value = {};
    }
    head.value = frame.head;
  });
  form = await known;
  render(html`<${Form} />`, find("#panel"));
}
