"""The start page and the pen in a real browser: from a card or a shape to a planned motion."""

import re

import pytest
from playwright.sync_api import expect
from tests.browser.axe_faults import faults, load_axe
from tests.browser.test_journeys import agree
from tools.studio_page import serving, write_job

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


def choose(studio, shape):
    """Take the pen."""
    button = studio.find("[aria-label=Pen]").get_by_role("button", name=shape)
    if button.get_attribute("aria-pressed") != "true":
        button.click()


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


def test_j50_the_first_motion_of_an_own_rectangle(started, judge):
    studio = started
    take(studio, "empty")
    text = studio.text
    draw(studio, (-100, 60), (20, -30))
    studio.rest()
    agree(studio, judge(studio, "compensated"))
    # It has whole millimetres, and the handles can be grabbed.
    expect(studio.find("g.handle.waypoint")).to_have_count(5)
    numbers = re.findall(r"\{to: \[([^,]*) mm, ([^,]*) mm", studio.text)
    assert len(numbers) == 4 and all(float(x) == round(float(x)) for p in numbers for x in p)
    with studio.changing():
        studio.drag(studio.handle("waypoint", 1), (15, 5))
    agree(studio, judge(studio, "compensated"))
    for _ in range(2):
        with studio.renewing():
            studio.find("#undo").click()
    assert studio.text == text
    expect(studio.find(".hint")).to_be_visible()


def test_j51_each_shape_is_drawn_to_typed_values_and_goes_on_at_the_end(started, judge):
    studio = started
    take(studio, "empty")
    choose(studio, "Line")
    with studio.renewing():
        draw(studio, (-120, 80), (0, 80), typed="120, 30")
    end = r"120 mm, 30 mm, 0 mm"
    assert re.search(end, studio.text)
    # The next line begins at the end, where it is pressed near by.
    choose(studio, "Arc")
    x, y = studio.middle(studio.handle("waypoint", 1))
    mx, my = studio.middle(studio.find("#view2d"))
    with studio.renewing():
        draw(studio, (x - mx + 3, y - my - 3), (60, -40))
    assert len(re.findall("via:", studio.text)) == 1 and len(re.findall(r"\bto:", studio.text)) == 2
    choose(studio, "Circle")
    with studio.renewing():
        draw(studio, (100, 0), (120, 0), typed="25")
    assert "angle: 360 deg" in studio.text
    studio.rest()
    agree(studio, judge(studio, "compensated"))
    for _ in range(3):
        with studio.renewing():
            studio.find("#undo").click()
    expect(studio.find(".hint")).to_be_visible()
    # By keys alone: the pen has the focus, values, Enter.
    choose(studio, "Rectangle")
    studio.find("rect.pen").focus()
    with studio.changing():
        studio.page.keyboard.type("60x40")
        studio.page.keyboard.press("Enter")
    agree(studio, judge(studio, "compensated"))
    assert len(re.findall(r"\bto:", studio.text)) == 4


def test_j52_each_card_leads_to_a_motion(started, judge):
    studio = started
    for card, arm, run in (
        ("drawing", "ur10e", "compensated"),
        ("gcode", "fr3", "compensated"),
        ("weld", "ur5e", "compensated"),
        ("paper", "ur5e", "optimal"),
    ):
        take(studio, card, arm)
        studio.wait("#view2d", run=run)
        studio.rest()
        assert studio.figure("duration") > 1
        assert arm in studio.text or card == "paper"
    agree(studio, judge(studio, "optimal"))


def test_j55_the_pen_by_keys_draws_no_shape_without_a_side(started, judge):
    studio = started
    take(studio, "weld")
    take(studio, "empty")
    text, keys = studio.text, studio.page.keyboard
    pen = studio.find("rect.pen")
    for press in (("ArrowRight", "Enter"), ("Enter",), ("Escape",)):
        pen.focus()
        for key in press:
            keys.press(key)
        expect(pen).to_be_visible()
        assert studio.page.evaluate("() => document.activeElement.classList.contains('pen')")
        assert studio.text == text
    # By the mouse, too.
    draw(studio, (-100, 60), (20, 60))
    studio.wait("body", busy="false")
    assert studio.text == text
    pen.focus()
    with studio.changing():
        for key in ("Shift+ArrowRight", "Shift+ArrowRight", "Shift+ArrowUp", "Enter"):
            keys.press(key)
    assert len(re.findall(r"\bto:", studio.text)) == 4
    assert studio.page.evaluate("() => document.activeElement.ariaLabel") == "Rectangle"
    agree(studio, judge(studio, "compensated"))


