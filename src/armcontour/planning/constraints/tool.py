"""Limits of the tool: assigned velocity, centripetal acceleration, acceleration, and rotation.

A traced joint path follows the tool path within its tolerance, but its derivatives are less exact.
So the motion of the tool at ds = 1 is measured by forward kinematics: bounds of its speed and its
curvature on each piece of the joint path, and vectors at the places of a grid.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.motion import JointPath
from armcontour.planning.constraints.base import Constraint
from armcontour.planning.grid import Grid
from armcontour.planning.topp.limits import Ceiling, Form
from armcontour.planning.topp.on_grid import OnGrid
from armcontour.robot import Arm
from armcontour.robot.limit_use import require_orientation

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
        uneven: Whether the curvature varies along a piece, so that intervals are measured one by
            one.
    """

    joint_path: JointPath
    arm: Arm
    speed: FloatArray
    curvature: FloatArray
    uneven: BoolArray

    @classmethod
    def of(cls, joint_path: JointPath, arm: Arm) -> ToolMetric:
        """Measure the tool motion along a joint path by forward kinematics.

        A bound is the largest sample of a piece plus the spread of its samples.
        """
        breaks, pieces = joint_path.breaks, np.arange(len(joint_path.breaks) - 1)
        s = breaks[:-1] + SAMPLES * (breaks[1:] - breaks[:-1])
        found = _measure(joint_path, arm, np.broadcast_to(pieces, s.shape), s)
        most, least = found.max(axis=1), found.min(axis=1)
        speed, curvature = 2 * most - least
        uneven = (most[1] > FLAT) & (most[1] - least[1] > EVEN * most[1])
        return cls(joint_path=joint_path, arm=arm, speed=speed, curvature=curvature, uneven=uneven)

    def curvature_on(self, grid: Grid) -> FloatArray:
        """Curvatures c at both ends of the intervals, to bound x at both [1/m], (2, n).

        If `c x <= a` holds at both ends of an interval, and x is linear in s, then the curvature
        times x is at most a on all of the interval. Where the curvature k is linear, too, a / k is
        convex: x stays below its tangent, which c at the ends stands for. The tangent touches in
        the middle, or nearer to the end of the larger curvature, so that it is positive.
        """
        chords = self._chords_on(grid)
        touch = np.maximum(chords.mean(axis=0), TOUCH * chords.max(axis=0))
        return np.asarray(touch * touch / np.maximum(2 * touch - chords, 1e-300))

    def _chords_on(self, grid: Grid) -> FloatArray:
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
            values = _measure(self.joint_path, self.arm, pieces, s)[1]
            begin, end = np.maximum(values[0], FLAT), np.maximum(values[-1], FLAT)
            even = begin + SHARES[1:-1] * (end - begin)
            bent = 1 + 2 * np.maximum(values[1:-1] / even - 1, 0.0).max(axis=0)
            found[:, i] = np.stack([begin, end]) * bent
        return found


def _measure(joint_path: JointPath, arm: Arm, pieces: IntArray, s: FloatArray) -> FloatArray:
    """Speed of the tool at ds = 1, and its acceleration at right angles to the motion.

    Args:
        joint_path: The joint path.
        arm: The arm.
        pieces: Pieces of the joint path, of any shape.
        s: Arc lengths [m], of the same shape.

    Returns:
        Of the shape of `s`, after a first axis of 2.
    """
    speed, _, across = _parts(*arm.tool_motion(*joint_path.motion(pieces.ravel(), s.ravel())))
    return np.stack([speed, across]).reshape(2, *s.shape)


def _parts(velocity: FloatArray, acceleration: FloatArray) -> tuple[FloatArray, ...]:
    """Speeds, and accelerations along the motion and at right angles to it, (n,) each."""
    speed = np.sqrt(np.einsum("ij,ij->i", velocity, velocity))
    # Where the tool stands, all of the acceleration counts as across.
    direction = velocity / np.where(speed > 0, speed, 1.0)[:, None]
    along = np.einsum("ij,ij->i", acceleration, direction)
    across = acceleration - along[:, None] * direction
    return speed, along, np.sqrt(np.einsum("ij,ij->i", across, across))


