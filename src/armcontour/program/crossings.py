"""Offsets and crossings of lines and arcs in the plane, for kerfs.

A table of pieces has a row for each line or arc; its columns are named below.
"""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.sampled_data import number_parts

# Points closer than this distance [m] count as equal.
SAME_POINT = 1e-9
# Approximate number of pairs of pieces that are intersected together, which limits the memory.
PAIRS = 200_000

# Columns of a table of pieces: start x, y, unit tangent x, y, curvature (positive to the left) and
# length.
X, Y, TX, TY, CURVATURE, LENGTH = range(6)


def points_at(pieces: FloatArray, u: FloatArray, order: int = 0) -> FloatArray:
    """Points of pieces, or their tangents, at distances u from their starts, (n, 2)."""
    angle = pieces[:, CURVATURE] * u
    tangents = pieces[:, TX : TY + 1]
    normals = rotate_left(tangents)
    if order == 1:
        return np.asarray(np.cos(angle)[:, None] * tangents + np.sin(angle)[:, None] * normals)
    along = u * np.sinc(angle / np.pi)
    across = u * (angle / 2) * np.sinc(angle / (2 * np.pi)) ** 2
    return np.asarray(pieces[:, :2] + along[:, None] * tangents + across[:, None] * normals)


def offset_pieces(pieces: FloatArray, d: float) -> FloatArray:
    """Pieces offset by d to the left [m], (n, 6); length <= 0 if a radius would be negative."""
    # The offset of an arc has the same centre.
    moved, grown = pieces.copy(), 1 - pieces[:, CURVATURE] * d
    moved[:, :2] += d * rotate_left(pieces[:, TX : TY + 1])
    moved[:, CURVATURE] /= np.where(grown > 0, grown, 1.0)
    moved[:, LENGTH] *= grown
    return moved


def turns_between(arriving: FloatArray, leaving: FloatArray) -> FloatArray:
    """Angles from arriving to leaving tangents, positive to the left [rad], (n,)."""
    return np.asarray(np.arctan2(_cross(arriving, leaving), (arriving * leaving).sum(axis=1)))


@np.errstate(divide="ignore", invalid="ignore")  # The radius of a line is 1 / 0.
def find_crossings(pieces: FloatArray) -> tuple[IntArray, FloatArray]:
    """All points at which pieces cross or touch each other, including their ends.

    Returns the indices of both pieces at each point, (m, 2), and the distances of the point along
    both pieces [m], (m, 2).
    """
    low, high = _boxes(pieces)
    # In the order along an axis, the box of a piece can overlap only the boxes up to the first box
    # that starts beyond it. The axis is the one on which boxes overlap less.
    span = high.max(axis=0, initial=-np.inf) - low.min(axis=0, initial=np.inf)
    axis = int(np.argmin((high - low + SAME_POINT).sum(axis=0) / (span + SAME_POINT)))
    start, end = low[:, axis], high[:, axis]
    order = np.argsort(start)
    last = np.searchsorted(start[order], end[order] + SAME_POINT, side="right")
    count = np.maximum(last - np.arange(len(order)) - 1, 0)
    parts = np.cumsum(count) // PAIRS
    meetings, distances = [np.empty((0, 2), np.intp)], [np.empty((0, 2))]
    for part in np.unique(parts):
        owner, number = number_parts(np.where(parts == part, count, 0))
        i, j = order[owner], order[owner + 1 + number]
        near = (np.maximum(low[i], low[j]) <= np.minimum(high[i], high[j]) + SAME_POINT).all(axis=1)
        pairs = np.stack([i, j], axis=1)[near]
        points = _common_points(pieces[pairs[:, 0]], pieces[pairs[:, 1]])
        along = np.stack([_distances_along(pieces[x], points) for x in pairs.T], axis=2)
        ends = pieces[pairs, LENGTH][:, None, :]
        row, point = np.nonzero(((along >= -SAME_POINT) & (along <= ends + SAME_POINT)).all(axis=2))
        along, ends = along[row, point], ends[row, 0]
        # A point near the end of a piece is moved to this end.
        along = np.where(ends - along <= SAME_POINT, ends, along)
        meetings.append(pairs[row])
        distances.append(np.where(along <= SAME_POINT, 0.0, along))
    return np.concatenate(meetings), np.concatenate(distances)


def rotate_left(vectors: FloatArray) -> FloatArray:
    """Vectors turned to the left by a right angle, (..., 2)."""
    return np.stack([-vectors[..., 1], vectors[..., 0]], axis=-1)


def _cross(a: FloatArray, b: FloatArray) -> FloatArray:
    """Cross products of vectors, (...,)."""
    return np.asarray(a[..., 0] * b[..., 1] - a[..., 1] * b[..., 0])


