"""Constraints of the tool: assigned velocity, centripetal acceleration, acceleration, rotation.

A traced joint path follows the tool path within its tolerance, but its derivatives are less exact.
Therefore the motion of the tool at ds = 1 is measured by forward kinematics: bounds of its speed
and its curvature on each piece of the joint path, and vectors at the samples of a grid.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.motion import JointPath
from armcontour.planning.constraints.constraint import Constraint
from armcontour.planning.path_grid import Grid
from armcontour.planning.topp.limit_forms import Ceiling, Form
from armcontour.planning.topp.on_grid import OnGrid
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import require_orientation
from armcontour.robot.limits import TOOL_LIMITS

# Positions of the samples on a piece of the joint path, as shares of its length, (9, 1)
PIECE_SAMPLES = np.linspace(0.0, 1.0, 9)[:, None]
# Positions of the samples on an interval, as shares of its length, (5, 1)
INTERVAL_SAMPLES = np.linspace(0.0, 1.0, 5)[:, None]
# The curvature of a piece is constant if it varies by at most this share.
EVEN_CURVATURE = 1e-3
# The bound of x on an interval is a tangent of `limit / curvature`. The curvature at its point of
# contact is at least this fraction of the larger of the curvatures at both ends.
TOUCH = 0.8
# A piece with at most this curvature is a straight line [1/m].
STRAIGHT = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolMetric:
    """Tool motion at ds = 1 along a joint path: upper bounds on each piece, (pieces,)."""

    joint_path: JointPath
    arm: Arm
    speed: FloatArray  # Tool speed [-]
    curvature: FloatArray  # Tool acceleration normal to the motion [1/m]
    # True for pieces along which the curvature varies; their intervals are sampled
    uneven: BoolArray

    @classmethod
    def measure(cls, joint_path: JointPath, arm: Arm) -> ToolMetric:
        """Measure the tool motion along a joint path by forward kinematics."""
        # A bound is the largest sample of a piece plus the spread of its samples.
        breaks, pieces = joint_path.breaks, np.arange(len(joint_path.breaks) - 1)
        s = breaks[:-1] + PIECE_SAMPLES * (breaks[1:] - breaks[:-1])
        samples = _measure(joint_path, arm, np.broadcast_to(pieces, s.shape), s)
        largest, smallest = samples.max(axis=1), samples.min(axis=1)
        speed, curvature = 2 * largest - smallest
        uneven = (largest[1] > STRAIGHT) & (largest[1] - smallest[1] > EVEN_CURVATURE * largest[1])
        return cls(joint_path=joint_path, arm=arm, speed=speed, curvature=curvature, uneven=uneven)

    def curvature_on(self, grid: Grid) -> FloatArray:
        """Curvatures c at interval ends [1/m], (2, n), such that `c ds² <= limit` is sufficient."""
        # x is linear in s. If the curvature k is linear too, a / k is convex for a limit a, so a
        # tangent of a / k is a lower bound of a / k. This tangent has the values a / c at the ends,
        # so `c x <= a` at both ends implies `k x <= a` on the whole interval. The tangent touches
        # in the middle, or closer to the end with the larger curvature, so that both values are
        # positive.
        chords = self._chords_on(grid)
        touch = np.maximum(chords.mean(axis=0), TOUCH * chords.max(axis=0))
        return np.asarray(touch * touch / np.maximum(2 * touch - chords, 1e-300))

    def _chords_on(self, grid: Grid) -> FloatArray:
        """Curvatures at interval ends [1/m], (2, n); the chord between them is an upper bound."""
        # If the curvature varies, the values at both ends are multiplied by 1 plus twice the
        # largest relative excess of the samples inside over the chord of these values.
        chords = np.empty((2, len(grid)))
        chords[:] = self.curvature[grid.piece]
        i = np.flatnonzero(self.uneven[grid.piece])
        if len(i):
            s = grid.s[i] + INTERVAL_SAMPLES * grid.width[i]
            pieces = np.broadcast_to(grid.piece[i], s.shape)
            values = _measure(self.joint_path, self.arm, pieces, s)[1]
            begin, end = np.maximum(values[0], STRAIGHT), np.maximum(values[-1], STRAIGHT)
            even = begin + INTERVAL_SAMPLES[1:-1] * (end - begin)
            bent = 1 + 2 * np.maximum(values[1:-1] / even - 1, 0.0).max(axis=0)
            chords[:, i] = np.stack([begin, end]) * bent
        return chords


def _measure(joint_path: JointPath, arm: Arm, pieces: IntArray, s: FloatArray) -> FloatArray:
    """Tool speed at ds = 1, and tool acceleration normal to the motion, (2, *s.shape)."""
    speed, _, across = _speed_and_acceleration(
        *arm.tool_motion(*joint_path.motion(pieces.ravel(), s.ravel()))
    )
    return np.stack([speed, across]).reshape(2, *s.shape)


def _speed_and_acceleration(
    velocity: FloatArray, acceleration: FloatArray
) -> tuple[FloatArray, ...]:
    """Speeds, and accelerations along and normal to the motion, (n,) each."""
    speed = np.sqrt(np.einsum("ij,ij->i", velocity, velocity))
    # If the tool rests, the whole acceleration counts as normal.
    direction = velocity / np.where(speed > 0, speed, 1.0)[:, None]
    along = np.einsum("ij,ij->i", acceleration, direction)
    across = acceleration - along[:, None] * direction
    return speed, along, np.sqrt(np.einsum("ij,ij->i", across, across))


def _refuse_tool_limits(limits: Limits) -> None:
    tool = [x for x in TOOL_LIMITS if getattr(limits, x) is not None]
    if tool:
        raise InvalidInput(
            "Limits of the tool need a tool path, but this joint path has none. Plan a Path or a "
            "traced joint path, or remove the limits with "
            f"limits.replace({', '.join(f'{x}=math.inf' for x in tool)})."
        )


def assigned_speeds(joint_path: JointPath, limits: Limits) -> FloatArray:
    """Assigned velocity on each piece of a joint path [m/s], infinite if none, (pieces,)."""
    path, breaks = joint_path.tool_path, joint_path.breaks
    if path is None:
        _refuse_tool_limits(limits)
        return np.full(len(breaks) - 1, np.inf)
    if len(path) == 1:
        return np.repeat(path.assigned_speeds(limits.speed), len(breaks) - 1)
    return path.assigned_speeds(limits.speed, (breaks[:-1] + breaks[1:]) / 2)


class ToolPace(Constraint):
    """Limits of ds²: `tool speed <= assigned velocity`, and `curvature ds² <= limit`.

    The second limit is that of the centripetal acceleration, which the paper uses in corners.
    """

    serves = ("speed", "centripetal_acceleration")

    def __init__(
        self, metric: ToolMetric, speed: FloatArray | None, centripetal: float | None
    ) -> None:
        # `metric`: tool motion at ds = 1; `speed`: assigned velocity on each piece of the joint
        # path [m/s], (pieces,); `centripetal`: largest centripetal acceleration [m/s²].
        self._metric, self._centripetal = metric, centripetal
        self._ceiling = None if speed is None else (speed / metric.speed) ** 2

    @classmethod
    def of(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> ToolPace | None:
        """Make the constraint of assigned velocities and centripetal acceleration, if any."""
        if joint_path.tool_path is None:
            _refuse_tool_limits(limits)
            return None
        speed, centripetal = assigned_speeds(joint_path, limits), limits.centripetal_acceleration
        assigned = speed if np.isfinite(speed).any() else None
        if assigned is None and centripetal is None:
            return None
        return cls(ToolMetric.measure(joint_path, arm), assigned, centripetal)

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Upper bounds of ds² at both interval ends; ds² stays below the chord between them."""
        if self._ceiling is not None:
            ceiling = np.empty((len(path), 2))
            ceiling[:] = self._ceiling[path.grid.piece, None]
            yield Ceiling(ceiling)
        if self._centripetal is not None:
            with np.errstate(divide="ignore"):
                curved = self._centripetal / self._metric.curvature_on(path.grid)
            yield Ceiling(np.ascontiguousarray(curved.T))


