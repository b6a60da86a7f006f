"""What a person does in the Studio, in a real browser; the page is held to the library."""

from pathlib import Path

import numpy as np
import pytest
from playwright.sync_api import expect
from tools.studio_page import SQUARE

import armcontour as ac
from armcontour.core.render import cells
from armcontour.files.exports import TemplateFormat
from armcontour.studio.page_frame import without_options

pytestmark = pytest.mark.browser
EXACT = 1e-9
DRAWINGS = Path(__file__).parents[2] / "examples" / "drawings"
# The largest share of pixels with one colour in a picture.
PLAIN = """async (png) => {
  const image = await createImageBitmap(new Blob([new Uint8Array(png)]));
  const context = new OffscreenCanvas(image.width, image.height).getContext("2d");
  context.drawImage(image, 0, 0);
  const { data } = context.getImageData(0, 0, image.width, image.height);
  const counts = new Map();
  for (const x of new Uint32Array(data.buffer)) counts.set(x, (counts.get(x) ?? 0) + 1);
  return Math.max(...counts.values()) / (data.length / 4);
}"""
DRAWN = "() => new Promise((go) => requestAnimationFrame(() => requestAnimationFrame(go)))"


def agree(studio, judgement):
    """What the page shows at rest is what the library finds."""
    error = judgement.judged.contour_error
    assert studio.figure("duration") == pytest.approx(judgement.trajectory.duration, abs=EXACT)
    assert studio.figure("contour_error.rms") == pytest.approx(error.rms, abs=EXACT)
    deviation = (judgement.rounding_error or 0.0) + error.max
    assert studio.figure("off_drawing") == pytest.approx(deviation, abs=EXACT)


def shares(studio):
    """What takes the time, as the notes say it."""
    studio.tab("notes")
    rows = studio.find("#tab-notes section:has-text('What takes the time') tr")
    expect(rows.first).to_be_visible()
    return [tuple(x.locator("th, td").all_inner_texts()) for x in rows.all()]


def test_j1_the_papers_job_is_shown_with_its_cycle_time(studio, judge):
    expect(studio.find("[data-figure=duration] .value")).to_have_text("5.3261")
    judgement = judge(studio)
    agree(studio, judgement)
    assert shares(studio) == cells(judgement.explanation.time_table)
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
    judgement = judge(studio)
    agree(studio, judgement)
    assert judgement.trajectory.duration < before
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
    assert studio.refusal == without_options(str(refused.value))
    with studio.changing():
        studio.page.keyboard.press("Control+z")
    assert studio.text == original


# Numbers of red and of dark grey pixels of the canvas.
COLOURED = """(canvas) => {
  const { data } = canvas.getContext("2d").getImageData(0, 0, canvas.width, canvas.height);
  let [red, grey] = [0, 0];
  for (let i = 0; i < data.length; i += 4) {
    const [r, g] = [data[i], data[i + 1]];
    if (r - g > 130) red += 1;
    else if (r < 180 && Math.abs(r - g) < 20) grey += 1;
  }
  return [red, grey];
}"""


def test_j4_a_refused_job_has_its_outline_also_after_a_reload(studio):
    def drawn():
        studio.wait("body", refused="true", busy="false")
        expect(studio.find("path.refused")).to_be_visible()
        studio.page.evaluate(DRAWN)
        return studio.find("#view2d canvas").evaluate(COLOURED)

    studio.open(DRAWINGS / "gasket.dxf", "ur5e")
    studio.rest()
    studio.find("#viewbar").get_by_role("button", name="Place part").click()
    studio.find("[aria-label='Place of the part']").focus()
    with studio.renewing():
        studio.page.keyboard.type("900, 0")
        studio.page.keyboard.press("Enter")
    # One of ten contours is red.
    assert min(drawn()) > 300
    assert float(studio.told("#view2d", "duration")) > 0
    for _ in range(2):
        studio.page.reload()
        studio.begin()
        assert min(drawn()) > 300
        assert "out of reach" in studio.refusal
    with studio.changing():
        studio.find("#undo").click()
    studio.page.evaluate(DRAWN)
    assert studio.find("#view2d canvas").evaluate(COLOURED)[0] == 0


