"""What holds for every optimal plan: symmetry, scaling, monotony, and limits between the points."""

from types import SimpleNamespace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import armcontour as ac

LEAK = 1e-9
INTERVALS = 300
# Plans on a coarse grid are this near to the optimum.
COARSE = 5e-3


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
    limits = ac.Limits(joint_velocity=velocity, joint_acceleration=rng.uniform(0.2, 5, dof))
    return np.cumsum(steps, axis=0) * size, limits


def plan(points, limits, intervals=INTERVALS):
    path = ac.JointPath.spline(points)
    return ac.plan(path, robot(path.dof), limits, intervals=intervals)


@given(problems())
def test_reversing_a_path_keeps_the_duration(problem):
    points, limits = problem
    there, back = plan(points, limits), plan(points[::-1], limits)
    assert back.duration == pytest.approx(there.duration, rel=COARSE)


@given(problems(), st.floats(0.1, 0.99), st.sampled_from(["joint_velocity", "joint_acceleration"]))
def test_tighter_limits_are_never_faster(problem, share, name):
    points, limits = problem
    if getattr(limits, name) is None:
        name = "joint_acceleration"
    tighter = limits.replace(**{name: getattr(limits, name) * share})
    slow, fast = plan(points, tighter), plan(points, limits)
    assert slow.duration >= fast.duration * (1 - COARSE)
    if name == "joint_acceleration":
        # Never worse than running the whole plan slower, either.
        assert slow.duration <= fast.duration / np.sqrt(share) * (1 + COARSE)


@given(problems(), st.floats(-3, 3))
def test_speeds_k_and_accelerations_k_squared_take_the_time_by_k(problem, power):
    points, limits = problem
    k = 10**power
    velocity = None if limits.joint_velocity is None else limits.joint_velocity * k
    faster = ac.Limits(joint_velocity=velocity, joint_acceleration=limits.joint_acceleration * k**2)
    own = plan(points, limits).duration
    assert plan(points, faster).duration * k == pytest.approx(own, rel=1e-9)


@given(problem=problems(), intervals=st.sampled_from([10, 60, 300, 1500]))
def test_the_motion_goes_forward_and_keeps_its_limits(problem, intervals, worst_ratios):
    points, limits = problem
    planned = plan(points, limits, intervals)
    law = planned.laws[0]
    assert law.s[0] == 0 and law.s[-1] == law.joint_path.breaks[-1]
    np.testing.assert_allclose(planned([0.0, planned.duration]), points[[0, -1]], atol=1e-9 * 1e3)
    assert (np.diff(law.s) > 0).all() and (law.rates.ds[1:] > 0).all()
    i = np.repeat(np.arange(len(law.breaks) - 1), 5)
    t = (law.breaks[:-1, None] + np.diff(law.breaks)[:, None] * np.linspace(0, 1, 5)).ravel()
    assert (np.diff(law.path_position(i, t)) >= -1e-12 * law.s[-1]).all()
    assert (law.path_position(i, t, 1) >= -1e-9 * law.rates.ds.max()).all()
    found = worst_ratios(planned, limits)
    assert max(found.values()) <= 1 + LEAK


def turning_line(arm, rng):
    """A line in the workspace of the arm on which at least one joint turns round."""
    while True:
        ends = rng.uniform((-0.28, 0.02), (0.55, 0.42), size=(2, 2))
        points = ends[0] + np.linspace(0, 1, 60)[:, None] * (ends[1] - ends[0])
        near, far = arm.reach
        distance = np.hypot(points[:, 0] - arm.base, points[:, 1])
        if distance.min() < near + 0.01 or distance.max() > far - 1e-3:
            continue
        steps = np.diff(arm.inverse(points), axis=0)
        # Not past the base, where joint 1 would swing round.
        if np.abs(steps).max() < 0.5 and (np.ptp(np.sign(steps), axis=0) == 2).any():
            return ac.Path.polyline(ends)


def test_lines_on_which_a_joint_turns_round(arm, worst_ratios):
    """Planned, limits kept."""
    rng = np.random.default_rng(0)
    for _ in range(200):
        path = turning_line(arm, rng)
        limits = ac.Limits(
            joint_acceleration=10 ** rng.uniform(-0.5, 0.5, 2), speed=10 ** rng.uniform(-1.5, 0)
        )
        planned = ac.plan(path, arm, limits, intervals=INTERVALS)
        found = worst_ratios(planned, limits, arm, places=10)
        assert max(found.values()) <= 1 + LEAK, path.vertices
        assert set(found) == {"joint_acceleration", "speed"}
