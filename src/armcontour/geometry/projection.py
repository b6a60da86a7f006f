"""Nearest point on a path: exact on lines and arcs, through a tree of bounding boxes."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armcontour._checks import FloatArray, IntArray

if TYPE_CHECKING:
    from armcontour.geometry.path import Path

# Leaves of the tree hold this many pieces; with fewer the tree costs, with more the pieces.
LEAF_SIZE = 4
# Long segments are cut for their boxes' sake, until a place lies in about this many boxes ...
OVERLAP = 8
# ... but the pieces number at most this many times the segments.
PIECES_PER_SEGMENT = 32


@dataclass(frozen=True, slots=True)
class Projection:
    """Nearest points of a path.

    Args:
        distance: Distance from each query to the path [m], (n,).
        s: Arc length of the nearest point [m], (n,).
    """

    distance: FloatArray
    s: FloatArray


@dataclass(frozen=True, slots=True)
class SegmentIndex:
    """A balanced tree of boxes over pieces of segments, ordered along a space-filling curve.

    Args:
        geometry: Per segment, padded to space: start, tangent, inward, curvature, length, its
            arc length on the path; (n, 12).
        pieces: Segment of each piece, in tree order.
        boxes: Lower and upper corner of every node's box in heap order, (2 m - 1, 6) for m leaves.
    """

    geometry: FloatArray
    pieces: IntArray
    boxes: FloatArray

    @classmethod
    def build(cls, path: Path) -> SegmentIndex:
        """The index of a path: O(n log n)."""
        segment, low, high = _pieces(path)
        order = _along_a_curve((low + high) / 2)
        leaves = 1 << max(0, int(np.ceil(np.log2(len(order) / LEAF_SIZE))))
        # Every leaf gets pieces: the k-th holds order[k n / leaves : (k + 1) n / leaves].
        first = (np.arange(leaves + 1) * len(order)) // leaves
        boxes_low = np.minimum.reduceat(low[order], first[:-1], axis=0)
        boxes_high = np.maximum.reduceat(high[order], first[:-1], axis=0)
        levels_low, levels_high = [boxes_low], [boxes_high]
        while len(levels_low[-1]) > 1:
            levels_low.append(np.minimum(levels_low[-1][0::2], levels_low[-1][1::2]))
            levels_high.append(np.maximum(levels_high[-1][0::2], levels_high[-1][1::2]))
        return cls(
            geometry=_geometry(path),
            pieces=segment[order],
            boxes=np.hstack([np.concatenate(levels_low[::-1]), np.concatenate(levels_high[::-1])]),
        )

    def nearest(self, queries: FloatArray) -> Projection:
        """Distance and arc length of the nearest point for each query (n, 2) or (n, 3)."""
        from armcontour.geometry._nearest import nearest

        # Neighbours in turn: each query then starts from a good guess, and in warm memory.
        order = _by_cell(queries)
        found = nearest(_in_space(queries[order]), self.geometry, self.pieces, self.boxes)
        distance, s = np.empty(len(queries)), np.empty(len(queries))
        distance[order], s[order] = found
        return Projection(distance, s)


def _geometry(path: Path) -> FloatArray:
    table = np.zeros((len(path), 12))
    d = path.dimension
    table[:, 0:d] = path.starts
    table[:, 3 : 3 + d] = path.tangents
    table[:, 6 : 6 + d] = path.inwards
    table[:, 9] = path.curvatures
    table[:, 10] = path.lengths
    table[:, 11] = path.breaks[:-1]
    return table


def _pieces(path: Path) -> tuple[IntArray, FloatArray, FloatArray]:
    """Segment and box of every piece; a piece of an arc turns by a quarter circle at most."""
    # A box over a piece of length l has an area of about l^2 / pi, so N pieces of a path of length
    # L overlap any place of an area A about L^2 / (pi A N) times.
    extent = np.sort(np.ptp(path.vertices, axis=0))[-2:]
    area = max(extent[0], 1e-3 * extent[1]) * extent[1]
    # The vertices of a full circle span no area.
    overlap = path.length**2 / (np.pi * max(area, 1e-24 * path.length**2) * OVERLAP)
    target = path.length / np.clip(overlap, len(path), PIECES_PER_SEGMENT * len(path))
    by_length = np.ceil(path.lengths / target)
    by_turn = np.ceil(path.lengths * path.curvatures / (np.pi / 2))
    count = np.maximum(1, np.maximum(by_length, by_turn)).astype(np.intp)
    segment = np.repeat(np.arange(len(path)), count)
    number = np.arange(count.sum()) - np.repeat(np.cumsum(count) - count, count)
    step = path.lengths[segment] / count[segment]
    begin = path.on_segment(segment, number * step)
    end = path.on_segment(segment, (number + 1) * step)
    # The arc bulges from its chord by at most the sagitta (1 - cos(turn / 2)) / curvature.
    sagitta = step * np.tan(path.curvatures[segment] * step / 4) / 2
    rounding = 1e-15 * (np.abs(begin) + np.abs(end)).max(axis=1)
    margin = (sagitta + rounding)[:, None]
    low = _in_space(np.minimum(begin, end) - margin)
    high = _in_space(np.maximum(begin, end) + margin)
    return segment, low, high


def _in_space(points: FloatArray) -> FloatArray:
    padded = np.zeros((len(points), 3))
    padded[:, : points.shape[1]] = points
    return padded


def _by_cell(points: FloatArray) -> IntArray:
    """Order of points by the cell of a coarse grid that holds them, along a Morton curve."""
    bits = 16 // points.shape[1]
    low = points.min(axis=0)
    span = float((points.max(axis=0) - low).max()) or 1.0
    cells = ((points - low) * ((2**bits - 1) / span)).astype(np.uint16)
    spread = np.zeros(2**bits, dtype=np.uint16)
    for bit in range(bits):
        spread |= ((np.arange(2**bits) >> bit & 1) << (bit * points.shape[1])).astype(np.uint16)
    code = spread[cells[:, 0]]
    for axis in range(1, points.shape[1]):
        code |= spread[cells[:, axis]] << np.uint16(axis)
    return np.argsort(code, kind="stable")


def _along_a_curve(points: FloatArray) -> IntArray:
    """Order of points along a Morton curve, so that neighbours in order are neighbours in space."""
    span = float(np.ptp(points, axis=0).max()) or 1.0
    cells = ((points - points.min(axis=0)) / span * (2**20 - 1)).astype(np.uint64)
    code = np.zeros(len(points), dtype=np.uint64)
    for axis in range(3):
        code |= _spread(cells[:, axis]) << np.uint64(axis)
    return np.argsort(code, kind="stable")


def _spread(
    x: np.ndarray[tuple[int], np.dtype[np.uint64]],
) -> np.ndarray[tuple[int], np.dtype[np.uint64]]:
    """The low 21 bits of each number, two zero bits put between them."""
    for shift, mask in (
        (32, 0x1F00000000FFFF),
        (16, 0x1F0000FF0000FF),
        (8, 0x100F00F00F00F00F),
        (4, 0x10C30C30C30C30C3),
        (2, 0x1249249249249249),
    ):
        x = (x | (x << np.uint64(shift))) & np.uint64(mask)
    return x
