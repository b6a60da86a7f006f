"""Editing with names and buttons: undo list, order, usual values, refusals, runs and inches."""

import hashlib

import ezdxf
import pytest
from playwright.sync_api import expect

from armcontour.core.errors import InvalidInput
from armcontour.core.yaml_loader import load
from armcontour.files import parse_job

pytestmark = pytest.mark.browser
JOB = """\
name: rings
arm: ur5e                     # the cell's arm
path:
  file: rings.dxf
  frame: {position: [420 mm, -20 mm, 100 mm]}
  orientation: {axis: [0, 0, -1]}
limits: {speed: 50 mm/s}
corners: {tolerance: 0.2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {own: {}}
"""


@pytest.fixture(scope="module")
def drawings(folder):
    drawing = ezdxf.new()
    drawing.units = ezdxf.units.MM
    for k in range(4):
        drawing.modelspace().add_circle((24 * k, 20), 9 - k, dxfattribs={"layer": "CUT"})
    drawing.saveas(folder / "rings.dxf")


@pytest.fixture
def studio(page):
    page.wait("#view2d", run="own")
    page.tab("contours")
    page.find("#panel .seek input").fill("")
    yield page
    # The undo list restores the file byte by byte.
    if page.find("#undo").is_enabled():
        with page.renewing():
            open_steps(page)
            page.find("#steps [data-step='0']").click()
    assert page.text == JOB


def open_steps(studio):
    """Open the list of undo steps."""
    studio.find("#steps-open").click()
    expect(studio.find("#steps")).to_be_visible()


def data_of(studio):
    """Keys of the job in the page."""
    return load(studio.text, "")


def search(studio, words):
    """Search settings."""
    studio.find("#panel .seek input").fill(words)


def test_the_undo_list_names_steps_and_goes_to_them(studio):
    texts = [studio.text]
    studio.tab("process")
    for key, value in (("limits.speed", "40 mm/s"), ("corners.tolerance", "0.1 mm")):
        with studio.changing():
            studio.type(key, value)
        texts.append(studio.text)
    area = studio.find("#tab-text textarea")
    open_steps(studio)
    steps = studio.find("#steps button")
    expect(steps).to_have_count(3)
    expect(steps.nth(1)).to_contain_text("40 mm/s")
    expect(steps.nth(2)).to_contain_text("0.1 mm")
    expect(steps.nth(2)).to_have_attribute("aria-current", "step")
    for k in (0, 2, 1):
        with studio.renewing():
            steps.nth(k).click()
        # A choice closes the list.
        expect(studio.find("#steps")).to_be_hidden()
        expect(area).to_have_value(texts[k])
        open_steps(studio)
        expect(steps.nth(k)).to_have_attribute("aria-current", "step")
    # Arrow keys move in the list.
    expect(steps.nth(1)).to_be_focused()
    studio.page.keyboard.press("ArrowDown")
    with studio.renewing():
        studio.page.keyboard.press("Enter")
    expect(area).to_have_value(texts[2])
    expect(studio.find("#steps")).to_be_hidden()


def test_contours_are_ordered_by_dragging(studio):
    rows = studio.find("ol.contours li")
    expect(rows).to_have_count(4)
    names = studio.find("ol.contours .name").all_inner_texts()
    mouse = studio.page.mouse
    first = rows.nth(0).bounding_box()
    third = rows.nth(2).bounding_box()
    mouse.move(first["x"] + 60, first["y"] + first["height"] / 2)
    mouse.down()
    mouse.move(third["x"] + 60, third["y"] + third["height"] - 4, steps=6)
    expect(rows.nth(3)).to_have_class("drop-before")
    with studio.changing():
        mouse.up()
    moved = [names[1], names[2], names[0], names[3]]
    expect(studio.find("ol.contours .name")).to_have_text(moved)
    orders = {k: x["order"] for k, x in data_of(studio)["path"]["contours"].items()}
    assert len(orders) == 3 and len(set(orders.values())) == 3
    # All of it is one step, and Escape ends a drag without a change.
    open_steps(studio)
    expect(studio.find("#steps button")).to_have_count(2)
    studio.page.keyboard.press("Escape")
    text = studio.text
    first = rows.nth(0).bounding_box()
    mouse.move(first["x"] + 60, first["y"] + first["height"] / 2)
    mouse.down()
    mouse.move(third["x"] + 60, third["y"] + third["height"] - 4, steps=6)
    studio.page.keyboard.press("Escape")
    mouse.up()
    assert studio.text == text
    expect(studio.find("ol.contours .drop-before")).to_have_count(0)


