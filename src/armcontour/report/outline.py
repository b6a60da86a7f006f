"""Few points that draw long curves: those from which the curve between them hardly leaves."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.program import Program

# What is off by less than this share of a drawing's size is not seen.
UNSEEN = 1 / 5000
# More points than this in one drawing are loaded, but hardly seen.
MOST_DRAWN = 20_000
# Points that may be looked at, so that a curve of any length is drawn in about a second.
MOST_LOOKED_AT = 200_000
# So many points, evenly spread, are drawn in any case: what is small shows when enlarged.
EVEN = 4000
# Evenly spread places along a program that are drawn with the ends of its segments.
DRAWN_PLACES = 800
# Chords of a whole circle, so that it looks round.
CHORDS = 96


def outline_points(program: Program) -> FloatArray:
    """Points that draw the contours of a program, with gaps (NaN) after them."""
    each = DRAWN_PLACES // len(program.contours)
    return outlines([finely(x.path, least=each) for x in program.contours])


def finely(
    path: Path, begin: float = 0.0, end: float | None = None, *, least: int = 0
) -> FloatArray:
    """Points along a path from one place to another: ends of segments, and arcs as chords.

    Args:
        path: The path.
        begin: The first place [m].
        end: The last place [m]; by default the end of the path.
        least: Of a path with fewer segments, so many places besides, evenly spread.
    """
    last = path.length if end is None else end
    chords = np.ceil(path.curvatures * path.lengths / (2 * np.pi) * CHORDS).astype(int)
    inner = [
        path.breaks[i] + path.lengths[i] * np.arange(1, chords[i]) / chords[i]
        for i in np.flatnonzero(chords > 1)
    ]
    if len(path) <= least:
        inner.append(np.linspace(0.0, path.length, least))
    places = np.union1d(path.breaks, np.concatenate(inner)) if inner else path.breaks
    kept = places[(places > begin) & (places < last)]
    return path(np.concatenate([[begin], kept, [last]]))


def outlines(curves: Sequence[FloatArray]) -> FloatArray:
    """Several curves as one with gaps (NaN) between them, in as many points as are seen."""
    kept = simplify(curves)
    gap = np.full((1, curves[0].shape[1]), np.nan)
    return np.concatenate([y for x, few in zip(curves, kept, strict=True) for y in (x[few], gap)])


def simplify(
    curves: Sequence[FloatArray], most: int = MOST_DRAWN, *, even: int = EVEN
) -> list[IntArray]:
    """Which points of curves to draw, so that nothing that is seen is off.

    Every stretch between two kept points is split where it leaves the line between them most, all
    of them at once, until none does so visibly or there are enough.

    Args:
        curves: Points, (n, dimension) each.
        most: Number of points of all; every curve has its ends in any case.
        even: About so many, evenly spread over all, are kept in any case.
    """
    step = max(1, sum(map(len, curves)) // MOST_LOOKED_AT)
    looked = [np.append(np.arange(0, len(x) - 1, step), len(x) - 1) for x in curves]
    points = np.concatenate([x[at] for x, at in zip(curves, looked, strict=True)])
    lasts = np.cumsum([len(x) for x in looked])
    kept = np.zeros(len(points), dtype=bool)
    kept[np.append(0, lasts[:-1])] = kept[lasts - 1] = True
    # To begin with, too: a spiral is else split a turn at a time.
    kept[:: max(1, len(points) // even)] = True
    ends = np.flatnonzero(kept)
    within = ~np.isin(ends[:-1], lasts - 1)
    begin, end = ends[:-1][within], ends[1:][within]
    unseen = (UNSEEN * float(np.ptp(points, axis=0).max())) ** 2
    room = most - int(kept.sum())
    while room > 0:
        long = end - begin > 1
        begin, end = begin[long], end[long]
        if not len(begin):
            break
        off, middle = _farthest(points, begin, end)
        split = np.flatnonzero(off > unseen)
        if len(split) > room:
            split = split[np.argsort(-off[split], kind="stable")[:room]]
        begin, middle, end = begin[split], middle[split], end[split]
        kept[middle] = True
        room -= len(split)
        begin, end = np.concatenate([begin, middle]), np.concatenate([middle, end])
    parts = np.split(kept, lasts[:-1])
    return [at[which] for at, which in zip(looked, parts, strict=True)]


def _farthest(points: FloatArray, begin: IntArray, end: IntArray) -> tuple[FloatArray, IntArray]:
    """How far curves leave the lines between two of their points at most, squared, and where."""
    counts = end - begin - 1
    first = np.cumsum(counts) - counts
    of = np.repeat(np.arange(len(begin)), counts)
    inner = np.arange(len(of)) - first[of] + begin[of] + 1
    away = points[inner] - points[begin][of]
    along = points[end] - points[begin]
    square = np.einsum("ij,ij->i", along, along)
    # Where a curve comes back to where it began, its distance from there counts.
    along = along / np.where(square > 0, square, np.inf)[:, None]
    share = np.clip(np.einsum("ij,ij->i", away, along[of]), 0.0, 1.0)
    away -= share[:, None] * (points[end] - points[begin])[of]
    off = np.einsum("ij,ij->i", away, away)
    largest = np.maximum.reduceat(off, first)
    at = np.flatnonzero(off == largest[of])
    _, which = np.unique(of[at], return_index=True)
    return largest, inner[at[which]]
