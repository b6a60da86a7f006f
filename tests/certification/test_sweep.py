"""Trade-offs: certified times for other tolerances and velocities."""

import csv
import io
import json
from dataclasses import replace
from functools import partial

import pytest
from soak.corner_job import CORNER_JOB

import armcontour as ac
from armcontour._executors import InProcess
from armcontour.errors import InvalidInput
from armcontour.io import parse_job, sweep_csv, sweep_json
from armcontour.report import render_sweep
from armcontour.report.sections import sweep as section_of

# Certified without a search: the plan at the full limit holds 0.1 mm.
JOB = CORNER_JOB.replace("[0.36, 0.20], [0.36, 0.24]", "[0.38, 0.20], [0.38, 0.26]")


@pytest.fixture(scope="module")
def swept():
    return ac.sweep(parse_job(JOB), tolerances=[4e-3, 1e-3, 2e-3], speeds=[0.15, 0.05])


def test_points_lie_above_the_optimum_of_their_own_choice(swept):
    assert [x.tolerance for x in swept.tolerances] == [1e-3, 2e-3, 4e-3]
    assert [x.speed for x in swept.speeds] == [0.05, 0.15]
    job, page = parse_job(JOB), render_sweep(swept)
    for x in (*swept.tolerances, *swept.speeds):
        path = ac.round_corners(job.path, tolerance=x.tolerance)
        fastest = ac.plan(path, job.arm, job.runs[0].limits.replace(speed=x.speed))
        assert x.optimum == pytest.approx(fastest.duration, rel=1e-9)
        assert x.refusal is None and x.contour_error <= 1e-4
        assert x.optimum <= x.duration < 1.05 * x.optimum
        assert f"{x.duration:.4f} s" in page
    assert swept.speeds[0].duration > 1.2 * swept.speeds[1].duration
    assert len({x.duration for x in swept.tolerances}) == 3


def test_a_point_is_what_certify_finds(swept):
    job = parse_job(JOB)
    limits = job.runs[0].limits.replace(speed=0.05)
    found = ac.certify(replace(job, runs=(replace(job.runs[0], limits=limits),)))
    assert swept.speeds[0].duration == found.duration
    assert swept.speeds[0].contour_error == found.budget.executed
    # The job's own choice lies on both lines.
    assert swept.speeds[1] == swept.tolerances[1]


def test_a_point_that_is_refused_says_why():
    job = parse_job(JOB.replace("pole_placement", "none"))
    found = ac.sweep(
        job, speeds=[0.05, 0.15], tolerances=[2e-3], goal=ac.Goal(servo=2e-5, slowest=1.05)
    )
    slow, fast = found.speeds
    assert fast.duration is None and "contour error comes down to" in fast.refusal
    assert fast.optimum < slow.optimum and "refused" in render_sweep(found)


def test_a_total_tolerance_is_swept_where_it_is_asked_for():
    found = ac.sweep(
        parse_job(JOB), tolerances=[1e-3, 3e-3], speeds=[], goal=ac.Goal(tolerance=2e-3)
    )
    narrow, wide = found.tolerances
    assert (narrow.tolerance, wide.tolerance) == (1e-3, 3e-3)
    assert wide.duration < narrow.duration and not found.speeds


def test_nothing_to_sweep_is_refused(refuses):
    job = parse_job(JOB)
    limits = job.runs[0].limits.replace(speed=None)
    sharp, bare = (
        replace(job, runs=(replace(job.runs[0], rounding=None, limits=x),))
        for x in (job.runs[0].limits, limits)
    )
    for call, words in (
        (partial(ac.sweep, sharp, tolerances=[1e-3]), "rounds no corners"),
        (partial(ac.sweep, bare), "give tolerances or speeds"),
        (partial(ac.sweep, job, speeds=[-1.0]), "above zero"),
        (partial(ac.sweep, parse_job(FREE), tolerances=[2e-3], shapes=["round"]), "arc, free"),
    ):
        refuses(call, InvalidInput, words)


FREE = JOB.replace("{tolerance: 2 mm}", "{shape: free, tolerance: 2 mm, iterations: 2}")


@pytest.fixture(scope="module")
def compared():
    return ac.sweep(parse_job(FREE), tolerances=[1e-3, 2e-3], speeds=[0.05])


def test_shapes_stand_beside_arcs(compared):
    assert [(x.shape, x.tolerance) for x in compared.tolerances] == [
        ("arc", 1e-3), ("arc", 2e-3), ("free", 1e-3), ("free", 2e-3)
    ]  # fmt: skip
    assert compared.speeds[0].shape == "free"
    arcs, free = compared.shapes["arc"], compared.shapes["free"]
    for arc, shaped in zip(arcs, free, strict=True):
        # Certified points are within the goal, too, and a shape is never slower than arcs.
        assert shaped.optimum <= arc.optimum * (1 + 1e-9)
        assert shaped.refusal is None and shaped.contour_error <= 1e-4
    job = parse_job(FREE)
    alone = ac.plan(
        job.path, job.arm, job.runs[0].limits, method="shaped", tolerance=1e-3, iterations=2
    )
    assert free[0].optimum == pytest.approx(alone.duration, rel=1e-9)
    assert compared.iterations == 2


def test_the_shapes_of_a_sweep_may_be_chosen():
    found = ac.sweep(parse_job(FREE), tolerances=[2e-3], speeds=[], shapes=["free"])
    assert list(found.shapes) == ["free"] and len(found.tolerances) == 1
    arcs = ac.sweep(parse_job(JOB), tolerances=[2e-3], speeds=[])
    assert list(arcs.shapes) == ["arc"] and arcs.iterations is None


def test_both_shapes_are_in_one_figure_and_in_the_files(compared):
    assert len(section_of(compared).figures[0].data) == 4
    rows = list(csv.DictReader(io.StringIO(sweep_csv(compared))))
    assert [x["shape"] for x in rows] == ["arc", "arc", "free", "free", "free"]
    assert [x["line"] for x in rows] == ["tolerance"] * 4 + ["speed"]
    assert float(rows[2]["certified [s]"]) == compared.tolerances[2].duration
    data = json.loads(sweep_json(compared))
    assert [x["shape"] for x in data["tolerances"]] == ["arc", "arc", "free", "free"]
    assert data["iterations"] == 2


def test_fastest_plans_alone_need_no_goal(compared):
    job = replace(parse_job(FREE), certificate=None)
    found = ac.sweep(job, tolerances=[1e-3], speeds=[], certified=False)
    expected = [compared.tolerances[k].optimum for k in (0, 2)]
    assert [x.optimum for x in found.tolerances] == pytest.approx(expected, rel=1e-9)
    assert all(x.duration is None and x.refusal is None for x in found.tolerances)
    assert "refused" not in section_of(found).tables[0].rows[0]
    assert json.loads(sweep_json(found))["goal"] is None


def test_an_executor_finds_the_same_points(swept):
    steps = []
    given = {"tolerances": [4e-3, 1e-3, 2e-3], "speeds": [0.15, 0.05]}
    found = ac.sweep(parse_job(JOB), **given, executor=InProcess(), progress=steps.append)
    assert (found.tolerances, found.speeds) == (swept.tolerances, swept.speeds)
    # The job's own choice, on both lines, is one point.
    assert [x.done for x in steps] == [0.0, 0.25, 0.5, 0.75]
