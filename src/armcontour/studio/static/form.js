// The form of the job: groups of fields from form.json, which Python derives from the job's schema. Text is sent as
// typed. The server reads units and refuses invalid values; the refusal is shown at its field.

import { find } from "./dom.js";
import { isPlain, quantity } from "./format.js";
import { Gesture } from "./gesture.js";
import { Entry, Remedies } from "./components.js";
import { shownField, shownSlider, shownText, shownUnit, typedField } from "./units.js";
import { computed, html, render, signal, useComputed, useLayoutEffect, useRef, useSignal } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */
/**
 * A quantity with a usual range, as `description.py` gives it, with its key and label; that of a joint has the joint's name,
 * and `linear` if the joint is prismatic.
 * @typedef {{key: string, label: string, value: number | string | null, written: string | null, unit: string,
 *   factor: number, min: number, max: number, log: boolean, from: string, joint?: string, linear?: boolean}} Slider
 */
/** @typedef {(string | number)[]} Key */
/**
 * A field, see `tools/job_form.py`; `at` is its key if it is in a group. A number that is typed without a unit has the unit
 * `typed` if the key has no value; one that the file has without a unit has the unit `unit`.
 * @typedef {{name: string, at?: string, label?: string, called?: string, text?: string, unit?: string, example?: string, default?: any, choices?: any[],
 *   typed?: string, open?: boolean, tick?: boolean, plain?: boolean, list?: boolean, needed?: boolean, usual?: [number, number], fields?: Field[],
 *   each?: Field, items?: Field[]}} Field
 */
/** @typedef {{f: Field, at: Key, label?: string, row?: Slider}} Props */

/** Where a value is written (job, run, default): a mark next to it, and a sentence. @type {Record<string, [string, string]>} */
const FROM = {
  job: ["", "Written for all runs of the job."],
  run: ["run", "Written for this run alone."],
  arm: ["arm", "Of the arm; not written in the job."],
  default: ["", "The default; not written in the job."],
  contour: ["", "As for the whole job."],
};
/** Keys of layers; a layer that they omit is not run. */
const [READ, BY_LAYER] = ["path.layers", "process.by_layer"];

const head = signal(/** @type {any} */ (null));
const everything = signal(false);
/** Tab of the settings whose groups are shown; a search finds groups of all tabs. */
const side = signal("process");
/** Groups that are not in the tab Process, with their tab. @type {Record<string, string>} */
const SIDES = { "Layers and order": "contours", Part: "contours", "Tool and tilt": "robot", "Arm and limits": "robot", Servo: "robot", Cell: "robot" };
/** The selected contour as JSON, or empty; and the labels of its fields. */
const contour = signal("");
const OWN = { speed: "speed", tolerance: "corner tolerance", kerf: "kerf", lead_in: "lead in", lead_out: "lead out", pierce: "pierce", tabs: "tabs", weave: "weave", order: "order" };
const wanted = signal("");
const forRun = signal(false);
/** Key of the field with the focus. */
const focused = signal(/** @type {Key | null} */ (null));
const help = signal("");
const unhelp = () => (help.value = "");
/**
 * Edits of a key.
 * @typedef {{key: string, edits: object[], outer: string, was?: string, place?: string, sentence?: string, remedies?: any[]}} Wish
 *   `outer` is the key around `key` that the server refused, or empty; `was` is the written value as JSON, with which a
 *   refused one stays in its field; `sentence` says at the key `place` why it is refused
 */
/** Refused edits with a value that their fields keep. If other keys of `outer` caused the refusal, they are sent again with the next edit there. */
const waiting = signal(/** @type {Wish[]} */ ([]));
/** A refused edit without a value that a field could keep. */
const passing = signal(/** @type {Wish | null} */ (null));
/** Sentences and buttons of refused edits, by key. They stay until the value is accepted, changed elsewhere or given up. */
const refusals = computed(() => {
  const found = /** @type {Record<string, any>} */ ({});
  for (const wish of [...waiting.value, ...(passing.value ? [passing.value] : [])]) {
    const take = (/** @type {any[]} */ edits) => {
      const isReplaced = (/** @type {any} */ edit) => edits.some((x) => String(x.key) === String(edit.key));
      send(wish.key.split("."), [...wish.edits.filter((x) => !isReplaced(x)), ...edits]);
    };
    if (wish.place && wish.sentence) found[wish.place] = html`${shownText(wish.sentence)} <${Remedies} all=${wish.remedies} take=${take} />`;
  }
  return found;
});
/** The edit without an answer, and the edits that were sent with it. @type {{wish: Wish, more: Wish[]} | null} */
let sent = null;
/** @type {any} */
let form = null;
/** @type {Link} */
let link;
/** Usual values with which a part of the process is added by one click. @type {Record<string, Record<string, string>>} */
const USUAL = {
  weave: { width: "4 mm", pitch: "2 mm" },
  tabs: { width: "2 mm", spacing: "50 mm" },
  pierce: { time: "0.5 s" },
  lead_in: { length: "3 mm" },
  lead_out: { length: "3 mm" },
};
/** Parts that need an output which is switched, and its usual name. */
const [SWITCHED, OUTPUT] = [new Set(["tabs", "pierce"]), "torch"];
/** Key of a lead along which the process is on, and its shape: a straight one would cut into the part. */
const [ACTIVE, ARC] = ["active", "arc"];
/** Key of all contours. */
const OF_CONTOURS = "path.contours.";
/** A number with a decimal comma, and its unit. */
const DECIMAL_COMMA = /^([-+]?\d+),(\d+)\s*([^\d\s,].*)?$/;
/** Slider positions are integers from 0 to this. */
const STEPS = 1000;

