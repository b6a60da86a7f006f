// Playback: moves the shown time at a chosen rate.

import { styleOf, themed } from "./colours.js";
import { find } from "./dom.js";
import { mm, seconds } from "./format.js";
import { motionOf, shownMotion } from "./motion.js";
import { kindAt, largest } from "./polylines.js";
import { nowAndThen, READING } from "./state.js";
import { roundUp } from "./viewport.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./motion.js").Which} Which */

const RATES = [0.1, 0.25, 0.5, 1, 2, 4];
/** Step of the arrow keys [share of the duration]; with Shift ten times as long. */
const STEP = 0.005;
const WAYS = /** @type {Record<string, number>} */ ({ ArrowRight: 1, ArrowUp: 1, ArrowLeft: -1, ArrowDown: -1 });
/** Minimum time between changes of numbers while the motion plays [ms]. */
const PLAYING = 60;
/** Heights of the limit strip and the time labels below it [px], and the minimum distance between labels. */
const [STRIP, TIMES, APART] = [9, 16, 90];

/**
 * Draw the speed over time, and the strip with the limits in their colours.
 * @param {HTMLCanvasElement} canvas @param {Store} store @param {number} duration [s]
 */
function drawSpeed(canvas, store, duration) {
  const { clientWidth: width, clientHeight: height } = canvas;
  [canvas.width, canvas.height] = [width * devicePixelRatio, height * devicePixelRatio];
  const context = /** @type {CanvasRenderingContext2D} */ (canvas.getContext("2d"));
  context.scale(devicePixelRatio, devicePixelRatio);
  const picture = store.latest("picture");
  const { path_t: t, speed, path_breaks: breaks } = picture?.arrays ?? {};
  if (!picture || !t?.length || !duration) return;
  const base = height - STRIP - TIMES;
  const x = (/** @type {number} */ at) => (at / duration) * width;
  const most = largest(speed);
  const y = (/** @type {number} */ v) => base - (v / most) * (base - 4);
  context.fillStyle = themed("--faint");
  context.fillRect(0, base, width, STRIP);
  const [curve, area] = [new Path2D(), new Path2D()];
  for (let k = 0; k + 1 < breaks.length; k++) {
    const [first, last] = [breaks[k], breaks[k + 1] - 1];
    curve.moveTo(x(t[first]), y(speed[first]));
    area.moveTo(x(t[first]), base);
    area.lineTo(x(t[first]), y(speed[first]));
    for (let i = first; i < last; i++) {
      for (const line of [curve, area]) line.lineTo(x(t[i + 1]), y(speed[i + 1]));
      context.fillStyle = styleOf(kindAt(picture, i), store.theme).colour;
      context.fillRect(x(t[i]), base, x(t[i + 1]) - x(t[i]), STRIP);
    }
    area.lineTo(x(t[last]), base);
  }
  context.fillStyle = themed("--band");
  context.fill(area);
  context.strokeStyle = themed("--executed");
  context.lineWidth = 1.4;
  context.stroke(curve);
  context.fillStyle = themed("--quiet");
  context.font = "11px system-ui, sans-serif";
  context.textAlign = "right";
  // The curve is behind the text.
  context.strokeStyle = themed("--surface");
  context.lineWidth = 4;
  for (const write of ["strokeText", "fillText"]) context[/** @type {"fillText"} */ (write)](`${mm(most, 0)} mm/s`, width - 4, 15);
  context.textAlign = "left";
  const step = roundUp((APART / width) * duration);
  for (let at = 0; x(at) < width - APART / 2; at += step) context.fillText(`${Number(at.toPrecision(6))} s`, x(at) + 1, height - 3);
}

/** A choice of one option. @param {{name: string, all: [string, string, boolean?][], chosen: string, choose: (value: string) => void}} props */
const Choice = ({ name, all, chosen, choose }) => html`<label class="field">${name} <select value=${chosen} onChange=${(/** @type {any} */ e) => choose(e.target.value)}>
  ${all.map(([value, text, isOff]) => html`<option value=${value} disabled=${isOff} selected=${value === chosen}>${text}</option>`)}</select></label>`;

/** @param {Store} store */
export function init(store) {
  const region = find("#playback");
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
  const show = () => {
    shown = performance.now();
    const motion = shownMotion(store);
    const { time, options } = store;
    const [now, end] = [time, motion?.duration ?? 0].map(seconds);
    render(
      html`<div class="controls"><button type="button" class="play" title="Play or pause (Space)" disabled=${!motion} onClick=${() => play(!playing)}>${playing ? "Pause" : "Play"}</button>
          <output class="clock">${now} / ${end} s</output>
          <${Choice} name="Motion" all=${[["planned", "planned"], ["executed", "executed", !motionOf(store, "executed")]]} chosen=${options.time} choose=${(/** @type {Which} */ x) => store.setView({ time: x })} />
          <${Choice} name="Rate" all=${RATES.map((x) => [String(x), `${x}×`])} chosen=${String(rate)} choose=${(/** @type {string} */ x) => (rate = Number(x))} /></div>
        <div class="track"><canvas role="img" aria-label="Tool speed over time, and the limits that determine it" />
          <input type="range" class="scrub" min="0" max=${motion?.duration || 1} step="any" value=${time} aria-label="Time" aria-valuetext=${`${now} s of ${end} s`} disabled=${!motion} onInput=${(/** @type {any} */ e) => scrub(Number(e.target.value))} /></div>`,
      region,
    );
    Object.assign(region.dataset, { state: playing ? "playing" : "paused", time: String(time), of: motion?.of ?? "none" });
  };
  /** Update the controls after another motion or choice. */
  const renew = nowAndThen(READING, () => {
    const motion = shownMotion(store);
    if (!motion) play(false);
    if (motion && store.time > motion.duration) store.setTime(motion.duration);
    show();
    drawSpeed(/** @type {HTMLCanvasElement} */ (region.querySelector("canvas")), store, motion?.duration ?? 0);
  });
  region.addEventListener("keydown", (event) => {
    const duration = shownMotion(store)?.duration;
    const way = WAYS[event.key];
    if (!duration || event.ctrlKey || event.metaKey || event.altKey || !(event.target instanceof Element && event.target.matches(".scrub"))) return;
    if (event.key === " ") play(!playing);
    else if (way) scrub(store.time + way * STEP * duration * (event.shiftKey ? 10 : 1));
    else return;
    event.preventDefault();
  });
  document.addEventListener("visibilitychange", () => document.hidden && play(false));
  // The user chose another time.
  store.on("time", () => {
    if (store.time !== played) play(false);
    if (!playing) show();
  });
  for (const event of ["picture", "executed", "view", "theme"]) store.on(event, renew);
  new ResizeObserver(renew).observe(region);
  show();
}
