"""The timeline: going to times and places, zooming, and the executed tool as a ghost."""

import re

import numpy as np
import pytest
from playwright.sync_api import expect
from tests.browser.axe_faults import faults, load_axe
from tools.studio_page import TWO_FRAMES, serving, write_job, write_shapes

from armcontour.core.yaml_loader import load

pytestmark = pytest.mark.browser
TRACK = "#playback .track"
# Two pixels of the timeline are the accuracy of a click.
PIXELS = 2
CONTOURS = 3


@pytest.fixture(scope="module")
def shapes(tmp_path_factory):
    """A circle, a square and an ellipse."""
    return write_shapes(tmp_path_factory.mktemp("shapes") / "shapes.dxf", CONTOURS, 3, 60.0, 20.0)


@pytest.fixture(scope="module")
def server(shapes):
    with serving(shapes, "--cell", "pmk3s", folder=shapes.parent) as address:
        yield address


@pytest.fixture
def studio(page):
    """The page with the whole motion, at its begin."""
    page.wait("#figures", exact="true")
    page.find(".scrub").dblclick(position={"x": 5, "y": 5})
    expect(page.find(f"{TRACK} .whole")).to_be_hidden()
    page.page.mouse.move(5, 5)
    page.page.keyboard.press("Home")
    page.wait("#playback", time="0")
    return page


def part_of(studio):
    """First and last shown time [s]."""
    # Both are read at once, because the part moves while the motion is played.
    part = studio.find(TRACK).evaluate("e => [e.dataset.begin, e.dataset.end]")
    return float(part[0]), float(part[1])


def time_of(studio):
    return float(studio.told("#playback", "time"))


def duration_of(studio):
    return float(studio.find(".scrub").get_attribute("aria-valuemax"))


def wait_for_part(studio, before):
    """Wait for another part than the one before; return it."""
    begin, end = (repr(x).removesuffix(".0") for x in before)
    studio.wait_for(f"{TRACK}:not([data-begin='{begin}'][data-end='{end}'])")
    return part_of(studio)


def place(studio, share, height=0.5):
    """A place in the curve, by shares of its width and height [px]."""
    box = studio.find(".scrub").bounding_box()
    return box["x"] + share * box["width"], box["y"] + height * box["height"]


def drag(studio, begin, end):
    mouse = studio.page.mouse
    mouse.move(*begin)
    mouse.down()
    mouse.move(*end, steps=6)
    mouse.up()


def tolerance(studio):
    """Time of some pixels [s]."""
    begin, end = part_of(studio)
    return PIXELS * (end - begin) / studio.find(".scrub").bounding_box()["width"]


@pytest.mark.parametrize("height", [0.04, 0.3, 0.6, 0.96])
def test_a_click_goes_to_its_time_at_every_height(studio, height):
    share = 0.3 + 0.4 * height
    studio.page.mouse.click(*place(studio, share, height))
    studio.wait_for("#playback:not([data-time='0'])")
    assert time_of(studio) == pytest.approx(share * duration_of(studio), abs=tolerance(studio))
    assert part_of(studio) == (0, duration_of(studio))


def test_a_dragged_range_is_zoomed_and_a_double_click_shows_the_whole(studio):
    duration = duration_of(studio)
    whole = part_of(studio)
    within = tolerance(studio)
    drag(studio, place(studio, 0.25), place(studio, 0.5))
    part = wait_for_part(studio, whole)
    assert part == pytest.approx((duration / 4, duration / 2), abs=within)
    # The time was outside of the range.
    studio.wait_for("#playback:not([data-time='0'])")
    assert time_of(studio) == pytest.approx(part[0], abs=within)
    # In the part, a click is finer.
    before = studio.told("#playback", "time")
    studio.page.mouse.click(*place(studio, 0.5))
    studio.wait_for(f"#playback:not([data-time='{before}'])")
    assert time_of(studio) == pytest.approx(sum(part) / 2, abs=tolerance(studio))
    load_axe(studio.page)
    assert faults(studio.page) == []
    button = studio.find(TRACK).get_by_role("button", name="Whole motion")
    button.click()
    assert wait_for_part(studio, part) == whole
    expect(button).to_be_hidden()
    drag(studio, place(studio, 0.25), place(studio, 0.5))
    part = wait_for_part(studio, whole)
    studio.page.mouse.dblclick(*place(studio, 0.7))
    assert wait_for_part(studio, part) == whole


