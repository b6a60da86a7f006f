"""Functions of joint motion that have no derivatives, sampled on the grid of a plan.

The function is sampled at the ends and in the middle of every interval.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armcontour._checks import FloatArray
from armcontour.timing.constraints import _sampled
from armcontour.timing.constraints.base import Bounds
from armcontour.timing.grid import Grid

Values = tuple[FloatArray, ...]
# Called with q, dq_ds and d2q_ds2, (n, dof) each; returns one or more quantities, (n, rows) each.
OfPath = Callable[[FloatArray, FloatArray, FloatArray], Values]

# Safety factor of the rise above the chord that is measured in the middle of an interval.
MARGIN = 2.0


class Sampled:
    """Quantities of joint motion on a grid; those on the last grid are kept for all passes.

    Samples of a coarser grid are not looked up for a finer one: that takes longer than to compute
    them again.

    Args:
        function: Called with joint positions and their first and second derivatives over s.
        sparing: Whether values in the middles, which only the rises need, are not kept.
    """

    def __init__(self, function: OfPath, *, sparing: bool = False) -> None:
        self._function, self._sparing = function, sparing
        self._grid: Grid | None = None
        self._found: dict[str, Values] = {}

    def at_ends(self, grid: Grid) -> Values:
        """Values at the starts and ends of all intervals, (2, n, rows) each."""
        return self._once(grid, "ends", self._at_ends)

    def in_middles(self, grid: Grid) -> Values:
        """Values in the middles of all intervals, (n, rows) each."""
        return self._once(grid, "middles", self._in_middles)

    def rises(self, grid: Grid) -> Values:
        """Bounds of the distances from the chords on all intervals, (n, rows) each."""
        return self._once(grid, "rises", self._rises)

    def _once(self, grid: Grid, name: str, compute: Callable[[Grid], Values]) -> Values:
        """What was computed on this grid before, or is computed now."""
        if self._grid is not grid:
            self._grid, self._found = grid, {}
        if name not in self._found:
            self._found[name] = compute(grid)
        return self._found[name]

    def _at_ends(self, grid: Grid) -> Values:
        piece, s, starts = _sampled.places(grid.piece, np.require(grid.s, requirements="W"))
        values = self._function(*grid.joint_path.motion(piece, s))
        return tuple(_sampled.ends_of(x, starts) for x in values)

    def _in_middles(self, grid: Grid) -> Values:
        middle = (grid.s[:-1] + grid.s[1:]) / 2
        return self._function(*grid.joint_path.motion(grid.piece, middle))

    def _rises(self, grid: Grid) -> Values:
        middles = self._in_middles(grid) if self._sparing else self.in_middles(grid)
        return tuple(rise(grid, x, y) for x, y in zip(self.at_ends(grid), middles, strict=True))


def rise(grid: Grid, ends: FloatArray, middle: FloatArray) -> FloatArray:
    """Bound of the distance of a smooth quantity from its chord on every interval, (n, rows).

    The sample in the middle is off the chord by `width² / 8 |f''|`. Near an inflection this misses
    the third derivative, which the neighbours show: the largest |f''| of the three intervals
    counts.

    Args:
        grid: The grid.
        ends: Values at the ends, (2, n, rows).
        middle: Values in the middles, (n, rows).
    """
    found = np.empty(middle.shape)
    _sampled.rises(grid.width, grid.piece, ends, middle, MARGIN, found)
    return found


def bulge(grid: Grid, a: FloatArray, b: FloatArray, rises: Values, bounds: Bounds) -> FloatArray:
    """Bound of the rise of `a u + b x + c` above its chord on every interval, (n, rows).

    Args:
        grid: The grid.
        a: Coefficients of u at the ends, (2, n, rows).
        b: Coefficients of x at the ends, (2, n, rows).
        rises: Bounds of the distances of a, b and c from their chords, (n, rows) each.
        bounds: Bounds of x and u.
    """
    of_a, of_b, of_c = rises
    found, own = np.empty(of_a.shape), (bounds.x, bounds.u, bounds.skew)
    _sampled.bulges(grid.width, a, b, of_a, of_b, of_c, *own, found)
    return found
