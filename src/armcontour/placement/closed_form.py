"""Arms whose joint positions are known in closed form, and what poses are beyond their reach."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, lock_floats
from armcontour.arms import SerialArm
from armcontour.placement import _closed_form

# Axes meet or are parallel within this [m, rad].
EXACT = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ClosedForm:
    """The axes of an arm of six joints whose joints 2 and 3 are parallel.

    Args:
        table: Its axes, points on them and its end, as `_closed_form` has them, (ROWS, 3).
        wrist: Whether the axes 4, 5 and 6 meet; else joint 4 is parallel to 2 and 3, and 5 and 6
            meet.
    """

    table: FloatArray
    wrist: bool

    @classmethod
    def of(cls, arm: SerialArm) -> ClosedForm | None:
        """The axes of an arm; None for an arm of another kind."""
        if arm.dof != 6:
            return None
        points, axes, end = _lines(arm)
        center = _meeting(points[4:6], axes[4:6])
        if center is None or not _parallel(axes[1], axes[2]):
            return None
        fourth = _meeting(points[3:5], axes[3:5])
        wrist = fourth is not None and bool(np.abs(fourth - center).max() < EXACT)
        if not wrist and not _parallel(axes[1], axes[3]):
            return None
        table = np.vstack([axes, points, center, end[:, :3].T, end[:, 3]])
        return cls(table=lock_floats(table), wrist=wrist)

    def solve(self, base: FloatArray, pose: FloatArray) -> FloatArray | None:
        """All joint positions that put the tool in a pose [rad], (k, 6); None near singularities.

        Args:
            base: Rotation and position of the base in the work frame, (3, 4).
            pose: Those of the tool, (3, 4).
        """
        q = np.empty((_closed_form.MOST, 6))
        count = _closed_form.solve_pose(self.table, self.wrist, base, pose, q)
        return None if count < 0 else np.pi - np.mod(np.pi - q[:count], 2 * np.pi)

    def beyond(self, bases: FloatArray, poses: FloatArray, enough: float) -> FloatArray:
        """How far poses are out of reach of the arm in several places [m], (n,).

        Args:
            bases: Rotations and positions of the base in the work frame, (n, 3, 4).
            poses: Those of the tool, (m, 3, 4).
            enough: Poses are looked at up to one that is farther out of reach [m].
        """
        return _closed_form.gaps_beyond(self.table, self.wrist, bases, poses, enough)


def _lines(arm: SerialArm) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Points on the axes and their directions with all joints at 0, and the end, (3, 4)."""
    rotations, positions, own, _, end = arm.arrays
    turned, point = np.eye(3), np.zeros(3)
    points, axes = [], []
    for rotation, position, axis in zip(rotations, positions, own, strict=True):
        point = point + turned @ position
        turned = turned @ rotation
        points.append(point)
        axes.append(turned @ axis)
    last = np.column_stack([turned @ end[:, :3], point + turned @ end[:, 3]])
    return np.array(points), np.array(axes), last


def _parallel(first: FloatArray, second: FloatArray) -> bool:
    """Whether two directions are parallel."""
    return float(np.linalg.norm(np.cross(first, second))) < EXACT


def _meeting(points: FloatArray, axes: FloatArray) -> FloatArray | None:
    """The point at which two lines meet [m], (3,); None if they do not, or are parallel."""
    across = np.cross(axes[0], axes[1])
    size = float(across @ across)
    gap = points[1] - points[0]
    if size < EXACT or abs(float(gap @ across)) > EXACT * np.sqrt(size):
        return None
    along = float(np.cross(gap, axes[1]) @ across) / size
    return np.asarray(points[0] + along * axes[0])
