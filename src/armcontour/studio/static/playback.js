// Playback: moves the shown time at a chosen rate.

import { find } from "./dom.js";
import { seconds } from "./format.js";
import { motionOf } from "./motion.js";
import { nowAndThen, READING } from "./state.js";
import { html, render } from "./vendor/preact.js";

/** @typedef {import("./state.js").Store} Store */
/** @typedef {import("./motion.js").Which} Which */

const RATES = [0.1, 0.25, 0.5, 1, 2, 4];
/** How far the arrow keys move [share of the duration]; with Shift ten times as far. */
const STEP = 0.005;
/** While it plays, numbers change so often at most [ms]. */
const PLAYING = 60;

/**
 * Fill the bar of the playback.
 * @param {Store} store
 */
export function init(store) {
  const playback = new Playback(find("#playback"), store);
  const renew = nowAndThen(READING, () => playback.renew());
  for (const event of ["picture", "executed"]) store.on(event, renew);
  store.on("time", () => playback.follow());
  store.on("view", () => playback.renew());
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

  /** The shown motion; where the executed one is not there, the planned one. */
  get motion() {
    const which = this.store.options.time;
    return motionOf(this.store, which) ?? motionOf(this.store, "planned");
  }

  /** There is another motion, or another choice. */
  renew() {
    const motion = this.motion;
    if (!motion) this.pause();
    if (motion && this.store.time > motion.duration) this.store.setTime(motion.duration);
    this.tell();
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
      html`<button type="button" class="play" title="Play or pause (Space)" disabled=${!motion} onClick=${() => this.toggle()}>${this.playing ? "Pause" : "Play"}</button>
        <input type="range" class="scrub" min="0" max=${duration || 1} step="any" value=${time} aria-label="Time" aria-valuetext=${`${seconds(time)} s of ${seconds(duration)} s`} disabled=${!motion} onInput=${(/** @type {any} */ e) => this.scrub(Number(e.target.value))} />
        <output class="clock">${seconds(time)} / ${seconds(duration)} s</output>
        ${choice("Motion", [["planned", "planned"], ["executed", "executed", !motionOf(this.store, "executed")]], options.time, (x) => this.store.setView({ time: /** @type {Which} */ (x) }))}
        ${choice("Rate", RATES.map((x) => [String(x), `${x}×`]), String(this.rate), (x) => (this.rate = Number(x)))}`,
      this.region,
    );
    this.region.dataset.state = this.playing ? "playing" : "paused";
    this.region.dataset.time = String(time);
    this.region.dataset.of = motion?.of ?? "none";
  }
}