class ToolConstraint(Constraint):
    """Base of constraints with one limit of the tool, which is a number."""

    brakes = True
    limit: float

    def __init__(self, limit: float, arm: Arm) -> None:
        self.limit, self.arm = limit, arm

    @classmethod
    def of(cls, joint_path: JointPath, arm: Arm, limits: Limits) -> Constraint | None:
        """Make the constraint of the limit; None without a limit."""
        limit = getattr(limits, cls.serves[0])
        return None if limit is None else cls(limit, arm)


class RapidSpeed(ToolConstraint):
    """Limit `tool speed <= limit` [m/s] along a joint path without a tool path."""

    name = "rapid speed"

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Upper bound of ds² on each interval, from samples of the tool speed."""
        # The speed is at most the largest sample plus the spread of the samples.
        grid = path.grid
        s = grid.s[:-1] + INTERVAL_SAMPLES * grid.width
        pieces = np.broadcast_to(grid.piece, s.shape)
        speed = _measure(grid.joint_path, self.arm, pieces, s)[0]
        bound = 2 * speed.max(axis=0) - speed.min(axis=0)
        with np.errstate(divide="ignore"):
            ceiling = (self.limit / bound) ** 2
        return (Ceiling(np.stack([ceiling, ceiling], axis=1)),)


class ToolAcceleration(ToolConstraint):
    """Limit `|p' dds + p'' ds²| <= limit` of the acceleration of the tool position p [m/s²]."""

    serves = ("tool_acceleration",)

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Vectors in a frame that turns with the motion, in which they are constant on circles."""
        speed, along, across = _speed_and_acceleration(*self.arm.tool_motion(*path.motion))
        first, second = np.stack([speed, 0 * speed], axis=1), np.stack([along, across], axis=1)
        return (path.round(first, second, self.limit),)


class AngularSpeed(ToolConstraint):
    """Limit `|w|² ds² <= limit²`, where w is the angular velocity of the tool at ds = 1 [rad/m]."""

    serves = ("angular_speed",)
    brakes = False

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Square of the angular speed at ds = 1, divided by the square of the limit."""
        q, first, _ = path.motion
        w = require_orientation(self.arm).tool_twist(q, first)[:, 3:]
        return (path.square(np.einsum("ij,ij->i", w, w) / self.limit**2),)


class AngularAcceleration(ToolConstraint):
    """Limit `|w dds + w' ds²| <= limit`, where w is the angular velocity of the tool at ds = 1."""

    serves = ("angular_acceleration",)

    def discretize(self, path: OnGrid) -> Iterable[Form]:
        """Angular velocity at ds = 1 and its derivative in s, as vectors."""
        (q, first, second), tool = path.motion, require_orientation(self.arm)
        w = tool.tool_twist(q, first)[:, 3:]
        rate = tool.tool_twist_rate(q, first, second)[:, 3:]
        return (path.round(w, rate, self.limit),)