def test_the_knob_is_dragged_without_a_zoom(studio):
    drag(studio, place(studio, 0.0), place(studio, 0.4))
    studio.wait_for("#playback:not([data-time='0'])")
    assert time_of(studio) == pytest.approx(0.4 * duration_of(studio), abs=tolerance(studio))
    assert part_of(studio) == (0, duration_of(studio))


def test_a_pointer_over_the_path_shows_figures_and_only_a_click_goes_there(studio):
    dot = studio.find("circle.cursor:not(.tool)")
    tip = studio.find("#view2d > .tip[role=tooltip]")
    begin = studio.middle(dot)
    studio.page.mouse.click(*place(studio, 0.1))
    studio.wait_for("#playback:not([data-time='0'])")
    gone_to = time_of(studio)
    on_path = studio.middle(dot)
    assert on_path != begin
    studio.page.keyboard.press("Home")
    studio.wait("#playback", time="0")
    studio.page.mouse.move(*on_path)
    expect(tip).to_be_visible()
    expect(tip).to_contain_text("mm/s")
    expect(studio.find("#view2d circle.hovered")).to_be_visible()
    studio.page.evaluate(TWO_FRAMES)
    assert time_of(studio) == 0
    assert studio.middle(dot) == begin
    studio.page.mouse.down()
    studio.page.mouse.up()
    studio.wait_for("#playback:not([data-time='0'])")
    assert time_of(studio) == pytest.approx(gone_to, abs=0.02 * duration_of(studio))
    studio.page.keyboard.press("Escape")


def test_a_pointer_over_a_chart_shows_values_and_a_click_or_the_line_goes_there(studio):
    studio.tab("charts")
    over = studio.find("[data-chart=acceleration] .u-over")
    over.scroll_into_view_if_needed()
    values = studio.find("[data-chart=acceleration] .u-value")
    duration = duration_of(studio)
    studio.wait("[data-chart=acceleration]", cursor="0")

    def at(share):
        box = over.bounding_box()
        return box["x"] + share * box["width"], box["y"] + 0.5 * box["height"]

    def shown_share():
        """The place of the line in the chart, which begins at time zero."""
        box = over.bounding_box()
        return (studio.middle(over.locator(".now"))[0] - box["x"]) / box["width"]

    expect(values.first).to_have_text("0 s")
    studio.page.mouse.move(*at(0.4), steps=4)
    # The values are those under the pointer.
    expect(values.first).not_to_have_text("0 s")
    studio.page.evaluate(TWO_FRAMES)
    assert time_of(studio) == 0 and shown_share() == pytest.approx(0, abs=0.02)
    studio.page.mouse.move(5, 5)
    expect(values.first).to_have_text("0 s")
    studio.page.mouse.click(*at(0.4))
    studio.wait_for("#playback:not([data-time='0'])")
    clicked = studio.told("#playback", "time")
    studio.wait("[data-chart=acceleration]", cursor=clicked)
    assert shown_share() == pytest.approx(0.4, abs=0.02)
    # The axis may go on a little after the end of the motion.
    assert 0.3 * duration < float(clicked) < 0.5 * duration
    drag(studio, at(0.4), at(0.6))
    studio.wait_for(f"#playback:not([data-time='{clicked}'])")
    studio.wait("[data-chart=acceleration]", cursor=studio.told("#playback", "time"))
    assert time_of(studio) == pytest.approx(1.5 * float(clicked), rel=0.05)
    # A drag beside the line zooms the chart, and leaves the time.
    time = studio.told("#playback", "time")
    drag(studio, at(0.1), at(0.3))
    expect(over.locator(".now")).to_be_hidden()
    assert studio.told("#playback", "time") == time
    studio.page.mouse.dblclick(*at(0.9))
    expect(over.locator(".now")).to_be_visible()
    studio.page.keyboard.press("d")


def test_the_wheel_zooms_about_the_pointer_and_with_shift_it_moves(studio):
    whole = part_of(studio)
    mouse = studio.page.mouse
    mouse.move(*place(studio, 0.75))
    mouse.wheel(0, -400)
    part = wait_for_part(studio, whole)
    assert np.diff(part)[0] < 0.5 * whole[1]
    at = part[0] + 0.75 * np.diff(part)[0]
    assert at == pytest.approx(0.75 * whole[1], abs=tolerance(studio) + 2e-3 * whole[1])
    studio.page.keyboard.down("Shift")
    mouse.wheel(0, -200)
    moved = wait_for_part(studio, part)
    studio.page.keyboard.up("Shift")
    assert np.diff(moved)[0] == pytest.approx(np.diff(part)[0])
    assert moved[0] < part[0]
    mouse.wheel(0, 3000)
    assert wait_for_part(studio, moved) == whole


