"""Texts of a page that are cut, lie over each other or are out of the page, measured by boxes."""

from __future__ import annotations

from typing import TYPE_CHECKING

if TYPE_CHECKING:
    from playwright.sync_api import Page

# Returns sentences about the faults of all texts that are seen. A text is seen if a point of it is
# hit.
MEASURE = """() => {
  const LEAST = 2;  // px
  const faults = [];
  const texts = [];
  const clipped = /auto|scroll/;
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const said = node.textContent.trim();
    const element = node.parentElement;
    const seen = { visibilityProperty: true, opacityProperty: true };
    if (!said || !element.checkVisibility(seen)) continue;
    if (element.closest(".unseen, .skip, svg, option, datalist, dialog:not([open])")) continue;
    const range = document.createRange();
    range.selectNodeContents(node);
    for (const box of range.getClientRects()) {
      if (box.width < 1 || box.height < 1) continue;
      // Characters are lower than their line.
      const trim = Math.max(0, (box.height - parseFloat(getComputedStyle(element).fontSize)) / 2);
      let [left, right, top, bottom] = [box.left, box.right, box.top + trim, box.bottom - trim];
      let isScrolledAway = false;
      for (let outer = element; outer && outer !== document.body; outer = outer.parentElement) {
        const style = getComputedStyle(outer);
        if (style.position === "fixed") break;
        const isContained = /content|strict|paint/.test(style.contain);
        const isOpen = style.overflowX === "visible" && style.overflowY === "visible";
        if (isOpen && !isContained) continue;
        const frame = outer.getBoundingClientRect();
        // A long name may end with dots, if its element has a title with all of it.
        if (style.textOverflow === "ellipsis" && outer.title) {
          [left, right] = [Math.max(left, frame.left), Math.min(right, frame.right)];
          continue;
        }
        const scrolls = [clipped.test(style.overflowX), clipped.test(style.overflowY)];
        const across = Math.max(frame.left - left, right - frame.right);
        const down = Math.max(frame.top - top, bottom - frame.bottom);
        const isBeside = right <= frame.left || left >= frame.right;
        const isOutside = isBeside || bottom <= frame.top || top >= frame.bottom;
        if (isOutside || (scrolls[1] && down > 0) || (scrolls[0] && across > 0)) {
          isScrolledAway = true;
          break;
        }
        const name = outer.id || outer.className || outer.tagName;
        const by = Math.round(Math.max(across, down));
        if (by > LEAST) faults.push(`cut: ${said.slice(0, 60)} (${by} px in ${name})`);
      }
      if (isScrolledAway) continue;
      const isOut = right > innerWidth + LEAST || left < -LEAST;
      if (isOut) faults.push(`outside: ${said.slice(0, 60)}`);
      texts.push({ said, element, left, right, top, bottom });
    }
  }
  const open = document.querySelector("dialog[open], [popover]:popover-open");
  const layerOf = (element) => element.closest("dialog, [popover], #panel, #hint, .tip");
  for (const [k, a] of texts.entries())
    for (const b of texts.slice(k + 1)) {
      const across = Math.min(a.right, b.right) - Math.max(a.left, b.left);
      const down = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
      if (across <= LEAST || down <= LEAST || a.element === b.element) continue;
      if (layerOf(a.element) !== layerOf(b.element)) continue;
      if (open && !open.contains(a.element)) continue;
      faults.push(`over each other: ${a.said.slice(0, 40)} and ${b.said.slice(0, 40)}`);
    }
  return [...new Set(faults)];
}"""


def text_faults(page: Page) -> list[str]:
    """Sentences about texts that are cut, overlap or are out of the page."""
    return page.evaluate(MEASURE)


def small_targets(page: Page, least: float = 44) -> list[str]:
    """Names of visible buttons, lists of choices and summaries that are lower than `least` px."""
    found = page.evaluate(
        """least => [...document.querySelectorAll("button, select, summary")]
          .filter((x) => x.checkVisibility({ visibilityProperty: true }) && !x.closest(".unseen"))
          .map((x) => [x.ariaLabel || x.textContent.trim(), x.getBoundingClientRect().height])
          .filter(([, height]) => height > 0 && height < least - 0.5)""",
        least,
    )
    return [f"{name}: {height:.0f} px" for name, height in found]
