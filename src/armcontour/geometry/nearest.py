"""Nearest points of a path, by a tree of boxes or, for tangled plane paths, a grid of cells.

Neither index serves both kinds of paths: for 10,000 segments and 100,000 random points
(benchmarks/projection) the tree takes 0.09 s on a spiral and 0.27 s on chords across a square, the
grid 12 s and 0.09 s.
"""

from __future__ import annotations

from dataclasses import dataclass
from weakref import WeakKeyDictionary

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour._parts import number_parts
from armcontour.errors import InvalidInput
from armcontour.geometry.segments import Segments
from armcontour.geometry.transitions import draw_arcs

# Long segments are split into pieces with smaller boxes, until a point lies in about this many
# boxes, but into at most this many pieces per segment on average.
OVERLAP = 8
PIECES_PER_SEGMENT = 32
# Pieces in a leaf of the tree: with fewer, searching nodes dominates; with more, searching pieces.
LEAF_SIZE = 4
# About this many segments run through a cell of the grid, which has at most this many cells.
THROUGH_A_CELL = 16
MOST_CELLS = 1_000_000


@dataclass(frozen=True, slots=True)
class Projection:
    """Nearest points of a path to n query points.

    Args:
        distance: Distance from each query point to the path [m], (n,).
        s: Arc length of the nearest point [m], (n,).
    """

    distance: FloatArray
    s: FloatArray


def find_nearest(
    segments: Segments, points: npt.ArrayLike, *, in_order: bool = False
) -> Projection:
    """The nearest point of a path for each of `points`, exact on lines and arcs.

    On transitions it is the nearest one of arcs within a nanometre of them (`draw_arcs`).

    An index is built at the first call for a table of segments and kept as long as the table. A
    query then takes time about proportional to the logarithm of the number of segments.

    Args:
        segments: Segments of the path.
        points: Query points [m], (n, dimension).
        in_order: Whether each point is near the one before, so that they need not be sorted.

    Raises:
        InvalidInput: The points have another dimension than the path, or are not finite.
    """
    queries = _checks.points("points to project", points)
    if queries.shape[1] != segments.dimension:
        raise InvalidInput(
            f"Points to project have {queries.shape[1]} coordinates, "
            f"the path has {segments.dimension}."
        )
    index = _indices.get(segments)
    if index is None:
        index = _indices[segments] = _build_index(*draw_arcs(segments))
    if in_order:
        return Projection(*index.search(pad(queries)))
    # Queries are searched in spatial order: each starts from a good guess and finds memory cached.
    order = _sort_along_a_curve(queries)
    found = index.search(pad(queries[order]))
    distance, s = np.empty(len(queries)), np.empty(len(queries))
    distance[order], s[order] = found
    return Projection(distance, s)


def pack(segments: Segments) -> FloatArray:
    """Segments as an array for compiled functions, padded to space, (n, 12).

    Transitions are drawn as arcs (`draw_arcs`), so that there may be more rows than segments.
    Columns: start (3), tangent (3), normal (3), curvature, length, arc length at the start.
    """
    return pack_arcs(*draw_arcs(segments))


def pack_arcs(arcs: Segments, begin: FloatArray) -> FloatArray:
    """What `pack` gives, from what `draw_arcs` gives."""
    vectors = [pad(x) for x in (arcs.starts, arcs.tangents, arcs.normals)]
    return np.column_stack([*vectors, arcs.curvatures, arcs.lengths, begin])


def pad(points: FloatArray) -> FloatArray:
    """Points of the plane or of space as points of space with z = 0 if missing, (n, 3)."""
    padded = np.zeros((len(points), 3))
    padded[:, : points.shape[1]] = points
    return padded