/** @param {any} data @param {Key} key @returns {any} */
const valueIn = (data, key) => key.reduce((x, name) => (x !== null && typeof x === "object" ? x[name] : undefined), data);

/** Return a key of the shown run, or of the job, as written. @param {Key} key @returns {{written: any, from: string}} */
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

/** Joints with their own values, by the key of the common value. */
const joints = computed(() => {
  const found = /** @type {Record<string, number[]>} */ ({});
  for (const key of Object.keys(head.value?.values ?? {})) {
    const [, all, joint] = /^(.*)\.(\d+)$/.exec(key) ?? [];
    if (all) (found[all] ??= []).push(Number(joint));
  }
  return found;
});

/** @param {Key} key @returns {Key[]} keys of its joints */
const jointsAt = (key) => (joints.value[key.join(".")] ?? []).map((joint) => [...key, joint]);

/** Convert a value to text. @param {any} x @returns {string} */
function textOf(x) {
  if (x === undefined) return "";
  if (x === null) return "none";
  if (Array.isArray(x) && !x.some((y) => typeof y === "object")) return x.join(", ");
  return typeof x === "object" ? JSON.stringify(x) : String(x);
}

/** Convert a field's text to the value in the job. @param {Field} f @param {string} text @returns {any} */
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

/** Forget the refused edit of a key, and its sentence. @param {string} key */
function forget(key) {
  waiting.value = waiting.value.filter((x) => x.key !== key);
  passing.value = null;
}

/** @param {string} key @returns {string} its written value as JSON */
const writtenOf = (key) => JSON.stringify(writtenAt(key.split(".")).written) ?? "";

/** Send edits of a key, with the edits that wait for it. @param {Key} at @param {object[]} edits */
function send(at, edits) {
  const key = at.join(".");
  forget(key);
  const more = waiting.value.filter((x) => key.startsWith(`${x.outer}.`));
  sent = { wish: { key, edits, outer: "" }, more };
  link.edit([...more.flatMap((x) => x.edits), ...edits]);
}

/** Return whether a change of a key applies only to the shown run. @param {Key} key @returns {boolean} */
const isOfRun = (key) => forRun.value && form.in_run.includes(key[0]);

/** Whether the next change is for the shown run alone: also a value that the run has of its own is changed there. */
const goesToRun = computed(() => {
  const key = focused.value;
  return key ? isOfRun(key) || writtenAt(key).from === "run" : forRun.value;
});

/** @param {Key} key @param {any} value */
function set(key, value) {
  send(key, value === "" ? [{ do: "unset", key }] : [...listed(key), { do: "set", key, value, run: isOfRun(key) }]);
}

/** Return edits that list all run layers, before one of them gets its own values; otherwise the others would not run. @param {Key} key @returns {object[]} */
function listed(key) {
  const { written } = writtenAt(READ.split("."));
  if (key.slice(0, 2).join(".") !== READ || key.length < 3 || (written && !Array.isArray(written))) return [];
  const value = Object.fromEntries((written ?? head.value.layers).map((/** @type {string} */ x) => [x, {}]));
  return [{ do: "set", key: READ.split("."), value }];
}

/** List the drawing's layers, each with whether it is run. @returns {[string, boolean][]} */
export function layers() {
  if (!head.value) return [];
  const { written } = writtenAt(READ.split("."));
  const given = written && (Array.isArray(written) ? written : Object.keys(written));
  return head.value.layers.map((/** @type {string} */ name) => [name, !given || given.includes(name)]);
}

/** @param {string} name of a layer @param {boolean} is whether it is to be run */
export function runLayer(name, is) {
  const key = [...READ.split("."), name];
  if (is) set(key, {});
  else unset(key);
}

/** Run a contour that was left out, with its layer. @param {{name: string, layer: string}} contour */
export function runContour({ name, layer }) {
  const { written } = writtenAt(["path", "names"]);
  if (layers().some((x) => x[0] === layer && !x[1])) runLayer(layer, true);
  else if (written) set(["path", "names"], [...written, name]);
}

/** @param {Key} key */
const unset = (key) => send(key, [...listed(key), { do: "unset", key }]);

/**
 * Show a refusal at its field. @param {import("./state.js").Frame} frame
 * @returns {boolean} true if there is such a field
 */
