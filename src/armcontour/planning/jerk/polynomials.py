"""Acceleration and jerk of joints and tool on parts of cells, as polynomials in Bernstein form."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.kernels import compiled
from armcontour.planning.path_grid import Grid
from armcontour.planning.topp.kernels import MotionBounds
from armcontour.planning.topp.limit_forms import Intervals
from armcontour.robot import Arm

# Highest degree of a joint path.
HIGHEST = 5


class Basis(NamedTuple):
    """ds², dds and slope on parts of cells, as rows of the three control points of a cell."""

    # Coefficients of ds² in powers of x, from 0 to 1 on each part, (m, 3 control points, 3)
    square: FloatArray
    rate: FloatArray  # Coefficients of dds in powers of x, (m, 3 control points, 2)
    slope: FloatArray  # Derivative of dds in s, (m, 3 control points)

    @property
    def points(self) -> FloatArray:
        """Control points of ds² on each part, (m, 3, 3 control points of the cell)."""
        return raised(self, 2)

    def at_end(self, end: int) -> tuple[FloatArray, FloatArray]:
        """Rows of ds² and dds at the start (0) or the end (1) of each part, (m, 3) each."""
        if end == 0:
            return self.square[..., 0], self.rate[..., 0]
        return self.square.sum(axis=-1), self.rate.sum(axis=-1)


def basis(start: FloatArray, share: FloatArray, width: FloatArray) -> Basis:
    """Make the basis from start and length of parts in their cell (0 to 1) and cell width [m]."""
    x, second = start[:, None], np.array([2.0, -4.0, 2.0])
    value = np.concatenate([(1 - x) ** 2, 2 * x * (1 - x), x**2], axis=1)
    first = np.concatenate([-2 * (1 - x), 2 - 4 * x, 2 * x], axis=1)
    y, h = share[:, None], width[:, None]
    square = np.stack([value, y * first, np.broadcast_to(y**2 * second / 2, value.shape)], axis=2)
    rate = np.stack([first, np.broadcast_to(y * second, first.shape)], axis=2) / (2 * h[..., None])
    return Basis(square, rate, second / (2 * h**2))


def to_bernstein(degree: int) -> FloatArray:
    """Matrix that converts coefficients of powers to control points, (degree + 1, degree + 1)."""
    return np.array(
        [
            [math.comb(k, m) / math.comb(degree, m) for m in range(degree + 1)]
            for k in range(degree + 1)
        ]
    )


def raised(basis: Basis, degree: int) -> FloatArray:
    """Control points of ds² as a polynomial of a degree of at least 2, (m, degree + 1, 3)."""
    return elevated(basis.square, degree)


def elevated(powers: FloatArray, degree: int) -> FloatArray:
    """Control points of the given degree of polynomials in powers of x, (m, degree + 1, 3)."""
    matrix = to_bernstein(degree)[:, : powers.shape[2]]
    return np.asarray(np.einsum("cm,pbm->pcb", matrix, powers))


@compiled()
def motion_rows(
    grid: Intervals,
    basis: Basis,
    degree: int,
    of_powers: tuple[FloatArray, FloatArray],
    joints: tuple[IntArray, IntArray],
    rows: tuple[FloatArray, FloatArray],
) -> None:
    """Write acceleration, and jerk divided by ds, as rows of the control points of ds²."""
    # The acceleration is `q'' a + q' dds`, and the jerk divided by ds is `q''' a + 3 q'' dds + q'
    # slope`, with `a = ds²`. `grid`: the n parts of cells; `of_powers`: `to_bernstein` of the
    # degrees of acceleration, `degree`, and of jerk, one less; `joints`: joints with rows of
    # acceleration, and joints with rows of jerk; `rows`: output in the order of the joints, (n,
    # joints (degree + 1), 3) and (n, joints degree, 3).
    taylor = np.empty((3, HIGHEST + 1))
    powers = np.empty(2 * HIGHEST)
    t = np.empty(HIGHEST + 1)
    for i in range(len(grid.piece)):
        k = grid.piece[i]
        scale = 1.0 / (grid.breaks[k + 1] - grid.breaks[k])
        x0 = (grid.s[i] - grid.breaks[k]) * scale
        h = grid.s[i + 1] - grid.s[i]
        dx = h * scale
        for kind in range(2):
            count = degree + 1 - kind
            for position in range(len(joints[kind])):
                j = joints[kind][position]
                factor = 1.0
                for m in range(HIGHEST + 1):
                    # `total` is the m-th derivative at the start of the part, divided by m!.
                    total = 0.0
                    for n in range(HIGHEST, m - 1, -1):
                        choose = 1.0
                        for c in range(m):
                            choose *= (n - c) / (c + 1.0)
                        total = total * x0 + choose * grid.coefficients[(6 * k + n) * grid.dof + j]
                    t[m] = total * factor
                    factor *= dx
                for m in range(HIGHEST + 1):
                    taylor[0, m] = (m + 1) * t[m + 1] / h if m < HIGHEST else 0.0
                    taylor[1, m] = (m + 2) * (m + 1) * t[m + 2] / h**2 if m < HIGHEST - 1 else 0.0
                    taylor[2, m] = (
                        (m + 3) * (m + 2) * (m + 1) * t[m + 3] / h**3 if m < HIGHEST - 2 else 0.0
                    )
                for b in range(3):
                    powers[:] = 0.0
                    for m in range(HIGHEST):
                        for n in range(3):
                            if kind == 0:
                                powers[m + n] += taylor[1, m] * basis.square[i, b, n]
                            else:
                                powers[m + n] += taylor[2, m] * basis.square[i, b, n]
                        for n in range(2):
                            if kind == 0:
                                powers[m + n] += taylor[0, m] * basis.rate[i, b, n]
                            else:
                                powers[m + n] += 3.0 * taylor[1, m] * basis.rate[i, b, n]
                        if kind == 1:
                            powers[m] += taylor[0, m] * basis.slope[i, b]
                    for c in range(count):
                        total = 0.0
                        for m in range(c + 1):
                            total += of_powers[kind][c, m] * powers[m]
                        rows[kind][i, position * count + c, b] = total


# Degree of the tool jerk divided by ds; derivatives of the tool position are parabolas on a part.
DEGREE = 4
# Positions of the samples on a part. Parabolas pass through every second sample, and are compared
# with the other samples.
SAMPLES = np.array([0.0, 0.25, 0.5, 0.75, 1.0])
PARABOLA = np.array([[1.0, 0.0, 0.0], [-3.0, 4.0, -1.0], [2.0, -4.0, 2.0]])
# Tool speed at ds = 1 below which the tool nearly rotates in place
MIN_SPEED = 0.5
# Safety factor of the measured distance from the parabolas
MARGIN = 2.0


@dataclass(frozen=True, slots=True)
class ToolDerivatives:
    """Derivatives of the tool position with respect to s on parts of cells."""

    # Coefficients of parabolas through the first to third derivative, in powers of x from 0 to 1 on
    # each part, (3, 3, n, 3)
    powers: FloatArray
    deviation: FloatArray  # Bounds of the distances of the derivatives from the parabolas, (3, n)
    largest: FloatArray  # Bounds of the norms of the derivatives, (3, n)

    @classmethod
    def measure(cls, grid: Grid, arm: Arm) -> ToolDerivatives:
        """Measure the derivatives by forward kinematics."""
        return cls(*_parabolas(_derivatives(grid, arm)))

    def rows(self, basis: Basis) -> FloatArray:
        """Control points of jerk divided by ds, as rows of control points of ds², (n, 5, 3, 3)."""
        # The jerk divided by ds is the vector `p''' ds² + 3 p'' dds + p' slope`.
        first, second, third = self.powers
        powers = np.zeros((DEGREE + 1, 3, *first.shape[1:]))  # power, control point, part, axis
        for b in range(3):
            for m in range(3):
                for k in range(3):
                    powers[m + k, b] += third[m] * basis.square[:, b, k, None]
                for k in range(2):
                    powers[m + k, b] += 3 * second[m] * basis.rate[:, b, k, None]
                powers[m, b] += first[m] * basis.slope[:, b, None]
        return np.asarray(np.einsum("cm,mbna->ncab", to_bernstein(DEGREE), powers))

    def margin(self, bounds: MotionBounds) -> FloatArray:
        """Bound of the error of the jerk rows, (n,)."""
        return np.asarray(
            self.deviation[2] * bounds.x
            + 3 * self.deviation[1] * bounds.u
            + self.deviation[0] * np.abs(bounds.k)
        )


def largest_at_ramps(derivatives: FloatArray, limit: float, h: FloatArray) -> FloatArray:
    """Largest ds² at the moving end of cells of uniform jerk of lengths h [m], (n,)."""
    # `derivatives`: bounds of the first to third derivative in s, (3, n); `limit`: the limit of
    # jerk [m/s³].
    first, second, third = derivatives
    with np.errstate(divide="ignore"):
        jerk = third + 2 * second / h + 2 / 9 * first / h**2
        return np.asarray((limit / jerk) ** (2 / 3))


def arc_length_bounds(grid: Grid, arm: Arm) -> FloatArray:
    """Bounds of the derivatives of the tool's own arc length in s on parts of cells, (3, n)."""
    # If joints follow a tool path, s is nearly the tool's arc length (the first derivative was 1
    # within 1e-6 on a UR5e), but the third derivative of the small difference matters. If the tool
    # rotates in place, s is not an arc length, and the limit applies to s.
    p = _derivatives(grid, arm)
    speed = np.linalg.norm(p[0], axis=2)
    moving = (speed > MIN_SPEED).all(axis=0)
    safe = np.where(moving, speed, 1.0)
    rate = np.where(moving, np.sum(p[0] * p[1], axis=2) / safe, 0.0)
    second = np.sum(p[0] * p[2] + p[1] * p[1], axis=2) - rate**2
    values = np.stack([safe, rate, np.where(moving, second / safe, 0.0)])
    return _parabolas(values[..., None])[2]


