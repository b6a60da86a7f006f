"""Reduce long curves to few points, so that the error of the drawing is not visible."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.program import Program

# Largest error of a drawn curve, as a share of the drawing's size, that is not visible.
VISIBLE = 1 / 5000
# Largest number of points in one drawing; more points are loaded, but not visible.
MAX_DRAWN = 20_000
# Largest number of points to choose from, so that any curve is simplified in about a second.
MAX_SAMPLED = 200_000
# Number of evenly spaced points that are always drawn, so that enlarged details show.
EVEN = 4000
# Chords of a full circle.
CHORDS = 96


def outline_points(program: Program) -> FloatArray:
    """Points that draw the contours of a program, with a gap (NaN) after each contour."""
    curves = [x.path(fine_places(x.path)) for x in program.contours]
    gap = np.full((1, program.dimension), np.nan)
    kept = simplify(curves)
    return np.concatenate([y for x, few in zip(curves, kept, strict=True) for y in (x[few], gap)])


def fine_places(path: Path, start: float = 0.0, end: float | None = None) -> FloatArray:
    """Arc lengths along a path [m]: ends of segments, and chords of arcs.

    Args:
        path: The path.
        start: The first arc length [m].
        end: The last arc length [m]; by default the end of the path.
    """
    last = path.length if end is None else end
    chords = np.ceil(path.curvatures * path.lengths / (2 * np.pi) * CHORDS).astype(int)
    inner = [
        path.breaks[i] + path.lengths[i] * np.arange(1, chords[i]) / chords[i]
        for i in np.flatnonzero(chords > 1)
    ]
    places = np.union1d(path.breaks, np.concatenate(inner)) if inner else path.breaks
    kept = places[(places > start) & (places < last)]
    return np.concatenate([[start], kept, [last]])


def simplify(
    curves: Sequence[FloatArray],
    most: int = MAX_DRAWN,
    *,
    even: int = EVEN,
    visible: float | None = None,
) -> list[IntArray]:
    """Choose points of curves, so that lines between these points show the curves.

    Every part between two chosen points is split at its largest distance from the line between
    them, all parts at once, until no distance is visible or the number of points is reached
    (Ramer, Douglas and Peucker).

    Args:
        curves: Points, (n, dimension) each.
        most: Largest number of points; the ends of every curve are always chosen.
        even: Approximate number of evenly spaced points that are always chosen.
        visible: Largest distance that is not visible; by default a share of the size of all curves.

    Returns:
        Indices of the chosen points of every curve.
    """
    step = max(1, sum(map(len, curves)) // MAX_SAMPLED)
    sampled = [np.append(np.arange(0, len(x) - 1, step), len(x) - 1) for x in curves]
    points = np.concatenate([x[at] for x, at in zip(curves, sampled, strict=True)])
    lasts = np.cumsum([len(x) for x in sampled])
    kept = np.zeros(len(points), dtype=bool)
    kept[np.append(0, lasts[:-1])] = kept[lasts - 1] = True
    # Evenly spaced points from the start: a spiral would be split one turn at a time.
    kept[:: max(1, len(points) // even)] = True
    ends = np.flatnonzero(kept)
    within = ~np.isin(ends[:-1], lasts - 1)
    start, end = ends[:-1][within], ends[1:][within]
    size = float(np.ptp(points, axis=0).max())
    invisible = (VISIBLE * size if visible is None else visible) ** 2
    room = most - int(kept.sum())
    while room > 0:
        long = end - start > 1
        start, end = start[long], end[long]
        if not len(start):
            break
        off, middle = _farthest(points, start, end)
        split = np.flatnonzero(off > invisible)
        if len(split) > room:
            split = split[np.argsort(-off[split], kind="stable")[:room]]
        start, middle, end = start[split], middle[split], end[split]
        kept[middle] = True
        room -= len(split)
        start, end = np.concatenate([start, middle]), np.concatenate([middle, end])
    parts = np.split(kept, lasts[:-1])
    return [at[which] for at, which in zip(sampled, parts, strict=True)]


def _farthest(points: FloatArray, start: IntArray, end: IntArray) -> tuple[FloatArray, IntArray]:
    """Largest squared distance of curves from the lines between two of their points, and where.

    Args:
        points: Points of all curves, (n, dimension).
        start: Indices of the first points of the lines.
        end: Indices of the last points of the lines.
    """
    counts = end - start - 1
    first = np.cumsum(counts) - counts
    of = np.repeat(np.arange(len(start)), counts)
    inner = np.arange(len(of)) - first[of] + start[of] + 1
    away = points[inner] - points[start][of]
    along = points[end] - points[start]
    square = np.einsum("ij,ij->i", along, along)
    # A line of length 0, of a closed curve, is a point.
    along = along / np.where(square > 0, square, np.inf)[:, None]
    share = np.clip(np.einsum("ij,ij->i", away, along[of]), 0.0, 1.0)
    away -= share[:, None] * (points[end] - points[start])[of]
    off = np.einsum("ij,ij->i", away, away)
    largest = np.maximum.reduceat(off, first)
    at = np.flatnonzero(off == largest[of])
    _, which = np.unique(of[at], return_index=True)
    return largest, inner[at[which]]
