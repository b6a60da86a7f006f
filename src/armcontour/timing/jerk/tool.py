"""The jerk of the tool on parts of cells, as polynomials in Bernstein form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.timing.grid import Grid
from armcontour.timing.jerk._polynomials import Basis, to_bernstein
from armcontour.timing.topp._kernel import Bounds

# Degree of the polynomials: derivatives of the tool's position are parabolas on a part.
DEGREE = 4
# Places of a part: parabolas go through every second one, and are checked at the others.
PLACES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])
# Safety factor of the distance from the parabolas that is measured at the places between.
MARGIN = 2.0


@dataclass(frozen=True, slots=True)
class ToolMotion:
    """Derivatives of the tool's position over s on parts of cells.

    Args:
        powers: Of x from 0 to 1 on every part, for the first to third derivative, (3, 3, n, 3).
        off: Bounds of the distance of the derivatives from these parabolas, (3, n).
        largest: Bounds of the derivatives' lengths, (3, n).
    """

    powers: FloatArray
    off: FloatArray
    largest: FloatArray

    @classmethod
    def on(cls, grid: Grid, arm: Arm) -> ToolMotion:
        """Measure the derivatives by forward kinematics."""
        s = grid.s[:-1] + PLACES[:, None] * grid.width
        piece = np.broadcast_to(grid.piece, s.shape).ravel()
        path = grid.joint_path
        q, *rates = (path.on_interval(piece, s.ravel(), order) for order in range(4))
        found = [arm.tool_velocity(q, *rates[:1]), arm.tool_acceleration(q, *rates[:2])]
        found.append(arm.tool_jerk(q, *rates))
        values = np.zeros((3, len(PLACES), len(grid), 3))
        for k, x in enumerate(found):
            values[k, ..., : x.shape[1]] = x.reshape(*s.shape, -1)
        powers = np.einsum("mp,kpnc->kmnc", PARABOLA, values[:, ::2])
        parabola = np.einsum("pm,kmnc->kpnc", PLACES[1::2, None] ** np.arange(3), powers)
        off = MARGIN * np.linalg.norm(values[:, 1::2] - parabola, axis=3).max(axis=1)
        points = np.einsum("cm,kmnx->kcnx", to_bernstein(2), powers)
        largest = np.linalg.norm(points, axis=3).max(axis=1) + off
        return cls(powers, off, largest)

    def rows(self, on: Basis) -> FloatArray:
        """Control points of jerk over ds as rows of the control points of ds², (n, 5, 3, 3).

        The jerk over ds is `p''' ds² + 3 p'' dds + p' slope`, a vector.
        """
        first, second, third = self.powers
        found = np.zeros((DEGREE + 1, 3, *first.shape[1:]))  # power, control point, part, axis
        for b in range(3):
            for m in range(3):
                for k in range(3):
                    found[m + k, b] += third[m] * on.square[:, b, k, None]
                for k in range(2):
                    found[m + k, b] += 3 * second[m] * on.rate[:, b, k, None]
                found[m, b] += first[m] * on.slope[:, b, None]
        return np.asarray(np.einsum("cm,mbna->ncab", to_bernstein(DEGREE), found))

    def margin(self, bounds: Bounds) -> FloatArray:
        """Bound of what the rows leave out, (n,)."""
        return np.asarray(
            self.off[2] * bounds.x + 3 * self.off[1] * bounds.u + self.off[0] * np.abs(bounds.k)
        )

    def largest_at_ramps(self, limit: float, h: FloatArray) -> FloatArray:
        """Largest ds² at the moving end of cells of uniform jerk of lengths h [m], (n,)."""
        first, second, third = self.largest
        with np.errstate(divide="ignore"):
            jerk = third + 2 * second / h + 2 / 9 * first / h**2
            return np.asarray((limit / jerk) ** (2 / 3))
