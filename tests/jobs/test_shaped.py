"""Runs whose corners have the shape free: what is shaped, shared, kept and said."""

import dataclasses

import numpy as np
import pytest
from tests.geometry.tables import refused
from tests.jobs import making
from tests.jobs.making import ARM, a_job

import armcontour as ac
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


def test_a_given_duration_and_the_execution_are_as_for_arcs():
    # Without a reserve the servo saturates and overshoots.
    durations = {"free": None, "slow": 4.0}
    timings = {k: ac.Optimal(intervals=300, reserve=0.1, duration=x) for k, x in durations.items()}
    results = run(a_job(BEND, *(a_run(k, timing=x) for k, x in timings.items()))).runs
    assert results["slow"].trajectory.duration == pytest.approx(4.0, abs=1e-9)
    assert results["slow"].path is results["free"].path
    for x in results.values():
        assert x.evaluation.contour_error.max < 1e-4
        assert x.evaluation.objective_error.max < 1e-3 + x.evaluation.contour_error.max
    assert results["free"].explanation is not None


def test_contours_have_rapids_leads_and_events_on_their_shapes():
    events = (Event(name="tool", s=0.02, value=1.0),)
    moves = (Contour(path=BEND, name="one", events=events), Contour(path=BACK))
    lead = Lead(length=4e-3)
    process = Process(lead_in=lead, lead_out=lead)
    plan = run(a_job(Program(moves=moves), a_run(), process=process), simulate=False).runs["free"]
    assert [type(x.path) for x in plan.path.contours] == [ShapedPath, ShapedPath]
    assert sum(plan.shaped.starts.values()) == 2
    spans = [x.t[1] - x.t[0] for x in plan.trajectory.contour_spans]
    assert sum(spans) == pytest.approx(plan.shaped.durations["shaped"], rel=1e-9)
    (switch_s,) = [x.s for x in plan.path.contours[0].events if x.name == "tool"]
    assert np.linalg.norm(plan.path.contours[0].path(switch_s) - BEND(0.02)) < 1e-3


def test_leads_of_automatic_length_are_found_with_arcs():
    process = Process(lead_in=Lead(length=None), lead_out=Lead(length=None))
    plans = run(
        a_job(BEND, a_run(), a_run("arcs", rounding=ARCS), process=process), simulate=False
    ).runs
    free, arcs = (plans[x].objective.contours[0].work for x in ("free", "arcs"))
    assert free == arcs and free[0] > 0
    assert isinstance(plans["free"].path.contours[0].path, ShapedPath)


def test_values_that_do_not_go_together_are_refused():
    def made(**values):
        return lambda: a_run(rounding=Rounding(**values))

    free = {"shape": "free", "tolerance": 1e-3}
    refused(
        (made(shape="free"), "corners.tolerance is missing"),
        (made(shape="free", tolerance=float("nan")), "tolerance of a rounding"),
        (made(**free, iterations=-1), "iterations of a rounding"),
        (lambda: a_run(timing=ac.Paper()), "timing method optimal", "paper"),
    )


def test_an_arm_in_space_keeps_the_configuration_that_it_was_shaped_for():
    # The fastest configuration of the shaped circle is another than that of the circle.
    arm = ac.load_arm("ur5e")
    circle = Path.from_segments(
        [Arc(start=(0.35, 0, 0.1), center=(0.352, 0, 0.1), angle=2 * np.pi, normal=(0, 0, 1))]
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


def test_a_shape_is_never_slower_than_arcs_of_a_redundant_arm():
    # Measured points: with stops at all of them another configuration is the fastest than along
    # arcs, and an arm with a free joint is slower near a given start than where it may choose.
    rng = np.random.default_rng(3)
    turn = np.linspace(0, np.pi, 13)
    points = np.stack([0.45 + 0.06 * np.cos(turn), 0.06 * np.sin(turn), 0 * turn + 0.3], axis=1)
    axes = rng.normal(scale=3e-3, size=(13, 3)) - (0, 0, 1)
    path = Path.polyline(points).pointing(axes)
    arm = ac.load_arm("panda")
    limits = arm.limits.replace(speed=0.15, joint_torque=np.inf, joint_jerk=np.inf)
    arcs = Rounding(tolerance=3e-4, angular_tolerance=0.03)
    free = dataclasses.replace(arcs, shape="free", iterations=1)
    run_options = {"limits": limits, "timing": ac.Optimal(reserve=0.1, intervals=150)}
    runs = (a_run("a", rounding=arcs, **run_options), a_run("b", rounding=free, **run_options))
    for motion in (path, Program(moves=(Contour(path=path), ac.Dwell(duration=0.1)))):
        plans = run(a_job(motion, *runs, arm=arm), simulate=False).runs
        outcome = plans["b"].shaped
        span, shaped_span = (plans[x].trajectory.contour_spans[0] for x in "ab")
        assert outcome.durations["arcs"] == pytest.approx(span.t[1] - span.t[0], rel=1e-9)
        assert plans["b"].trajectory.duration <= plans["a"].trajectory.duration * (1 + 1e-9)
        assert outcome.durations["shaped"] == pytest.approx(
            shaped_span.t[1] - shaped_span.t[0], rel=1e-9
        )
