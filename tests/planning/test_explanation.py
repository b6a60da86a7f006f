"""Explanations, the fastest configuration, and the entry point of the planners."""

from types import SimpleNamespace

import numpy as np
import pytest

import armcontour as ac
from armcontour.motion import Method, PathLaw, Rates
from armcontour.planning import PlanOptions, explain
from armcontour.planning.constraints import SecondOrder

SPEED = 0.1  # m/s, assigned to the tool
ACCELERATION = 0.2  # m/s², limit of the tool


def explained(path, arm, limits, *, tiled=True, **options):
    """A plan and its explanation, whose parts lie in order and cover all of it."""
    planned = ac.plan(path, arm, limits, ac.Optimal(**options))
    explanation = explain(planned, arm, limits, **options)
    law = planned.laws[0]
    t, s = (np.array([getattr(x, name) for x in explanation.bindings]) for name in ("t", "s"))
    for x, last in ((t, planned.duration), (s, law.s[-1])):
        assert x[0, 0] == 0 and x[-1, 1] == last and (x[:, 0] < x[:, 1]).all()
        np.testing.assert_array_equal(x[:-1, 1], x[1:, 0])
    for before, after in zip(explanation.bindings[:-1], explanation.bindings[1:], strict=True):
        assert before.name != after.name
    for x in explanation.bindings:
        assert 0 <= x.share <= 1 + 1e-9
        assert not tiled or (x.share >= 0.999) == (x.limit != "nothing")
    return planned, explanation


def robot(dof):
    return SimpleNamespace(dof=dof, limits=ac.Limits())


def names(explanation):
    """What binds, one after the other, leaving out the single intervals between two limits."""
    return [x.name for x in explanation.bindings if x.name != "nothing"]


def idle(explanation):
    """Time in which nothing binds [s]."""
    return sum(x.t[1] - x.t[0] for x in explanation.bindings if x.name == "nothing")


def test_the_explanation_names_acceleration_velocity_and_acceleration():
    limits = ac.Limits.only(joint_acceleration=[[-2.0, 1.0]], joint_velocity=[[-9.0, 0.5]])
    planned, explanation = explained(ac.JointPath.spline([(0.0,), (2.0,)]), robot(1), limits)
    assert names(explanation) == [
        "joint 1 acceleration",
        "joint 1 velocity",
        "joint 1 acceleration",
    ]
    middle = next(x for x in explanation.bindings if x.limit == "velocity")
    # Up at 1 rad/s², down at 2 rad/s²: 0.125 and 0.0625 rad, known to one interval of 0.5 mrad.
    np.testing.assert_allclose(middle.s, [0.125, 2 - 0.0625], atol=1e-3)
    np.testing.assert_allclose(middle.t, [0.5, planned.duration - 0.25], atol=2e-3)
    assert middle.joint == 0
    assert (explanation.assigned_length, explanation.assigned_time, explanation.shortfalls) == (
        None,
        None,
        (),
    )
    assert "joint 1 velocity 83%, joint 1 acceleration 17%; 0 shortfalls" in repr(explanation)


def test_the_slowest_joint_and_a_further_constraint_are_named():
    for slow in range(3):
        acceleration = np.full(3, 5.0)
        acceleration[slow] = 1.0
        path = ac.JointPath.spline([(0.0, 0.0, 0.0), (1.0, -1.0, 1.0)])
        explanation = explained(path, robot(3), ac.Limits.only(joint_acceleration=acceleration))[1]
        assert set(names(explanation)) == {f"joint {slow + 1} acceleration"}

    def coefficients(s, side):
        one = np.ones((len(s), 1))
        return one, 0 * one, 0 * one

    weak = SecondOrder("torque", coefficients, [-0.5], [0.5], joints=True)
    path = ac.JointPath.spline([(0.0,), (2.0,)])
    limits = ac.Limits.only(joint_acceleration=[5.0])
    explanation = explained(path, robot(1), limits, constraints=[weak])[1]
    assert set(names(explanation)) == {"joint 1 torque"}