@dataclass(frozen=True, slots=True)
class _Tree:
    """A balanced tree of boxes over pieces of segments, ordered along a space-filling curve.

    Args:
        geometry: Segments from `pack`, (n, 12).
        pieces: Index of the segment of each piece, in tree order, (pieces,).
        boxes: Lower and upper corners of the nodes' boxes in heap order, (2 m - 1, 6) for m leaves.
    """

    geometry: FloatArray
    pieces: IntArray
    boxes: FloatArray

    @classmethod
    def build(cls, segments: Segments, begin: FloatArray) -> _Tree:
        """The tree of lines and arcs from `draw_arcs`, in O(n log n)."""
        segment, low, high = _divide(segments)
        order = _sort_along_a_curve((low + high) / 2, digits=4)
        leaves = 1 << max(0, int(np.ceil(np.log2(len(order) / LEAF_SIZE))))
        # Leaf k has the pieces order[k n / leaves : (k + 1) n / leaves], so that none is empty.
        first = (np.arange(leaves + 1) * len(order)) // leaves
        levels_low = [np.minimum.reduceat(low[order], first[:-1], axis=0)]
        levels_high = [np.maximum.reduceat(high[order], first[:-1], axis=0)]
        while len(levels_low[-1]) > 1:
            levels_low.append(np.minimum(levels_low[-1][0::2], levels_low[-1][1::2]))
            levels_high.append(np.maximum(levels_high[-1][0::2], levels_high[-1][1::2]))
        return cls(
            geometry=pack_arcs(segments, begin),
            pieces=segment[order],
            boxes=np.hstack([np.concatenate(levels_low[::-1]), np.concatenate(levels_high[::-1])]),
        )

    def search(self, queries: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance and arc length of the nearest point for each query, (n, 3)."""
        from armcontour.geometry._nearest import search_tree

        return search_tree(queries, self.geometry, self.pieces, self.boxes)


@dataclass(frozen=True, slots=True)
class _Grid:
    """A grid of cells over a plane path, each with a list of the segments that run through it.

    Args:
        geometry: Segments from `pack`, (n, 12).
        low: Lower corner of the grid [m], (2,).
        size: Edge length of a cell [m].
        columns, rows: Numbers of cells along x and y.
        first: Index in `entries` at which the list of each cell starts, (cells + 1,).
        entries: Indices of segments, cell by cell.
    """

    geometry: FloatArray
    low: FloatArray
    size: float
    columns: int
    rows: int
    first: IntArray
    entries: IntArray

    @classmethod
    def build(cls, segments: Segments, begin: FloatArray) -> _Grid:
        """The grid of lines and arcs from `draw_arcs` in the plane."""
        from armcontour.geometry._nearest import fill_cells

        diameter = np.where(segments.curvatures > 0, 2 / np.maximum(segments.curvatures, 1e-300), 0)
        diameter = np.minimum(diameter, segments.lengths)[:, None]
        last = segments[-1:].ends
        low = np.min(np.concatenate([segments.starts - diameter, last]), axis=0)
        high = np.max(np.concatenate([segments.starts + diameter, last]), axis=0)
        extent = np.maximum(high - low, 1e-3 * (high - low).max())
        area, length = float(extent.prod()), float(segments.lengths.sum())
        # A line of length l runs through about 4 l / (pi size) cells.
        size = max(THROUGH_A_CELL * np.pi * area / (4 * length), np.sqrt(area / MOST_CELLS))
        columns, rows = (int(np.ceil(x / size)) + 1 for x in extent)
        geometry = pack_arcs(segments, begin)
        lists = fill_cells(geometry, low, size, columns, rows)
        return cls(geometry, low, float(size), columns, rows, *lists)

    def search(self, queries: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Distance and arc length of the nearest point for each query, (n, 3)."""
        from armcontour.geometry._nearest import search_cells

        cells = self.low, self.size, self.columns, self.rows, self.first, self.entries
        return search_cells(queries, self.geometry, *cells)


_indices: WeakKeyDictionary[Segments, _Tree | _Grid] = WeakKeyDictionary()


def _build_index(segments: Segments, begin: FloatArray) -> _Tree | _Grid:
    """A tree; or a grid, for a plane path so tangled that a tree would need too many pieces."""
    tangled = _target_pieces(segments) > PIECES_PER_SEGMENT * len(segments)
    return (_Grid if tangled and segments.dimension == 2 else _Tree).build(segments, begin)


def _target_pieces(segments: Segments) -> float:
    """Number of pieces of a path with which a point lies in about `OVERLAP` of their boxes.

    The box of a piece of length l has an area of about l² / pi, so that of N pieces of a path of
    length L in an area A, about L² / (pi A N) boxes contain a point.
    """
    extent = np.sort(np.ptp(np.concatenate([segments.starts, segments[-1:].ends]), axis=0))[-2:]
    area = max(extent[0], 1e-3 * extent[1]) * extent[1]
    return float(segments.lengths.sum() ** 2 / (np.pi * max(area, 1e-300) * OVERLAP))


def _divide(segments: Segments) -> tuple[IntArray, FloatArray, FloatArray]:
    """Divide segments into pieces, of at most a quarter circle each.

    Returns:
        Index of the segment of every piece, and lower and upper corner of its box, (pieces, 3).
    """
    n, lengths, curvatures = len(segments), segments.lengths, segments.curvatures
    target = lengths.sum() / np.clip(_target_pieces(segments), n, PIECES_PER_SEGMENT * n)
    by_length = np.ceil(lengths / target)
    by_turn = np.ceil(lengths * curvatures / (np.pi / 2))
    count = np.maximum(1, np.maximum(by_length, by_turn)).astype(np.intp)
    segment, number = number_parts(count)
    step = lengths[segment] / count[segment]
    start, end = (segments.at(segment, k * step) for k in (number, number + 1))
    # An arc leaves its chord by at most the sagitta, (1 - cos(turn / 2)) / curvature.
    sagitta = step * np.tan(curvatures[segment] * step / 4) / 2
    rounding = 1e-15 * (np.abs(start) + np.abs(end)).max(axis=1)
    margin = (sagitta + rounding)[:, None]
    return segment, pad(np.minimum(start, end) - margin), pad(np.maximum(start, end) + margin)


def _sort_along_a_curve(points: FloatArray, digits: int = 1) -> IntArray:
    """Indices that sort points along a Morton curve, so that points next in order are near.

    Args:
        points: The points, (n, 2) or (n, 3).
        digits: Fineness of the curve's cells: each digit is 8 bits per axis in the plane, 5 in
            space.
    """
    axes = points.shape[1]
    bits = 16 // axes
    low = points.min(axis=0)
    span = float((points.max(axis=0) - low).max()) or 1.0
    cells = ((points - low) * ((2 ** (bits * digits) - 1) / span)).astype(np.uint32)
    values = np.arange(2**bits)
    spread = np.zeros(2**bits, dtype=np.uint16)
    for bit in range(bits):
        spread |= ((values >> bit & 1) << (bit * axes)).astype(np.uint16)
    keys = []
    for digit in range(digits):
        code = np.zeros(len(points), dtype=np.uint16)
        for axis in range(axes):
            code |= spread[cells[:, axis] >> (bits * digit) & (2**bits - 1)] << np.uint16(axis)
        keys.append(code)
    return np.lexsort(keys)