def test_j5_a_run_that_is_refused_leaves_the_others(studio, judge):
    studio.choose_run("proposed")
    studio.wait("#view2d", run="proposed")
    studio.rest()
    agree(studio, judge(studio, "proposed"))
    studio.type("limits.joint_acceleration", "0.3 rad/s^2")
    studio.wait("body", refused="true", dirty="true")
    with pytest.raises(ac.NotRealizable) as refused:
        judge(studio, "proposed")
    assert studio.refusal == without_options(str(refused.value))
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
    assert b"5.326" in content


def test_j39_programs_for_kuka_and_abb_are_those_of_the_library(studio, judge, tmp_path):
    file = tmp_path / "square.yaml"
    file.write_text(SQUARE)
    studio.open(file)
    studio.rest()
    for template, ending in (("kuka", ".src"), ("abb", ".mod")):
        task_result = studio.do("export", {"format": template})
        name, content = studio.save_file(task_result.locator(f"button[data-file$='{ending}']"))
        # The name of the program is that of its file.
        program = TemplateFormat(template=template, name="square set-points")
        ac.export(judge(studio).set_points, tmp_path / name, program, arm=ac.load_arm("ur5e"))
        assert content == (tmp_path / name).read_bytes()


def press(studio, within, name):
    """Press a button of a region."""
    studio.find(within).get_by_role("button", name=name, exact=True).click()


def test_j26_the_skip_link_moves_the_focus_and_keeps_the_session(studio):
    for _ in range(2):
        studio.page.reload()
        studio.begin()
        studio.page.keyboard.press("Tab")
        expect(studio.find(".skip")).to_be_focused()
        studio.page.keyboard.press("Enter")
        expect(studio.find("#view2d")).to_be_focused()
        studio.wait("body", link="open")
    studio.page.keyboard.press("Tab")
    expect(studio.find("#view2d g.handle").first).to_be_visible()
    assert studio.page.evaluate("() => document.activeElement.matches('g.handle')")


def test_j27_drawing_arm_slider_and_charts_show_one_time(studio):
    press(studio, "#viewbar", "Both")
    studio.wait("#view3d", exact="true", time="0")
    dot = studio.find("circle.cursor:not(.tool)")
    studio.page.mouse.move(*studio.middle(studio.handle("middle", 2)))
    studio.wait_for("#playback:not([data-time='0'])")

    def agreed():
        time = studio.told("#playback", "time")
        studio.wait("#view3d", exact="true", time=time)
        studio.wait("[data-chart=acceleration]", cursor=time)
        assert float(studio.find("#playback .scrub").input_value()) == pytest.approx(float(time))
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
    studio.page.evaluate(DRAWN)
    assert agreed() == before
    studio.find("#playback .scrub").press("ArrowRight")
    studio.wait_for(f"#playback:not([data-time='{before[0]}'])")
    assert agreed()[0] > before[0]


def test_j28_a_document_of_the_same_name_is_fitted(studio):
    drawing = DRAWINGS / "gasket.dxf"
    studio.open(drawing, "ur5e")
    studio.rest()
    corner = studio.handle("corner", 0)
    expect(corner).to_be_in_viewport()
    fitted = float(studio.told("#view2d", "scale"))
    studio.page.mouse.move(*studio.middle(studio.find("#view2d")))
    for _ in range(6):
        studio.page.mouse.wheel(0, -500)
    expect(studio.find("#view2d")).not_to_have_attribute("data-scale", str(fitted))
    assert float(studio.told("#view2d", "scale")) > 4 * fitted
    studio.open(drawing, "ur10e")
    studio.rest()
    assert float(studio.told("#view2d", "scale")) == pytest.approx(fitted, rel=1e-2)
    expect(corner).to_be_in_viewport()


