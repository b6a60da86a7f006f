"""Limits of the tool: assigned velocity, centripetal acceleration, acceleration.

A traced joint path follows the tool path within its tolerance, but its derivatives are less exact.
So the motion of the tool at ds = 1 is measured by forward kinematics at several samples of every
piece of the joint path: speed, curvature, and acceleration along the motion. The spread of the
samples is the margin.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.motion import JointPath
from armcontour.timing.constraints._rows import ROUNDING
from armcontour.timing.constraints.base import (
    Bounds,
    Ceiling,
    Constraint,
    Disc,
    JointDerivatives,
)
from armcontour.timing.grid import Grid

# Samples of the tool motion per piece of the joint path.
PLACES = 9


@dataclass(frozen=True, slots=True)
class ToolMetric:
    """Tool motion at ds = 1 on each piece of the joint path: upper bounds, (pieces,).

    Args:
        speed: Tool speed [-].
        curvature: Acceleration at right angles to the motion [1/m].
        stretch: Acceleration along the motion [1/m].
    """

    speed: FloatArray
    curvature: FloatArray
    stretch: FloatArray

    @classmethod
    def of(cls, joint_path: JointPath, arm: Arm) -> ToolMetric:
        """Measure the tool motion along a joint path by forward kinematics."""
        pieces = len(joint_path.breaks) - 1
        share = np.linspace(0, 1, PLACES)[:, None]
        s = joint_path.breaks[:-1] + share * np.diff(joint_path.breaks)
        i = np.broadcast_to(np.arange(pieces), s.shape).ravel()
        velocity, acceleration = arm.tool_motion(*joint_path.motion(i, s.ravel()))
        speed = np.linalg.norm(velocity, axis=1)
        direction = velocity / speed[:, None]
        along = np.sum(acceleration * direction, axis=1)
        across = np.linalg.norm(acceleration - along[:, None] * direction, axis=1)
        return cls(*(_bound(x.reshape(s.shape)) for x in (speed, across, np.abs(along))))


def _bound(values: FloatArray) -> FloatArray:
    """Largest sample of each piece plus the spread of its samples, as a margin between them."""
    return np.asarray(2 * values.max(axis=0) - values.min(axis=0))


class ToolSpeed(Constraint):
    """`tool speed <= assigned velocity`.

    Args:
        speed: Assigned velocity on each piece of the joint path [m/s], (pieces,).
        metric: Tool motion at ds = 1.
    """

    name = "assigned velocity"
    limit_name = "speed"

    def __init__(self, speed: FloatArray, metric: ToolMetric) -> None:
        self.assigned = speed
        self._ceiling: FloatArray = (speed / metric.speed) ** 2

    def ceiling(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Ceiling:
        """The bound of each piece, which holds on the whole interval."""
        return Ceiling(np.broadcast_to(self._ceiling[grid.piece], (2, len(grid))))

    def allowed(self, grid: Grid) -> FloatArray:
        """Assigned velocity of every interval [m/s], (n, 1)."""
        return np.asarray(self.assigned[grid.piece][:, None])


class CentripetalAcceleration(Constraint):
    """`curvature ds² <= limit`, the paper's bound in corners.

    Args:
        limit: Largest centripetal acceleration [m/s²].
        metric: Tool motion at ds = 1.
    """

    name = "centripetal acceleration"
    limit_name = "centripetal_acceleration"

    def __init__(self, limit: float, metric: ToolMetric) -> None:
        self.limit, self.metric = limit, metric

    def ceiling(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Ceiling:
        """The bound of each piece, which holds on the whole interval."""
        with np.errstate(divide="ignore"):
            ceiling = self.limit / self.metric.curvature
        return Ceiling(np.broadcast_to(ceiling[grid.piece], (2, len(grid))))


class ToolAcceleration(Constraint):
    """`(curvature ds²)² + dds² <= limit²`.

    Args:
        limit: Largest length of the acceleration vector [m/s²].
        metric: Tool motion at ds = 1.
    """

    name = "tool acceleration"
    limit_name = "tool_acceleration"

    def __init__(self, limit: float, metric: ToolMetric) -> None:
        self.limit, self.metric = limit, metric

    def disc(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Disc:
        """The disc, less the margin for skew.

        Without skew the left side is convex along an interval, so it is largest at an end. With
        skew its second derivative is at least `-4 curvature² x |skew|`.
        """
        speed = self.metric.speed[grid.piece]
        curvature = self.metric.curvature[grid.piece] / speed
        radius = np.full(len(grid), self.limit) / speed
        if bounds is not None:
            play = self.metric.stretch[grid.piece] / speed + ROUNDING / grid.width
            radius = np.maximum(radius - play * bounds.x, 0.0)
            rise = grid.width**2 / 2 * curvature**2 * bounds.x * np.abs(bounds.skew)
            radius = np.sqrt(np.maximum(radius**2 - rise, 0.0))
        return Disc(np.broadcast_to(curvature, (2, len(grid))), radius)

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval: the radius of the disc."""
        return self.disc(grid, path, None).r