def test_keys_and_buttons_go_to_contours_stops_and_the_slowest_place(studio):
    press = studio.page.keyboard.press
    selected = studio.find("#tab-contours ol [aria-pressed=true] .name")

    def go(key):
        """Press a key; returns the time after it."""
        before = studio.told("#playback", "time")
        press(key)
        studio.wait_for(f"#playback:not([data-time='{before}'])")
        return time_of(studio)

    def click(name):
        before = studio.told("#playback", "time")
        studio.find(f"#playback [data-jump={name}]").click()
        studio.wait_for(f"#playback:not([data-time='{before}'])")
        return time_of(studio)

    end = go("End")
    assert end == pytest.approx(duration_of(studio))
    begins = [go("[") for _ in range(CONTOURS)]
    assert begins == sorted(begins, reverse=True)
    expect(selected).to_contain_text(re.compile("^1"))
    assert begins[-1] == pytest.approx(0, abs=1e-6)
    assert [click("contour-after"), click("contour-after")] == begins[1::-1]
    expect(selected).to_contain_text(re.compile("^3"))
    # Keyboards that have brackets on AltGr report Ctrl and Alt.
    press("Home")
    studio.wait("#playback", time="0")
    studio.page.evaluate(
        """() => dispatchEvent(new KeyboardEvent("keydown",
            {key: "]", ctrlKey: true, altKey: true, modifierAltGraph: true}))"""
    )
    studio.wait("#playback", time=str(begins[1]))
    # The end of the first contour is a stop between the begins of two contours.
    stop = go("{")
    assert begins[2] < stop < begins[1]
    assert go("{") < stop
    assert go("}") == pytest.approx(stop)
    assert click("stop-after") == pytest.approx(begins[1], abs=1e-5)
    slowest = go(".")
    press("Home")
    assert click("slowest") == slowest
    # Its contour is selected, and the curve tells the speed and the limit there.
    tip = studio.find(f"{TRACK} .tip")
    expect(tip).to_be_visible()
    number = selected.inner_text().split()[0]
    told = re.fullmatch(r"([\d.]+) s: ([\d.]+) mm/s, contour (\d+)[^,]*, (.+)", tip.inner_text())
    assert float(told[1]) == pytest.approx(slowest, abs=1e-3) and told[3] == number
    ends = {1: (0, stop)}.get(int(number), (begins[-int(number)], end))
    assert ends[0] <= slowest <= ends[1]
    press("Home")
    studio.wait("#playback", time="0")
    expect(tip).to_be_hidden()
    # An edit, and its undo, are other motions.
    for change in (lambda: studio.type("limits.speed", "45 mm/s"), studio.find("#undo").click):
        studio.find("#playback [data-jump=slowest]").click()
        expect(tip).to_be_visible()
        studio.tab("process")
        with studio.changing():
            change()
        expect(tip).to_be_hidden()
    studio.find("#playback .play").press("Home")
    studio.wait("#playback", time="0")
    # The arrow keys belong to the curve that has the focus; + and - zoom it.
    studio.rest()
    whole = part_of(studio)
    slider = studio.find(".scrub")
    slider.press("Shift+ArrowRight")
    studio.wait_for("#playback:not([data-time='0'])")
    assert time_of(studio) == pytest.approx(0.05 * whole[1])
    slider.press("+")
    assert np.diff(wait_for_part(studio, whole))[0] < whole[1]


def test_a_long_time_is_beside_the_curve(studio):
    """Motions of some minutes have times with three digits before the point."""
    studio.tab("process")
    with studio.changing():
        studio.type("limits.speed", "1 mm/s")
    assert duration_of(studio) > 100
    studio.find(".scrub").focus()
    studio.page.keyboard.press("Home")
    width = studio.find("#playback .clock").bounding_box()["width"]
    studio.page.keyboard.press("End")
    studio.wait_for("#playback:not([data-time='0'])")
    assert time_of(studio) == pytest.approx(duration_of(studio))
    assert studio.find("#playback .clock").bounding_box()["width"] == pytest.approx(width, abs=1)
    curve = studio.find(TRACK).bounding_box()
    for control in studio.find("#playback .controls > *").all():
        box = control.bounding_box()
        assert box["x"] + box["width"] < curve["x"]
    with studio.changing():
        studio.find("#undo").click()
    studio.rest()


