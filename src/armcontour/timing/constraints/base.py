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

import numpy as np

from armcontour._checks import FloatArray
from armcontour.motion import JointPath
from armcontour.timing.constraints._rows import derivatives
from armcontour.timing.grid import Grid


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


class Constraint:
    """One limit along a path; this base limits nothing.

    Attributes:
        name: What people call it, such as "acceleration".
        joints: Whether there is one per joint, which explanations then name.
        curved: Whether its rows stand for a curve in x: those of the first pass are made again for
            the plan that comes out.
        bracketed: Whether its rows hold only while x on every interval is from `bounds.least` to
            `bounds.x`, or take much smaller margins then: the planner looks for brackets around its
            plan, on a grid that is finer next to rests.
    """

    name = ""
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

    def usage(
        self, grid: Grid, path: JointDerivatives, x: FloatArray, u: FloatArray, skew: FloatArray
    ) -> FloatArray:
        """Share of the limit in use on every interval, the larger of both ends.

        Args:
            grid: The grid.
            path: Derivatives on it.
            x: ds² at the grid points, (n + 1,).
            u: dds at the starts of the intervals, (n,).
            skew: Its slope over s, (n,).

        Returns:
            (n, 1), or (n, joints) where `joints` is true.
        """
        ends = np.stack([x[:-1], x[1:]])
        u_ends = np.stack([u, u + skew * grid.width])
        used = np.zeros((len(grid), 1))
        ceiling = self.ceiling(grid, path, None)
        if ceiling is not None:
            used = np.maximum(used, np.sqrt(ends / ceiling.x).max(axis=0)[:, None])
        rows = self.rows(grid, path, None)
        if rows is not None:
            value = rows.a * u_ends[..., None] + rows.b * ends[..., None]
            used = np.maximum(used, np.maximum(value / rows.high, value / rows.low).max(axis=0))
        disc = self.disc(grid, path, None)
        if disc is not None:
            used = np.maximum(used, (np.hypot(disc.c * ends, u_ends) / disc.r).max(axis=0)[:, None])
        return np.asarray(used)
