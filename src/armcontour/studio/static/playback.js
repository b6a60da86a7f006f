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
/** How far the arrow keys move [share of the duration]; with Shift ten times as far. */
const STEP = 0.005;
/** While it plays, numbers change so often at most [ms]. */
const PLAYING = 60;
/** Heights of the strip of limits and of the times below it [px], and the least distance of times. */
const [STRIP, TIMES, APART] = [9, 16, 90];

/**
 * Fill the bar of the playback.
 * @param {Store} store
 */
export function init(store) {
  const playback = new Playback(find("#playback"), store);
  const renew = nowAndThen(READING, () => playback.renew());
  for (const event of ["picture", "executed"]) store.on(event, renew);
  store.on("time", () => playback.follow());
  for (const event of ["view", "theme"]) store.on(event, renew);
  new ResizeObserver(renew).observe(find("#playback"));
}

/**
 * Draw the speed over time, and the strip of the limits in their colours.
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

class Playback {
  /**
   * @param {HTMLElement} region
   * @param {Store} store
   */
  constructor(region, store) {
    this.region = region;
    this.store = store;
    /** Time to which it has played [s]. */
    this.played = 0;
    this.rate = 1;
    this.playing = false;
    this.last = 0;
    this.told = 0;
    region.addEventListener("keydown", (event) => this.press(event));
    document.addEventListener("visibilitychange", () => document.hidden && this.pause());
    this.renew();
  }

  get motion() {
    return shownMotion(this.store);
  }

  /** There is another motion, or another choice. */
  renew() {
    const motion = this.motion;
    if (!motion) this.pause();
    if (motion && this.store.time > motion.duration) this.store.setTime(motion.duration);
    this.tell();
    drawSpeed(/** @type {HTMLCanvasElement} */ (this.region.querySelector("canvas")), this.store, motion?.duration ?? 0);
  }

  /** Another time is shown; if it is not the next one, the user has chosen it. */
  follow() {
    if (this.store.time !== this.played) this.pause();
    if (!this.playing) this.tell();
  }

  toggle() {
    if (this.playing) this.pause();
    else this.play();
  }

  play() {
    const motion = this.motion;
    if (!motion || this.playing) return;
    if (this.store.time >= motion.duration) this.store.setTime(0);
    this.playing = true;
    this.last = performance.now();
    this.tell();
    requestAnimationFrame((now) => this.advance(now));
  }

  pause() {
    if (!this.playing) return;
    this.playing = false;
    this.tell();
  }

  /**
   * One frame of the animation.
   * @param {number} now [ms]
   */
  advance(now) {
    const motion = this.motion;
    if (!this.playing || !motion) return;
    const passed = Math.max(0, (now - this.last) / 1000);
    this.last = now;
    const time = this.store.time + passed * this.rate;
    const ends = time >= motion.duration;
    this.played = ends ? motion.duration : time;
    this.store.setTime(this.played);
    if (now - this.told > PLAYING) this.tell();
    if (ends) this.pause();
    else requestAnimationFrame((next) => this.advance(next));
  }

  /**
   * Go to a time.
   * @param {number} t [s]
   */
  scrub(t) {
    this.pause();
    this.store.setTime(Math.min(Math.max(0, t), this.motion?.duration ?? 0));
  }

  /** @param {KeyboardEvent} event */
  press(event) {
    const duration = this.motion?.duration;
    if (!duration || event.ctrlKey || event.metaKey || event.altKey) return;
    const onSlider = event.target instanceof Element && event.target.matches(".scrub");
    const far = STEP * duration * (event.shiftKey ? 10 : 1);
    if (event.key === " " && onSlider) this.toggle();
    else if (onSlider && (event.key === "ArrowRight" || event.key === "ArrowUp")) this.scrub(this.store.time + far);
    else if (onSlider && (event.key === "ArrowLeft" || event.key === "ArrowDown")) this.scrub(this.store.time - far);
    else return;
    event.preventDefault();
  }

  /** Show the state. */
  tell() {
    this.told = performance.now();
    const motion = this.motion;
    const duration = motion?.duration ?? 0;
    const { time, options } = this.store;
    const choice = (/** @type {string} */ name, /** @type {[string, string, boolean?][]} */ all, /** @type {string} */ chosen, /** @type {(value: string) => void} */ choose) =>
      html`<label class="field">${name} <select value=${chosen} onChange=${(/** @type {any} */ e) => choose(e.target.value)}>${all.map(([value, text, isOff]) => html`<option value=${value} disabled=${isOff} selected=${value === chosen}>${text}</option>`)}</select></label>`;
    render(
      html`<div class="controls"><button type="button" class="play" title="Play or pause (Space)" disabled=${!motion} onClick=${() => this.toggle()}>${this.playing ? "Pause" : "Play"}</button>
          <output class="clock">${seconds(time)} / ${seconds(duration)} s</output>
          ${choice("Motion", [["planned", "planned"], ["executed", "executed", !motionOf(this.store, "executed")]], options.time, (x) => this.store.setView({ time: /** @type {Which} */ (x) }))}
          ${choice("Rate", RATES.map((x) => [String(x), `${x}×`]), String(this.rate), (x) => (this.rate = Number(x)))}</div>
        <div class="track"><canvas role="img" aria-label="Tool speed over time, and the limits that determine it" />
          <input type="range" class="scrub" min="0" max=${duration || 1} step="any" value=${time} aria-label="Time" aria-valuetext=${`${seconds(time)} s of ${seconds(duration)} s`} disabled=${!motion} onInput=${(/** @type {any} */ e) => this.scrub(Number(e.target.value))} /></div>`,
      this.region,
    );
    this.region.dataset.state = this.playing ? "playing" : "paused";
    this.region.dataset.time = String(time);
    this.region.dataset.of = motion?.of ?? "none";
  }
}
