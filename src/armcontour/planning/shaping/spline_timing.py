"""Fastest timing of a joint spline, or of a part of it, for the comparison of shapes.

The planner times the spline itself: a parameter of the spline takes the place of the arc length.
Neither a tool path nor its tracing is needed, and a part of the spline is timed without the rest.
"""

from __future__ import annotations

import math
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.motion import JointPath
from armcontour.planning.constraints import FROM_LIMITS, Constraint, ToolPace, measure_tool
from armcontour.planning.optimal_timing import time_optimal
from armcontour.planning.path_grid import Grid, divide_intervals
from armcontour.planning.shaping.spline_rows import JointSpline
from armcontour.planning.topp.limit_forms import Ceiling, Form
from armcontour.planning.topp.sampled_joint_path import SampledJointPath
from armcontour.robot import Arm, Limits

# Number of grid intervals in each span of a spline.
INTERVALS_OF_SPAN = 2
# Share of the largest possible rate that a plan has at the ends of a part, for rounding errors.
RATE_SHARE = 1 - 1e-6
# Smallest share of the required rate that a plan may have at an end of a part. At the end of a
# grid, the planner reaches slightly less than inside a longer grid.
LEAST_RATE_SHARE = 0.99


@dataclass(frozen=True, slots=True)
class SplineTiming:
    """Fastest motion along the n spans of a spline."""

    times: FloatArray  # Time that each span takes [s], (n,)
    # Derivative of the spline's parameter with respect to time at the knots, (n + 1,)
    rates: FloatArray


def time_spline(
    spline: JointSpline, arm: Arm, limits: Limits, speeds: FloatArray, rates: tuple[float, float]
) -> SplineTiming:
    """Plan the fastest motion along a spline.

    - `limits`: the limits, one value per joint.
    - `speeds`: assigned velocity in each span [m/s], infinite if none, (n,).
    - `rates`: derivatives of the spline's parameter with respect to time at its start and its end,
      where the spline is part of a longer one; not used at rests.

    Raises:
        NotRealizable: No motion satisfies the limits, or not with these rates at the ends.
    """
    joint_path = _joint_path(spline)
    breaks = joint_path.breaks
    count = np.full(len(spline.h), INTERVALS_OF_SPAN, dtype=np.intp)
    points, span = divide_intervals(breaks, count, breaks[:-1])
    grid = Grid(joint_path=joint_path, s=points, piece=span)
    constraints = _constraints(joint_path, arm, limits, speeds)
    required = np.where(spline.rest[[0, -1]], 0.0, rates)
    start, end = (RATE_SHARE * required).tolist()
    try:
        law = time_optimal(grid, constraints, arm, start, end, math.inf)
    except NotRealizable as error:
        start = _reachable_rate(error, "start speed", start)
        end = _reachable_rate(error, "end speed", end)
        law = time_optimal(grid, constraints, arm, start, end, math.inf)
    # All knots are grid points.
    index = np.searchsorted(law.s, joint_path.breaks)
    rates_at_knots = np.where(spline.rest, 0.0, law.speeds[index])
    return SplineTiming(np.diff(law.breaks[index]), rates_at_knots)


def _reachable_rate(error: NotRealizable, name: str, rate: float) -> float:
    """Return the rate at an end of a part that the planner reaches, if it is close to `rate`.

    - `name`: name of the limit in the error for a rate at this end that is too high.
    """
    if error.limit not in ("start speed", "end speed"):
        raise error
    if error.limit != name:
        return rate
    if error.allowed is None or error.allowed < LEAST_RATE_SHARE * rate:
        raise error
    return RATE_SHARE * error.allowed


def _constraints(
    joint_path: JointPath, arm: Arm, limits: Limits, speeds: FloatArray
) -> list[Constraint]:
    """Make the constraints of the planner, with the assigned velocity of each span [m/s], (n,)."""
    made = [
        kind.from_limits(joint_path, arm, limits) for kind in FROM_LIMITS if kind is not ToolPace
    ]
    if np.isfinite(speeds).any() or limits.centripetal_acceleration is not None:
        made.append(_PaceAtEnds(arm, speeds, limits.centripetal_acceleration))
    return [x for x in made if x is not None]


class _PaceAtEnds(Constraint):
    """Limits of the speed and the centripetal acceleration of the tool at the ends of intervals.

    Between the ends they may be exceeded slightly, as in the quadratic program. The exact timing of
    the path has bounds that hold everywhere.
    """

    brakes = False

    def __init__(self, arm: Arm, speeds: FloatArray, centripetal: float | None) -> None:
        # `speeds`: assigned velocity in each span [m/s], infinite if none, (spans,); `centripetal`:
        # largest centripetal acceleration [m/s²].
        self._arm = arm
        self._speeds = speeds
        self._centripetal = centripetal

    def discretize(self, path: SampledJointPath) -> Iterable[Form]:
        """Yield upper bounds of the squared rate at interval ends."""
        grid = path.grid
        s = np.stack([grid.s[:-1], grid.s[1:]])
        pieces = np.broadcast_to(grid.piece, s.shape)
        speed, curvature = measure_tool(grid.joint_path, self._arm, pieces, s)
        with np.errstate(divide="ignore"):
            ceiling = (self._speeds[grid.piece] / speed) ** 2
            if self._centripetal is not None:
                ceiling = np.minimum(ceiling, self._centripetal / curvature)
        yield Ceiling(np.ascontiguousarray(ceiling.T))


def _joint_path(spline: JointSpline) -> JointPath:
    """Return the spline as a joint path over its parameter.

    In span i, the parameter runs from 0 to h_i, and

        q = knot_i + e_i p + (e_{i+1} - e_i) p² / (2 h_i).

    A span next to a rest is straight in joint space. Its parameter runs from 0 to h_i / 2, and q is
    linear, so that the derivative is that of the neighbouring span and does not vanish at the rest.
    """
    e = spline.velocities
    knots = spline.knots
    at_rest = spline.rest[1:] | spline.rest[:-1]
    width = np.where(at_rest, spline.h / 2, spline.h)[:, None]
    coefficients = np.zeros((len(spline.h), 6, knots.shape[1]))
    coefficients[:, 0] = knots[:-1]
    coefficients[:, 1] = np.where(at_rest[:, None], np.diff(knots, axis=0), e[:-1] * width)
    coefficients[:, 2] = np.where(at_rest[:, None], 0.0, np.diff(e, axis=0) * width / 2)
    breaks = np.append(0.0, np.cumsum(width))
    return JointPath(
        breaks=breaks, coefficients=coefficients, stops=breaks[1:-1][spline.rest[1:-1]]
    )
