"""The report: values, figures and sections."""

import base64
import dataclasses
import gzip
import itertools
import json
import re

import numpy as np
import pytest
from tests.corner_job import CORNER_JOB

import armcontour as ac
from armcontour.cli.run_command import built_in_job
from armcontour.core.errors import InvalidInput
from armcontour.core.render import number
from armcontour.files import parse_job
from armcontour.jobs import run
from armcontour.jobs.run_learning import LearnedRun, learn_logs, plan_run
from armcontour.report import render_report, sections, write_report
from armcontour.report.batch_report import render_batch
from armcontour.report.figure import Curve, Figure, Plot, to_json
from armcontour.report.message_frame import MessageFrame
from armcontour.report.origin import Origin
from armcontour.report.sections.learning import learned, learning
from armcontour.report.sections.placement_section import edges_of, placed
from armcontour.report.style import thin
from armcontour.studies.placement import Place, Placement


@pytest.fixture(scope="module")
def job_result():
    """The paper's job, coarsely, to be quick."""
    job = built_in_job()
    coarse = tuple(dataclasses.replace(x, cycle=4e-3) for x in job.runs)
    return run(dataclasses.replace(job, runs=coarse, title="<b>T & J</b>"))


@pytest.fixture(scope="module")
def page(job_result):
    return render_report(job_result)


def written(value, unit):
    """A value on a page: small lengths have three decimals of a millimetre."""
    if unit == "m" and value < 1e-5:
        return f"{value * 1e3:.3f} mm" if value >= 1e-6 else "&lt; 0.001 mm"
    return number(value, unit)


def test_the_report_shows_the_figures_of_every_run(job_result, page, in_order):
    for result in job_result.runs.values():
        e = result.judged
        values = (e.duration, "s"), (e.contour_error.rms, "m"), (e.contour_error.max, "m")
        assert all(written(*x) in page for x in values)
    slowest = job_result.runs["shaped"].explanation.to_data()["slowest"].value
    words = (f"slowest point: {slowest}", "&lt;b&gt;T &amp; J&lt;/b&gt;")
    assert [x for x in words if x not in page] == []
    assert "<b>T & J</b>" not in page
    in_order(page, "figures time paths joints")


def first_screen(page):
    return page[page.index('<section class="front">') : page.index("</section>")]


def test_the_first_screen_states_the_verdict_before_any_figure(job_result, page):
    front = first_screen(page)
    assert "<script" not in front
    durations = {x: y.trajectory.duration for x, y in job_result.runs.items() if y.kept}
    fastest = min(durations, key=durations.get)
    assert f"Run {fastest}: Kept" in front and '<p class="verdict kept">' in front
    # Several runs are compared; a single one has three figures in large print.
    for name in job_result.runs:
        assert f'<th scope="row">{name}</th>' in front
    alone = dataclasses.replace(job_result.job, runs=job_result.job.runs[3:4])
    front = first_screen(render_report(run(alone)))
    (result,) = [job_result.runs["optimal"]]
    assert front.count('class="tile">') == 3
    assert f"<b>{number(result.trajectory.duration, 's')}</b>" in front


def test_the_report_begins_with_a_run_that_is_not_kept(job_result):
    # Without compensation, and nearer to the drawing than the servo can be.
    (loose,) = (x for x in job_result.job.runs if x.name == "uncompensated")
    strict = dataclasses.replace(job_result.job, runs=(dataclasses.replace(loose, accuracy=1e-6),))
    assert '<p class="verdict not-kept">' in first_screen(render_report(run(strict)))


def test_the_report_is_written_completely_or_not_at_all(job_result, tmp_path):
    write_report(job_result, tmp_path / "report.html")
    assert (tmp_path / "report.html").read_text(encoding="utf-8").endswith("</html>")
    with pytest.raises(InvalidInput):
        write_report(job_result, tmp_path / "none" / "report.html")
    assert [x.name for x in tmp_path.iterdir()] == ["report.html"]


def test_thinned_curves_keep_every_peak_and_the_ends_of_every_part():
    t = np.linspace(0, 1, 100_000)
    y = np.zeros_like(t)
    y[54_321] = 7.0
    y[12_345] = -3.0
    t2, y2 = thin(t, y)
    assert len(t2) < 4000 and np.all(np.diff(t2) > 0)
    assert (y2.max(), y2.min()) == (7.0, -3.0) and (t2[0], t2[-1]) == (0, 1)
    # Ten contours, each from rest to rest; the ends are no extremes of their intervals.
    y = np.tile(np.append(np.sin(np.linspace(0, np.pi, 4001)), np.nan), 10)
    _, y2 = thin(np.arange(len(y), dtype=float), y, count=500)
    gaps = np.flatnonzero(np.isnan(y2))
    assert len(gaps) == 10 and len(y2) < 600
    np.testing.assert_allclose([y2[0], *y2[gaps - 1], *y2[gaps[:-1] + 1]], 0.0, atol=1e-12)


