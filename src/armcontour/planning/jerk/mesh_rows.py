"""Rows of the interior-point method: limits as functions of the control points of ds²."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import FloatArray, IntArray, kernel_array
from armcontour.core.kernel_cache import compiled
from armcontour.core.quintics import to_bernstein
from armcontour.planning.constraints import Constraint, JointMotion, limits_on
from armcontour.planning.jerk.interior_point import JerkSection
from armcontour.planning.jerk.mesh import JerkMesh
from armcontour.planning.topp.friction_rows import rows_with_friction
from armcontour.planning.topp.limit_forms import (
    HIGH,
    LOW,
    A,
    B,
    GridLimits,
    Intervals,
    MotionBounds,
    margins_of,
)
from armcontour.planning.topp.sampled_joint_path import SampledJointPath

# Highest degree of a joint path.
HIGHEST_DEGREE = 5
# Cell of each part, and `control_points` of the cells
_Cells = tuple[IntArray, FloatArray, FloatArray]
# Smallest value at an end of the tangent that bounds ds², as a fraction of its value in the middle
LEAST_TANGENT_SHARE = 0.25
# Smallest q' as a fraction of its limit [s/m], which prevents a division by zero
SMALLEST_SLOPE = 1e-150


class Basis(NamedTuple):
    """ds², dds and slope on parts of cells, as rows that multiply a cell's three control points."""

    # Coefficients of ds² in powers of x, from 0 to 1 on each part, (m, 3 control points, 3)
    square: FloatArray
    rate: FloatArray  # Coefficients of dds in powers of x, (m, 3 control points, 2)
    slope: FloatArray  # Derivative of dds in s, (m, 3 control points)

    @property
    def points(self) -> FloatArray:
        """Control points of ds² on each part, (m, 3, 3 control points of the cell)."""
        return raised(self, 2)

    def at_end(self, end: int) -> tuple[FloatArray, FloatArray]:
        """Return the rows of ds² and dds at the start (0) or end (1) of each part, (m, 3) each."""
        if end == 0:
            return self.square[..., 0], self.rate[..., 0]
        return self.square.sum(axis=-1), self.rate.sum(axis=-1)


def basis(start: FloatArray, share: FloatArray, width: FloatArray) -> Basis:
    """Make the basis from start and length of parts in their cell (0 to 1) and cell width [m]."""
    x = start[:, None]
    second = np.array([2.0, -4.0, 2.0])
    value = np.concatenate([(1 - x) ** 2, 2 * x * (1 - x), x**2], axis=1)
    first = np.concatenate([-2 * (1 - x), 2 - 4 * x, 2 * x], axis=1)
    y = share[:, None]
    h = width[:, None]
    square = np.stack([value, y * first, np.broadcast_to(y**2 * second / 2, value.shape)], axis=2)
    rate = np.stack([first, np.broadcast_to(y * second, first.shape)], axis=2) / (2 * h[..., None])
    return Basis(square, rate, second / (2 * h**2))


def raised(basis: Basis, degree: int) -> FloatArray:
    """Return the control points of ds² as a polynomial of a degree >= 2, (m, degree + 1, 3)."""
    points = basis.square.reshape(-1, 3) @ to_bernstein(degree)[:, :3].T
    return np.asarray(points.reshape(-1, 3, degree + 1).transpose(0, 2, 1))


@compiled()
def localize(cells: _Cells, points: FloatArray, rows: FloatArray) -> None:
    """Convert rows that multiply a cell's control points to rows of the unknowns.

    - `cells`: cell of each of the n parts, and `control_points` of the cells.
    - `points`: rows of the three control points, (n, rows, 3).
    - `rows`: output, (n, rows, 3).
    """
    cell, begin, end = cells
    for i in range(points.shape[0]):
        m = cell[i]
        for r in range(points.shape[1]):
            # The middle control point is an unknown, the other two follow from the unknowns.
            for b in range(3):
                rows[i, r, b] = points[i, r, 0] * begin[m, b] + points[i, r, 2] * end[m, b]
            rows[i, r, 1] += points[i, r, 1]


