"""What a constraint tells the kernel.

On an interval of the grid the planner moves with a path acceleration `u = dds` that is linear in
s with a given slope, the skew. A constraint says what that means at both ends of every interval:

- a ceiling: the largest x at either end;
- rows: `low <= a u + b x <= high` at the interval's start, with x there, and at its end;
- a disc: `(c x)² + u² <= r²` at either end.

A constraint needs to define only what it has. What it returns is already narrowed so that what
holds at both ends holds between them (docs/concepts/optimal.md has the proof); to bound what
happens between the ends it is told how large x and u can get.
"""

from __future__ import annotations

import sys
import threading
from dataclasses import dataclass
from functools import cached_property

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.motion import JointPath, PathLaw
from armcontour.timing.constraints._rows import derivatives
from armcontour.timing.grid import Grid
from armcontour.timing.limit_use import States, quantity


@dataclass(frozen=True, slots=True)
class JointDerivatives:
    """Derivatives of the joint path on a grid.

    Args:
        first: dq_ds at the starts (index 0) and ends (1) of all intervals, (2, n, dof).
        second: d2q_ds2 there, (2, n, dof).
        third: Bound of |d3q_ds3| on each interval, (n, dof).
        fourth: Bound of |d4q_ds4| on each interval, (n, dof).
    """

    first: FloatArray
    second: FloatArray
    third: FloatArray
    fourth: FloatArray

    @classmethod
    def on(cls, grid: Grid) -> JointDerivatives:
        """Those of the grid's joint path."""
        path: JointPath = grid.joint_path
        shape = (len(grid), path.dof)
        block = _memory.take(6 * shape[0] * shape[1])
        arrays = block[: 6 * shape[0] * shape[1]].reshape(6, *shape)
        parts = arrays[0:2], arrays[2:4], arrays[4], arrays[5]
        derivatives(path.coefficients, path.breaks, grid.piece, grid.s, *parts)
        return cls(*parts)


class _Memory(threading.local):
    """The block of the last plan, per thread.

    At 5000 points, to take fresh memory from the system costs as much as all the arithmetic.
    """

    block: FloatArray | None = None

    def take(self, size: int) -> FloatArray:
        """A block of at least `size` numbers that nobody else refers to."""
        block = self.block
        if block is not None and block.size >= size and sys.getrefcount(block) == UNUSED:
            return block
        block = np.empty(size)
        self.block = block if size <= MOST_KEPT else None
        return block


_memory = _Memory()
# A block of more numbers than this (16 MB) is not kept.
MOST_KEPT = 2_000_000
# References to a block while it is looked at: the attribute, the local name, the argument.
UNUSED = 3


@dataclass(frozen=True, slots=True)
class Bounds:
    """How large things can get on each interval, whatever the plan.

    Args:
        x: Largest ds² [m²/s²], (n,).
        u: Largest |dds| [m/s²], (n,).
        skew: Slope of dds over s [1/s²], (n,).
        least: Smallest ds², (n,) [m²/s²]; kept if any constraint is `bracketed`.
    """

    x: FloatArray
    u: FloatArray
    skew: FloatArray
    least: FloatArray


@dataclass(frozen=True, slots=True)
class Ceiling:
    """Largest x.

    Args:
        x: At the starts and ends of all intervals, (2, n).
        lost: Largest share of it that margins have taken on each interval, (n,); None for none.
    """

    x: FloatArray
    lost: FloatArray | None = None


@dataclass(frozen=True, slots=True)
class Rows:
    """Linear constraints at the starts (index 0) and ends (1) of all intervals.

    Args:
        a: Coefficients of u, (2, n, rows).
        b: Coefficients of x, (2, n, rows).
        low: Lower bounds, (2, n, rows).
        high: Upper bounds, (2, n, rows).
        margin: What both bounds are drawn in by on each interval, (n, rows).
    """

    a: FloatArray
    b: FloatArray
    low: FloatArray
    high: FloatArray
    margin: FloatArray


@dataclass(frozen=True, slots=True)
class Disc:
    """A round constraint.

    Args:
        c: At the starts and ends of all intervals [1/m], (2, n).
        r: Radius [m/s²], (n,).
    """

    c: FloatArray
    r: FloatArray