export function refuseAt({ head: { key, sentence, remedies } }) {
  if (!sent) return false;
  const { wish, more } = sent;
  // The edits were refused together, not because of keys around them, so the new edit may be possible alone.
  sent = more.length && !more.some((x) => x.outer.startsWith(`${key}.`)) ? { wish, more: [] } : null;
  if (sent) link.edit(wish.edits);
  if (sent) return true;
  const place = [key, wish.key].find((x) => x && find("#form").querySelector(`[data-key="${CSS.escape(x)}"]`));
  const outer = [key, wish.key.slice(0, wish.key.lastIndexOf("."))].find((x) => x && wish.key.startsWith(`${x}.`) && `${key}.`.startsWith(`${x}.`));
  const isOuter = outer !== undefined && key !== wish.key;
  // The field shows its location, and the newest refusal has the reasons of the waiting edits.
  const said = sentence.replace(/^[\w.-]+: ([\w.-]+: )*/, "").replace(/ \(line \d+\)/, "").replace(/^the key \S*?(\w+) is missing/, (/** @type {string} */ _all, /** @type {string} */ name) => `${words(name)} is required as well`);
  const pointed = pointedOf(wish);
  const refused = { ...wish, place: place ?? wish.key, sentence: said, remedies: pointed ? [[pointed]] : remedies, was: writtenOf(wish.key), outer: isOuter ? outer : "" };
  const others = waiting.value.map((x) => {
    if (isOuter && more.includes(x)) return { ...x, outer, sentence: "" };
    return isOuter && x.outer === outer ? { ...x, sentence: "" } : x;
  });
  if (isOuter || wish.edits.some((x) => isValue(x, wish.key))) [waiting.value, passing.value] = [[...others, refused], null];
  else passing.value = refused;
  requestAnimationFrame(() => document.querySelector("#form .refused")?.scrollIntoView({ block: "nearest" }));
  return place !== undefined;
}

/** Return the edit that writes a refused decimal comma as a point, with the unit of the field; null without such a comma. @param {Wish} wish @returns {any} */
function pointedOf({ key, edits }) {
  const edit = /** @type {any} */ (edits.find((x) => isValue(x, key)));
  const [, whole, decimals, unit] = DECIMAL_COMMA.exec(String(edit?.value)) ?? [];
  if (whole === undefined) return null;
  const value = `${whole}.${decimals} ${unit || (rowAt(key.split("."))?.unit ?? "")}`.trim();
  return { ...edit, value };
}

/** Return whether an edit sets the value of a field. @param {any} edit @param {string} key */
function isValue(edit, key) {
  const isMapping = edit.value !== null && typeof edit.value === "object" && !Array.isArray(edit.value);
  return edit.do === "set" && !edit.insert && !isMapping && [edit.key].flat().join(".") === key;
}

/** After a change of the job, sent edits are done, and waiting edits of keys that were changed elsewhere are forgotten. */
function accept() {
  const made = sent ? [sent.wish, ...sent.more] : [];
  waiting.value = waiting.value.filter((x) => !made.includes(x) && x.was === writtenOf(x.key));
  passing.value = null;
  sent = null;
}

/** @param {string} text */
const words = (text) => text.charAt(0).toUpperCase() + text.slice(1).replaceAll("_", " ");

/** Our words for words of other programs, for the search. */
const SYNONYMS = /** @type {Record<string, string>} */ ({ exclude: "layers", dwell: "pierce", robot: "arm" });

/** @param {Field} f @returns {boolean} true if a search finds its own words */
const isNamed = (f) => {
  const own = ` ${f.name.replaceAll("_", " ")} ${f.name} ${f.label ?? ""} ${f.called ?? ""} ${f.text ?? ""}`.toLowerCase();
  const sought = wanted.value.toLowerCase();
  return own.includes(` ${sought}`) || own.includes(` ${SYNONYMS[sought] ?? sought}`);
};

/** @param {Field} f @returns {boolean} true if a search finds it, or a field in it */
const isFound = (f) => isNamed(f) || [...(f.fields ?? []), ...(f.items ?? []), ...(f.each ? [f.each] : [])].some(isFound);

/** True if a field is written, or usual. @param {Field} f @param {Key} key */
const isSet = (f, key) => writtenAt(key).written !== undefined || Boolean(f.label) || rowAt(key) !== undefined || jointsAt(key).length > 0;

/** @param {{at: Key}} props */
const Refusal = ({ at }) => {
  const sentence = useComputed(() => refusals.value[at.join(".")] ?? "");
  return html`${sentence.value && html`<p class="refused" role="alert">${shownText(sentence.value)}</p>`}`;
};

/** A field with one value, or one for each joint. @param {Props} props */
function Leaf({ f, at, label = f.label ?? f.called ?? f.name }) {
  const joints = useComputed(() => JSON.stringify(jointsAt(at)));
  const all = /** @type {Key[]} */ (JSON.parse(joints.value));
  if (!all.length) return html`<${One} f=${f} at=${at} label=${label} />`;
  return all.map((key) => html`<${One} key=${key} f=${f} at=${key} label=${`${label}, ${rowAt(key)?.joint}`} />`);
}

