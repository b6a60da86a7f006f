// Colours of the page: the palette of Okabe and Ito for colour-blind readers, and
// cividis for values. Dashes or labels repeat the information of every colour.

/** @typedef {{colour: string, dash: number[], label: string}} Style */

/** @typedef {Record<string, {light: string, dark: string, dash: number[], word?: string, mark?: string}>} Looks */
/** Colours, dashes and words, by the same file as in reports. @type {{limits: Looks, verdicts: Looks, runs: string[], cividis: number[][]}} */
const PALETTE = await (await fetch("/static/palette.json")).json();
export const RUN_COLOURS = PALETTE.runs;
/** Colours of cividis at equal steps, from dark to bright. */
const CIVIDIS = PALETTE.cividis;
/** Kind of the parts on which no limit is active. */
export const BETWEEN = "between two limits";

/**
 * Return how a limit kind is drawn; kinds are names of limits in explanations, without a joint.
 * @param {string} kind @param {"light" | "dark"} theme @returns {Style}
 */
export function styleOf(kind, theme) {
  const style = PALETTE.limits[kind] ?? PALETTE.limits.other;
  return { colour: style[theme], dash: style.dash, label: style.word ?? kind };
}

/** Return how a verdict is drawn. @param {boolean} kept @param {"light" | "dark"} theme @returns {{colour: string, mark: string}} */
export function verdictOf(kept, theme) {
  const style = PALETTE.verdicts[kept ? "kept" : "not kept"];
  return { colour: style[theme], mark: style.mark ?? "" };
}

/** The whole allowed value, with room for rounding. */
export const ALL = 1 + 1e-6;

/**
 * Colour of a share from 0 to 1, as cividis; its darkest part is omitted on dark ground, its brightest on light ground.
 * @param {number} share @param {"light" | "dark"} theme @returns {string}
 */
export function heat(share, theme) {
  const within = Math.min(1, Math.max(0, share));
  const at = theme === "dark" ? 0.25 + 0.75 * within : 0.85 * within;
  const place = at * (CIVIDIS.length - 1);
  const i = Math.min(CIVIDIS.length - 2, Math.floor(place));
  const parts = CIVIDIS[i].map((low, k) => Math.round(low + (place - i) * (CIVIDIS[i + 1][k] - low)));
  return `rgb(${parts.join(",")})`;
}

/** Return the colour of a share: as `heat`, but the alarm colour above 1. @param {number} share @param {"light" | "dark"} theme @returns {string} */
export const shadeOf = (share, theme) => (share > ALL ? themed("--alarm") : heat(share, theme));

/** Cache: theme and name -> colour of the style sheet. Reading one makes the browser compute all styles. @type {Map<string, string>} */
const READ = new Map();

/** A colour of the style sheet in the shown theme, such as "--ink". @param {string} name @returns {string} */
export function themed(name) {
  const root = document.documentElement;
  const key = `${root.dataset.theme} ${name}`;
  let found = READ.get(key);
  if (!found) READ.set(key, (found = getComputedStyle(root).getPropertyValue(name).trim()));
  return found;
}
