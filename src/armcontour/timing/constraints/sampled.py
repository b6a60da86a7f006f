"""What follows from joint motion by functions that the planner cannot differentiate.

Such quantities are seen at the ends of the grid's intervals and in their middles. Each place is
computed once for all passes and all grids of a plan: most points of a coarse grid, and of one that
was made finer, are points of the grid itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.motion import JointPath
from armcontour.timing.constraints._rows import ROUNDING
from armcontour.timing.constraints.base import Bounds
from armcontour.timing.grid import Grid

# Of q, dq_ds and d2q_ds2, (n, dof) each, whatever is wanted there, (n, ...).
OfPath = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]

# The rise above the chord is seen in the middle of an interval; it counts this many times.
MARGIN = 2.0


class Sampled:
    """A function of joint motion along a path, seen where a grid needs it.

    Args:
        function: Gives what is wanted at joint positions and their derivatives over s.
    """

    def __init__(self, function: OfPath) -> None:
        self._function = function
        self._path: JointPath | None = None
        self._keys = np.empty(0)
        self._values = np.empty(0)

    def at_ends(self, grid: Grid) -> FloatArray:
        """Values at the starts and ends of all intervals, (2, n, ...)."""
        ends = grid.s[1:].copy()
        last = np.append(grid.piece[1:] != grid.piece[:-1], True)
        # The left side of a break is filed one rounding below it.
        ends[last] = np.nextafter(ends[last], -np.inf)
        return np.stack([self._at(grid, grid.s[:-1]), self._at(grid, ends)])

    def in_middles(self, grid: Grid) -> FloatArray:
        """Values in the middles of all intervals, (n, ...)."""
        return self._at(grid, (grid.s[:-1] + grid.s[1:]) / 2)

    def _at(self, grid: Grid, keys: FloatArray) -> FloatArray:
        if self._path is not grid.joint_path:
            self._path, self._keys = grid.joint_path, np.empty(0)
        known = self._places(keys)
        fresh = self._keys[known] != keys if len(self._keys) else np.ones(len(keys), dtype=bool)
        if fresh.any():
            self._learn(grid.joint_path, keys[fresh], grid.piece[fresh])
            known = self._places(keys)
        return np.asarray(self._values[known])

    def _places(self, keys: FloatArray) -> IntArray:
        return np.minimum(np.searchsorted(self._keys, keys), max(len(self._keys) - 1, 0))

    def _learn(self, path: JointPath, keys: FloatArray, piece: IntArray) -> None:
        values = self._function(*(path.on_interval(piece, keys, order) for order in (0, 1, 2)))
        if len(self._keys):
            keys = np.concatenate([self._keys, keys])
            values = np.concatenate([self._values, values])
        order = np.argsort(keys, kind="stable")
        self._keys, self._values = keys[order], values[order]


def rise(grid: Grid, ends: FloatArray, middle: FloatArray) -> FloatArray:
    """Bound of what a smooth quantity departs from its chord on every interval, (n, ...).

    The middle shows `width² / 8 |f''|`. Near an inflection it shows nothing of what the third
    derivative does, but the neighbours' middles do: the most curved of the three counts.

    Args:
        grid: The grid.
        ends: Values at the ends, (2, n, ...).
        middle: Values in the middles, (n, ...).
    """
    square = (grid.width**2).reshape(-1, *(1,) * (middle.ndim - 1))
    bend = MARGIN * np.abs(middle - (ends[0] + ends[1]) / 2) / square
    same = (grid.piece[1:] == grid.piece[:-1]).reshape(-1, *(1,) * (middle.ndim - 1))
    largest = bend.copy()
    np.maximum(largest[1:], np.where(same, bend[:-1], 0.0), out=largest[1:])
    np.maximum(largest[:-1], np.where(same, bend[1:], 0.0), out=largest[:-1])
    return np.asarray(largest * square)


def bulge(
    grid: Grid, a: FloatArray, b: FloatArray, rises: tuple[FloatArray, ...], bounds: Bounds
) -> FloatArray:
    """How far `a u + b x + c` can rise above its chord on every interval, (n, rows).

    Args:
        grid: The grid.
        a: Coefficients of u at the ends, (2, n, rows).
        b: Coefficients of x at the ends, (2, n, rows).
        rises: What a, b and c depart from their chords, (n, rows) each.
        bounds: How large x and u can get.
    """
    u, x, width = bounds.u[:, None], bounds.x[:, None], grid.width[:, None]
    skew = np.abs(bounds.skew[:, None] * width)
    found = rises[0] * u + rises[1] * x + rises[2]
    # Products of two slopes come on top, and what rounding of x makes of u.
    found = found + np.abs(b[1] - b[0]) * width / 2 * u
    found += skew / 4 * (np.abs(a[1] - a[0]) + np.abs(b).max(axis=0) * width)
    found += ROUNDING * x / width * np.abs(a).max(axis=0)
    return np.asarray(found)
