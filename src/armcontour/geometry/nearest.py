"""Nearest points of a path: a tree of boxes, or a grid of cells for tangled paths in the plane.

One index does not serve both. Of 10,000 segments and 100,000 random points (benchmarks/projection),
the tree takes 0.09 s on a spiral and 0.27 s on chords across a square, the grid 12 s and 0.09 s.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.geometry.segments import Segments

# Long segments are cut for their boxes' sake, until a place lies in about this many boxes ...
OVERLAP = 8
# ... but the pieces number at most this many times the segments.
PIECES_PER_SEGMENT = 32
# Leaves of the tree hold this many pieces; with fewer the tree costs, with more the pieces.
LEAF_SIZE = 4
# About this many segments come through a cell of the grid ...
THROUGH_A_CELL = 16
# ... and the cells number at most this many.
MOST_CELLS = 1_000_000


@dataclass(frozen=True, slots=True)
class Projection:
    """Nearest points of a path.

    Args:
        distance: Distance from each query to the path [m], (n,).
        s: Arc length of the nearest point [m], (n,).
    """

    distance: FloatArray
    s: FloatArray


def find_nearest(segments: Segments, points: npt.ArrayLike) -> Projection:
    """The nearest point of a path for each of `points`, (n, dimension) [m].

    Exact on lines and arcs. An index is built at the first call for a table of segments and kept
    for as long as the table; a query then costs about the logarithm of the number of segments.

    Raises:
        InvalidInput: Points of another dimension, or not finite.
    """
    queries = _checks.points("points to project", points)
    if queries.shape[1] != segments.dimension:
        raise InvalidInput(
            f"Points to project have {queries.shape[1]} coordinates, "
            f"the path has {segments.dimension}."
        )
    index = _indices.get(segments)
    if index is None:
        index = _indices[segments] = _build_index(segments)
    # Neighbours in turn: each then starts from a good guess, and in warm memory.
    order = _sort_along_a_curve(queries)
    found = index.search(pad(queries[order]))
    distance, s = np.empty(len(queries)), np.empty(len(queries))
    distance[order], s[order] = found
    return Projection(distance, s)


def pack(segments: Segments) -> FloatArray:
    """Per segment, padded to space: start, tangent, normal, curvature, length, place; (n, 12)."""
    vectors = [pad(x) for x in (segments.starts, segments.tangents, segments.normals)]
    return np.column_stack(
        [*vectors, segments.curvatures, segments.lengths, segments.breaks[:-1]],
    )


def pad(points: FloatArray) -> FloatArray:
    """Points of the plane or of space as points of space, (n, 3)."""
    padded = np.zeros((len(points), 3))
    padded[:, : points.shape[1]] = points
    return padded


@dataclass(frozen=True, slots=True)
class _Tree:
    """A balanced tree of boxes over pieces of segments, ordered along a space-filling curve.

    Args:
        geometry: Segments as `pack` makes them.
        pieces: Segment of each piece, in tree order.
        boxes: Lower and upper corner of every node's box in heap order, (2 m - 1, 6) for m leaves.
    """

    geometry: FloatArray
    pieces: IntArray
    boxes: FloatArray

    @classmethod
    def build(cls, segments: Segments) -> _Tree:
        """The tree of a path: O(n log n)."""
        segment, low, high = _pieces(segments)
        order = _sort_along_a_curve((low + high) / 2, digits=4)
        leaves = 1 << max(0, int(np.ceil(np.log2(len(order) / LEAF_SIZE))))
        # Every leaf gets pieces: the k-th holds order[k n / leaves : (k + 1) n / leaves].
        first = (np.arange(leaves + 1) * len(order)) // leaves
        levels_low = [np.minimum.reduceat(low[order], first[:-1], axis=0)]
        levels_high = [np.maximum.reduceat(high[order], first[:-1], axis=0)]
        while len(levels_low[-1]) > 1:
            levels_low.append(np.minimum(levels_low[-1][0::2], levels_low[-1][1::2]))
            levels_high.append(np.maximum(levels_high[-1][0::2], levels_high[-1][1::2]))
        return cls(
            geometry=pack(segments),
            pieces=segment[order],
            boxes=np.hstack([np.concatenate(levels_low[::-1]), np.concatenate(levels_high[::-1])]),
        )

    def search(self, queries: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance and arc length of the nearest point for each query, (n, 3)."""
        from armcontour.geometry._nearest import search_tree

        return search_tree(queries, self.geometry, self.pieces, self.boxes)


