"""Settings changed by mouse and keys in the form of the page, and the resulting plan."""

import pytest
from playwright.sync_api import expect

from armcontour.core.yaml_loader import load

pytestmark = pytest.mark.browser
DRAWING = """\
0
SECTION
2
HEADER
9
$INSUNITS
70
4
0
ENDSEC
0
SECTION
2
ENTITIES
0
CIRCLE
8
CUT
10
0
20
0
40
10
0
CIRCLE
8
FINE
10
30
20
0
40
6
0
ENDSEC
0
EOF
"""
JOB = """\
name: plate
arm: ur5e                     # the cell's arm
path:
  file: plate.dxf
  frame: {position: [420 mm, -20 mm, 100 mm]}
  orientation: {axis: [0, 0, -1]}   # down
limits: {speed: 50 mm/s}
corners: {tolerance: 0.2 mm}
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {own: {}}
"""


@pytest.fixture(scope="module")
def drawings(folder):
    (folder / "plate.dxf").write_text(DRAWING)


@pytest.fixture
def studio(page):
    page.wait("#view2d", run="own")
    yield page
    # Every change is undone byte by byte.
    while page.find("#undo").is_enabled():
        with page.renewing():
            page.find("#undo").click()
    assert page.text == JOB
    # No contour stays selected.
    page.find("#view2d").press("Escape")


def open_group(studio, title, *keys):
    """Open a group, all its fields, and mappings in it."""
    studio.tab("contours" if title == "Layers and order" else "process")
    group = studio.find(f"#panel details[data-group='{title}']")
    if group.get_attribute("open") is None:
        group.locator("summary").first.click()
    if group.locator("button.rest").count():
        group.locator("button.rest").click()
    for key in keys:
        part = studio.find(f"#panel details[data-key='{key}']")
        if part.get_attribute("open") is None:
            part.locator("summary").first.click()


def planned(studio):
    """Wait for the plan of the document, exact or not; returns its duration [s]."""
    studio.wait("#view2d", rev=studio.told("body", "rev"), stale="false")
    assert studio.told("body", "refused") != "true", studio.refusal
    return float(studio.told("#view2d", "duration"))


def change(studio, **values):
    """Type values of keys, of which the last one changes the job; returns data and duration."""
    keys = [x.replace("__", ".") for x in values]
    with studio.renewing():
        for key, value in zip(keys, values.values(), strict=True):
            studio.type(key, value)
    return load(studio.text, ""), planned(studio)


def test_kerf_and_lead_in_are_saved_and_undone(studio, folder):
    before = planned(studio)
    open_group(studio, "Process", "process.lead_in")
    data, duration = change(studio, process__kerf="2")
    # The tool goes outside of the circles by half of the kerf.
    assert data["process"] == {"kerf": "2 mm"} and duration > before
    data, longer = change(studio, process__lead_in__length="3 mm")
    assert data["process"]["lead_in"] == {"length": "3 mm"} and longer > duration
    assert "# the cell's arm" in studio.text and "# down" in studio.text
    studio.page.keyboard.press("Control+s")
    studio.wait("body", dirty="false")
    assert (folder / "job.yaml").read_text() == studio.text
    for _ in range(2):
        with studio.renewing():
            studio.find("#undo").click()
    studio.page.keyboard.press("Control+s")
    studio.wait("body", dirty="false")
    assert (folder / "job.yaml").read_text() == JOB


def test_settings_of_a_layer_do_not_change_other_layers(studio):
    before = planned(studio)
    open_group(studio, "Layers and order", "process.by_layer", "process.by_layer.FINE")
    data, twice = change(studio, process__by_layer__FINE__passes="2")
    assert data["process"]["by_layer"] == {"FINE": {"passes": 2}} and twice > before
    open_group(studio, "Layers and order", "path.layers", "path.layers.FINE")
    data, slow = change(studio, path__layers__FINE__speed="20 mm/s")
    # The other layer is run as before.
    assert data["path"]["layers"] == {"CUT": {}, "FINE": {"speed": "20 mm/s"}} and slow > twice
    with studio.renewing():
        studio.find("#panel details[data-key='path.layers.FINE'] > label input").click()
    assert load(studio.text, "")["path"]["layers"] == {"CUT": {}} and planned(studio) < before
    # A layer that is not run stays above the list, where it is ticked again.
    tick = studio.find(".layers").get_by_label("FINE")
    expect(tick).not_to_be_checked()
    with studio.renewing():
        tick.click()
    assert load(studio.text, "")["path"]["layers"] == {"CUT": {}, "FINE": {}}