def test_j29_the_camera_stays_above_the_floor_and_sees_the_scene(studio):
    studio.open(DRAWINGS / "gasket.dxf", "ur5e")
    press(studio, "#viewbar", "3D")
    studio.wait("#view3d", exact="true")
    canvas, mouse = studio.find("#view3d canvas"), studio.page.mouse
    box = canvas.bounding_box()
    x, y = studio.middle(canvas)
    # Below the buttons over the picture.
    clip = {"x": box["x"], "y": box["y"] + 60, "width": box["width"], "height": box["height"] - 60}

    def drag(dx, dy, button="left"):
        mouse.move(x, y)
        mouse.down(button=button)
        mouse.move(x + dx, y + dy, steps=4)
        mouse.up(button=button)

    def wheel(by, times, place=(0, 0)):
        mouse.move(x + place[0], y + place[1])
        for _ in range(times):
            mouse.wheel(0, by)

    for act in (
        lambda: wheel(-200, 8),
        lambda: wheel(-400, 40),
        lambda: wheel(400, 60),
        lambda: wheel(-400, 40, (box["width"] / 2 - 20, box["height"] / 2 - 20)),
        lambda: drag(0, -500),
        lambda: drag(400, 500),
        *[lambda: drag(500, 150, "right")] * 6,
        *[lambda: drag(-500, -150, "right")] * 12,
    ):
        act()
        studio.page.evaluate(DRAWN)
        assert 0 <= float(studio.told("#view3d", "elevation")) <= np.pi / 2
        picture = studio.page.screenshot(clip=clip)
        assert studio.page.evaluate(PLAIN, list(picture)) < 1 - 2e-4


def test_j30_a_new_waypoint_has_the_focus(studio):
    original, count = studio.text, 4
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


def test_j31_what_cannot_be_done_is_not_offered(studio, tmp_path):
    studio.tab("waypoints")
    expect(studio.find("#tab-waypoints table")).to_be_visible()
    studio.open(DRAWINGS / "gasket.dxf", "ur5e")
    expect(studio.find("#tab-waypoints")).to_contain_text("gasket.dxf")
    # Ten contours are no waypoints of one path; a table without rows has no headers.
    expect(studio.find("#tab-waypoints button:visible")).to_have_count(0)
    expect(studio.find("#tab-waypoints table")).to_be_hidden()
    studio.tab("runs")
    expect(studio.find("#tab-runs tbody tr")).to_have_count(1)
    expect(studio.find("#tab-runs").get_by_role("button", name="Remove")).to_have_count(0)
    # Two points are the least.
    one = tmp_path / "one.svg"
    size = 'width="50mm" height="50mm" viewBox="0 0 50 50"'
    line = f'<svg xmlns="http://www.w3.org/2000/svg" {size}><path d="M 5 5 L 40 5"/></svg>'
    one.write_text(line)
    studio.open(one, "ur5e")
    studio.tab("waypoints")
    with studio.renewing():
        studio.find("#tab-waypoints").get_by_role("button", name="Make waypoints").click()
    rows = studio.find("#tab-waypoints tbody tr")
    expect(rows).to_have_count(2)
    expect(rows.get_by_role("button", name="Remove")).to_have_count(0)
    expect(rows.get_by_role("button", name="Insert")).to_have_count(2)


def test_j32_an_unreadable_drawing_names_what_the_page_has(studio, tmp_path):
    drawing = tmp_path / "sheet.svg"
    size = 'width="50mm" height="50mm" viewBox="0 0 50 50"'
    drawing.write_text(
        f'<svg xmlns="http://www.w3.org/2000/svg" {size}>'
        '<style>path { transform: rotate(3deg) }</style><path d="M 5 5 L 40 5"/></svg>'
    )
    dialog = studio.find("#question")
    # The console says that the file was refused.
    studio.is_cut_off = True
    studio.find("#picker").set_input_files(drawing)
    dialog.locator("select").select_option("ur5e")
    dialog.get_by_role("button", name="Open").click()
    alarm = studio.find("#messages .message.alarm:not(.refusal)")
    expect(alarm).to_contain_text("unknown: skip")
    expect(alarm).not_to_contain_text("--")
    studio.is_cut_off = False
    studio.find("#picker").set_input_files(drawing)
    dialog.get_by_role("checkbox", name="unknown: skip").check()
    dialog.locator("select").select_option("ur5e")
    with studio.changing():
        dialog.get_by_role("button", name="Open").click()
    assert "unknown: skip" in studio.text


def test_j33_numbers_are_readable(studio):
    studio.tab("notes")
    slow = studio.find("#tab-notes li").first
    expect(slow).to_contain_text("mm/s")
    sentences = studio.find("#tab-notes li").all_inner_texts()
    assert sentences and not any(" m:" in x or " m/s" in x for x in sentences), sentences