def _derivatives(grid: Grid, arm: Arm) -> FloatArray:
    """First to third derivative of the tool's position at the samples of parts, (3, 5, n, 3)."""
    s = grid.s[:-1] + SAMPLES[:, None] * grid.width
    piece = np.broadcast_to(grid.piece, s.shape).ravel()
    path = grid.joint_path
    q, *rates = (path.on_interval(piece, s.ravel(), order) for order in range(4))
    derivatives = [arm.tool_velocity(q, *rates[:1]), arm.tool_acceleration(q, *rates[:2])]
    derivatives.append(arm.tool_jerk(q, *rates))
    values = np.zeros((3, len(SAMPLES), len(grid), 3))
    for k, derivative in enumerate(derivatives):
        values[k, ..., : derivative.shape[1]] = derivative.reshape(*s.shape, -1)
    return values


def _parabolas(values: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Coefficients of parabolas through values at samples, their errors, and largest norms."""
    powers = np.einsum("mp,kpnc->kmnc", PARABOLA, values[:, ::2])
    parabola = np.einsum("pm,kmnc->kpnc", SAMPLES[1::2, None] ** np.arange(3), powers)
    deviation = MARGIN * np.linalg.norm(values[:, 1::2] - parabola, axis=3).max(axis=1)
    points = np.einsum("cm,kmnx->kcnx", to_bernstein(2), powers)
    return powers, deviation, np.linalg.norm(points, axis=3).max(axis=1) + deviation