@compiled()
def speed_ceiling(
    width: FloatArray, slopes: FloatArray, third: FloatArray, limit: FloatArray, top: FloatArray
) -> None:
    """Write upper bounds of the control points of ds² by the joint velocity limits.

    A joint's |q'| divided by its limit is below a line. The tangent of `1 / line²` is a lower bound
    of `1 / line²`.

    - `width`: lengths of the n parts [m], (n,).
    - `slopes`: q' at the starts and ends of the parts, (n, 2, dof).
    - `third`: bounds of |q'''| on the parts, (n, dof).
    - `limit`: velocity limits [rad/s], (n, dof); infinite without a limit.
    - `top`: output, (n, 3).
    """
    for i in range(len(width)):
        top[i] = np.inf
        for j in range(limit.shape[1]):
            if limit[i, j] == np.inf:
                continue
            bulge = width[i] * width[i] / 8 * third[i, j]
            first = max((abs(slopes[i, 0, j]) + bulge) / limit[i, j], SMALLEST_SLOPE)
            last = max((abs(slopes[i, 1, j]) + bulge) / limit[i, j], SMALLEST_SLOPE)
            middle = (first + last) / 2
            change = (last - first) / middle
            if abs(change) > 1 - LEAST_TANGENT_SHARE:
                level = 1 / max(first, last) ** 2
                for k in range(3):
                    top[i, k] = min(top[i, k], level)
                continue
            tangent = 1 / middle**2
            top[i, 0] = min(top[i, 0], tangent * (1 + change))
            top[i, 1] = min(top[i, 1], tangent)
            top[i, 2] = min(top[i, 2], tangent * (1 - change))


@compiled()
def motion_rows(
    grid: Intervals,
    basis: Basis,
    cells: _Cells,
    of_powers: tuple[FloatArray, FloatArray],
    first_rows: tuple[IntArray, IntArray],
    rows: tuple[FloatArray, FloatArray],
) -> None:
    """Write acceleration, and jerk divided by ds, as rows of the unknowns.

    The acceleration is `q'' a + q' dds`, and the jerk divided by ds is `q''' a + 3 q'' dds + q'
    slope`, with `a = ds²`. On a part of a cell both are polynomials, whose control points are
    linear in the control points of a.

    - `grid`: the n parts of cells.
    - `cells`: cell of each part, and `control_points` of the cells.
    - `of_powers`: `to_bernstein` of the degrees of acceleration and of jerk.
    - `first_rows`: first rows of acceleration and of jerk of each joint, -1 if it has none.
    - `rows`: output, (n, rows, 3) each.
    """
    derivatives = np.zeros((3, HIGHEST_DEGREE + 1))
    powers = np.empty((2, HIGHEST_DEGREE + 2, 3))
    degree = len(of_powers[0]) - 1
    for i in range(len(grid.piece)):
        for j in range(grid.dof):
            if first_rows[0][j] < 0 and first_rows[1][j] < 0:
                continue
            _write_derivatives(grid, i, j, derivatives)
            _write_products(basis, i, degree, derivatives, powers)
            for kind in range(2):
                first = first_rows[kind][j]
                if first >= 0:
                    _write_rows(cells, i, of_powers[kind], powers[kind], first, rows[kind])


