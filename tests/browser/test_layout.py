"""Layout at four widths: no text is cut or lies over another one, and targets fit fingers."""

import re

import ezdxf
import pytest
from playwright.sync_api import expect
from tests.browser.text_boxes import small_targets, text_faults
from tests.dynamics_extra import needs_dynamics
from tools.studio_page import TWO_FRAMES, serving, write_job, write_shapes

pytestmark = [pytest.mark.browser, needs_dynamics]
SIZES = ((390, 844), (820, 1180), (1440, 900), (1920, 1080))
JOB = """\
name: bracket of the left door
arm: ur5e
path:
  file: plate.dxf
  frame: {position: [420 mm, -20 mm, 100 mm]}
  orientation: {axis: [0, 0, -1]}
limits: {speed: 120 mm/s}
corners: {tolerance: 0.2 mm}
accuracy: 0.5 mm
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {own: {}}
"""


@pytest.fixture(scope="module")
def drawings(folder):
    drawing = ezdxf.new()
    drawing.units = ezdxf.units.MM
    for k in range(4):
        layer = {"layer": "CUT" if k % 2 else "MARKING"}
        drawing.modelspace().add_circle((24 * k, 0), 8 - k, dxfattribs=layer)
    drawing.saveas(folder / "plate.dxf")


def check(studio, where):
    """No text is cut or over another one, and nothing scrolls sideways."""
    faults = text_faults(studio.page)
    assert not faults, (where, faults)
    wide = "x => document.querySelector(x).scrollWidth - document.querySelector(x).clientWidth"
    for region in ("html", "#panel", "#sides", "#bar", "#tabs", "#dock-bar"):
        assert studio.page.evaluate(wide, region) <= 0, (where, region)


def begin(pages, size):
    """A page that shows the job as its file has it."""
    studio = pages(size=size)
    studio.begin()
    while studio.find("#undo").is_enabled():
        with studio.renewing():
            studio.find("#undo").click()
    studio.rest()
    return studio


def write_many(job, count, columns, pitch, radius):
    """Write a job with many contours, and its drawing beside it; return the job."""
    drawing = job.with_suffix(".dxf")
    write_shapes(drawing, count, columns=columns, pitch=pitch, radius=radius)
    text = JOB.replace("plate.dxf", drawing.name).replace("420 mm, -20 mm", "380 mm, -60 mm")
    job.write_text(text)
    return job


def open_settings(studio, side):
    """Open a tab of the settings, which are a drawer in narrow pages."""
    if studio.find("#panel-open").is_visible() and studio.told("body", "drawer") != "open":
        studio.find("#panel-open").click()
    studio.tab(side)


def close_settings(studio):
    """Close the drawer, if the settings are one."""
    if studio.find("#panel-close").is_visible():
        studio.find("#panel-close").click()
        expect(studio.find("#panel")).to_be_hidden()


@pytest.mark.parametrize("size", SIZES, ids=[str(x[0]) for x in SIZES])
def test_no_text_is_cut_or_over_another_one(size, pages):
    studio = begin(pages, size)
    width = size[0]
    check(studio, (width, "kept"))
    # The drawing has most of a wide page.
    assert width < 1000 or studio.find("#stage").bounding_box()["height"] >= 600
    for side in ("contours", "process", "robot", "notes"):
        open_settings(studio, side)
        check(studio, (width, side))
    studio.select_contour(0)
    check(studio, (width, "a contour"))
    studio.tab("process")
    # A run that is not kept has longer figures, and its settings are changed.
    with studio.changing():
        studio.type("accuracy", "0.001 mm")
    close_settings(studio)
    check(studio, (width, "not kept"))
    # A refused value has a sentence with a button.
    open_settings(studio, "process")
    studio.find("#panel .seek input").fill("pierce")
    studio.type("process.pierce.time", "0.3 s")
    expect(studio.find("#panel .refused")).to_be_visible()
    check(studio, (width, "refused"))
    studio.find("#panel .seek input").fill("")
    close_settings(studio)
    for tab in ("runs", "tasks", "charts", "waypoints"):
        studio.tab(tab)
        check(studio, (width, tab))
    studio.do("report")
    studio.wait(".task-result[data-task=report]", state="done", outdated="false")
    check(studio, (width, "report"))
    with studio.changing():
        studio.find("#undo").click()
    studio.wait(".task-result[data-task=report]", outdated="true")
    check(studio, (width, "outdated"))
    studio.find("#dock-toggle").click()
    studio.find("#steps-open").click()
    check(studio, (width, "steps"))
    studio.page.keyboard.press("Escape")
    if studio.find("#menu-open").is_visible():
        studio.find("#menu-open").click()
        check(studio, (width, "menu"))
    studio.find("#units").click()
    studio.page.keyboard.press("Escape")
    check(studio, (width, "inches"))
    # A text that is cut is found.
    studio.find("#tab-button-charts").evaluate(
        "e => { e.style.width = '12px'; e.style.overflow = 'hidden' }"
    )
    assert text_faults(studio.page)


