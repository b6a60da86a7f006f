"""Plans with limits of jerk against IPOPT, closed forms and Ruckig."""

import numpy as np
import pytest
from soak import jerk_oracle, straight_moves
from soak.jerk import NEAR, WITHOUT, paper_gaps, spline_gaps
from soak.jerk_oracle import Bounds, not_a_knot, solve

import armcontour as ac

# A straight line of 1 m: 0.35 s to the full speed, as long to rest, and 0.65 s between.
LINE = ac.JointPath.spline([[0.0], [1.0]])
LIMITS = ac.Limits(joint_velocity=[1.0], joint_acceleration=[4.0], joint_jerk=[40.0])
EXACT = 1.35


def test_a_line_and_the_oracle_take_what_the_closed_form_says():
    planned = ac.plan(LINE, limits=LIMITS, intervals=1000)
    assert 1 <= planned.duration / EXACT <= 1 + 1e-3
    pytest.importorskip("casadi")
    found = solve(LINE, Bounds.of(LIMITS, 1), (80, 300)).duration
    assert found == pytest.approx(EXACT, rel=2e-3)


def test_a_plan_is_as_fast_as_the_oracle():
    pytest.importorskip("casadi")
    way = np.random.default_rng(7).uniform(-1.5, 1.5, (5, 2))
    bounds = {"joint_velocity": [2.0, 3.0], "joint_acceleration": [5.0, 8.0]}
    limits = ac.Limits(**bounds, joint_jerk=[60.0, np.inf], path_jerk=20.0)
    path = not_a_knot(way)
    oracle = solve(path, Bounds.of(limits, 2), (80, 250)).duration
    assert -NEAR < ac.plan(path, limits=limits).duration / oracle - 1 < NEAR


def test_splines_are_as_fast_as_the_kept_oracle():
    """It finds the same again: `python -m soak.jerk_oracle` takes minutes."""
    for name, (above, longer) in spline_gaps().items():
        assert -NEAR < above <= NEAR, name
        assert 0 < longer <= WITHOUT[name.split()[-1]], name


def test_the_kept_oracle_is_found_again_and_the_paper_s_job_is_as_fast():
    for name, gap in paper_gaps().items():
        assert -NEAR < gap <= NEAR, name
    pytest.importorskip("casadi")
    name, path, limits = next(jerk_oracle.splines())
    again = solve(path, Bounds.of(limits, path.dof), (100,)).duration
    assert again == pytest.approx(jerk_oracle.read_durations()[name], rel=3e-3)


def test_straight_moves_take_as_long_as_ruckig_s():
    pytest.importorskip("ruckig")
    for seed in range(8):
        assert -straight_moves.ROUNDING < straight_moves.gap(seed) < straight_moves.BAR, seed
