// The shown part of a motion: times <-> pixels of the timeline.

/** Shortest shown part [s]. */
const SHORTEST = 0.002;
/** Where a time is shown that was outside of the shown part, as a share of this part. */
const LEAD = 0.15;
/** Times that differ by less are the same [s]. */
const SAME = 1e-9;

export class TimeScale {
  constructor() {
    /** Duration of the motion [s]. */
    this.duration = 0;
    /** Width of the timeline [px]. */
    this.width = 1;
    /** First and last shown time [s]. */
    this.begin = 0;
    this.end = 0;
  }

  /** Whether the whole motion is shown. */
  get isWhole() {
    return this.begin <= SAME && this.end >= this.duration - SAME;
  }

  /** Length of the shown part [s]. */
  get span() {
    return this.end - this.begin;
  }

  /** Return where a time is [px]. @param {number} t s */
  xOf(t) {
    return this.span > 0 ? ((t - this.begin) / this.span) * this.width : 0;
  }

  /** Return the time at a place, within the motion [s]. @param {number} x px */
  timeAt(x) {
    return Math.min(this.duration, Math.max(0, this.begin + (x / this.width) * this.span));
  }

  /** Set the duration of the motion: a shown part stays as it is, the whole stays the whole. @param {number} duration s */
  fit(duration) {
    const wasWhole = this.isWhole;
    this.duration = duration;
    if (wasWhole) this.showAll();
    else this.show(this.begin, this.end);
  }

  showAll() {
    this.begin = 0;
    this.end = this.duration;
  }

  /** Show a part, moved into the motion, and not shorter than `SHORTEST`. @param {number} begin s @param {number} end s */
  show(begin, end) {
    const wished = Math.max(end - begin, SHORTEST);
    const span = Math.min(this.duration, wished);
    const middle = (begin + end) / 2;
    this.begin = Math.min(Math.max(0, middle - span / 2), this.duration - span);
    this.end = this.begin + span;
  }

  /** Change the length of the shown part about a time, which stays in place. @param {number} factor above 1: a longer part @param {number} t s */
  zoom(factor, t) {
    const span = Math.min(this.duration, Math.max(SHORTEST, this.span * factor));
    const begin = t - ((t - this.begin) * span) / (this.span || 1);
    this.show(begin, begin + span);
  }

  /** Move the shown part. @param {number} by s */
  shift(by) {
    this.show(this.begin + by, this.end + by);
  }

  /** Move the shown part to a time that is outside of it; returns whether it moved. @param {number} t s @returns {boolean} */
  follow(t) {
    if (t >= this.begin - SAME && t <= this.end + SAME) return false;
    const begin = t - LEAD * this.span;
    this.show(begin, begin + this.span);
    return true;
  }
}