def unpacked(page, name):
    """A packed part of a page."""
    (text,) = re.findall(rf'id="packed-{name}">([^<]*)</script>', page)
    return gzip.decompress(base64.b64decode(text))


def test_a_page_contains_its_figures_and_their_script(page, job_result):
    figures = json.loads(unpacked(page, "figures"))
    assert set(figures) == set(re.findall(r'<div id="([^"]*)" class="plots"', page))
    speed, limits, error = figures["figure-time-1"]["plots"]
    assert [x["name"] for x in speed["curves"]][: len(job_result.runs)] == list(job_result.runs)
    for curve, result in zip(speed["curves"], job_result.runs.values(), strict=False):
        largest = 1e3 * result.motion.tool_speed.max()
        assert max(x for x in curve["y"] if x is not None) == pytest.approx(largest, rel=1e-4)
    assert {x[3] for x in limits["bars"]} >= {"joint acceleration"} and error["logarithmic"]
    assert b"export" in unpacked(page, "uplot") and len(page) < 1e6
    # A page without figures has no code for them.
    assert 'id="packed-' not in render_batch("a", "", ("b",), [], [], Origin())


def test_the_animated_arm_moves_as_planned_along_the_path(page, job_result):
    frames = (unpacked(page, f"figure-arm-1-{x}") for x in ("arm", "motion"))
    arm, motion = map(MessageFrame.unpack, frames)
    (name,) = re.findall(r"Run (\w+): Kept", page)
    result = job_result.runs[name]
    t, q = (motion.arrays[x].astype(float) for x in "tq")
    assert t[-1] == pytest.approx(result.trajectory.duration) and len(t) < 1500
    # Between the stored postures the page interpolates.
    times = np.linspace(0, t[-1], 5000)
    drawn = np.stack([np.interp(times, t, x) for x in q.T], axis=1)
    planned = result.trajectory(np.minimum(times, result.trajectory.duration))
    assert np.abs(drawn - planned).max() < 2e-3
    assert len(arm.header["joints"]) == q.shape[1]
    # The path is where the tool is at these times.
    tool = job_result.job.arm.tool_position(planned)
    lines = [motion.arrays[x["points"]][:, : tool.shape[1]] for x in motion.header["lines"]]
    corners = np.concatenate(lines)
    distances = np.linalg.norm(corners[:, None] - tool[None], axis=2).min(axis=1)
    assert distances.max() < 1e-3 and len({x["light"] for x in motion.header["lines"]}) > 1


def test_a_single_run_has_another_colour_than_the_limits(job_result):
    alone = dataclasses.replace(job_result, runs={"optimal": job_result.runs["optimal"]})
    limits = {x.colour for x in sections.motion.plot_limits(alone).bars}
    (curve,) = [x for x in sections.motion.plot_speed(alone).curves if x.name == "optimal"]
    assert limits and curve.colour not in limits
    # Runs in one figure have different colours.
    speeds = [x for x in sections.motion.plot_speed(job_result).curves if x.name in job_result.runs]
    assert len({x.colour for x in speeds}) == len(job_result.runs)


def test_errors_are_shown_in_percent_of_the_allowed_error(job_result):
    for name in ("optimal", "shaped"):
        alone = dataclasses.replace(job_result, runs={name: job_result.runs[name]})
        plot = sections.motion.plot_error(alone)
        e = job_result.runs[name].evaluation.contour_error
        allowed = job_result.runs[name].tolerance / 10
        largest = np.nanmax(plot.curves[0].y)
        assert largest == pytest.approx(100 * e.max / allowed, rel=1e-6)
        assert plot.also == (pytest.approx(10 * allowed), "mm")
        # Noise does not take the height of the plot.
        low, high = plot.limits
        assert high < 200 * largest and (low == 0 or high / low < 2e4)


def test_figures_of_a_result_are_pages(job_result, tmp_path):
    result = next(iter(job_result.runs.values()))
    for kind in ("path", "joints", "speed", "error"):
        result.plot(kind).write_html(tmp_path / f"{kind}.html")
        text = (tmp_path / f"{kind}.html").read_text(encoding="utf-8")
        assert ('id="packed-figures"' in text) == (kind != "path") and "<figure" in text
        assert "<iframe" in result.plot(kind)._repr_html_()


def test_figures_are_written_as_valid_json(job_result):
    x = np.array([0.0, 0.5, 1.0])
    y = np.array([1 / 3, np.nan, np.inf])
    curves = tuple(Curve(x=x, y=z, name="</script>", colour="#000") for z in (y, 2 * y))
    figures = {"a": Figure(title="t", plots=(Plot(label="l", curves=curves),))}
    (plot,) = json.loads(to_json(figures))["a"]["plots"]
    assert plot["x"] == [[0.0, 0.5, 1.0]] and [x["x"] for x in plot["curves"]] == [0, 0]
    assert plot["curves"][0]["y"] == [pytest.approx(1 / 3, rel=1e-4), None, None]


