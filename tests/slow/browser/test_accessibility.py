"""Accessibility faults on light, dark and narrow pages, as reported by axe-core."""

import pytest
from tests.browser.axe_faults import faults, load_axe

pytestmark = pytest.mark.browser
TABS = ("charts", "runs", "waypoints", "tasks", "text", "notes", "contours")


def test_the_accessibility_checker_reports_a_fault(browser):
    page = browser.new_page()
    page.set_content("<img src='data:,'><button></button>")
    load_axe(page)
    report = page.evaluate("() => axe.run(document)")
    assert {"image-alt", "button-name"} <= {x["id"] for x in report["violations"]}
    page.close()


@pytest.mark.parametrize(("colours", "width"), [("light", 1400), ("dark", 1400), ("light", 500)])
def test_the_studio_page_is_accessible(pages, colours, width):
    studio = pages(colours=colours, size=(width, 900))
    studio.begin()
    studio.wait_for("#view2d[data-tier='2']")
    load_axe(studio.page)
    page_faults = []
    for tab in TABS:
        studio.tab(tab)
        page_faults += [f"{tab}: {x}" for x in faults(studio.page)]
    studio.tab("process")
    studio.find("#panel .seek").get_by_role("button", name="All").click()
    # Fields are made when what they are in is opened.
    while studio.find("#panel details:not([open])").count():
        studio.find("#panel details:not([open])").evaluate_all(
            "all => all.forEach(x => (x.open = true))"
        )
        studio.page.wait_for_timeout(100)
    studio.type("limits.speed", "5 parsecs")
    studio.find("#panel .refused").wait_for()
    page_faults += [f"settings: {x}" for x in faults(studio.page)]
    if width == 1400:
        studio.find("#viewbar").get_by_role("button", name="Both").click()
        studio.find("#help-open").click()
        page_faults += [f"help: {x}" for x in faults(studio.page)]
    assert not page_faults, "\n".join(page_faults)


# Texts that their box cuts, and pairs of texts that share pixels; the bars of a narrow page scroll.
CUT = """() => {
  scrollTo(0, 0);
  const regions = ["bar", "figures", "sides", "viewbar", "legend", "playback", "dock-bar",
    "tab-contours", "tab-notes", "form", "tasks", "messages"];
  const texts = [...document.querySelectorAll(regions.map((x) => `#${x} *`).join())]
    .filter((e) => e.checkVisibility() && !e.closest(".unseen, svg")
      && [...e.childNodes].some((x) => x.nodeType === 3 && x.data.trim()));
  const boxes = texts.map((e) => {
    const range = document.createRange();
    range.selectNodeContents(e);
    return range.getBoundingClientRect();
  });
  const cut = texts.filter((e) => e.tagName !== "OPTION"
    && getComputedStyle(e).overflowX !== "visible"
    && e.scrollWidth > e.clientWidth + 1 && e.clientWidth)
    .map((e) => `cut: ${e.textContent}`);
  texts.forEach((e, i) => texts.slice(0, i).forEach((f, k) => {
    const [a, b] = [boxes[i], boxes[k]];
    const wide = Math.min(a.right, b.right) - Math.max(a.left, b.left);
    const high = Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top);
    if (wide > 1 && high > 4 && !e.contains(f) && !f.contains(e))
      cut.push(`overlap: ${e.textContent} / ${f.textContent}`);
  }));
  texts.forEach((e, i) => {
    if (boxes[i].right > innerWidth + 1 && !e.closest("#bar, #viewbar"))
      cut.push(`outside: ${e.textContent}`);
  });
  return cut;
}"""


@pytest.mark.parametrize("size", [(1440, 900), (1920, 1080), (390, 844)])
def test_the_drawing_has_space_and_no_text_is_truncated(pages, size):
    studio = pages(size=size)
    studio.rest()
    assert studio.page.evaluate(CUT) == []
    for tab in ("notes", "robot", "process", "contours"):
        studio.tab(tab)
        assert studio.page.evaluate(CUT) == [], tab
    studio.find(".contours button").first.click()
    studio.find("#form [data-key$='.tolerance'] input").fill("x")
    studio.page.keyboard.press("Enter")
    studio.find("#form .refused").wait_for()
    assert studio.page.evaluate(CUT) == []
    stage = studio.find("#stage").bounding_box()
    assert stage["height"] >= 600
    playback = studio.find("#playback").bounding_box()
    assert playback["y"] >= stage["y"] + stage["height"] - 1
    assert playback["y"] < studio.find("#dock").bounding_box()["y"]
    # The test finds a text that is cut.
    studio.find("#name").evaluate("e => { e.style.width = '12px' }")
    assert studio.page.evaluate(CUT)
