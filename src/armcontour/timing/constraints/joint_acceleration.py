"""Joint acceleration limits, which may differ in the two directions."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.timing.constraints._rows import acceleration_bulge, path_acceleration_bound
from armcontour.timing.constraints.base import Bounds, Constraint, JointDerivatives, Rows
from armcontour.timing.grid import Grid


class JointAcceleration(Constraint):
    """`low <= q' u + q'' x <= high` for every joint.

    Args:
        low: Lower bounds, negative [rad/s²], (dof,).
        high: Upper bounds, positive [rad/s²], (dof,).
    """

    name = "acceleration"
    joints = True

    def __init__(self, low: FloatArray, high: FloatArray) -> None:
        self.low, self.high = low, high

    def on(self, grid: Grid) -> tuple[FloatArray, FloatArray]:
        """Lower and upper bounds on every interval of a grid, (n, dof) each."""
        shape = (len(grid), len(self.low))
        return np.broadcast_to(self.low, shape), np.broadcast_to(self.high, shape)

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows:
        """The bounds, less what the acceleration can exceed its chord between the ends."""
        margin = np.zeros(path.third.shape)
        if bounds is not None:
            acceleration_bulge(
                grid.width,
                path.first,
                path.second,
                path.third,
                path.fourth,
                bounds.x,
                bounds.u,
                bounds.skew,
                margin,
            )
        low, high = (np.broadcast_to(x, path.first.shape) for x in self.on(grid))
        return Rows(path.first, path.second, low, high, margin)

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval, given the largest x there."""
        return np.asarray(path_acceleration_bound(path.first, path.second, self.low, self.high, x))
