"""Runs with corners of shape free: paths, shared plans, verdicts and notes."""

import numpy as np
import pytest
from scipy.spatial import cKDTree
from tests.geometry.tables import refused
from tests.jobs import making
from tests.jobs.making import ARM, a_job

import armcontour as ac
from armcontour.files import parse_job
from armcontour.geometry import Arc, Path, ShapedPath
from armcontour.jobs import Rounding, run
from armcontour.program import Contour, Event, Lead, Process, Program

LIMITS = ARM.limits.replace(speed=0.1, centripetal_acceleration=0.09)
BEND = Path.polyline([[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]])
BACK = Path.polyline(BEND.vertices[::-1])
FREE = Rounding(shape="free", tolerance=1e-3, iterations=3)
ARCS = Rounding(tolerance=1e-3)


def a_run(name="free", **values):
    run_options = {"limits": LIMITS, "rounding": FREE, "timing": ac.Optimal(intervals=300)}
    return making.a_run(name, **run_options | values)


@pytest.fixture(scope="module")
def plans():
    """Plans of runs that differ in one value each."""
    others = (
        a_run("arcs", rounding=ARCS),
        a_run("sharp", rounding=None),
        a_run("r", timing=ac.Optimal(intervals=300, reserve=0.3)),
    )
    coarse = a_run("d", timing=ac.Optimal(intervals=200))
    more = (a_run("b", compensation=ac.NoCompensation()), coarse)
    return run(a_job(BEND, a_run(), *others, *more), simulate=False).runs


def test_shaped_runs_keep_the_reserve_and_share_shapes(plans):
    path = plans["free"].path.path
    assert isinstance(path, ShapedPath) and path.objective is BEND
    assert plans["free"].trajectory.method == "optimal"
    assert plans["free"].trajectory.duration <= plans["arcs"].trajectory.duration * (1 + 1e-9)
    reduced = LIMITS.replace(joint_acceleration=0.7 * np.asarray(LIMITS.joint_acceleration))
    alone = ac.plan(BEND, ARM, reduced, ac.Shaped(tolerance=1e-3, iterations=3, intervals=300))
    assert plans["r"].trajectory.duration == pytest.approx(alone.duration, rel=1e-12)
    assert plans["r"].trajectory.duration > plans["free"].trajectory.duration
    free = plans["free"]
    assert plans["b"].path is free.path and plans["b"].traced is free.traced
    assert plans["r"].path is not free.path and plans["d"].path is not free.path


def test_contours_have_rapids_leads_and_events_on_their_shapes():
    events = (Event(name="tool", s=0.02, value=1.0),)
    moves = (Contour(path=BEND, name="one", events=events), Contour(path=BACK))
    lead = Lead(length=4e-3)
    process = Process(lead_in=lead, lead_out=lead)
    plan = run(a_job(Program(moves=moves), a_run(), process=process), simulate=False).runs["free"]
    assert [type(x.path) for x in plan.path.contours] == [ShapedPath, ShapedPath]
    data = plan.to_data()
    assert sum(data["shaping.starts"].value.values()) == 2
    spans = [x.t[1] - x.t[0] for x in plan.trajectory.contour_spans]
    assert sum(spans) == pytest.approx(data["shaping.durations"].value["shaped"], rel=1e-9)
    (switch_s,) = [x.s for x in plan.path.contours[0].events if x.name == "tool"]
    assert np.linalg.norm(plan.path.contours[0].path(switch_s) - BEND(0.02)) < 1e-3


def test_invalid_rounding_values_and_free_corners_with_paper_timing_are_refused():
    def made(**values):
        return lambda: a_run(rounding=Rounding(**values))

    free = {"shape": "free", "tolerance": 1e-3}
    refused(
        (made(shape="free"), "corners.tolerance is missing"),
        (made(shape="free", tolerance=float("nan")), "tolerance of a rounding"),
        (made(**free, iterations=-1), "iterations of a rounding"),
        (lambda: a_run(timing=ac.Paper()), "timing method optimal", "paper"),
    )


def test_an_arm_in_space_keeps_the_configuration_of_the_shape_search():
    # The fastest configuration of the shaped circle is another than that of the circle.
    arm = ac.load_arm("ur5e")
    circle = Path(
        segments=[
            Arc(start=(0.35, 0, 0.1), center=(0.352, 0, 0.1), angle=2 * np.pi, normal=(0, 0, 1))
        ]
    )
    bend = Path.polyline([(0.38, 0, 0.1), (0.41, 0, 0.1), (0.41, 0.03, 0.1)])
    moves = tuple(Contour(path=x.pointing((0, 0, -1))) for x in (circle, bend))
    rounding = Rounding(shape="free", tolerance=2.5e-4, iterations=2)
    limits = arm.limits.replace(speed=0.1, centripetal_acceleration=1.0)
    shaped_run = a_run(
        limits=limits, rounding=rounding, timing=ac.Optimal(intervals=300, reserve=0.1)
    )
    plan = run(a_job(Program(moves=moves), shaped_run, arm=arm), simulate=False).runs["free"]
    for span, x in zip(plan.trajectory.contour_spans, plan.path.contours, strict=True):
        assert span.t[1] - span.t[0] == pytest.approx(x.path.outcome.durations["shaped"], rel=1e-9)


FREE_JOB = """
name: bend
arm: pmk3s
path: {points: [[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]]}
limits: {speed: 0.1 m/s, centripetal_acceleration: 0.09 m/s^2}
corners: {tolerance: 1 mm, shape: free}
servo: {kp: 25 1/s, kv: 150 1/s}
runs: {free: {}}
"""


def nearest(points, curve):
    """Distances from points to a curve between dense samples, by parabolas [m]."""
    s = np.linspace(0, curve.length, 100_001)
    samples = np.asarray(curve(s))
    middle = np.clip(cKDTree(samples).query(points)[1], 1, len(s) - 2)
    before, at, after = (((points - samples[middle + k]) ** 2).sum(axis=1) for k in (-1, 0, 1))
    bend = before - 2 * at + after
    return np.sqrt(np.minimum(at, at - (after - before) ** 2 / (8 * np.maximum(bend, 1e-30))))


def test_verdict_states_the_distance_of_the_curve_from_the_drawing():
    """Terminal and verdict use the bound of `deviation`, which dense samples almost reach."""
    result = run(parse_job(FREE_JOB)).runs["free"]
    path = result.path.path
    assert isinstance(path, ShapedPath) and path.curve is not None
    s = np.union1d(np.linspace(0, path.length, 20_001), path.curve.breaks)
    there = BEND.project(path(s)).distance.max()
    back = nearest(BEND(np.linspace(0, BEND.length, 70_001)), path).max()
    deviation = result.verdict.deviation
    assert deviation.rounding == pytest.approx(max(there, back), abs=1e-6 * path.tolerance)
    assert deviation.rounding <= path.tolerance
    made = a_run(rounding=Rounding(shape="free", tolerance=1e-3), timing=ac.Optimal())
    same = run(a_job(BEND, made), simulate=False).runs["free"].path.path
    assert same.deviation == deviation.rounding
