"""The start page and the pen, each shape and each key, in a real browser."""

import re

import pytest
from playwright.sync_api import expect
from tests.browser.axe_faults import faults, load_axe
from tests.browser.test_journeys import agree
from tests.browser.test_starting import draw, started, take

__all__ = ["started"]

pytestmark = pytest.mark.browser


def choose(studio, shape):
    """Take the pen."""
    button = studio.find("[aria-label=Pen]").get_by_role("button", name=shape)
    if button.get_attribute("aria-pressed") != "true":
        button.click()


def test_j51_each_shape_is_drawn_to_typed_values_and_goes_on_at_the_end(started, judge):
    studio = started
    take(studio, "empty")
    choose(studio, "Line")
    with studio.renewing():
        draw(studio, (-120, 80), (0, 80), typed="120, 30")
    end = r"120 mm, 30 mm, 0 mm"
    assert re.search(end, studio.text)
    # The next line begins at the end, where it is pressed near by.
    choose(studio, "Arc")
    x, y = studio.middle(studio.handle("waypoint", 1))
    mx, my = studio.middle(studio.find("#view2d"))
    with studio.renewing():
        draw(studio, (x - mx + 3, y - my - 3), (60, -40))
    assert len(re.findall("via:", studio.text)) == 1 and len(re.findall(r"\bto:", studio.text)) == 2
    choose(studio, "Circle")
    with studio.renewing():
        draw(studio, (100, 0), (120, 0), typed="25")
    assert "angle: 360 deg" in studio.text
    studio.rest()
    agree(studio, judge(studio, "compensated"))
    for _ in range(3):
        with studio.renewing():
            studio.find("#undo").click()
    expect(studio.find(".hint")).to_be_visible()
    # By keys alone: the pen has the focus, values, Enter.
    choose(studio, "Rectangle")
    studio.find("rect.pen").focus()
    with studio.changing():
        studio.page.keyboard.type("60x40")
        studio.page.keyboard.press("Enter")
    agree(studio, judge(studio, "compensated"))
    assert len(re.findall(r"\bto:", studio.text)) == 4


@pytest.mark.parametrize(("colours", "width"), [("light", 1400), ("dark", 500)])
def test_j54_the_start_page_has_no_fault(started, pages, colours, width):
    studio = pages(started.server, colours=colours, size=(width, 900))
    studio.wait_for("#start[open]")
    load_axe(studio.page)
    page_faults = faults(studio.page)
    # By keys: an arm is chosen with arrows, a card with Tab and Enter.
    keys = studio.page.keyboard
    assert studio.page.evaluate("() => document.activeElement.value") == "ur5e"
    keys.press("ArrowLeft")
    keys.press("Tab")
    with studio.renewing():
        keys.press("Enter")
    assert "ur10e" in studio.text
    expect(studio.find("rect.pen")).to_be_visible()
    page_faults += faults(studio.page)
    assert not page_faults, "\n".join(page_faults)
