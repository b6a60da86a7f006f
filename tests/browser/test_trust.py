"""What the page states stays true: collisions, outdated results, names of joints, and rails."""

import re

import pytest
from playwright.sync_api import expect
from tests.dynamics_extra import needs_dynamics

from armcontour.core.yaml_loader import load

pytestmark = [pytest.mark.browser, needs_dynamics]
JOB = """\
name: cell
arm: ur5e
path:
  points: [[0.45, -0.03, 0.3], [0.50, -0.03, 0.3], [0.50, 0.03, 0.3]]
  orientation: {axis: [0, 0, -1]}
limits: {speed: 50 mm/s}
corners: {tolerance: 1 mm}
accuracy: 2 mm
servo: {kp: 25 1/s, kv: 150 1/s}
cycle: 4 ms
runs: {only: {timing: {reserve: 5 %}}}
"""
POST = """\
scene:
  obstacles: [{type: box, name: post, size: [20 mm, 20 mm, 100 mm], at: [0.50, 0.03, 0.36]}]
"""
POSITIONER = """\
  positioner:
    axes:
      - {name: tilt, axis: [0, 1, 0], origin: [0.9, 0, 0.3], lower: -100 deg, upper: 100 deg,
         velocity: 60 deg/s, acceleration: 100 deg/s^2}
      - {name: turn, axis: [0, 0, 1], origin: [0.9, 0, 0.4], lower: -400 deg, upper: 400 deg,
         velocity: 90 deg/s, acceleration: 100 deg/s^2}
  preferences: {turn: {hold: 0 deg}}
"""


def shown(page, folder, text, name="other.yaml"):
    """Open a job in the page."""
    file = folder / name
    file.write_text(text)
    page.open(file)
    return page


def test_a_collision_is_the_verdict_and_its_bodies_are_red(page, folder):
    studio = shown(page, folder, JOB + POST, "post.yaml")
    studio.wait("body", refused="true")
    verdict = studio.find("[data-figure=kept] .value")
    expect(verdict).to_have_text("✗ COLLISION")
    assert "post" in studio.find(".contacts details").text_content()
    # In the drawing a cross marks the place, in space the bodies are red.
    expect(studio.find("path.refused")).to_be_visible()
    studio.wait_for("#view3d[data-alarmed*=post]")
    alarmed = studio.told("#view3d", "alarmed").split(",")
    assert len(alarmed) == 2
    studio.find(".contacts").get_by_role("button", name="Go there").first.click()
    studio.wait_for('#view3d:not([data-time="0"])')
    # Without the obstacle, the run is kept.
    shown(page, folder, JOB, "free.yaml")
    studio.rest()
    expect(verdict).to_have_text("✓ kept, as modelled")
    studio.wait("#view3d", alarmed="")


# Records the verdict and its colour whenever the figures change.
RECORD = """figures => {
    const record = () => {
        const verdict = figures.querySelector("[data-figure=kept]");
        const { exact } = figures.dataset;
        const colour = getComputedStyle(verdict.querySelector(".value")).color;
        window.verdicts.push([exact, verdict.innerText, colour]);
    };
    window.verdicts = [];
    new MutationObserver(record).observe(figures, {
        attributes: true, characterData: true, childList: true, subtree: true,
    });
}"""


def test_no_verdict_stands_until_the_exact_result_has_come(page, folder):
    studio = shown(page, folder, JOB, "checking.yaml")
    studio.rest()
    verdict = studio.find("[data-figure=kept] .value")
    kept = verdict.evaluate("e => getComputedStyle(e).color")
    studio.find("#figures").evaluate(RECORD)
    studio.tab("process")
    with studio.changing():
        studio.type("limits.speed", "35 mm/s")
    expect(verdict).to_have_text("✓ kept, as modelled")
    recorded = studio.page.evaluate("window.verdicts")
    before = [(text, colour) for exact, text, colour in recorded if exact == "false"]
    assert any("checking" in text for text, _ in before)
    assert not [x for x in before if "kept" in x[0] or x[1] == kept]


def show_run(studio, name):
    """Show another run, and wait for its exact figures."""
    studio.choose_run(name)
    studio.wait("#view2d", run=name)
    studio.rest()


def test_the_change_of_the_cycle_time_is_that_of_the_shown_run(page, folder):
    runs = "runs: {first: {}, second: {limits: {speed: 20 mm/s}}}"
    text = JOB.replace("runs: {only: {timing: {reserve: 5 %}}}", runs)
    studio = shown(page, folder, text, "two_runs.yaml")
    studio.rest()
    show_run(studio, "first")
    show_run(studio, "second")
    duration = studio.find("[data-figure=duration]")
    before = duration.locator(".value").inner_text()
    # Nothing has changed in this run.
    expect(duration.locator(".note")).not_to_contain_text("was")
    studio.tab("process")
    with studio.changing():
        studio.type("corners.tolerance", "0.2 mm")
    expect(duration.locator(".note")).to_contain_text(f"was {before} s")
    studio.tab("runs")
    row = studio.find("#tab-runs tr").filter(has_text="before the last change")
    expect(row).to_contain_text(f"{float(before):g} s")
    assert row.locator("th").inner_text().startswith("second")
    studio.tab("charts")


