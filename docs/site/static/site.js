// What is wider than the page scrolls in a box of its own; whoever has no mouse gets there by the tab key.
"use strict";

const BOXES = ".table-wrapper, .math-wrapper, .math, .highlight pre";

function reach() {
  for (const box of document.querySelectorAll(BOXES)) {
    if (box.scrollWidth > box.clientWidth) box.tabIndex = 0;
    else box.removeAttribute("tabindex");
  }
}

reach();
new ResizeObserver(reach).observe(document.body);
