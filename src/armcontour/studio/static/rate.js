// How often something is drawn.

/** Frames drawn in the last second. */
export class Rate {
  constructor() {
    this.all = 0;
    /** When, within the last second [ms]. @type {number[]} */
    this.times = [];
    this.rate = 0;
  }

  count() {
    const now = performance.now();
    this.all += 1;
    this.times.push(now);
    while (now - this.times[0] > 1000) this.times.shift();
    const span = now - this.times[0];
    this.rate = span > 0 ? (1000 * (this.times.length - 1)) / span : 0;
  }
}