/** @param {Props} props */
function One({ f, at, label = f.name }) {
  const key = at.join(".");
  // Only fields whose own state differs are rendered again.
  const state = useComputed(() => {
    const [own, whole] = [writtenAt(at), writtenAt(at.slice(0, -1))];
    // A joint has the common value; sharp corners are not a shape in the file.
    if (typeof at.at(-1) === "number" && typeof whole.written !== "object") own.written ??= whole.written;
    if (key === "corners.shape" && typeof (whole.written ?? "") === "string") own.written = f.choices?.[0];
    const edits = /** @type {any[]} */ (waiting.value.find((x) => x.key === key)?.edits);
    return JSON.stringify([own, rowAt(at), head.value.shown[key], edits?.findLast((x) => x.do === "set" && x.key.join(".") === key)?.value, head.value.capped[key]]);
  });
  // Values of external axes are shown in the units of the page, whatever their units in the file.
  const [{ written, from }, row, shown, refused, capped] = JSON.parse(state.value);
  const isEmpty = written === undefined && !row;
  const lengthUnit = row?.unit ?? shown?.unit ?? (isEmpty ? typedUnitOf(f, at) : f.unit) ?? "";
  const place = useRef(/** @type {HTMLElement | null} */ (null));
  const is = written !== undefined ? from : row?.arm ? "arm" : at[1] === "contours" ? "contour" : "default";
  const [mark, where] = FROM[is];
  const isChosen = f.choices && !f.open;
  const given = refused === null && shown ? shown.text : textOf(refused !== null ? refused : key === "arm" ? (written?.name ?? written?.file ?? written) : written);
  const isComputed = typeof row?.value === "number" && (is === "arm" || is === "default" || row.linear);
  // A refused value is shown as it was typed.
  const value = refused !== null ? given : shownField(isComputed ? quantity(Number(row?.value), /** @type {Slider} */ (row)) : given, lengthUnit);
  const id = `set-${key.replace(/[^\w]/g, "-")}`;
  const title = [f.text, where].filter(Boolean).join(" ");
  const name = words(label);
  const more = { id, title, "aria-invalid": String(refused !== null) };
  const escape = (/** @type {KeyboardEvent} */ event) => event.key === "Escape" && forget(key);
  const focus = () => ([help.value, focused.value] = [title, at]);
  const blur = () => {
    unhelp();
    focused.value = null;
  };
  // The written value changes while the field has the focus.
  useLayoutEffect(() => void (place.current?.contains(document.activeElement) && (help.value = title)), [title]);
  // A number that is typed for a prismatic joint has the shown unit; the server reads it.
  const typed = row?.linear ? { ...f, plain: false } : f;
  let control = html`<${Entry} ...${more} value=${value} placeholder=${shownText(hintOf(f, Boolean(row?.linear)))} list=${f.choices && `${id}-known`} send=${(/** @type {string} */ text) => set(at, text === "" ? "" : readAs(typed, typedField(text, lengthUnit)))} />`;
  if (f.choices && !isChosen)
    control = html`${control}<datalist id=${`${id}-known`}>${f.choices.map((x) => html`<option value=${String(x)} />`)}</datalist>`;
  if (f.tick) control = html`<input type="checkbox" ...${more} checked=${written ?? f.default ?? false} onChange=${(/** @type {any} */ e) => set(at, e.target.checked)} />`;
  if (isChosen) {
    const now = written ?? (f.label ? f.default : "") ?? "";
    const none = f.label || f.needed ? [] : [html`<option value="">${words(String(f.default ?? "none"))}</option>`];
    control = html`<select ...${more} value=${String(now)} onChange=${(/** @type {any} */ e) => set(at, e.target.value)}>${none}${f.choices?.filter((x) => !none.length || x !== f.default || x === now).map(
      (x) => html`<option value=${String(x)} selected=${String(x) === String(now)}>${words(String(x))}</option>`,
    )}</select>`;
  }
  const slider = row && typeof row.min === "number" && row.min < row.max ? { ...row, key, label: name.toLowerCase() } : null;
  // A plain number in the file stays a plain number; its unit is shown next to it, also that of a number to be typed.
  const isBare = isEmpty || (value !== "" && value.split(", ").every((/** @type {string} */ x) => isPlain(x)));
  const unit = isBare && refused === null ? shownUnit(lengthUnit) : "";
  return html`<div class="setting" ref=${place} data-key=${key} data-from=${is} onFocusIn=${focus} onFocusOut=${blur} onKeyDown=${escape}>
    <label for=${id} title=${title}>${name}</label>
    <span class="from">${[unit, mark].filter(Boolean).join(" · ")}</span>
    ${(is === "job" || is === "run") && !f.needed && !(isChosen && f.label) && html`<${Without} at=${at} name=${name} />`}
    ${control}
    ${slider && html`<${Range} slider=${slider} at=${at} written=${value} place=${place} />`}
    ${capped && refused === null && html`<${Capped} ...${capped} />`}
    <${Refusal} at=${at} />
  </div>`;
}

/** That a speed is above the job's, with a button that raises the job's. @param {{sentence: string, raised: string | number, text: string}} props */
const Capped = ({ sentence, raised, text }) =>
  html`<p class="capped" role="status">${shownText(sentence)} <button type="button" onClick=${() => link.edit([{ do: "set", key: ["limits", "speed"], value: raised }])}>Raise it to ${shownText(text)}</button></p>`;

/** Return the unit of a number that is typed for a key without a value: on a contour, that of the value for all contours. @param {Field} f @param {Key} at @returns {string | undefined} */
function typedUnitOf(f, at) {
  if (at[1] !== "contours" || f.default === undefined || f.default === null) return f.typed;
  if (isPlain(String(f.default))) return f.unit;
  return /^[-+]?[\d.]+(?:e[-+]?\d+)? (\S.*)$/i.exec(String(f.default))?.[1] ?? f.typed;
}

