"""Functions of joint motion that have no derivatives, sampled on the grid of a plan.

The function is sampled at the ends and in the middle of every interval. Each sample is computed
once for all passes and all grids of a plan: most points of coarser and finer grids are points of
the grid itself.
"""

from __future__ import annotations

from collections.abc import Callable

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.motion import JointPath
from armcontour.timing.constraints._rows import ROUNDING
from armcontour.timing.constraints.base import Bounds
from armcontour.timing.grid import Grid

# Called with q, dq_ds and d2q_ds2, (n, dof) each; returns the values, (n, ...).
OfPath = Callable[[FloatArray, FloatArray, FloatArray], FloatArray]

# Safety factor of the rise above the chord that is measured in the middle of an interval.
MARGIN = 2.0


class Sampled:
    """A function of joint motion along a path, with the samples computed so far.

    Args:
        function: Called with joint positions and their first and second derivatives over s.
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
        # The left side of a break has the key of the next smaller floating-point number.
        ends[last] = np.nextafter(ends[last], -np.inf)
        return np.stack([self._at(grid, grid.s[:-1]), self._at(grid, ends)])

    def in_middles(self, grid: Grid) -> FloatArray:
        """Values in the middles of all intervals, (n, ...)."""
        return self._at(grid, (grid.s[:-1] + grid.s[1:]) / 2)

    def _at(self, grid: Grid, keys: FloatArray) -> FloatArray:
        """Values at one arc length in each interval [m], (n,); computes those not known yet."""
        if self._path is not grid.joint_path:
            self._path, self._keys = grid.joint_path, np.empty(0)
        known = self._places(keys)
        fresh = self._keys[known] != keys if len(self._keys) else np.ones(len(keys), dtype=bool)
        if fresh.any():
            self._add_samples(grid.joint_path, keys[fresh], grid.piece[fresh])
            known = self._places(keys)
        return np.asarray(self._values[known])

    def _places(self, keys: FloatArray) -> IntArray:
        """Indices of keys in the sorted keys of the samples."""
        return np.minimum(np.searchsorted(self._keys, keys), max(len(self._keys) - 1, 0))

    def _add_samples(self, path: JointPath, keys: FloatArray, piece: IntArray) -> None:
        """Compute and store samples at arc lengths [m] in given pieces of the joint path."""
        values = self._function(*(path.on_interval(piece, keys, order) for order in (0, 1, 2)))
        if len(self._keys):
            keys = np.concatenate([self._keys, keys])
            values = np.concatenate([self._values, values])
        order = np.argsort(keys, kind="stable")
        self._keys, self._values = keys[order], values[order]


def rise(grid: Grid, ends: FloatArray, middle: FloatArray) -> FloatArray:
    """Bound of the distance of a smooth quantity from its chord on every interval, (n, ...).

    The sample in the middle is off the chord by `width² / 8 |f''|`. Near an inflection this misses
    the third derivative, which the neighbours show: the largest |f''| of the three intervals
    counts.

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
    """Bound of the rise of `a u + b x + c` above its chord on every interval, (n, rows).

    Args:
        grid: The grid.
        a: Coefficients of u at the ends, (2, n, rows).
        b: Coefficients of x at the ends, (2, n, rows).
        rises: Bounds of the distances of a, b and c from their chords, (n, rows) each.
        bounds: Bounds of x and u.
    """
    u, x, width = bounds.u[:, None], bounds.x[:, None], grid.width[:, None]
    skew = np.abs(bounds.skew[:, None] * width)
    found = rises[0] * u + rises[1] * x + rises[2]
    # Add the products of two slopes, and the error of u from rounding of x.
    found = found + np.abs(b[1] - b[0]) * width / 2 * u
    found += skew / 4 * (np.abs(a[1] - a[0]) + np.abs(b).max(axis=0) * width)
    found += ROUNDING * x / width * np.abs(a).max(axis=0)
    return np.asarray(found)
