"""Straight joint moves from rest to rest, against Ruckig, which plans them in closed form."""

from __future__ import annotations

import numpy as np

import armcontour as ac

# The longest that a plan may be, as a share of Ruckig's; it is never shorter.
BAR, ROUNDING = 1e-3, 1e-9


def draw(seed: int) -> tuple[np.ndarray, ac.Limits]:
    """Both ends of a move, (2, dof), and the limits of its joints."""
    rng = np.random.default_rng((17, seed))
    dof = int(rng.integers(1, 8))
    ends = rng.uniform(-3, 3, (2, dof))
    velocity, acceleration = 10 ** rng.uniform(-1, 1, dof), 10 ** rng.uniform(-0.5, 1.5, dof)
    factor = 10 ** rng.uniform(np.log10(2), np.log10(300))
    jerk = factor * acceleration * 10 ** rng.uniform(-0.3, 0.3, dof)
    return ends, ac.Limits(
        joint_velocity=velocity, joint_acceleration=acceleration, joint_jerk=jerk
    )


def ruckig_duration(ends: np.ndarray, limits: ac.Limits) -> float:
    """Duration along the line, of which every joint scales the limits [s]."""
    from ruckig import InputParameter, Result, Ruckig, Trajectory

    step = np.abs(ends[1] - ends[0])
    given = InputParameter(1)
    given.current_position, given.target_position = [0.0], [1.0]
    given.max_velocity = [float((limits.joint_velocity / step).min())]
    given.max_acceleration = [float((limits.joint_acceleration / step).min())]
    given.max_jerk = [float((limits.joint_jerk / step).min())]
    found = Trajectory(1)
    result = Ruckig(1).calculate(given, found)
    assert result in (Result.Working, Result.Finished), result
    return float(found.duration)


def gap(seed: int) -> float:
    """Share of Ruckig's duration by which our plan is longer."""
    ends, limits = draw(seed)
    planned = ac.plan(ac.JointPath.spline(ends), limits=limits)
    return planned.duration / ruckig_duration(ends, limits) - 1