def test_the_tip_of_a_drag_goes_with_the_drag(studio):
    whole = part_of(studio)
    tip = studio.find(f"{TRACK} .tip")
    mouse = studio.page.mouse
    mouse.move(*place(studio, 0.3))
    mouse.down()
    mouse.move(*place(studio, 0.4), steps=6)
    expect(tip).to_contain_text("zoom")
    mouse.up()
    wait_for_part(studio, whole)
    expect(tip).to_be_hidden()


def test_while_a_zoomed_part_is_played_the_time_stays_in_it(studio):
    whole = part_of(studio)
    drag(studio, place(studio, 0.3), place(studio, 0.34))
    part = wait_for_part(studio, whole)
    studio.page.keyboard.press("Space")
    moved = wait_for_part(studio, part)
    studio.page.keyboard.press("Space")
    studio.wait("#playback", state="paused")
    assert np.diff(moved)[0] == pytest.approx(np.diff(part)[0])
    moved = part_of(studio)
    assert moved[0] <= time_of(studio) <= moved[1]


def test_a_place_outside_of_a_zoomed_drawing_comes_into_the_view(studio):
    view = studio.find("#view2d")
    box = view.bounding_box()
    dot = studio.find("circle.cursor:not(.tool)")
    scale = float(studio.told("#view2d", "scale"))
    # Zoom at the middle of the first contour, so that the others are outside.
    studio.page.mouse.move(*studio.middle(dot))
    while float(studio.told("#view2d", "scale")) < 10 * scale:
        before = studio.told("#view2d", "scale")
        studio.page.mouse.wheel(0, -300)
        studio.wait_for(f"#view2d:not([data-scale='{before}'])")
    zoomed = studio.told("#view2d", "scale")

    def check_seen():
        studio.page.evaluate(TWO_FRAMES)
        x, y = studio.middle(dot)
        assert box["x"] < x < box["x"] + box["width"]
        assert box["y"] < y < box["y"] + box["height"]
        assert studio.told("#view2d", "scale") == zoomed

    for key in (".", "Home", "]", "]"):
        before = studio.told("#playback", "time")
        studio.page.keyboard.press(key)
        studio.wait_for(f"#playback:not([data-time='{before}'])")
        if key != "Home":
            check_seen()
    studio.page.keyboard.press("f")
    studio.wait_for(f"#view2d:not([data-scale='{zoomed}'])")
    studio.page.keyboard.press("Escape")


def test_a_tip_ends_with_the_next_action(studio):
    tip = studio.find(f"{TRACK} .tip")
    studio.page.mouse.move(*place(studio, 0.4))
    expect(tip).to_be_visible()
    # A key that changes neither the time nor the pointer.
    studio.page.keyboard.press("d")
    expect(tip).to_be_hidden()
    studio.page.keyboard.press("d")


def test_the_curve_says_what_is_at_the_pointer(studio):
    tip = studio.find(f"{TRACK} .tip")
    expect(tip).to_be_hidden()
    # The first contour lasts longer than a tenth of the motion.
    studio.page.mouse.move(*place(studio, 0.05))
    expect(tip).to_be_visible()
    expect(tip).to_contain_text("contour 1")
    share = float(tip.inner_text().partition(" s")[0]) / duration_of(studio)
    assert share == pytest.approx(0.05, abs=2e-3)
    metric = float(re.search(r"([\d.]+) mm/s", tip.inner_text())[1])
    studio.page.mouse.move(5, 5)
    expect(tip).to_be_hidden()
    # Speeds are in the unit that the page shows.
    switch = studio.find("#bar").get_by_role("button", name="inch")
    switch.click()
    studio.page.mouse.move(*place(studio, 0.05))
    expect(tip).to_contain_text("in/s")
    inches = float(re.search(r"([\d.]+) in/s", tip.inner_text())[1])
    assert inches == pytest.approx(metric / 25.4, rel=0.02)
    switch.click()


def test_a_finger_moves_the_time(pages):
    opened = pages(size=(390, 844))
    opened.begin()
    opened.wait("#figures", exact="true")
    opened.find(".scrub").scroll_into_view_if_needed()
    touch = opened.page.context.new_cdp_session(opened.page)
    touch.send("Emulation.setTouchEmulationEnabled", {"enabled": True})

    def send(kind, *points):
        points = [dict(zip("xy", x, strict=True)) for x in points]
        touch.send("Input.dispatchTouchEvent", {"type": kind, "touchPoints": points})

    send("touchStart", place(opened, 0.5))
    for k in range(1, 6):
        send("touchMove", place(opened, 0.5 + 0.05 * k))
    opened.wait_for("#playback:not([data-time='0'])")
    opened.wait_for(".scrub[data-drag=time]")
    send("touchEnd")
    opened.wait_for(".scrub:not([data-drag])")
    within = tolerance(opened) + 0.01 * duration_of(opened)
    assert time_of(opened) == pytest.approx(0.75 * duration_of(opened), abs=within)
    assert part_of(opened) == (0, duration_of(opened))