# The motion of `smooth_law`.
RAMP = 0.2  # s, duration of each of the two parts with uniform jerk
JERK = 5.0  # m/s³, of these parts
SLOPE = 40.0  # 1/s², decrease of the path acceleration along s in the half wave
LENGTH = 2 * JERK * RAMP**3 / 6 + 2 * JERK * RAMP / SLOPE  # m, of the whole path


def smooth_law(points):
    """Uniform jerk from rest, half a wave of the path acceleration, uniform jerk to rest.

    The plan has rests at both ends, and its jerk is largest in the middle of the wave.
    """
    path = ac.JointPath.spline(points)
    path = ac.JointPath(breaks=[0.0, LENGTH], coefficients=path.coefficients)
    speed = JERK * RAMP**2 / 2
    peak = JERK * RAMP
    ramp = JERK * RAMP**3 / 6
    wave = 2 * peak / SLOPE
    s = np.cumsum([0.0, ramp, wave, speed * RAMP - peak * RAMP**2 / 2 + JERK * RAMP**3 / 6])
    time = 2 * np.arctan(peak / (speed * np.sqrt(SLOPE))) / np.sqrt(SLOPE)
    rates = [[0, 0, 0, JERK], [speed, peak, -SLOPE, 0], [speed, -peak, 0, JERK]]
    breaks = np.cumsum([0.0, RAMP, time, RAMP])
    return PathLaw(joint_path=path, breaks=breaks, s=s, rates=Rates(*np.transpose(rates) * 1.0))


def test_an_active_jerk_limit_is_named():
    planned = ac.Trajectory(laws=(smooth_law([(0.0, 0.0), (1.0, -2.0)]),), method=Method.OPTIMAL)
    # In the middle of the wave, ds² = ds1² + dds1² / slope; both joints move evenly along s.
    middle = SLOPE * np.sqrt((JERK * RAMP**2 / 2) ** 2 + (JERK * RAMP) ** 2 / SLOPE)
    slope = 2.0 / LENGTH
    t = planned.breaks
    s = planned.laws[0].s
    np.testing.assert_allclose(np.abs(planned(t[1:3].mean(), 3)[1]), slope * middle, rtol=1e-12)
    explanation = explain(planned, robot(2), ac.Limits.only(joint_jerk=[np.inf, slope * middle]))
    assert names(explanation) == ["joint 2 jerk"]
    assert [x.limit for x in explanation.bindings] == ["nothing", "jerk", "nothing"]
    assert (explanation.bindings[1].t, explanation.bindings[1].s) == (tuple(t[1:3]), tuple(s[1:3]))
    # Next to rests jerk is uniform, and here far below its limit.
    shares = [x.share for x in explanation.bindings[:2]]
    assert shares == pytest.approx([JERK / middle, 1], abs=1e-12)


def test_plans_with_jerk_limits_are_explained():
    path = ac.JointPath.spline(np.random.default_rng(1).uniform(-1.5, 1.5, (5, 2)))
    for factor in (3, 50):
        limits = ac.Limits.only(joint_velocity=1.5, joint_acceleration=5.0, joint_jerk=5.0 * factor)
        planned, explanation = explained(path, robot(2), limits.for_joints(2), tiled=False)
        # It is jerk that holds a motion back next to its rests, and it is a limit at each time but
        # where one limit hands over to another.
        assert {explanation.bindings[k].limit for k in (0, -1)} == {"jerk"}
        assert {x.limit for x in explanation.bindings} >= {"jerk", "acceleration", "velocity"}
        assert idle(explanation) < 0.005 * planned.duration


def line(length):
    return ac.Path.polyline([(0.3, 0.2), (0.3 + length, 0.2)])


