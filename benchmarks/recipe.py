"""Plan the recipe of copp's own benchmark: paths of seven joints through 50 random points.

Every path has its own limits, near 1 rad/s, 5 rad/s² and 50 rad/s³. The peers get the same cubic
splines and limits, without the limits of jerk. Times are the means of all paths, and include making
the path and the limits.
"""

from __future__ import annotations

from importlib.util import find_spec
from typing import NamedTuple

import numpy as np

import armcontour as ac
from benchmarks import reference
from benchmarks.measured import Bar, Line, Missing, Pair, timed

# Paths, joints, and points of each path.
PATHS = 13
JOINTS = 7
POINTS = 50
# Stations of copp-py, and grid points of the plan that is compared with it.
STATIONS = 1000
# Limits of every joint: these values times factors from 0.9 to 1.1.
VELOCITY = 1.0  # rad/s
ACCELERATION = 5.0  # rad/s²
JERK = 50.0  # rad/s³
SEED = 20260414
AT = np.linspace(0.0, 1.0, POINTS)


class Problem(NamedTuple):
    """Points of a path, and its limits in both directions."""

    points: np.ndarray  # rad, (POINTS, JOINTS)
    velocity: np.ndarray  # Lower and upper bounds [rad/s], (JOINTS, 2)
    acceleration: np.ndarray  # Lower and upper bounds [rad/s²], (JOINTS, 2)
    jerk: np.ndarray  # rad/s³, (JOINTS,)


def lines() -> list[Line]:
    """Return the lines against copp-py and toppra, by default, and with limits of jerk."""
    title = f"{PATHS} paths of {JOINTS} joints through {POINTS} points"
    return [
        Line(
            "recipe/copp", f"{title}, {STATIONS} stations", "copp-py", _against_copp, Bar(ratio=1.2)
        ),
        Line("recipe/toppra", f"{title}, {STATIONS} stations", "toppra (Seidel)", _against_toppra),
        Line("recipe/default", f"{title}, default", reference.NAME, _default, Bar(seconds=6.5e-3)),
        Line("recipe/jerk", f"{title}, jerk", reference.NAME, _with_jerk, Bar(seconds=18e-3)),
    ]


def problems() -> list[Problem]:
    """Draw the problems, as the recipe does."""
    rng = np.random.default_rng(SEED)

    def bounds(value: float) -> np.ndarray:
        low = -value * rng.uniform(0.9, 1.1, JOINTS)
        return np.column_stack([low, value * rng.uniform(0.9, 1.1, JOINTS)])

    drawn = []
    for _ in range(PATHS):
        points = rng.uniform(-0.5, 0.5, (POINTS, JOINTS))
        velocity = bounds(VELOCITY)
        acceleration = bounds(ACCELERATION)
        drawn.append(Problem(points, velocity, acceleration, bounds(JERK)[:, 1]))
    return drawn


def plan_all(intervals: int | None = None, *, jerk: bool = False) -> list[ac.Trajectory]:
    """Plan all paths; making paths and limits is included in the time."""
    plans = []
    for x in problems():
        limits = ac.Limits(
            joint_velocity=x.velocity,
            joint_acceleration=x.acceleration,
            joint_jerk=x.jerk if jerk else None,
        )
        path = ac.JointPath.spline(x.points, AT)
        plans.append(ac.plan(path, limits=limits, options=ac.Optimal(intervals=intervals)))
    return plans


def _copp_all(slopes: list[np.ndarray]) -> list[float]:
    """Plan all paths with copp-py; return the durations [s].

    `slopes` are the derivatives of the splines at both ends, per point, (2, JOINTS) each.
    """
    import copp_py as copp

    s = np.linspace(0.0, 1.0, STATIONS)
    durations = []
    for k, x in enumerate(problems()):
        # The same natural spline has these slopes at its ends, per point.
        ends = slopes[k]
        config = copp.SplineConfig(order=3, start_state=ends[:1].T, end_state=ends[1:].T)
        path = copp.Path.from_waypoints_interpolating(x.points, config)
        robot = copp.Robot(JOINTS, capacity=STATIONS)
        robot.append_s(s)
        robot.set_q_from_path_2nd(path, 0, STATIONS)
        for add, (low, high) in (
            (robot.add_velocity_limits, x.velocity.T),
            (robot.add_acceleration_limits, x.acceleration.T),
        ):
            upper = np.ascontiguousarray(high)
            add(upper, np.ascontiguousarray(low), start_idx_s=0, length=STATIONS)
        problem = copp.solver.topp2_ra.Problem(
            robot.constraints, idx_s_interval=(0, STATIONS - 1), a_boundary=(0.0, 0.0)
        )
        squares = copp.solver.topp2_ra.solve(problem, copp.solver.topp2_ra.Options())
        duration, _ = copp.interpolation.s_to_t_topp2(s, squares, 0.0)
        durations.append(float(duration))
    return durations


def _toppra_all() -> list[float]:
    """Plan all paths with toppra; return the durations [s]."""
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import (
        DiscretizationType,
        JointAccelerationConstraint,
        JointVelocityConstraint,
    )

    toppra.setup_logging("CRITICAL")
    durations = []
    for x in problems():
        path = toppra.SplineInterpolator(AT, x.points, bc_type="natural")
        acceleration = JointAccelerationConstraint(x.acceleration, DiscretizationType.Interpolation)
        law = TOPPRA(
            [JointVelocityConstraint(x.velocity), acceleration],
            path,
            gridpoints=np.linspace(0.0, 1.0, STATIONS),
            solver_wrapper="seidel",
            parametrizer="ParametrizeConstAccel",
        ).compute_trajectory(0, 0)
        durations.append(float(law.duration))
    return durations


def _against_copp() -> Pair:
    if find_spec("copp_py") is None:
        raise Missing("copp-py is not installed")

    ends = [ac.JointPath.spline(x.points, AT)([0.0, 1.0], 1) for x in problems()]
    slopes = [np.ascontiguousarray(x) / (POINTS - 1) for x in ends]

    def notes() -> list[str]:
        return _durations("copp-py", _copp_all(slopes))

    ours = timed(lambda: plan_all(STATIONS - 1))
    return Pair(ours, timed(lambda: _copp_all(slopes)), notes, parts=(PATHS, PATHS))


def _against_toppra() -> Pair:
    if find_spec("toppra") is None:
        raise Missing("toppra is not installed, which has wheels for linux-x86_64")

    def notes() -> list[str]:
        return _durations("toppra", _toppra_all())

    ours = timed(lambda: plan_all(STATIONS - 1))
    return Pair(ours, timed(_toppra_all), notes, parts=(PATHS, PATHS))


def _durations(peer: str, theirs: list[float]) -> list[str]:
    """State by how much our durations differ from those of a peer."""
    ours = np.array([x.duration for x in plan_all(STATIONS - 1)])
    ratio = ours / np.array(theirs) - 1
    return [f"durations relative to {peer}: {ratio.min():+.1e} to {ratio.max():+.1e}"]


def _default() -> Pair:
    return Pair(timed(plan_all), timed(reference.work), parts=(PATHS, 1))


def _with_jerk() -> Pair:
    return Pair(timed(lambda: plan_all(jerk=True)), timed(reference.work), parts=(PATHS, 1))
