// Playback: moves the shown time at a chosen rate, and to places of the motion.

import { find, make } from "./dom.js";
import { seconds } from "./format.js";
import { contourAt, contourBeside, slowestOf, stopBeside } from "./motion_places.js";
import { motionOf, shownMotion } from "./motion.js";
import { nowAndThen, READING } from "./state.js";
import { Timeline } from "./timeline.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./motion.js").Which} Which */

const RATES = [0.1, 0.25, 0.5, 1, 2, 4];
/** Minimum time between changes of numbers while the motion plays [ms]. */
const PLAYING = 60;
/** Space with the width of a digit. */
const FIGURE_SPACE = "\u2007";
/** Places of the motion to which a button and a key go: title, key, and picture of the button. */
const JUMPS = /** @type {Record<string, {title: string, key: string, d: string}>} */ ({
  "contour-before": { title: "Begin of the contour, or the one before", key: "[", d: "M4 3v10M13 3L6 8l7 5z" },
  "contour-after": { title: "Next contour", key: "]", d: "M12 3v10M3 3l7 5-7 5z" },
  "stop-before": { title: "Stop before", key: "{", d: "M14 8H8M10 5L7 8l3 3M2 4.5h3v7H2z" },
  "stop-after": { title: "Next stop", key: "}", d: "M2 8h6M6 5l3 3-3 3M11 4.5h3v7h-3z" },
  slowest: { title: "Slowest place", key: ".", d: "M2 12a6 6 0 1 1 12 0M8 12L4.5 7.5" },
});

/** A choice of one option. @param {{name: string, all: [string, string, boolean?][], chosen: string, choose: (value: string) => void}} props */
const Choice = ({ name, all, chosen, choose }) => html`<select aria-label=${name} title=${name} value=${chosen} onChange=${(/** @type {any} */ e) => choose(e.target.value)}>
  ${all.map(([value, text, isOff]) => html`<option value=${value} disabled=${isOff} selected=${value === chosen}>${text}</option>`)}</select>`;

/** Go to a place of the planned motion; its contour is also selected. @param {Store} store @param {Timeline} timeline that tells of the slowest place @param {string} name of `JUMPS` */
function jump(store, timeline, name) {
  const picture = store.latest("picture");
  if (!picture?.arrays.path_t.length) return;
  const way = name.endsWith("after") ? 1 : -1;
  if (name.startsWith("contour")) {
    const contour = contourBeside(picture, store.time, way);
    if (contour >= 0) store.selectContour(contour);
    return;
  }
  const t = name === "slowest" ? slowestOf(picture) : stopBeside(picture, store.time, way);
  if (t === undefined) return;
  store.goTo(t);
  if (name !== "slowest") return;
  store.setView({ contour: contourAt(picture, t), side: "contours" });
  timeline.tellPlace();
}

/** @param {Store} store */
export function init(store) {
  const region = find("#playback");
  const controls = make("div", { class: "controls" });
  let [rate, playing] = [1, false];
  /** Played time [s]; times of the last frame and the last change of numbers [ms]. */
  let [played, last, shown] = [0, 0, 0];

  /** @param {boolean} on */
  const play = (on) => {
    const motion = shownMotion(store);
    if (on === playing || (on && !motion)) return;
    playing = on;
    last = performance.now();
    played = motion && store.time >= motion.duration && on ? 0 : store.time;
    if (on) store.setTime(played);
    show();
    if (on) requestAnimationFrame(advance);
  };
  /** Draw a frame of the animation. @param {number} now [ms] */
  const advance = (now) => {
    const motion = shownMotion(store);
    if (!playing || !motion) return;
    played = Math.min(motion.duration, store.time + (Math.max(0, now - last) / 1000) * rate);
    last = now;
    store.setTime(played);
    if (now - shown > PLAYING) show();
    if (played >= motion.duration) play(false);
    else requestAnimationFrame(advance);
  };
  /** Go to a time. @param {number} t [s] */
  const scrub = (t) => {
    play(false);
    store.setTime(Math.min(Math.max(0, t), shownMotion(store)?.duration ?? 0));
  };
  const timeline = new Timeline(store, scrub);
  region.append(controls, timeline.element);
  const show = () => {
    shown = performance.now();
    const motion = shownMotion(store);
    const { time, options } = store;
    const end = seconds(motion?.duration ?? 0);
    // It has the width of the longest time, so that nothing beside it moves.
    const now = seconds(time).padStart(end.length, FIGURE_SPACE);
    const rates = RATES.map((x) => /** @type {[string, string]} */ ([String(x), `${x}×`]));
    render(
      html`<button type="button" class="play" title="Play or pause (Space)" disabled=${!motion} onClick=${() => play(!playing)}>${playing ? "Pause" : "Play"}</button>
        <output class="clock">${now} / ${end} s</output>
        <span class="jumps" role="group" aria-label="Go to">${Object.entries(JUMPS).map(([name, { title, key, d }]) => html`<button type="button" data-jump=${name} title=${`${title} (${key})`} aria-label=${title} aria-keyshortcuts=${key} disabled=${!motion} onClick=${() => jump(store, timeline, name)}>
          <svg viewBox="0 0 16 16" aria-hidden="true"><path d=${d} /></svg></button>`)}</span>
        <${Choice} name="Motion" all=${[["both", "both tools"], ["planned", "planned"], ["executed", "executed", !motionOf(store, "executed")]]} chosen=${options.time} choose=${(/** @type {Which} */ x) => store.setView({ time: x })} />
        <${Choice} name="Rate" all=${rates} chosen=${String(rate)} choose=${(/** @type {string} */ x) => (rate = Number(x))} />`,
      controls,
    );
    Object.assign(region.dataset, { state: playing ? "playing" : "paused", time: String(time), of: motion?.of ?? "none" });
  };
  /** Update the controls after another motion or choice. */
  const renew = nowAndThen(READING, () => {
    const motion = shownMotion(store);
    if (!motion) play(false);
    if (motion && store.time > motion.duration) store.setTime(motion.duration);
    show();
    timeline.fit(motion?.duration ?? 0);
  });
  document.addEventListener("visibilitychange", () => document.hidden && play(false));
  // The user chose another time.
  store.on("time", () => {
    if (store.time !== played) play(false);
    if (!playing) show();
    timeline.point();
  });
  for (const event of ["picture", "executed", "view", "theme", "refusal"]) store.on(event, renew);
  show();
}