def told_point(studio, name):
    """A point of the 3D view in the plane [m]."""
    return np.array(studio.told("#view3d", name).split(","), dtype=float)[:2]


def from_line(point, begin, end):
    """Distance of a point from a line [m]."""
    along = (end - begin) / np.linalg.norm(end - begin)
    across = point - begin
    return abs(along[0] * across[1] - along[1] * across[0])


def straight_part(points, tool):
    """The segment in whose inner half the tool is, or None."""
    for begin, end in zip(points, points[1:], strict=False):
        length = np.linalg.norm(end - begin)
        share = (tool - begin) @ (end - begin) / length**2
        if 0.25 < share < 0.75 and from_line(tool, begin, end) < 1e-6:
            return begin, end
    return None


def test_the_executed_tool_is_a_ghost_beside_the_planned_one(pages, tmp_path):
    job = write_job(tmp_path / "job.yaml", "optimal")
    points = np.array(load(job.read_text(), "job")["path"]["points"])
    with serving(job, folder=tmp_path) as address:
        studio = pages(address)
        studio.rest()
        studio.find("#viewbar").get_by_role("button", name="Both").click()
        studio.wait_for("#view3d[data-frames]")
        # Go on to a straight part of the path.
        line = None
        for _ in range(20):
            studio.find(".scrub").press("Shift+ArrowRight")
            studio.wait("#view3d", time=studio.told("#playback", "time"))
            line = straight_part(points, told_point(studio, "tool"))
            if line is not None:
                break
        assert line is not None
        studio.wait_for("#view3d[data-ghost*=',']")
        ghost = told_point(studio, "ghost")
        factor = float(studio.told("#view3d", "magnify"))
        note = studio.find(".arm-note").inner_text()
        assert f"×{factor:.0f}" in note
        error = 1e-6 * float(re.search(r"([\d.e-]+) µm", note)[1])
        assert from_line(ghost, *line) == pytest.approx(factor * error, rel=0.01, abs=1e-6)
        dot = studio.find("circle.cursor.tool")
        expect(dot).to_be_visible()
        legend = studio.find("#legend")
        expect(legend).to_contain_text(f"×{studio.told('#view2d', 'magnify')}")
        motion = studio.find("#playback select").first
        motion.select_option("planned")
        studio.wait("#view3d", ghost="")
        expect(dot).to_be_hidden()
        expect(legend).not_to_contain_text("×")
        motion.select_option("both")
        expect(dot).to_be_visible()
        studio.wait_for("#view3d[data-ghost*=',']")
        # The executed motion has its own tool.
        motion.select_option("executed")
        studio.wait("#view3d", of="executed", ghost="")


def test_a_moving_arm_is_drawn_with_fewer_pixels_in_software_rendering(studio):
    renderer = studio.page.evaluate(
        "async () => (await import('/static/viewer.js')).rendererName()"
    )
    if re.search("swiftshader|llvmpipe|software", renderer, re.IGNORECASE) is None:
        pytest.skip(f"The browser renders with {renderer}.")
    studio.find("#viewbar").get_by_role("button", name="3D", exact=True).click()
    studio.wait("#views", stage="3d")
    canvas = studio.find("#view3d canvas")
    # The view has taken the room of the other one, and is drawn with all pixels.
    studio.page.wait_for_function(
        "() => { const e = document.querySelector('#view3d canvas');"
        " return e.clientWidth > 800 && e.width === 2 * e.clientWidth; }"
    )
    wide = canvas.evaluate("e => e.clientWidth")
    studio.find("#playback select").last.select_option("0.1")
    studio.page.keyboard.press("Space")
    expect(canvas).not_to_have_attribute("width", str(2 * wide))
    assert int(canvas.get_attribute("width")) < wide
    studio.page.keyboard.press("Space")
    studio.wait("#playback", state="paused")
    expect(canvas).to_have_attribute("width", str(2 * wide))
    # The page is left as it was.
    studio.find("#playback select").last.select_option("1")
    studio.find("#viewbar").get_by_role("button", name="2D", exact=True).click()