/** Return what an empty field shows. The examples are those of revolute joints. @param {Field} f @param {boolean} isLinear @returns {string} */
function hintOf(f, isLinear) {
  const example = f.example && !isLinear ? `e.g. ${f.example}` : "";
  return f.default === undefined ? example || (f.needed ? "" : "none") : String(f.default);
}

/** @param {{at: Key, name: string}} props */
const Without = ({ at, name }) =>
  html`<button type="button" class="unset" title="Leave it out of the file again" aria-label=${`Leave ${name.toLowerCase()} out of the file again`} onClick=${() => unset(at)}>↺</button>`;

/** @param {Slider} slider @param {number} value SI @returns {number} */
function positionOf({ min, max, log }, value) {
  const share = log ? Math.log(value / min) / Math.log(max / min) : (value - min) / (max - min);
  return Math.round(STEPS * Math.min(1, Math.max(0, share)));
}

/** Return the value at a position, with three digits in the slider's unit. @param {Slider} slider @param {number} position @returns {number} SI */
function valueAt({ min, max, log, factor }, position) {
  const share = position / STEPS;
  const value = log ? min * (max / min) ** share : min + share * (max - min);
  return Number((Number((value / factor).toPrecision(3)) * factor).toPrecision(12));
}

/** @param {{slider: Slider, at: Key, written: string, place: {current: HTMLElement | null}}} props */
function Range({ slider, at, written, place }) {
  const gesture = useRef(/** @type {Gesture | null} */ (null));
  const slide = (/** @type {any} */ { target, timeStamp }) => {
    gesture.current ??= new Gesture(link);
    const value = valueAt(slider, Number(target.value));
    const field = place.current?.querySelector("input");
    const text = quantity(value, shownSlider(slider));
    if (field) field.value = text;
    target.setAttribute("aria-valuetext", text);
    gesture.current.update([{ do: "set", key: at, value, run: isOfRun(at) }], timeStamp);
  };
  const end = () => {
    gesture.current?.end();
    gesture.current = null;
  };
  const position = typeof slider.value === "number" ? positionOf(slider, slider.value) : STEPS;
  // A document without the newest change must not move the slider back, because the next key starts from there.
  return html`<input type="range" min="0" max=${STEPS} value=${gesture.current || link.change ? undefined : position} data-unset=${String(typeof slider.value !== "number")} aria-label=${`${slider.label}, slider`} aria-valuetext=${written}
    onInput=${slide} onChange=${end} />`;
}

/**
 * A group that the user opens, or that opens because a key in it is written, refused or found. Its content is created when
 * it is open.
 * @param {{at: Key, title: string, text?: string, count: number, told?: string, aside?: any, content: () => any}} props
 */
function Fold({ at, title, text, count, told = " set", aside, content }) {
  const open = useSignal(count > 0);
  const isRefused = Boolean(refusals.value[at.join(".")]);
  const isWritten = count > 0;
  useLayoutEffect(() => {
    if (isWritten || isRefused) open.value = true;
  }, [isWritten, isRefused]);
  const isOpen = open.value || Boolean(wanted.value);
  const fold = html`<details class="part" data-key=${at.join(".")} open=${isOpen} onToggle=${(/** @type {any} */ e) => (open.value = e.target.open)}>
    <summary title=${text}>${words(title)}${count > 0 && html` <small>${count}${told}</small>`}</summary>
    <${Refusal} at=${at} />${isOpen && content()}
  </details>`;
  return aside ? html`<div class="with-usual">${fold}${aside}</div>` : fold;
}

/** Return the value of a part of the process that applies at a contour or layer, or to the whole job. @param {Key} outer @param {string} name @returns {any} */
function appliedAt(outer, name) {
  const { process, path } = head.value.data;
  const layer = outer[1] === "contours" && contour.value ? JSON.parse(contour.value).layer : "";
  const written = [valueIn(head.value.data, outer), path?.layers?.[layer], process?.by_layer?.[layer], process];
  return written.find((x) => x?.[name] !== undefined)?.[name];
}

/**
 * Return the usual values of a part of the process, and the edits that it needs as well: tabs and a pierce need an output,
 * and after a pierce, the process is on along the lead-in, which is an arc in the waste then. `said` names them.
 * @param {Key} at @param {string} name @returns {{values: Record<string, any>, more: object[], said: string[]}}
 */
function usualOf(at, name) {
  const outer = at.slice(0, -1);
  const values = /** @type {Record<string, any>} */ ({ ...USUAL[name] });
  const [more, said] = [/** @type {object[]} */ ([]), /** @type {string[]} */ ([])];
  if (SWITCHED.has(name) && writtenAt(["process", "switch"]).written === undefined) {
    more.push({ do: "set", key: ["process", "switch", "name"], value: OUTPUT });
    said.push(`switch ${OUTPUT}`);
  }
  const lead = appliedAt(outer, "lead_in");
  if (name === "pierce" && lead && !lead[ACTIVE]) {
    more.push({ do: "set", key: [...outer, "lead_in"], value: { ...lead, [ACTIVE]: true, shape: ARC } });
    said.push("arc as lead-in with the process on");
  }
  if (name === "lead_in" && appliedAt(outer, "pierce")) {
    values[ACTIVE] = true;
    values.shape = ARC;
    said.push("with the process on");
  }
  return { values, more, said };
}