def test_weave_and_tabs_are_added_by_one_click(studio):
    search(studio, "weave")
    fold = studio.find("#panel details[data-key='process.weave'] + .usual-values")
    expect(fold).to_contain_text("pitch 2 mm")
    with studio.renewing():
        fold.click()
    assert data_of(studio)["process"]["weave"] == {"width": "4 mm", "pitch": "2 mm"}
    expect(fold).to_have_count(0)
    with studio.renewing():
        studio.find("#undo").click()
    search(studio, "tabs")
    with studio.renewing():
        studio.find("#panel details[data-key='process.tabs'] + .usual-values").click()
    process = data_of(studio)["process"]
    assert set(process) == {"tabs", "switch"}
    studio.wait("#view2d", rev=studio.told("body", "rev"), stale="false")
    assert studio.told("body", "refused") != "true"


def test_a_weave_without_its_pitch_offers_one(studio):
    search(studio, "weave")
    studio.type("process.weave.width", "3 mm")
    refusal = studio.find("#panel .refused").first
    with studio.renewing():
        refusal.get_by_role("button", name="pitch").click()
    assert data_of(studio)["process"]["weave"] == {"width": "3 mm", "pitch": "2 mm"}


def test_a_refused_value_keeps_its_sentence_and_button(studio):
    search(studio, "pierce")
    studio.type("process.pierce.time", "0.3 s")
    field = studio.slider("process.pierce.time").locator("input")
    refusal = studio.find("#panel .refused")
    button = refusal.get_by_role("button", name="torch")
    expect(button).to_be_visible()
    # Another refused value, and an accepted one, elsewhere.
    search(studio, "corner")
    studio.type("corners.tolerance", "-1 mm")
    expect(refusal).to_have_count(1)
    search(studio, "kerf")
    with studio.renewing():
        studio.type("process.kerf", "1 mm")
    search(studio, "pierce")
    expect(field).to_have_value("0.3 s")
    expect(field).to_have_attribute("aria-invalid", "true")
    expect(button).to_be_visible()
    # Enter tries again, without retyping.
    before = refusal.inner_text()
    field.press("Enter")
    expect(button).to_be_visible()
    assert refusal.inner_text() == before and "pierce" not in data_of(studio)["process"]
    # Another page adds the output: Enter is enough.
    other = "process: {kerf: 1 mm, switch: {name: torch}}"
    text = studio.text.replace("process: {kerf: 1 mm}", other)
    assert other in text
    studio.tab("text")
    studio.find("#tab-text textarea").fill(text)
    with studio.renewing():
        studio.page.keyboard.press("Control+Enter")
    expect(field).to_have_attribute("aria-invalid", "true")
    with studio.renewing():
        field.press("Enter")
    assert data_of(studio)["process"]["pierce"] == {"time": "0.3 s"}
    expect(studio.find("[aria-invalid=true][id*=pierce]")).to_have_count(0)
    # What is still refused elsewhere is given up with Escape.
    search(studio, "corner")
    studio.slider("corners.tolerance").locator("input[type=text]").press("Escape")
    expect(refusal).to_have_count(0)


@pytest.mark.parametrize("typed", ["0,1", "0,1 mm"])
def test_a_decimal_comma_is_repaired_by_one_click(studio, typed):
    studio.tab("process")
    studio.type("corners.tolerance", typed)
    refusal = studio.find("#panel .refused")
    with studio.renewing():
        refusal.get_by_role("button", name="0.1 mm").click()
    expect(refusal).to_have_count(0)
    assert data_of(studio)["corners"]["tolerance"] == "0.1 mm"