def test_the_compared_state_is_before_as_many_changes_as_its_name_says(page, folder):
    studio = shown(page, folder, JOB, "two_changes.yaml")
    studio.rest()
    duration = studio.find("[data-figure=duration] .value")
    first = float(duration.inner_text())
    studio.tab("process")
    with studio.changing():
        studio.type("limits.speed", "40 mm/s")
    between = float(duration.inner_text())
    assert between > first + 0.1
    with studio.changing():
        studio.find("#undo").click()
    # The exact figures between two changes may be left out.
    with studio.renewing():
        studio.type("limits.speed", "40 mm/s")
    with studio.changing():
        studio.type("limits.speed", "30 mm/s")
    studio.tab("runs")
    row = studio.find("#tab-runs tr").filter(has_text="before the last")
    after_one = f"change✓ kept, as modelled{between:g} s"
    after_two = f"2 changes✓ kept, as modelled{first:g} s"
    expect(row).to_contain_text(re.compile(f"before the last ({after_one}|{after_two})"))
    studio.tab("charts")


def test_another_timing_method_has_its_name_before_the_change_and_a_reason(page, folder):
    text = JOB.replace("runs: {only: {timing: {reserve: 5 %}}}", "runs: {first: {}, second: {}}")
    studio = shown(page, folder, text, "methods.yaml")
    show_run(studio, "first")
    shares = studio.find("#figures .shares")
    expect(shares.locator(".bar")).to_be_visible()
    studio.tab("process")
    studio.find("#panel").get_by_role("button", name="For run").click()
    studio.find("#panel .seek input").fill("timing")
    with studio.changing():
        studio.find("#panel [data-key='timing.method'] select").select_option("conventional")
    studio.find("#panel .seek input").fill("")
    studio.find("#panel").get_by_role("button", name="For job").click()
    # The share of each limit is not known, and the page says so.
    expect(shares.locator(".bar")).to_have_count(0)
    expect(shares).to_be_visible()
    expect(shares).to_contain_text("optimal")
    studio.tab("runs")
    names = studio.find("#tab-runs thead th")
    expect(names.filter(has_text="method")).to_have_count(1)
    column = names.all_inner_texts().index("method")
    before = studio.find("#tab-runs tr").filter(has_text="before the last change")
    expect(before.locator("th, td").nth(column)).to_have_text("optimal")
    now = studio.find("#tab-runs tr[data-run=first]")
    expect(now.locator("th, td").nth(column)).to_have_text("conventional")
    studio.tab("charts")


def test_figures_of_a_run_stay_until_an_edit_touches_it(page, folder):
    runs = "runs: {first: {}, second: {limits: {speed: 45 mm/s}}}"
    text = JOB.replace("runs: {only: {timing: {reserve: 5 %}}}", runs)
    studio = shown(page, folder, text, "compared.yaml")
    studio.rest()
    show_run(studio, "first")
    duration = float(studio.find("[data-figure=duration] .value").inner_text())
    show_run(studio, "second")
    studio.tab("runs")
    rows = studio.find("#tab-runs tbody tr")
    other = rows.filter(has=studio.page.locator("th", has_text=re.compile("^first$")))
    expect(other).to_contain_text("✓ kept")
    studio.tab("text")

    def write(changed):
        with studio.changing():
            field = studio.find("#tab-text textarea")
            field.fill(changed)
            field.press("Control+Enter")

    # A change of the shown run only.
    write(studio.text.replace("45 mm/s", "30 mm/s"))
    studio.tab("runs")
    expect(other).to_contain_text("✓ kept")
    expect(other).to_contain_text(f"{duration:g} s")
    # A change of all runs.
    studio.tab("text")
    write(studio.text.replace("accuracy: 2 mm", "accuracy: 3 mm"))
    studio.tab("runs")
    expect(other).not_to_contain_text("kept")
    studio.tab("charts")


