"""Full stops where the curvature jumps and jerk is limited: found, counted, and said once."""

from __future__ import annotations

import dataclasses
from typing import Any

import numpy as np
import pytest

import armcontour as ac
from armcontour.jobs import Rounding, Run, teach, warnings_of
from armcontour.program import Contour, Program

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
    plans = teach(job(bent, {}, {"compensation": "inverse"}, {"smoothing": (0.01,)}))
    for plan in plans.values():
        assert [x.s for x in plan.jerk_stops] == pytest.approx(ENDS, abs=1e-12)
        assert plan.jerk_stops[1].point == pytest.approx((0.38, 0.22), abs=1e-9)
        assert plan.trajectory.speed_at(ENDS) == pytest.approx([0, 0], abs=1e-9)
        assert plan.full_stops == {"curvature jumps": 2} and plan.stops_note is None
    (said,) = [x for x in warnings_of(plans.values()) if "full stop" in x]
    assert said.startswith(
        "Runs run0, run1, run2: 2 full stops, the first at s = 0.06 m (360, 200 mm), where the "
        "curvature of the path jumps and limits of jerk allow no speed"
    )


def test_without_limits_of_jerk_the_tool_goes_on(bent: ac.Path) -> None:
    plain = ac.load_arm("pmk3s").limits.replace(speed=0.1)
    endless = plain.replace(joint_jerk=float("inf")).for_joints(2)
    for plan in teach(job(bent, {"limits": plain}, {"limits": endless})).values():
        assert plan.full_stops == {} and not any("full stop" in x for x in plan.warnings)


def test_contours_are_named_and_counted_together(bent: ac.Path) -> None:
    straight = ac.Path.polyline([(0.3, 0.3), (0.34, 0.3)])
    program = Program(moves=(Contour(path=straight, name="A"), Contour(path=bent, name="B")))
    (plan,) = teach(job(program, {})).values()
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
    assert said.endswith("corners: {continuity: curvature} rounds corners without such jumps.")
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
