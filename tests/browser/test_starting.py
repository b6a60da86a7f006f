"""The start page and the pen in a real browser: from a card or a shape to a planned motion."""

import re

import pytest
from playwright.sync_api import expect
from tests.browser.test_journeys import agree
from tools.studio_page import serving

pytestmark = pytest.mark.browser


@pytest.fixture
def started(pages, tmp_path, monkeypatch):
    """A Studio without a file, whose user has opened nothing before; with its folder."""
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    folder = tmp_path / "work"
    folder.mkdir()
    with serving(folder=folder) as server:
        studio = pages(server)
        studio.wait_for("#start[open]")
        yield studio


def take(studio, card, arm="ur5e"):
    """Choose an arm and a card."""
    if not studio.find("#start").is_visible():
        studio.find("#new").click()
    studio.find("#start .arms label").filter(has_text=re.compile(f"^{arm}$")).click()
    with studio.renewing():
        studio.find(f"#start [data-card={card}]").click()
    expect(studio.find("#start")).to_be_hidden()


def draw(studio, begin, end, *, typed=""):
    """Drag on the plane, from the middle of the view [px]."""
    x, y = studio.middle(studio.find("#view2d"))
    mouse = studio.page.mouse
    mouse.move(x + begin[0], y + begin[1])
    mouse.down()
    mouse.move(x + end[0], y + end[1], steps=5)
    if typed:
        studio.page.keyboard.type(typed)
        studio.page.keyboard.press("Enter")
    mouse.up()


def test_the_first_sentence_on_an_empty_plane_is_not_covered(started):
    take(started, "empty")
    hint = started.find(".hint")
    for width, height in ((1440, 900), (820, 1180), (390, 844)):
        started.page.set_viewport_size({"width": width, "height": height})
        started.page.wait_for_timeout(300)
        expect(hint).to_be_visible()
        text = hint.bounding_box()
        for over in started.find("#viewbar button, #viewbar .scales, #legend").all():
            box = over.bounding_box()
            if box is None:
                continue
            is_beside = (
                box["x"] + box["width"] <= text["x"] or text["x"] + text["width"] <= box["x"]
            )
            is_above = (
                box["y"] + box["height"] <= text["y"] or text["y"] + text["height"] <= box["y"]
            )
            assert is_beside or is_above, (width, over.inner_text(), box, text)


def test_a_drawn_rectangle_is_planned_and_moved(started, judge):
    studio = started
    take(studio, "empty")
    text = studio.text
    draw(studio, (-100, 60), (20, -30))
    studio.rest()
    agree(studio, judge(studio, "compensated"))
    # It has whole millimetres, and the handles can be grabbed.
    expect(studio.find("g.handle.waypoint")).to_have_count(5)
    numbers = re.findall(r"to: \[([^,]*) mm, ([^,]*) mm", studio.text)
    assert len(numbers) == 4 and all(float(x) == round(float(x)) for p in numbers for x in p)
    with studio.changing():
        studio.drag(studio.handle("waypoint", 1), (15, 5))
    agree(studio, judge(studio, "compensated"))
    for _ in range(2):
        with studio.renewing():
            studio.find("#undo").click()
    assert studio.text == text
    expect(studio.find(".hint")).to_be_visible()