def test_the_explanation_states_where_the_assigned_velocity_is_reached(arm):
    only = ac.Limits.only(speed=SPEED, tool_acceleration=ACCELERATION)
    explanation = explained(line(0.1), arm, only)[1]
    assert names(explanation) == ["tool acceleration", "assigned velocity", "tool acceleration"]
    ramp = SPEED**2 / (2 * ACCELERATION)
    time = 0.1 / SPEED + SPEED / ACCELERATION
    # Known to an interval or two at either end.
    assert explanation.assigned_length == pytest.approx(1 - 2 * ramp / 0.1, abs=2e-3)
    assert explanation.assigned_time == pytest.approx(1 - 2 * SPEED / ACCELERATION / time, abs=2e-3)
    assert explanation.shortfalls == ()
    explanation = explained(line(0.03), arm, only)[1]
    assert explanation.assigned_length == explanation.assigned_time == 0
    (short,) = explanation.shortfalls
    assert (short.kind, short.reason, short.assigned) == ("fastest", "tool acceleration", SPEED)
    assert short.s == pytest.approx(0.015, abs=1e-4)
    assert short.speed == pytest.approx(np.sqrt(ACCELERATION * 0.03), rel=1e-3)
    assert short.sentence == "tool acceleration at s = 15 mm: 77.5 mm/s of 100 mm/s"
    # Without an assigned velocity; the arm's limits are the default.
    planned = ac.plan(line(0.1), arm)
    explanation = explain(planned, arm)
    assert set(names(explanation)) <= {"joint 1 acceleration", "joint 2 acceleration"}
    assert explanation.assigned_length is None


def test_the_explanation_of_the_paper_job_names_its_limits(traced, rounded, arm, limits):
    planned, explanation = explained(traced, arm, limits)
    half = ["joint 2 acceleration", "joint 2 acceleration", "centripetal acceleration"]
    middle = ["joint 1 acceleration", "assigned velocity", "joint 1 acceleration"]
    assert names(explanation) == [*half, *middle, half[0], half[2], *half[:2]]
    # The paper runs each corner at one speed: so does the optimum, under its centripetal bound.
    turns = [x for x in explanation.bindings if x.limit == "centripetal acceleration"]
    assert [x.joint for x in turns] == [None, None]
    corners = np.column_stack([rounded.corners.start, rounded.corners.end])
    np.testing.assert_allclose([x.s for x in turns], corners, atol=1e-9)
    assert [x.kind for x in explanation.shortfalls] == ["fastest", "slowest", "slowest", "fastest"]
    # docs/method.md: 32.422 and 30.444 mm/s in the corners.
    slow = [x for x in explanation.shortfalls if x.kind == "slowest"]
    assert [x.reason for x in slow] == ["centripetal acceleration"] * 2
    np.testing.assert_allclose([x.speed for x in slow], [0.032422, 0.030444], rtol=1e-4)
    np.testing.assert_allclose([x.s for x in slow], corners.mean(axis=1), atol=2e-4)
    fast = [x for x in explanation.shortfalls if x.kind == "fastest"]
    assert [x.reason for x in fast] == ["joint 2 acceleration"] * 2
    # On line 2 only.
    (only,) = (x for x in explanation.bindings if x.limit == "assigned velocity")
    # On the intervals next to it another limit binds more, but the speed is there too.
    shares = np.ptp(only.s) / rounded.length, np.ptp(only.t) / planned.duration
    for share, stated in zip(
        shares, (explanation.assigned_length, explanation.assigned_time), strict=True
    ):
        assert share <= stated < share + 2e-3


def test_the_explanation_uses_the_assigned_velocity_of_each_segment(arm):
    points = [(0.3, 0.2), (0.34, 0.2), (0.38, 0.2)]
    lines = [
        ac.Line(start=points[k], end=points[k + 1], segment_limits=ac.SegmentLimits(speed=x))
        for k, x in enumerate((0.02, 0.5))
    ]
    path = ac.Path(segments=lines)
    explanation = explained(path, arm, ac.Limits.only(tool_acceleration=ACCELERATION))[1]
    slow = next(x for x in explanation.bindings if x.limit == "assigned velocity")
    assert slow.s[1] == pytest.approx(0.04, abs=1e-9)
    assert explanation.assigned_length == pytest.approx(0.5 * (1 - 0.001 / 0.04), abs=2e-3)
    (shortfall,) = explanation.shortfalls
    assert shortfall.assigned == 0.5 and 0.04 < shortfall.s < 0.08


