"""Repair of vertices that are almost tangent because of rounded coordinates."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.frames import angle_between
from armcontour.geometry.biarcs import biarc_distance, make_biarcs, unit
from armcontour.geometry.path import Path
from armcontour.geometry.rounding.arc_corners import LARGEST_ARC_TURN
from armcontour.geometry.rounding.collinear_lines import MergedLines, merge_lines
from armcontour.geometry.rounding.rounded_path import blend_vertices
from armcontour.geometry.segments import EVERY, TANGENT_TOLERANCE, Segments

# Largest turn of a repaired vertex [rad]; larger turns are corners.
LARGEST_KINK = 0.05
# Fractions of the replaced lengths at the closing vertex of a closed path at which the path is
# compared with the new arcs.
SHARES = np.linspace(0.0, 1.0, 9)
# Row 0 of a table with one segment, for every fraction.
FIRST_ROWS = np.zeros(len(SHARES), dtype=np.intp)
# These lengths are halved at most this number of times. If they do not suffice, the vertex stays
# unchanged.
MAX_HALVINGS = 20


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RepairedPath:
    """A path with repaired vertices."""

    path: Path
    before: FloatArray  # Arc lengths on the path before the repair [m], increasing, (n,)
    after: FloatArray  # Corresponding arc lengths on the repaired path [m], (n,)
    count: int  # Number of repaired vertices
    kink: float  # Largest turn of a repaired vertex before the repair [rad]
    deviation: float  # Largest distance between the original and the repaired path [m]

    def place(self, s: npt.ArrayLike) -> FloatArray:
        """Return arc lengths on the repaired path for arc lengths before the repair [m]."""
        return np.asarray(np.interp(np.asarray(s, dtype=np.float64), self.before, self.after))


def repair_tangents(
    path: Path, tolerance: float, deviation_limit: float = np.inf
) -> RepairedPath | None:
    """Make almost tangent vertices exactly tangent; None without such vertices.

    A vertex is almost tangent if small movements of points explain its turn. If both ends of a line
    move by a distance, the line turns by up to twice the distance divided by its length; for an
    arc, divided by its length or radius. At most half of each segment changes per vertex. The
    corner errors of segments also bound the repair, unless they are 0: then only corners stay
    exact. The closing point of a closed path does not move.

    The original and the repaired path are at most the smaller of `tolerance` and `deviation_limit`
    [m] apart.

    `tolerance` is the largest movement of points [m].
    """
    largest_deviation = min(tolerance, deviation_limit)
    # A corner error of 0 bounds no repair, because a repaired vertex is no corner.
    corner_errors = np.where(path.vertex_tolerances > 0, path.vertex_tolerances, np.inf)
    allowed = np.minimum(corner_errors, largest_deviation)
    merged = merge_lines(path, allowed)
    possible_turns = _possible_turns(merged.path.segments, tolerance)
    inner = _repair_inner_vertices(path, merged, possible_turns, allowed)
    open_path = path
    end_deviation = 0.0
    if inner is not None:
        open_path = inner.path
        end_deviation = max(merged.deviation[0], merged.deviation[-1])
    closing_limit = float(np.min(np.append(_closing_errors(path), largest_deviation)))
    closing = _repair_closure(
        open_path,
        min(possible_turns[0] + possible_turns[-1], LARGEST_KINK),
        closing_limit - end_deviation,
    )
    if inner is None or closing is None:
        return inner or closing
    return RepairedPath(
        path=closing.path,
        before=inner.before,
        after=closing.place(inner.after),
        count=inner.count + 1,
        kink=max(inner.kink, closing.kink),
        deviation=max(inner.deviation, closing.deviation + end_deviation),
    )


def _possible_turns(segments: Segments, tolerance: float) -> FloatArray:
    """Return angles by which segments turn if their ends move by `tolerance` [m], (n,)."""
    longest = 1 / np.maximum(segments.curvatures, 1 / segments.lengths)
    return np.asarray(2 * tolerance / np.minimum(segments.lengths, longest))


def _repair_inner_vertices(
    path: Path, merged: MergedLines, possible_turns: FloatArray, allowed: FloatArray
) -> RepairedPath | None:
    """Repair the vertices between segments; None if no vertex is repaired.

    - `merged`: the path in which lines replace nearly collinear lines, m segments.
    - `possible_turns`: turns of its segments that moved points explain [rad], (m,).
    - `allowed`: largest deviations at the inner vertices of `path` [m], (n - 1,).
    """
    # A vertex and the lines next to it move by at most the tolerance together.
    line_deviation = np.maximum(merged.deviation[:-1], merged.deviation[1:])
    allowed = allowed[merged.vertex] - line_deviation
    turns = merged.path.turns
    largest = np.minimum(possible_turns[:-1] + possible_turns[1:], LARGEST_KINK)
    vertex = np.flatnonzero((turns > TANGENT_TOLERANCE) & (turns <= largest) & (allowed > 0))
    if not len(vertex) and merged.path is path:
        return None
    blended = blend_vertices(merged.path, vertex, turns[vertex], allowed[vertex])
    is_replaced = ~blended.corners.stopped
    repaired = path.turns > TANGENT_TOLERANCE
    repaired[np.delete(merged.vertex, vertex[is_replaced])] = False
    if not repaired.any():
        return None
    ends = np.concatenate([[0], merged.vertex + 1, [len(path)]])
    after = np.minimum(blended.place(merged.path.breaks), blended.length)
    error = (blended.corners.error + line_deviation[vertex])[is_replaced]
    return RepairedPath(
        path=_keep_waypoints(path, blended, ends, after, vertex[is_replaced] + 1),
        before=path.breaks[ends],
        after=after,
        count=int(repaired.sum()),
        kink=float(path.turns[repaired].max()),
        deviation=float(np.max(error, initial=merged.deviation.max())),
    )


def _keep_waypoints(
    path: Path, blended: Path, ends: IntArray, after: FloatArray, replaced: IntArray
) -> Path:
    """Return the repaired path, with the waypoints of the path before the repair.

    Waypoints keep their numbers. They are no vertices if a line or an arc replaced them.

    - `ends`: vertices of `path` where merged lines start and end, (m + 1,).
    - `after`: arc lengths of these vertices on the repaired path [m], (m + 1,).
    - `replaced`: indices in `ends` of the vertices that an arc replaced.
    """
    remains = np.isin(path.waypoints, np.delete(ends, replaced))
    middles = (blended.breaks[1:] + blended.breaks[:-1]) / 2
    s = after[np.searchsorted(ends, path.waypoints[remains])]
    points = np.arange(len(path.waypoints) + len(path.merged))
    removed = np.delete(points, path.merged)[~remains].tolist()
    return Path(
        segments=blended.segments,
        merged=tuple(sorted([*path.merged, *removed])),
        waypoints=np.searchsorted(middles, s),
    )


def _closing_errors(path: Path) -> FloatArray:
    """Return the corner errors above 0 of the first and the last segment [m], (k,)."""
    errors = path.tolerances[[0, -1]]
    return np.asarray(errors[errors > 0])


def _repair_closure(path: Path, largest_turn: float, allowed: float) -> RepairedPath | None:
    """Replace both ends of a closed path by two arcs each, which are tangent where it closes.

    Returns None if the path has no almost tangent closing vertex, or no arcs within the tolerance.

    - `largest_turn`: largest turn of a repaired vertex [rad].
    - `allowed`: largest deviation from the path [m].
    """
    rows = path.segments
    first = rows[:1]
    last = rows[-1:]
    kink = float(angle_between(last.end_tangents, first.tangents)[0])
    if len(rows) == 1 or not rows.closed or not allowed > 0:
        return None
    if not TANGENT_TOLERANCE < kink <= largest_turn:
        return None
    closure = _fit_closure(first, last, allowed)
    if closure is None:
        return None
    t = closure.size
    total = path.length
    begin = np.zeros(len(rows))
    end = rows.lengths.copy()
    begin[0] = t
    end[-1] -= t
    kept = rows.cut(np.arange(len(rows)), begin, end)
    opening = [x.replace(**first.limit_columns) for x in closure.leaving]
    closing = [x.replace(**last.limit_columns) for x in closure.arriving]
    table = Segments.join([*opening, kept, *closing])
    opening_length = float(sum(x.lengths[0] for x in closure.leaving))
    closing_length = float(sum(x.lengths[0] for x in closure.arriving))
    waypoints = np.concatenate([[0], path.waypoints[1:-1] + 2, [len(table)]])
    return RepairedPath(
        path=Path(segments=table, merged=path.merged, waypoints=waypoints),
        before=np.array([0.0, t, total - t, total]),
        after=np.cumsum([0.0, opening_length, total - 2 * t, closing_length]),
        count=1,
        kink=kink,
        deviation=closure.deviation,
    )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Closure:
    """Arcs that are tangent at the closing vertex of a closed path."""

    size: float  # Length that the arcs replace on either side of the vertex [m]
    leaving: tuple[Segments, Segments]  # The two arcs after the vertex
    arriving: tuple[Segments, Segments]  # The two arcs before the vertex
    deviation: float  # Largest distance of the path from the arcs [m]


def _fit_closure(first: Segments, last: Segments, allowed: float) -> _Closure | None:
    """Fit arcs at a closing vertex; None if the deviation does not become small enough.

    The replaced length starts at half of the shorter segment, and is halved until the deviation is
    within the tolerance.

    - `first`, `last`: the first and the last segment of the path.
    - `allowed`: largest deviation [m].
    """
    middle = unit(first.tangents + last.end_tangents)
    size = np.minimum(first.lengths, last.lengths) / 2
    size = np.minimum(
        size, LARGEST_ARC_TURN / np.maximum(np.maximum(first.curvatures, last.curvatures), 1e-300)
    )
    for _ in range(MAX_HALVINGS):
        begin = last.lengths - size
        leaving = make_biarcs(
            first.starts, middle, first.evaluate(EVERY, size), first.evaluate(EVERY, size, 1)
        )
        arriving = make_biarcs(
            last.evaluate(EVERY, begin), last.evaluate(EVERY, begin, 1), last.ends, middle
        )
        deviation = max(
            float(biarc_distance(row.evaluate(FIRST_ROWS, start + size * SHARES)[None], *arcs)[0])
            for row, start, arcs in ((first, 0.0, leaving), (last, begin, arriving))
        )
        if deviation <= allowed:
            return _Closure(
                size=float(size[0]), leaving=leaving, arriving=arriving, deviation=deviation
            )
        size = size / 2
    return None