@dataclass(frozen=True)
class IntervalEnds:
    """A plan at the starts (index 0) and ends (1) of all intervals.

    Args:
        arm: The arm.
        law: The plan.
        grid: Its intervals.
    """

    arm: Arm
    law: PathLaw
    grid: Grid

    @cached_property
    def path(self) -> JointDerivatives:
        """Derivatives of the joint path on the grid."""
        return JointDerivatives.on(self.grid)

    @cached_property
    def x(self) -> FloatArray:
        """Square of the path speed, ds² [m²/s²], (2, n)."""
        square = self.law.speeds**2
        return np.stack([square[:-1], square[1:]])

    @cached_property
    def u(self) -> FloatArray:
        """Path acceleration dds [m/s²], (2, n)."""
        rates = self.law.rates
        return np.stack([rates.dds, rates.dds + rates.slope * self.grid.width])

    @cached_property
    def states(self) -> States:
        """The arm at all starts and then at all ends, (2 n, dof)."""
        piece, s = np.tile(self.grid.piece, 2), np.append(self.grid.s[:-1], self.grid.s[1:])
        q = self.grid.joint_path.on_interval(piece, s)
        x, u = self.x[..., None], self.u[..., None]
        dq, ddq = self.path.first * np.sqrt(x), self.path.first * u + self.path.second * x
        return States(self.arm, q, dq.reshape(q.shape), ddq.reshape(q.shape))


class Constraint:
    """One limit along a path; this base limits nothing.

    Attributes:
        name: What people call it, such as "acceleration".
        limit_name: The field of `Limits` that it keeps, whose values are `limit`: then that limit
            says how far it is used. Without, its rows, ceiling and disc do.
        limit: What is allowed; one, or per joint.
        joints: Whether there is one per joint, which explanations then name.
        curved: Whether its rows stand for a curve in x: those of the first pass are made again for
            the plan that comes out.
        bracketed: Whether its rows hold only while x on every interval is from `bounds.least` to
            `bounds.x`, or take much smaller margins then: the planner looks for brackets around its
            plan, on a grid that is finer next to rests.
    """

    name = ""
    limit_name = ""
    limit: float | FloatArray = np.inf
    joints = False
    curved = False
    bracketed = False

    def ceiling(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Ceiling | None:
        """Largest x at the starts and ends of all intervals.

        Args:
            grid: The grid.
            path: Derivatives on it.
            bounds: For what happens between the ends; None in the first pass, where only the ends
                count.
        """
        return None

    def rows(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Rows | None:
        """Linear constraints; arguments as in `ceiling`."""
        return None

    def rows_about(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> Rows | None:
        """Rows of the first pass for a plan near x, one per interval, (n,)."""
        return self.rows(grid, path, None)

    def disc(self, grid: Grid, path: JointDerivatives, bounds: Bounds | None) -> Disc | None:
        """A round constraint; arguments as in `ceiling`."""
        return None

    def largest_u(self, grid: Grid, path: JointDerivatives, x: FloatArray) -> FloatArray | None:
        """Largest |dds| it allows on every interval, given the largest x there, (n,)."""
        return None

    def allowed(self, grid: Grid) -> FloatArray:
        """What there may be of what `limit_name` limits, of a shape that fits (n, joints or 1)."""
        return np.asarray(self.limit)

    def usage(self, ends: IntervalEnds) -> FloatArray:
        """Share of the limit in use on every interval, the larger of both ends.

        Args:
            ends: The plan.

        Returns:
            (n, 1), or (n, joints) where `joints` is true.
        """
        grid, path, x, u = ends.grid, ends.path, ends.x, ends.u
        if self.limit_name:
            found = quantity(self.limit_name, ends.states).reshape(2, len(grid), -1)
            return np.asarray((found / self.allowed(grid)).max(axis=0))
        used = np.zeros((len(grid), 1))
        ceiling = self.ceiling(grid, path, None)
        if ceiling is not None:
            used = np.maximum(used, np.sqrt(x / ceiling.x).max(axis=0)[:, None])
        rows = self.rows(grid, path, None)
        if rows is not None:
            value = rows.a * u[..., None] + rows.b * x[..., None]
            used = np.maximum(used, np.maximum(value / rows.high, value / rows.low).max(axis=0))
        disc = self.disc(grid, path, None)
        if disc is not None:
            used = np.maximum(used, (np.hypot(disc.c * x, u) / disc.r).max(axis=0)[:, None])
        return np.asarray(used)
