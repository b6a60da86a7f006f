"""Values at the pointer: labels, snapping, typing, one corner or all, obstacles beside the part."""

import re

import pytest
from playwright.sync_api import expect
from tests.browser.test_journeys import agree, label, numbers, points
from tools.studio_page import SQUARE

pytestmark = pytest.mark.browser


def test_j41_alt_snaps_to_a_hundredth_and_keys_snap_as_the_mouse_does(studio):
    handle = studio.handle("waypoint", 2)
    with studio.changing():
        studio.page.keyboard.down("Alt")
        with studio.grabbing(handle) as (x, y):
            studio.page.mouse.move(x + 7, y + 5, steps=3)
        studio.page.keyboard.up("Alt")
    px, py = points(studio)[4:6]
    fine = [round(1e5 * x, 4) for x in (px, py)]
    assert [x % 1 for x in fine] == [0, 0] and any(x % 100 for x in fine)
    handle.focus()
    with studio.changing():
        studio.page.keyboard.press("ArrowRight")
        studio.page.keyboard.press("ArrowRight")
    moved = points(studio)[4:6]
    assert round(1000 * moved[0], 6) % 1 == 0 and 1e-3 <= moved[0] - px <= 3e-3
    # What does not move is not rounded.
    assert moved[1] == py
    with studio.changing():
        studio.page.keyboard.press("Alt+ArrowUp")
    assert points(studio)[5] == pytest.approx(round(1e5 * py) / 1e5 + 1e-5, abs=1e-9)


def test_j47_a_key_starts_from_the_value_that_the_keys_before_it_have_made(studio):
    keys, text = studio.page.keyboard, studio.find("#tab-text textarea")

    def press(*names):
        for name in names:
            keys.press(name)

    def has(pattern):
        expect(text).to_have_value(re.compile(pattern))
        studio.rest()

    with studio.changing():
        studio.type("corners.tolerance", "0.25 mm")
    corner = studio.handle("corner", 0)
    corner.focus()
    # Enter ends a gesture at once, so that the next key comes before any answer.
    press(*["ArrowUp", "Enter"] * 5)
    has(r"tolerance: 0.5 mm")
    # Undo concerns the keys before it, and the next key starts from what it leaves.
    press("ArrowUp", "ArrowUp", "Control+z", "ArrowUp", "Enter")
    has(r"tolerance: 0.55 mm")
    press("Control+z", "Control+z", "ArrowUp", "Enter")
    has(r"tolerance: 0.5 mm")
    for k in range(6):
        studio.handle("corner", k % 2).focus()
        press("ArrowUp")
    press("Enter")
    # Each key of each corner changes all corners.
    has(r"tolerance: 0.8 mm")
    x, y = points(studio)[2:4]
    studio.handle("waypoint", 1).focus()
    press(*["ArrowRight", "Enter"] * 3, *["ArrowUp", "Enter"] * 2)
    has(rf"\[{x + 0.003:g}, {y + 0.002:g}")
    # A corner that cannot use up its tolerance has that of the file.
    with studio.changing():
        studio.type("corners.tolerance", "300 mm")
    corner.focus()
    press("ArrowUp", "Enter")
    has(r"tolerance: 301 mm")
    slider = studio.slider("limits.speed").locator("input[type=range]")
    before = int(slider.input_value())
    slider.focus()
    press(*["ArrowLeft"] * 20)
    studio.rest()
    assert int(slider.input_value()) == pytest.approx(before - 20, abs=1)


def test_j44_an_obstacle_is_set_beside_the_part(studio, judge, tmp_path):
    (tmp_path / "square.yaml").write_text(SQUARE)
    studio.open(tmp_path / "square.yaml")
    studio.rest()
    original = studio.text
    studio.find("#add-obstacle").click()
    dialog = studio.find("#question")
    dialog.get_by_label("Name").fill("clamp")
    dialog.get_by_label("Height").fill("30")
    with studio.changing():
        dialog.get_by_role("button", name="OK").click()
    # It is not on the part, and the arm goes on.
    judgement = judge(studio)
    agree(studio, judgement)
    assert "clamp" in studio.text and "30 mm" in studio.text
    box = studio.find("g.handle.obstacle").bounding_box()
    for k in range(4):
        x, y = studio.middle(studio.handle("waypoint", k))
        inside = box["x"] < x < box["x"] + box["width"] and box["y"] < y < box["y"] + box["height"]
        assert not inside
    with studio.changing():
        with studio.grabbing(studio.find("g.handle.obstacle")) as (x, y):
            studio.page.mouse.move(x + 11, y + 13, steps=4)
            expect(label(studio)).to_contain_text("mm")
    studio.find("g.handle.obstacle").focus()
    studio.page.keyboard.press("F2")
    dialog.get_by_label("Height").fill("45")
    with studio.changing():
        dialog.get_by_role("button", name="OK").click()
    assert "45 mm" in studio.text and "30 mm" not in studio.text
    for _ in range(3):
        with studio.changing():
            studio.find("#undo").click()
    assert studio.text == original


def test_j45_the_part_is_moved_by_a_typed_way(studio, judge):
    studio.find("#viewbar").get_by_role("button", name="Place part").click()
    mover = studio.find("[aria-label='Place of the part']")
    with studio.changing():
        with studio.grabbing(mover) as (x, y):
            studio.page.mouse.move(x + 9, y, steps=2)
            studio.page.keyboard.type("-0.012 0.0035")
            expect(label(studio)).to_contain_text("-0.012 0.0035")
            studio.page.keyboard.press("Enter")
    position = studio.text.partition("position:")[2].partition("]")[0]
    assert "-12 mm" in position and "3.5 mm" in position
    agree(studio, judge(studio))
    turner = studio.find("[aria-label='Turn of the part']")
    with studio.changing():
        with studio.grabbing(turner) as (x, y):
            studio.page.mouse.move(x - 12, y, steps=3)
            expect(label(studio)).to_contain_text("°")
            (turn,) = numbers(label(studio).locator(".value").inner_text())
    assert turn == round(turn) != 0
    assert f"{turn:g} deg" in studio.text.partition("path:")[2].partition("limits:")[0]
    studio.find("#viewbar").get_by_role("button", name="Place part").click()