def test_a_new_run_is_shown_and_edited(studio):
    studio.tab("runs")
    studio.find("#tab-runs").get_by_role("button", name="New run").click()
    studio.find("#question input").fill("slow")
    with studio.renewing():
        studio.find("#question").get_by_role("button", name="OK").click()
    expect(studio.find("#run")).to_have_value("slow")
    studio.tab("process")
    with studio.renewing():
        studio.type("limits.speed", "20 mm/s")
    data = data_of(studio)
    assert data["runs"] == {"own": {}, "slow": {"limits": {"speed": "20 mm/s"}}}
    assert data["limits"] == {"speed": "50 mm/s"}
    # The comparison says of what it is.
    digest = hashlib.sha256(studio.text.encode()).hexdigest()
    expect(studio.find("#tab-runs .made")).to_contain_text(digest[:8])
    studio.find("#panel .seek").get_by_role("button", name="For job").click()


def test_a_result_says_when_it_was_made_and_what_has_changed(studio, folder):
    studio.rest()
    result = studio.do("export", {"format": "csv"})
    studio.wait(".task-result[data-task=export]", state="done", outdated="false")
    digest = hashlib.sha256(JOB.encode()).hexdigest()
    expect(result.locator(".made")).to_contain_text("rings")
    expect(result.locator(".made")).to_contain_text(digest[:8])
    drawing = hashlib.sha256((folder / "rings.dxf").read_bytes()).hexdigest()
    expect(result.locator(".made")).to_contain_text(drawing[:8])
    studio.tab("process")
    with studio.changing():
        studio.type("limits.speed", "40 mm/s")
    studio.wait(".task-result[data-task=export]", outdated="true")
    expect(result.locator(".outdated")).to_contain_text("50 mm/s → 40 mm/s")
    expect(studio.find("#bar [data-opens=export] .chip")).to_be_visible()
    # Making it again makes it for the job as it is now, with the same choices.
    result.get_by_role("button", name="Make again").click()
    studio.wait_for(".task-result[data-task=export][data-state=done][data-outdated=false]")
    expect(studio.find("#bar [data-opens=export] .chip")).to_have_count(0)
    name, _ = studio.save_file(studio.find(".task-result [data-file]").first)
    assert name.endswith(".csv")


def test_lengths_are_shown_and_typed_in_inches(studio):
    text = studio.text
    studio.tab("process")
    speed = studio.slider("limits.speed").locator("input[type=text]")
    studio.rest()
    off = studio.figure("off_drawing")
    studio.find("#units").click()
    assert float(speed.input_value().removesuffix(" in/s")) * 25.4 == pytest.approx(50, rel=1e-4)
    shown = studio.find("[data-figure=off_drawing]")
    expect(shown.locator(".unit")).to_contain_text("in")
    assert float(shown.locator(".value").inner_text()) == pytest.approx(off / 0.0254, rel=5e-3)
    # The display changes neither the file nor the figures, and a number is in the shown unit.
    assert studio.text == text and studio.figure("off_drawing") == off
    with studio.renewing():
        studio.type("limits.speed", "1")
    assert data_of(studio)["limits"] == {"speed": "1 in/s"}
    studio.find("#units").click()
    expect(shown.locator(".unit")).to_contain_text("mm")
    studio.rest()


def test_charts_tables_and_tips_are_in_inches(studio):
    studio.rest()
    studio.find("#units").click()
    # The speed of 50 mm/s is 1.97 in/s.
    studio.tab("charts")
    summary = studio.find("[data-chart=speed] .chart-summary")
    expect(summary).to_have_text("At most 1.97 in/s.")
    expect(studio.find("[data-chart=error] .chart-summary")).to_contain_text(" in")
    studio.tab("runs")
    row = studio.find("#tab-runs tbody tr").first
    expect(row).to_contain_text(" in")
    expect(row).not_to_contain_text(" mm")
    studio.tab("tasks")
    expect(studio.find("form[data-task=certify]")).to_contain_text("in, or as in the job")
    x, y = studio.middle(studio.find("#playback .track"))
    studio.page.mouse.move(x, y)
    expect(studio.find("#playback .tip")).to_contain_text("in/s")
    # Back in millimetres, the charts follow.
    studio.find("#units").click()
    studio.tab("charts")
    expect(summary).to_have_text("At most 50 mm/s.")


