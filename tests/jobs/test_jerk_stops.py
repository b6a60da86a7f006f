"""Full stops where the curvature jumps and jerk is limited: found, counted, and said once."""

import dataclasses
from pathlib import Path as FilePath

import numpy as np
import pytest
from tests.geometry.tables import arc, each, line, path_of
from tests.jobs.making import ARM, a_job, a_run

import armcontour as ac
from armcontour.frames import from_rpy
from armcontour.geometry.placing import lift_path, place_path
from armcontour.io.cell import read_cell
from armcontour.io.job_overrides import JobOverrides
from armcontour.jobs import Rounding, teach, warnings_of
from armcontour.program import Contour, Program

DRAWINGS = FilePath(__file__).parents[2] / "examples" / "drawings"
# A line, a quarter of a circle, and a line: the curvature jumps at both ends of the arc.
BENT = path_of(
    line((0.30, 0.20), (0.36, 0.20)),
    arc((0.36, 0.20), (0.36, 0.22), np.pi / 2),
    line((0.38, 0.22), (0.38, 0.26)),
)
ENDS = [0.06, 0.06 + 0.01 * np.pi]
CORNER = ac.Path.polyline([(0.30, 0.20), (0.34, 0.20), (0.34, 0.23)])
ARCS = Rounding(tolerance=1e-3, continuity="tangent")


def plans(path, *runs, arm=ARM):
    asked = {
        "compensation": "none",
        "limits": arm.limits.replace(speed=0.1, joint_jerk=7.2).for_joints(arm.dof),
        "rounding": Rounding(tolerance=1e-3),
        "timing_options": {"intervals": 200},
    }
    made = (a_run(f"run{i}", **asked | x) for i, x in enumerate(runs))
    return list(teach(a_job(path, *made, arm=arm)).values())


def stops_said(sentences):
    return [x for x in sentences if "full stop" in x]


def test_the_ends_of_an_arc_are_said_once_and_counted_by_contours():
    runs = ({}, {"compensation": "inverse"}, {"smoothing": (0.01,)})
    found = plans(BENT, *({**x, "rounding": None} for x in runs))
    for plan in found:
        assert [x.s for x in plan.jerk_stops] == pytest.approx(ENDS, abs=1e-12)
        assert plan.jerk_stops[1].point == pytest.approx((0.38, 0.22), abs=1e-9)
        assert plan.trajectory.speed_at(ENDS) == pytest.approx([0, 0], abs=1e-9)
        assert plan.full_stops == {"curvature jumps": 2} and plan.stops_note is None
    (said,) = stops_said(warnings_of(found))
    assert said.startswith("Runs run0, run1, run2: 2 full stops, the first at s = 0.06 m (360, 200")
    straight = ac.Path.polyline([(0.3, 0.3), (0.34, 0.3)])
    program = Program(moves=(Contour(path=straight, name="A"), Contour(path=BENT, name="B")))
    (plan,) = plans(program, {"rounding": None})
    assert [x.contour for x in plan.jerk_stops] == ["contour B"] * 2
    (said,) = stops_said(plan.warnings)
    assert "2 full stops, the first at s = 0.06 m (360, 200 mm) of contour B" in said


def test_transitions_spare_the_stops_within_their_tolerance():
    fine, coarse = Rounding(tolerance=1e-3, transition_tolerance=1e-6), Rounding(tolerance=2e-6)
    found = plans(BENT, {}, {"rounding": fine}, {"rounding": coarse}, {"rounding": ARCS})
    times = {}
    for plan, allowed in zip(found, (1e-5, 1e-6, 2e-6, 0.0), strict=True):
        path = plan.path.path
        off = BENT.project(path(np.linspace(0.0, path.length, 4001))).distance.max()
        assert off <= allowed + 1e-12 and (off > 0.5 * allowed or allowed == 0.0)
        assert plan.full_stops == ({} if allowed else {"curvature jumps": 2})
        times[allowed] = plan.trajectory.duration
    assert sorted(times, reverse=True) == sorted(times, key=lambda x: times[x])