def test_settings_change_the_selected_contour_only(studio):
    before = planned(studio)
    studio.page.get_by_role("tab", name="Contours").click()
    studio.select_contour(1)
    # A number without a unit has the unit of the speed of all contours.
    data, slow = change(studio, **{"path__contours__FINE-1__speed": "20"})
    assert data["path"]["contours"] == {"FINE-1": {"speed": "20 mm/s"}} and slow > before
    studio.find("#panel details[data-key='path.contours.FINE-1.lead_in'] summary").click()
    data, led = change(studio, **{"path__contours__FINE-1__lead_in__length": "3 mm"})
    assert data["path"]["contours"]["FINE-1"]["lead_in"] == {"length": "3 mm"} and led > slow
    with studio.renewing():
        studio.slider("path.contours.FINE-1.speed").locator(".unset").click()
    assert planned(studio) < slow
    studio.select_contour(0)
    expect(studio.slider("path.contours.CUT-1.speed").locator("input")).to_have_value("")


def test_contours_are_moved_left_out_and_run_again(studio):
    planned(studio)
    studio.tab("contours")
    rows = studio.find("ol.contours .name")
    names = rows.all_inner_texts()
    rows.nth(1).click()
    with studio.changing():
        studio.page.keyboard.press("Alt+ArrowUp")
    assert rows.all_inner_texts() == [names[1], names[0], *names[2:]]
    with studio.changing():
        studio.find(".layers input").first.click()
    assert sorted(rows.all_inner_texts()) == names
    with studio.changing():
        studio.find(".left-out").first.click()
    expect(studio.find(".left-out")).to_have_count(0)


def test_a_contour_is_selected_by_a_click_in_space(studio):
    planned(studio)
    studio.find("[data-view='Part']").click()
    canvas = studio.find(".arm-canvas")
    box = canvas.bounding_box()
    chosen = studio.find("ol.contours [aria-pressed=true]")
    # A line through the middle of the part crosses a contour.
    for x in range(0, int(box["width"]), 8):
        canvas.click(position={"x": x, "y": box["height"] / 2})
        if chosen.count():
            break
    expect(studio.find("#tab-button-contours")).to_have_attribute("aria-selected", "true")
    expect(chosen).to_have_count(1)
    canvas.click(position={"x": 4, "y": box["height"] - 4})
    expect(chosen).to_have_count(0)


def test_a_refusal_offers_what_is_missing(studio):
    planned(studio)
    open_group(studio, "Process", "process.tabs")
    studio.type("process.tabs.width", "2 mm")
    refusal = studio.find("#panel .refused")
    refusal.get_by_role("button", name="spacing").click()
    with studio.renewing():
        refusal.get_by_role("button", name="torch").click()
    tabs = load(studio.text, "")["process"]
    assert tabs == {"tabs": {"width": "2 mm", "spacing": "50 mm"}, "switch": {"name": "torch"}}
    assert planned(studio) > 0


def test_a_changed_setting_applies_to_the_job_or_the_selected_run(studio):
    planned(studio)
    studio.tab("process")
    data, slow = change(studio, limits__speed="40 mm/s")
    assert data["limits"] == {"speed": "40 mm/s"}
    studio.find("#panel .seek").get_by_role("button", name="For run").click()
    data, slower = change(studio, limits__speed="30")
    assert data["runs"]["own"] == {"limits": {"speed": "30 mm/s"}} and slower > slow
    row = studio.slider("limits.speed")
    expect(row.locator(".from")).to_have_text("run")
    with studio.renewing():
        row.locator(".unset").click()
    expect(row.locator("input[type=text]")).to_have_value("40 mm/s")
    data, _ = change(studio, corners__tolerance="0.1 mm")
    assert data["runs"]["own"]["corners"] == {"tolerance": "0.1 mm"}
    studio.find("#panel .seek").get_by_role("button", name="For job").click()


def test_the_choice_of_job_or_run_says_where_a_change_goes(studio):
    planned(studio)
    studio.tab("process")
    for_job, for_run = (
        studio.find("#panel .seek").get_by_role("button", name=x) for x in ("For job", "For run")
    )
    for_run.click()
    data, _ = change(studio, limits__speed="30 mm/s")
    assert data["runs"]["own"] == {"limits": {"speed": "30 mm/s"}}
    for_job.click()
    expect(for_job).to_have_attribute("aria-pressed", "true")
    # The run has its own speed, so that a change of it is for the run.
    speed = studio.slider("limits.speed").locator("input[type=text]")
    speed.focus()
    expect(for_run).to_have_attribute("aria-pressed", "true")
    speed.fill("25 mm/s")
    with studio.renewing():
        speed.press("Enter")
    data = load(studio.text, "")
    assert data["runs"]["own"] == {"limits": {"speed": "25 mm/s"}}
    assert data["limits"] == {"speed": "50 mm/s"}
    # Other values are still those of the job.
    studio.slider("corners.tolerance").locator("input[type=text]").focus()
    expect(for_job).to_have_attribute("aria-pressed", "true")
    # A contour without its own speed has that of the run.
    studio.select_contour(0)
    own = studio.find("#panel [aria-label='Selected contour'] [data-key$='.speed'] input").first
    expect(own).to_have_attribute("placeholder", "25 mm/s")
    studio.page.keyboard.press("Escape")


