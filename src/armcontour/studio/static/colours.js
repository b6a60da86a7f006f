// Colours of the page: the palette of Okabe and Ito, for colour-blind readers as in the reports, and
// cividis for heat. What colour tells is always told by a dash or a label too.

/** @typedef {{colour: string, dash: number[], label: string}} Style */

/**
 * How kinds of limits are drawn: kinds as the server groups them.
 * @type {Record<string, {light: string, dark: string, dash: number[], label: string}>}
 */
const KINDS = {
  speed: { light: "#009E73", dark: "#1fbf92", dash: [], label: "assigned speed reached" },
  velocity: { light: "#0072B2", dark: "#4aa3df", dash: [12, 4], label: "joint velocity" },
  acceleration: { light: "#D55E00", dark: "#f07b22", dash: [7, 3], label: "joint acceleration" },
  torque: { light: "#b8578f", dark: "#dd8fbd", dash: [4, 3], label: "joint torque" },
  jerk: { light: "#2a94d0", dark: "#56B4E9", dash: [12, 3, 3, 3], label: "jerk" },
  tool: { light: "#c28500", dark: "#E69F00", dash: [7, 3, 2, 3], label: "tool" },
  corner: { light: "#8f8400", dark: "#F0E442", dash: [2, 2], label: "corner" },
  none: { light: "#1b2024", dark: "#e6e9ec", dash: [], label: "path" },
  other: { light: "#777777", dark: "#999999", dash: [1, 3], label: "nothing binds, or another limit" },
};

/** The runs' colours, as in the reports. */
export const RUN_COLOURS = ["#D55E00", "#0072B2", "#009E73", "#CC79A7", "#E69F00", "#56B4E9"];

/**
 * How a kind of limit is drawn.
 * @param {string} kind @param {"light" | "dark"} theme @returns {Style}
 */
export function styleOf(kind, theme) {
  const style = KINDS[kind] ?? KINDS.other;
  return { colour: style[theme], dash: style.dash, label: style.label };
}

/** Points of cividis at equal steps, dark to bright. */
const CIVIDIS = [
  [0, 34, 78],
  [18, 53, 112],
  [59, 73, 108],
  [87, 93, 109],
  [112, 113, 115],
  [138, 134, 120],
  [165, 156, 116],
  [195, 179, 105],
  [225, 204, 85],
  [254, 232, 56],
];

/**
 * Colour of a share from 0 to 1, as cividis; its darkest part is left out on dark ground, its brightest on light ground.
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

/** Colours of the style sheet by theme and name: reading one makes the browser compute all styles. @type {Map<string, string>} */
const READ = new Map();

/** A colour of the style sheet in the shown theme, such as "--ink". @param {string} name @returns {string} */
export function themed(name) {
  const root = document.documentElement;
  const key = `${root.dataset.theme} ${name}`;
  let found = READ.get(key);
  if (!found) READ.set(key, (found = getComputedStyle(root).getPropertyValue(name).trim()));
  return found;
}
