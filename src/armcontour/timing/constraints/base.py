"""What a constraint tells the kernel.

On an interval of the grid the planner moves with one path acceleration `u = dds`, so that
`x = ds²` is linear in s. A constraint says what that means at both ends of every interval:

- rows: `low <= a u + b x <= high` at the interval's start, with x there, and at its end;
- a ceiling: the largest x at either end;
- a disc: `(c x)² + u² <= r²` at either end.

Its bounds are already narrowed so that what holds at both ends holds between them (see
docs/concepts/optimal.md). To bound what happens between, it may use how large x and u can get.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Protocol

from armcontour._checks import FloatArray
from armcontour.timing.grid import Grid


@dataclass(frozen=True, slots=True)
class Bounds:
    """How large things get on each interval, whatever the plan: for what happens between points.

    Args:
        x: Largest ds² [m²/s²], (n,).
        u: Largest |dds| [m/s²], (n,).
    """

    x: FloatArray
    u: FloatArray


@dataclass(frozen=True, slots=True)
class Rows:
    """Linear constraints at the starts (index 0) and ends (index 1) of all intervals.

    Args:
        a, b: Coefficients of u and x, (2, n, rows).
        low, high: Bounds, (2, n, rows).
    """

    a: FloatArray
    b: FloatArray
    low: FloatArray
    high: FloatArray


@dataclass(frozen=True, slots=True)
class Disc:
    """Round constraints: c at the starts and ends of all intervals (2, n), and one radius (n,)."""

    c: FloatArray
    r: FloatArray


class Constraint(Protocol):
    """One limit along a path.

    Attributes:
        name: What people call it, such as "acceleration".
        joints: Whether there is one per joint, which explanations then name.
    """

    name: str
    joints: bool

    def ceiling(self, grid: Grid) -> FloatArray | None:
        """Largest x at the starts and ends of all intervals, (2, n), or None."""

    def rows(self, grid: Grid, bounds: Bounds) -> Rows | None:
        """Linear constraints, or None."""

    def disc(self, grid: Grid) -> Disc | None:
        """A round constraint, or None."""

    def usage(self, grid: Grid, x: FloatArray, u: FloatArray) -> FloatArray:
        """Share of the limit in use: largest of both ends, (n, 1) or (n, joints).

        Args:
            grid: The grid.
            x: ds² at the grid points, (n + 1,).
            u: dds on the intervals, (n,).
        """
