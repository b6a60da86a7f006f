"""Edges of a CAD model clicked in the 3D view: from the part to a planned seam, and its angle."""

import re

import pytest
from playwright.sync_api import expect
from tests.browser.axe_faults import faults, load_axe
from tests.files.model.conftest import steps

from armcontour.core.yaml_loader import load

__all__ = ["steps"]

pytestmark = pytest.mark.browser
# Places of the grid on which an edge is searched.
PLACES = 24
# Moves the pointer over the 3D view until an edge of a kind is below it, and returns the place.
SEARCH = """([places, word]) => {
  const canvas = document.querySelector("#view3d canvas");
  const box = canvas.getBoundingClientRect();
  const shown = document.querySelector(".edge-box");
  for (let row = 1; row < places; row += 1)
    for (let column = 1; column < places; column += 1) {
      const clientX = box.left + (box.width * column) / places;
      const clientY = box.top + (box.height * row) / places;
      if (document.elementFromPoint(clientX, clientY) !== canvas) continue;
      canvas.dispatchEvent(new PointerEvent("pointermove", { clientX, clientY, bubbles: true }));
      if (shown.dataset.hovered !== "-1" && shown.dataset.kind === word) return [clientX, clientY];
    }
  return null;
}"""


@pytest.fixture
def opened(pages, steps):
    """A page on which a model was opened, by two clicks."""
    studio = pages()
    studio.begin()
    studio.open(steps / "block.step", "ur10e")
    studio.wait(".edge-box", state="ready")
    studio.wait_for("#view3d[data-model='block.step']")
    return studio


def find_edge(studio, kind):
    place = studio.page.evaluate(SEARCH, [PLACES, kind])
    assert place is not None
    return place


def rules_of(studio):
    return load(studio.text, "job")["path"]["edges"]


def test_two_more_clicks_plan_a_contour_and_the_angle_is_dragged_and_typed(opened):
    assert rules_of(opened) == []
    x, y = find_edge(opened, "line")
    opened.page.mouse.click(x, y)
    add = opened.find(".edge-box").get_by_role("button", name="Add")
    with opened.changing():
        add.click()
    (rule,) = rules_of(opened)
    assert list(rule) == ["near"]
    opened.wait(".edge-box", selected="1")
    expect(opened.find("#tab-contours li")).to_have_count(1)
    knob = opened.find(".edge-knob")
    with opened.renewing():
        opened.drag(knob, (60, 25))
    angle = load(opened.text, "job")["path"]["orientation"]["bisector"]["work"]
    assert float(angle.removesuffix(" deg")) % 5 == 0 and angle != "0 deg"
    field = opened.find(".edge-box").get_by_label("Work angle")
    expect(field).to_have_value(angle)
    with opened.changing():
        field.fill("12")
        field.press("Enter")
    assert load(opened.text, "job")["path"]["orientation"]["bisector"]["work"] == "12 deg"
    load_axe(opened.page)
    assert faults(opened.page) == []


def test_all_edges_like_one_are_added_by_one_rule_and_removed_together(opened):
    x, y = find_edge(opened, "circle")
    opened.page.mouse.click(x, y)
    box = opened.find(".edge-box")
    like = box.get_by_role("button", name="like this")
    like.hover()
    expect(opened.find(".edge-like")).to_have_attribute("d", re.compile("M.*M"))
    count = int(like.inner_text().split()[1])
    with opened.renewing():
        like.click()
    (rule,) = rules_of(opened)
    assert rule["kind"] == "circle"
    opened.wait(".edge-box", selected=str(count))
    before = opened.text
    opened.page.keyboard.press("x")
    transparent = box.get_by_role("button", name="Transparent")
    expect(transparent).to_have_attribute("aria-pressed", "true")
    opened.page.mouse.click(x, y)
    with opened.renewing():
        box.get_by_role("button", name=f"Remove all {count}").click()
    assert rules_of(opened) == []
    with opened.renewing():
        opened.find("#undo").click()
    assert opened.text == before


def test_edges_are_found_by_keys_and_a_broken_file_is_a_sentence(opened, tmp_path):
    box = opened.find(".edge-box")
    following = box.get_by_role("button", name="Next edge")
    following.focus()
    opened.page.keyboard.press("Enter")
    opened.wait(".edge-box", picked="0")
    with opened.renewing():
        box.get_by_role("button", name="Add").press("Enter")
    assert len(rules_of(opened)) == 1
    broken = tmp_path / "broken.step"
    broken.write_text("ISO-10303-21;")
    opened.open(broken, "ur10e")
    opened.wait(".edge-box", state="failed")
    expect(box).to_contain_text("incomplete")