@dataclass(frozen=True, slots=True)
class _Grid:
    """A grid of cells over a plane path, each with the segments that come through it.

    Args:
        geometry: Segments as `pack` makes them.
        low: Lower corner of the grid, (2,).
        size: Edge of a cell [m].
        columns, rows: Cells along x and y.
        first: Where every cell's list starts in `entries`, (cells + 1,).
        entries: Segments, cell by cell.
    """

    geometry: FloatArray
    low: FloatArray
    size: float
    columns: int
    rows: int
    first: IntArray
    entries: IntArray

    @classmethod
    def build(cls, segments: Segments) -> _Grid:
        """The grid of a path in the plane."""
        from armcontour.geometry._nearest import fill_cells

        reach = np.where(segments.curvatures > 0, 2 / np.maximum(segments.curvatures, 1e-300), 0)
        reach = np.minimum(reach, segments.lengths)[:, None]
        last = segments[-1:].ends
        low = np.min(np.concatenate([segments.starts - reach, last]), axis=0)
        high = np.max(np.concatenate([segments.starts + reach, last]), axis=0)
        extent = np.maximum(high - low, 1e-3 * (high - low).max())
        area, length = float(extent.prod()), float(segments.lengths.sum())
        # A line of length l comes through about 4 l / (pi size) cells.
        size = max(THROUGH_A_CELL * np.pi * area / (4 * length), np.sqrt(area / MOST_CELLS))
        columns, rows = (int(np.ceil(x / size)) + 1 for x in extent)
        geometry = pack(segments)
        lists = fill_cells(geometry, low, size, columns, rows)
        return cls(geometry, low, float(size), columns, rows, *lists)

    def search(self, queries: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance and arc length of the nearest point for each query, (n, 3)."""
        from armcontour.geometry._nearest import search_cells

        cells = self.low, self.size, self.columns, self.rows, self.first, self.entries
        return search_cells(queries, self.geometry, *cells)


_indices: WeakKeyDictionary[Segments, _Tree | _Grid] = WeakKeyDictionary()


def _build_index(segments: Segments) -> _Tree | _Grid:
    """A grid for a path so tangled that a tree would need too many pieces, else a tree."""
    tangled = _pieces_wanted(segments) > PIECES_PER_SEGMENT * len(segments)
    return (_Grid if tangled and segments.dimension == 2 else _Tree).build(segments)


def _pieces_wanted(segments: Segments) -> float:
    """Pieces of a path after which a place lies in `OVERLAP` of their boxes.

    A box over a piece of length l has an area of about l² / pi, so N pieces of a path of length L
    overlap any place of an area A about L² / (pi A N) times.
    """
    extent = np.sort(np.ptp(np.concatenate([segments.starts, segments[-1:].ends]), axis=0))[-2:]
    area = max(extent[0], 1e-3 * extent[1]) * extent[1]
    return float(segments.lengths.sum() ** 2 / (np.pi * max(area, 1e-300) * OVERLAP))


def _pieces(segments: Segments) -> tuple[IntArray, FloatArray, FloatArray]:
    """Segment and box of every piece; a piece of an arc turns by a quarter circle at most."""
    n, lengths, curvatures = len(segments), segments.lengths, segments.curvatures
    target = lengths.sum() / np.clip(_pieces_wanted(segments), n, PIECES_PER_SEGMENT * n)
    by_length = np.ceil(lengths / target)
    by_turn = np.ceil(lengths * curvatures / (np.pi / 2))
    count = np.maximum(1, np.maximum(by_length, by_turn)).astype(np.intp)
    segment = np.repeat(np.arange(n), count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    step = lengths[segment] / count[segment]
    start, end = (segments.at(segment, k * step) for k in (number, number + 1))
    # The arc bulges from its chord by at most the sagitta (1 - cos(turn / 2)) / curvature.
    sagitta = step * np.tan(curvatures[segment] * step / 4) / 2
    rounding = 1e-15 * (np.abs(start) + np.abs(end)).max(axis=1)
    margin = (sagitta + rounding)[:, None]
    return segment, pad(np.minimum(start, end) - margin), pad(np.maximum(start, end) + margin)


def _sort_along_a_curve(points: FloatArray, digits: int = 1) -> IntArray:
    """Order of points along a Morton curve, so that neighbours in order are neighbours in space.

    Args:
        points: (n, 2) or (n, 3).
        digits: How fine the cells of the curve are: 8 bits an axis each in the plane, 5 in space.
    """
    axes = points.shape[1]
    bits = 16 // axes
    low = points.min(axis=0)
    span = float((points.max(axis=0) - low).max()) or 1.0
    cells = ((points - low) * ((2 ** (bits * digits) - 1) / span)).astype(np.uint32)
    every = np.arange(2**bits)
    apart = np.zeros(2**bits, dtype=np.uint16)
    for bit in range(bits):
        apart |= ((every >> bit & 1) << (bit * axes)).astype(np.uint16)
    keys = []
    for digit in range(digits):
        code = np.zeros(len(points), dtype=np.uint16)
        for axis in range(axes):
            code |= apart[cells[:, axis] >> (bits * digit) & (2**bits - 1)] << np.uint16(axis)
        keys.append(code)
    return np.lexsort(keys)
