"""Plans with limits of jerk against IPOPT, closed forms and Ruckig."""

import numpy as np
import pytest
from soak.jerk import run_move
from tests.oracle.jerk_optimum import NEAR, WITHOUT, Bounds, not_a_knot, paper, solve, splines

import armcontour as ac

# A straight line of 1 m: 0.35 s to the full speed, as long to rest, and 0.65 s between.
LINE = ac.JointPath.spline([[0.0], [1.0]])
LIMITS = ac.Limits(joint_velocity=[1.0], joint_acceleration=[4.0], joint_jerk=[40.0])
EXACT = 1.35
# Durations [s] that `solve` has found.
KEPT = {
    "spline 0 at 10": 6.13785,
    "spline 1 at 10": 5.232257,
    "spline 2 at 10": 5.719026,
    "spline 3 at 10": 4.877969,
    "spline 4 at 10": 4.644522,
    "spline 0 at 50": 6.052785,
    "spline 1 at 50": 5.147903,
    "spline 2 at 50": 5.632885,
    "spline 3 at 50": 4.791418,
    "spline 4 at 50": 4.555831,
    "paper at 7.2": 5.177963,
    "paper at 36": 5.085867,
}


def test_plan_and_oracle_of_a_line_have_the_duration_of_the_closed_form():
    planned = ac.plan(LINE, limits=LIMITS, options=ac.Optimal(intervals=1000))
    assert 1 <= planned.duration / EXACT <= 1 + 1e-3
    pytest.importorskip("casadi")
    duration = solve(LINE, Bounds.of(LIMITS, 1), (80, 300)).duration
    assert duration == pytest.approx(EXACT, rel=2e-3)


def test_a_plan_is_as_fast_as_the_oracle():
    pytest.importorskip("casadi")
    way = np.random.default_rng(7).uniform(-1.5, 1.5, (5, 2))
    bounds = {"joint_velocity": [2.0, 3.0], "joint_acceleration": [5.0, 8.0]}
    limits = ac.Limits(**bounds, joint_jerk=[60.0, np.inf])
    path = not_a_knot(way)
    oracle = solve(path, Bounds.of(limits, 2), (80, 250)).duration
    assert -NEAR < ac.plan(path, limits=limits).duration / oracle - 1 < NEAR


def test_splines_and_the_paper_job_are_as_fast_as_the_stored_oracle():
    """It finds the same again: `python -m soak jerk-oracle` takes minutes."""
    for name, path, limits in splines():
        duration = ac.plan(path, limits=limits).duration
        plain = ac.plan(path, limits=limits.replace(joint_jerk=np.inf)).duration
        assert -NEAR < duration / KEPT[name] - 1 <= NEAR, name
        assert 0 < duration / plain - 1 <= WITHOUT[name.split()[-1]], name
    for name, path, limits in paper():
        duration = ac.plan(path, ac.load_arm("pmk3s"), limits).duration
        assert -NEAR < duration / KEPT[name] - 1 <= NEAR, name


def test_the_stored_oracle_is_reproduced():
    pytest.importorskip("casadi")
    name, path, limits = next(splines())
    again = solve(path, Bounds.of(limits, path.dof), (100,)).duration
    assert again == pytest.approx(KEPT[name], rel=3e-3)


def test_straight_moves_take_as_long_as_with_ruckig():
    pytest.importorskip("ruckig")
    for seed in range(8):
        assert run_move(seed).notes == [], seed
