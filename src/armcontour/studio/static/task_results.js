// Results of tasks: sentences, tables and charts from the headers and arrays of the server.

import { RUN_COLOURS } from "./colours.js";
import { withGaps } from "./chart.js";
import { rowOf, textOf } from "./format.js";

/** @typedef {import("./state.js").Frame} Frame */
/** @typedef {import("./chart.js").Axes} Axes */
/** @typedef {import("./chart.js").Content} Content */
/** @typedef {{title?: string, columns: string[], rows: string[][]}} Table */
/** @typedef {{name: string, axes: Axes, content: Content, time: boolean, along?: boolean}} Graph `time`: whether its x is time; `along`: arc length */
/** @typedef {{sentences: string[], tables?: Table[], graphs?: Graph[]}} Answer */

const KINDS = /** @type {Record<string, string>} */ ({
  environment: "links to obstacles", own: "links to each other", tool: "tool to anything",
});

/**
 * Content of a result.
 * @param {string} task
 * @param {Frame} frame
 * @returns {Answer}
 */
export function answerOf(task, frame) {
  const found = ANSWERS[task]?.(frame) ?? { sentences: [] };
  const notes = [...(frame.head.notes ?? []), ...(frame.head.warnings ?? [])];
  return { ...found, sentences: [...found.sentences, ...notes] };
}

/** @type {Record<string, (frame: Frame) => Answer>} */
const ANSWERS = {
  check: ({ head }) => ({
    sentences: [head.sentence, ...(head.not_judged ?? []).map((/** @type {string} */ x) => `Not judged: ${x}.`)],
    tables: [tableOf("Limits of the plan", head.table)],
  }),
  compare: compareAnswer,
  certify: ({ head }) => ({ sentences: [head.sentence] }),
  export: ({ head }) => ({ sentences: [`${head.points} set-points.`] }),
  report: () => ({ sentences: ["The report is ready."] }),
  clearance: clearanceAnswer,
  identify: ({ head }) => ({ sentences: [head.sentence], tables: tablesOf(head) }),
  learn: ({ head }) => ({ sentences: [], tables: [figuresOf(head), ...tablesOf(head)] }),
};

/** Tables as the terminal prints them. @param {any} head @returns {Table[]} */
const tablesOf = (head) => head.tables.map((/** @type {any} */ { title, cells }) => tableOf(title, cells));

/** @param {any} head @returns {Table} */
const figuresOf = (head) => ({ title: "figures", columns: ["figure", "value"], rows: head.rows.map((/** @type {any} */ x) => [x.label, textOf(x)]) });

/**
 * @param {Frame} frame
 * @returns {Answer}
 */
function compareAnswer({ head, arrays }) {
  const curves = (/** @type {string} */ name) => head.names.map((/** @type {string} */ label, /** @type {number} */ k) => ({
    label, colour: RUN_COLOURS[1 - k], dash: k ? [6, 3] : [], y: withGaps(arrays[`${name}_${k}`], 1000),
  }));
  const axes = { title: "Tool speed along the path", x: "Arc length [mm]", xUnit: "mm", y: "Speed", unit: "mm/s" };
  return {
    sentences: [head.sentence],
    tables: [tableOf("Differences", head.table)],
    graphs: [
      { name: "variants-speed", time: false, along: true, axes, content: { x: arrays.s.map((x) => 1000 * x), curves: curves("speed"), range: [0, 0], summary: head.names.join(" and ") } },
      { name: "variants-error", time: true, axes: { title: "Contour error", x: "Time [s]", xUnit: "s", y: "Error", unit: "mm" }, content: { x: arrays.t, curves: curves("error"), range: [0, 0], summary: head.names.join(" and ") } },
    ],
  };
}

/**
 * @param {Frame} frame
 * @returns {Answer}
 */
function clearanceAnswer({ head, arrays }) {
  const curves = head.kinds.map((/** @type {string} */ kind, /** @type {number} */ k) => ({
    label: KINDS[kind] ?? kind, colour: RUN_COLOURS[k % RUN_COLOURS.length], dash: [[], [9, 3], [3, 3]][k % 3],
    y: withGaps(arrays[kind], 1000),
  }));
  const low = rowOf(head, "low");
  return {
    sentences: [head.sentence],
    graphs: [{
      name: "clearance", time: true,
      axes: { title: "Distance over time", x: "Time [s]", xUnit: "s", y: "Distance", unit: "mm" },
      content: { x: arrays.t, curves, range: [0, 0], summary: low ? `${low.label} ${textOf(low)}` : "" },
    }],
    tables: [tableOf("The nearest pairs", head.table)],
  };
}

/** A table as Python gave it. @param {string} title @param {string[][]} rows the header first @returns {Table} */
function tableOf(title, [columns, ...rows]) {
  return { title, columns, rows };
}
