"""Limits of angular speed and angular acceleration, for arms whose tool has an orientation.

Forward kinematics gives w(s), the angular velocity of the tool at ds = 1. The angular velocity is
then `w ds`, and the angular acceleration is `w u + w' x`.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.timing.constraints._angular import write_rows
from armcontour.timing.constraints.base import Bounds, Ceiling, Constraint, JointDerivatives, Rows
from armcontour.timing.constraints.sampled import Sampled, Values, bulge, rise
from armcontour.timing.grid import Grid
from armcontour.timing.limit_use import require_orientation

# The length of a vector in a plane is bounded by a polygon of twice as many sides. The polygon lies
# inside the circle of the limit, by at most 1 - cos(pi / 64) = 0.12 % of its radius.
DIRECTIONS = 32
ANGLES = np.arange(DIRECTIONS) * np.pi / DIRECTIONS
# Cosines and sines of the directions at right angles to the sides.
POLYGON = np.array([np.cos(ANGLES), np.sin(ANGLES)])


def turning_of(arm: Arm) -> Sampled:
    """The angular velocity w of the tool at ds = 1 and its derivative over s, (n, 3) each; |w|².

    Raises:
        InvalidInput: The arm's tool has no orientation.
    """
    tool = require_orientation(arm)

    def turning(q: FloatArray, first: FloatArray, second: FloatArray) -> Values:
        rate, bend = tool.tool_twist(q, first), tool.tool_twist_rate(q, first, second)
        w, dw = rate[:, 3:].copy(), bend[:, 3:].copy()
        return w, dw, np.sum(w**2, axis=1, keepdims=True)

    return Sampled(turning)


class AngularSpeed(Constraint):
    """`|w|² x <= limit²`.

    Args:
        limit: Largest angular speed of the tool [rad/s].
        turning: Angular velocity along the path, from `turning_of`.
    """

    name = "angular speed"
    limit_name = "angular_speed"

    def __init__(self, limit: float, turning: Sampled) -> None:
        self.limit, self._turning = limit, turning

    def ceiling(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Ceiling:
        """The bound, less what `|w|² x` can rise between the ends."""
        square = self._turning.at_ends(grid)[2]
        with np.errstate(divide="ignore"):
            if bounds is None:
                return Ceiling(self.limit**2 / square[..., 0])
            none = np.zeros_like(square)
            rises = none[0], self._turning.rises(grid)[2], none[0]
            lost = bulge(grid, none, square, rises, bounds)[:, 0] / self.limit**2
            return Ceiling(self.limit**2 * np.maximum(1 - lost, 0.0) / square[..., 0], lost)


class AngularAcceleration(Constraint):
    """`|w u + w' x| <= limit`, by a polygon in the plane of w and w'.

    Args:
        limit: Length of the angular acceleration vector [rad/s²].
        turning: Angular velocity along the path, from `turning_of`.
    """

    name = "angular acceleration"
    limit_name = "angular_acceleration"

    def __init__(self, limit: float, turning: Sampled) -> None:
        self.limit, self._turning = limit, turning

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows:
        """One row per side of the polygon; its direction is fixed on each interval."""
        w, dw = self._turning.at_ends(grid)[:2]
        middle_w, middle_dw = self._turning.in_middles(grid)[:2]
        n = len(grid)
        ends, seen = np.empty((2, 2, n, DIRECTIONS)), np.empty((2, n, DIRECTIONS))
        out, margin = np.empty((2, n)), np.zeros((n, DIRECTIONS))
        write_rows(w, dw, middle_w, middle_dw, POLYGON, ends, seen, out)
        (a, b), radius = ends, np.full(n, self.limit)
        if bounds is not None:
            rises = rise(grid, a, seen[0]), rise(grid, b, seen[1]), margin
            margin = bulge(grid, a, b, rises, bounds)
            # The plane turns along the interval: the part that leaves it reduces the radius.
            out += [x.sum(axis=1) for x in self._turning.rises(grid)[:2]]
            across = out[0] * bounds.u + out[1] * bounds.x
            radius = np.sqrt(np.maximum(radius**2 - across**2, 0.0))
        bound = np.broadcast_to((radius * np.cos(np.pi / (2 * DIRECTIONS)))[:, None], a.shape)
        return Rows(a, b, -bound, bound, margin)

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray:
        """Largest |dds| on every interval, given the largest x there."""
        w, dw = (np.linalg.norm(x[0], axis=1) for x in self._turning.at_ends(grid)[:2])
        with np.errstate(divide="ignore"):
            return np.asarray((self.limit + dw * x) / w)
