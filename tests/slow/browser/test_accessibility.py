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