/** A button that adds a part of the process with usual values, which it names. @param {{at: Key, name: string}} props */
function AddUsual({ at, name }) {
  const state = useComputed(() => JSON.stringify(usualOf(at, name)));
  const { values, more, said } = JSON.parse(state.value);
  const own = Object.entries(values).filter(([key]) => key !== ACTIVE);
  const text = [...own.map(([key, x]) => `${key} ${shownText(String(x))}`), ...said].join(", ");
  const add = () => send(at, [{ do: "set", key: at, value: values, run: isOfRun(at) }, ...more]);
  return html`<button type="button" class=${said.length ? "usual-values wide" : "usual-values"} aria-label=${`Add ${words(name).toLowerCase()}: ${text}`} onClick=${add}>+ ${text}</button>`;
}

/** A mapping. @param {Props & {more?: any}} props */
function Part({ f, at, label = f.label ?? f.name, more = null }) {
  const count = useComputed(() => {
    const { written } = writtenAt(at);
    return written !== null && typeof written === "object" ? Object.keys(written).length : Number(written !== undefined);
  });
  const fields = (f.fields ?? []).filter((x) => !wanted.value || isNamed(f) || isFound(x));
  const usual = count.value === 0 && f.name in USUAL && html`<${AddUsual} at=${at} name=${f.name} />`;
  const leave = !f.needed && count.value > 0 && html`<p class="acts"><button type="button" onClick=${() => unset(at)}>Remove ${label.replaceAll("_", " ")}</button></p>`;
  return html`<${Fold} at=${at} title=${label} text=${f.text} count=${count.value} aside=${usual} content=${() => html`${more}${fields.map((x) => html`<${Any} key=${x.name} f=${x} at=${[...at, x.name]} />`)}${leave}`} />`;
}

/** @param {Props} props */
function Any({ f, at, label }) {
  const isWhole = useComputed(() => Array.isArray(writtenAt(at).written));
  if (f.items && !f.fields) return html`<${List} f=${f} at=${at} />`;
  if (f.fields && !isWhole.value) return html`<${Part} f=${f} at=${at} label=${label} />`;
  if (f.each?.fields || (f.each && !f.list && !f.choices)) return html`<${Named} f=${f} at=${at} />`;
  return html`<${Leaf} f=${f} at=${at} label=${label} />`;
}

/** Names of one item of a list, where the name of the list has no regular plural. @type {Record<string, string>} */
const SINGULAR = { axes: "axis", analog: "analog output" };

/** A list of mappings. @param {Props} props */
function List({ f, at }) {
  const count = useComputed(() => writtenAt(at).written?.length ?? 0);
  const fields = f.items ?? [];
  const one = SINGULAR[f.name] ?? f.name.replace(/s$/, "");
  // Required keys of an item get an example, which the user changes.
  const first = (/** @type {Field} */ x) => x.choices?.[0] ?? x.example ?? (x.list ? ["100 mm", "100 mm", "100 mm"] : `${one} ${count.value + 1}`);
  const add = () => send(at, [{ do: "set", key: [...at, count.value], insert: true, value: Object.fromEntries(fields.filter((x) => x.needed).map((x) => [x.name, first(x)])) }]);
  const content = () => html`${Array.from({ length: count.value }, (_, k) => html`<${Part} key=${k} f=${{ ...f, fields, needed: false }} at=${[...at, k]} label=${`${one} ${k + 1}`} />`)}
    <p class="acts"><button type="button" onClick=${add}>Add</button></p>`;
  return html`<${Fold} at=${at} title=${f.name} text=${f.text} count=${count.value} told="" content=${content} />`;
}

