"""What a person does in the Studio, in a real browser; the page is held to the library."""

from collections import Counter

import pytest
from playwright.sync_api import expect

import armcontour as ac

pytestmark = pytest.mark.browser
EXACT = 1e-9


def agree(studio, found):
    """What the page shows at rest is what the library finds."""
    error = found.evaluation.contour_error
    assert studio.figure("duration") == pytest.approx(found.trajectory.duration, abs=EXACT)
    assert studio.figure("contour_error.rms") == pytest.approx(error.rms, abs=EXACT)
    assert studio.figure("contour_error.max") == pytest.approx(error.max, abs=EXACT)


def shares(studio):
    """How long each limit binds [s], as the notes say it."""
    studio.tab("notes")
    rows = studio.find("#tab-notes tbody tr")
    expect(rows.first).to_be_visible()
    names, times = rows.locator("th").all_inner_texts(), rows.locator("td:nth-child(2)")
    return dict(zip(names, map(float, times.all_inner_texts()), strict=True))


def test_j1_the_papers_job_is_shown_with_its_cycle_time(studio, judge):
    expect(studio.find("[data-figure=duration] .value")).to_have_text("5.3261")
    found = judge(studio)
    agree(studio, found)
    times = Counter[str]()
    for x in found.explanation.bindings:
        times["between two limits" if x.limit == "nothing" else x.name] += x.t[1] - x.t[0]
    assert shares(studio) == pytest.approx(times, abs=1e-3)
    assert studio.find("g.handle.waypoint").count() == 4
    assert studio.find("g.handle.corner").count() == 2


def test_j2_a_dragged_corner_has_another_tolerance(studio, judge):
    before, bound = studio.figure("duration"), shares(studio)
    with studio.changing():
        with studio.grabbing(studio.handle("corner", 1)) as (x, y):
            studio.page.mouse.move(x + 8, y, steps=4)
            # It is seen before the button is let go.
            studio.wait("body", busy="false")
            expect(studio.find("#view2d")).not_to_have_attribute("data-duration", str(before))
            assert float(studio.told("#view2d", "duration")) < before
    found = judge(studio)
    agree(studio, found)
    assert found.trajectory.duration < before
    assert shares(studio) != bound
    with studio.changing():
        studio.find("#undo").click()
    assert studio.figure("duration") == before


def test_j3_a_waypoint_out_of_reach_is_refused_at_its_place(studio, judge):
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
    # Left there, the file has it, and the library says the same sentence.
    studio.drag(handle, (320, 0))
    studio.wait("body", refused="true", dirty="true", busy="false")
    expect(studio.find("#undo")).to_be_enabled()
    with pytest.raises(ac.Unreachable) as refused:
        judge(studio)
    assert studio.refusal == str(refused.value)
    with studio.changing():
        studio.page.keyboard.press("Control+z")
    assert studio.text == original


def test_j5_a_run_that_is_refused_leaves_the_others(studio, judge):
    studio.choose_run("proposed")
    studio.wait("#view2d", run="proposed")
    studio.rest()
    agree(studio, judge(studio, "proposed"))
    studio.type("limits.joint_acceleration", "0.3 rad/s^2")
    studio.wait("body", refused="true", dirty="true")
    with pytest.raises(ac.NotRealizable) as refused:
        judge(studio, "proposed")
    assert studio.refusal == str(refused.value)
    studio.choose_run("optimal")
    studio.wait("body", refused="false")
    studio.wait("#view2d", run="optimal")
    studio.rest()
    agree(studio, judge(studio))


def test_j7_undo_and_redo_go_all_the_way_and_survive_a_reload(studio):
    texts = [studio.text]
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


def test_j9_results_are_saved_as_files(studio, judge, tmp_path):
    done = studio.do("export", {"format": "csv"})
    studio.wait(".task-result[data-task=export]", state="done")
    name, content = studio.save_file(done.locator("button, a").first)
    found = judge(studio)
    ac.export(found.taught, tmp_path / "taught.csv", arm=ac.load_arm("pmk3s"))
    assert name.endswith(".csv")
    assert content == (tmp_path / "taught.csv").read_bytes()
    done = studio.do("report")
    studio.wait(".task-result[data-task=report]", state="done")
    name, content = studio.save_file(done.locator("button, a").first)
    assert name.endswith(".html")
    assert b"5.326" in content
