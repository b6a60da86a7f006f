"""Values at the pointer: labels, snapping, typing, one corner or all, obstacles beside the part."""

import re

import pytest
from playwright.sync_api import expect
from tests.browser.test_journeys import agree
from tools.studio_page import SQUARE

pytestmark = pytest.mark.browser
NUMBERS = re.compile(r"[-−+]?\d+(?:\.\d+)?")


def label(studio):
    """The label at the pointer."""
    return studio.find(".at-pointer")


def numbers(text):
    """The numbers of a text."""
    return [float(x.replace("−", "-")) for x in NUMBERS.findall(text)]


def points(studio):
    """The points of the job's path, as the file has them."""
    return numbers(studio.text.partition("points:")[2].partition("limits:")[0])


def test_j40_a_dragged_waypoint_snaps_and_shows_its_gain(studio, judge):
    before, original = studio.figure("duration"), studio.text
    handle = studio.handle("waypoint", 1)
    expect(label(studio)).to_be_hidden()
    with studio.changing():
        with studio.grabbing(handle) as (x, y):
            studio.page.mouse.move(x - 31, y + 17, steps=4)
            expect(label(studio)).to_contain_text("preview")
            shown = label(studio).locator(".value").inner_text()
            gained = label(studio).locator(".better, .worse")
            expect(gained).to_be_visible()
            box, middle = label(studio).bounding_box(), studio.middle(handle)
            assert abs(box["x"] - middle[0]) < 60 and abs(box["y"] - middle[1]) < 60
            studio.wait("body", busy="false")
            (seconds,) = numbers(gained.inner_text())
    expect(label(studio)).to_be_hidden()
    # The file has whole millimetres, which the label has shown in its unit.
    px, py = points(studio)[2:4]
    assert numbers(shown) == [px, py] and "m" in shown.split()
    assert round(1000 * px, 6) % 1 == 0 and round(1000 * py, 6) % 1 == 0
    assert (px, py) != (0.41, 0.15)
    judgement = judge(studio)
    agree(studio, judgement)
    assert judgement.trajectory.duration - before == pytest.approx(seconds, abs=2e-3)
    with studio.changing():
        studio.find("#undo").click()
    assert studio.text == original
    expect(studio.find("#undo")).to_be_disabled()


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


def test_j42_typed_digits_are_exact_and_escape_reverts(studio, judge):
    original = studio.text
    handle = studio.handle("waypoint", 1)
    with studio.changing():
        with studio.grabbing(handle) as (x, y):
            studio.page.mouse.move(x + 20, y, steps=3)
            studio.page.keyboard.type("0.4012, 0.1489")
            expect(label(studio)).to_contain_text("0.4012, 0.1489")
            # The pointer does not take it back.
            studio.page.mouse.move(x + 40, y + 9, steps=3)
            studio.page.keyboard.press("Enter")
    assert points(studio)[2:4] == [0.4012, 0.1489]
    agree(studio, judge(studio))
    with studio.changing():
        studio.page.keyboard.press("Control+z")
    assert studio.text == original
    for first in ("grab", "focus"):
        rev = studio.told("body", "rev")
        if first == "grab":
            with studio.grabbing(handle) as (x, y):
                studio.page.mouse.move(x + 20, y, steps=3)
                studio.page.keyboard.type("0.4")
                studio.page.keyboard.press("Escape")
        else:
            handle.focus()
            studio.page.keyboard.type("0.4")
            expect(label(studio)).to_contain_text("0.4")
            studio.page.keyboard.press("Escape")
        expect(label(studio)).to_be_hidden()
        studio.rest()
        assert studio.text == original and studio.told("body", "rev") == rev
    # By keys alone: a handle that has the focus, digits, Enter.
    corner = studio.handle("corner", 0)
    corner.focus()
    with studio.changing():
        studio.page.keyboard.type("2.35")
        studio.page.keyboard.press("Enter")
    assert "2.35 mm" in studio.text
    agree(studio, judge(studio))


def test_j46_an_arrow_key_moves_a_small_tolerance_by_a_part_of_it(studio):
    with studio.changing():
        studio.type("corners.tolerance", "0.25 mm")
    studio.rest()
    corner = studio.handle("corner", 0)
    for key, value in (("ArrowUp", 0.3), ("ArrowDown", 0.25), ("Alt+ArrowUp", 0.2505)):
        corner.focus()
        with studio.changing():
            studio.page.keyboard.press(key)
        assert f"tolerance: {value:g} mm" in studio.text
        studio.rest()


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


def test_j43_a_diamond_changes_the_tolerance_of_all_corners(studio, judge):
    with studio.changing():
        with studio.grabbing(studio.handle("corner", 0)) as (x, y):
            studio.page.mouse.move(x - 9, y, steps=4)
            expect(label(studio)).to_contain_text("all corners")
            (value,) = numbers(label(studio).locator(".value").inner_text())
    assert f"tolerance: {value:g} mm" in studio.text
    agree(studio, judge(studio))


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
