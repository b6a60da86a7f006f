"""Reduction of long curves to few points without a visible deviation."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.geometry import Path

# Maximum number of points in a drawing; more points increase the file but are not visible.
MAX_DRAWN = 20_000
# Maximum number of points that `simplify` examines, so that it takes at most about a second.
MAX_SAMPLED = 200_000
# Number of chords of a full circle.
CHORDS = 96


def fine_places(path: Path, start: float = 0.0, end: float | None = None) -> FloatArray:
    """Arc lengths of the drawn points of a path: ends of segments, and points on arcs [m], (n,)."""
    last = path.length if end is None else end
    chords = np.ceil(path.curvatures * path.lengths / (2 * np.pi) * CHORDS).astype(int)
    inner = [
        path.breaks[i] + path.lengths[i] * np.arange(1, chords[i]) / chords[i]
        for i in np.flatnonzero(chords > 1)
    ]
    places = np.union1d(path.breaks, np.concatenate(inner)) if inner else path.breaks
    inside = places[(places > start) & (places < last)]
    return np.concatenate([[start], inside, [last]])


def simplify(
    curves: Sequence[FloatArray],
    count: int = MAX_DRAWN,
    *,
    even: int,
    visible: float,
) -> list[IntArray]:
    """Select about `count` points of all curves for a drawing; returns the indices for each curve.

    In each iteration, every chord is split at the point with the largest distance from the chord,
    until no distance exceeds `visible` (Ramer, Douglas and Peucker). About `even` of the points are
    evenly spaced.
    """
    step = max(1, sum(map(len, curves)) // MAX_SAMPLED)
    sampled = [np.append(np.arange(0, len(x) - 1, step), len(x) - 1) for x in curves]
    points = np.concatenate([x[at] for x, at in zip(curves, sampled, strict=True)])
    lasts = np.cumsum([len(x) for x in sampled])
    chosen = np.zeros(len(points), dtype=bool)
    chosen[np.append(0, lasts[:-1])] = chosen[lasts - 1] = True
    # Evenly spaced points reduce the number of iterations: without them, a spiral is split turn by
    # turn.
    chosen[:: max(1, len(points) // even)] = True
    ends = np.flatnonzero(chosen)
    within = ~np.isin(ends[:-1], lasts - 1)
    start, end = ends[:-1][within], ends[1:][within]
    invisible = visible**2
    room = count - int(chosen.sum())
    while room > 0:
        long = end - start > 1
        start, end = start[long], end[long]
        if not len(start):
            break
        distance, middle = _farthest(points, start, end)
        split = np.flatnonzero(distance > invisible)
        if len(split) > room:
            split = split[np.argsort(-distance[split], kind="stable")[:room]]
        start, middle, end = start[split], middle[split], end[split]
        chosen[middle] = True
        room -= len(split)
        start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
    parts = np.split(chosen, lasts[:-1])
    return [at[which] for at, which in zip(sampled, parts, strict=True)]


def _farthest(points: FloatArray, start: IntArray, end: IntArray) -> tuple[FloatArray, IntArray]:
    """Squared distance of the farthest point from each chord, and index of the point, (m,) each."""
    counts = end - start - 1
    first = np.cumsum(counts) - counts
    line = np.repeat(np.arange(len(start)), counts)
    inner = np.arange(len(line)) - first[line] + start[line] + 1
    away = points[inner] - points[start][line]
    along = points[end] - points[start]
    square = np.einsum("ij,ij->i", along, along)
    # A chord of length 0, such as the chord of a closed curve, is treated as a point.
    along = along / np.where(square > 0, square, np.inf)[:, None]
    share = np.clip(np.einsum("ij,ij->i", away, along[line]), 0.0, 1.0)
    away -= share[:, None] * (points[end] - points[start])[line]
    squares = np.einsum("ij,ij->i", away, away)
    largest = np.maximum.reduceat(squares, first)
    candidates = np.flatnonzero(squares == largest[line])
    _, first_of_line = np.unique(line[candidates], return_index=True)
    return largest, inner[candidates[first_of_line]]
