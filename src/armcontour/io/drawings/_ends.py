"""Which ends of pieces go on in which."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings._pieces import Pieces

# Ends nearer than this part of the tolerance touch.
TOUCHING = 0.01
# So many ends with the smallest turns, or nearest by, are candidates to go on with.
MOST_CANDIDATES = 8
# Turns that differ by less [rad] are equal: then the order of the pieces decides.
SAME_TURN = 1e-6
# Ends on different layers are further apart than any tolerance [m].
LAYERS_APART = 1e9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Ends:
    """The two ends of every piece: end 2 i is the start of piece i, end 2 i + 1 its end.

    Args:
        points: (2 n, dimension) [m].
        inwards: Unit tangents into the piece, same shape.
        layers: Number of the layer, (2 n,).
        lengths: Of the pieces [m], (n,).
        closed: Pieces whose ends are one point, (n,).
        free: Ends that can be joined, (2 n,).
    """

    points: FloatArray
    inwards: FloatArray
    layers: IntArray
    lengths: FloatArray
    closed: BoolArray
    free: BoolArray

    @classmethod
    def of(cls, pieces: Pieces, layers: IntArray, left_out: BoolArray) -> Ends:
        """The ends of pieces, some of which are left out."""

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
    """The end that each end goes on in, -1 where there is none, (2 n,)."""
    partner = np.full(len(ends.points), -1, dtype=np.intp)
    for near in (REPEATED_POINT, TOUCHING * tolerance, tolerance):
        free = np.flatnonzero(ends.free & (partner < 0))
        if len(free) > 1:
            candidates = _near if near == tolerance else _touching
            _match(ends, partner, candidates(ends, free, near), tolerance)
    return partner


def _match(ends: Ends, partner: IntArray, candidates: IntArray, tolerance: float) -> None:
    """Join candidates, (m, 2), the smallest turns first."""
    a, b = candidates.min(axis=1), candidates.max(axis=1)
    gap = np.linalg.norm(ends.points[a] - ends.points[b], axis=1)
    # A piece does not close on itself within the tolerance.
    allowed = (a != b) & (ends.layers[a] == ends.layers[b]) & (gap < tolerance)
    allowed &= (a // 2 != b // 2) | (ends.lengths[a // 2] > tolerance)
    a, b = a[allowed], b[allowed]
    # The turn from one into the other, by its half: exact near zero.
    u, v = ends.inwards[a], ends.inwards[b]
    turn = 2 * np.arctan2(np.linalg.norm(u + v, axis=1), np.linalg.norm(u - v, axis=1))
    order = np.lexsort([b, a, np.round(turn / SAME_TURN)])
    taken = (partner >= 0).tolist()
    for i, j in zip(a[order].tolist(), b[order].tolist(), strict=True):
        if not (taken[i] or taken[j]):
            taken[i] = taken[j] = True
            partner[i], partner[j] = j, i


def _touching(ends: Ends, free: IntArray, near: float) -> IntArray:
    """Of ends that touch, those that each can go on in with the smallest turns."""
    from scipy.sparse import coo_array
    from scipy.sparse.csgraph import connected_components
    from scipy.spatial import cKDTree

    # Ends in a cell of a grid are one, so that a heap of ends makes few pairs.
    keys = np.column_stack([ends.layers[free], np.round(ends.points[free] / (near / 2))])
    _, first, cell = np.unique(keys, axis=0, return_index=True, return_inverse=True)
    cell, n = cell.ravel(), len(first)
    centres = np.column_stack([ends.layers[free][first] * LAYERS_APART, ends.points[free][first]])
    pairs = cKDTree(centres).query_pairs(near, output_type="ndarray")
    links = coo_array((np.ones(len(pairs)), pairs.T), shape=(n, n))
    place = connected_components(links, directed=False)[1][cell]
    alone = np.bincount(place)[place] == 1
    free, place = free[~alone], place[~alone]
    return _pairs(free, *_smallest_turns(place, ends.inwards[free]))


def _smallest_turns(place: IntArray, inwards: FloatArray) -> tuple[IntArray, IntArray]:
    """Pairs of ends of one place, those with the smallest turns for each."""
    from scipy.spatial import cKDTree

    if len(place) == 0:
        return np.empty(0, dtype=np.intp), np.empty(0, dtype=np.intp)
    # Directions differ by no more than 2, places by 4.
    tree = cKDTree(np.column_stack([4.0 * place, inwards]))
    count = min(MOST_CANDIDATES + 1, len(place))
    found = tree.query(np.column_stack([4.0 * place, -inwards]), k=count, distance_upper_bound=3.0)
    return _drop_missing(np.asarray(found[1]), len(place))


def _near(ends: Ends, free: IntArray, near: float) -> IntArray:
    """Of the ends nearer than that, the nearest of each."""
    from scipy.spatial import cKDTree

    points = np.column_stack([ends.layers[free] * LAYERS_APART, ends.points[free]])
    count = min(MOST_CANDIDATES + 1, len(free))
    found = cKDTree(points).query(points, k=count, distance_upper_bound=near)
    return _pairs(free, *_drop_missing(np.asarray(found[1]), len(free)))


def _drop_missing(neighbours: IntArray, n: int) -> tuple[IntArray, IntArray]:
    """Pairs of neighbours of a tree's query, without those it did not find."""
    i = np.repeat(np.arange(n), neighbours.shape[1])
    k = neighbours.ravel()
    return i[k < n], k[k < n]


def _pairs(free: IntArray, a: IntArray, b: IntArray) -> IntArray:
    return np.unique(np.sort(np.column_stack([free[a], free[b]]), axis=1), axis=0)
