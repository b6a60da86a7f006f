"""Approximation of a parametric curve by lines and tangent arcs within a tolerance."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.sampled_data import number_parts
from armcontour.geometry.biarcs import biarc_distance, dot, length, make_biarcs, unit
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.path import Path
from armcontour.geometry.prescribed_orientation import carry_frame
from armcontour.geometry.segments import (
    EVERY,
    REPEATED_POINT,
    TANGENT_TOLERANCE,
    Segments,
    close_gaps,
)

Curve = Callable[[FloatArray, int], FloatArray]
# Many curves in one call: `curves(row, t, order)` returns the point or derivative of curve `row[k]`
# at parameter `t[k]` for each k, (len(t), dimension).
Curves = Callable[[IntArray, FloatArray, int], FloatArray]

# Fractions of an interval at which its arcs are compared with the curve.
SAMPLES = np.linspace(0, 1, 17)
# Fraction of the tolerance that is allowed at these samples, because the deviation between samples
# is slightly larger.
TOLERANCE_SHARE = 0.9
# Largest number of parts into which one iteration splits an interval outside the tolerance.
MAX_PARTS = 8
# Largest number of intervals. If a curve needs more, an error reports that its tolerance is too
# small.
MAX_INTERVALS = 500_000
# Default tolerance of the arcs that replace transitions [m].
DEFAULT_TOLERANCE = 1e-7
# An interval outside the tolerance becomes a corner if its extent is at most this fraction of the
# tolerance.
CORNER_EXTENT = 1e-3
# A derivative below this fraction of the largest one counts as zero; the tangent is then computed
# as a limit.
ZERO_SPEED = 1e-10
# Fractions of the interval at which tangents are sampled for this limit, and weights with which a
# cubic through these four samples is extrapolated to 0.
NEAR_END = 2e-3 * 0.5 ** np.arange(4)
TO_ZERO = np.array([np.prod([-b / (a - b) for b in NEAR_END if b != a]) for a in NEAR_END])
# Rounding errors of points rotate a tangent by this factor times the ratio of the largest
# coordinate to the length of the interval [rad].
TANGENT_ROUNDING = 64 * np.finfo(float).eps
# Two tangents that are computed as limits count as equal if they differ by at most this angle
# [rad].
SAME_LIMIT = 1e-4
# Largest distance between two neighbouring samples, as a fraction of the interval's length. With a
# larger distance a deviation between samples could be missed, so the interval is split. A
# parametrization that starts from rest satisfies this limit.
LARGEST_SAMPLE_STEP = 0.35
# An interval is a line if the distance of the curve from the chord is at most the fraction ON_CHORD
# of the chord's length, plus the rounding error of points: POINT_ROUNDING times the largest
# coordinate. On short chords this rounding error is limited, so the chord is within the tangent
# tolerance.
ON_CHORD = 1e-12
POINT_ROUNDING = 16 * np.finfo(float).eps
# Neighbours are merged if their tangents differ by at most SAME_LINE [rad], or their radii and
# directions to the centre by at most SAME_CIRCLE (relative), and if merging moves the end point by
# at most SAME_POINT [m].
SAME_LINE = 1e-12
SAME_CIRCLE = 1e-10
SAME_POINT = 1e-11


def fit_many(
    curves: Curves, breaks: FloatArray, rows: IntArray, tolerance: float, *, separate: bool = False
) -> list[Segments]:
    """Return lines and tangent arcs along many curves, within a tolerance of the curves.

    Every interval becomes a biarc with the curve's end points and tangents; intervals are split
    until the biarcs are within the tolerance. Straight parts become one line, and neighbours on one
    circle become one arc. Corners remain where the tangents at a break differ, and at cusps; all
    other neighbours are tangent.

    - `curves`: `curves(row, t, order)` gives points [m] (order 0) or derivatives with respect to t
      (order 1) of the curves `row`, (n, 2) or (n, 3), for t of shape (n,). Curves are smooth
      between two breaks.
    - `breaks`: increasing values of t, those of each curve after those of the previous one, (n,).
    - `rows`: curve of each break, ascending from 0, (n,).
    - `tolerance`: largest distance of the arcs from the curve and of the curve from the arcs [m].
    - `separate`: fit each curve as if it were alone: it has the same rounding errors, and its last
      arcs are merged.
    """
    _check_tolerance(tolerance)
    arcs, vertices = _fit_curves(curves, breaks, rows, tolerance, through=False, separate=separate)
    ends = np.flatnonzero(np.diff(rows, append=-1))
    return [arcs[vertices[i] : vertices[i + 1]] for i in range(len(ends))]


def fit_through(curve: Curve, breaks: FloatArray, tolerance: float) -> tuple[Segments, IntArray]:
    """Return tangent arcs along a smooth curve as by `fit_many`, with a vertex at every break.

    Returns the arcs, and the index of the vertex at each break, (n,).
    """
    row = np.zeros(len(breaks), dtype=np.intp)
    return _fit_curves(_wrap_curve(curve), breaks, row, tolerance, through=True)


def draw_with_arcs(path: Path, tolerance: float = DEFAULT_TOLERANCE) -> tuple[Path, FloatArray]:
    """Return the path with tangent arcs instead of its transitions, within a tolerance [m].

    Returns the path, and corresponding arc lengths on both paths at the vertices [m], (n, 2).
    """
    rows = path.segments
    breaks = path.breaks
    arcs, vertices = fit_through(path, breaks, tolerance)
    source = np.repeat(np.arange(len(rows)), np.diff(vertices))
    drawn = np.flatnonzero(rows.is_transition[source])
    unchanged = np.flatnonzero(~rows.is_transition)
    columns = rows[source[drawn]].limit_columns
    lines = rows[unchanged].replace(quintics=np.empty((len(unchanged), 0, 0)))
    source = np.concatenate([unchanged, source[drawn]])
    order = np.argsort(source, kind="stable")
    table = Segments.join([lines, arcs[drawn].replace(**columns)])[order]
    first = np.searchsorted(source[order], np.arange(len(rows) + 1))
    matched_s = np.stack([breaks, table.breaks[first]], axis=1)
    waypoints = first[path.waypoints]
    orientation = path.orientation
    return Path(
        segments=table,
        merged=path.merged,
        waypoints=waypoints,
        orientation=None
        if orientation is None
        else _orient(orientation, table, matched_s[path.waypoints]),
    ), matched_s


def _orient(orientation: Orientation, table: Segments, matched_s: FloatArray) -> Orientation:
    """Transfer an orientation to the segments `table`.

    `matched_s` are the arc lengths of the waypoints on the old and on the new path [m], (n, 2).
    """
    if orientation.follows:
        carried = carry_frame(table, orientation.starts[0], axis_only=orientation.axis_only)
        return carried.with_cone(orientation.cone)
    middle = (table.breaks[:-1] + table.breaks[1:]) / 2
    before, after = matched_s.T
    ratio = (np.diff(before) / np.diff(after))[np.searchsorted(after[1:-1], middle)]
    rates, _ = orientation.rates(np.interp(middle, after, before))
    starts = orientation(np.interp(table.breaks[:-1], after, before))
    transferred = Orientation.even(
        table.lengths, starts, ratio[:, None] * rates, axis_only=orientation.axis_only
    )
    return transferred.with_cone(orientation.cone)


def _check_tolerance(tolerance: float) -> None:
    """Raise InvalidInput for a tolerance below the resolution of a point."""
    if checks.positive("tolerance of a curve", tolerance, "m") < REPEATED_POINT:
        raise InvalidInput(
            f"The tolerance of a curve must be at least {REPEATED_POINT:g} m, but is "
            f"{tolerance:g} m."
        )


def _wrap_curve(curve: Curve) -> Curves:
    """Wrap one curve as `Curves`."""
    return lambda row, t, order: np.asarray(curve(t, order))


def _fit_curves(
    curves: Curves,
    breaks: FloatArray,
    row: IntArray,
    tolerance: float,
    *,
    through: bool,
    separate: bool = False,
) -> tuple[Segments, IntArray]:
    """Fit all curves; also return the vertices at which segments are never merged.

    The indices end with the number of segments. With `through` every break is such a vertex, and
    all intervals become arcs; otherwise the start of each curve is such a vertex.
    """
    with np.errstate(all="ignore"):
        intervals = _split(curves, _intervals_of(curves, breaks, row), tolerance, lines=not through)
        intervals = _drop_points(intervals)
        arcs, first = _make_segments(intervals)
        if through:
            vertices = first[np.searchsorted(intervals.begin, breaks[:-1])]
        else:
            vertices = first[np.flatnonzero(np.diff(intervals.row, prepend=-1))]
        merged, rows = _merge_neighbours(arcs, vertices, vertices if separate else vertices[:1])
    return merged, np.append(np.searchsorted(rows, vertices), len(merged))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Intervals:
    """The n intervals of all curves, with their end points and tangents."""

    row: IntArray  # Index of the curve of each interval, (n,)
    begin: FloatArray  # Parameter at the start of each interval, (n,)
    end: FloatArray  # Parameter at the end of each interval, (n,)
    p0: FloatArray  # Points at the starts [m], (n, dimension)
    p1: FloatArray  # Points at the ends [m], (n, dimension)
    t0: FloatArray  # Unit tangents at the starts, (n, dimension)
    t1: FloatArray  # Unit tangents at the ends, (n, dimension)
    line: BoolArray  # Mask of the intervals that become lines, (n,)

    def select(self, chosen: Any, **changed: Any) -> _Intervals:
        """Select intervals by indices or by a mask, and replace some of their columns."""
        columns = {name: getattr(self, name)[chosen] for name in self.__slots__}
        return _Intervals(**{**columns, **changed})


def _intervals_of(curves: Curves, breaks: FloatArray, row: IntArray) -> _Intervals:
    """Make the intervals between neighbouring breaks of curves.

    - `breaks`, `row`: parameter and curve of each break, as in `fit_many`, (m,) each.
    """
    points = np.array(curves(row, breaks, 0), dtype=np.float64)
    if not np.isfinite(points).all():
        raise InvalidInput("A curve must be finite at its breaks.")
    first = np.flatnonzero(np.diff(row, prepend=-1))
    last = np.append(first[1:], len(row)) - 1
    closed = length(points[last] - points[first]) <= REPEATED_POINT
    points[last[closed]] = points[first[closed]]
    size = np.maximum.reduceat(np.abs(points).max(axis=1), first)[row]
    # An interval starts at every break except the last one of a curve, and ends at the next break.
    starts = np.delete(np.arange(len(row)), last)
    (t0, uncertainty0), (t1, uncertainty1) = _tangents(curves, breaks, row, starts, size[starts])
    n = len(starts)
    curve = row[starts]
    begin = np.flatnonzero(np.diff(curve, prepend=-1))
    end = np.append(begin[1:], n) - 1
    # `after`: index of the next interval. After the last interval of a curve, this is the first one
    # if the curve is closed, or else -1.
    after = np.arange(1, n + 1)
    after[end] = np.where(closed, begin, -1)
    before = np.flatnonzero(after >= 0)
    # Where both tangents at a break differ by rounding errors only, their mean replaces them.
    into = t1[before]
    out = t0[after[before]]
    uncertainty = np.maximum(uncertainty1[before], uncertainty0[after[before]])
    same = length(out - into) <= uncertainty
    common = unit(out + into)[same]
    before = before[same]
    t1[before] = common
    t0[after[before]] = common
    return _Intervals(
        row=curve,
        begin=breaks[starts],
        end=breaks[starts + 1],
        p0=points[starts],
        p1=points[starts + 1],
        t0=t0,
        t1=t1,
        line=np.zeros(n, dtype=bool),
    )


def _tangents(
    curves: Curves, breaks: FloatArray, row: IntArray, starts: IntArray, size: FloatArray
) -> list[tuple[FloatArray, FloatArray]]:
    """Return the unit tangents and their uncertainties [rad] at both ends of intervals.

    The first pair is at the starts, the second one at the ends, (n, dimension) and (n,) each.

    - `breaks`, `row`: parameter and curve of each break, (m,) each.
    - `starts`: index of the break at which each interval starts, (n,).
    - `size`: largest coordinate of each interval's curve [m], (n,).
    """
    row = row[starts]
    begin = breaks[starts]
    end = breaks[starts + 1]
    span = end - begin
    parameters = begin[:, None] + span[:, None] * SAMPLES[1:-1]
    largest_speed = length(_evaluate(curves, row, parameters, 1)).max(axis=1)
    zero_speed = ZERO_SPEED * largest_speed + POINT_ROUNDING * size / span
    tangents = []
    for t, sign in ((begin, 1.0), (end, -1.0)):
        # The derivative can jump at a break, so it is evaluated at the next floating-point number
        # inside the interval.
        derivative = curves(row, np.nextafter(t, t + sign * span), 1)
        at_rest = length(derivative) <= zero_speed
        direction = unit(derivative)
        if at_rest.any():
            near_end = t[at_rest, None] + sign * span[at_rest, None] * NEAR_END
            directions = unit(_evaluate(curves, row[at_rest], near_end, 1))
            direction[at_rest] = unit(np.einsum("k,nkd->nd", TO_ZERO, directions))
        uncertainty = TANGENT_ROUNDING * size / (span * length(derivative))
        uncertainty = np.clip(uncertainty, TANGENT_TOLERANCE, SAME_LIMIT)
        tangents.append((direction, np.where(at_rest, SAME_LIMIT, uncertainty)))
    return tangents


def _evaluate(curves: Curves, row: IntArray, parameters: FloatArray, order: int) -> FloatArray:
    """Return points or derivatives at k parameters of each interval, (n, k, dimension).

    - `row`: curve of each interval, (n,).
    - `parameters`: parameters on the curves, (n, k).
    """
    rows = np.repeat(row, parameters.shape[1])
    return np.asarray(curves(rows, parameters.ravel(), order)).reshape(*parameters.shape, -1)


def _split(curves: Curves, todo: _Intervals, tolerance: float, *, lines: bool) -> _Intervals:
    """Split intervals until a biarc or a line approximates each one within the tolerance.

    A line has the direction of its chord, so short lines are not exactly tangent to neighbours.
    Without `lines`, a straight interval is a biarc of zero curvature.
    """
    done: list[_Intervals] = []
    count = 0
    while len(todo.begin):
        parameters = todo.begin[:, None] + (todo.end - todo.begin)[:, None] * SAMPLES[1:-1]
        points = _evaluate(curves, todo.row, parameters, 0)
        if not np.isfinite(points).all():
            raise InvalidInput("A curve must be finite between its breaks.")
        distances = _distances_from_arcs(todo, points)
        along = np.concatenate([todo.p0[:, None], points, todo.p1[:, None]], axis=1)
        extent = length(along - todo.p0[:, None]).max(axis=1)
        steps = length(np.diff(along, axis=1))
        distances[steps.max(axis=1) > LARGEST_SAMPLE_STEP * steps.sum(axis=1)] = np.inf
        corner = (extent <= REPEATED_POINT) | (
            (extent <= CORNER_EXTENT * tolerance) & (distances > TOLERANCE_SHARE * tolerance)
        )
        line = (_is_straight(todo, points) & np.isfinite(distances) & lines) | corner
        ready = line | (distances <= TOLERANCE_SHARE * tolerance)
        done.append(todo.select(ready, line=line[ready]))
        pending = ~ready
        todo = _divide(
            curves, todo.select(pending), distances[pending] / (TOLERANCE_SHARE * tolerance)
        )
        count += int(ready.sum())
        if count + len(todo.begin) > MAX_INTERVALS:
            raise InvalidInput(
                f"A curve would need more than {2 * MAX_INTERVALS} arcs for its tolerance of "
                f"{tolerance:g} m. Specify a larger tolerance."
            )
    names = _Intervals.__slots__
    whole = _Intervals(**{x: np.concatenate([getattr(part, x) for part in done]) for x in names})
    return whole.select(np.lexsort([whole.begin, whole.row]))


def _distances_from_arcs(intervals: _Intervals, points: FloatArray) -> FloatArray:
    """Return the largest distance between each interval's biarc and its samples [m], (n,).

    The distance is infinite for a biarc with an arc of more than a quarter circle.
    """
    x = intervals
    first, second = make_biarcs(x.p0, x.t0, x.p1, x.t1)
    distances = biarc_distance(points, first, second)
    # For a sample beyond an end of the biarc, the nearest point of the biarc is this end.
    for end, tangent in ((x.p0, x.t0), (x.p1, -x.t1)):
        v = points - end[:, None]
        outside = dot(v, tangent[:, None]) < 0
        distances = np.maximum(distances, np.where(outside, length(v), 0.0).max(axis=1))
    # `biarc_distance` uses full circles. This is correct for arcs of at most a quarter circle,
    # because points between the planes at the ends of such an arc are nearest to the arc itself.
    quarter = np.pi / 2 * (1 + 1e-9)
    bent = np.maximum(first.curvatures * first.lengths, second.curvatures * second.lengths)
    return np.where(bent <= quarter, distances, np.inf)


def _is_straight(intervals: _Intervals, points: FloatArray) -> BoolArray:
    """Return the mask of the intervals on which the curve follows its chord, (n,)."""
    chord = intervals.p1 - intervals.p0
    size = length(chord)
    along = unit(chord)
    v = points - intervals.p0[:, None]
    x = dot(v, along[:, None])
    across = length(v - x[..., None] * along[:, None]).max(axis=1)
    scale = np.abs(intervals.p0).max(axis=1)
    allowed = ON_CHORD * size + np.minimum(POINT_ROUNDING * scale, TANGENT_TOLERANCE * size / 16)
    runs_forwards = np.diff(np.column_stack([np.zeros(len(x)), x, size]), axis=1) >= 0
    return np.asarray((across <= allowed) & runs_forwards.all(axis=1))


def _divide(curves: Curves, intervals: _Intervals, excess: FloatArray) -> _Intervals:
    """Divide intervals into 2 to MAX_PARTS equal parts, depending on their relative `excess`.

    The distance between curve and biarc decreases with the cube of the interval's length.

    `excess` is the distance of each interval divided by the allowed distance, (n,).
    """
    parts = np.where(np.isfinite(excess), np.ceil(np.cbrt(excess)), 2)
    parts = np.clip(parts, 2, MAX_PARTS).astype(np.intp)
    i, k = number_parts(parts)
    old = intervals.select(i)
    first = k == 0
    last = k == parts[i] - 1
    span = (old.end - old.begin) / parts[i]
    begin = old.begin + k * span
    end = np.where(last, old.end, old.begin + (k + 1) * span)
    if (begin >= end).any():
        point = tuple(np.round(old.p0[int(np.argmax(begin >= end))], 6).tolist())
        raise InvalidInput(
            f"A curve jumps near {point} m, or its derivative does not match its points."
        )
    inner = np.flatnonzero(~first)
    row = old.row[inner]
    t = begin[inner]
    points = curves(row, t, 0)
    tangents = unit(curves(row, t, 1))
    p0 = old.p0
    p1 = old.p1
    t0 = old.t0
    t1 = old.t1
    p0[inner] = points
    t0[inner] = tangents
    p1[inner - 1] = points
    t1[inner - 1] = tangents
    return _Intervals(row=old.row, begin=begin, end=end, p0=p0, p1=p1, t0=t0, t1=t1, line=old.line)


def _drop_points(intervals: _Intervals) -> _Intervals:
    """Discard lines shorter than `REPEATED_POINT`; the remaining intervals stay connected."""
    x = intervals
    short = x.line & (length(x.p1 - x.p0) <= REPEATED_POINT)
    if not short.any():
        return x
    p0 = x.p0.copy()
    p1 = x.p1.copy()
    mask = np.ones(len(short), dtype=bool)
    for row in np.unique(x.row[short]).tolist():
        a, b = np.searchsorted(x.row, [row, row + 1]).tolist()
        part = slice(a, b)
        p0[part], mask[part] = close_gaps(x.p0[part], x.p1[part], ~x.line[part], REPEATED_POINT)
        remaining = a + np.flatnonzero(mask[part])
        if len(remaining) == 0:
            raise InvalidInput(f"A curve has no length at {tuple(x.p0[a].tolist())} m.")
        if length(x.p1[b - 1] - x.p0[a]) <= REPEATED_POINT:
            p1[remaining[-1]] = p0[remaining[0]]
    return x.select(mask, p0=p0[mask], p1=p1[mask])


def _make_segments(intervals: _Intervals) -> tuple[Segments, IntArray]:
    """Return lines and arcs, and the first row of each interval among them, (n,)."""
    x = intervals
    first, second = make_biarcs(x.p0, x.t0, x.p1, x.t1)
    chord = x.p1 - x.p0
    line = x.line[:, None]
    first = first.replace(
        tangents=np.where(line, unit(chord), first.tangents),
        normals=np.where(line, 0.0, first.normals),
        curvatures=np.where(x.line, 0.0, first.curvatures),
        lengths=np.where(x.line, length(chord), first.lengths),
    )
    n = len(first)
    used = np.column_stack([np.full(n, True), ~x.line])
    in_order = np.arange(2 * n).reshape(2, n).T[used]
    return Segments.join([first, second])[in_order], np.append(0, used.sum(axis=1).cumsum()[:-1])


def _merge_neighbours(
    arcs: Segments, vertices: IntArray, starts: IntArray
) -> tuple[Segments, IntArray]:
    """Merge neighbours on one line or circle.

    Returns the segments, and for each of them the index of its first segment in `arcs`.

    - `vertices`: rows before which segments are never merged, (k,).
    - `starts`: first rows of the curves that are merged separately, (n,).
    """
    first, run = _find_runs(_split_circles(arcs, _find_mergeable(arcs, vertices)))
    lengths = np.add.reduceat(arcs.lengths, first)
    curvatures = np.add.reduceat(arcs.curvatures * arcs.lengths, first) / lengths
    merged = arcs[first].replace(curvatures=curvatures, lengths=lengths)
    run_ends = np.concatenate([arcs.starts[first[1:]], arcs[-1:].ends])
    run_ends[np.searchsorted(first, starts[1:]) - 1] = arcs[starts[1:] - 1].ends
    # A run is not merged if the end of its arc would move.
    end_moves = length(merged.ends - run_ends) > SAME_POINT
    rows = np.union1d(first, np.flatnonzero(end_moves[run]))
    if len(rows) == len(arcs):
        return arcs, rows
    # A curve without merged arcs keeps their values.
    curve = np.searchsorted(starts, rows, side="right") - 1
    has_merged = np.diff(starts, append=len(arcs)) > np.bincount(curve)
    replaced = ~end_moves[run[rows]] & has_merged[curve]
    new_curvatures = arcs.curvatures[rows]
    new_lengths = arcs.lengths[rows]
    new_curvatures[replaced] = curvatures[run[rows[replaced]]]
    new_lengths[replaced] = lengths[run[rows[replaced]]]
    return arcs[rows].replace(curvatures=new_curvatures, lengths=new_lengths), rows


def _find_mergeable(arcs: Segments, vertices: IntArray) -> BoolArray:
    """Return the mask of the rows that lie on the line or circle of the next row, (n - 1,)."""
    k = arcs.curvatures
    normals = arcs.normals_at(EVERY, arcs.lengths)
    mergeable = (
        (length(arcs.end_tangents[:-1] - arcs.tangents[1:]) <= SAME_LINE)
        & (np.abs(k[1:] - k[:-1]) <= SAME_CIRCLE * k[1:])
        & (length(normals[:-1] - arcs.normals[1:]) <= SAME_CIRCLE)
    )
    mergeable[vertices[1:] - 1] = False
    return np.asarray(mergeable)


def _find_runs(mergeable: BoolArray) -> tuple[IntArray, IntArray]:
    """Return the first row of each run, (runs,), and the index of each row's run, (n,).

    A run consists of rows that are merged. A row that is merged with no other is a run of one.

    - `mergeable`: true for a row that is merged with the next row, (n - 1,).
    """
    ends = ~mergeable
    return np.append(0, np.flatnonzero(ends) + 1), np.cumsum(np.append(False, ends))


def _split_circles(arcs: Segments, mergeable: BoolArray) -> BoolArray:
    """Return the mask `mergeable` in which runs longer than a full circle are split, (n - 1,).

    They are split after three quarters of a circle, because each arc is at most a quarter circle.
    """
    turn = arcs.curvatures * arcs.lengths
    first, run = _find_runs(mergeable)
    run_turn = np.add.reduceat(turn, first)[run]
    turn_before = np.cumsum(turn) - turn
    turn_in_run = turn_before - turn_before[first][run] + turn
    part = np.floor((turn_in_run - SAME_CIRCLE) / (1.5 * np.pi))
    return mergeable & ((np.diff(part) <= 0) | (run_turn[1:] <= 2 * np.pi + SAME_CIRCLE))
