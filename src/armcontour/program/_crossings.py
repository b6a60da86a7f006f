"""Where lines and arcs in the plane cross each other.

A table of pieces has a row for each line or arc; its columns are named below.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour._sampling import number_parts

# Points nearer than this are one [m].
SAME_PLACE = 1e-9
# Sine of the angle between two lines below which they are parallel.
PARALLEL = 1e-12
# Number of pairs of pieces that are intersected at a time, about, which bounds the memory.
PAIRS = 200_000

# Columns of a table of pieces: start x, y, unit tangent x, y, curvature, positive to the left,
# and length.
X, Y, TX, TY, CURVATURE, LENGTH = range(6)
# Points in which two pieces meet, if both were continued: the middle between them, (n, 2), their
# distance from it, (n,), its direction, (n, 2), and whether the pieces lie on one curve, (n,).
_Meeting = tuple[FloatArray, FloatArray, FloatArray, BoolArray]


def points_at(pieces: FloatArray, u: FloatArray, order: int = 0) -> FloatArray:
    """Points of pieces, or their tangents, at distances u from their starts, (n, 2)."""
    angle = pieces[:, CURVATURE] * u
    tangents = pieces[:, TX : TY + 1]
    normals = _left(tangents)
    if order == 1:
        return np.asarray(np.cos(angle)[:, None] * tangents + np.sin(angle)[:, None] * normals)
    along = u * np.sinc(angle / np.pi)
    across = u * (angle / 2) * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(pieces[:, :2] + along[:, None] * tangents + across[:, None] * normals)


@np.errstate(divide="ignore", invalid="ignore")  # Lines have no circles.
def crossings(pieces: FloatArray) -> tuple[IntArray, FloatArray]:
    """All places at which pieces meet each other, their own ends included.

    Args:
        pieces: The pieces, (n, 6).

    Returns:
        The two pieces of each meeting, (m, 2), and how far along each of them it is [m], (m, 2).
    """
    low, high = _boxes(pieces)
    order = np.argsort(low[:, 0])
    # Boxes of later pieces in this order overlap up to the first one that begins too far right.
    last = np.searchsorted(low[order, 0], high[order, 0] + SAME_PLACE, side="right")
    count = np.maximum(last - np.arange(len(order)) - 1, 0)
    parts = np.cumsum(count) // PAIRS
    which, places = [np.empty((0, 2), np.intp)], [np.empty((0, 2))]
    for part in np.unique(parts):
        of, number = number_parts(np.where(parts == part, count, 0))
        i, j = order[of], order[of + 1 + number]
        near = (low[j, 1] <= high[i, 1] + SAME_PLACE) & (low[i, 1] <= high[j, 1] + SAME_PLACE)
        pairs = np.stack([i, j], axis=1)[near]
        points = _common_points(pieces[pairs[:, 0]], pieces[pairs[:, 1]])
        at = np.stack([_places(pieces[x], points) for x in pairs.T], axis=2)
        ends = pieces[pairs, LENGTH][:, None, :]
        row, point = np.nonzero(((at >= -SAME_PLACE) & (at <= ends + SAME_PLACE)).all(axis=2))
        at, ends = at[row, point], ends[row, 0]
        # A place near an end is this end.
        at = np.where(ends - at <= SAME_PLACE, ends, at)
        which.append(pairs[row])
        places.append(np.where(at <= SAME_PLACE, 0.0, at))
    return np.concatenate(which), np.concatenate(places)


def _left(vectors: FloatArray) -> FloatArray:
    """Vectors turned to the left by a right angle, (..., 2)."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of vectors, (...,)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _circles(pieces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Centres and radii of arcs [m], (n, 2) and (n,); not finite for lines."""
    radius = 1 / pieces[:, CURVATURE]
    return pieces[:, :2] + radius[:, None] * _left(pieces[:, TX : TY + 1]), np.abs(radius)