def test_results_of_a_job_that_has_changed_are_outdated(page, pages, folder):
    studio = shown(page, folder, JOB, "certified.yaml")
    studio.rest()
    studio.do("certify", {"tolerance": "2"})
    studio.wait(".task-result[data-task=certify]", state="done", outdated="false")
    studio.do("export", {"format": "csv"})
    studio.wait(".task-result[data-task=export]", state="done", outdated="false")
    studio.tab("process")
    with studio.changing():
        studio.type("limits.speed", "40 mm/s")
    for task in ("certify", "export"):
        studio.wait(f".task-result[data-task={task}]", outdated="true")
    expect(studio.find(".task-result[data-task=certify] .outdated")).to_be_visible()
    # They stay when the page is loaded again, and are on other pages too.
    studio.page.reload()
    other = pages()
    for shown_on in (studio, other):
        shown_on.begin()
        shown_on.tab("tasks")
        for task in ("certify", "export"):
            shown_on.wait(f".task-result[data-task={task}]", state="done", outdated="true")
    other.close()
    name, content = studio.save_file(studio.find(".task-result[data-task=export] [data-file]"))
    assert name.endswith(".csv") and content.startswith(b"t [s],")
    studio.tab("process")
    # With the last edit undone, the results are those of the job again.
    with studio.changing():
        studio.find("#undo").click()
    for task in ("certify", "export"):
        studio.wait(f".task-result[data-task={task}]", outdated="false")


def test_notices_do_not_take_the_place_of_lasting_messages(page, folder):
    studio = shown(page, folder, JOB, "noticed.yaml")
    studio.rest()
    lasting = studio.find("#messages .message:not(.passing)")
    count = lasting.count()
    assert count >= 3
    many = "m => { for (let k = 0; k < 9; k += 1) m.notify(`Notice ${k}`); }"
    studio.page.evaluate(f"import('/static/messages.js').then({many})")
    expect(studio.find("#messages .passing")).to_have_count(4)
    expect(lasting).to_have_count(count)


def test_the_plan_of_a_certificate_is_shown_and_exported_by_one_click(page, folder):
    studio = shown(page, folder, JOB.replace("name: cell", "name: proved"), "proved.yaml")
    studio.rest()
    usual = studio.figure("duration")
    studio.tab("tasks")
    result = studio.do("certify", {"tolerance": "2"})
    # The other tasks wait, and say why.
    waiting = studio.find("#tasks .task-wait")
    export = studio.find("#tasks form[data-task=export] button[type=submit]")
    if studio.told(".task-result[data-task=certify]", "state") == "running":
        expect(waiting).to_contain_text("Certify")
        expect(export).to_have_attribute("aria-disabled", "true")
        expect(export).to_have_attribute("title", re.compile("Certify is running"))
        bar = studio.find("#bar [data-opens=report]")
        expect(bar).to_have_attribute("title", re.compile("Certify is running"))
    studio.wait(".task-result[data-task=certify]", state="done")
    expect(waiting).to_have_count(0)
    expect(export).to_have_attribute("aria-disabled", "false")
    expect(result.locator(".task-sentence")).to_contain_text("run only")
    # The proved plan is slower than that of the run.
    result.get_by_role("button", name="Show this plan").click()
    studio.wait_for("body:not([data-certified=''])")
    studio.wait_for("#figures[data-exact=true]")
    banner = studio.find(".certified-banner")
    expect(banner).to_contain_text("run only")
    proved = studio.figure("duration")
    assert proved != usual
    tile = result.locator(".tiles div", has_text=re.compile("duration|motion|cycle", re.I)).first
    assert f"{proved:.3g}" in tile.inner_text()
    # It is exported by one click.
    result.locator("[name=format]").select_option("csv")
    result.get_by_role("button", name="Export this plan").click()
    made = ".task-result[data-task=export]"
    studio.wait(made, state="done")
    name, content = studio.save_file(studio.find(f"{made} [data-file]").first)
    assert name == "proved-only-certified.csv"
    assert abs(content.count(b"\n") * 4e-3 - proved) < 0.2
    # The plan of the run comes back by a button, and by an edit.
    banner.get_by_role("button", name="Back to the plan of the run").click()
    studio.wait("body", certified="")
    studio.rest()
    assert studio.figure("duration") == usual
    expect(banner).to_be_hidden()
    studio.tab("process")
    with studio.changing():
        studio.type("limits.speed", "40 mm/s")
    show = result.get_by_role("button", name="Show this plan")
    expect(show).to_have_attribute("aria-disabled", "true")
    with studio.changing():
        studio.find("#undo").click()


# Records the cells and the notes that the 3D view shows.
CELLS = """region => {
    window.cells = [];
    const record = () => {
        const canvas = region.querySelector("canvas");
        const seen = getComputedStyle(canvas).visibility === "visible";
        window.cells.push([region.dataset.cell, seen]);
    };
    const wished = {attributes: true, attributeFilter: ["data-cell"]};
    new MutationObserver(record).observe(region, wished);
}"""