@compiled(inner=True)
def _write_derivatives(grid: Intervals, i: int, j: int, out: FloatArray) -> None:
    """Write q', q'' and q''' of joint j on part i, in powers of the part's fraction, (3, 6)."""
    k = grid.piece[i]
    scale = 1.0 / (grid.breaks[k + 1] - grid.breaks[k])
    x = (grid.s[i] - grid.breaks[k]) * scale
    h = grid.s[i + 1] - grid.s[i]
    dx = h * scale
    # Coefficients of q in powers of the fraction of the piece
    at = 6 * k * grid.dof + j
    c1 = grid.coefficients[at + grid.dof]
    c2 = grid.coefficients[at + 2 * grid.dof]
    c3 = grid.coefficients[at + 3 * grid.dof]
    c4 = grid.coefficients[at + 4 * grid.dof]
    c5 = grid.coefficients[at + 5 * grid.dof]
    # Coefficients of q in powers of the fraction of the part, by Taylor expansion
    t1 = dx * (c1 + x * (2 * c2 + x * (3 * c3 + x * (4 * c4 + x * 5 * c5))))
    t2 = dx**2 * (c2 + x * (3 * c3 + x * (6 * c4 + x * 10 * c5)))
    t3 = dx**3 * (c3 + x * (4 * c4 + x * 10 * c5))
    t4 = dx**4 * (c4 + x * 5 * c5)
    t5 = dx**5 * c5
    # Derivatives in the arc length
    out[0, 0] = t1 / h
    out[0, 1] = 2 * t2 / h
    out[0, 2] = 3 * t3 / h
    out[0, 3] = 4 * t4 / h
    out[0, 4] = 5 * t5 / h
    out[1, 0] = 2 * t2 / h**2
    out[1, 1] = 6 * t3 / h**2
    out[1, 2] = 12 * t4 / h**2
    out[1, 3] = 20 * t5 / h**2
    out[2, 0] = 6 * t3 / h**3
    out[2, 1] = 24 * t4 / h**3
    out[2, 2] = 60 * t5 / h**3


@compiled(inner=True)
def _write_products(
    basis: Basis, i: int, degree: int, derivatives: FloatArray, powers: FloatArray
) -> None:
    """Write acceleration, and jerk divided by ds, for each control point of the cell.

    - `degree`: degree of the joint path.
    - `derivatives`: from `_write_derivatives`.
    - `powers`: output, in powers of the part's fraction, (2, HIGHEST_DEGREE + 2, 3 control points).
    """
    powers[:] = 0.0
    for b in range(3):
        for r in range(degree):
            # q'' a and q''' a
            for n in range(3):
                powers[0, r + n, b] += derivatives[1, r] * basis.square[i, b, n]
                powers[1, r + n, b] += derivatives[2, r] * basis.square[i, b, n]
            # q' dds and 3 q'' dds
            for n in range(2):
                powers[0, r + n, b] += derivatives[0, r] * basis.rate[i, b, n]
                powers[1, r + n, b] += 3.0 * derivatives[1, r] * basis.rate[i, b, n]
            # q' slope
            powers[1, r, b] += derivatives[0, r] * basis.slope[i, b]


@compiled(inner=True)
def _write_rows(
    cells: _Cells,
    i: int,
    of_powers: FloatArray,
    powers: FloatArray,
    first: int,
    rows: FloatArray,
) -> None:
    """Write the control points of a polynomial on part i as rows of the unknowns, from `first` on.

    - `of_powers`: `to_bernstein` of the degree.
    - `powers`: the polynomial for each control point of the cell, (powers, 3).
    """
    cell, begin, end = cells
    m = cell[i]
    for c in range(len(of_powers)):
        begin_value = 0.0
        middle_value = 0.0
        end_value = 0.0
        for r in range(c + 1):
            begin_value += of_powers[c, r] * powers[r, 0]
            middle_value += of_powers[c, r] * powers[r, 1]
            end_value += of_powers[c, r] * powers[r, 2]
        # The middle control point is an unknown, the other two follow from the unknowns.
        for b in range(3):
            rows[i, first + c, b] = begin_value * begin[m, b] + end_value * end[m, b]
        rows[i, first + c, 1] += middle_value


