"""Joint velocity limits."""

from __future__ import annotations

from armcontour._checks import FloatArray
from armcontour.timing.constraints._rows import velocity_ceiling, velocity_ceiling_at_ends
from armcontour.timing.constraints.base import Bounds, Ceiling, Constraint, JointDerivatives
from armcontour.timing.grid import Grid


class JointVelocity(Constraint):
    """`|q' ds| <= limit` for every joint.

    Args:
        limit: Largest joint velocities [rad/s], infinite where there is none, (dof,).
    """

    name = "velocity"
    limit_name = "joint_velocity"
    limit: FloatArray
    joints = True

    def __init__(self, limit: FloatArray) -> None:
        self.limit = limit

    def ceiling(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Ceiling:
        """Largest x at both ends; with bounds, small enough for the points between them too."""
        if bounds is None:
            return Ceiling(velocity_ceiling_at_ends(path.first, self.limit))
        return Ceiling(
            *velocity_ceiling(
                grid.width,
                path.first,
                path.second,
                path.third,
                self.limit,
                bounds.x,
                bounds.u,
                bounds.skew,
            )
        )
