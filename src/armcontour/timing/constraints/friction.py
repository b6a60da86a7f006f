"""Lines that stand for a square root, which the planner's linear rows do not know.

Viscous friction is `viscous q' sqrt(x)`. On every interval the root is bounded from above and from
below by one line each, `offset + slope x`, wherever x is within a bracket.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray

# Keeps divisions finite where a bracket is empty: the root of it is far below any path speed.
TINY = 1e-300


@dataclass(frozen=True, slots=True)
class Lines:
    """`offset + slope x` on every interval.

    Args:
        offset: (n, rows).
        slope: (n, rows).
    """

    offset: FloatArray
    slope: FloatArray

    def where(self, condition: BoolArray, other: Lines) -> Lines:
        """These lines where the condition holds, the others elsewhere."""
        return Lines(
            np.where(condition, self.offset, other.offset),
            np.where(condition, self.slope, other.slope),
        )


def chord(least: FloatArray, most: FloatArray) -> Lines:
    """Below the root of x for all x from `least` to `most`, (n, 1) each; above it elsewhere."""
    low, high = np.sqrt(least), np.sqrt(np.maximum(most, TINY))
    return Lines(low * high / (low + high), 1 / (low + high))


def tangent(least: FloatArray, most: FloatArray, cap: FloatArray) -> Lines:
    """Above the root of x from `least` on, near it up to `most`; the offset is at most `cap`.

    The tangent that is as far above the root at `least` as at `most`. If its offset is more than
    `cap`, the tangent of offset `cap`, at a smaller x; if that x would be below `least`, the
    steeper line of offset `cap` that meets the root at `least`.

    Args:
        least: Smallest x, (n, 1).
        most: Largest x, (n, 1).
        cap: Above zero, (n, rows).
    """
    low, high = np.sqrt(least), np.sqrt(np.maximum(most, TINY))
    offset = np.minimum((low + high) / 4, cap)
    with np.errstate(divide="ignore", invalid="ignore"):
        slope = np.where(offset >= low / 2, 1 / (4 * offset), (low - offset) / least)
    return Lines(offset, np.asarray(slope))
