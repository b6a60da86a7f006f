"""Fewer points of long rows, with what stands out kept."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray, IntArray


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
    buckets = max(1, (most - len(kept)) // (2 * len(rows)))
    found = [kept, np.array([0, count - 1]), *(_extremes(x, buckets) for x in rows)]
    return np.unique(np.concatenate(found))


def _extremes(row: FloatArray, buckets: int) -> IntArray:
    """Indices of the smallest and the largest value in each of so many parts of a row."""
    count = len(row)
    width = -(-count // buckets)
    padded = np.nan_to_num(np.pad(row, (0, -count % width), mode="edge")).reshape(-1, width)
    first = np.arange(len(padded)) * width
    both = np.concatenate([first + padded.argmin(axis=1), first + padded.argmax(axis=1)])
    return np.asarray(np.minimum(both, count - 1))


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