def test_fields_show_the_unit_of_a_typed_number(studio):
    studio.tab("contours")
    group = studio.find("#panel details[data-group=Part]")
    if group.get_attribute("open") is None:
        group.locator("summary").first.click()
    search(studio, "position")
    field = studio.slider("path.frame.position")
    expect(field.locator("input")).to_have_value("420 mm, -20 mm, 100 mm")
    # The texts have their own units, and a number takes that of its place.
    expect(field.locator(".from")).to_have_text("")
    with studio.renewing():
        studio.type("path.frame.position", "0.43 m, -21, 101")
    assert data_of(studio)["path"]["frame"]["position"] == ["0.43 m", "-21 mm", "101 mm"]
    search(studio, "rpy")
    angles = studio.slider("path.frame.rpy")
    expect(angles.locator(".from")).to_have_text("deg")
    with studio.renewing():
        studio.type("path.frame.rpy", "0, 0, 15")
    assert data_of(studio)["path"]["frame"]["rpy"][2] == "15 deg"
    search(studio, "")


def test_tip_at_a_dragged_corner_is_not_under_the_tools(studio, folder):
    square = "points: [[0, 0, 0], [0.05, 0, 0], [0.05, 0.03, 0], [0, 0.03, 0], [0, 0, 0]]"
    (folder / "square.yaml").write_text(JOB.replace("file: rings.dxf", square))
    studio.open(folder / "square.yaml")
    studio.rest()
    tools = studio.find("#viewbar .tools").bounding_box()
    for index in (0, 1, 2):
        with studio.grabbing(studio.handle("corner", index)) as (x, y):
            studio.page.mouse.move(x + 6, y + 6, steps=3)
            tip = studio.find(".at-pointer")
            expect(tip).to_be_visible()
            box = tip.bounding_box()
            assert box["x"] >= tools["x"] + tools["width"]
            region = studio.find("#view2d").bounding_box()
            assert box["x"] + box["width"] <= region["x"] + region["width"]
            studio.page.keyboard.press("Escape")
    studio.open(folder / "job.yaml")


def test_tilt_that_the_file_overrides_is_disabled_and_grey(studio, folder):
    """The file states the tool axis at each point."""
    rows = "".join(f"{x},0,0,0,0,-1\n" for x in (0, 20, 40))
    (folder / "axes.csv").write_text(f"x [mm],y [mm],z [mm],ax,ay,az\n{rows}")
    (folder / "axes.yaml").write_text(JOB.replace("rings.dxf", "axes.csv"))
    look = "e => getComputedStyle(e).backgroundColor + getComputedStyle(e).color"
    tilt = studio.find("#panel [data-key=tilt] input")
    looks = []
    for name in ("axes.yaml", "job.yaml"):
        studio.open(folder / name)
        studio.tab("robot")
        group = studio.find("#panel details[data-group='Tool and tilt']")
        if group.get_attribute("open") is None:
            group.locator("summary").first.click()
        expect(tilt).to_be_enabled(enabled=name == "job.yaml")
        looks.append(tilt.evaluate(look))
    assert looks[0] != looks[1]


