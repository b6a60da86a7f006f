"""Which ends of the pieces of a drawing are joined to which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.geometry.near_points import group_points, nearest_points
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings._pieces import Pieces

# Ends closer than this fraction of the tolerance touch.
TOUCHING = 0.01
# Number of candidates for joining to an end: those with the smallest turns, or the nearest ones.
MOST_CANDIDATES = 8
# Turns that differ by less than this [rad] are equal: then the order of the pieces decides.
SAME_TURN = 1e-6
# Added distance between ends on different layers [m], larger than any tolerance.
LAYERS_APART = 1e9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ends:
    """The two ends of every piece: end 2 i is the start of piece i, end 2 i + 1 its last point.

    Args:
        points: Points of the ends [m], (2 n, dimension).
        inwards: Unit tangents at the ends that point into the piece, same shape.
        layers: Number of the layer of each end, (2 n,).
        lengths: Lengths of the pieces [m], (n,).
        closed: Whether both ends of a piece are one point, (n,).
        free: Whether an end may be joined, (2 n,).
    """

    points: FloatArray
    inwards: FloatArray
    layers: IntArray
    lengths: FloatArray
    closed: BoolArray
    free: BoolArray

    @classmethod
    def of(cls, pieces: Pieces, layers: IntArray, left_out: BoolArray) -> Ends:
        """The ends of the pieces.

        Args:
            pieces: The pieces.
            layers: Number of the layer of each piece, (n,).
            left_out: Pieces whose ends are never joined, (n,).
        """

        def both(a: FloatArray, b: FloatArray) -> FloatArray:
            return np.stack([a, b], axis=1).reshape(-1, a.shape[1])

        start, end = pieces.starts, pieces.ends
        closed = np.linalg.norm(end - start, axis=1) <= REPEATED_POINT
        return cls(
            points=both(start, end),
            inwards=both(pieces.tangents, -pieces.end_tangents),
            layers=np.repeat(layers, 2),
            lengths=pieces.lengths,
            closed=closed,
            free=np.repeat(~(closed | left_out), 2),
        )


def find_partners(ends: Ends, tolerance: float) -> IntArray:
    """The end to which each end is joined, (2 n,); -1 if it stays free.

    Ends at the same point are joined first, then ends that touch, then ends with a gap.

    Args:
        ends: Ends of all pieces.
        tolerance: Ends closer than this may be joined [m].
    """
    partner = np.full(len(ends.points), -1, dtype=np.intp)
    for near in (REPEATED_POINT, TOUCHING * tolerance, tolerance):
        free = np.flatnonzero(ends.free & (partner < 0))
        if len(free) > 1:
            candidates = _near if near == tolerance else _touching
            _match(ends, partner, candidates(ends, free, near), tolerance)
    return partner


def _match(ends: Ends, partner: IntArray, candidates: IntArray, tolerance: float) -> None:
    """Join pairs of ends, those with the smallest turns first.

    Args:
        ends: Ends of all pieces.
        partner: The end to which each end is joined, -1 for none, (2 n,); updated.
        candidates: Pairs of ends that may be joined, (m, 2).
        tolerance: Only ends closer than this are joined [m].
    """
    a, b = candidates.min(axis=1), candidates.max(axis=1)
    gap = np.linalg.norm(ends.points[a] - ends.points[b], axis=1)
    # A piece shorter than the tolerance is not closed on itself.
    allowed = (a != b) & (ends.layers[a] == ends.layers[b]) & (gap < tolerance)
    allowed &= (a // 2 != b // 2) | (ends.lengths[a // 2] > tolerance)
    a, b = a[allowed], b[allowed]
    # The angle between the tangents, computed from its half, which is exact near zero.
    u, v = ends.inwards[a], ends.inwards[b]
    turn = 2 * np.arctan2(np.linalg.norm(u + v, axis=1), np.linalg.norm(u - v, axis=1))
    order = np.lexsort([b, a, np.round(turn / SAME_TURN)])
    taken = (partner >= 0).tolist()
    for i, j in zip(a[order].tolist(), b[order].tolist(), strict=True):
        if not (taken[i] or taken[j]):
            taken[i] = taken[j] = True
            partner[i], partner[j] = j, i


def _touching(ends: Ends, free: IntArray, near: float) -> IntArray:
    """Pairs of ends that touch, those with the smallest turns for each end, (m, 2).

    Args:
        ends: Ends of all pieces.
        free: Indices of the ends that are not joined yet.
        near: Ends closer than this touch [m].
    """
    # Ends in one cell of a grid are merged, so that many ends at one point make few pairs.
    keys = np.column_stack([ends.layers[free], np.round(ends.points[free] / (near / 2))])
    _, first, cell = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    centres = np.column_stack([ends.layers[free][first] * LAYERS_APART, ends.points[free][first]])
    vertex = group_points(centres, near)[cell.ravel()]
    alone = np.bincount(vertex)[vertex] == 1
    free, vertex = free[~alone], vertex[~alone]
    return _pairs(free, *_smallest_turns(vertex, ends.inwards[free]))


def _smallest_turns(vertex: IntArray, inwards: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of ends at one vertex, those with the smallest turns for each end.

    Args:
        vertex: Number of the vertex at which each end lies, (n,).
        inwards: Unit tangents into the pieces, (n, dimension).
    """
    if len(vertex) == 0:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    # Tangents differ by at most 2 and the coordinates of two vertices by at least 4, so a
    # neighbour within 3 is at the same vertex.
    here, there = (np.column_stack([4.0 * vertex, x]) for x in (inwards, -inwards))
    count = min(MOST_CANDIDATES + 1, len(vertex))
    return _drop_missing(nearest_points(there, here, count, 3.0), len(vertex))


def _near(ends: Ends, free: IntArray, near: float) -> IntArray:
    """Pairs of ends that are close to each other, the nearest ones of each end, (m, 2).

    Args:
        ends: Ends of all pieces.
        free: Indices of the ends that are not joined yet.
        near: Largest distance of two ends [m].
    """
    points = np.column_stack([ends.layers[free] * LAYERS_APART, ends.points[free]])
    count = min(MOST_CANDIDATES + 1, len(free))
    return _pairs(free, *_drop_missing(nearest_points(points, points, count, near), len(free)))


def _drop_missing(neighbours: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Pairs of points and neighbours, without the neighbours not found.

    Args:
        neighbours: Indices of the neighbours, n if there is none, (n, k).
        n: Number of points.
    """
    i = np.repeat(np.arange(n), neighbours.shape[1])
    k = neighbours.ravel()
    return i[k < n], k[k < n]


def _pairs(free: IntArray, a: IntArray, b: IntArray) -> IntArray:
    """Sorted unique pairs of ends, (m, 2), from two arrays of indices into `free`."""
    return np.unique(np.sort(np.column_stack([free[a], free[b]]), axis=1), axis=0)
