"""Full stops where the curvature jumps and jerk is limited: found, counted, and said once."""

from __future__ import annotations

import dataclasses
from pathlib import Path as FilePath
from typing import Any

import numpy as np
import pytest

import armcontour as ac
from armcontour.io.cell import read_cell
from armcontour.io.job_overrides import JobOverrides
from armcontour.jobs import Rounding, Run, teach, warnings_of
from armcontour.program import Contour, Program

DRAWINGS = FilePath(__file__).parents[2] / "examples" / "drawings"
# A line, a quarter of a circle, and a line: the curvature jumps at both ends of the arc.
BENT = [
    ac.Line(start=(0.30, 0.20), end=(0.36, 0.20)),
    ac.Arc(start=(0.36, 0.20), center=(0.36, 0.22), angle=np.pi / 2),
    ac.Line(start=(0.38, 0.22), end=(0.38, 0.26)),
]
ENDS = [0.06, 0.06 + 0.01 * np.pi]
CORNER = [(0.30, 0.20), (0.34, 0.20), (0.34, 0.23)]


def job(path: Any, *runs: dict[str, Any]) -> ac.Job:
    arm = ac.load_arm("pmk3s")
    servo = ac.ServoModel(kp=25.0, kv=150.0)
    asked: dict[str, Any] = {
        "timing": "optimal",
        "compensation": "none",
        "limits": arm.limits.replace(speed=0.1, joint_jerk=7.2).for_joints(2),
        "rounding": Rounding(tolerance=1e-3),
        "period": 4e-3,
        "timing_options": {"intervals": 200},
    }
    made = tuple(Run(name=f"run{i}", **asked | x) for i, x in enumerate(runs))
    return ac.Job(
        name="j", title="j", arm=arm, path=path, servo=servo, plant_servo=servo, runs=made
    )


@pytest.fixture(scope="module")
def bent() -> ac.Path:
    return ac.Path.from_segments(BENT)


def test_the_ends_of_an_arc_are_said_once(bent: ac.Path) -> None:
    runs: list[dict[str, Any]] = [{}, {"compensation": "inverse"}, {"smoothing": (0.01,)}]
    plans = teach(job(bent, *({**x, "rounding": None} for x in runs)))
    for plan in plans.values():
        assert [x.s for x in plan.jerk_stops] == pytest.approx(ENDS, abs=1e-12)
        assert plan.jerk_stops[1].point == pytest.approx((0.38, 0.22), abs=1e-9)
        assert plan.trajectory.speed_at(ENDS) == pytest.approx([0, 0], abs=1e-9)
        assert plan.full_stops == {"curvature jumps": 2} and plan.stops_note is None
    (said,) = [x for x in warnings_of(plans.values()) if "full stop" in x]
    assert said.startswith(
        "Runs run0, run1, run2: 2 full stops, the first at s = 0.06 m (360, 200 mm), where the "
        "curvature of the path jumps and limits of jerk allow no speed: corners, such as corners: "
        "{tolerance: 0.1 mm}, join lines and arcs without such jumps."
    )


def test_transitions_spare_the_stops_within_their_tolerance(bent: ac.Path) -> None:
    fine = Rounding(tolerance=1e-3, transition_tolerance=1e-6)
    coarse = Rounding(tolerance=2e-6)
    arcs = Rounding(tolerance=1e-3, continuity="tangent")
    plans = teach(job(bent, {}, {"rounding": fine}, {"rounding": coarse}, {"rounding": arcs}))
    times = {}
    for plan, allowed in zip(plans.values(), (1e-5, 1e-6, 2e-6, 0.0), strict=True):
        path = plan.path.path
        s = np.linspace(0.0, path.length, 4001)
        off = bent.project(path(s)).distance.max()
        assert off <= allowed + 1e-12 and (off > 0.5 * allowed or allowed == 0.0)
        assert plan.full_stops == ({} if allowed else {"curvature jumps": 2})
        times[allowed] = plan.trajectory.duration
    assert sorted(times, reverse=True) == sorted(times, key=lambda x: times[x])