/** A mapping by name, such as layers. @param {Props} props */
function Named({ f, at }) {
  const key = at.join(".");
  const isOfLayers = key === READ || key === BY_LAYER;
  const state = useComputed(() => JSON.stringify([writtenAt(at).written, isOfLayers ? head.value.layers : []]));
  const [written, layers] = JSON.parse(state.value);
  const added = useSignal(/** @type {string[]} */ ([]));
  const given = Array.isArray(written) ? written : Object.keys(written ?? {});
  const names = [...new Set([...layers, ...given, ...added.value])].map(String);
  const each = f.each ?? f;
  const entry = (/** @type {string} */ name) => {
    if (!each.fields) return html`<${Leaf} key=${name} f=${{ ...each, unit: f.unit, text: f.text }} at=${[...at, name]} label=${name} />`;
    const tick = html`<label class="field"><input type="checkbox" checked=${written === null || given.includes(name)} onChange=${(/** @type {any} */ e) => runLayer(name, e.target.checked)} /> run this layer</label>`;
    return html`<${Part} key=${name} f=${{ ...each, needed: key === READ, text: f.text }} at=${[...at, name]} label=${name} more=${key === READ && tick} />`;
  };
  const add = (/** @type {any} */ event) => {
    event.preventDefault();
    const field = event.target.querySelector("input");
    if (field.value.trim()) added.value = [...added.value, field.value.trim()];
    field.value = "";
  };
  const content = () => html`${names.map(entry)}${!layers.length && html`<form class="acts" onSubmit=${add}><input type="text" aria-label=${`New name of ${words(f.name).toLowerCase()}`} placeholder="name" /><button type="submit">Add</button></form>`}`;
  return html`<${Fold} at=${at} title=${f.name} text=${f.text} count=${given.length} content=${content} />`;
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
  return html`${Object.entries(texts).map(([name, [label, text]]) => html`<div class="setting" data-key=${name === "angle" ? "tilt" : "tilt-towards"} onFocusIn=${() => (help.value = text)} onFocusOut=${unhelp}>
    <label for=${`tilt-${name}`} title=${text}>${label}</label><span class="from">deg</span>
    <${Entry} id=${`tilt-${name}`} title=${tilt.why_not ?? text} disabled=${Boolean(tilt.why_not)} value=${String(Number(tilt[name].toFixed(6)))} send=${(/** @type {string} */ value) => send(["tilt"], [{ do: "tilt", [name]: value }])} />
    ${name === "towards" && (tilt.why_not || tilt.note) && html`<p class="quiet about">${tilt.why_not || tilt.note}</p>`}
    ${name === "angle" && html`<${Refusal} at=${["tilt"]} />`}
  </div>`)}`;
}

/** @param {{title: string, fields: Field[]}} props */
function Group({ title, fields }) {
  const open = useSignal(fields.some((f) => f.usual || f.label));
  const more = useSignal(false);
  const all = everything.value || more.value || Boolean(wanted.value);
  const shown = useComputed(() => {
    const some = fields.filter((f) => isSet(f, /** @type {string} */ (f.at).split(".")));
    return some.map((f) => f.at).join(" ");
  });
  const set = shown.value.split(" ").filter(Boolean);
  // A group without written keys shows all its fields.
  const isWanted = wanted.value && title.toLowerCase().includes(wanted.value.toLowerCase());
  const listed = fields.filter((f) => (wanted.value ? isWanted || isFound(f) : all || !set.length || set.includes(f.at ?? "")));
  if (!listed.length) return null;
  const isOpen = open.value || Boolean(wanted.value);
  const rest = fields.length - listed.length;
  const isTilted = fields.some((f) => f.at === "path.orientation" && (!wanted.value || isWanted || isNamed(f)));
  const toggle = (/** @type {any} */ { target }) => {
    open.value = target.open;
    // Fields stay visible once one of them is written.
    if (target.open && !set.length) more.value = true;
  };
  return html`<details class="group" data-group=${title} open=${isOpen} onToggle=${toggle}>
    <summary>${title}</summary>
    ${isOpen && html`${isTilted && html`<${Tilt} />`}${listed.map((f) => html`<${Any} key=${f.at} f=${f} at=${f.at?.split(".")} label=${f.label} />`)}
      ${rest > 0 && html`<button type="button" class="rest" onClick=${() => (more.value = true)}>${rest} more</button>`}`}
  </details>`;
}

/** The selected contour as JSON, with its key: its name, or its number if others have this name. @param {Store} store */
function contourOf(store) {
  const all = /** @type {any[]} */ (store.latest("picture")?.head.contours ?? []);
  const { number, layer } = all[store.options.contour] ?? {};
  return number && head.value ? JSON.stringify({ number, layer, ...keyOf(all, number) }) : "";
}

/** @param {any[]} all contours @param {number} number @returns {{name: string, key: Key}} */
function keyOf(all, number) {
  // Further passes have other names.
  const name = all.find((x) => x.number === number)?.name;
  const isNamed = name && head.value.data.path.contours?.[number] === undefined && all.every((x) => x.name !== name || x.number === number);
  return { name, key: ["path", "contours", isNamed ? name : number] };
}

/** Set orders of contours, so that one runs at the place of another. @param {any[]} all in the order of the motion @param {number} k @param {number} other */
export function moveContour(all, k, other) {
  const numbers = [...new Set(all.map((x) => x.number))];
  const [from, to] = [k, other].map((i) => numbers.indexOf(all[i]?.number));
  if (to < 0 || from === to) return;
  const keys = numbers.map((x) => [...keyOf(all, x).key, "order"]);
  const orders = keys.map((key) => valueIn(head.value.data, key) ?? 0);
  keys.splice(to, 0, ...keys.splice(from, 1));
  const [low, high] = [Math.min(from, to), Math.max(from, to) + 1];
  // A tour is searched among contours of equal order, so all contours get orders; otherwise only the shorter side does.
  const isTour = ["nearest", "shortest"].includes(head.value.data.process?.order);
  const [begin, end] = isTour ? [0, keys.length] : high < keys.length - low ? [0, high] : [low, keys.length];
  const first = end < keys.length ? orders[end] - high : isTour ? 1 : (orders[low - 1] ?? 0) + 1;
  link.edit([{ do: "order", orders: keys.slice(begin, end).map((key, i) => [key[2], first + i]) }]);
}

