"""Limits of the tool: assigned velocity, centripetal acceleration, acceleration.

A traced joint path follows the tool path within its tolerance, but its derivatives are less exact.
So the motion of the tool at ds = 1 is measured by forward kinematics at several samples of every
piece of the joint path: speed, curvature, and acceleration along the motion. The spread of the
samples is the margin.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray, for_kernel
from armcontour.arms import Arm
from armcontour.motion import JointPath
from armcontour.timing.constraints._tool import (
    bound_on_pieces,
    measure,
    shrink_discs,
    touch_chords,
)
from armcontour.timing.constraints.base import (
    Bounds,
    Ceiling,
    Constraint,
    Disc,
    JointDerivatives,
)
from armcontour.timing.grid import Grid

# Shares of a piece of the joint path at which the tool motion is sampled.
SAMPLES = np.linspace(0.0, 1.0, 9)[:, None]
# Samples of an interval whose curvature varies.
SHARES = np.linspace(0.0, 1.0, 5)[:, None]
# A piece is even if its curvature varies by less than this share.
EVEN = 1e-3
# A tangent of the bound of x touches it where the curvature is at least this share of its largest.
TOUCH = 0.8
# Curvatures below this are those of lines [1/m].
FLAT = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolMetric:
    """Tool motion at ds = 1 along a joint path: upper bounds on each piece, (pieces,).

    Args:
        joint_path: The joint path.
        arm: The arm.
        speed: Tool speed [-].
        curvature: Acceleration at right angles to the motion [1/m].
        stretch: Acceleration along the motion [1/m].
        uneven: Whether the curvature varies along a piece, so that intervals are measured one by
            one.
    """

    joint_path: JointPath
    arm: Arm
    speed: FloatArray
    curvature: FloatArray
    stretch: FloatArray
    uneven: BoolArray

    @classmethod
    def of(cls, joint_path: JointPath, arm: Arm) -> ToolMetric:
        """Measure the tool motion along a joint path by forward kinematics."""
        breaks, pieces = joint_path.breaks, np.arange(len(joint_path.breaks) - 1)
        s = breaks[:-1] + SAMPLES * (breaks[1:] - breaks[:-1])
        motion = _motion(joint_path, arm, np.broadcast_to(pieces, s.shape), s)
        bounds, uneven = bound_on_pieces(*motion, FLAT, EVEN)
        speed, curvature, stretch = bounds
        return cls(
            joint_path=joint_path,
            arm=arm,
            speed=speed,
            curvature=curvature,
            stretch=stretch,
            uneven=uneven,
        )

    def curvature_on(self, grid: Grid) -> FloatArray:
        """Curvatures c at both ends of the intervals, to bound x at both [1/m], (2, n).

        If `c x <= a` holds at both ends of an interval, and x is linear in s, then the curvature
        times x is at most a on all of the interval. Where the curvature k is linear, too, a / k is
        convex: x stays below its tangent, which c at the ends stands for. The tangent touches in
        the middle, or nearer to the end of the larger curvature, so that it is positive.
        """
        return np.asarray(touch_chords(self.chords_on(grid), TOUCH))

    def chords_on(self, grid: Grid) -> FloatArray:
        """Curvatures at both ends of the intervals, whose chord is above the curvature, (2, n).

        Where the curvature varies, a factor bounds how far it is above its chord: twice what the
        samples in between show.
        """
        found = np.empty((2, len(grid)))
        found[:] = self.curvature[grid.piece]
        i = np.flatnonzero(self.uneven[grid.piece])
        if len(i):
            s = grid.s[i] + SHARES * grid.width[i]
            pieces = np.broadcast_to(grid.piece[i], s.shape)
            velocity, acceleration = _motion(self.joint_path, self.arm, pieces, s)
            rows = s.size, -1
            measured = measure(velocity.reshape(rows), acceleration.reshape(rows))
            values = measured[1].reshape(s.shape)
            begin, end = np.maximum(values[0], FLAT), np.maximum(values[-1], FLAT)
            even = begin + SHARES[1:-1] * (end - begin)
            bent = 1 + 2 * np.maximum(values[1:-1] / even - 1, 0.0).max(axis=0)
            found[:, i] = np.stack([begin, end]) * bent
        return found


def _motion(
    joint_path: JointPath, arm: Arm, pieces: IntArray, s: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Velocity and acceleration of the tool at ds = 1, at arc lengths on pieces of a joint path.

    Both are of the shape of `s` and a last axis.
    """
    motion = arm.tool_motion(*joint_path.motion(pieces.ravel(), s.ravel()))
    # Arms of users may give arrays of any kind.
    velocity, acceleration = (for_kernel(x).reshape(*s.shape, -1) for x in motion)
    return velocity, acceleration


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
        return Ceiling(self.fixed_ceiling(grid))

    def fixed_ceiling(self, grid: Grid) -> FloatArray:
        """The ceiling, (2, n), which depends on the place only."""
        found = np.empty((2, len(grid)))
        found[:] = self._ceiling[grid.piece]
        return found

    @property
    def on_pieces(self) -> FloatArray:
        """The ceiling on each piece of the joint path, (pieces,)."""
        return self._ceiling

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
        """The bound at both ends; between them x stays below the chord of both."""
        return Ceiling(self.fixed_ceiling(grid))

    def fixed_ceiling(self, grid: Grid) -> FloatArray:
        """The ceiling, (2, n), which depends on the place only."""
        with np.errstate(divide="ignore"):
            return np.asarray(self.limit / self.metric.curvature_on(grid))

    @property
    def on_pieces(self) -> FloatArray | None:
        """The ceiling on each piece of the joint path, (pieces,); None if it varies along one."""
        if self.metric.uneven.any():
            return None
        both = np.array([self.metric.curvature, self.metric.curvature])
        with np.errstate(divide="ignore"):
            return np.asarray(self.limit / touch_chords(both, TOUCH)[0])


class Discs(NamedTuple):
    """Discs on the intervals of a grid without margins, and what their margins follow from.

    Args:
        curvature: Curvatures at the starts and ends over the tool speed [1/m], (2, n).
        radius: Radii [m/s²], (n,).
        stretch: Acceleration along the motion over the tool speed [1/m], (n,).
        uneven: Whether the curvature varies, (n,).
    """

    curvature: FloatArray
    radius: FloatArray
    stretch: FloatArray
    uneven: BoolArray


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
        """The disc, less the margin for what happens between the ends."""
        discs = self.on(grid)
        if bounds is None:
            return Disc(discs.curvature, discs.radius)
        found = np.empty(len(grid))
        shrink_discs(grid.width, *discs, bounds.x, bounds.u, bounds.skew, found)
        return Disc(discs.curvature, found)

    def on(self, grid: Grid) -> Discs:
        """The discs on a grid, without margins."""
        metric, speed = self.metric, self.metric.speed[grid.piece]
        return Discs(
            curvature=metric.curvature_on(grid) / speed,
            radius=np.full(len(grid), self.limit) / speed,
            stretch=metric.stretch[grid.piece] / speed,
            uneven=metric.uneven[grid.piece],
        )

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval: the radius of the disc."""
        return self.disc(grid, path, None).r