def test_j34_typed_text_survives_a_reload(studio):
    before = studio.text
    typed = before.replace("speed: 0.15 m/s", "speed: 0.11 m/s")
    studio.tab("text")
    studio.find("#tab-text textarea").fill(typed)
    studio.page.reload()
    studio.begin()
    expect(studio.find("#tab-text textarea")).to_have_value(typed)
    expect(studio.find("#tab-text textarea")).to_be_visible()
    with studio.changing():
        press(studio, "#tab-text", "Apply (Ctrl+Enter)")
    assert studio.text == typed
    with studio.changing():
        studio.find("#undo").click()
    studio.page.reload()
    studio.begin()
    assert studio.text == before


def test_j35_a_drawing_with_wide_corners_is_not_kept(studio):
    studio.open(DRAWINGS / "gasket.dxf", "ur5e")
    studio.rest()
    verdict = studio.find("[data-figure=kept]")
    expect(verdict.locator(".value")).to_have_text("✓ kept")
    green = verdict.evaluate("e => getComputedStyle(e).color")
    with studio.changing():
        studio.type("corners.tolerance", "10 mm")
    expect(verdict.locator(".value")).to_have_text("✗ NOT KEPT")
    assert studio.figure("off_drawing") == pytest.approx(3.19e-3, abs=1e-5)
    expect(studio.find("[data-figure=off_drawing] .number")).to_have_text("3.189mm")
    assert verdict.evaluate("e => getComputedStyle(e).color") != green
    # What rapids take is in the legend, in the words of the table.
    rapids = next(x for x in shares(studio) if x[0] == "rapids between contours")
    expect(studio.find("#legend")).to_contain_text(f"{rapids[0]} {rapids[2]}")


def test_j36_a_change_is_made_by_its_button_and_undone(studio):
    studio.open(DRAWINGS / "gasket.dxf", "ur5e")
    studio.rest()
    text, before = studio.text, studio.figure("duration")
    studio.wait("#figures", changes="3")
    button = studio.find("#changes button").first
    effect = button.locator("b").inner_text()
    unit, saved = effect.split()[2], float(effect.split()[1])
    assert effect.startswith("saves ") and unit == "s" and saved > 1
    with studio.changing():
        button.click()
    studio.rest()
    # By the button the motion is as much shorter as it says, to its last digit.
    assert before - studio.figure("duration") == pytest.approx(saved, abs=5.01e-5)
    assert studio.text != text
    with studio.changing():
        studio.find("#undo").click()
    assert studio.text == text
    studio.rest()
    assert studio.figure("duration") == before
    # What was planned before is known.
    studio.wait("#figures", changes="3")


def test_j37_a_run_that_is_not_kept_is_repaired_by_its_button(studio):
    studio.open(DRAWINGS / "gasket.dxf", "ur5e")
    with studio.changing():
        studio.type("corners.tolerance", "10 mm")
    verdict = studio.find("[data-figure=kept] .value")
    expect(verdict).to_have_text("✗ NOT KEPT")
    studio.wait("#figures", changes="1")
    with studio.changing():
        studio.find("#changes button").click()
    expect(verdict).to_have_text("✓ kept")
    assert studio.figure("off_drawing") <= 0.5e-3


def test_j38_two_variants_are_compared_with_one_cursor(studio):
    before = studio.figure("duration")
    with studio.changing():
        studio.type("corners.tolerance", "8 mm")
    studio.rest()
    after = studio.figure("duration")
    studio.tab("tasks")
    task_result = studio.do("compare")
    expect(task_result.locator("table caption")).to_have_text("Differences")
    row = task_result.get_by_role("row").filter(
        has=studio.page.get_by_role("rowheader", name="motion")
    )
    cells = [x.split() for x in row.locator("td").all_inner_texts()]
    numbers = [float(x) * {"s": 1.0, "ms": 1e-3}[unit] for x, unit in cells]
    assert numbers == pytest.approx([after, before, after - before], abs=1e-4)
    expect(task_result.locator("[data-chart]")).to_have_count(2)
    # A click in one chart moves the time of all.
    plot = task_result.locator("[data-chart=variants-speed] .u-over")
    plot.scroll_into_view_if_needed()
    box = plot.bounding_box()
    studio.page.mouse.move(box["x"] + 0.5 * box["width"], box["y"] + 0.5 * box["height"])
    expect(studio.find("#playback")).not_to_have_attribute("data-time", "0")
    time = float(studio.told("#playback", "time"))
    assert 0 < time < after
    legend = task_result.locator("[data-chart=variants-error]")
    legend.scroll_into_view_if_needed()
    expect(legend).to_contain_text("now")
    expect(legend).to_contain_text("before")
