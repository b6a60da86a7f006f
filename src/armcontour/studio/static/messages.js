// Messages of the server: refusals, notices, failures; and the state of the connection.

import { contactsOf } from "./collision.js";
import { Remedies } from "./components.js";
import { find, make, say } from "./dom.js";
import { hasMotion } from "./figures.js";
import { refuseAt } from "./form.js";
import { Stopped } from "./stopped.js";
import { shownText } from "./units.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./connection.js").Link} Link */

/** Tasks whose progress is shown here: the start, and work on the newest state; with their names in messages. */
const WORK = /** @type {Record<string, string>} */ ({ start: "Starting", "#": "Preview" });
/** Name of the step in which functions are compiled, as in `progress.py`. */
const COMPILING = "compiling, once";
/** The first functions take longer than their share of the compilation, so its time is estimated from this share on. */
const KNOWN_FROM = 0.2;
const SHOWN_FOR = 9000; // ms
const MOST = 4;

/**
 * Show a sentence for a while; it can be closed.
 * @param {string} sentence @param {string} [look] classes: alarm, and a kind that is closed together
 */
export function notify(sentence, look = "notice") {
  const region = find("#messages");
  const text = shownText(sentence);
  const old = [...region.querySelectorAll(".passing")].filter((m) => m.firstChild?.textContent === text);
  old.forEach((m) => m.remove());
  const close = make("button", { type: "button", text: "×", "aria-label": "Close this message", onclick: () => message.remove() });
  const message = make("div", { class: `message passing ${look}` }, [make("span", { text }), close]);
  region.append(message);
  // Lasting messages, such as refusals, stay in their places, also while they are hidden.
  while (region.querySelectorAll(".passing").length > MOST) region.querySelector(".passing")?.remove();
  setTimeout(() => message.remove(), SHOWN_FOR);
}

/** Close alarms that go together. @param {string} kind */
function clear(kind) {
  for (const message of document.querySelectorAll(`.message.${kind}`)) message.remove();
}

/** Show a sentence on what needs a path; it is closed when the first path is shown. @param {string} sentence */
export const tellEarly = (sentence) => notify(sentence, "alarm early");

/** The progress of the compilation, whose time goes on between two reports of the server. */
class Compiling {
  /** @param {(text: string, share: number | null | undefined) => void} show */
  constructor(show) {
    this.showWork = show;
    this.timer = 0;
  }

  /** @param {{share?: number | null, spent?: number, left?: number | null}} report with times [s] */
  show({ share, spent = 0, left }) {
    this.end();
    const begun = performance.now() - 1000 * spent;
    const tell = () => {
      const now = (performance.now() - begun) / 1000;
      const whole = left && (share ?? 0) >= KNOWN_FROM ? spent + left : 0;
      // An estimate that was too short is not told any more.
      const of = whole > now ? ` of about ${Math.ceil(whole)} s` : " s so far";
      this.showWork(`Compiling for the first run on this machine, only this once: ${Math.floor(now)}${of}`, share);
    };
    tell();
    this.timer = setInterval(tell, 1000);
  }

  end() {
    clearInterval(this.timer);
  }
}

/** @param {Store} store @param {Link} link */
export function init(store, link) {
  store.on("picture", () => clear("early"));
  const [refused, work] = ["alarm refusal", "work"].map((name) => make("div", { class: `message ${name}`, hidden: true }));
  find("#messages").append(refused, work);
  const refuse = (sentence = "", rest = "", edits = /** @type {any[]} */ ([]), t = /** @type {number | undefined} */ (undefined)) =>
    render(html`<span>${shownText(sentence)}</span><span class="quiet">${rest}</span>${t !== undefined && html`<button type="button" onClick=${() => store.goTo(t)}>Show its place</button> `}<${Remedies} all=${edits} take=${(/** @type {object[]} */ edits) => link.edit(edits)} />`, refused);
  refuse();
  store.on("refusal", (/** @type {any} */ frame) => {
    // A collision has a box of its own.
    refused.hidden = !frame || contactsOf(store).length > 0;
    document.body.dataset.refused = String(Boolean(frame));
    if (!frame) return;
    refuse(frame.head.sentence, frame.head.tier === 1 && hasMotion(store) ? "The last good motion stays, greyed." : "", frame.head.remedies, hasMotion(store) ? frame.head.at?.t : undefined);
  });
  let task = "";
  const showWork = (/** @type {string} */ text, /** @type {number | null | undefined} */ share) =>
    render(html`<span>${text}</span><progress key=${typeof share} max="1" value=${share ?? undefined} aria-label="Progress" />`, work);
  const compiling = new Compiling(showWork);
  store.on("progress", (/** @type {any} */ { head }) => {
    const { steps = [], share, part, left, state, tier } = head;
    // The progress of the start that ends is not that of a later plan.
    if (!(head.task in WORK) || (state === "done" && head.task !== task)) return;
    task = head.task;
    work.hidden = state === "done";
    if (work.hidden || !steps.includes(COMPILING)) compiling.end();
    if (work.hidden) return;
    if (steps.includes(COMPILING)) return compiling.show(head);
    const name = tier === "exact" ? "Exact figures" : WORK[task];
    const done = part || (share ? `${Math.round(100 * share)} %` : "");
    const how = [`: ${steps.at(-1) ?? "…"}`, done, left ? `about ${Math.ceil(left)} s left` : ""].filter(Boolean).join(", ");
    showWork(name + how, share);
  });
  // A refused job has also started; an outline is shown before the plan.
  for (const event of ["picture", "refusal"])
    store.on(event, (/** @type {any} */ frame) => {
      if (task !== "start" || !frame || frame.head.tier === "outline") return;
      work.hidden = true;
      compiling.end();
    });
  store.on("dropped", (/** @type {any} */ frame) => refuseAt(frame) || notify(`${frame.head.sentence} Nothing was changed.`, "alarm dropped"));
  let rev = -1;
  store.on("document", (/** @type {any} */ frame) => {
    if (frame.rev === rev) return;
    rev = frame.rev;
    clear("dropped");
  });
  store.on("notice", (/** @type {any} */ frame) => notify(frame.head.sentence));
  // Results of a task are shown next to its button.
  store.on("failed", (/** @type {any} */ { head }) => head.id || notify(head.sentence, "alarm"));
  const state = find("#link-state");
  const banner = make("div", { class: "message alarm" });
  /** Element that had the focus before the page became unusable. @type {HTMLElement | null} */
  let focused = null;
  store.on("link", (/** @type {any} */ link) => {
    const gone = link.state === "lost" || link.state === "refused";
    if (gone && !banner.isConnected) focused = /** @type {HTMLElement} */ (document.activeElement);
    if (gone) find("#messages").append(banner);
    else banner.remove();
    const { stopped = false, lost: isChangeLost = false } = link;
    document.body.dataset.stopped = String(stopped);
    render(stopped ? html`<${Stopped} head=${store.document} isChangeLost=${isChangeLost} />` : html`<p>Not connected, so nothing can be changed. ${link.sentence}</p>`, banner);
    for (const region of document.querySelectorAll("#stage, #tool-box, #panel, #playback, #dock, #bar .group, #bar .field, #bar .usual")) region.toggleAttribute("inert", gone);
    if (!gone && document.activeElement === document.body) focused?.focus({ preventScroll: true });
    document.body.dataset.link = link.state;
    document.body.dataset.busy = String(link.busy);
    say(state, { open: "", starting: link.sentence }[/** @type {string} */ (link.state)] ?? "Not connected");
    state.title = link.sentence;
  });
}