def test_all_corners_are_one_stop_of_the_tab_key(studio, folder):
    square = "points: [[0, 0, 0], [0.05, 0, 0], [0.05, 0.03, 0], [0, 0.03, 0], [0, 0, 0]]"
    (folder / "square.yaml").write_text(JOB.replace("file: rings.dxf", square))
    studio.open(folder / "square.yaml")
    studio.rest()
    for kind, count in (("corner", 3), ("waypoint", 4)):
        handles = studio.find(f"g.handle.{kind}")
        assert handles.count() >= count
        stops = studio.find(f"g.handle.{kind}[tabindex='0']")
        expect(stops).to_have_count(1)
        stops.focus()
        # The keys go around all handles of the kind; the last one with the focus is the stop.
        expect(handles.first).to_be_focused()
        studio.page.keyboard.press("PageUp")
        expect(handles.last).to_be_focused()
        studio.page.keyboard.press("PageDown")
        studio.page.keyboard.press("PageDown")
        expect(handles.nth(1)).to_be_focused()
        expect(stops).to_have_count(1)
        studio.page.keyboard.press("Tab")
        expect(studio.find(f"g.handle.{kind}:focus")).to_have_count(0)
        studio.page.keyboard.press("Shift+Tab")
        expect(handles.nth(1)).to_be_focused()
    studio.open(folder / "job.yaml")
    studio.rest()


def test_no_contour_of_another_job_is_selected(studio, folder):
    studio.select_contour(0)
    expect(studio.find("ol.contours [aria-pressed=true]")).to_have_count(1)
    (folder / "other.yaml").write_text(JOB)
    studio.open(folder / "other.yaml")
    studio.rest()
    expect(studio.find("ol.contours li")).to_have_count(4)
    expect(studio.find("ol.contours [aria-pressed=true]")).to_have_count(0)
    studio.open(folder / "job.yaml")
    studio.rest()


def test_a_pierce_after_a_lead_in_is_planned_and_both_are_added_by_one_click(studio):
    studio.select_contour(0)
    section = studio.find("section[aria-label='Selected contour']")
    for name in ("lead in", "pierce"):
        with studio.changing():
            section.get_by_role("button", name=f"Add {name}").click()
    assert studio.find("#messages .refusal").is_hidden()
    (own,) = data_of(studio)["path"]["contours"].values()
    assert own["lead_in"]["active"] is True and own["lead_in"]["shape"] == "arc"
    assert own["pierce"]["time"] == "0.5 s"


def test_the_search_of_settings_ends_when_another_job_is_opened(studio, folder):
    search(studio, "tilt")
    (folder / "other.yaml").write_text(JOB)
    studio.open(folder / "other.yaml")
    expect(studio.find("#panel .seek input")).to_have_value("")
    studio.open(folder / "job.yaml")
    studio.rest()


def test_speed_of_a_contour_above_that_of_the_job_is_told_with_a_remedy(studio):
    studio.select_contour(0)
    section = studio.find("section[aria-label='Selected contour']")
    field = section.locator(".setting[data-key$='.speed']")
    entry = field.locator("input[type=text]")
    with studio.renewing():
        entry.fill("40 mm/s")
        entry.press("Enter")
    expect(field.locator(".capped")).to_have_count(0)
    with studio.renewing():
        entry.fill("60 mm/s")
        entry.press("Enter")
    told = field.locator(".capped")
    expect(told).to_contain_text("50 mm/s")
    with studio.renewing():
        told.get_by_role("button").click()
    assert data_of(studio)["limits"]["speed"] == "60 mm/s"
    expect(told).to_have_count(0)


def test_messages_show_code_without_backticks(studio, folder):
    before = studio.text
    text = before.replace("\nruns: {", "\nruns: {more: {servo: {kp: 20, kv: 150}}, ", 1)
    with pytest.raises(InvalidInput, match="`armcontour batch`"):
        parse_job(text, folder=folder)
    studio.tab("text")
    studio.find("#tab-text textarea").fill(text)
    studio.page.keyboard.press("Control+Enter")
    message = studio.find("#messages .message").filter(has_text="armcontour batch").first
    expect(message).to_be_visible()
    assert "`" not in message.inner_text()
    # The refused text is no state of the job.
    studio.find("#tab-text textarea").fill(before)
    studio.page.keyboard.press("Control+Enter")
    expect(message).to_have_count(0)
