"use strict";
// plotly.js comes packed, so that a page is a third as large. Figures wait until it is unpacked and
// their section is open, because hidden figures do not know their width.
const plotly = unpack("plotly").then(function (code) {
  const script = document.createElement("script");
  script.textContent = code;
  document.head.append(script);
});
plotly.catch(function () {
  document.body.classList.add("without-figures");
});
const waiting = new Map();
// Height of a legend of two lines [pixels], for which figures have room.
const USUAL_LEGEND = 45;

async function unpack(name) {
  const text = document.getElementById(name).textContent;
  const packed = Uint8Array.from(atob(text), (x) => x.charCodeAt(0));
  const stream = new Blob([packed]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).text();
}

function draw(key, data, layout, config) {
  waiting.set(key, async function (place) {
    place.fullHeight = layout.height;
    layout.template = template;
    // On a narrow page everything else is smaller, too; and a finger scrolls the page.
    if (place.clientWidth < 600) {
      layout.font.size = 11;
      shrinkScenes(layout);
    }
    if (matchMedia("(pointer: coarse)").matches) layout.dragmode = false;
    // The wheel scrolls the page: plotly would take it for scenes.
    place.addEventListener("wheel", (x) => x.stopPropagation(), { capture: true, passive: true });
    await Plotly.newPlot(place, data, layout, config);
    await fit(place);
  });
}

// Draws the figures of what is open, and says so when all are drawn.
async function drawOpen() {
  document.body.removeAttribute("data-drawn");
  await plotly;
  const found = [...waiting.keys()].map((key) => document.getElementById(key));
  await Promise.allSettled(found.filter((x) => x.checkVisibility()).map(function (place) {
    const make = waiting.get(place.id);
    waiting.delete(place.id);
    return make(place);
  }));
  fitBoxes();
  document.body.dataset.drawn = "true";
}

// On a narrow page letters take a larger share of a scene: it is smaller, in every view, so that its
// ticks and titles are not cut off.
function shrinkScenes(part) {
  for (const [name, value] of Object.entries(part)) {
    if (value === null || typeof value !== "object") continue;
    if (!name.endsWith("aspectratio")) shrinkScenes(value);
    else part[name] = { x: value.x * 0.8, y: value.y * 0.8, z: value.z * 0.8 };
  }
}

// A scene is as large as its figure is high: on narrow pages it would be cut off at the sides. And
// a legend of many lines takes no height of the plots above it.
async function fit(place) {
  let height = place.fullHeight;
  const entries = place.querySelector(".legend .scrollbox");
  const below = entries && place.layout.legend.orientation === "h";
  if (below) height += Math.max(0, Math.round(entries.getBBox().height) - USUAL_LEGEND);
  if (place.layout.scene) height = Math.min(height, Math.round(place.clientWidth * 0.8) + 150);
  if (height === place.layout.height) return;
  place.style.height = `${height}px`;
  await Plotly.relayout(place, { height: height });
}

// Fits everything that is seen to the present width of the page.
async function fitPage() {
  const seen = [...document.querySelectorAll(".js-plotly-plot")].filter((x) => x.checkVisibility());
  await Promise.all(seen.map(Plotly.Plots.resize));
  await Promise.all(seen.map(fit));
  fitBoxes();
}

// Only what goes on says so, and is a stop of the Tab key.
function fitBoxes() {
  for (const box of document.querySelectorAll(".scroll")) {
    const on = box.scrollWidth > box.clientWidth + 1 || box.scrollHeight > box.clientHeight + 1;
    box.classList.toggle("wide", on);
    if (on) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
}

// Shows one of several groups of parts.
function choose(selector) {
  selector.closest("details").querySelectorAll(".choice").forEach(function (group, i) {
    group.hidden = i !== selector.selectedIndex;
  });
  drawOpen();
}

// A link to a section opens it.
function openTarget() {
  const target = document.getElementById(decodeURIComponent(location.hash.slice(1)));
  if (!target) return;
  target.open = true;
  target.scrollIntoView();
}

window.addEventListener("load", function () {
  openTarget();
  drawOpen();
});
window.addEventListener("hashchange", openTarget);
document.addEventListener("toggle", drawOpen, { capture: true });
let resized = 0;
window.addEventListener("resize", function () {
  clearTimeout(resized);
  resized = setTimeout(fitPage, 100);
});
