"""Lines that bound a square root, because the rows of the planner are linear in x.

Viscous friction is `viscous q' sqrt(x)`. On every interval, one line bounds the root from above and
one from below, `offset + slope x`, while x is within a bracket.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray

# Keeps divisions finite where a bracket is empty; its square root is far below any path speed.
TINY = 1e-300


@dataclass(frozen=True, slots=True)
class Lines:
    """A line `offset + slope x` on every interval.

    Args:
        offset: Values at x = 0 [m/s], (n, rows).
        slope: Slopes over x [s/m], (n, rows).
    """

    offset: FloatArray
    slope: FloatArray

    def where(self, condition: BoolArray, other: Lines) -> Lines:
        """These lines where the condition is true, the other lines elsewhere."""
        return Lines(
            np.where(condition, self.offset, other.offset),
            np.where(condition, self.slope, other.slope),
        )


def chord(least: FloatArray, most: FloatArray) -> Lines:
    """Lines below the root of x for x from `least` to `most` [m²/s²], (n, 1) each."""
    low, high = np.sqrt(least), np.sqrt(np.maximum(most, TINY))
    return Lines(low * high / (low + high), 1 / (low + high))


def tangent(least: FloatArray, most: FloatArray, cap: FloatArray) -> Lines:
    """Lines above the root of x from `least` on, near the root up to `most`.

    The line is the tangent that is as far above the root at `least` as at `most`. If its offset
    exceeds `cap`, the line is the tangent of offset `cap`, at a smaller x. If that x is below
    `least`, the line is the steeper one of offset `cap` that meets the root at `least`.

    Args:
        least: Smallest x [m²/s²], (n, 1).
        most: Largest x [m²/s²], (n, 1).
        cap: Largest offset, above zero [m/s], (n, rows).
    """
    low, high = np.sqrt(least), np.sqrt(np.maximum(most, TINY))
    offset = np.minimum((low + high) / 4, cap)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(offset >= low / 2, 1 / (4 * offset), (low - offset) / least)
    return Lines(offset, np.asarray(slope))
