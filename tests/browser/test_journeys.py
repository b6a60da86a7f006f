"""One journey per area of the Studio in a real browser; its values are those of the library.

Longer journeys are in tests/slow/browser.
"""

import re
from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect
from tools.studio_page import TWO_FRAMES

import armcontour as ac
from armcontour.core.render import cells
from armcontour.report.message_frame import without_options

pytestmark = pytest.mark.browser
EXACT = 1e-9
NUMBERS = re.compile(r"[-−+]?\d+(?:\.\d+)?")
DRAWINGS = Path(__file__).parents[2] / "examples" / "drawings"


def agree(studio, judgement):
    """What the page shows at rest is what the library finds."""
    error = judgement.judged.contour_error
    assert studio.figure("duration") == pytest.approx(judgement.trajectory.duration, abs=EXACT)
    assert studio.figure("contour_error.rms") == pytest.approx(error.rms, abs=EXACT)
    other_robot = judgement.unknown_gains.max
    assert studio.figure("unknown_gains.max") == pytest.approx(other_robot, abs=EXACT)
    deviation = judgement.verdict.off_drawing
    assert studio.figure("off_drawing") == pytest.approx(deviation, abs=EXACT)


def shares(studio):
    """What takes the time, as the notes say it."""
    studio.tab("notes")
    rows = studio.find("#tab-notes section:has(table) tr")
    expect(rows.first).to_be_visible()
    return [tuple(x.locator("th, td").all_inner_texts()) for x in rows.all()]


def test_the_papers_job_is_shown_with_its_cycle_time(studio, judge):
    expect(studio.find("[data-figure=duration] .value")).to_have_text("5.33")
    judgement = judge(studio)
    agree(studio, judgement)
    assert shares(studio) == [x[:3] for x in cells(judgement.explanation.time_table)]
    assert studio.find("g.handle.waypoint").count() == 4
    assert studio.find("g.handle.corner").count() == 2


def test_a_dragged_corner_has_another_tolerance(studio, judge):
    before = studio.figure("duration")
    bound = shares(studio)
    with studio.changing():
        with studio.grabbing(studio.handle("corner", 1)) as (x, y):
            studio.page.mouse.move(x + 8, y, steps=4)
            # It is seen before the button is let go.
            studio.wait("body", busy="false")
            expect(studio.find("#view2d")).not_to_have_attribute("data-duration", str(before))
            assert float(studio.told("#view2d", "duration")) < before
    judgement = judge(studio)
    agree(studio, judgement)
    assert judgement.trajectory.duration < before
    assert shares(studio) != bound
    studio.tab("runs")
    row = studio.find("#tab-runs tr:has-text('before the last change')")
    expect(row).to_be_visible()
    heads = studio.find("#tab-runs thead th").all_inner_texts()
    old = row.locator("th, td").nth(heads.index("cycle time"))
    expect(old).to_have_text(f"{before:.2f} s")
    with studio.changing():
        studio.find("#undo").click()
    assert studio.figure("duration") == before


def test_a_refusal_is_shown_at_the_waypoint_out_of_reach(studio, judge):
    original = studio.text
    handle = studio.handle("waypoint", 1)
    with studio.grabbing(handle) as (x, y):
        studio.page.mouse.move(x + 320, y, steps=6)
        studio.wait("body", refused="true")
        place = studio.find("path.refused")
        expect(place).to_be_visible()
        assert "reach" in studio.refusal
        # The last motion stays, greyed, and the handle is under the mouse.
        studio.wait("#view2d", stale="true")
        assert float(studio.told("#view2d", "duration")) > 0
        assert studio.middle(handle)[0] == pytest.approx(x + 320, abs=1)
        studio.page.mouse.move(x, y, steps=6)
        studio.wait("body", refused="false")
    assert studio.text == original
    # After the drop, the file has this point, and the library gives the same message.
    studio.drag(handle, (320, 0))
    studio.wait("body", refused="true", dirty="true", busy="false")
    expect(studio.find("#undo")).to_be_enabled()
    with pytest.raises(ac.Unreachable) as refused:
        judge(studio)
    # The farthest point is searched after the last edit. Marks of code are not shown.
    shown = studio.find("#messages .refusal > span").first
    expect(shown).to_have_text(without_options(str(refused.value)).replace("`", ""))
    with studio.changing():
        studio.page.keyboard.press("Control+z")
    assert studio.text == original


def test_undo_and_redo_reach_every_state_and_survive_a_reload(studio):
    texts = [studio.text]
    studio.tab("process")
    for change in ("speed", "waypoint", "corner"):
        with studio.changing():
            if change == "speed":
                studio.type("limits.speed", "0.1 m/s")
            elif change == "waypoint":
                studio.drag(studio.handle("waypoint", 2), (-20, 10))
            else:
                studio.drag(studio.handle("corner", 0), (-5, 0))
        texts.append(studio.text)
    assert len(set(texts)) == 4
    for text in texts[-2::-1]:
        with studio.changing():
            studio.find("#undo").click()
        assert studio.text == text
    expect(studio.find("#undo")).to_be_disabled()
    studio.wait("body", dirty="false")
    for text in texts[1:3]:
        with studio.changing():
            studio.page.keyboard.press("Control+Shift+z")
        assert studio.text == text
    studio.page.reload()
    studio.rest()
    assert studio.text == texts[2]
    with studio.changing():
        studio.find("#redo").click()
    assert studio.text == texts[3]


