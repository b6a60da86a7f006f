"""The report: its numbers, its figures, and its sections."""

import base64
import dataclasses
import json

import numpy as np
import plotly.graph_objects as go
import pytest
from plotly.subplots import make_subplots as plots_of_plotly
from tests.corner_job import CORNER_JOB

import armcontour as ac
from armcontour.cli.run_command import built_in_job
from armcontour.core.errors import InvalidInput
from armcontour.core.render import number
from armcontour.files import parse_job
from armcontour.jobs import run
from armcontour.jobs.run_learning import LearningStudy, learn_logs, plan_run
from armcontour.report import render_report, sections, write_report
from armcontour.report.figure import Node, make_subplots, make_trace, to_json
from armcontour.report.style import finish, thin
from armcontour.studies.placement import Place, Placement


@pytest.fixture(scope="module")
def study():
    """The paper's job, coarsely, to be quick."""
    job = built_in_job()
    coarse = tuple(dataclasses.replace(x, cycle=4e-3) for x in job.runs)
    return run(dataclasses.replace(job, runs=coarse, title="<b>T & J</b>"))


@pytest.fixture(scope="module")
def page(study):
    return render_report(study)


def test_the_page(study, page, in_order):
    for result in study.runs.values():
        e = result.judged
        rms, largest = (number(x, "m") for x in (e.contour_error.rms, e.contour_error.max))
        assert number(e.duration, "s") in page and rms in page and largest in page
    slowest = study.runs["shaped"].explanation.to_data()["slowest"].value
    words = (f"The slowest point is {slowest}.", "&lt;b&gt;T &amp; J&lt;/b&gt;")
    assert [x for x in words if x not in page] == []
    assert "<b>T & J</b>" not in page
    in_order(page, "figures time paths joints")


def first_screen(page):
    return page[page.index('<section class="front">') : page.index("</section>")]


def test_the_first_screen_answers_before_any_figure(study, page):
    front = first_screen(page)
    assert "<script" not in front
    durations = {x: y.trajectory.duration for x, y in study.runs.items() if y.kept}
    fastest = min(durations, key=durations.get)
    assert f"Run {fastest}: Kept" in front and '<p class="verdict kept">' in front
    # Several runs are compared; a single one has three figures in large print.
    for name in study.runs:
        assert f'<th scope="row">{name}</th>' in front
    alone = dataclasses.replace(study.job, runs=study.job.runs[3:4])
    front, (result,) = first_screen(render_report(run(alone))), [study.runs["optimal"]]
    assert front.count('<div class="tile">') == 3
    assert f"<b>{number(result.trajectory.duration, 's')}</b>" in front


def test_the_report_begins_with_a_run_that_is_not_kept(study):
    # Without compensation, and nearer to the drawing than the servo can be.
    (loose,) = (x for x in study.job.runs if x.name == "uncompensated")
    strict = dataclasses.replace(study.job, runs=(dataclasses.replace(loose, accuracy=1e-6),))
    assert '<p class="verdict not-kept">' in first_screen(render_report(run(strict)))