def test_j56_figures_that_are_not_known_leave_no_notes(started):
    studio = started
    take(studio, "paper")
    studio.rest()
    written = re.compile(".")
    notes = studio.find(".figure[data-value=''] .note:visible").filter(has_text=written)
    changes = studio.find("#changes")
    expect(studio.find("#figures .note:visible").filter(has_text=written).first).to_be_visible()
    expect(studio.find("#figures:not([data-changes=''])")).to_be_visible()
    shown = changes.text_content() or ""
    # Refused, and the start of another job.
    studio.drag(studio.handle("waypoint", 1), (320, 0))
    studio.wait("body", refused="true", busy="false")
    expect(studio.find(".figure[data-value='']:visible").first).to_be_visible()
    expect(notes).to_have_count(0)
    expect(changes).not_to_contain_text("%")
    take(studio, "empty")
    expect(studio.find("#figures .value").filter(has_text=re.compile("[0-9]"))).to_have_count(0)
    expect(notes).to_have_count(0)
    expect(changes).not_to_contain_text("%")
    take(studio, "paper")
    studio.rest()
    expect(changes).to_have_text(shown.strip())


def test_j53_new_loses_nothing_and_recent_files_come_back(started, pages, tmp_path):
    studio = started
    take(studio, "drawing")
    with studio.changing():
        studio.type("limits.speed", "77 mm/s")
    changed = studio.text
    take(studio, "empty")
    expect(studio.find("#messages")).to_contain_text("unsaved")
    # A file that was opened by a command before, and one that has vanished.
    studio.find("#new").click()
    recent = studio.find("#start .recent button")
    expect(recent).to_have_count(1)
    with studio.changing():
        recent.first.click()
    assert studio.text == changed
    file = write_job(tmp_path / "mine.yaml", "optimal")
    gone = write_job(tmp_path / "gone.yaml", "optimal")
    for x in (gone, file):
        with serving(x, folder=tmp_path) as server:
            page = pages(server)
            page.begin()
            page.is_cut_off = True
    gone.unlink()
    studio.find("#new").click()
    expect(recent.filter(has_text="gone.yaml")).to_have_count(0)
    with studio.changing():
        recent.filter(has_text="mine.yaml").click()
    assert studio.text == file.read_text()
    expect(studio.find("#name")).to_have_attribute("title", str(file))


@pytest.mark.parametrize(("colours", "width"), [("light", 1400), ("dark", 500)])
def test_j54_the_start_page_has_no_fault(started, pages, colours, width):
    studio = pages(started.server, colours=colours, size=(width, 900))
    studio.wait_for("#start[open]")
    load_axe(studio.page)
    page_faults = faults(studio.page)
    # By keys: an arm is chosen with arrows, a card with Tab and Enter.
    keys = studio.page.keyboard
    assert studio.page.evaluate("() => document.activeElement.value") == "ur5e"
    keys.press("ArrowLeft")
    keys.press("Tab")
    with studio.renewing():
        keys.press("Enter")
    assert "ur10e" in studio.text
    expect(studio.find("rect.pen")).to_be_visible()
    page_faults += faults(studio.page)
    assert not page_faults, "\n".join(page_faults)


def test_j57_a_running_studio_keeps_its_drafts(pages, tmp_path):
    file = write_job(tmp_path / "job.yaml", "optimal")
    with serving(file, folder=tmp_path) as first:
        studio = pages(first)
        studio.begin()
        with studio.renewing():
            studio.type("limits.speed", "77 mm/s")
        changed = studio.text
        # A job without a file is in the same folder.
        take(studio, "drawing")
        with studio.renewing():
            studio.type("limits.speed", "66 mm/s")
        with serving(file, folder=tmp_path) as second:
            other = pages(second)
            other.begin()
            assert not other.told("body", "draft")
            expect(other.find("#question")).to_be_hidden()
            with other.renewing():
                other.type("limits.speed", "55 mm/s")
            other.is_cut_off = True
        studio.is_cut_off = True
    with serving(file, folder=tmp_path) as third:
        again = pages(third)
        again.wait_for("#question[open]")
        with again.renewing():
            again.find("#question").get_by_role("button", name="Take them up").click()
        assert again.text == changed
        # The start page has the others: that of the drawing, and that of the second Studio.
        again.find("#new").click()
        drafts = again.find("#start .drafts button")
        expect(drafts.filter(has_text="job.yaml")).to_have_count(1)
        expect(drafts.filter(has_text="plate.yaml")).to_have_count(1)
