"""The jerk of the tool on parts of cells, as polynomials in Bernstein form."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.planning.grid import Grid
from armcontour.planning.jerk._polynomials import Basis, to_bernstein
from armcontour.planning.topp._kernel import Bounds
from armcontour.robot import Arm

# Degree of the polynomials: derivatives of the tool's position are parabolas on a part.
DEGREE = 4
# Places of a part: parabolas go through every second one, and are checked at the others.
PLACES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])
# Below this share of the speed over s the tool turns nearly on the spot.
LEAST_SPEED = 0.5
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
        return cls(*_parabolas(_derivatives(grid, arm)))

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


def largest_at_ramps(derivatives: FloatArray, limit: float, h: FloatArray) -> FloatArray:
    """Largest ds² at the moving end of cells of uniform jerk of lengths h [m], (n,).

    Args:
        derivatives: Bounds of the first to third derivative over s, (3, n).
        limit: The limit of jerk [m/s³].
        h: The lengths.
    """
    first, second, third = derivatives
    with np.errstate(divide="ignore"):
        jerk = third + 2 * second / h + 2 / 9 * first / h**2
        return np.asarray((limit / jerk) ** (2 / 3))


def arc_length_bounds(grid: Grid, arm: Arm) -> FloatArray:
    """Bounds of the derivatives of the tool's own arc length over s on parts of cells, (3, n).

    Where joints follow a tool path, s is nearly the tool's arc length (the first derivative was 1
    within 1e-6 on a UR5e), but the third derivative of the small difference counts. Where the tool
    turns on the spot s is no arc length, and the limit applies to s.
    """
    p = _derivatives(grid, arm)
    speed = np.linalg.norm(p[0], axis=2)
    own = (speed > LEAST_SPEED).all(axis=0)
    safe = np.where(own, speed, 1.0)
    rate = np.where(own, np.sum(p[0] * p[1], axis=2) / safe, 0.0)
    bend = np.sum(p[0] * p[2] + p[1] * p[1], axis=2) - rate**2
    values = np.stack([safe, rate, np.where(own, bend / safe, 0.0)])
    return _parabolas(values[..., None])[2]


def _derivatives(grid: Grid, arm: Arm) -> FloatArray:
    """First to third derivative of the tool's position at the places of parts, (3, 5, n, 3)."""
    s = grid.s[:-1] + PLACES[:, None] * grid.width
    piece = np.broadcast_to(grid.piece, s.shape).ravel()
    path = grid.joint_path
    q, *rates = (path.on_interval(piece, s.ravel(), order) for order in range(4))
    found = [arm.tool_velocity(q, *rates[:1]), arm.tool_acceleration(q, *rates[:2])]
    found.append(arm.tool_jerk(q, *rates))
    values = np.zeros((3, len(PLACES), len(grid), 3))
    for k, x in enumerate(found):
        values[k, ..., : x.shape[1]] = x.reshape(*s.shape, -1)
    return values


def _parabolas(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Powers of parabolas through values at places, distances from them, and largest lengths."""
    powers = np.einsum("mp,kpnc->kmnc", PARABOLA, values[:, ::2])
    parabola = np.einsum("pm,kmnc->kpnc", PLACES[1::2, None] ** np.arange(3), powers)
    off = MARGIN * np.linalg.norm(values[:, 1::2] - parabola, axis=3).max(axis=1)
    points = np.einsum("cm,kmnx->kcnx", to_bernstein(2), powers)
    return powers, off, np.linalg.norm(points, axis=3).max(axis=1) + off