@pytest.mark.parametrize("size", SIZES[:2], ids=[str(x[0]) for x in SIZES[:2]])
def test_narrow_pages_show_the_stage_and_targets_for_fingers(size, pages):
    studio = begin(pages, size)
    # Nothing scrolls: header, verdict, drawing and time are in one screen.
    assert studio.page.evaluate("document.documentElement.scrollHeight <= innerHeight")
    stage = studio.find("#stage").bounding_box()
    assert stage["height"] > 0.35 * size[1] and stage["y"] < 130
    figures = studio.find("#figures").bounding_box()
    assert figures["height"] < 70
    expect(studio.find("#panel")).to_be_hidden()
    assert not small_targets(studio.page)
    # The settings are a drawer, which Escape and a click beside it close.
    studio.find("#panel-open").click()
    expect(studio.find("#panel")).to_be_in_viewport(ratio=0.9)
    # The figures that an edit changes are above the drawer, the error with its limit.
    assert studio.find("#panel").bounding_box()["y"] >= figures["y"] + figures["height"] - 1
    expect(studio.find("[data-figure=off_drawing]")).to_contain_text("of 0.5 mm")
    expect(studio.find("[data-figure=off_drawing] .of")).to_be_visible()
    assert not small_targets(studio.page)
    studio.select_contour(0)
    expect(studio.find("ol.contours [aria-pressed=true]")).to_have_count(1)
    studio.find("#tab-button-contours").press("Escape")
    expect(studio.find("#panel")).to_be_hidden()
    expect(studio.find("#panel-open")).to_be_focused()
    studio.find("#panel-open").click()
    expect(studio.find("#panel")).to_be_visible()
    studio.page.mouse.click(8, size[1] / 2)
    expect(studio.find("#panel")).to_be_hidden()
    # The click closed the drawer, and the contour stays selected.
    expect(studio.find("ol.contours [aria-pressed=true]")).to_have_count(1)


def test_outdated_results_and_notes_do_not_wrap_a_bar(pages):
    studio = begin(pages, (1400, 900))
    height = studio.find("#bar").bounding_box()["height"]
    for task in ("report", "export"):
        studio.do(task)
        studio.wait(f".task-result[data-task={task}]", state="done", outdated="false")
    studio.tab("process")
    with studio.renewing():
        studio.type("limits.speed", "100 mm/s")
    for task in ("report", "export"):
        studio.wait(f".task-result[data-task={task}]", outdated="true")
        expect(studio.find(f"#bar [data-opens={task}] .chip")).to_be_visible()
    assert studio.find("#bar").bounding_box()["height"] == height
    for size in ((1400, 900), (1920, 1080)):
        studio.page.set_viewport_size({"width": size[0], "height": size[1]})
        studio.find("#tab-button-notes").evaluate("e => (e.textContent = 'Notes (12)')")
        assert studio.find("#sides").evaluate("e => e.scrollWidth <= e.clientWidth")


def test_messages_lie_beside_the_stage(pages):
    for size in SIZES:
        studio = begin(pages, size)
        studio.page.evaluate("() => import('/static/messages.js').then((x) => x.notify('Saved.'))")
        message = studio.find("#messages .message:visible").first
        expect(message).to_be_visible()
        stage = studio.find("#stage").bounding_box()
        box = message.bounding_box()
        across = min(stage["x"] + stage["width"], box["x"] + box["width"]) - max(
            stage["x"], box["x"]
        )
        down = min(stage["y"] + stage["height"], box["y"] + box["height"]) - max(
            stage["y"], box["y"]
        )
        assert across <= 0 or down <= 0
        studio.close()