def _boxes(pieces: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Lower and upper corners of boxes around pieces, (n, 2) each."""
    radius = 1 / pieces[:, CURVATURE]
    centers = pieces[:, :2] + radius[:, None] * rotate_left(pieces[:, TX : TY + 1])
    radii = np.abs(radius)
    sides = centers[:, None] + radii[:, None, None] * [[1, 0], [-1, 0], [0, 1], [0, -1]]
    on_arc = _distances_along(pieces, sides) <= pieces[:, LENGTH, None]
    on_arc &= pieces[:, CURVATURE, None] != 0
    starts = pieces[:, None, :2]
    ends = points_at(pieces, pieces[:, LENGTH])[:, None]
    points = np.concatenate([starts, ends, np.where(on_arc[:, :, None], sides, starts)], axis=1)
    return points.min(axis=1), points.max(axis=1)


def _distances_along(pieces: FloatArray, points: FloatArray) -> FloatArray:
    """Distances of points (n, m, 2) along n pieces that are extended beyond their ends, (n, m)."""
    offset, tangents = points - pieces[:, None, :2], pieces[:, None, TX : TY + 1]
    along, k = (offset * tangents).sum(axis=2), pieces[:, CURVATURE, None]
    # Angle around the centre, 0 at the start and increasing along the arc.
    angle = np.arctan2(along * np.abs(k), 1 - _cross(tangents, offset) * k)
    radius = 1 / np.where(k == 0, np.inf, np.abs(k))
    u = angle * radius
    turn = 2 * np.pi * radius
    # A point just before the start has a small negative distance, not nearly a full turn. For a
    # large radius, a full turn has no digits for this distance.
    before = (u >= -SAME_POINT) & (turn + u > pieces[:, LENGTH, None])
    return np.asarray(np.where(k == 0, along, np.where((u < 0) & ~before, u + turn, u)))


def _common_points(a: FloatArray, b: FloatArray) -> FloatArray:
    """Common points of pairs of extended pieces [m], (n, 4, 2), NaN for missing points.

    A line or circle through the origin with curvature k and left normal n there consists of the
    points x with k x.x / 2 = n.x. The difference of two such equations is the straight line w.x =
    r. This method uses neither centres nor radii, so nearly straight arcs lose no digits. Where
    pieces coincide, the result is their ends. The piece with more curvature is `a`.
    """
    turned = (np.abs(b[:, CURVATURE]) > np.abs(a[:, CURVATURE]))[:, None]
    a, b = np.where(turned, b, a), np.where(turned, a, b)
    ka, kb = a[:, CURVATURE], b[:, CURVATURE]
    na, nb = rotate_left(a[:, TX : TY + 1]), rotate_left(b[:, TX : TY + 1])
    gap, ratio = b[:, :2] - a[:, :2], kb / np.where(ka == 0, 1.0, ka)
    w = nb + kb[:, None] * gap - ratio[:, None] * na
    r = kb * (gap * gap).sum(axis=1) / 2 + (nb * gap).sum(axis=1)
    size = np.hypot(w[:, 0], w[:, 1])
    foot, along = (r / size**2)[:, None] * w, rotate_left(w) / size[:, None]
    slope = (na * along).sum(axis=1)
    constant = ka * (foot * foot).sum(axis=1) / 2 - (na * foot).sum(axis=1)
    # The common points are foot + s along with ka s² / 2 - slope s + constant = 0. Rounding errors
    # can make the discriminant slightly negative where pieces touch.
    inside = slope**2 - 2 * ka * constant
    inside[inside < -2 * np.abs(ka) * SAME_POINT / size] = np.nan
    # Lines that depart from each other by less than SAME_POINT count as parallel.
    parallel = (ka == 0) & (np.abs(slope) * a[:, LENGTH] < SAME_POINT)
    slope = np.where(parallel, np.nan, slope)
    larger = slope + np.copysign(np.sqrt(np.maximum(inside, 0.0)), slope)
    second = np.where(ka == 0, np.nan, larger / ka)
    first = np.where(inside > 0, 2 * constant / larger, second)
    points = np.full((len(a), 4, 2), np.nan)
    for i, s in enumerate((first, second)):
        points[:, i] = a[:, :2] + foot + s[:, None] * along
    one_circle = (size <= np.abs(kb) * SAME_POINT) & (
        np.abs(1 / ka) - np.abs(1 / kb) >= -SAME_POINT
    )
    together = np.where(ka == 0, parallel & (np.abs(constant) <= SAME_POINT), one_circle)
    ends = [x[together] for x in (a, b)]
    points[together] = np.stack(
        [y for x in ends for y in (x[:, :2], points_at(x, x[:, LENGTH]))], axis=1
    )
    return points
