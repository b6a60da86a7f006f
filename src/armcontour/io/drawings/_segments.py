"""The segments of many paths in one table, so that joining thousands of them costs little."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.geometry import Path
from armcontour.geometry.cutting import PER_SEGMENT
from armcontour.geometry.path import REPEATED_POINT

# A gap of half a repeated point stays: closing it would spoil the tangents.
NO_GAP = 0.5 * REPEATED_POINT


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Segments:
    """All segments of some pieces one after the other, and what is at their ends.

    Args:
        table: What a path holds of every segment, by its name.
        tags: Their tags.
        ends: Last points of the segments, (n, dimension).
        end_tangents: Tangents there, same shape.
        end_inwards: Vectors towards the centre there, same shape.
        first: First segment of every piece, and the number of segments, (pieces + 1,).
    """

    table: dict[str, FloatArray]
    tags: tuple[str | None, ...]
    ends: FloatArray
    end_tangents: FloatArray
    end_inwards: FloatArray
    first: IntArray

    @classmethod
    def of(cls, paths: Sequence[Path]) -> Segments:
        """The segments of paths."""
        table = {x: np.concatenate([getattr(path, x) for path in paths]) for x in PER_SEGMENT}
        turn = table["curvatures"] * table["lengths"]
        c, s = np.cos(turn)[:, None], np.sin(turn)[:, None]
        tangents, inwards = table["tangents"], table["inwards"]
        return cls(
            table=table,
            tags=tuple(tag for path in paths for tag in path.tags),
            ends=_points(table, table["lengths"]),
            end_tangents=c * tangents + s * inwards,
            end_inwards=c * inwards - s * tangents,
            first=np.concatenate([[0], np.cumsum([len(path) for path in paths])]),
        )

    @property
    def begin_points(self) -> FloatArray:
        """Where the pieces start, (pieces, dimension)."""
        return self.table["starts"][self.first[:-1]]

    @property
    def end_points(self) -> FloatArray:
        """Where the pieces end."""
        return self.ends[self.first[1:] - 1]

    @property
    def begin_tangents(self) -> FloatArray:
        """Tangents where the pieces start."""
        return self.table["tangents"][self.first[:-1]]

    @property
    def last_tangents(self) -> FloatArray:
        """Tangents where the pieces end."""
        return self.end_tangents[self.first[1:] - 1]

    @property
    def piece_lengths(self) -> FloatArray:
        """Lengths of the pieces [m], (pieces,)."""
        return np.asarray(np.add.reduceat(self.table["lengths"], self.first[:-1]))

    @property
    def middle_points(self) -> FloatArray:
        """The pieces' points at half of their lengths."""
        lengths = self.table["lengths"]
        before = np.concatenate([[0.0], np.cumsum(lengths)])
        half = before[self.first[:-1]] + self.piece_lengths / 2
        i = np.clip(np.searchsorted(before, half) - 1, self.first[:-1], self.first[1:] - 1)
        chosen = {name: values[i] for name, values in self.table.items()}
        return _points(chosen, np.clip(half - before[i], 0.0, lengths[i]))

    def joined(self, entries: Sequence[int], closed: bool, tolerance: float) -> Path:
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
        table, ends = self._directed(i, np.repeat(turned, count))
        tags = tuple(self.tags[k] for k in i)
        joints = begin if closed else begin[1:]
        gap = ends[joints - 1] - table["starts"][joints]
        wide = np.linalg.norm(gap, axis=1) > NO_GAP
        if wide.any():
            table, tags = _closed_gaps(table, ends, tags, joints[wide], tolerance)
        arrays: dict[str, Any] = dict(table)
        return Path(**arrays, tags=tags)

    def _directed(self, i: IntArray, back: BoolArray) -> tuple[dict[str, FloatArray], FloatArray]:
        """Segments, some of them run backwards, and their last points."""
        table = {name: values[i] for name, values in self.table.items()}
        ends, k = self.ends[i], i[back]
        ends[back] = table["starts"][back]
        table["starts"][back] = self.ends[k]
        table["tangents"][back] = -self.end_tangents[k]
        table["inwards"][back] = self.end_inwards[k]
        return table, ends


def _points(table: dict[str, FloatArray], u: FloatArray) -> FloatArray:
    """Points of segments at a distance from their starts."""
    turn = table["curvatures"] * u
    along, inward = u * np.sinc(turn / np.pi), u * turn / 2 * np.sinc(turn / (2 * np.pi)) ** 2
    return np.asarray(
        table["starts"] + along[:, None] * table["tangents"] + inward[:, None] * table["inwards"]
    )


