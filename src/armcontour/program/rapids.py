"""Changes rapids after their contours got new end points."""

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
    """Whether a rapid, dwell or event comes before move i, a contour, so that its start is kept.

    Without a rapid, something must come between the contour and the contour before it.
    """
    for k in range(i - 1, -1, -1):
        if isinstance(moves[k], Rapid):
            return True
        if isinstance(moves[k], Contour):
            return k < i - 1
    return False


def next_rapid(moves: Sequence[Move], order: Iterable[int]) -> int | None:
    """Index of the first rapid in the given order, if it has a path and no contour comes first.

    Args:
        moves: The moves of a program.
        order: Indices of moves to search, in order.
    """
    for k in order:
        x = moves[k]
        if isinstance(x, Rapid):
            return k if x.path is not None else None
        if isinstance(x, Contour):
            return None
    return None


def leading_away(moves: Sequence[Move]) -> set[Rapid]:
    """Rapids whose path starts at the end of the contour before them."""
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
    """End point of the last contour [m]; None without contours."""
    last = next((x.path for x in reversed(moves) if isinstance(x, Contour)), None)
    return None if last is None else last(last.length)


def reroute(
    rapid: Move, *, start: FloatArray | None = None, end: FloatArray | None = None
) -> Rapid:
    """A rapid with new end points, as leads and overlaps move the ends of contours.

    A rapid whose points all coincide becomes a joint motion without a path.

    Args:
        rapid: The rapid.
        start: New start point [m]; by default the old one.
        end: New end point [m]; by default the old one.
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
    """A rapid along a path with arcs, extended by lines from the new start and to the new end."""
    gaps = ((first, path(0.0)), (path(path.length), last))
    before, after = (
        [Path.polyline(x)] if np.linalg.norm(x[1] - x[0]) > REPEATED_POINT else [] for x in gaps
    )
    return Rapid(path=join_paths([*before, dataclasses.replace(path, orientation=None), *after]))
