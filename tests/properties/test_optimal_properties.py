"""Properties of plans and executions."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import example, given
from hypothesis import strategies as st

import armcontour as ac
from armcontour.motion import LapLaw

LEAK = 1e-9
INTERVALS = 300


def robot(dof):
    return SimpleNamespace(dof=dof, limits=ac.Limits())


@st.composite
def problems(draw):
    """Waypoints at least 0.05 rad apart, and limits."""
    dof = draw(st.integers(1, 7))
    count = draw(st.integers(2, 7))
    rng = np.random.default_rng(draw(st.integers(0, 2**32 - 1)))
    size = 10 ** draw(st.floats(-3, 2))
    steps = rng.normal(size=(count, dof))
    steps *= rng.uniform(0.05, 1, (count, 1)) / np.linalg.norm(steps, axis=1, keepdims=True)
    velocity = rng.uniform(0.2, 3, dof) if draw(st.booleans()) else None
    limits = ac.Limits.only(joint_velocity=velocity, joint_acceleration=rng.uniform(0.2, 5, dof))
    return np.cumsum(steps, axis=0) * size, limits


def plan(points, limits, intervals=INTERVALS):
    path = ac.JointPath.spline(points)
    return ac.plan(path, robot(path.dof), limits, ac.Optimal(intervals=intervals))


# The only joint turns round three times.
TURNS = np.array([[-0.1], [-0.4], [0.0], [0.2], [0.3], [0.6], [0.1]])


@example(problem=(TURNS, ac.Limits.only(joint_acceleration=np.array([2.0]))), intervals=10)
@given(problem=problems(), intervals=st.sampled_from([10, 60, 300, 1500]))
def test_random_plans_move_forward_within_their_limits(problem, intervals, worst_ratios):
    points, limits = problem
    planned = plan(points, limits, intervals)
    law = planned.laws[0]
    assert law.s[0] == 0 and law.s[-1] == law.joint_path.breaks[-1]
    np.testing.assert_allclose(planned([0.0, planned.duration]), points[[0, -1]], atol=1e-9 * 1e3)
    # A single joint turns round at a full stop.
    moves = ~np.isin(law.s[1 : len(law.rates.ds)], law.joint_path.stops)
    assert (np.diff(law.s) > 0).all() and (law.rates.ds[1:] > 0)[moves].all()
    i = np.repeat(np.arange(len(law.breaks) - 1), 5)
    t = (law.breaks[:-1, None] + np.diff(law.breaks)[:, None] * np.linspace(0, 1, 5)).ravel()
    assert (np.diff(law.path_position(i, t)) >= -1e-12 * law.s[-1]).all()
    assert (law.path_position(i, t, 1) >= -1e-9 * law.rates.ds.max()).all()
    ratios = worst_ratios(planned, limits)
    assert max(ratios.values()) <= 1 + LEAK


def turning_line(arm, rng):
    """A line in the workspace of the arm on which at least one joint turns round."""
    while True:
        ends = rng.uniform((-0.28, 0.02), (0.55, 0.42), size=(2, 2))
        points = ends[0] + np.linspace(0, 1, 60)[:, None] * (ends[1] - ends[0])
        near, far = arm.reach
        distance = np.hypot(points[:, 0] - arm.base, points[:, 1])
        if distance.min() < near + 0.01 or distance.max() > far - 1e-3:
            continue
        steps = np.diff(arm.joint_position(points), axis=0)
        # Not past the base, where joint 1 would swing round.
        if np.abs(steps).max() < 0.5 and (np.ptp(np.sign(steps), axis=0) == 2).any():
            return ac.Path.polyline(ends)


def test_lines_on_which_a_joint_reverses_are_planned_within_their_limits(arm, worst_ratios):
    """Planned, limits kept."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        path = turning_line(arm, rng)
        limits = ac.Limits.only(
            joint_acceleration=10 ** rng.uniform(-0.5, 0.5, 2), speed=10 ** rng.uniform(-1.5, 0)
        )
        planned = ac.plan(path, arm, limits, ac.Optimal(intervals=INTERVALS))
        ratios = worst_ratios(planned, limits, arm, places=10)
        assert max(ratios.values()) <= 1 + LEAK, path.vertices
        assert set(ratios) == {"joint_acceleration", "speed"}


def random_job(rng):
    points = rng.uniform((0.15, 0.08), (0.42, 0.32), size=(int(rng.integers(2, 6)), 2))
    if rng.random() < 0.2:  # a short line among long ones
        points[1] = points[0] + rng.uniform(-2e-3, 2e-3, 2)
    rounded = ac.round_corners(ac.Path.polyline(points), tolerance=10 ** rng.uniform(-3.5, -2))
    limits = ac.Limits.only(
        joint_acceleration=rng.uniform(0.4, 2.0, 2),
        speed=rng.uniform(0.03, 0.25),
        centripetal_acceleration=rng.uniform(0.03, 0.2),
    )
    return rounded, limits, int(rng.integers(40, 200))