def test_settings_can_be_searched_by_names_and_descriptions(studio):
    planned(studio)
    studio.tab("process")
    seek = studio.find("#panel .seek input")
    seek.fill("pierce")
    expect(studio.slider("process.pierce.height")).to_be_visible()
    seek.fill("dead time")
    expect(studio.slider("servo.dead_time")).to_be_visible()
    expect(studio.slider("limits.speed")).to_have_count(0)
    for words in ("tilt", "work angle", "torch"):
        seek.fill(words)
        expect(studio.slider("tilt")).to_be_visible()
        expect(studio.find("#panel [data-key='path.orientation']")).to_be_visible()
    seek.fill("")
    expect(studio.slider("limits.speed")).to_be_visible()


def test_narrow_pages_have_a_menu_and_large_targets(pages):
    studio = pages(size=(390, 844))
    studio.begin()
    planned(studio)
    studio.find("#panel-open").click()
    studio.select_contour(0)
    small = [
        x.get_attribute("aria-label") or x.inner_text()
        for x in studio.find("#bar, #viewbar, #panel").locator("button, select, summary").all()
        if x.is_visible() and x.bounding_box()["height"] < 44
    ]
    assert not small
    studio.find("#panel-close").click()
    studio.find("#menu-open").click()
    for name in ("Save", "Compare", "Certify"):
        expect(studio.find("#menu").get_by_role("button", name=name)).to_be_in_viewport(ratio=1)
    studio.find("#menu").get_by_role("button", name="Compare").click()
    expect(studio.find("#menu")).to_be_hidden()
    expect(studio.find("#tab-runs")).to_be_visible()


def test_usual_values_of_leads_and_pierces_fit_together_and_are_named(studio):
    open_group(studio, "Process")
    adds = {
        x: studio.find(f"#panel .with-usual:has(details[data-key='process.{x}']) .usual-values")
        for x in ("lead_in", "pierce")
    }
    for first, then in (("lead_in", "pierce"), ("pierce", "lead_in")):
        change(studio, process__kerf="2")
        for name in (first, then):
            said = adds[name].inner_text()
            before = load(studio.text, "")["process"]
            with studio.renewing():
                adds[name].click()
            process = load(studio.text, "")["process"]
            assert ("torch" in said) == ("switch" in process and "switch" not in before)
        assert process["lead_in"] == {"length": "3 mm", "active": True, "shape": "arc"}
        assert process["pierce"] == {"time": "0.5 s"}
        assert "process on" in said
        expect(studio.find("#panel .refused")).to_have_count(0)
        planned(studio)
        while studio.find("#undo").is_enabled():
            with studio.renewing():
                studio.find("#undo").click()


def test_a_refused_change_of_a_contour_stays_when_another_one_is_selected(studio):
    planned(studio)
    studio.select_contour(0)
    own = studio.find("#panel [aria-label='Selected contour']")
    tolerance = own.locator("[data-key$='.tolerance'] input").first
    tolerance.fill("-1 mm")
    tolerance.press("Enter")
    refused = studio.find("#panel .refused")
    expect(refused).to_have_count(1)
    sentence = refused.inner_text()
    studio.select_contour(-1)
    elsewhere = studio.find("#panel [data-refused]")
    expect(elsewhere).to_contain_text(sentence)
    studio.select_contour(0)
    expect(elsewhere).to_have_count(0)
    expect(refused).to_have_count(1)
    tolerance.press("Escape")
    expect(refused).to_have_count(0)


def test_an_added_part_of_the_process_opens_and_offers_the_repair_of_its_refusal(studio):
    open_group(studio, "Process")
    change(studio, process__kerf="2")
    lead_in = studio.find("#panel .with-usual:has(details[data-key='process.lead_in'])")
    with studio.renewing():
        lead_in.locator("button.usual-values").click()
    expect(studio.find("#panel details[data-key='process.lead_in']")).to_have_attribute("open", "")
    # A pierce needs a lead-in along which the process is on.
    open_group(studio, "Process", "process.pierce")
    studio.type("process.pierce.time", "0.5 s")
    part = studio.find("#panel details[data-key='process.pierce']")
    refused = studio.find("#panel .refused")
    expect(refused).to_be_visible()
    with studio.renewing():
        refused.get_by_role("button").first.click()
    process = load(studio.text, "")["process"]
    assert process["lead_in"]["active"] is True and "time" in process["pierce"]
    expect(part).to_have_attribute("open", "")
    expect(refused).to_have_count(0)
    planned(studio)