def test_only_optimal_plans_can_be_explained(mac, arm, limits, refuses):
    refuses(lambda: explain(mac, arm, limits), ac.InvalidInput, "not of paper")


@pytest.mark.filterwarnings("ignore:Limits of jerk add")
def test_stops_caused_by_jerk_limits_are_named(arm):
    objective = ac.Path.polyline([(0.35, 0.1), (0.41, 0.15), (0.28, 0.3)])
    limits = arm.limits.replace(speed=0.15, joint_jerk=36.0)
    arcs = ac.round_corners(objective, tolerance=5e-3)
    explanation = ac.explain(ac.plan(arcs, arm, limits), arm, limits)
    np.testing.assert_allclose(explanation.jerk_stops, arcs.breaks[1:-1])
    assert "2 stops by jerk" in repr(explanation)
    free = limits.replace(joint_jerk=np.inf)
    assert ac.explain(ac.plan(arcs, arm, free), arm, free).jerk_stops == ()


def test_plan_traces_a_path_as_trace_does(arm, rounded, traced, limits):
    direct = ac.plan(rounded, arm, limits, ac.Paper(knots=50))
    by_hand = ac.plan(traced, arm, limits, ac.Paper(knots=50))
    assert direct.duration == by_hand.duration
    assert direct.path is rounded and direct.method == "paper"
    other = ac.plan(rounded, arm, limits.replace(speed=0.05), ac.Paper(configuration="negative"))
    t = np.linspace(0, other.duration, 101)
    assert (other(t)[:, 1] < 0).all()
    assert rounded.project(arm.tool_position(other(t))).distance.max() < 1e-6


def test_wrong_options_of_methods_are_refused(arm, rounded, traced, objective, limits, refuses):
    spline = ac.JointPath.spline([(0.1, 1.0), (0.2, 1.1), (0.5, 1.0)])
    for call in (
        lambda: ac.Paper(intervals=50),
        lambda: ac.Conventional(knots=3),
        lambda: ac.Paper(knots=7),
        lambda: ac.Paper(cycle=0.0),
        lambda: ac.Paper(cycle=np.nan),
        PlanOptions,
    ):
        refuses(call, ac.InvalidInput)
    rows = [(rounded, limits, ac.Paper(configuration="up"), ac.InvalidInput, {})]
    for options in (ac.Paper(), ac.Conventional()):
        # The arm's limits hold no assigned velocity, which the method needs.
        rows.append((rounded, None, options, ac.InvalidInput, {}))
        rows.append((spline, limits, options, ac.InvalidInput, {}))
        jerk = limits.replace(joint_jerk=10.0)
        rows.append((traced, jerk, options, ac.NotRealizable, {"limit": "joint_jerk"}))
    # Along a shaped path accelerations jump.
    jerk = limits.replace(joint_jerk=10.0)
    shaped = ac.Shaped(tolerance=1e-3)
    data = {"limit": "joint_jerk"}
    rows.append((objective, jerk, shaped, ac.NotRealizable, data))
    refuses(lambda: ac.shape(objective, arm, jerk, shaped), ac.NotRealizable, **data)
    for changed_limits in ({"joint_acceleration": np.inf}, {"joint_acceleration": [1.0, 1.0, 1.0]}):
        rows.append((rounded, limits.replace(**changed_limits), ac.Paper(), ac.InvalidInput, {}))
    rows.append((traced, limits, ac.Optimal(configuration="negative"), ac.InvalidInput, {}))
    for path, changed_limits, options, kind, data in rows:
        refuses(lambda x=path, y=changed_limits, z=options: ac.plan(x, arm, y, z), kind, **data)


def test_an_infinite_jerk_limit_is_no_limit(arm, traced, limits):
    slow = limits.replace(speed=0.04)
    endless = slow.replace(joint_jerk=[np.inf, np.inf])
    assert not endless.limits_jerk
    durations = [ac.plan(traced, arm, x, ac.Paper(knots=50)).duration for x in (slow, endless)]
    assert durations[0] == durations[1]