def test_set_points_of_a_drawing_change_no_faster_than_the_arm_may():
    """An ellipse of 37 arcs on the UR5e, with acceleration and jerk of a joint_limits.yaml."""
    one = JobOverrides(names=("handle 38",))
    drawn = read_cell(DRAWINGS / "gentle.yaml", DRAWINGS / "gasket.dxf", overrides=one)
    as_planned, compensated = teach(drawn).values()
    assert as_planned.full_stops == {} and as_planned.warnings == ()
    limits, taught = drawn.runs[0].limits, as_planned.taught
    bounds = limits.joint_velocity, limits.joint_acceleration, limits.joint_jerk
    for order, limit in enumerate(bounds, 1):
        ratio = np.abs(np.diff(taught.q, order, axis=0)) / taught.period**order / limit
        assert ratio.max() < 1 + 1e-6
    assert ratio.max() > 0.99
    # The inverse of the servo leads by dddq / K_p, and by what the jerk's own jumps ask for.
    ahead = np.abs(np.diff(compensated.taught.q, 2, axis=0)) / taught.period**2
    assert (ahead < limits.joint_acceleration + limits.joint_jerk / 25.0).all()


def test_stops_that_are_not_there_or_are_there_anyway_are_not_said():
    plain = ARM.limits.replace(speed=0.1)
    endless = plain.replace(joint_jerk=float("inf")).for_joints(2)
    for plan in plans(BENT, {"limits": plain}, {"limits": endless}):
        assert plan.full_stops == {} and not stops_said(plan.warnings)
    (plan,) = plans(CORNER, {"rounding": None})
    assert plan.full_stops == {"rounding off": 1} and plan.jerk_stops == ()
    assert plan.stops_note == "Run run0: 1 full stop inside contours (1 rounding off)."
    slow = dataclasses.replace(plan.run, duration=2 * plan.trajectory.duration)
    again = teach(a_job(plan.path, slow))["run0"]
    assert again.full_stops == {"rounding off": 1} and again.jerk_stops == ()


@each("orientation, stops", [("fixed", 0), ("follows", 0), ("turns", 2)])
def test_transitions_in_space(orientation, stops):
    way = place_path(lift_path(BENT), ac.Frame(position=(0.1, -0.2, 0.2)))
    down = from_rpy([[np.pi, 0, 0]] * 3 + [[np.pi, 0, 0.05]])
    turned = {
        "fixed": lambda: way.oriented(down[0]),
        "follows": lambda: way.following_tangent((0.0, 0.0, 1.0)),
        "turns": lambda: way.oriented(down),
    }[orientation]()
    arm, rounding = ac.load_arm("ur5e"), Rounding(tolerance=1e-3, angular_tolerance=0.05)
    limits = arm.limits.replace(speed=0.1, joint_jerk=100.0).for_joints(6)
    (plan,) = plans(turned, {"limits": limits, "rounding": rounding}, arm=arm)
    assert len(plan.jerk_stops) == stops
    assert sum("does not turn" in x for x in plan.warnings) == (stops > 0)


def test_corners_have_no_such_stops_unless_arcs_are_asked_for():
    curved, tangent = plans(CORNER, {}, {"rounding": ARCS})
    assert curved.full_stops == {} and tangent.full_stops == {"curvature jumps": 2}
    assert curved.trajectory.duration < tangent.trajectory.duration
    (said,) = stops_said(tangent.warnings)
    assert "corners: {continuity: curvature}" in said
    c = tangent.path.path.corners
    assert [x.s for x in tangent.jerk_stops] == pytest.approx([c.start[0], c.end[0]], abs=1e-9)
    # The corner error is the same.
    assert curved.path.path.corners.error == pytest.approx([1e-3], rel=1e-9)