def test_results_are_saved_as_files(studio, judge, tmp_path):
    task_result = studio.do("export", {"format": "csv"})
    studio.wait(".task-result[data-task=export]", state="done")
    name, content = studio.save_file(task_result.locator("button, a").first)
    judgement = judge(studio)
    ac.export(judgement.set_points, tmp_path / "set_points.csv", arm=ac.load_arm("pmk3s"))
    assert name.endswith(".csv")
    assert content == (tmp_path / "set_points.csv").read_bytes()
    task_result = studio.do("report")
    studio.wait(".task-result[data-task=report]", state="done")
    name, content = studio.save_file(task_result.locator("button, a").first)
    assert name.endswith(".html")
    assert b"5.33 s" in content


def press(studio, within, name):
    """Press a button of a region."""
    studio.find(within).get_by_role("button", name=name).click()


def test_drawing_and_arm_and_slider_and_charts_show_the_same_time(studio):
    press(studio, "#viewbar", "Both")
    studio.wait("#view3d", time="0")
    dot = studio.find("circle.cursor:not(.tool)")
    # A click on the path, beside its handles.
    begin = np.array(studio.middle(studio.handle("waypoint", 2)))
    end = np.array(studio.middle(studio.handle("middle", 2)))
    studio.page.mouse.click(*(begin + 0.5 * (end - begin)))
    studio.wait_for("#playback:not([data-time='0'])")

    def agreed():
        time = studio.told("#playback", "time")
        studio.wait("#view3d", time=time)
        studio.wait("[data-chart=acceleration]", cursor=time)
        studio.wait_for(f"#playback .scrub[aria-valuenow='{time}']")
        # The arm's tool is where the dot on the path is: within two pixels.
        scale = float(studio.told("#view2d", "scale"))
        tool = np.array(studio.told("#view3d", "tool").split(","), dtype=float)[:2]
        origin = np.array(studio.middle(studio.handle("waypoint", 0)))
        shown = origin + scale * (tool - [0.35, 0.1]) * [1, -1]
        assert np.abs(shown - studio.middle(dot)).max() < 2
        return time, studio.middle(dot)

    before = agreed()
    # The pointer leaves the path, and nothing goes back.
    studio.page.mouse.move(5, 5)
    studio.page.evaluate(TWO_FRAMES)
    assert agreed() == before
    studio.find("#playback .scrub").press("ArrowRight")
    studio.wait_for(f"#playback:not([data-time='{before[0]}'])")
    assert agreed()[0] > before[0]
    press(studio, "#viewbar", "2D")


def test_a_new_waypoint_has_the_focus(studio):
    original = studio.text
    count = 4
    waypoints = studio.find("g.handle.waypoint")
    plus = studio.handle("middle", 2)
    for insert in (lambda: plus.click(), lambda: studio.drag(plus, (20, 15))):
        with studio.renewing():
            insert()
        expect(studio.handle("waypoint", 2)).to_be_focused()
        expect(waypoints).to_have_count(count + 1)
        with studio.renewing():
            studio.page.keyboard.press("Delete")
        expect(waypoints).to_have_count(count)
        assert studio.text == original
    studio.tab("waypoints")
    with studio.renewing():
        studio.find("#tab-waypoints tr").get_by_role("button", name="Insert").last.click()
    rows = studio.find("#tab-waypoints tbody tr")
    expect(rows).to_have_count(count + 1)
    expect(rows.last.locator("input").first).to_be_focused()


def label(studio):
    """The label at the pointer."""
    return studio.find(".at-pointer")


def numbers(text):
    """The numbers of a text."""
    return [float(x.replace("−", "-")) for x in NUMBERS.findall(text)]


def points(studio):
    """The points of the job's path, as the file has them."""
    return numbers(studio.text.partition("points:")[2].partition("limits:")[0])


def test_a_dragged_waypoint_snaps_and_shows_its_gain(studio, judge):
    before = studio.figure("duration")
    original = studio.text
    handle = studio.handle("waypoint", 1)
    expect(label(studio)).to_be_hidden()
    with studio.changing():
        with studio.grabbing(handle) as (x, y):
            studio.page.mouse.move(x - 31, y + 17, steps=4)
            expect(label(studio)).to_contain_text("preview")
            shown = label(studio).locator(".value").inner_text()
            gained = label(studio).locator(".better, .worse")
            expect(gained).to_be_visible()
            box = label(studio).bounding_box()
            middle = studio.middle(handle)
            # The label is on the side of the pointer that has room.
            for axis, size, place in zip("xy", ("width", "height"), middle, strict=True):
                assert box[axis] - 60 < place < box[axis] + box[size] + 60
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


def test_a_typed_value_keeps_its_digits_and_escape_reverts_it(studio, judge):
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
