"""Tool errors that a servo model does not explain, along and across the path."""

from __future__ import annotations

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.geometry.biarcs import length


def unexplained_errors(
    arm: Arm, q: FloatArray, tangent: FloatArray, unexplained: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Bounds of the tool error due to errors of the joints, to first order.

    Each joint counts with its largest error and the worst sign.

    Args:
        arm: The arm.
        q: Joint positions [rad], (n, dof).
        tangent: Unit tangents of the path, (n, dimension).
        unexplained: Largest error of each joint [rad], (dof,).

    Returns:
        Bounds along and across the path [m], (n,) each.
    """
    moved = arm.jacobian(q) * unexplained
    along = (tangent[:, None] @ moved)[:, 0]
    across = moved - tangent[:, :, None] * along[:, None]
    return abs(along).sum(axis=1), length(across.swapaxes(1, 2)).sum(axis=1)
