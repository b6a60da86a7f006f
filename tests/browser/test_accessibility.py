"""Faults of accessibility, as axe-core finds them, on light and dark pages and on narrow ones."""

from __future__ import annotations

from pathlib import Path

import pytest
from soak.studio_page import Studio

pytestmark = pytest.mark.browser
AXE = (Path(__file__).parent / "axe" / "axe.min.js").read_text(encoding="utf-8")
GRAVE = ("serious", "critical")
TABS = ("charts", "runs", "waypoints", "corners", "tasks", "text", "notes")
RULES = ["wcag2a", "wcag2aa", "wcag21a", "wcag21aa", "wcag22aa", "best-practice"]


def faults(studio: Studio, state: str) -> list[str]:
    """Serious and critical faults of the page as it is now."""
    found = studio.page.evaluate(
        "(rules) => axe.run(document, {runOnly: rules, resultTypes: ['violations']})", RULES
    )
    return [
        f"{state}: {x['id']}: {node['html'][:120]}"
        for x in found["violations"]
        if x["impact"] in GRAVE
        for node in x["nodes"]
    ]


def test_axe_sees_a_fault(browser):
    page = browser.new_page()
    page.set_content("<img src='data:,'><button></button>")
    page.evaluate(AXE)
    found = page.evaluate("() => axe.run(document)")
    assert {"image-alt", "button-name"} <= {x["id"] for x in found["violations"]}
    page.close()


@pytest.mark.parametrize(("colours", "width"), [("light", 1400), ("dark", 1400), ("light", 500)])
def test_the_page_has_no_serious_fault(pages, colours, width):
    studio = pages(colours=colours, size=(width, 900))
    studio.begin()
    studio.wait_for("#view2d[data-tier='2']")
    studio.page.evaluate(AXE)
    found = []
    for tab in TABS:
        studio.tab(tab)
        found += faults(studio, tab)
    if width == 1400:
        studio.find("#viewbar").get_by_role("button", name="Both").click()
        studio.find("#pin").click()
        studio.find("#help-open").click()
        found += faults(studio, "help")
    assert not found, "\n".join(found)
