"""The segments of many pieces in one table, so that joining thousands of them costs little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.geometry import Path, Segments
from armcontour.geometry.segments import REPEATED_POINT

# A gap of half a repeated point stays: closing it would spoil the tangents.
NO_GAP = 0.5 * REPEATED_POINT


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pieces:
    """All segments of some pieces one after the other.

    Args:
        segments: The table.
        first: First segment of every piece, and the number of segments, (pieces + 1,).
    """

    segments: Segments
    first: IntArray

    @classmethod
    def of(cls, paths: Sequence[Path]) -> Pieces:
        """The segments of paths."""
        first = np.concatenate([[0], np.cumsum([len(path) for path in paths])])
        return cls(segments=Segments.join([path.segments for path in paths]), first=first)

    @property
    def starts(self) -> FloatArray:
        """Where the pieces start, (pieces, dimension)."""
        return self.segments.starts[self.first[:-1]]

    @property
    def ends(self) -> FloatArray:
        """Where the pieces end, (pieces, dimension)."""
        return self.segments[self.first[1:] - 1].ends

    @property
    def tangents(self) -> FloatArray:
        """Tangents where the pieces start, (pieces, dimension)."""
        return self.segments.tangents[self.first[:-1]]

    @property
    def end_tangents(self) -> FloatArray:
        """Tangents where the pieces end, (pieces, dimension)."""
        return self.segments[self.first[1:] - 1].end_tangents

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the pieces [m], (pieces,)."""
        return np.asarray(np.add.reduceat(self.segments.lengths, self.first[:-1]))

    @property
    def middles(self) -> FloatArray:
        """The pieces' points at half of their lengths, (pieces, dimension)."""
        breaks = self.segments.breaks
        half = breaks[self.first[:-1]] + self.lengths / 2
        i = np.clip(np.searchsorted(breaks, half) - 1, self.first[:-1], self.first[1:] - 1)
        return self.segments.at(i, np.clip(half - breaks[i], 0.0, self.segments.lengths[i]))

    def join(self, entries: Sequence[int], closed: bool, tolerance: float) -> Path:
        """The path of pieces in turn, with the gaps between them closed.

        Args:
            entries: Twice the number of each piece, and one more where it is turned round.
            closed: Whether the last goes on in the first.
            tolerance: No point is moved by more [m].
        """
        entered = np.asarray(entries, dtype=np.intp)
        piece, turned = entered // 2, entered % 2 == 1
        count = self.first[piece + 1] - self.first[piece]
        begin = np.cumsum(count) - count
        within = np.arange(count.sum()) - np.repeat(begin, count)
        base = np.where(turned, self.first[piece + 1] - 1, self.first[piece])
        i = np.repeat(base, count) + np.repeat(np.where(turned, -1, 1), count) * within
        rows = self.segments.run(i, np.repeat(turned, count))
        vertices, ends = begin if closed else begin[1:], rows.ends
        gaps = np.linalg.norm(ends[vertices - 1] - rows.starts[vertices], axis=1)
        wide = gaps > NO_GAP
        if wide.any():
            rows = _close_gaps(rows, ends, vertices[wide], tolerance)
        return Path(segments=rows)


def _close_gaps(rows: Segments, ends: FloatArray, vertices: IntArray, tolerance: float) -> Segments:
    """Segments whose ends at some vertices meet in the middle of the gap before them.

    An arc that would move by more than the tolerance stays, and lines go to the middle and on.

    Args:
        rows: The segments.
        ends: Their last points, (n, dimension).
        vertices: Segments at whose starts there is a gap.
        tolerance: No point is moved by more [m].
    """
    to_start, to_end = rows.starts.copy(), ends.copy()
    middle = (ends[vertices - 1] + rows.starts[vertices]) / 2
    to_start[vertices] = to_end[vertices - 1] = middle
    changed = np.zeros(len(rows), dtype=bool)
    changed[vertices] = changed[vertices - 1] = True
    line, arc = changed & (rows.curvatures == 0), changed & (rows.curvatures > 0)
    stays = arc.copy()
    stays[arc] = _shift(rows[arc], ends[arc], to_start[arc], to_end[arc]) > tolerance
    moves = arc & ~stays
    moved = rows.put(line, _lines(rows[line], to_start[line], to_end[line]))
    if moves.any():
        moved = moved.put(moves, _stretch(rows[moves], ends[moves], to_start[moves], to_end[moves]))
    # Lines from the middle of a gap to an arc that stays, and on; what is a point is left out.
    before, after = _lines(rows, to_start, rows.starts), _lines(rows, ends, to_end)
    used = [
        stays & (before.lengths > REPEATED_POINT),
        ~line | (moved.lengths > REPEATED_POINT),
        stays & (after.lengths > REPEATED_POINT),
    ]
    in_order = np.arange(3 * len(rows)).reshape(3, -1).T[np.column_stack(used)]
    return Segments.join([before, moved, after])[in_order]


def _lines(rows: Segments, starts: FloatArray, ends: FloatArray) -> Segments:
    """Lines between points, with the demands of segments."""
    chords = ends - starts
    lengths = np.linalg.norm(chords, axis=1)
    return rows.replace(
        starts=starts,
        tangents=chords / np.where(lengths > 0, lengths, 1.0)[:, None],
        normals=np.zeros_like(chords),
        curvatures=np.zeros(len(rows)),
        lengths=lengths,
    )


def _shift(
    arcs: Segments, ends: FloatArray, to_start: FloatArray, to_end: FloatArray
) -> FloatArray:
    """How far a point of an arc moves at most if its ends move, by similarity [m]."""
    at_start, at_end = to_start - arcs.starts, to_end - ends
    chord = np.linalg.norm(ends - arcs.starts, axis=1)
    reach = np.where(arcs.curvatures * arcs.lengths < np.pi, chord, 2 / arcs.curvatures)
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.linalg.norm(at_end - at_start, axis=1) / chord
        shift = np.linalg.norm(at_start, axis=1) + change * reach
    # A similarity is found for small changes only.
    return np.where(change < 0.5, shift, np.inf)


def _stretch(
    arcs: Segments, ends: FloatArray, to_start: FloatArray, to_end: FloatArray
) -> Segments:
    """Arcs put between new ends, with the same swept angles."""
    old, new = ends - arcs.starts, to_end - to_start
    size, wanted = np.linalg.norm(old, axis=1), np.linalg.norm(new, axis=1)
    a, b = old / size[:, None], new / wanted[:, None]
    scale = wanted / size

    def turned(v: FloatArray) -> FloatArray:
        # The least rotation from a to b.
        part = np.sum((a + b) * v, axis=1) / (1 + np.sum(a * b, axis=1))
        v = v - part[:, None] * (a + b) + 2 * np.sum(a * v, axis=1)[:, None] * b
        return np.asarray(v / np.linalg.norm(v, axis=1)[:, None])

    return arcs.replace(
        starts=to_start,
        tangents=turned(arcs.tangents),
        normals=turned(arcs.normals),
        curvatures=arcs.curvatures / scale,
        lengths=arcs.lengths * scale,
    )
