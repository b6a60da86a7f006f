"""Nearest points of a path: what its two spatial indices share."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armcontour._checks import FloatArray, IntArray

if TYPE_CHECKING:
    from armcontour.geometry.path import Path

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


def in_turn(
    queries: FloatArray, search: Callable[[FloatArray], tuple[FloatArray, FloatArray]]
) -> Projection:
    """Search for neighbours in turn: each then starts from a good guess, and in warm memory."""
    order = _by_cell(queries)
    found = search(in_space(queries[order]))
    distance, s = np.empty(len(queries)), np.empty(len(queries))
    distance[order], s[order] = found
    return Projection(distance, s)


def pieces_wanted(path: Path) -> float:
    """Pieces of a path after which a place lies in `OVERLAP` of their boxes.

    A box over a piece of length l has an area of about l² / pi, so N pieces of a path of length L
    overlap any place of an area A about L² / (pi A N) times.
    """
    extent = np.sort(np.ptp(path.vertices, axis=0))[-2:]
    area = max(extent[0], 1e-3 * extent[1]) * extent[1]
    return float(path.length**2 / (np.pi * max(area, 1e-300) * OVERLAP))


def segment_table(path: Path) -> FloatArray:
    """Per segment, padded to space: start, tangent, inward, curvature, length, place; (n, 12)."""
    table = np.zeros((len(path), 12))
    d = path.dimension
    table[:, 0:d] = path.starts
    table[:, 3 : 3 + d] = path.tangents
    table[:, 6 : 6 + d] = path.inwards
    table[:, 9] = path.curvatures
    table[:, 10] = path.lengths
    table[:, 11] = path.breaks[:-1]
    return table


def in_space(points: FloatArray) -> FloatArray:
    """Points of the plane or of space as points of space, (n, 3)."""
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
