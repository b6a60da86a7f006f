"""Runs whose corners have the shape free: what is shaped, shared, kept and said."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import armcontour as ac
from armcontour._progress import Step
from armcontour.errors import InvalidInput
from armcontour.geometry import Arc, Path, ShapedPath
from armcontour.jobs import Job, Rounding, Run, Shaped, run, steps_of, teach
from armcontour.program import Contour, Event, Lead, Process, Program

ARM = ac.load_arm("pmk3s")
SERVO = ac.ServoModel(kp=25.0, kv=150.0)
LIMITS = ARM.limits.replace(speed=0.1, centripetal_acceleration=0.09)
BEND = Path.polyline([[0.30, 0.20], [0.34, 0.20], [0.34, 0.23]])
BACK = Path.polyline(BEND.vertices[::-1])
FREE = Rounding(shape="free", tolerance=1e-3, iterations=3)
GRID = {"intervals": 300}


def a_run(name: str = "free", **values: object) -> Run:
    asked: dict[str, Any] = {
        "timing": "optimal",
        "compensation": "inverse",
        "limits": LIMITS,
        "rounding": FREE,
        "period": 4e-3,
        "timing_options": GRID,
    }
    return Run(name=name, **{**asked, **values})


def a_job(*runs: Run, path: Path | Program = BEND, process: Process | None = None) -> Job:
    return Job(
        name="j",
        title="j",
        arm=ARM,
        path=path,
        servo=SERVO,
        plant_servo=SERVO,
        process=process or Process(),
        runs=runs,
    )


def test_the_run_is_shaped_for_its_limits_less_the_reserve() -> None:
    job = a_job(a_run(), a_run("arcs", rounding=Rounding(tolerance=1e-3)), a_run("r", reserve=0.3))
    plans = teach(job)
    path = plans["free"].path.path
    assert isinstance(path, ShapedPath) and path.objective is job.single_path
    assert plans["free"].trajectory.method == "optimal"
    assert plans["free"].trajectory.duration <= plans["arcs"].trajectory.duration * (1 + 1e-9)
    kept = LIMITS.replace(joint_acceleration=0.7 * np.asarray(LIMITS.joint_acceleration))
    alone = ac.plan(BEND, ARM, kept, method="shaped", tolerance=1e-3, iterations=3, intervals=300)
    assert plans["r"].trajectory.duration == pytest.approx(alone.duration, rel=1e-12)
    assert plans["r"].trajectory.duration > plans["free"].trajectory.duration


def test_runs_share_a_shape_if_limits_corners_and_reserve_are_the_same() -> None:
    first, same, other = a_run("a"), a_run("b", compensation="none"), a_run("c", reserve=0.1)
    plans = teach(a_job(first, same, other, a_run("d", timing_options={"intervals": 200})))
    assert plans["b"].path is plans["a"].path and plans["b"].traced is plans["a"].traced
    assert plans["c"].path is not plans["a"].path and plans["d"].path is not plans["a"].path


def test_a_given_duration_smoothing_and_the_execution_are_as_for_arcs() -> None:
    runs = (a_run(), a_run("slow", duration=4.0), a_run("smooth", smoothing=(0.02,)))
    # Without a reserve the servo saturates and overshoots.
    study = run(a_job(*(dataclasses.replace(x, reserve=0.1) for x in runs)))
    found = study.runs
    assert found["slow"].trajectory.duration == pytest.approx(4.0, abs=1e-9)
    assert found["slow"].path is found["free"].path
    for x in found.values():
        assert x.evaluation.contour_error.max < 1e-4
        assert x.evaluation.objective_error is not None
        assert x.evaluation.objective_error.max < 1e-3 + x.evaluation.contour_error.max
    assert found["free"].explanation is not None


def test_contours_have_rapids_leads_and_events_on_their_shapes() -> None:
    events = (Event(name="tool", s=0.02, value=1.0),)
    moves = (Contour(path=BEND, name="one", events=events), Contour(path=BACK))
    lead = Lead(length=4e-3)
    job = a_job(a_run(), path=Program(moves=moves), process=Process(lead_in=lead, lead_out=lead))
    plan = teach(job)["free"]
    assert [type(x.path) for x in plan.path.contours] == [ShapedPath, ShapedPath]
    shaped = plan.shaped
    assert shaped is not None and sum(shaped.starts.values()) == 2
    spans = [x.t[1] - x.t[0] for x in plan.trajectory.contour_spans]
    assert sum(spans) == pytest.approx(shaped.durations["shaped"], rel=1e-9)
    (at,) = [x.s for x in plan.path.contours[0].events if x.name == "tool"]
    path = plan.path.contours[0].path
    assert np.linalg.norm(path(at) - BEND(0.02)) < 1e-3


def test_leads_of_automatic_length_are_found_with_arcs() -> None:
    process = Process(lead_in=Lead(length=None), lead_out=Lead(length=None))
    arcs = a_run("arcs", rounding=Rounding(tolerance=1e-3))
    plans = teach(a_job(a_run(), arcs, process=process))
    lengths = [plans[x].objective.contours[0].work for x in ("free", "arcs")]
    assert lengths[0] == lengths[1] and lengths[0] is not None and lengths[0][0] > 0
    assert isinstance(plans["free"].path.contours[0].path, ShapedPath)


def test_the_step_is_called_shaping_and_says_its_share() -> None:
    steps: list[Step] = []
    job = a_job(a_run())
    teach(job, progress=steps.append)
    shaping = [x for x in steps if x.names[:2] == ("free", "shaping")]
    assert shaping[-1].done == 1.0
    assert steps_of(job.runs[0])[0] == "shaping" and "rounding" not in steps_of(job.runs[0])
    assert steps_of(a_run(rounding=None))[0] == "rounding"


def test_shaping_may_be_interrupted() -> None:
    def stop(step: Step) -> None:
        if step.names[1] == "shaping" and step.done is not None:
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        teach(a_job(a_run()), progress=stop)


def test_what_is_said_of_a_shaped_run() -> None:
    strict = dataclasses.replace(BEND.segments, tolerances=np.array([np.nan, 5e-3]))
    job = a_job(a_run(), path=Path(segments=strict))
    plan = teach(job)["free"]
    assert plan.shape_note is not None and plan.shaped is not None
    assert plan.shape_note.startswith(
        f"Run free: shaped: {plan.shaped.durations['shaped']:.4g} s (arcs "
    )
    assert 0 <= plan.shaped.gain < 1
    (said,) = [x for x in plan.weak_points if "capped" in x]
    assert "5 mm of segment 2 is capped at 1 mm by corners.tolerance" in said
    assert teach(a_job(a_run(rounding=None)))["free"].shape_note is None


def test_sums_over_contours_leave_out_starts_that_one_does_not_have() -> None:
    path = teach(a_job(a_run()))["free"].path.path
    assert isinstance(path, ShapedPath)

    def shaped(start: str, **durations: float) -> Contour:
        outcome = dataclasses.replace(path.outcome, start=start, durations=durations)
        return Contour(path=dataclasses.replace(path, outcome=outcome))

    some = shaped("arcs", arcs=2.0, stops=3.0, shaped=1.5)
    other = shaped("stops", stops=2.0, shaped=2.0)
    found = Shaped.of(Program(moves=(some, other)))
    assert found is not None and found.starts == {"arcs": 1, "stops": 1}
    assert found.durations == {"stops": 5.0, "shaped": 3.5}
    assert found.gain == pytest.approx(0.3)
    assert str(found) == "shaped: 3.5 s (stops 5 s)"


@pytest.mark.parametrize(
    ("rounding", "words"),
    [
        (Rounding(shape="free"), "corners.tolerance is missing: the shape free needs it"),
        (Rounding(shape="round"), "corners.shape must be one of arc, free, not 'round'"),
        (Rounding(tolerance=1e-3, zone=0.02), "corners.zone is for the shape free"),
        (
            Rounding(shape="free", tolerance=1e-3, speed=0.1),
            "corners.speed sets the radius of arcs, but the shape is free",
        ),
        (
            Rounding(shape="free", tolerance=1e-3, line_tolerance=2e-3, zone=0.02),
            "corners.line_tolerance of 2 mm is above corners.tolerance of 1 mm",
        ),
        (
            Rounding(shape="free", tolerance=1e-3, line_tolerance=1e-4),
            "corners: line_tolerance is given without zone",
        ),
        (Rounding(shape="free", tolerance=float("nan")), "corners: tolerance"),
        (Rounding(shape="free", tolerance=1e-3, iterations=-1), "corners: iterations"),
    ],
)
def test_values_that_do_not_go_together_are_refused(rounding: Rounding, words: str) -> None:
    with pytest.raises(InvalidInput, match=words):
        a_run(rounding=rounding)


@pytest.mark.parametrize("method", ["mac", "conventional"])
def test_other_timing_methods_keep_arcs(method: str) -> None:
    with pytest.raises(InvalidInput, match=f"timing method optimal, but this run .* {method}"):
        a_run(timing=method, timing_options={})


def test_an_arm_in_space_keeps_the_configuration_that_it_was_shaped_for() -> None:
    # The fastest configuration of the shaped circle is another than that of the circle.
    arm = ac.load_arm("ur5e")
    circle = Path.from_segments(
        [Arc(start=(0.35, 0, 0.1), center=(0.352, 0, 0.1), angle=2 * np.pi, normal=(0, 0, 1))]
    )
    bend = Path.polyline([(0.38, 0, 0.1), (0.41, 0, 0.1), (0.41, 0.03, 0.1)])
    moves = tuple(Contour(path=x.pointing((0, 0, -1))) for x in (circle, bend))
    rounding = Rounding(shape="free", tolerance=2.5e-4, iterations=2)
    limits = arm.limits.replace(speed=0.1, centripetal_acceleration=1.0)
    this = a_run(limits=limits, rounding=rounding, reserve=0.1)
    job = dataclasses.replace(a_job(this, path=Program(moves=moves)), arm=arm)
    plan = teach(job)["free"]
    for span, x in zip(plan.trajectory.contour_spans, plan.path.contours, strict=True):
        assert isinstance(x.path, ShapedPath)
        assert span.t[1] - span.t[0] == pytest.approx(x.path.outcome.durations["shaped"], rel=1e-9)


def test_a_shape_is_never_slower_than_arcs_of_a_redundant_arm() -> None:
    # Measured points: with stops at all of them another configuration is the fastest than along
    # arcs, and an arm with a free joint is slower near a given start than where it may choose.
    rng = np.random.default_rng(3)
    turn = np.linspace(0, np.pi, 13)
    points = np.stack([0.45 + 0.06 * np.cos(turn), 0.06 * np.sin(turn), 0 * turn + 0.3], axis=1)
    axes = rng.normal(scale=3e-3, size=(13, 3)) - (0, 0, 1)
    path = Path.polyline(points).pointing(axes)
    arm = ac.load_arm("panda")
    limits = arm.limits.replace(speed=0.15, joint_torque=None, joint_jerk=None)
    arcs = Rounding(tolerance=3e-4, angular_tolerance=0.03)
    free = dataclasses.replace(arcs, shape="free", iterations=1)
    asked = {"limits": limits, "reserve": 0.1}
    runs = (a_run("a", rounding=arcs, **asked), a_run("b", rounding=free, **asked))
    moves = Program(moves=(Contour(path=path), ac.Dwell(duration=0.1)))
    for given in (path, moves):
        plans = teach(dataclasses.replace(a_job(*runs, path=given), arm=arm))
        told = plans["b"].shaped
        assert told is not None
        span = plans["a"].trajectory.contour_spans[0]
        assert told.durations["arcs"] == pytest.approx(span.t[1] - span.t[0], rel=1e-9)
        assert plans["b"].trajectory.duration <= plans["a"].trajectory.duration * (1 + 1e-9)
        found = plans["b"].trajectory.contour_spans[0]
        assert told.durations["shaped"] == pytest.approx(found.t[1] - found.t[0], rel=1e-9)