class MeshRows:
    """Rows of the interior-point method for all sections of a mesh."""

    def __init__(
        self,
        mesh: JerkMesh,
        active: Sequence[Constraint],
        jerk: FloatArray,
        bounds: MotionBounds | None,
        about: FloatArray,
    ) -> None:
        # `jerk`: limits of joint jerk [rad/s³], (dof,). `bounds`: bounds of ds² and dds on the
        # parts of cells. They limit the plan, and determine the margins inside parts; None for no
        # margins. `about`: ds² on each part about which nonlinear limits are linearized if there
        # are no bounds, (m,).
        self.mesh = mesh
        self.bounds = bounds
        self.jerk = jerk
        grid = mesh.grid
        self.path = SampledJointPath(grid)
        width = mesh.width[mesh.cell]
        start = (grid.s[:-1] - mesh.nodes[mesh.cell]) / width
        self.basis: Basis = basis(np.clip(start, 0, 1), grid.width / width, width)
        used = np.flatnonzero(grid.joint_path.coefficients.any(axis=(0, 2)))
        self.degree = max(3, int(used[-1]) if len(used) else 3)
        # Largest fraction of a limit that margins take on each part, (m,)
        self.lost = np.zeros(len(grid))
        self.bounded = np.full((2, len(grid), grid.joint_path.dof), np.inf)
        self.speeds = np.full((len(grid), grid.joint_path.dof), np.inf)
        sampled = []
        for constraint in active:
            if isinstance(constraint, JointMotion):
                # Rows of joint motion are polynomials, which need no margins.
                if len(constraint.velocity[0]):
                    self.speeds = np.minimum(self.speeds, constraint.fastest(self.path))
                if len(constraint.low):
                    low, high = constraint.bounds(grid)
                    self.bounded = np.minimum(self.bounded, [-low, high])
            else:
                sampled.append(constraint)
        self.limits = self._subtract_margins(limits_on(self.path, sampled), about)
        # Indices of the joints with limits of acceleration, and of the joints with limits of jerk
        self.joints = (
            np.flatnonzero(np.isfinite(self.bounded).any(axis=(0, 1))),
            np.flatnonzero(np.isfinite(jerk)),
        )
        self.section = self._make_section()

    def _subtract_margins(self, limits: GridLimits, about: FloatArray) -> GridLimits:
        """Return the limits less their margins, with lines for friction; write `lost`."""
        none = np.zeros(len(about))
        bounds = self.bounds
        linearized = MotionBounds(about, about, none, none) if bounds is None else bounds
        if limits.friction.viscous.shape[2]:
            linearized = MotionBounds(*(kernel_array(x) for x in linearized))
            width = self.mesh.grid.width
            margins = bounds is not None
            limits = limits._replace(rows=rows_with_friction(width, limits, linearized, margins))
        if bounds is None:
            return limits
        ends = limits.rows.ends.copy()
        radius = limits.rounds.radius
        room = np.minimum(ends[..., HIGH], -ends[..., LOW]).min(axis=1)
        rows, squares, rounds = (margins_of(x.rise, bounds) for x in limits[:3])
        self._record_margins(rows, room)
        self._record_margins(squares, np.ones_like(squares))
        self._record_margins(rounds, radius)
        ends[..., LOW] += rows[:, None]
        ends[..., HIGH] -= rows[:, None]
        remaining = np.maximum(1 - squares, 0.0)[:, None]
        with np.errstate(divide="ignore", invalid="ignore"):
            tight = np.where(remaining > 0, limits.squares.ends / remaining, np.inf)
        return limits._replace(
            rows=limits.rows._replace(ends=ends),
            squares=limits.squares._replace(ends=tight),
            rounds=limits.rounds._replace(radius=np.maximum(radius - rounds, 0.0)),
        )

    def _record_margins(self, margins: FloatArray, room: FloatArray) -> None:
        """Record in `lost` the largest share of a limit at rest that `margins`, (m, rows), take."""
        with np.errstate(invalid="ignore", divide="ignore"):
            share = np.where(np.isfinite(room), margins / room, 0.0)
        lost = np.where(room > 0, share, 1.0).max(axis=1, initial=0.0)
        self.lost = np.maximum(self.lost, lost)

    @property
    def count(self) -> int:
        """Number of bounds of all rows."""
        p = self.section
        finite = sum(int(np.isfinite(x).sum()) for x in (p.low, p.high, p.radius))
        return finite + 2 * len(p.curved) * int(p.curved.shape[1])

    def select_section(self, k: int) -> JerkSection:
        """Return the rows of one section, without its cells of uniform jerk."""
        mesh = self.mesh
        p = self.section
        first = mesh.sections[k] + 1
        last = mesh.sections[k + 1] - 1
        ramps = mesh.width[[first - 1, last]]
        start, end = np.searchsorted(mesh.cell, [first, last])
        cells = {name: getattr(p, name)[first:last] for name in ("width", "begin", "end")}
        parts = {
            name: getattr(p, name)[start:end]
            for name in ("plain", "low", "high", "curved", "raised", "about", "round", "radius")
        }
        return p._replace(ramps=ramps, cell=mesh.cell[start:end] - first, **cells, **parts)

    def allowed_slopes(self, k: int) -> tuple[FloatArray, FloatArray]:
        """Return the slopes of ds^1.5 and ds² that use half of the jerk and acceleration limits."""
        # The slopes assume a straight path. They are returned for the cells of a section except its
        # cells of uniform jerk, (n,) each.
        mesh = self.mesh
        slopes_by_cell = []
        first = int(mesh.sections[k]) + 1
        last = int(mesh.sections[k + 1]) - 1
        start, end = np.searchsorted(mesh.cell, [first, last])
        slopes = np.abs(self.path.derivatives[0][0][start:end]).max(axis=1)
        begins = np.searchsorted(mesh.cell[start:end], np.arange(first, last))
        with np.errstate(divide="ignore"):
            jerk = (self.jerk / slopes).min(axis=1)
            rate = (self.bounded[:, start:end].min(axis=0) / slopes).min(axis=1)
        for x in (np.sqrt(4.5 * jerk) / 2, rate):
            slopes_by_cell.append(np.minimum.reduceat(x, begins))
        return slopes_by_cell[0], slopes_by_cell[1]

    def _make_section(self) -> JerkSection:
        """Make the rows of the whole path as one section."""
        begin, end = control_points(self.mesh)
        cells = self.mesh.cell, begin, end
        acceleration, rows = self._motion_rows(cells)
        plain, low, high = self._plain_rows(cells, acceleration)
        vectors, radius = self._vector_rows()
        return JerkSection(
            width=self.mesh.width,
            begin=begin,
            end=end,
            ramps=np.zeros(2),
            cell=self.mesh.cell,
            plain=plain,
            low=low,
            high=high,
            curved=rows,
            jerk=np.repeat(self.jerk[self.joints[1]], self.degree),
            curved_points=np.tile(np.arange(self.degree), len(self.joints[1])),
            raised=_localize(cells, raised(self.basis, self.degree - 1)),
            about=np.zeros(len(self.mesh.cell)),
            round=_localize(cells, vectors),
            radius=radius,
        )

    def _motion_rows(self, cells: _Cells) -> tuple[FloatArray, FloatArray]:
        """Return the rows of acceleration and of jerk for all limited joints, in joint order."""
        dof = self.mesh.grid.joint_path.dof
        sizes = (self.degree + 1, self.degree)
        first = np.full((2, dof), -1)
        rows = []
        for kind, (joints, size) in enumerate(zip(self.joints, sizes, strict=True)):
            first[kind, joints] = size * np.arange(len(joints))
            rows.append(np.empty((len(self.mesh.grid), size * len(joints), 3)))
        acceleration, jerk = rows
        powers = to_bernstein(self.degree), to_bernstein(self.degree - 1)
        firsts = first[0], first[1]
        motion_rows(self.path.intervals, self.basis, cells, powers, firsts, (acceleration, jerk))
        return acceleration, jerk

    def _plain_rows(
        self, cells: _Cells, acceleration: FloatArray
    ) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Return the rows with fixed bounds: ds², accelerations, and those of other constraints."""
        n = len(self.mesh.grid)
        bounds = self.bounds
        basis = self.basis
        none = np.full((n, 3), np.inf)
        top = np.minimum(self._speed_ceiling(), self._ceiling())
        ends = [basis.at_end(e) for e in range(2)]
        rows = [basis.points]
        low = [-none]
        high = [top]
        if bounds is not None:
            smallest = np.where(bounds.x_min > 0, bounds.x_min, -np.inf)
            low = [np.broadcast_to(smallest[:, None], (n, 3))]
            high = [np.minimum(top, bounds.x[:, None])]
            rate_bounds = np.stack([bounds.u, bounds.u, np.abs(bounds.k)], axis=1)
            rows.append(np.stack([ends[0][1], ends[1][1], basis.slope], axis=1))
            low.append(-rate_bounds)
            high.append(rate_bounds)
        general = self.limits.rows.ends
        for e in range(2):
            square, rate = (x[:, None] for x in ends[e])
            a, b = general[:, e, :, A, None], general[:, e, :, B, None]
            rows.append(a * rate + b * square)
            low.append(general[:, e, :, LOW])
            high.append(general[:, e, :, HIGH])
        for sign, out in ((-1, low), (1, high)):
            bound = self.bounded[(sign + 1) // 2][:, self.joints[0]]
            out.append(np.repeat(sign * bound, self.degree + 1, axis=1))
        bottom = np.concatenate(low, axis=1)
        top = np.concatenate(high, axis=1)
        self._bound_next_to_ramps(top)
        others = _localize(cells, np.concatenate(rows, axis=1))
        return np.concatenate([others, acceleration], axis=1), bottom, top

    def _vector_rows(self) -> tuple[FloatArray, FloatArray]:
        """Return the vector rows, (m, l, 2, 3), and their radii, (m, l)."""
        n = len(self.mesh.grid)
        rounds = self.limits.rounds
        products = rounds.products
        vectors = [np.zeros((n, 0, 2, 3))]
        for r in range(rounds.radius.shape[1]):
            for e in range(2):
                # Coordinates in the plane of both vectors; the first axis is parallel to the first
                # vector.
                square, rate = (x[:, None] for x in self.basis.at_end(e))
                aa, ab, bb = (x[:, e, r, None] for x in products)
                along = np.sqrt(aa)
                with np.errstate(invalid="ignore", divide="ignore"):
                    part = np.where(aa > 0, ab / along, 0.0)
                both = np.zeros((n, 1, 2, 3))
                both[:, :, 0] = (along * rate[:, 0] + part * square[:, 0])[:, None]
                both[:, :, 1] = (np.sqrt(np.maximum(bb - part * part, 0.0)) * square[:, 0])[:, None]
                vectors.append(both)
        return np.concatenate(vectors, axis=1), np.repeat(rounds.radius, 2, axis=1)

    def _speed_ceiling(self) -> FloatArray:
        """Bound the control points of ds² by the joint velocity limits, (n, 3)."""
        (slopes, _), (third, _) = self.path.derivatives
        top = np.empty((len(self.mesh.grid), 3))
        speed_ceiling(self.mesh.grid.width, slopes, third, self.speeds, top)
        return top

    def _ceiling(self) -> FloatArray:
        """Return upper bounds of ds² at the start, middle and end of each part [m²/s²], (m, 3)."""
        with np.errstate(divide="ignore"):
            squares = (1 / self.limits.squares.ends).min(axis=2, initial=np.inf)
        first, last = np.minimum(self.limits.ceiling, squares).T
        return np.stack([first, (first + last) / 2, last], axis=1)

    def _bound_next_to_ramps(self, top: FloatArray) -> None:
        """Reduce the bounds of ds² so that adjacent cells of uniform jerk satisfy the limits."""
        mesh = self.mesh
        ramps = self.mesh.ramps
        largest = np.full(len(ramps), np.inf)
        parts = np.flatnonzero(ramps[mesh.cell])
        np.minimum.at(largest, mesh.cell[parts], self._largest_at_ramps(parts))
        first = np.searchsorted(mesh.cell, np.flatnonzero(ramps > 0) + 1)
        last = np.searchsorted(mesh.cell, np.flatnonzero(ramps < 0)) - 1
        top[first, 0] = np.minimum(top[first, 0], largest[ramps > 0])
        top[last, 2] = np.minimum(top[last, 2], largest[ramps < 0])

    def _largest_at_ramps(self, parts: IntArray) -> FloatArray:
        """Return the largest ds² that parts of uniform-jerk cells allow at the moving end, (m,)."""
        # On a cell of length h from a rest, `ds² = A (s / h)^(4/3)`, where A is ds² at the moving
        # end. At this end dds is `2 A / (3 h)`, and the jerk is `2 A^1.5 / (9 h²)`. Each part is
        # bounded as if it had the speed and acceleration of the moving end.
        width = self.mesh.grid.width[parts]
        h = self.mesh.width[self.mesh.cell[parts]]
        ramp_column = h[:, None]
        width_column = width[:, None]
        (slopes, bends), (third, fourth) = (x[:, parts] for x in self.path.derivatives)
        first = np.abs(slopes).max(axis=1) + width_column**2 / 8 * third
        second = np.abs(bends).max(axis=1) + width_column**2 / 8 * fourth
        rate = 2 / (3 * h)
        bounds = [self._ceiling()[parts].min(axis=1)]
        with np.errstate(divide="ignore", invalid="ignore"):
            bounds.append(((self.speeds[parts] / first) ** 2).min(axis=1))
            pull = second + first * rate[:, None]
            bounds.append((self.bounded[:, parts].min(axis=0) / pull).min(axis=1))
            jerk = third + 2 * second / ramp_column + 2 / 9 * first / ramp_column**2
            bounds.append(((self.jerk / jerk) ** (2 / 3)).min(axis=1))
            general = self.limits.rows.ends[parts]
            rounds = self.limits.rounds
            for sign, column in ((1, HIGH), (-1, LOW)):
                coefficient = np.maximum(sign * general[..., A], 0).max(axis=1) * rate[:, None]
                coefficient += np.maximum(sign * general[..., B], 0).max(axis=1)
                remaining = np.maximum((sign * general[..., column]).min(axis=1), 0)
                bounds.append(
                    np.where(coefficient > 0, remaining / coefficient, np.inf).min(
                        axis=1, initial=np.inf
                    )
                )
            aa, ab, bb = (x[parts] for x in rounds.products)
            turned = rate[:, None, None]
            size = np.sqrt(np.maximum(aa * turned**2 + 2 * ab * turned + bb, 0.0)).max(axis=1)
            bounds.append((rounds.radius[parts] / size).min(axis=1, initial=np.inf))
            if self.bounds is not None:
                bounds += [self.bounds.x[parts], self.bounds.u[parts] / rate]
        return np.asarray(np.nanmin(bounds, axis=0))


def _localize(cells: _Cells, points: FloatArray) -> FloatArray:
    """Convert rows that multiply a cell's control points, (n, ..., 3), to rows of the unknowns."""
    flat = kernel_array(points.reshape(len(points), -1, 3))
    rows = np.empty(flat.shape)
    localize(cells, flat, rows)
    return rows.reshape(points.shape)


def control_points(mesh: JerkMesh) -> tuple[FloatArray, FloatArray]:
    """Return coefficients of the first and last control point of ds² on each cell, (n, 3) each."""
    # The coefficients multiply the middle control points of the previous cell, of the cell itself
    # and of the next cell. Inside a section both control points are means of their neighbours, so
    # that ds² has a continuous slope. Next to a cell of uniform jerk with length h and `ds² = A` at
    # its moving end, ds² has the slope of that cell, `4 A / (3 h)`.
    width = mesh.width
    begin, end = np.zeros((2, len(width), 3))
    total = width[:-1] + width[1:]
    begin[1:, 0] = width[1:] / total
    begin[1:, 1] = width[:-1] / total
    end[:-1, 1] = width[1:] / total
    end[:-1, 2] = width[:-1] / total
    first = mesh.sections[:-1]
    last = mesh.sections[1:] - 1
    for rows, ramp, step in ((begin, first, 1), (end, last, -1)):
        near = ramp + step
        rows[near] = 0
        rows[near, 1] = 1 / (1 + 2 * width[near] / (3 * width[ramp]))
    return begin, end
