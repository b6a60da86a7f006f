"""Rapids of a program that link its contours: where they lead, and between which ends they go."""

from __future__ import annotations

import dataclasses
from collections.abc import Iterable, Sequence

import numpy as np

from armcontour._checks import FloatArray
from armcontour.geometry import Path
from armcontour.geometry.cutting import join_paths
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program.moves import Contour, Move, Rapid


def is_meant(moves: Sequence[Move], i: int) -> bool:
    """Whether the program itself leads to where its move i begins, a contour."""
    for k in range(i - 1, -1, -1):
        if isinstance(moves[k], Rapid):
            return True
        if isinstance(moves[k], Contour):
            return k < i - 1
    return False


def next_rapid(moves: Sequence[Move], order: Iterable[int]) -> int | None:
    """The first rapid along a path, if the tool only stands still between."""
    for k in order:
        x = moves[k]
        if isinstance(x, Rapid):
            return k if x.path is not None else None
        if isinstance(x, Contour):
            return None
    return None


def leading_away(moves: Sequence[Move]) -> set[Rapid]:
    """Rapids that begin where the contour before them ends."""
    found = set()
    for i, x in enumerate(moves):
        k = next_rapid(moves, range(i + 1, len(moves))) if isinstance(x, Contour) else None
        if k is None or not isinstance(x, Contour):
            continue
        rapid = moves[k]
        assert isinstance(rapid, Rapid) and rapid.path is not None
        if np.linalg.norm(rapid.path(0.0) - x.path(x.path.length)) <= REPEATED_POINT:
            found.add(rapid)
    return found


def last_end(moves: Sequence[Move]) -> FloatArray | None:
    """Where the last contour ends."""
    last = next((x.path for x in reversed(moves) if isinstance(x, Contour)), None)
    return None if last is None else last(last.length)


def reroute(
    rapid: Move, *, start: FloatArray | None = None, end: FloatArray | None = None
) -> Rapid:
    """A rapid between other ends: leads and overlaps have moved those of its contours.

    It is left to the joints if there is no way between them.
    """
    assert isinstance(rapid, Rapid)
    if rapid.path is None:
        return rapid
    vertices = rapid.path.vertices
    first = vertices[0] if start is None else start
    last = vertices[-1] if end is None else end
    moved = np.linalg.norm([first - vertices[0], last - vertices[-1]], axis=1)
    if (moved <= REPEATED_POINT).all():
        return rapid
    if rapid.path.curvatures.any():
        return _prolong(rapid.path, first, last)
    points = np.array([first, *vertices[1:-1], last])
    if (np.linalg.norm(points - first, axis=1) <= REPEATED_POINT).all():
        return Rapid()
    return Rapid(path=Path.polyline(points))


def _prolong(path: Path, first: FloatArray, last: FloatArray) -> Rapid:
    """A rapid that goes in arcs, with lines from and to other ends."""
    ways = ((first, path(0.0)), (path(path.length), last))
    before, after = (
        [Path.polyline(x)] if np.linalg.norm(x[1] - x[0]) > REPEATED_POINT else [] for x in ways
    )
    return Rapid(path=join_paths([*before, dataclasses.replace(path, orientation=None), *after]))
