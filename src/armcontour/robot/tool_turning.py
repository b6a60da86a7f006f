"""Rotations that the tool of an arm can have if all revolute joints are parallel, or all slide."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.frames import angle_between, exp

# Joint axes count as parallel if the sine of their angle is below this, and the tool axis as
# parallel to them. Angles in robot descriptions are rounded, for example 3.1416 or 1.5708.
PARALLEL = 1e-4
# Largest angle between an orientation and the nearest one that the tool can have at which the
# orientation counts as reached [rad].
REACHED_ANGLE = np.radians(0.1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ToolTurning:
    """The rotations `exp(angle axis) rotation` of a tool that turns about one direction only.

    Vectors and rotations are in the work frame.

    Args:
        axis: Direction of the revolute joints, a unit vector, (3,); zero if no joint turns the
            tool.
        rotation: Rotation of the tool with the joints at 0, (3, 3).
    """

    axis: FloatArray
    rotation: FloatArray

    @classmethod
    def about(cls, directions: FloatArray, rotation: FloatArray) -> ToolTurning | None:
        """Return the rotations of a tool; None if it turns about several directions.

        Args:
            directions: Angular velocity of the tool per joint velocity, (dof, 3).
            rotation: Rotation of the tool with the joints at 0, (3, 3).
        """
        # Parallel axes stay parallel at all joint positions.
        turning = directions[np.linalg.norm(directions, axis=1) > PARALLEL]
        axis = turning[0] / np.linalg.norm(turning[0]) if len(turning) else np.zeros(3)
        if (np.linalg.norm(np.cross(turning, axis), axis=1) > PARALLEL).any():
            return None
        return cls(axis=axis, rotation=rotation)

    @property
    def turns(self) -> bool:
        """True if a joint turns the tool."""
        return bool(self.axis.any())

    @property
    def keeps_axis(self) -> bool:
        """True if the tool axis has the same direction at all joint positions."""
        return bool(np.linalg.norm(np.cross(self.axis, self.rotation[:, 2])) < PARALLEL)

    def angles(self, rotations: FloatArray, *, axis_only: bool) -> FloatArray:
        """Return angles about the axis at which the tool is nearest to rotations [rad], (n,).

        Args:
            rotations: Required rotations of the tool, (n, 3, 3).
            axis_only: Only the tool axes, the third columns, are compared.
        """
        sine, cosine = self.components(rotations, axis_only=axis_only)
        return np.arctan2(sine, cosine)

    def components(self, vectors: FloatArray, *, axis_only: bool) -> tuple[FloatArray, FloatArray]:
        """Return two numbers whose direction is the angle of `angles`, (n,) each.

        With the columns c of the required rotation, and the columns b of the tool's rotation with
        the joints at 0, they are the sums of `axis . (b x c)` and of `b . c - (axis . b)
        (axis . c)`. Both are linear in c, so they also give the derivatives.

        Args:
            vectors: Required rotations or their derivatives, (n, 3, 3).
            axis_only: Only the third columns are summed.
        """
        columns = slice(2, 3) if axis_only else slice(0, 3)
        base = self.rotation[:, columns]
        along = self.axis @ base
        across = np.cross(self.axis, base, axisb=0, axisc=0)
        chosen = vectors[:, :, columns]
        sine = np.einsum("ik,nik->n", across, chosen)
        cosine = np.einsum("ik,nik->n", base - np.outer(self.axis, along), chosen)
        return sine, cosine

    def nearest(self, rotations: FloatArray, *, axis_only: bool) -> FloatArray:
        """Return the tool rotations nearest to required ones, (n, 3, 3), as in `angles`.

        Args:
            rotations: Required rotations of the tool, (n, 3, 3).
            axis_only: Only the tool axes, the third columns, are compared.
        """
        angles = self.angles(rotations, axis_only=axis_only)
        return np.asarray(exp(angles[:, None] * self.axis) @ self.rotation)

    def missed(self, rotations: FloatArray, *, axis_only: bool) -> FloatArray:
        """Return the angles between required rotations and the nearest ones [rad], (n,).

        Args:
            rotations: Required rotations of the tool, (n, 3, 3).
            axis_only: Only the tool axes, the third columns, are compared.
        """
        nearest = self.nearest(rotations, axis_only=axis_only)
        if axis_only:
            return angle_between(rotations[:, :, 2], nearest[:, :, 2])
        size = np.linalg.norm(rotations - nearest, axis=(1, 2)) / np.sqrt(8)
        return np.asarray(2 * np.arcsin(np.minimum(size, 1.0)))
