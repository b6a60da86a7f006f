"""What binds where, how much is run at the assigned velocity, and why not more."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import Method, PathLaw, Rates
from armcontour.timing import explain
from armcontour.timing.constraints import IntervalEnds, SecondOrder, jerks_of
from armcontour.timing.grid import grid_through


def robot(dof):
    return SimpleNamespace(dof=dof, limits=ac.Limits())


def names(explanation):
    """What binds, one after the other, leaving out the single intervals between two limits."""
    return [x.name for x in explanation.bindings if x.name != "nothing"]


def assert_tiled(explanation, planned):
    assert_in_order(explanation, planned)
    for x in explanation.bindings:
        assert (x.share >= 0.999) == (x.limit != "nothing")


def assert_in_order(explanation, planned):
    law = planned.laws[0]
    first, last = explanation.bindings[0], explanation.bindings[-1]
    assert first.t[0] == 0 and first.s[0] == law.s[0]
    assert last.t[1] == planned.duration and last.s[1] == law.s[-1]
    for before, after in zip(explanation.bindings[:-1], explanation.bindings[1:], strict=True):
        assert before.t[1] == after.t[0] and before.s[1] == after.s[0]
        assert before.name != after.name
    for x in explanation.bindings:
        assert x.t[0] < x.t[1] and x.s[0] < x.s[1]
        assert 0 <= x.share <= 1 + 1e-9


# --- joints


def test_a_trapezoid_of_one_joint():
    limits = ac.Limits(joint_acceleration=[1.0], joint_deceleration=[2.0], joint_velocity=[0.5])
    planned = ac.plan(ac.JointPath.spline([(0.0,), (2.0,)]), robot(1), limits)
    found = explain(planned, robot(1), limits)
    assert_tiled(found, planned)
    assert names(found) == ["joint 1 acceleration", "joint 1 velocity", "joint 1 acceleration"]
    middle = next(x for x in found.bindings if x.limit == "velocity")
    # Up at 1 rad/s², down at 2 rad/s²: 0.125 and 0.0625 rad, known to one interval of 0.5 mrad.
    np.testing.assert_allclose(middle.s, [0.125, 2 - 0.0625], atol=1e-3)
    np.testing.assert_allclose(middle.t, [0.5, planned.duration - 0.25], atol=2e-3)
    assert middle.joint == 1
    assert (found.assigned_length, found.assigned_time, found.shortfalls) == (None, None, ())
    assert repr(found) == (
        "Explanation(joint 1 velocity 83%, joint 1 acceleration 17%; 0 shortfalls)"
    )


@pytest.mark.parametrize("slow", [0, 1, 2])
def test_the_slowest_joint_is_named(slow):
    acceleration = np.full(3, 5.0)
    acceleration[slow] = 1.0
    limits = ac.Limits(joint_acceleration=acceleration)
    path = ac.JointPath.spline([(0.0, 0.0, 0.0), (1.0, -1.0, 1.0)])
    planned = ac.plan(path, robot(3), limits)
    found = explain(planned, robot(3), limits)
    assert_tiled(found, planned)
    assert set(names(found)) == {f"joint {slow + 1} acceleration"}


def test_a_further_constraint_is_named():
    def coefficients(s, side):
        one = np.ones((len(s), 1))
        return one, 0 * one, 0 * one

    weak = SecondOrder("torque", coefficients, [-0.5], [0.5], joints=True)
    limits = ac.Limits(joint_acceleration=[5.0])
    path = ac.JointPath.spline([(0.0,), (2.0,)])
    planned = ac.plan(path, robot(1), limits, constraints=[weak])
    found = explain(planned, robot(1), limits, constraints=[weak])
    assert_tiled(found, planned)
    assert set(names(found)) == {"joint 1 torque"}


RAMP, JERK = 0.2, 5.0  # s, m/s³
SLOPE = 40.0  # 1/s²


def smooth_law(joint_path):
    """Uniform jerk from rest, half a wave of the path acceleration, uniform jerk to rest.

    The plan has rests at both ends, and its jerk is largest in the middle of the wave.
    """
    speed, most = JERK * RAMP**2 / 2, JERK * RAMP
    ramp, wave = JERK * RAMP**3 / 6, 2 * most / SLOPE
    s = np.cumsum([0.0, ramp, wave, speed * RAMP - most * RAMP**2 / 2 + JERK * RAMP**3 / 6])
    time = 2 * np.arctan(most / (speed * np.sqrt(SLOPE))) / np.sqrt(SLOPE)
    return PathLaw(
        joint_path=joint_path,
        breaks=np.cumsum([0.0, RAMP, time, RAMP]),
        s=s,
        rates=Rates(
            ds=np.array([0.0, speed, speed]),
            dds=np.array([0.0, most, -most]),
            slope=np.array([0.0, -SLOPE, 0.0]),
            jerk=np.array([JERK, 0.0, JERK]),
        ),
    )


def smooth_length():
    return 2 * JERK * RAMP**3 / 6 + 2 * JERK * RAMP / SLOPE


def test_jerk_is_named_where_it_binds():
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, -2.0)])
    scale = path.breaks[-1] / smooth_length()
    path = ac.JointPath(breaks=path.breaks / scale, coefficients=path.coefficients)
    planned = ac.Trajectory(laws=(smooth_law(path),), method=Method.OPTIMAL)
    # In the middle of the wave, ds² = ds1² + dds1² / slope; both joints move evenly along s.
    middle = SLOPE * np.sqrt((JERK * RAMP**2 / 2) ** 2 + (JERK * RAMP) ** 2 / SLOPE)
    slope = 2.0 / smooth_length()
    t, s = planned.breaks, planned.laws[0].s
    np.testing.assert_allclose(np.abs(planned(t[1:3].mean(), 3)[1]), slope * middle, rtol=1e-12)
    limits = ac.Limits(joint_jerk=[np.inf, slope * middle])
    found = explain(planned, robot(2), limits)
    assert names(found) == ["joint 2 jerk"]
    assert [x.limit for x in found.bindings] == ["nothing", "jerk", "nothing"]
    assert (found.bindings[1].t, found.bindings[1].s) == (tuple(t[1:3]), tuple(s[1:3]))
    assert found.bindings[1].share == pytest.approx(1, abs=1e-12)
    # Next to rests jerk is uniform, and here far below its limit.
    assert found.bindings[0].share == pytest.approx(JERK / middle, abs=1e-12)


def test_the_tools_jerk_is_the_largest_along_an_interval(arm):
    path = ac.JointPath.spline([(0.0, 0.0), (1.0, 0.0)])
    path = ac.JointPath(breaks=path.breaks * smooth_length(), coefficients=path.coefficients)
    law = smooth_law(path)
    ends = IntervalEnds(arm, law, grid_through(path, law.s))
    tool, along = (x.usage(ends)[:, 0] for x in jerks_of(ac.Limits(tool_jerk=1, path_jerk=1), 2))
    assert along[0] == pytest.approx(JERK) and along[2] == pytest.approx(JERK)
    planned = ac.Trajectory(laws=(law,), method=Method.OPTIMAL)
    for k in range(3):
        t = np.linspace(*law.breaks[k : k + 2], 201)[1:-1]
        dq, ddq, dddq = (planned(t, order)[:, 0] for order in (1, 2, 3))
        # The stretched arm turns on a circle.
        jerk = (arm.link1 + arm.link2) * np.hypot(dddq - dq**3, 3 * dq * ddq)
        assert tool[k] == pytest.approx(jerk.max(), rel=0.02)


@pytest.mark.parametrize("factor", [3, 50])
def test_plans_with_limits_of_jerk_are_covered(factor):
    rng = np.random.default_rng(1)
    path = ac.JointPath.spline(rng.uniform(-1.5, 1.5, (5, 2)))
    limits = ac.Limits(joint_velocity=1.5, joint_acceleration=5.0, joint_jerk=5.0 * factor)
    planned = ac.plan(path, robot(2), limits.for_joints(2))
    found = explain(planned, robot(2), limits)
    assert_in_order(found, planned)
    # It is jerk that holds a motion back next to its rests, and it is a limit at each time but
    # where one limit hands over to another.
    assert {found.bindings[k].limit for k in (0, -1)} == {"jerk"}
    assert set(x.limit for x in found.bindings) >= {"jerk", "acceleration", "velocity"}
    idle = sum(x.t[1] - x.t[0] for x in found.bindings if x.limit == "nothing")
    assert idle < 0.005 * planned.duration


@pytest.mark.parametrize("seed", range(8))
def test_random_splines_are_covered(seed):
    rng = np.random.default_rng(seed)
    dof = int(rng.integers(2, 8))
    path = ac.JointPath.spline(rng.uniform(-2, 2, (6, dof)))
    limits = ac.Limits(
        joint_velocity=rng.uniform(0.5, 3, dof), joint_acceleration=rng.uniform(0.5, 5, dof)
    )
    planned = ac.plan(path, robot(dof), limits)
    found = explain(planned, robot(dof), limits)
    assert_tiled(found, planned)
    # Time-optimal: some limit binds nearly always.
    idle = sum(x.t[1] - x.t[0] for x in found.bindings if x.limit == "nothing")
    assert idle < 0.02 * planned.duration


# --- tool

SPEED, ACCELERATION = 0.1, 0.2  # m/s, m/s²


def line(length):
    return ac.Path.polyline([(0.3, 0.2), (0.3 + length, 0.2)])


def test_shares_of_a_line_in_closed_form(arm):
    only = ac.Limits(speed=SPEED, tool_acceleration=ACCELERATION)
    planned = ac.plan(line(0.1), arm, only)
    found = explain(planned, arm, only)
    assert_tiled(found, planned)
    assert names(found) == ["tool acceleration", "assigned velocity", "tool acceleration"]
    ramp = SPEED**2 / (2 * ACCELERATION)
    time = 0.1 / SPEED + SPEED / ACCELERATION
    # Known to an interval or two at either end.
    assert found.assigned_length == pytest.approx(1 - 2 * ramp / 0.1, abs=2e-3)
    assert found.assigned_time == pytest.approx(1 - 2 * SPEED / ACCELERATION / time, abs=2e-3)
    assert found.shortfalls == ()


def test_a_line_too_short_for_its_speed(arm):
    only = ac.Limits(speed=SPEED, tool_acceleration=ACCELERATION)
    planned = ac.plan(line(0.03), arm, only)
    found = explain(planned, arm, only)
    assert found.assigned_length == found.assigned_time == 0
    (shortfall,) = found.shortfalls
    top = np.sqrt(ACCELERATION * 0.03)
    assert shortfall.kind == "fastest"
    assert shortfall.reason == "tool acceleration"
    assert shortfall.s == pytest.approx(0.015, abs=1e-4)
    assert shortfall.speed == pytest.approx(top, rel=1e-3)
    assert shortfall.assigned == SPEED
    assert shortfall.sentence == "tool acceleration at s = 0.015 m: 0.0775 of 0.1 m/s"


def test_the_papers_job(traced, rounded, arm, limits):
    planned = ac.plan(traced, arm, limits)
    found = explain(planned, arm, limits)
    assert_tiled(found, planned)
    assert names(found) == [
        "joint 2 acceleration",
        "joint 2 acceleration",
        "centripetal acceleration",
        "joint 1 acceleration",
        "assigned velocity",
        "joint 1 acceleration",
        "joint 2 acceleration",
        "centripetal acceleration",
        "joint 2 acceleration",
        "joint 2 acceleration",
    ]
    # The paper runs each corner at one speed: so does the optimum, under its centripetal bound.
    turns = [x for x in found.bindings if x.limit == "centripetal acceleration"]
    assert [x.joint for x in turns] == [None, None]
    corners = np.column_stack([rounded.corners.start, rounded.corners.end])
    np.testing.assert_allclose([x.s for x in turns], corners, atol=1e-9)
    assert [x.kind for x in found.shortfalls] == ["fastest", "slowest", "slowest", "fastest"]
    # docs/method.md: 32.422 and 30.444 mm/s in the corners.
    slow = [x for x in found.shortfalls if x.kind == "slowest"]
    assert [x.reason for x in slow] == ["centripetal acceleration"] * 2
    np.testing.assert_allclose([x.speed for x in slow], [0.032422, 0.030444], rtol=1e-4)
    np.testing.assert_allclose([x.s for x in slow], corners.mean(axis=1), atol=2e-4)
    fast = [x for x in found.shortfalls if x.kind == "fastest"]
    assert [x.reason for x in fast] == ["joint 2 acceleration"] * 2
    assert slow[0].sentence == "centripetal acceleration at s = 0.075 m: 0.0324 of 0.15 m/s"
    # On line 2 only.
    at_speed = [x for x in found.bindings if x.limit == "assigned velocity"]
    (only,) = at_speed
    # On the intervals next to it another limit binds more, but the speed is there too.
    share = (only.s[1] - only.s[0]) / rounded.length
    assert share <= found.assigned_length < share + 2e-3
    share = (only.t[1] - only.t[0]) / planned.duration
    assert share <= found.assigned_time < share + 2e-3


def test_every_segment_has_its_own_assigned_velocity(arm):
    points = [(0.3, 0.2), (0.34, 0.2), (0.38, 0.2)]
    path = ac.Path.from_segments(
        [
            ac.Line(start=points[0], end=points[1], demand=ac.Demand(speed=0.02)),
            ac.Line(start=points[1], end=points[2], demand=ac.Demand(speed=0.5)),
        ]
    )
    only = ac.Limits(tool_acceleration=ACCELERATION)
    planned = ac.plan(path, arm, only)
    found = explain(planned, arm, only)
    assert_tiled(found, planned)
    slow = next(x for x in found.bindings if x.limit == "assigned velocity")
    assert slow.s[1] == pytest.approx(0.04, abs=1e-9)
    assert found.assigned_length == pytest.approx(0.5 * (1 - 0.001 / 0.04), abs=2e-3)
    (shortfall,) = found.shortfalls
    assert shortfall.assigned == 0.5
    assert 0.04 < shortfall.s < 0.08


def test_the_arms_limits_are_the_default(arm):
    planned = ac.plan(line(0.1), arm)
    found = explain(planned, arm)
    assert_tiled(found, planned)
    assert set(names(found)) <= {"joint 1 acceleration", "joint 2 acceleration"}
    assert found.assigned_length is None


def test_only_optimal_plans_can_be_explained(mac, arm, limits, refuses):
    refuses(
        lambda: explain(mac, arm, limits),
        ac.InvalidInput,
        "methods optimal and shaped",
        "not of mac",
    )


@pytest.mark.filterwarnings("ignore:Limits of jerk add")
def test_stops_that_limits_of_jerk_force_are_named():
    arm = ac.load_arm("pmk3s")
    objective = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3)])
    limits = arm.limits.replace(speed=0.15, joint_jerk=36.0)
    arcs = ac.round_corners(objective, tolerance=5e-3)
    found = ac.explain(ac.plan(arcs, arm, limits), arm, limits)
    np.testing.assert_allclose(found.jerk_stops, arcs.breaks[1:-1])
    assert "2 stops by jerk" in repr(found)
    free = limits.replace(joint_jerk=None)
    assert ac.explain(ac.plan(arcs, arm, free), arm, free).jerk_stops == ()


def test_margins_of_wide_intervals_do_not_hide_what_binds():
    """Along bends whose curvature varies, wide intervals leave some percent of the limit."""
    arm = ac.load_arm("pmk3s")
    path = ac.Path.polyline([(0.35, 0.10), (0.41, 0.15), (0.28, 0.30)])
    path = ac.round_corners(path, tolerance=5e-3, continuity="curvature")
    limits = ac.Limits(tool_acceleration=0.3)
    planned = ac.plan(path, arm, limits, intervals=300)
    times = {"tool acceleration": 0.0, "nothing": 0.0}
    for x in ac.explain(planned, arm, limits).bindings:
        times[x.name] += x.t[1] - x.t[0]
    assert times["nothing"] < 0.03 * planned.duration
