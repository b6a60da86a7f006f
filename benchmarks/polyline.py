"""Plan polylines of 10,000 segments from their points, against toppra's solver alone.

The PMK-3s follows a zigzag along a Lissajous curve, with corners of 24° to 169°, and a wavy curve
with corners of about 1°. Our time includes polyline, rounded corners, inverse kinematics, grid,
timing and law, with default settings. toppra gets the rounded path in joint space, the joint limits
and 5 grid points per segment. Only its solver is timed, without path, constraints and law.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from importlib.util import find_spec

import numpy as np

import armcontour as ac
from armcontour.core.checks import FloatArray
from benchmarks.measured import Bar, Line, Missing, Pair, timed

SEGMENTS = 10_000
# Grid points of toppra per segment.
GRID_POINTS = 5
# Points of toppra's spline per line or arc of the rounded path.
SPLINE_POINTS = 4
TOLERANCE = 5e-5
VELOCITY = (2.0, 2.0)
# The margins of the zigzag need three finer grids: five plans, of up to 293,000 intervals, take 0.7
# of its time, and one of them a sixth.
BARS = {("zigzag", "joints"): 1.1, ("zigzag", "tool"): 0.6}


def lines() -> list[Line]:
    """Return the lines for both shapes, with joint limits, and with tool limits too."""
    peer = "toppra, solver alone"
    entries = []
    for shape in ("zigzag", "wavy"):
        for limits, name in (("joints", "joint limits"), ("tool", "tool limits too")):
            title = f"{shape} of {SEGMENTS:,} segments, {name}"
            prepare = partial(_pair, shape, limits == "tool")
            bar = Bar(ratio=BARS.get((shape, limits), 0.5))
            entries.append(Line(f"polyline/{shape}/{limits}", title, peer, prepare, bar))
    return entries


def _pair(shape: str, tool: bool) -> Pair:
    if find_spec("toppra") is None:
        raise Missing("toppra is not installed, which has wheels for linux-x86_64")
    arm = ac.load_arm("pmk3s")
    points = zigzag() if shape == "zigzag" else wavy()
    joints = arm.limits.replace(joint_velocity=VELOCITY)
    solve = toppra_solver(points, arm, joints)
    limits = joints.replace(speed=0.15, centripetal_acceleration=0.09) if tool else joints

    def notes() -> list[str]:
        planned = plan(points, arm, limits)
        theirs = f"{solve():.3f} s on {GRID_POINTS * SEGMENTS + 1:,}"
        ours = f"{planned.duration:.3f} s on {len(planned.breaks):,} grid points"
        return [f"{ours}; toppra, joint limits: {theirs}"]

    return Pair(timed(lambda: plan(points, arm, limits)), timed(solve), notes)


def zigzag() -> FloatArray:
    """Return points [m] to the left and to the right of a Lissajous curve."""
    u = np.linspace(0, 2 * np.pi, SEGMENTS + 1)
    line = np.column_stack([0.4 + 0.1 * np.sin(9 * u), 0.1 + 0.15 * np.sin(8 * u + 0.3)])
    along = np.gradient(line, axis=0)
    across = np.column_stack([-along[:, 1], along[:, 0]])
    across /= np.linalg.norm(across, axis=1)[:, None]
    sideways = 2e-4 * (1 + 0.5 * np.sin(37 * u)) * (-1) ** np.arange(SEGMENTS + 1)
    return np.asarray(line + sideways[:, None] * across)


def wavy() -> FloatArray:
    """Return points [m] on three rounds of a circle whose radius oscillates 60 times."""
    u = np.linspace(0, 2 * np.pi, SEGMENTS + 1)
    radius = 0.06 + 0.004 * np.sin(60 * u)
    return np.column_stack([0.38 + radius * np.cos(3 * u), 0.1 + radius * np.sin(3 * u)])


def plan(points: FloatArray, arm: ac.Arm, limits: ac.Limits) -> ac.Trajectory:
    """Plan everything, from the points to the law."""
    rounded = ac.round_corners(ac.Path.polyline(points), tolerance=TOLERANCE)
    return ac.plan(rounded, arm, limits, ac.Optimal())


def toppra_solver(points: FloatArray, arm: ac.Arm, limits: ac.Limits) -> Callable[[], float]:
    """Return a call that runs toppra's solver and returns the duration [s], or nan."""
    import toppra
    from toppra.algorithm import TOPPRA
    from toppra.constraint import (
        DiscretizationType,
        JointAccelerationConstraint,
        JointVelocityConstraint,
    )

    toppra.setup_logging("CRITICAL")
    rounded = ac.round_corners(ac.Path.polyline(points), tolerance=TOLERANCE)
    share = np.arange(SPLINE_POINTS) / SPLINE_POINTS
    s = rounded.breaks[:-1, None] + share * np.diff(rounded.breaks)[:, None]
    s = np.append(s.ravel(), rounded.length)
    path = toppra.SplineInterpolator(
        s / rounded.length, ac.trace(rounded, arm)(s), bc_type="natural"
    )
    grid = np.linspace(0, 1, GRID_POINTS * SEGMENTS + 1)
    constraints = [
        JointVelocityConstraint(np.column_stack([np.negative(VELOCITY), VELOCITY])),
        JointAccelerationConstraint(
            np.column_stack(limits.acceleration_bounds(arm.dof)), DiscretizationType.Interpolation
        ),
    ]
    solver = TOPPRA(constraints, path, gridpoints=grid, solver_wrapper="seidel")

    def solve() -> float:
        _, speed, _ = solver.compute_parameterization(0, 0)
        if speed is None:
            return float("nan")
        return float((2 * np.diff(grid) / (speed[1:] + speed[:-1])).sum())

    return solve