def test_writes_whole_or_not_at_all(study, tmp_path):
    write_report(study, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8").endswith("</html>")
    with pytest.raises(InvalidInput):
        write_report(study, tmp_path / "none" / "report.html")
    assert [x.name for x in tmp_path.iterdir()] == ["report.html"]


def test_thinning_keeps_every_peak_and_both_ends_of_every_part():
    t = np.linspace(0, 1, 100_000)
    y = np.zeros_like(t)
    y[54_321], y[12_345] = 7.0, -3.0
    t2, y2 = thin(t, y)
    assert len(t2) < 4000 and np.all(np.diff(t2) > 0)
    assert (y2.max(), y2.min()) == (7.0, -3.0) and (t2[0], t2[-1]) == (0, 1)
    # Ten contours, each from rest to rest; the ends are no extremes of their intervals.
    y = np.tile(np.append(np.sin(np.linspace(0, np.pi, 4001)), np.nan), 10)
    _, y2 = thin(np.arange(len(y), dtype=float), y, count=500)
    gaps = np.flatnonzero(np.isnan(y2))
    assert len(gaps) == 10 and len(y2) < 600
    np.testing.assert_allclose([y2[0], *y2[gaps - 1], *y2[gaps[:-1] + 1]], 0.0, atol=1e-12)


PLACES = [
    {"rows": 6, "cols": 3, "column_titles": ["a", "b", "c"], "vertical_spacing": 0.025},
    {"rows": 2, "cols": 1, "row_heights": [0.75, 0.25], "vertical_spacing": 0.05},
]  # fmt: skip


def written(figure):
    """Arguments of a page for plotly.js: key, data, layout, configuration."""
    page = figure.to_html("key")
    figures, position = [], page.index("draw(") + len("draw(")
    while page[position - 1] != ")":
        value, position = json.JSONDecoder().raw_decode(page, position)
        figures.append(value)
        position += 1
    return figures


def test_several_plots_are_where_plotly_puts_them():
    for options in PLACES:
        ours, theirs = make_subplots(**options), plots_of_plotly(shared_xaxes=True, **options)
        ours.add_trace(make_trace("bar", y=[1, 2]), row=2, col=1)
        theirs.add_trace(go.Bar(y=[1, 2]), row=2, col=1)
        for made in (ours, theirs):
            made.update_yaxes(title="y", row=2, col=1)
            made.update_xaxes(range=[0, 1])
            made.add_hline(y=3.0, line={"color": "#000000"}, row=2, col=1)
        finish(ours, title="several", height=300)
        finish(theirs.update_layout(template="plotly_white"), title="several", height=300)
        expected = json.loads(theirs.to_json())
        # The page has the title above the figure, and the template once.
        layout = {x: y for x, y in expected["layout"].items() if x not in ("title", "template")}
        assert written(ours)[1:3] == [expected["data"], layout], options
        assert ">several</figcaption>" in ours.to_html("key")


def test_arrays_are_written_in_base64_and_cannot_end_a_script():
    for values in (np.array([1.5, np.nan], np.float32), np.arange(6.0).reshape(2, 3)):
        encoded = json.loads(to_json({"x": values}))["x"]
        back = np.frombuffer(base64.b64decode(encoded["bdata"]), encoded["dtype"])
        np.testing.assert_array_equal(back, values.ravel())
        assert encoded.get("shape") == (None if values.ndim == 1 else "2, 3")
    for whole, kind in (([3, -4], "i1"), ([200], "i2"), ([-40_000], "i4")):
        assert json.loads(to_json(np.array(whole)))["dtype"] == kind
    assert json.loads(to_json([np.float32(0.5), np.array([]), np.array(["a"])])) == [0.5, [], ["a"]]
    text = to_json(Node({"name": "</script><b>", "y": [1.0, np.nan, np.inf]}))
    assert not set("<>/") & set(text)
    assert json.loads(text) == {"name": "</script><b>", "y": [1.0, None, None]}


JERKY = """
name: jerk
arm: pmk3s
path: {points: [[0.35, 0.10], [0.36, 0.12]]}
limits: {joint_acceleration: 0.72 rad/s^2, joint_jerk: 7.2 rad/s^3}
servo: {kp: 25, kv: 150}
runs: {plain: {timing: {method: optimal}, compensation: {method: none}}}
"""


# Along x, y and yaw, 2 places each.
def traces(figure):
    return {x.name: x for x in figure.data}


@pytest.fixture(scope="module")
def real():
    """Learned from an ideal servo: the second run is made up of the first."""
    job = parse_job(CORNER_JOB.replace("pole_placement", "none"))
    plan = plan_run(job, None)
    executed = ac.simulate(plan.set_points, ac.ServoPlant(job.arm, job.servo), resolution=4e-3)
    lesson = learn_logs(job, plan, [executed])
    first = lesson.runs[0]
    second = dataclasses.replace(
        first, error=first.error / 10, joint_rms=first.joint_rms / 10, contour_rms=2e-6,
        contour_max=5e-6, source="<b>run2</b>.csv",
    )  # fmt: skip
    lesson = dataclasses.replace(lesson, runs=(first, second), noise=2e-7, best=1, finished=False)
    return LearningStudy(job=job, plan=plan, lesson=lesson)


def test_learning_shows_errors_over_runs_joints_and_time(real):
    (over_runs,), (over_time, _) = sections.learned(real).parts, sections.learning(real).parts
    figure, (first, _) = traces(over_runs), real.lesson.runs
    np.testing.assert_allclose(figure["RMS"].y, [1e3 * first.contour_rms, 2e-3])
    np.testing.assert_allclose(figure["largest"].y, [1e3 * first.contour_max, 5e-3])
    np.testing.assert_allclose(figure["does not repeat"].y, 2e-4, rtol=1e-6)
    before, after = over_time.data
    assert before.name.startswith("before learning: RMS")
    assert after.name == "run 2: RMS 0.002 mm, largest 0.005 mm"
    assert 0 < np.max(after.y) < np.max(before.y) / 3


def test_a_map_shows_the_best_over_other_axes_and_letters_of_refusals():
    job, yaws = parse_job(JERKY), (0.0, 0.2)
    known = {
        (0.0, 0.0): (2.0, 3.0), (0.0, 0.1): (None, 2.5),
        (0.1, 0.0): (None, None), (0.1, 0.1): (4.0, 5.0),
    }  # fmt: skip
    places = [
        Place(values={"x": x, "y": y, "yaw": yaw}, duration=t, refusal="" if t else "reach")
        for (x, y), durations in known.items()
        for yaw, t in zip(yaws, durations, strict=True)
    ]
    placement = Placement(
        job=job, run=job.runs[0], moved="part", about=np.zeros(3), own=places[0],
        axes={"x": np.array([0.0, 0.1]), "y": np.array([0.0, 0.1]), "yaw": np.array(yaws)},
        places=tuple(places),
    )  # fmt: skip
    front = sections.placed(placement)
    (planned, refused) = front.parts[0].data
    # Each place has the shortest motion over the other axis.
    np.testing.assert_allclose([planned.x, planned.y], [[0.0, 0.0, 100.0], [0.0, 100.0, 100.0]])
    assert planned.marker["color"] == [2.0, 2.5, 4.0]
    assert (list(refused.x), list(refused.y), refused.text) == ([100.0], [0.0], ["1"])
    assert front.sentences[0][0] == "1: refused by reach (3)"