def test_set_points_of_a_drawing_change_no_faster_than_the_arm_may() -> None:
    """An ellipse of 37 arcs on the UR5e, with acceleration and jerk of a joint_limits.yaml."""
    one = JobOverrides(names=("handle 38",))
    drawn = read_cell(DRAWINGS / "gentle.yaml", DRAWINGS / "gasket.dxf", overrides=one)
    as_planned, compensated = teach(drawn).values()
    assert as_planned.full_stops == {} and as_planned.warnings == ()
    limits, taught = drawn.runs[0].limits, as_planned.taught
    for order, limit in (
        (1, limits.joint_velocity),
        (2, limits.joint_acceleration),
        (3, limits.joint_jerk),
    ):
        ratio = np.abs(np.diff(taught.q, order, axis=0)) / taught.period**order / limit
        assert ratio.max() < 1 + 1e-6
    assert ratio.max() > 0.99
    # The inverse of the servo leads by dddq / K_p, and by what the jerk's own jumps ask for.
    ahead = np.abs(np.diff(compensated.taught.q, 2, axis=0)) / taught.period**2
    assert (ahead < limits.joint_acceleration + limits.joint_jerk / 25.0).all()


def test_without_limits_of_jerk_the_tool_goes_on(bent: ac.Path) -> None:
    plain = ac.load_arm("pmk3s").limits.replace(speed=0.1)
    endless = plain.replace(joint_jerk=float("inf")).for_joints(2)
    for plan in teach(job(bent, {"limits": plain}, {"limits": endless})).values():
        assert plan.full_stops == {} and not any("full stop" in x for x in plan.warnings)


def test_contours_are_named_and_counted_together(bent: ac.Path) -> None:
    straight = ac.Path.polyline([(0.3, 0.3), (0.34, 0.3)])
    program = Program(moves=(Contour(path=straight, name="A"), Contour(path=bent, name="B")))
    (plan,) = teach(job(program, {"rounding": None})).values()
    assert [x.contour for x in plan.jerk_stops] == ["contour B"] * 2
    (said,) = [x for x in plan.warnings if "full stop" in x]
    assert "2 full stops, the first at s = 0.06 m (360, 200 mm) of contour B" in said


def test_corners_have_no_such_stops_unless_arcs_are_asked_for() -> None:
    arcs = Rounding(tolerance=1e-3, continuity="tangent")
    plans = teach(job(ac.Path.polyline(CORNER), {}, {"rounding": arcs}))
    curved, tangent = plans.values()
    assert curved.full_stops == {} and tangent.full_stops == {"curvature jumps": 2}
    assert curved.trajectory.duration < tangent.trajectory.duration
    (said,) = [x for x in tangent.warnings if "full stop" in x]
    assert said.endswith("corners: {continuity: curvature} has no such jumps.")
    c = tangent.path.path.corners
    assert [x.s for x in tangent.jerk_stops] == pytest.approx([c.start[0], c.end[0]], abs=1e-9)
    # The corner error is the same.
    assert curved.path.path.corners.error == pytest.approx([1e-3], rel=1e-9)


def test_a_vertex_that_stops_the_tool_anyway_is_not_said_again() -> None:
    plan = next(iter(teach(job(ac.Path.polyline(CORNER), {"rounding": None})).values()))
    assert plan.full_stops == {"rounding off": 1} and plan.jerk_stops == ()
    assert plan.stops_note == "Run run0: 1 full stop inside contours (1 rounding off)."
    slow = dataclasses.replace(plan.run, duration=2 * plan.trajectory.duration)
    again = next(iter(teach(dataclasses.replace(job(plan.path, {}), runs=(slow,))).values()))
    assert again.full_stops == {"rounding off": 1} and again.jerk_stops == ()
