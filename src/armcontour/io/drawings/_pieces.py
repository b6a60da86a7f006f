"""One table of the segments of many pieces, so that joining thousands of pieces is fast."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._parts import number_parts
from armcontour.geometry import Path, Segments
from armcontour.geometry.segments import REPEATED_POINT

# Smaller gaps [m] stay open: closing them would change the tangents of short segments.
NO_GAP = 0.5 * REPEATED_POINT


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Pieces:
    """The segments of all pieces in sequence.

    Args:
        segments: The segments.
        first: Index of the first segment of each piece, then the number of segments,
            (pieces + 1,).
    """

    segments: Segments
    first: IntArray

    @classmethod
    def of(cls, paths: Sequence[Path]) -> Pieces:
        """The table of the segments of paths, one piece per path."""
        first = np.concatenate([[0], np.cumsum([len(path) for path in paths])])
        return cls(segments=Segments.join([path.segments for path in paths]), first=first)

    @property
    def starts(self) -> FloatArray:
        """Start points of the pieces [m], (pieces, dimension)."""
        return self.segments.starts[self.first[:-1]]

    @property
    def ends(self) -> FloatArray:
        """End points of the pieces [m], (pieces, dimension)."""
        return self.segments[self.first[1:] - 1].ends

    @property
    def tangents(self) -> FloatArray:
        """Unit tangents at the start points of the pieces, (pieces, dimension)."""
        return self.segments.tangents[self.first[:-1]]

    @property
    def end_tangents(self) -> FloatArray:
        """Unit tangents at the end points of the pieces, (pieces, dimension)."""
        return self.segments[self.first[1:] - 1].end_tangents

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the pieces [m], (pieces,)."""
        return np.asarray(np.add.reduceat(self.segments.lengths, self.first[:-1]))

    @property
    def middles(self) -> FloatArray:
        """Points of the pieces at half of their lengths [m], (pieces, dimension)."""
        breaks = self.segments.breaks
        half = breaks[self.first[:-1]] + self.lengths / 2
        i = np.clip(np.searchsorted(breaks, half) - 1, self.first[:-1], self.first[1:] - 1)
        return self.segments.at(i, np.clip(half - breaks[i], 0.0, self.segments.lengths[i]))

    def join(self, entries: Sequence[int], closed: bool, tolerance: float) -> Path:
        """The path through pieces in the given order, with the gaps between them closed.

        Args:
            entries: For each piece 2 i if piece i is followed forwards, 2 i + 1 if backwards.
            closed: Whether the last piece joins the first one.
            tolerance: Largest displacement of a point [m].
        """
        entered = np.asarray(entries, dtype=np.intp)
        piece, backwards = entered // 2, entered % 2 == 1
        count = self.first[piece + 1] - self.first[piece]
        of, within = number_parts(count)
        base = np.where(backwards, self.first[piece + 1] - 1, self.first[piece])
        rows = self.segments.run(base[of] + np.where(backwards, -1, 1)[of] * within, backwards[of])
        start = np.cumsum(count) - count
        vertices, ends = start if closed else start[1:], rows.ends
        gaps = np.linalg.norm(ends[vertices - 1] - rows.starts[vertices], axis=1)
        wide = gaps > NO_GAP
        if wide.any():
            rows = _close_gaps(rows, ends, vertices[wide], tolerance)
        return Path(segments=rows)


def _close_gaps(rows: Segments, ends: FloatArray, vertices: IntArray, tolerance: float) -> Segments:
    """Close gaps between segments: both neighbours are moved to the middle of the gap.

    An arc that would move by more than the tolerance stays; lines connect it to the middle of the
    gap.

    Args:
        rows: The segments.
        ends: End points of the segments [m], (n, dimension).
        vertices: Indices of the segments with a gap before their start.
        tolerance: Largest displacement of a point [m].
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
    # Lines connect an arc that stays to the middles of the gaps before and after it; lines without
    # length are left out.
    before, after = _lines(rows, to_start, rows.starts), _lines(rows, ends, to_end)
    used = [
        stays & (before.lengths > REPEATED_POINT),
        ~line | (moved.lengths > REPEATED_POINT),
        stays & (after.lengths > REPEATED_POINT),
    ]
    in_order = np.arange(3 * len(rows)).reshape(3, -1).T[np.column_stack(used)]
    return Segments.join([before, moved, after])[in_order]


def _lines(rows: Segments, starts: FloatArray, ends: FloatArray) -> Segments:
    """Lines between points, with the speeds and tolerances of the given segments."""
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
    """Largest displacement of a point of each arc if `_stretch` moves the arc's ends [m], (n,).

    Args:
        arcs: The arcs.
        ends: End points of the arcs [m], (n, dimension).
        to_start: New start points [m], same shape.
        to_end: New end points [m], same shape.
    """
    at_start, at_end = to_start - arcs.starts, to_end - ends
    chord = np.linalg.norm(ends - arcs.starts, axis=1)
    reach = np.where(arcs.curvatures * arcs.lengths < np.pi, chord, 2 / arcs.curvatures)
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.linalg.norm(at_end - at_start, axis=1) / chord
        shift = np.linalg.norm(at_start, axis=1) + change * reach
    # The estimate holds for small changes only.
    return np.where(change < 0.5, shift, np.inf)


def _stretch(
    arcs: Segments, ends: FloatArray, to_start: FloatArray, to_end: FloatArray
) -> Segments:
    """Scale and rotate arcs to new end points, with the arguments of `_shift`; angles stay."""
    old, new = ends - arcs.starts, to_end - to_start
    size, wanted = np.linalg.norm(old, axis=1), np.linalg.norm(new, axis=1)
    a, b = old / size[:, None], new / wanted[:, None]
    scale = wanted / size

    def turned(v: FloatArray) -> FloatArray:
        # The smallest rotation from a to b.
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