JERKY = """
name: jerk
arm: pmk3s
path: {points: [[0.35, 0.10], [0.36, 0.12]]}
limits: {joint_acceleration: 0.72 rad/s^2, joint_jerk: 7.2 rad/s^3}
servo: {kp: 25, kv: 150}
runs: {plain: {timing: {method: optimal}, compensation: {method: none}}}
"""


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
    return LearnedRun(job=job, plan=plan, lesson=lesson)


def test_learning_shows_errors_over_runs_joints_and_time(real):
    (over_runs,) = learned(real).parts
    over_time, _ = learning(real).parts
    figure = {x.name: x for x in over_runs.plots[0].curves}
    first, _ = real.lesson.runs
    np.testing.assert_allclose(figure["RMS"].y, [1e3 * first.contour_rms, 2e-3])
    np.testing.assert_allclose(figure["largest"].y, [1e3 * first.contour_max, 5e-3])
    np.testing.assert_allclose(figure["does not repeat"].y, 2e-4, rtol=1e-6)
    before, after = over_time.plots[0].curves
    assert before.name.startswith("before learning: RMS")
    assert after.name == "run 2: RMS 0.002 mm, largest 0.005 mm"
    assert 0 < np.max(after.y) < np.max(before.y) / 3


def test_a_placement_map_shows_the_best_position_and_the_kind_of_refusals():
    job = parse_job(JERKY)
    yaws = (0.0, 0.2)
    known = {
        (0.0, 0.0): (2.0, 3.0), (0.0, 0.1): (None, 2.5),
        (0.1, 0.0): (None, None), (0.1, 0.1): (4.0, 5.0),
    }  # fmt: skip
    places = []
    for (x, y), durations in known.items():
        for yaw, t in zip(yaws, durations, strict=True):
            values = {"x": x, "y": y, "yaw": yaw}
            places.append(Place(values=values, duration=t, refusal="" if t else "reach"))
    placement = Placement(
        job=job, run=job.runs[0], moved="part", about=np.zeros(3), own=places[0],
        axes={"x": np.array([0.0, 0.1]), "y": np.array([0.0, 0.1]), "yaw": np.array(yaws)},
        places=tuple(places),
    )  # fmt: skip
    front = placed(placement)
    svg = front.drawing.svg
    cells = re.findall(r'<rect x="([\d.]+)" y="([\d.]+)"[^>]*/><text[^>]*>([^<]*)<', svg)
    right, low = (max(float(x[k]) for x in cells) for k in (0, 1))
    found = {(float(x) == right, float(y) == low): text for x, y, text in cells}
    # Each place has the shortest motion over the other axis; y points up.
    assert found == {(False, True): "2", (False, False): "2.5", (True, True): "1",
                     (True, False): "4"}  # fmt: skip
    assert ("1: refused by reach (3)", "") in front.sentences
    # The shortest motion is yellow and framed, the longest one is dark.
    colours = re.findall(r'fill="rgb\((\d+),\d+,\d+\)"/><text[^>]*>([\d.]+)<', svg)
    reds = {text: int(red) for red, text in colours}
    assert reds["2"] == 254 and reds["2"] > reds["2.5"] > reds["4"]
    (framed,) = re.findall(r'<rect class="best" x="([\d.]+)" y="([\d.]+)"', svg)
    places_of_text = {text: (float(x), float(y)) for x, y, text in cells}
    assert np.allclose(np.array(framed, float) - places_of_text["2"], 2.0)
    assert "at the edge of the grid (x, y, yaw)" in front.verdict


def placement_at(axes, best):
    """A placement whose best place has given values."""
    job = parse_job(JERKY)
    names = list(axes)
    places = []
    for values in itertools.product(*axes.values()):
        duration = 1.0 if values == best else 2.0
        places.append(Place(values=dict(zip(names, values, strict=True)), duration=duration))
    return Placement(
        job=job, run=job.runs[0], moved="part", about=np.zeros(3), own=places[0],
        axes={x: np.array(y) for x, y in axes.items()}, places=tuple(places),
    )  # fmt: skip


def test_the_edge_of_a_grid_of_places_is_named_unless_it_is_a_whole_turn():
    turn = [0.0, 0.5 * np.pi, np.pi, 1.5 * np.pi]
    assert edges_of(placement_at({"x": [0.0, 0.1, 0.2]}, (0.1,))) == []
    assert edges_of(placement_at({"x": [0.0, 0.1, 0.2]}, (0.2,))) == ["x"]
    assert edges_of(placement_at({"x": [0.0], "yaw": turn}, (0.0, 0.0))) == []
    assert edges_of(placement_at({"yaw": turn[:3]}, (0.0,))) == ["yaw"]
    inside = placed(placement_at({"x": [0.0, 0.1, 0.2]}, (0.1,)))
    assert "edge" not in inside.verdict