/** Fields of the selected contour. */
function Contour() {
  if (!contour.value || wanted.value) return null;
  const { number, name, layer, key } = JSON.parse(contour.value);
  const { process, path } = head.value.data;
  const [speed, tolerance] = [["limits", "speed"], ["corners", "tolerance"]].map((x) => writtenAt(x).written);
  const each = (/** @type {string} */ at) => form.groups.flatMap((/** @type {any} */ x) => x.fields).find((/** @type {Field} */ f) => f.at === at).each.fields;
  const known = /** @type {Field[]} */ ([...each(READ), ...each(BY_LAYER), { name: "order", text: "Contours with smaller numbers run first.", plain: true }]);
  // Values that apply to a contour without its own values, in the shown run.
  const shared = { order: 0, speed, tolerance, ...process, ...process?.by_layer?.[layer], ...path?.layers?.[layer] };
  const field = (/** @type {string} */ label, /** @type {string} */ of) => {
    const f = { .../** @type {Field} */ (known.find((x) => x.name === of)), label, example: "" };
    const at = [...key, of];
    const none = shared[of] && html`<p class="acts"><button type="button" onClick=${() => set(at, null)}>None on this contour</button></p>`;
    return f.fields ? html`<${Part} key=${of} f=${f} at=${at} more=${none} />` : html`<${Leaf} key=${of} f=${{ ...f, default: shared[of] ?? f.default }} at=${at} />`;
  };
  return html`<section key=${number} aria-label="Selected contour"><h3>${`Contour ${number}`}${name && ` · ${name}`}${layer && `, layer ${layer}`}</h3>${Object.entries(OWN).map(([of, label]) => field(label, of))}</section>
    <h3>Whole job</h3>`;
}

/** Refused changes of contours that are not selected, so that their fields do not show them. */
function Elsewhere() {
  const key = contour.value && !wanted.value && side.value === "contours" ? JSON.parse(contour.value).key.join(".") : "";
  const places = Object.keys(refusals.value).filter((x) => x.startsWith(OF_CONTOURS) && !(key && x.startsWith(`${key}.`)));
  return places.map((place) => {
    const [, name, part] = /^(.*?)\.?([^.]*)$/.exec(place.slice(OF_CONTOURS.length)) ?? [];
    return html`<p class="refused" role="alert" data-refused=${place}>Contour ${name}, ${part.replaceAll("_", " ")}: ${refusals.value[place]}</p>`;
  });
}

function Form() {
  const isThere = useComputed(() => Boolean(head.value && Object.keys(head.value.values).length));
  if (!isThere.value) return null;
  const choice = (/** @type {{value: boolean}} */ of, /** @type {boolean} */ is, /** @type {string} */ text, /** @type {string} */ title, /** @type {{value: boolean}} */ now = of) =>
    html`<button type="button" title=${title} aria-pressed=${String(now.value === is)} onClick=${() => (of.value = is)}>${text}</button>`;
  const seek = html`<div class="seek">
      <input type="search" aria-label="Search settings" placeholder="Search settings" value=${wanted} onInput=${(/** @type {any} */ e) => (wanted.value = e.target.value.trim())} />
      <span class="group choice" role="group" aria-label="Settings that are shown">${choice(everything, false, "What is set", "Only what is set or usual")}${choice(everything, true, "All", "All settings of the job")}</span>
      <span class="group choice" role="group" aria-label="Changes are for">${choice(forRun, false, "For job", "Changes are for all runs. A value that the shown run has of its own is changed in this run alone.", goesToRun)}${choice(forRun, true, "For run", "Changes are for the shown run alone", goesToRun)}</span>
    </div>`;
  return html`<${Elsewhere} />${side.value === "contours" && html`<${Contour} />`}${seek}
    ${form.groups.map((/** @type {any} */ x) => (wanted.value || (SIDES[x.title] ?? "process") === side.value) && html`<${Group} key=${x.title} ...${x} />`)}
    ${wanted.value && !form.groups.some((/** @type {any} */ x) => x.title.toLowerCase().includes(wanted.value.toLowerCase()) || x.fields.some(isFound)) && html`<p role="status">No setting matches "${wanted}".</p>`}`;
}

/** Return whether a document shows a run that was added just now: the edits that follow are for it. @param {any} next @returns {boolean} */
function isNewRun(next) {
  const before = head.value;
  return before?.id === next.id && !before.runs.some((/** @type {{name: string}} */ x) => x.name === next.run);
}

/** Fields, cells, formats and endings of jobs. @type {Promise<any>} */
export const known = fetch("/static/form.json").then((answer) => answer.json());

/** @param {Store} store @param {Link} to */
export async function init(store, to) {
  link = to;
  let rev = -1;
  store.on("document", (/** @type {any} */ frame) => {
    if (frame.rev !== rev) {
      rev = frame.rev;
      if (isNewRun(frame.head)) forRun.value = true;
      head.value = frame.head;
      accept();
    }
    head.value = frame.head;
  });
  store.on("reset", () => ([waiting.value, passing.value, wanted.value] = [[], null, ""]));
  form = await known;
  for (const event of ["view", "picture"])
    store.on(event, () => {
      if (side.value !== store.options.side) [help.value, focused.value] = ["", null];
      side.value = store.options.side;
      contour.value = contourOf(store);
    });
  render(html`<${Form} />`, find("#form"));
  render(html`${help}`, find("#hint"));
}
