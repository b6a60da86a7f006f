"""Outlines of chains and splines, which become paths."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.files.drawings.chain import Affine, Chain, draw_plain
from armcontour.files.drawings.splines import Spline, fit_splines
from armcontour.geometry import Path, Segments

# The gap of a closed outline is closed by moving the end only if it is at most this fraction of
# the length of the last line, arc or curve; otherwise a line closes it.
SMALL_GAP = 0.1

Shape = Chain | Spline


@dataclass(frozen=True, slots=True, eq=False)
class Outline:
    """Shapes in sequence.

    Args:
        shapes: The shapes, each of which starts at the end of the one before.
        closed: Whether the last shape must end where the first one starts.
    """

    shapes: Sequence[Shape]
    closed: bool = False

    def place(self, to: Affine) -> Outline:
        """The image of the outline under an affine map."""
        return Outline([x.place(to) for x in self.shapes], self.closed)

    @property
    def reach(self) -> FloatArray:
        """Points whose largest coordinates tell how far the outline extends, (m, dimension)."""
        return np.concatenate([x.reach for x in self.shapes])

    def parts(self, tolerance: float, join: float) -> list[Segments | Spline]:
        """Segments of its chains, and its splines, each from the end of the part before.

        Args:
            tolerance: As in `paths_of` [m].
            join: As in `paths_of` [m].

        Raises:
            InvalidInput: An arc is too large for the tolerance.
        """
        parts: list[Segments | Spline] = []
        for shape in self.closed_up(join):
            x = shape
            if parts:
                before = parts[-1]
                at = before.points[-1] if isinstance(before, Spline) else before[-1:].ends[0]
                x = x.start_at(at)
            part = x.to_segments(tolerance) if isinstance(x, Chain) else x if x.has_length else None
            if part is not None:
                parts.append(part)
        return parts

    def closed_up(self, join: float) -> Sequence[Shape]:
        """The shapes, of a closed outline with its gap closed: by moving the end, or by a line.

        Args:
            join: As in `paths_of` [m].
        """
        if not self.closed:
            return self.shapes
        *others, last = self.shapes
        start, (before, end) = self.shapes[0].starts[0], last.last
        if np.array_equal(start, end):
            return self.shapes
        gap, size = (float(np.linalg.norm(end - x)) for x in (start, before))
        if gap > min(join, SMALL_GAP * size):
            return [*self.shapes, Chain.straight(np.stack([end, start]))]
        return [*others, last.end_at(start)]


def paths_of(
    outlines: Sequence[Outline],
    tolerance: float,
    join: float = 0.0,
    tell: Callable[[float], None] = lambda done: None,
) -> list[Path | None]:
    """The paths of outlines; None for an outline that has no length.

    Lines stay lines, and arcs of circles arcs; other curves become tangent arcs.

    Args:
        outlines: The outlines. The curves of all of them are fitted together, which is faster.
        tolerance: Largest distance between a curve and its arcs [m].
        join: Largest gap of a closed outline that is closed by moving its end [m].
        tell: Called from time to time with the fraction that is done.

    Raises:
        InvalidInput: A curve is too large for the tolerance; with the index of its outline.
    """
    plain = _draw_plain(outlines, tolerance, join)
    parts: list[list[Segments | Spline]] = []
    for i, outline in enumerate(outlines):
        with _indexed(i):
            parts.append([plain[i]] if i in plain else outline.parts(tolerance, join))
    places = [
        (i, k) for i, x in enumerate(parts) for k, part in enumerate(x) if isinstance(part, Spline)
    ]
    splines = [x for row in parts for x in row if isinstance(x, Spline)]
    try:
        for done, (n, segments) in enumerate(fit_splines(splines, tolerance)):
            i, k = places[n]
            parts[i][k] = segments
            tell((done + 1) / len(splines))
    except InvalidInput as error:
        assert error.index is not None
        raise InvalidInput(str(error), index=places[error.index][0]) from None
    return _join_parts([[x for x in row if isinstance(x, Segments)] for row in parts])


def _draw_plain(outlines: Sequence[Outline], tolerance: float, join: float) -> dict[int, Segments]:
    """What `Outline.parts` gives for outlines of one chain of lines and circular arcs, by index."""
    alone: dict[int, Chain] = {}
    for i, outline in enumerate(outlines):
        shapes = outline.closed_up(join)
        if len(shapes) == 1 and isinstance(shapes[0], Chain):
            alone[i] = shapes[0]
    drawn = draw_plain(list(alone.values()), tolerance)
    return {i: x for i, x in zip(alone, drawn, strict=True) if x is not None}


def _join_parts(rows: Sequence[Sequence[Segments]]) -> list[Path | None]:
    """A path of the parts of every outline; None for an outline without parts.

    Raises:
        InvalidInput: The parts of an outline do not make a path; with the index of the outline.
    """
    full = [i for i, x in enumerate(rows) if x]
    bounds = np.cumsum([0, *(sum(map(len, rows[i])) for i in full)])
    paths: list[Path | None] = [None] * len(rows)
    try:
        # All are checked at once, which is faster.
        tables = Segments.join([x for i in full for x in rows[i]]).split(bounds) if full else []
    except InvalidInput:
        # Each alone, for an error that names its outline.
        tables = [Segments.join(rows[i]) for i in full]
    for i, table in zip(full, tables, strict=True):
        with _indexed(i):
            paths[i] = Path(segments=table)
    return paths


@contextmanager
def _indexed(i: int) -> Iterator[None]:
    """Give an error the index of the outline that it comes from."""
    try:
        yield
    except InvalidInput as error:
        raise InvalidInput(str(error), index=i) from None
