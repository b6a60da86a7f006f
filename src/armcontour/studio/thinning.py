"""Fewer points of long rows, with what stands out kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray, IntArray

# Times of a motion that are drawn, whatever happens between them, are so close [s], and at most so
# many: on straight lines between them an arm that accelerates by 20 rad/s² is off by 0.3 mrad.
CLOSE, MOST_EVEN = 10e-3, 2_000
# Charts of short motions have so many at least.
FEWEST_EVEN = 200


def evenly(duration: float) -> FloatArray:
    """Times from 0 to the end of a motion, spread evenly [s].

    Args:
        duration: Duration of the motion [s].
    """
    count = min(MOST_EVEN, max(FEWEST_EVEN, 1 + int(np.ceil(duration / CLOSE))))
    return np.linspace(0.0, duration, count)


def thin(weight: FloatArray, rows: Sequence[FloatArray], most: int) -> IntArray:
    """Indices of the points to keep: heavy ones, and those with extremes of rows nearby.

    Args:
        weight: How much is lost without each point; infinite for points that are always kept, zero
            for points that only extremes keep, (n,).
        rows: Values along the points, (n,) each.
        most: About the largest number of points to keep.
    """
    count = len(weight)
    if count <= most:
        return np.arange(count)
    kept = np.flatnonzero(weight > 0)
    if len(kept) > most // 2:
        heaviest = np.argpartition(weight[kept], -(most // 2))[-(most // 2) :]
        kept = np.union1d(kept[heaviest], np.flatnonzero(np.isinf(weight)))
    stays = np.zeros(count, dtype=bool)
    stays[kept] = stays[0] = stays[-1] = True
    parts = max(1, (most - len(kept)) // (2 * len(rows)))
    width = -(-count // parts)
    table = np.nan_to_num(np.stack(rows))
    # The last part may be shorter than the others.
    whole = count - count % width
    for begin, end in ((0, whole), (whole, count)):
        if begin < end:
            cut = table[:, begin:end].reshape(len(rows), -1, min(width, end - begin))
            first = begin + np.arange(cut.shape[1]) * width
            stays[first + cut.argmin(axis=2)] = True
            stays[first + cut.argmax(axis=2)] = True
    return np.flatnonzero(stays)


def bends(points: FloatArray) -> FloatArray:
    """Distance of every point from the line through its neighbours, 0 at the ends [m], (n,)."""
    found = np.zeros(len(points))
    if len(points) < 3:
        return found
    chord, away = points[2:] - points[:-2], points[1:-1] - points[:-2]
    square = np.einsum("ij,ij->i", chord, chord)
    along = np.einsum("ij,ij->i", away, chord) / np.where(square > 0, square, 1.0)
    found[1:-1] = np.linalg.norm(away - along[:, None] * chord, axis=1)
    return found