def test_120_contours_are_listed(pages, folder):
    job = write_many(folder / "many.yaml", 120, columns=12, pitch=12, radius=4)
    studio = pages(size=(1440, 900))
    studio.begin()
    studio.open(job)
    expect(studio.find("ol.contours li")).to_have_count(120)
    check(studio, "120 contours")
    # The last row is reached in the list, and its contour is shown.
    studio.select_contour(-1)
    check(studio, "120 contours")


def test_every_one_of_many_contours_is_reached_in_the_list(pages, folder):
    job = write_many(folder / "more.yaml", 230, columns=20, pitch=6, radius=2)
    studio = pages(size=(1440, 900))
    studio.begin()
    studio.open(job)
    rows = studio.find("ol.contours li")
    expect(rows).to_have_count(200)
    pages_of = studio.find("#tab-contours .pages")
    expect(pages_of.get_by_role("button", name="Earlier")).to_be_disabled()
    pages_of.get_by_role("button", name="Later").click()
    expect(rows).to_have_count(30)
    expect(rows.last).to_contain_text("230")
    check(studio, "second page")
    pages_of.get_by_role("button", name="Earlier").click()
    expect(rows).to_have_count(200)
    # A number finds its contour, and other words find names.
    search = studio.find("#tab-contours input[type=search]")
    search.fill("217")
    expect(rows).to_have_count(1)
    rows.first.locator("button").first.click()
    expect(studio.find("ol.contours [aria-pressed=true]")).to_contain_text("217")
    # The next contour is not in the search: its page is shown, scrolled to its row.
    expect(rows.first.locator(".time")).to_contain_text("s")
    rows.first.locator("button").first.click()
    rows.first.locator("button").first.click()
    studio.page.keyboard.press("]")
    selected = studio.find("ol.contours [aria-pressed=true]")
    expect(selected).to_contain_text("218")
    expect(search).to_have_value("")
    place_in_list = """row => {
        const [inner, outer] = [row, row.closest("ol")].map((x) => x.getBoundingClientRect());
        return [inner.top - outer.top, outer.bottom - inner.bottom];
    }"""
    assert all(x >= 0 for x in selected.evaluate(place_in_list))
    # So is the one before, on the page before.
    search.fill("201")
    expect(rows).to_have_count(1)
    rows.first.locator("button").first.click()
    studio.find("body").press("[")
    expect(selected).to_contain_text("200")
    assert all(x >= 0 for x in selected.evaluate(place_in_list))
    search.fill("217")
    expect(rows).to_have_count(1)
    rows.first.locator("button").first.click()
    search.fill("no such layer")
    expect(rows).to_have_count(0)
    # Without the search, the page of the selected contour is shown when it is selected again.
    search.fill("")
    expect(rows).to_have_count(200)
    pages_of.get_by_role("button", name="Later").click()
    expect(selected).to_contain_text("217")
    # Arrow keys move within the page.
    selected.focus()
    studio.page.keyboard.press("ArrowDown")
    assert "218" in studio.page.evaluate("document.activeElement.textContent")
    studio.close()


def stops_of(studio):
    """Press Tab once around the page; returns the element and the group of each stop."""
    where = """() => {
        const e = document.activeElement;
        const { x, y, right, bottom } = e.getBoundingClientRect();
        const isSeen = right > 0 && bottom > 0 && x < innerWidth && y < innerHeight;
        return [e.tagName, e.getAttribute("aria-label") || e.title || e.textContent.trim(), isSeen];
    }"""
    stops = []
    for _ in range(90):
        studio.page.keyboard.press("Tab")
        stops.append(tuple(studio.page.evaluate(where)))
        if stops[-1][0] == "BODY":
            return stops[:-1]
    raise AssertionError("The Tab key does not come to the end of the page.")


