"""The rows of the interior point: what limits mean for the control points of ds²."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.timing.constraints import (
    Bounds,
    Constraint,
    JointAcceleration,
    JointDerivatives,
    JointVelocity,
    ToolAcceleration,
)
from armcontour.timing.constraints import Rows as GeneralRows
from armcontour.timing.jerk._interior_point import Section
from armcontour.timing.jerk._polynomials import Basis, basis, motion_rows, raised, to_bernstein
from armcontour.timing.jerk.mesh import Mesh
from armcontour.timing.jerk.task import JerkLimits
from armcontour.timing.jerk.tool import DEGREE, ToolMotion

# A tangent of the bound of ds² is used unless it falls below this share of its middle at an end.
LEAST_SHARE = 0.25


class Rows:
    """All rows of a mesh, from which the sections take theirs.

    Args:
        mesh: The cells.
        active: The constraints of the planner.
        jerk: The limits of jerk.
        bounds: Bounds of ds² and dds on the parts of cells, which rows hold the plan to, and from
            which margins between the ends follow; None for no margins.
        about: Without bounds: ds² on each part near which rows that stand for a curve are
            linearized, (n,).
        arm: The arm.
    """

    def __init__(
        self,
        mesh: Mesh,
        active: Sequence[Constraint],
        jerk: JerkLimits,
        bounds: Bounds | None,
        about: FloatArray,
        arm: Arm,
    ) -> None:
        self.mesh, self.bounds, self.jerk = mesh, bounds, jerk
        grid = mesh.grid
        self.path = JointDerivatives.on(grid)
        width = mesh.width[mesh.cell]
        start = (grid.s[:-1] - mesh.nodes[mesh.cell]) / width
        self.basis: Basis = basis(np.clip(start, 0, 1), grid.width / width, width)
        self.degree = _degree(grid.joint_path.coefficients)
        self.tool: ToolMotion | None = None
        if np.isfinite(jerk.tool):
            # The tangents have as many control points as the jerk of the tool.
            self.tool, self.degree = ToolMotion.on(grid, arm), DEGREE + 1
        self.lost = np.zeros(len(grid))  # largest share of any limit that margins take
        self.bounded = np.full((2, len(grid), grid.joint_path.dof), np.inf)
        self.speeds = np.full(grid.joint_path.dof, np.inf)
        self.ceilings: list[FloatArray] = []
        self.general: list[GeneralRows] = []
        # Vectors and their radii.
        self.round: list[tuple[FloatArray, FloatArray]] = []
        # Curvatures and radii of vectors, for cells of uniform jerk.
        self.at_ramps: list[tuple[FloatArray, FloatArray]] = []
        for x in active:
            self._add(x, about)
        # Joints whose accelerations, and whose jerks are limited.
        self.joints = (
            np.flatnonzero(np.isfinite(self.bounded).any(axis=(0, 1))),
            np.flatnonzero(np.isfinite(jerk.joint)),
        )
        self.section = self._whole()

    def _add(self, x: Constraint, about: FloatArray) -> None:
        """Add what a constraint asks for."""
        grid, path, bounds = self.mesh.grid, self.path, self.bounds
        if isinstance(x, JointVelocity):
            self.speeds = np.minimum(self.speeds, x.limit)
            return
        if isinstance(x, JointAcceleration):
            low, high = x.on(grid)
            self.bounded = np.minimum(self.bounded, [-low, high])
            return
        if isinstance(x, ToolAcceleration):
            self._add_tool_acceleration(x)
            return
        ceiling, disc = x.ceiling(grid, path, bounds), x.disc(grid, path, bounds)
        rows = x.rows_about(grid, path, about) if bounds is None else x.rows(grid, path, bounds)
        if ceiling is not None:
            first, last = ceiling.x
            self.ceilings.append(np.stack([first, (first + last) / 2, last], axis=1))
            if ceiling.lost is not None:
                self.lost = np.maximum(self.lost, ceiling.lost)
        if disc is not None:
            vectors = np.zeros((len(grid), 2, 3, 3))
            for e in range(2):
                square, vectors[:, e, 0] = self.basis.at_end(e)
                vectors[:, e, 1] = disc.c[e][:, None] * square
            self._add_round(vectors, disc.r, disc.c.max(axis=0))
            plain = x.disc(grid, path, None)
            if plain is not None:
                self.lost = np.maximum(self.lost, 1 - disc.r / plain.r)
        if rows is not None:
            self.general.append(rows)
            room = np.minimum(rows.high, -rows.low).min(axis=0)
            with np.errstate(invalid="ignore", divide="ignore"):
                share = np.where(np.isfinite(room), rows.margin / room, 0.0)
            self.lost = np.maximum(self.lost, np.where(room > 0, share, 1.0).max(axis=1))

    def _add_tool_acceleration(self, x: ToolAcceleration) -> None:
        """Add the vectors of the tool's acceleration, along the motion and at right angles to it.

        The curvature is below a chord, so that its product with ds² is below a cubic. With dds, its
        control points are vectors in a disc.
        """
        grid, on = self.mesh.grid, self.basis
        begin, end = x.metric.chords_on(grid)[..., None, None]
        square = on.points
        above = [begin * square[:, :1], (end * square[:, :1] + 2 * begin * square[:, 1:2]) / 3]
        above += [(2 * end * square[:, 1:2] + begin * square[:, 2:]) / 3, end * square[:, 2:]]
        across = np.concatenate(above, axis=1)
        first, last = (on.at_end(e)[1][:, None] for e in range(2))
        share = np.arange(4)[:, None] / 3
        speed = x.metric.speed[grid.piece]
        vectors = np.zeros((len(grid), 4, 3, 3))
        vectors[:, :, 0] = first + (last - first) * share
        vectors[:, :, 1] = across / speed[:, None, None]
        # What the tool's own speed adds along the path.
        play = x.metric.stretch[grid.piece] / speed
        most = np.zeros(len(grid)) if self.bounds is None else self.bounds.x
        radius = x.limit / speed
        left = np.maximum(radius - play * most, 0.0)
        self._add_round(vectors, left, np.maximum(begin, end)[:, 0, 0] / speed)
        self.lost = np.maximum(self.lost, np.minimum(play * most / radius, 1.0))

    def _add_round(self, vectors: FloatArray, radius: FloatArray, curvature: FloatArray) -> None:
        """Add vectors, (n, k, 3, 3), that are in a disc, of ds² times a curvature, and of dds."""
        self.round.append((vectors, radius))
        self.at_ramps.append((curvature, radius))

    @property
    def exact(self) -> bool:
        """Whether all limits are polynomials, which need no margins."""
        return not (self.ceilings or self.general or self.round or self.tool)

    def of_section(self, k: int) -> Section:
        """The rows of one section, without its cells of uniform jerk."""
        mesh, p = self.mesh, self.section
        first, last = mesh.sections[k : k + 2]
        ramps = np.zeros(2)
        if mesh.at_rest[k, 0]:
            ramps[0] = mesh.width[first]
            first += 1
        if mesh.at_rest[k, 1]:
            last -= 1
            ramps[1] = mesh.width[last]
        start, end = np.searchsorted(mesh.cell, [first, last])
        cells = {name: getattr(p, name)[first:last] for name in ("width", "begin", "end")}
        parts = {
            name: getattr(p, name)[start:end]
            for name in ("plain", "low", "high", "curved", "raised", "round", "radius", "margin")
        }
        return p._replace(ramps=ramps, cell=mesh.cell[start:end] - first, **cells, **parts)

    def _whole(self) -> Section:
        """The rows of all cells."""
        of, on = self.mesh.cell, self.basis
        begin, end = control_points(self.mesh)
        acceleration, jerk = self._motion()
        plain, low, high = self._plain(acceleration)
        curved, limits = [jerk], [np.repeat(self.jerk.joint[self.joints[1]], self.degree)]
        if np.isfinite(self.jerk.path):
            curved.append(np.repeat(on.slope[:, None], self.degree, axis=1))
            limits.append(np.full(self.degree, self.jerk.path))
        rows = np.concatenate(curved, axis=1)
        vectors, radius, margin, points = self._round()

        def local(x: FloatArray) -> FloatArray:
            """Rows of control points of ds² on each cell as rows of the unknowns."""
            around = (of,) + (None,) * (x.ndim - 2)
            found = x[..., :1] * begin[around] + x[..., 2:] * end[around]
            found[..., 1] += x[..., 1]
            return np.asarray(found)

        return Section(
            width=self.mesh.width,
            begin=begin,
            end=end,
            ramps=np.zeros(2),
            cell=of,
            plain=local(plain),
            low=low,
            high=high,
            curved=local(rows),
            jerk=np.concatenate(limits),
            of=np.tile(np.arange(self.degree), rows.shape[1] // self.degree),
            raised=local(raised(on, self.degree - 1)),
            round=local(vectors),
            radius=radius,
            margin=margin,
            round_of=points,
        )

    def _motion(self) -> tuple[FloatArray, FloatArray]:
        """Rows of the accelerations and jerks of the limited joints, joint after joint."""
        grid, degree = self.mesh.grid, self.degree
        n, joints = len(grid), self.joints
        found = (
            np.empty((n, len(joints[0]) * (degree + 1), 3)),
            np.empty((n, len(joints[1]) * degree, 3)),
        )
        powers = to_bernstein(degree), to_bernstein(degree - 1)
        path, on = grid.joint_path, self.basis
        motion_rows(
            path.coefficients, path.breaks, grid.piece, grid.s, on, degree, powers, joints, found
        )
        return found

    def _plain(self, acceleration: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """Rows with fixed bounds: ds², accelerations, and the rows of other constraints."""
        n, bounds, on = len(self.mesh.grid), self.bounds, self.basis
        none = np.full((n, 3), np.inf)
        top = np.min([none, self._speed_ceiling(), *self.ceilings], axis=0)
        ends = [on.at_end(e) for e in range(2)]
        rows, low, high = [on.points], [-none], [top]
        if bounds is not None:
            least = np.where(bounds.least > 0, bounds.least, -np.inf)
            low = [np.broadcast_to(least[:, None], (n, 3))]
            high = [np.minimum(top, bounds.x[:, None])]
            most = np.stack([bounds.u, bounds.u, np.abs(bounds.skew)], axis=1)
            rows.append(np.stack([ends[0][1], ends[1][1], on.slope], axis=1))
            low.append(-most)
            high.append(most)
        rows.append(acceleration)
        for sign, out in ((-1, low), (1, high)):
            bound = self.bounded[(sign + 1) // 2][:, self.joints[0]]
            out.append(np.repeat(sign * bound, self.degree + 1, axis=1))
        for y in self.general:
            for e in range(2):
                square, rate = (x[:, None] for x in ends[e])
                rows.append(y.a[e][..., None] * rate + y.b[e][..., None] * square)
                low.append(y.low[e] + y.margin)
                high.append(y.high[e] - y.margin)
        bottom, top = np.concatenate(low, axis=1), np.concatenate(high, axis=1)
        self._bound_next_to_ramps(top)
        return np.concatenate(rows, axis=1), bottom, top

    def _round(self) -> tuple[FloatArray, FloatArray, FloatArray, IntArray]:
        """Round rows, (n, l, 3, 3), their radii and margins, (n, l), and control points, (l,)."""
        n = len(self.mesh.grid)
        vectors, radius = [np.zeros((n, 0, 3, 3))], []
        for both, most in self.round:
            vectors.append(both)
            radius += [most] * both.shape[1]
        of, margin = [-1] * len(radius), [np.zeros(n)] * len(radius)
        if self.tool is not None:
            vectors.append(self.tool.rows(self.basis))
            left_out = np.zeros(n)
            if self.bounds is not None:
                left_out = self.tool.margin(self.bounds)
                share = left_out * np.sqrt(self.bounds.x) / self.jerk.tool
                self.lost = np.maximum(self.lost, share)
            of += range(DEGREE + 1)
            radius += [np.full(n, self.jerk.tool)] * (DEGREE + 1)
            margin += [left_out] * (DEGREE + 1)
        none = np.zeros((n, 0))
        return (
            np.concatenate(vectors, axis=1),
            np.stack(radius, axis=1) if radius else none,
            np.stack(margin, axis=1) if margin else none,
            np.array(of, dtype=np.intp),
        )

    def _speed_ceiling(self) -> FloatArray:
        """Bounds of the control points of a under joint velocity limits, (n, 3)."""
        limited = np.isfinite(self.speeds)
        if not limited.any():
            return np.full((len(self.mesh.grid), 3), np.inf)
        width, limit = self.mesh.grid.width[:, None], self.speeds[limited]
        bulge = width**2 / 8 * self.path.third[:, limited]
        # |q'| over its limit lies below a line, and the tangent of 1 / line² below that.
        first, last = (np.abs(x[:, limited]) + bulge for x in self.path.first)
        first, last = np.maximum(first / limit, 1e-150), np.maximum(last / limit, 1e-150)
        middle = (first + last) / 2
        change = (last - first) / middle
        level = 1 / np.maximum(first, last) ** 2
        tangent = 1 / middle**2
        steep = np.abs(change) > 1 - LEAST_SHARE
        points = [
            np.where(steep, level, tangent * (1 + change)),
            np.where(steep, level, tangent),
            np.where(steep, level, tangent * (1 - change)),
        ]
        return np.asarray(np.min(points, axis=2).T)

    def _bound_next_to_ramps(self, top: FloatArray) -> None:
        """Lower the bounds of ds² where cells of uniform jerk end, so that they keep all limits."""
        mesh, ramps = self.mesh, self.mesh.ramps
        largest = np.full(len(ramps), np.inf)
        np.minimum.at(largest, mesh.cell, self._largest_at_ramps())
        first = np.searchsorted(mesh.cell, np.flatnonzero(ramps > 0) + 1)
        last = np.searchsorted(mesh.cell, np.flatnonzero(ramps < 0)) - 1
        top[first, 0] = np.minimum(top[first, 0], largest[ramps > 0])
        top[last, 2] = np.minimum(top[last, 2], largest[ramps < 0])

    def _largest_at_ramps(self) -> FloatArray:
        """Largest ds² at the moving end of cells of uniform jerk, by each of their parts, (m,).

        From rest, `ds² = A (s / h)^(4/3)`. At the end dds is `2 A / 3 h`; the jerk is
        `2 A^1.5 / 9 h²`. Each part is bounded with the speed and acceleration of the end. Parts of
        other cells mean nothing.
        """
        path, width, h = self.path, self.mesh.grid.width, self.mesh.width[self.mesh.cell]
        wide, own = h[:, None], width[:, None]
        first = np.abs(path.first).max(axis=0) + own**2 / 8 * path.third
        second = np.abs(path.second).max(axis=0) + own**2 / 8 * path.fourth
        rate = 2 / (3 * h)
        found = [x.min(axis=1) for x in self.ceilings]
        with np.errstate(divide="ignore", invalid="ignore"):
            found.append(((self.speeds / first) ** 2).min(axis=1))
            pull = second + first * rate[:, None]
            found.append((self.bounded.min(axis=0) / pull).min(axis=1))
            jerk = path.third + 2 * second / wide + 2 / 9 * first / wide**2
            found.append(((self.jerk.joint / jerk) ** (2 / 3)).min(axis=1))
            found.append((self.jerk.path * 4.5 * h**2) ** (2 / 3))
            for y in self.general:
                for sign, room in ((1, y.high), (-1, -y.low)):
                    up = np.maximum(sign * y.a, 0).max(axis=0) * rate[:, None]
                    up += np.maximum(sign * y.b, 0).max(axis=0)
                    left = np.maximum(room.min(axis=0) - y.margin, 0)
                    found.append(np.where(up > 0, left / up, np.inf).min(axis=1))
            if self.tool is not None:
                found.append(self.tool.largest_at_ramps(self.jerk.tool, h))
            found += [radius / np.hypot(most, rate) for most, radius in self.at_ramps]
            if self.bounds is not None:
                found += [self.bounds.x, self.bounds.u / rate]
        return np.asarray(np.nanmin(found, axis=0))


def control_points(mesh: Mesh) -> tuple[FloatArray, FloatArray]:
    """Rows of the first and last control point of ds² on every cell, (n, 3) each.

    Inside a section both are means of the neighbours, so that ds² has a continuous slope. Next to a
    cell of uniform jerk they have its slope, `4 A / 3 h`; at other ends they are given.
    """
    width = mesh.width
    begin, end = np.zeros((2, len(width), 3))
    total = width[:-1] + width[1:]
    begin[1:, 0], begin[1:, 1] = width[1:] / total, width[:-1] / total
    end[:-1, 1], end[:-1, 2] = width[1:] / total, width[:-1] / total
    first, last = mesh.sections[:-1], mesh.sections[1:] - 1
    begin[first], end[last] = (1, 0, 0), (0, 0, 1)
    for rows, ramp, step in ((begin, first, 1), (end, last, -1)):
        ramp = ramp[mesh.at_rest[:, 0 if step > 0 else 1]]
        near = ramp + step
        rows[near] = 0
        rows[near, 1] = 1 / (1 + 2 * width[near] / (3 * width[ramp]))
    return begin, end


def _degree(coefficients: FloatArray) -> int:
    """Degree of a joint path, at least 3."""
    used = np.flatnonzero(coefficients.any(axis=(0, 2)))
    return max(3, int(used[-1]) if len(used) else 3)