def _boxes(pieces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners of boxes around pieces, (n, 2) each."""
    centers, radii = _circles(pieces)
    sides = centers[:, None] + radii[:, None, None] * [[1, 0], [-1, 0], [0, 1], [0, -1]]
    on_arc = _places(pieces, sides) <= pieces[:, LENGTH, None]
    on_arc &= pieces[:, CURVATURE, None] != 0
    starts = pieces[:, None, :2]
    ends = points_at(pieces, pieces[:, LENGTH])[:, None]
    points = np.concatenate([starts, ends, np.where(on_arc[:, :, None], sides, starts)], axis=1)
    return points.min(axis=1), points.max(axis=1)


def _places(pieces: FloatArray, points: FloatArray) -> FloatArray:
    """Distances along pieces at which these, if continued, come to points on them, (n, m).

    Args:
        pieces: The pieces, (n, 6).
        points: Points of each piece, (n, m, 2).
    """
    offset, tangents = points - pieces[:, None, :2], pieces[:, None, TX : TY + 1]
    along, k = (offset * tangents).sum(axis=2), pieces[:, CURVATURE, None]
    # The direction from the centre: angle 0 at the start, growing along the arc.
    angle = np.arctan2(along * np.abs(k), 1 - _cross(tangents, offset) * k)
    radius = 1 / np.where(k == 0, np.inf, np.abs(k))
    u = np.where(angle < 0, angle + 2 * np.pi, angle) * radius
    # Just before the start, and not after nearly a full turn.
    before = (u > pieces[:, LENGTH, None]) & (2 * np.pi * radius - u <= SAME_PLACE)
    return np.asarray(np.where(k == 0, along, np.where(before, u - 2 * np.pi * radius, u)))


def _common_points(a: FloatArray, b: FloatArray) -> FloatArray:
    """Points that pieces have in common two by two if continued; ends where they run together.

    Returns:
        The points, NaN where there are fewer than four, (n, 4, 2).
    """
    bent = (a[:, CURVATURE] != 0).astype(int) + (b[:, CURVATURE] != 0)
    # A line comes first.
    turned = ((a[:, CURVATURE] != 0) & (b[:, CURVATURE] == 0))[:, None]
    a, b = np.where(turned, b, a), np.where(turned, a, b)
    found = np.full((len(a), 4, 2), np.nan)
    for arcs, meet in enumerate((_two_lines, _line_and_arc, _two_arcs)):
        kind = np.flatnonzero(bent == arcs)
        if not len(kind):
            continue
        middle, half, direction, together = meet(a[kind], b[kind])
        apart = half[:, None] * direction
        found[kind, 0], found[kind, 1] = middle + apart, middle - apart
        same = kind[together]
        ends = [x for p in (a[same], b[same]) for x in (p[:, :2], points_at(p, p[:, LENGTH]))]
        found[same] = np.stack(ends, axis=1)
    # Lines meet in one point.
    found[(bent == 0) & np.isnan(found[:, 2, 0]), 1] = np.nan
    return found


def _two_lines(a: FloatArray, b: FloatArray) -> _Meeting:
    """The point in which two lines meet."""
    along, gap = a[:, TX : TY + 1], b[:, :2] - a[:, :2]
    sine = _cross(along, b[:, TX : TY + 1])
    parallel = np.abs(sine) < PARALLEL
    u = _cross(gap, b[:, TX : TY + 1]) / np.where(parallel, np.nan, sine)
    together = parallel & (np.abs(_cross(along, gap)) <= SAME_PLACE)
    return a[:, :2] + u[:, None] * along, np.zeros(len(a)), along, together


def _line_and_arc(a: FloatArray, b: FloatArray) -> _Meeting:
    """Points in which lines meet circles."""
    (centers, r), tangents = _circles(b), a[:, TX : TY + 1]
    gap = centers - a[:, :2]
    along, across = (gap * tangents).sum(axis=1), _cross(tangents, gap)
    half = np.sqrt(np.maximum((r - across) * (r + across), 0.0))
    half[np.abs(across) > r + SAME_PLACE] = np.nan
    return a[:, :2] + along[:, None] * tangents, half, tangents, np.zeros(len(a), np.bool_)


def _two_arcs(a: FloatArray, b: FloatArray) -> _Meeting:
    """Points in which circles meet."""
    (ca, ra), (cb, rb) = _circles(a), _circles(b)
    gap = cb - ca
    d = np.hypot(gap[:, 0], gap[:, 1])
    together = (d <= SAME_PLACE) & (np.abs(ra - rb) <= SAME_PLACE)
    meet = (d > 0) & (d <= ra + rb + SAME_PLACE) & (d >= np.abs(ra - rb) - SAME_PLACE)
    d = np.where(meet, d, np.nan)
    along = (d * d + (ra - rb) * (ra + rb)) / (2 * d)
    half = np.sqrt(np.maximum((ra - along) * (ra + along), 0.0))
    return ca + (along / d)[:, None] * gap, half, _left(gap) / d[:, None], together