def test_tab_key_reaches_all_groups_in_few_steps(pages, folder):
    # An obstacle that is far from the drawing is not in view.
    far = (
        "scene: {obstacles: [{type: box, name: far, size: [20 mm, 20 mm, 20 mm], at: [0, 0.9, 0]}]}"
    )
    (folder / "far.yaml").write_text(f"{JOB}{far}\n")
    studio = pages(size=(1440, 900))
    studio.begin()
    studio.open(folder / "far.yaml")
    studio.rest()
    studio.find("#view2d").wait_for()
    studio.find("a.skip").focus()
    stops = stops_of(studio)
    assert len(stops) < 45
    assert all(is_seen for *_, is_seen in stops), [x for x in stops if not x[2]]
    names = [name for _, name, _ in stops]
    for part in ("New", "Certify", "Select", "Contours", "Play", "Charts"):
        assert sum(part in x for x in names) <= 1, part
    # Arrow keys go around a group, and the group keeps its place.
    tools = studio.find("#viewbar .tools button")
    tools.first.focus()
    for key, index in (("ArrowDown", 1), ("ArrowDown", 2), ("ArrowUp", 1), ("ArrowUp", 0)):
        studio.page.keyboard.press(key)
        expect(tools.nth(index)).to_be_focused()
    studio.page.keyboard.press("ArrowUp")
    expect(tools.last).to_be_focused()
    studio.page.keyboard.press("Enter")
    expect(tools.last).to_have_attribute("aria-pressed", "true")
    studio.page.keyboard.press("Tab")
    studio.page.keyboard.press("Shift+Tab")
    expect(tools.last).to_be_focused()
    studio.close()


def test_choices_are_visible_in_the_colours_of_the_system(pages):
    studio = begin(pages, (1440, 900))
    studio.page.emulate_media(forced_colors="active")
    colour = "e => getComputedStyle(e).backgroundColor"
    for group in ("#viewbar [aria-label='View']", "#panel .choice", "#viewbar .tools"):
        pressed = studio.find(f"{group} [aria-pressed=true]").first.evaluate(colour)
        others = studio.find(f"{group} [aria-pressed=false]").first.evaluate(colour)
        assert pressed != others, group
    # The colours of limits are data.
    keys = {x.evaluate(colour) for x in studio.find(".shares .key").all()}
    assert len(keys) == studio.find(".shares .key").count() > 1
    studio.page.emulate_media(forced_colors="none")
    studio.close()


def test_a_stopped_studio_is_told_over_no_drawer_and_in_a_bar_of_one_line(
    pages, tmp_path, monkeypatch
):
    monkeypatch.setenv("XDG_STATE_HOME", str(tmp_path / "state"))
    job = write_job(tmp_path / "job_with_a_long_name.yaml", "optimal")
    with serving(job, folder=tmp_path) as server:
        studio = pages(server)
        studio.rest()

        def check_bar():
            for width in (901, 960, 1024, 1150, 1280, 1440, 1920):
                studio.page.set_viewport_size({"width": width, "height": 844})
                studio.page.evaluate(TWO_FRAMES)
                bar = studio.find("#bar")
                boxes = [x.bounding_box() for x in bar.locator("button:visible, select").all()]
                middles = [x["y"] + x["height"] / 2 for x in boxes]
                assert max(middles) - min(middles) < 3, width
                assert max(x["x"] + x["width"] for x in boxes) <= width
                assert studio.find("#name").bounding_box()["width"] > 20

        check_bar()
        studio.page.set_viewport_size({"width": 390, "height": 844})
        studio.find("#panel-open").click()
        studio.wait("body", drawer="open")
        studio.is_cut_off = True
        server.stop()
        studio.wait("body", stopped="true", drawer="closed")
        copy = studio.find("#messages").get_by_role("button", name="Save a copy of the job")
        expect(copy).to_be_visible()
        # A click reaches the button, because nothing covers it.
        studio.save_file(copy)
        check_bar()


def test_the_number_of_notes_fits_its_tab_on_a_phone(pages, folder):
    job = write_many(folder / "noted.yaml", 230, columns=20, pitch=6, radius=2)
    studio = pages(size=(390, 844))
    studio.begin()
    studio.open(job)
    studio.rest()
    open_settings(studio, "notes")
    expect(studio.find("#tab-button-notes")).to_have_text(re.compile(r"Notes \(\d+\)"))
    check(studio, "notes")