def test_no_old_cell_is_shown_while_another_job_is_opened(page, folder):
    studio = shown(page, folder, JOB, "old_cell.yaml")
    studio.rest()
    studio.find("#viewbar").get_by_role("button", name="Both").click()
    studio.wait_for("#view3d canvas")
    studio.wait("#view3d", cell="UR5e")
    studio.find("#view3d").evaluate(CELLS)
    shown(page, folder, JOB.replace("ur5e", "ur10e"), "new_cell.yaml")
    studio.wait("#view3d", cell="UR10e")
    cells = studio.page.evaluate("window.cells")
    assert cells == [["", False], ["UR10e", True]]


def test_charts_of_a_positioner_name_its_joints(page, folder):
    text = JOB.replace("arm: ur5e\n", "arm:\n  name: ur5e\n" + POSITIONER)
    text = text.replace("[[0.45, -0.03, 0.3], [0.50, -0.03, 0.3], [0.50, 0.03, 0.3]]",
                        "[[0.02, -0.03, 0.1], [0.05, -0.03, 0.1], [0.05, 0.03, 0.1]]")  # fmt: skip
    text = text.replace("  points", "  frame: {position: [0.5, 0, 0.2]}\n  points")
    studio = shown(page, folder, text, "positioner.yaml")
    studio.rest()
    studio.tab("charts")
    # As in Python, joint 1 is the axis next to the part.
    labels = studio.find("#charts [data-chart=velocity] .u-legend .u-label")
    joints = labels.filter(has_text=re.compile(r"^\s*\d"))
    expect(joints.nth(0)).to_have_text(re.compile(r"^\s*1 turn"))
    expect(joints.nth(1)).to_have_text(re.compile(r"^\s*2 tilt"))
    # The items of lists have whole names.
    studio.tab("robot")
    studio.find("#panel .seek input").fill("axes")
    titles = studio.find("#panel summary").all_inner_texts()
    assert {"Axis 1", "Axis 2"} <= {x.partition(" \u00a0")[0].strip()[:6] for x in titles}
    studio.find("#panel .seek input").fill("")
    studio.tab("contours")


def test_a_rail_is_added_in_the_settings(page, folder):
    studio = shown(page, folder, JOB, "rail.yaml")
    studio.rest()
    studio.tab("robot")
    group = studio.find("#panel details[data-group='Arm and limits']")
    if group.get_attribute("open") is None:
        group.locator("summary").first.click()
    if group.locator("button.rest").count():
        group.locator("button.rest").click()
    part = studio.find("#panel details[data-key='arm.rail']")
    if part.get_attribute("open") is None:
        part.locator("summary").first.click()
    # Values wait for those that are required as well.
    for key, text in (("axis", "0, 1, 0"), ("upper", "1 m"), ("velocity", "1 m/s")):
        studio.type(f"arm.rail.{key}", text)
        expect(studio.find("#panel .refused")).to_contain_text("required as well")
    with studio.renewing():
        studio.type("arm.rail.acceleration", "2 m/s^2")
    studio.rest()
    assert load(studio.text, "")["arm"] == {
        "name": "ur5e",
        "rail": {"axis": [0, 1, 0], "upper": "1 m", "velocity": "1 m/s", "acceleration": "2 m/s^2"},
    }


def test_compare_plans_the_runs_that_were_never_shown(page, folder):
    runs = "runs: {first: {}, second: {limits: {speed: 25 mm/s}}, third: {duration: 10 ms}}"
    text = JOB.replace("runs: {only: {timing: {reserve: 5 %}}}", runs)
    studio = shown(page, folder, text, "never_shown.yaml")
    show_run(studio, "first")
    studio.find("#bar [data-opens=runs]").click()
    second, third = (studio.find(f"#tab-runs tr[data-run={x}]") for x in ("second", "third"))
    expect(second).to_contain_text("kept")
    expect(third).to_contain_text("refused")
    # The key in which they differ has a column, with the value that applies to each.
    heads = studio.find("#tab-runs thead th").all_inner_texts()
    cells = [x.inner_text() for x in second.locator("th, td").all()]
    assert cells[heads.index("speed")] == "25 mm/s"
    of_first = studio.find("#tab-runs tr[data-run=first]").locator("th, td").all_inner_texts()
    assert of_first[heads.index("speed")] == "50 mm/s"
    # Half the speed takes about twice as long.
    times = [float(x[heads.index("cycle time")].split()[0]) for x in (of_first, cells)]
    assert 1.8 < times[1] / times[0] < 2.0
    # After an edit of the job, one button plans them again.
    studio.tab("process")
    with studio.changing():
        studio.type("corners.tolerance", "0.5 mm")
    studio.tab("runs")
    expect(second).not_to_contain_text("kept")
    studio.find("#tab-runs").get_by_role("button", name=re.compile("^Plan ")).click()
    expect(second).to_contain_text("kept")
    studio.tab("charts")
