"""Nearest points through a tree of bounding boxes: for paths of any shape."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.geometry.projection import (
    PIECES_PER_SEGMENT,
    Projection,
    in_space,
    in_turn,
    pieces_wanted,
    segment_table,
)

if TYPE_CHECKING:
    from armcontour.geometry.path import Path

# Leaves of the tree hold this many pieces; with fewer the tree costs, with more the pieces.
LEAF_SIZE = 4


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
            geometry=segment_table(path),
            pieces=segment[order],
            boxes=np.hstack([np.concatenate(levels_low[::-1]), np.concatenate(levels_high[::-1])]),
        )

    def nearest(self, queries: FloatArray) -> Projection:
        """Distance and arc length of the nearest point for each query (n, 2) or (n, 3)."""
        from armcontour.geometry._nearest import nearest

        def search(ordered: FloatArray) -> tuple[FloatArray, FloatArray]:
            found: tuple[FloatArray, FloatArray] = nearest(
                ordered, self.geometry, self.pieces, self.boxes
            )
            return found

        return in_turn(queries, search)


def _pieces(path: Path) -> tuple[IntArray, FloatArray, FloatArray]:
    """Segment and box of every piece; a piece of an arc turns by a quarter circle at most."""
    wanted = pieces_wanted(path)
    target = path.length / np.clip(wanted, len(path), PIECES_PER_SEGMENT * len(path))
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
    low = in_space(np.minimum(begin, end) - margin)
    high = in_space(np.maximum(begin, end) + margin)
    return segment, low, high


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