def _closed_gaps(
    table: dict[str, FloatArray],
    ends: FloatArray,
    tags: tuple[str | None, ...],
    joints: IntArray,
    tolerance: float,
) -> tuple[dict[str, FloatArray], tuple[str | None, ...]]:
    """Segments whose ends at some joints meet in the middle of the gap before them.

    An arc that would move by more than the tolerance stays, and lines go to the middle and on.
    """
    starts = table["starts"]
    new_starts, new_ends = starts.copy(), ends.copy()
    middle = (ends[joints - 1] + starts[joints]) / 2
    new_starts[joints], new_ends[joints - 1] = middle, middle
    changed = np.zeros(len(starts), dtype=bool)
    changed[joints] = changed[joints - 1] = True
    line = changed & (table["curvatures"] == 0)
    arc = changed & ~line
    kept_arc = arc.copy()
    kept_arc[arc] = _moved(table, ends, new_starts, new_ends, arc) > tolerance
    _stretch(table, ends, new_starts, new_ends, arc & ~kept_arc)
    chord = new_ends[line] - new_starts[line]
    size = np.linalg.norm(chord, axis=1)
    starts[line], table["lengths"][line] = new_starts[line], size
    # What collapses to a point is left out.
    nothing = np.zeros(len(starts), dtype=bool)
    nothing[line] = size <= REPEATED_POINT
    table["tangents"][line] = chord / np.where(size > 0, size, 1.0)[:, None]
    return _with_bridges(table, tags, kept_arc, nothing, (new_starts, ends, new_ends))


def _moved(
    table: dict[str, FloatArray],
    ends: FloatArray,
    new_starts: FloatArray,
    new_ends: FloatArray,
    which: BoolArray,
) -> FloatArray:
    """How far a point of an arc moves at most if its ends move, by similarity [m]."""
    start, end = table["starts"][which], ends[which]
    begun, ended = new_starts[which] - start, new_ends[which] - end
    chord = np.linalg.norm(end - start, axis=1)
    k, u = table["curvatures"][which], table["lengths"][which]
    reach = np.where(k * u < np.pi, chord, 2 / k)
    with np.errstate(divide="ignore", invalid="ignore"):
        change = np.linalg.norm(ended - begun, axis=1) / chord
        moved = np.linalg.norm(begun, axis=1) + change * reach
    # A similarity is found for small changes only.
    return np.where(change < 0.5, moved, np.inf)


def _stretch(
    table: dict[str, FloatArray],
    ends: FloatArray,
    new_starts: FloatArray,
    new_ends: FloatArray,
    which: BoolArray,
) -> None:
    """Put arcs between new ends, with the same swept angle."""
    if not which.any():
        return
    old, new = (ends - table["starts"])[which], (new_ends - new_starts)[which]
    size, wanted = np.linalg.norm(old, axis=1), np.linalg.norm(new, axis=1)
    a, b = old / size[:, None], new / wanted[:, None]
    for name in ("tangents", "inwards"):
        v = table[name][which]
        # The least rotation from a to b.
        part = np.sum((a + b) * v, axis=1) / (1 + np.sum(a * b, axis=1))
        v = v - part[:, None] * (a + b) + 2 * np.sum(a * v, axis=1)[:, None] * b
        table[name][which] = v / np.linalg.norm(v, axis=1)[:, None]
    scale = wanted / size
    table["starts"][which] = new_starts[which]
    table["curvatures"][which] /= scale
    table["lengths"][which] *= scale


def _with_bridges(
    table: dict[str, FloatArray],
    tags: tuple[str | None, ...],
    kept_arc: BoolArray,
    nothing: BoolArray,
    points: tuple[FloatArray, FloatArray, FloatArray],
) -> tuple[dict[str, FloatArray], tuple[str | None, ...]]:
    """Lines from the middle of a gap to arcs that stay, and on; nothing where there is nothing."""
    if not (kept_arc.any() or nothing.any()):
        return table, tags
    new_starts, ends, new_ends = points
    pieces: list[tuple[dict[str, Any], str | None]] = []
    for i in range(len(tags)):
        row = {name: values[i] for name, values in table.items()}
        if kept_arc[i]:
            pieces += _bridge(row, new_starts[i], row["starts"], tags[i])
        if not nothing[i]:
            pieces.append((row, tags[i]))
        if kept_arc[i]:
            pieces += _bridge(row, ends[i], new_ends[i], tags[i])
    arrays = {name: np.array([row[name] for row, _ in pieces]) for name in table}
    return arrays, tuple(tag for _, tag in pieces)


def _bridge(
    row: dict[str, Any], start: FloatArray, end: FloatArray, tag: str | None
) -> list[tuple[dict[str, Any], str | None]]:
    """A line with the demands of a segment, if it is one."""
    chord = end - start
    size = float(np.linalg.norm(chord))
    if size <= REPEATED_POINT:
        return []
    line = {
        "starts": start,
        "tangents": chord / size,
        "inwards": np.zeros_like(chord),
        "curvatures": 0.0,
        "lengths": size,
    }
    return [({**row, **line}, tag)]