class ToolSpeed(Constraint):
    """`tool speed <= assigned velocity`.

    Args:
        speed: Assigned velocity on each piece of the joint path [m/s], (pieces,).
        metric: Tool motion at ds = 1.
    """

    name = "assigned velocity"

    def __init__(self, speed: FloatArray, metric: ToolMetric) -> None:
        self._ceiling: FloatArray = (speed / metric.speed) ** 2

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The bound of each piece, which holds on the whole interval."""
        found = np.empty((len(path), 2))
        found[:] = self._ceiling[path.grid.piece, None]
        return (Ceiling(found),)


class RapidSpeed(Constraint):
    """`tool speed <= limit` along a joint path without a tool path.

    Args:
        limit: Largest tool speed [m/s].
        arm: The arm.
    """

    name = "rapid speed"

    def __init__(self, limit: float, arm: Arm) -> None:
        self.limit, self._arm = limit, arm

    def on(self, path: OnGrid) -> Iterable[Form]:
        """A bound on each interval: the largest sample plus the spread of the samples."""
        grid = path.grid
        s = grid.s[:-1] + SHARES * grid.width
        pieces = np.broadcast_to(grid.piece, s.shape)
        speed = _measure(grid.joint_path, self._arm, pieces, s)[0]
        bound = 2 * speed.max(axis=0) - speed.min(axis=0)
        with np.errstate(divide="ignore"):
            ceiling = (self.limit / bound) ** 2
        return (Ceiling(np.stack([ceiling, ceiling], axis=1)),)


class CentripetalAcceleration(Constraint):
    """`curvature ds² <= limit`, the paper's bound in corners.

    Args:
        limit: Largest centripetal acceleration [m/s²].
        metric: Tool motion at ds = 1.
    """

    name = "centripetal acceleration"

    def __init__(self, limit: float, metric: ToolMetric) -> None:
        self.limit, self.metric = limit, metric

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The bound at both ends; between them x stays below the chord of both."""
        with np.errstate(divide="ignore"):
            found = self.limit / self.metric.curvature_on(path.grid)
        return (Ceiling(np.ascontiguousarray(found.T)),)


class ToolAcceleration(Constraint):
    """`|p' u + p'' x| <= limit` for the position p of the tool.

    Args:
        limit: Largest length of the acceleration vector [m/s²].
        arm: The arm.
    """

    name = "tool acceleration"
    limit: float

    def __init__(self, limit: float, arm: Arm) -> None:
        self.limit, self._arm = limit, arm

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The vectors, in a frame that turns with the motion: on circles they do not change."""
        speed, along, across = _parts(*self._arm.tool_motion(*path.motion))
        first, second = np.stack([speed, 0 * speed], axis=1), np.stack([along, across], axis=1)
        return (path.round(first, second, self.limit),)


class AngularSpeed(Constraint):
    """`|w|² x <= limit²` for the angular velocity w of the tool at ds = 1.

    Args:
        limit: Largest angular speed of the tool [rad/s].
        arm: The arm.

    Raises:
        InvalidInput: The arm's tool has no orientation.
    """

    name = "angular speed"

    def __init__(self, limit: float, arm: Arm) -> None:
        self.limit, self._tool = limit, require_orientation(arm)

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The square of the angular speed."""
        q, first, _ = path.motion
        w = self._tool.tool_twist(q, first)[:, 3:]
        return (path.square(np.einsum("ij,ij->i", w, w) / self.limit**2),)


class AngularAcceleration(Constraint):
    """`|w u + w' x| <= limit` for the angular velocity w of the tool at ds = 1.

    Args:
        limit: Length of the angular acceleration vector [rad/s²].
        arm: The arm.

    Raises:
        InvalidInput: The arm's tool has no orientation.
    """

    name = "angular acceleration"
    limit: float

    def __init__(self, limit: float, arm: Arm) -> None:
        self.limit, self._tool = limit, require_orientation(arm)

    def on(self, path: OnGrid) -> Iterable[Form]:
        """The vectors."""
        q, first, second = path.motion
        w = self._tool.tool_twist(q, first)[:, 3:]
        rate = self._tool.tool_twist_rate(q, first, second)[:, 3:]
        return (path.round(w, rate, self.limit),)
