"use strict";
// Code and data of figures are packed. Figures are drawn when their section is opened, because
// hidden figures do not know their width.
const FONT = "12px system-ui, sans-serif";
const AXIS = { font: FONT, labelFont: FONT, stroke: "#222", grid: { stroke: "#e4e4e4", width: 1 }, ticks: { stroke: "#444", width: 1, size: 4 } };
const loaded = document.getElementById("packed-figures") ? load() : Promise.resolve(null);
loaded.catch(() => document.body.classList.add("without-figures"));
const drawn = new Map();
// Module and data that draw figures, when they are loaded.
let library = null;
let viewerCode = null;
delayLoad();

// A browser that prints a page at once waits for the event `load`: a chain of images delays it until the figures can be drawn.
function delayLoad() {
  let isLoaded = false;
  loaded.then((x) => { library = x; }, () => {}).finally(() => { isLoaded = true; });
  const next = () => {
    if (isLoaded) return;
    const image = new Image();
    image.onload = image.onerror = next;
    image.src = "data:image/gif;base64,R0lGODlhAQABAAAAACH5BAEKAAEALAAAAAABAAEAAAICTAEAOw==";
  };
  next();
}

function unpack(name) {
  const packed = Uint8Array.from(atob(document.getElementById(`packed-${name}`).textContent), (x) => x.charCodeAt(0));
  return new Response(new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip")));
}

// Address of a packed module; `others` are the addresses of the modules that it imports.
async function addressOf(name, others = {}) {
  let code = await unpack(name).text();
  for (const [path, address] of Object.entries(others)) code = code.replace(`"${path}"`, `"${address}"`);
  return URL.createObjectURL(new Blob([code], { type: "text/javascript" }));
}

async function load() {
  const [{ default: uPlot }, figures] = await Promise.all([import(await addressOf("uplot")), unpack("figures").json()]);
  return { uPlot, figures };
}

async function loadViewer() {
  const three = { "./vendor/three.js": await addressOf("three") };
  const viewer = await addressOf("viewer", { ...three, "./framing.js": await addressOf("framing"), "./kinematics.js": await addressOf("kinematics", three) });
  return { ...(await import(viewer)), ...(await import(await addressOf("message_frame"))) };
}

// Draw the figures of open sections, and report when all are drawn.
async function drawOpen() {
  document.body.removeAttribute("data-drawn");
  library = await loaded.catch(() => null);
  drawPlots();
  document.querySelectorAll("svg.drawing").forEach(keepMarks);
  fitBoxes();
  document.body.dataset.drawn = "true";
  // Arms are last, because their code is the largest.
  for (const figure of document.querySelectorAll(".moving:not([data-shown])")) if (figure.checkVisibility()) showArm(figure);
}

function drawPlots() {
  for (const box of library ? document.querySelectorAll(".plots") : []) {
    if (box.checkVisibility() && !drawn.has(box)) draw(box, library.figures[box.id], library.uPlot);
  }
}

// On paper, all sections and all choices are open, and their figures fit the paper.
let closed = [];
function preparePaper() {
  closed = [...document.querySelectorAll("details:not([open]), .choice[hidden]")];
  closed.forEach((x) => (x.tagName === "DETAILS" ? (x.open = true) : (x.hidden = false)));
  document.body.classList.add("paper");
  drawPlots();
  fitPage();
}

function leavePaper() {
  closed.forEach((x) => (x.tagName === "DETAILS" ? (x.open = false) : (x.hidden = true)));
  document.body.classList.remove("paper");
  fitPage();
}

// Longest time in which an arm shows its motion [s]; longer motions are shown faster.
const LONGEST = 30;
const DARK = matchMedia("(prefers-color-scheme: dark)");

async function showArm(figure) {
  figure.dataset.shown = "";
  const [space, player] = [".space", ".player"].map((x) => figure.querySelector(x));
  try {
    viewerCode ??= loadViewer();
    const { createViewer, rendererName, unpack: frameOf } = await viewerCode;
    if (rendererName() === null) throw new Error("no WebGL");
    const [arm, motion] = await Promise.all(["arm", "motion"].map(async (x) => frameOf(await unpack(`${figure.id}-${x}`).arrayBuffer())));
    player.hidden = space.hidden = false;
    const viewer = createViewer(space, arm, "light");
    player.append(viewer.bar);
    const paint = () => {
      const theme = DARK.matches ? "dark" : "light";
      viewer.setTheme(theme);
      viewer.setPath(motion.head.lines.map((x) => ({ points: motion.arrays[x.points], breaks: motion.arrays[x.breaks], colours: () => x[theme] })));
    };
    paint();
    DARK.addEventListener("change", paint);
    viewer.mark(motion.head.nearest?.points ?? null, null);
    enablePlayer(player, motion.arrays, viewer);
    viewer.look("Cell");
  } catch (error) {
    console.error(error);
    player.hidden = space.hidden = true;
    figure.querySelector(".trouble").hidden = false;
  }
}

// Slider and button that show the postures of a motion.
function enablePlayer(player, { t: times, q }, viewer) {
  const [button, slider, clock] = [".play", "input", ".clock"].map((x) => player.querySelector(x));
  const [end, count] = [times[times.length - 1], q.length / times.length];
  const rate = Math.max(1, end / LONGEST);
  const show = (t) => {
    const k = Math.min(times.length - 2, Math.max(0, times.findIndex((x) => x > t) - 1));
    const share = (t - times[k]) / (times[k + 1] - times[k]);
    viewer.setJoints(Array.from({ length: count }, (_, j) => q[count * k + j] + share * (q[count * (k + 1) + j] - q[count * k + j])));
    slider.value = t;
    slider.ariaValueText = clock.textContent = `${short(t)} of ${short(end)} s`;
  };
  let last = null;
  const step = (now) => {
    if (last === null) return;
    show(Math.min(end, slider.valueAsNumber + ((now - last) / 1000) * rate));
    last = now;
    if (slider.valueAsNumber >= end) play(false);
    else requestAnimationFrame(step);
  };
  const play = (on) => {
    button.textContent = on ? "Pause" : "Play";
    last = on ? performance.now() : null;
    if (on) requestAnimationFrame(step);
  };
  slider.max = end;
  slider.addEventListener("input", () => show(slider.valueAsNumber));
  button.addEventListener("click", () => {
    if (last === null && slider.valueAsNumber >= end) show(0);
    play(last === null);
  });
  button.title = rate > 1 ? `${short(rate)} times faster than real` : "in real time";
  show(0);
}

function draw(box, { plots, columns }, uPlot) {
  const tip = document.createElement("div");
  tip.className = "tip";
  const last = plots.length - columns;
  // All plots have the same range, so that times are below each other.
  const xs = plots.flatMap((plot) => [...plot.x.flat(), ...plot.bars.flatMap((bar) => bar.slice(0, 2))]);
  const ends = [xs.reduce((a, b) => Math.min(a, b)), xs.reduce((a, b) => Math.max(a, b))];
  drawn.set(box, plots.map((plot, k) => {
    const place = document.createElement("div");
    box.append(place);
    const u = new uPlot(optionsOf(plot, place.clientWidth, { key: box.id, bottom: k >= last, narrow: columns > 1, tip }), dataOf(plot, ends, uPlot), place);
    lowest.set(u, Math.min(u.height, u.height - plot.height + PADDING + LETTER * plot.label.length));
    return u;
  }));
  box.append(tip);
  fillKeys(box, plots);
}

function dataOf(plot, ends, uPlot) {
  if (plot.bars.length) return [ends, [null, null]];
  return uPlot.join([...plot.curves.map((x) => [plot.x[x.x], x.y]), [ends]]);
}

function optionsOf(plot, width, { key, bottom, narrow, tip }) {
  const isBars = plot.bars.length > 0;
  const limits = isBars ? [Math.max(1, plot.rows.length), 0] : plot.limits;
  const values = (u, ticks) => ticks.map((x) => (x === null ? "" : short(x)));
  return {
    width,
    height: plot.height + (bottom ? 42 : 12),
    legend: { show: false },
    padding: [PADDING, 12, bottom ? 0 : 2, 0],
    cursor: { sync: { key, scales: ["x", null] }, drag: { x: true, y: false }, y: false, points: { size: 6 } },
    scales: { x: { time: false }, y: { distr: plot.logarithmic ? 3 : 1, ...(limits && { range: (u, ...all) => (u.showsAll ? all : limits) }) } },
    axes: [
      { ...AXIS, size: bottom ? 24 : 4, label: bottom ? plot.x_label : undefined, labelSize: 18, values: bottom ? values : () => [], ...(plot.counts && { incrs: [1, 2, 5, 10, 20, 50, 100] }), ...(isBars && { grid: { show: false } }) },
      {
        ...AXIS, label: plot.label, labelSize: 16, size: 52, values,
        ...(narrow && { space: 18 }),
        ...(isBars && { grid: { show: false }, ticks: { show: false }, splits: () => plot.rows.map((_, k) => k + 0.5), values: () => plot.rows }),
      },
    ],
    series: [{}, ...(isBars ? [{}] : plot.curves).map((x) => ({ label: x.name, stroke: x.colour, width: x.width, dash: x.dash, points: { show: Boolean(x.marked), size: 9, fill: x.colour } }))],
    hooks: {
      // A double click also shows values outside the vertical axis.
      ready: [(u) => isBars || u.over.addEventListener("dblclick", () => { u.showsAll = !u.showsAll; u.setScale("x", { min: null, max: null }); }, true)],
      drawClear: [(u) => paint(u, plot)],
      setCursor: [(u) => showValues(u, plot, tip)],
    },
  };
}

// Bars, and lines of limits.
function paint(u, plot) {
  const { ctx, bbox } = u;
  ctx.save();
  for (const [start, end, row, , , colour] of plot.bars) {
    const [left, right] = [start, end].map((x) => Math.min(bbox.left + bbox.width, Math.max(bbox.left, u.valToPos(x, "x", true))));
    const [top, bottom] = [row + 0.05, row + 0.95].map((y) => u.valToPos(y, "y", true));
    ctx.fillStyle = colour;
    ctx.fillRect(left, top, right - left, bottom - top);
  }
  ctx.fillStyle = "#000";
  for (const y of plot.lines) ctx.fillRect(bbox.left, Math.round(u.valToPos(y, "y", true)), bbox.width, devicePixelRatio);
  ctx.restore();
}

// Values under the pointer.
function showValues(u, plot, tip) {
  if (!u.over.matches(":hover")) return;
  const { left, top, idxs } = u.cursor;
  tip.hidden = left < 0;
  const x = u.posToVal(left, "x");
  const row = Math.floor(u.posToVal(top, "y"));
  const bar = plot.bars.find((b) => b[0] <= x && x <= b[1] && b[2] === row);
  const lines = bar ? [[bar[5], `${bar[4]}: ${short(bar[0])} to ${short(bar[1])} s`]] : [];
  plot.curves.forEach((curve, k) => {
    const y = u.data[k + 1][idxs?.[k + 1]];
    if (u.series[k + 1].show && typeof y === "number") lines.push([curve.colour, `${curve.name}: ${plot.also ? `${small(y)} % (${small(y * plot.also[0])} ${plot.also[1]})` : short(y)}`]);
  });
  tip.replaceChildren(`${plot.x_label.replace(/ \[.*/, "")} ${short(x)}`, ...lines.map(([colour, text]) => keyOf("div", colour, text)));
  const [inside, over] = [tip.parentElement, u.over].map((e) => e.getBoundingClientRect());
  const at = over.left - inside.left + left;
  tip.style.left = `${at + 14 + tip.offsetWidth > inside.width ? Math.max(0, at - tip.offsetWidth - 14) : at + 14}px`;
  tip.style.top = `${over.top - inside.top + 4}px`;
}

// Four significant digits, without zeros at the end.
const short = (x) => (Math.abs(x) >= 1e4 ? x.toFixed(0) : String(Number(x.toPrecision(4))));

const small = (x) => (x > 0 && x < 1e-3 ? "< 0.001" : short(x));

// Shorter dashes are dots in a legend [px].
const DOT = 3;

function keyOf(tag, colour, text, dash = []) {
  const key = document.createElement(tag);
  const line = document.createElement("i");
  line.className = "swatch";
  const look = dash.length === 0 ? "solid" : dash[0] > DOT ? "dashed" : "dotted";
  line.style.cssText = `--colour:${colour};--stroke:${look}`;
  key.append(line, text);
  return key;
}

// Legend of a figure; its buttons hide and show curves.
function fillKeys(box, plots) {
  const entries = new Map();
  for (const { curves, bars } of plots) {
    for (const { name, colour, dash } of curves) entries.set(name, keyOf("button", colour, name, dash));
    for (const [, , , kind, , colour] of bars) entries.set(kind, keyOf("span", colour, kind));
  }
  for (const [name, key] of entries) {
    if (key.tagName === "BUTTON") key.ariaPressed = "true";
    key.addEventListener("click", () => {
      const show = key.ariaPressed !== "true";
      key.ariaPressed = String(show);
      for (const u of drawn.get(box)) u.series.forEach((x, i) => i && x.label === name && u.setSeries(i, { show }));
    });
    const entry = document.createElement("li");
    entry.append(key);
    box.closest("figure").querySelector(".keys").append(entry);
  }
}

// Width of a letter in the title of an axis, and padding above a plot [px].
const [LETTER, PADDING] = [6.6, 10];
// Smallest height of each plot [px], at which the title of its axis fits.
const lowest = new Map();
// Share of its height that a wide plot has on paper, so that it fits below the section before it.
const ON_PAPER = 0.72;
// Heights of plots on the screen [px].
const heights = new Map();

// Fit everything visible to the width of the page.
function fitPage() {
  const onPaper = document.body.classList.contains("paper");
  for (const [box, plots] of drawn) {
    if (!box.checkVisibility()) continue;
    const share = onPaper && box.style.getPropertyValue("--columns") === "1" ? ON_PAPER : 1;
    for (const u of plots) {
      if (!heights.has(u)) heights.set(u, u.height);
      u.setSize({ width: u.root.parentElement.clientWidth, height: Math.round(Math.max(share * heights.get(u), lowest.get(u))) });
    }
  }
  document.querySelectorAll("svg.drawing").forEach(keepMarks);
  fitBoxes();
}

// Only scrollable elements are marked so, and get a stop for the Tab key.
function fitBoxes() {
  for (const box of document.querySelectorAll(".scroll")) {
    const on = box.scrollWidth > box.clientWidth + 1 || box.scrollHeight > box.clientHeight + 1;
    box.classList.toggle("wide", on);
    if (on) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
}

// Show one of several groups.
function choose(selector) {
  selector.closest("details").querySelectorAll(".choice").forEach(function (group, i) {
    group.hidden = i !== selector.selectedIndex;
  });
  drawOpen();
}

// Drawings: a dragged rectangle is enlarged, a double click shows all, and marks keep their size.
function zoom(svg, box) {
  const whole = svg.dataset.whole.split(" ").map(Number);
  svg.setAttribute("viewBox", (box ?? whole).join(" "));
  keepMarks(svg);
}

// Marks and letters have the same size at every width and zoom.
function keepMarks(svg) {
  if (svg.checkVisibility()) svg.style.setProperty("--inverse", 1 / svg.getScreenCTM().a);
}

function enableZoom(svg) {
  svg.dataset.whole = svg.getAttribute("viewBox");
  keepMarks(svg);
  const at = (event) => new DOMPoint(event.clientX, event.clientY).matrixTransform(svg.getScreenCTM().inverse());
  const frame = document.createElementNS("http://www.w3.org/2000/svg", "rect");
  frame.setAttribute("class", "frame");
  let from = null;
  const box = (to) => [Math.min(from.x, to.x), Math.min(from.y, to.y), Math.abs(to.x - from.x), Math.abs(to.y - from.y)];
  svg.addEventListener("pointerdown", (event) => {
    if (event.pointerType === "touch" || event.button) return;
    from = at(event);
    svg.setPointerCapture(event.pointerId);
  });
  svg.addEventListener("pointermove", (event) => {
    const to = at(event);
    const words = event.target.querySelector?.("title")?.textContent ?? "";
    const [x, y, size] = (svg.dataset.mm ?? "").split(" ").map(Number);
    const height = Number(svg.dataset.whole.split(" ")[3]);
    const place = svg.dataset.mm ? `x ${(x + to.x * size).toFixed(2)}, y ${(y + (height - to.y) * size).toFixed(2)} mm ` : "";
    const output = svg.parentElement.querySelector("output");
    if (output) output.textContent = place + words;
    if (!from) return;
    svg.append(frame);
    box(to).forEach((value, i) => frame.setAttribute(["x", "y", "width", "height"][i], value));
  });
  svg.addEventListener("pointerup", (event) => {
    if (!from) return;
    const chosen = box(at(event));
    from = null;
    frame.remove();
    const [, , width] = svg.getAttribute("viewBox").split(" ").map(Number);
    if (Math.max(chosen[2], chosen[3]) > width / 50) zoom(svg, chosen);
  });
  svg.addEventListener("dblclick", () => zoom(svg));
}

// Enlarge a drawing around the place to which a link leads.
function showPlace(place) {
  const svg = place.closest("svg");
  const [, , width, height] = svg.dataset.whole.split(" ").map(Number);
  const size = Math.min(Number(place.dataset.window), width);
  const tall = (size * height) / width;
  zoom(svg, [place.cx.baseVal.value - size / 2, place.cy.baseVal.value - tall / 2, size, tall]);
  svg.parentElement.querySelector("output").textContent = place.querySelector("title").textContent;
}

// A link to a section opens it, and one to a place in a drawing shows this place.
function openTarget() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!target) return;
  if (target.tagName === "DETAILS") target.open = true;
  if (target.matches(".place")) showPlace(target);
  (target.closest("figure") ?? target).scrollIntoView({ block: "nearest" });
}

window.addEventListener("load", () => {
  document.querySelectorAll("svg.drawing").forEach(enableZoom);
  openTarget();
  drawOpen();
});
// A link that was followed before shows its place again.
document.addEventListener("click", (event) => {
  if (event.target.closest?.("a")?.hash === location.hash) openTarget();
});
window.addEventListener("hashchange", openTarget);
document.addEventListener("toggle", drawOpen, { capture: true });
window.addEventListener("beforeprint", preparePaper);
for (const button of document.querySelectorAll("header .print")) {
  button.hidden = false;
  button.addEventListener("click", () => print());
}
window.addEventListener("afterprint", leavePaper);
let resized = 0;
window.addEventListener("resize", () => {
  clearTimeout(resized);
  resized = setTimeout(fitPage, 100);
});