@pytest.mark.parametrize("batch", range(2))
def test_random_polylines_are_planned_within_their_limits_or_refused(arm, batch):
    rng = np.random.default_rng(batch)
    planned_ones = refused_ones = 0
    for _ in range(40):
        path, limits, knots = random_job(rng)
        try:
            planned = ac.plan(path, arm, limits, ac.Paper(knots=knots))
        except ac.NotRealizable as error:
            assert 0 <= error.s <= path.length
            if "at rest next to an arc" in str(error):  # the arc used up the first or last line
                assert 0 in path.corners.start or path.length in path.corners.end
                continue
            # Intervals of full acceleration satisfy the limit or are refused.
            assert "(MAC)" not in str(error) and "(MDC)" not in str(error)
            assert error.limit == "joint_acceleration" and error.joint in (0, 1)
            assert error.needed > error.allowed
            refused_ones += 1
            continue
        planned_ones += 1
        breaks = planned.breaks
        t = (breaks[:-1, None] + np.diff(breaks)[:, None] * np.linspace(0.05, 0.95, 10)).ravel()
        q, dq, ddq = (planned(t, order) for order in (0, 1, 2))
        assert (np.abs(ddq) <= limits.joint_acceleration * (1 + 1e-6)).all()
        speed = np.linalg.norm(arm.tool_velocity(q, dq), axis=1)
        # Tracing leaves the tool 1e-8 m of play, and its speed a few millionths.
        assert speed.max() <= limits.speed * (1 + 1e-5)
        projection = path.project(arm.tool_position(q))
        assert projection.distance.max() < 2e-5
        inner = breaks[1:-1]
        np.testing.assert_allclose(planned(inner, side="left"), planned(inner), atol=1e-9)
        assert np.abs(planned([0.0, planned.duration], 1)).max() < 1e-9
        ends = arm.tool_position(planned([0.0, planned.duration]))
        np.testing.assert_allclose(ends, path.vertices[[0, -1]], atol=1e-7)
        assert planned.duration > path.length / limits.speed
        demand = np.max([x.demand for x in planned.stretches], axis=0)
        assert (demand >= np.abs(ddq).max(axis=0) * (1 - 1e-3)).all()
    assert planned_ones >= 10 and refused_ones >= 1


def still(q=(0.0, 0.0)):
    rest = np.zeros((1, 2))
    law = LapLaw(breaks=np.array([0.0, 1.0]), q=np.array([q, q]), dq=rest, ddq=rest)
    return ac.Trajectory(laws=(law,), method="hand")


def run(arm, q, cycle, kp, kv, limit, interpolation="linear"):
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
    set_points = ac.SetPoints(cycle=cycle, q=q, trajectory=still(), method="x")
    plant = ac.ServoPlant(arm, servo, ac.Limits.only(joint_acceleration=limit))
    execution = ac.simulate(set_points, plant, resolution=cycle)
    np.testing.assert_allclose(execution.q[-1], set_points.q[-1], atol=1e-8)
    np.testing.assert_allclose(execution.dq[-1], 0, atol=1e-8)
    assert (execution.saturated_time <= execution.t[-1] * (1 + 1e-9)).all()
    assert np.isfinite(execution.peak_demand).all()
    # No joint ever moves faster than the limit lets it.
    assert (np.abs(np.diff(execution.dq, axis=0)) <= limit * cycle * (1 + 1e-9)).all()
    return execution


@given(
    st.lists(st.tuples(st.floats(-0.1, 0.1), st.floats(-1e-3, 1e-3)), min_size=2, max_size=12),
    st.sampled_from([1e-3, 4e-3, 0.03]),
    st.sampled_from([(25.0, 150.0), (25.0, 100.0), (60.0, 40.0)]),
    st.sampled_from([0.0, 1e-16, 3e-16, 1e-15, 1e-13, 1e-11, 1e-9, 1e-7, 1e-5, 1e-3]),
    st.sampled_from(["linear", "step"]),
)
def test_a_limit_equal_to_the_peak_demand_is_simulated_exactly(
    arm, q, cycle, gain, below, interpolation
):
    # The demand's largest value without a limit, taken as the limit: it touches and turns round.
    kp, kv = gain
    servo = ac.ServoModel(kp=kp, kv=kv, interpolation=interpolation)
    set_points = ac.SetPoints(cycle=cycle, q=np.array(q), trajectory=still(), method="x")
    free = ac.simulate(set_points, ac.ServoPlant(arm, servo, ac.Limits.only()), resolution=cycle)
    limit = np.maximum(free.peak_demand * (1 - below), 0.1)
    run(arm, np.array(q), cycle, kp, kv, limit, interpolation)
