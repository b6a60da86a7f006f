"""Nearest points through a grid of cells: for tangled paths in the plane."""

from __future__ import annotations

from dataclasses import dataclass
from typing import TYPE_CHECKING

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.geometry.projection import Projection, in_turn, segment_table

if TYPE_CHECKING:
    from armcontour.geometry.path import Path

# About this many segments come through a cell ...
THROUGH_A_CELL = 16
# ... and the cells number at most this many.
MOST_CELLS = 1_000_000


@dataclass(frozen=True, slots=True)
class CellIndex:
    """A grid of cells over a plane path, each with the segments that come through it.

    Args:
        geometry: As in `SegmentIndex`.
        low: Lower corner of the grid, (2,).
        size: Edge of a cell [m].
        columns, rows: Cells along x and y.
        first: Where every cell's list begins in `entries`, (cells + 1,).
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
    def build(cls, path: Path) -> CellIndex:
        """The index of a path in the plane."""
        from armcontour.geometry._cells import fill_cells

        reach = np.where(path.curvatures > 0, 2 / np.maximum(path.curvatures, 1e-300), 0)
        reach = np.minimum(reach, path.lengths)[:, None]
        arcs = (path.curvatures > 0)[:, None]
        low = np.min(np.where(arcs, path.starts - reach, path.starts), axis=0)
        low = np.minimum(low, path.vertices.min(axis=0))
        high = np.max(np.where(arcs, path.starts + reach, path.starts), axis=0)
        high = np.maximum(high, path.vertices.max(axis=0))
        extent = np.maximum(high - low, 1e-3 * (high - low).max())
        area = float(extent.prod())
        # A line of length l comes through about 4 l / (pi size) cells.
        size = max(THROUGH_A_CELL * np.pi * area / (4 * path.length), np.sqrt(area / MOST_CELLS))
        columns, rows = (int(np.ceil(x / size)) + 1 for x in extent)
        geometry = segment_table(path)
        lists = fill_cells(geometry, low, size, columns, rows)
        return cls(geometry, low, float(size), columns, rows, *lists)

    def nearest(self, queries: FloatArray) -> Projection:
        """Distance and arc length of the nearest point for each query, (n, 2)."""
        from armcontour.geometry._cells import nearest_in_cells

        def search(ordered: FloatArray) -> tuple[FloatArray, FloatArray]:
            found: tuple[FloatArray, FloatArray] = nearest_in_cells(
                ordered,
                self.geometry,
                self.low,
                self.size,
                self.columns,
                self.rows,
                self.first,
                self.entries,
            )
            return found

        return in_turn(queries, search)
