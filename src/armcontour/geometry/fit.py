"""Lines and tangent arcs fitted to a curve that is given by a formula."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.geometry.biarcs import biarcs, distance, length, unit
from armcontour.geometry.cusps import split_at_cusps
from armcontour.geometry.segments import (
    EVERY,
    REPEATED_POINT,
    TANGENT_TOLERANCE,
    Segments,
    close_up,
)

Curve = Callable[[FloatArray, int], FloatArray]

# Places in an interval at which its arcs are compared with the curve, and how much of the tolerance
# they may use there: between them it is a little more.
PLACES = np.linspace(0, 1, 17)
SHARE = 0.9
# A missed interval is cut into as many parts as its distance asks for, but no more at once.
MOST_PARTS = 8
# More intervals than this are a tolerance that does not fit the curve.
MOST_INTERVALS = 500_000
# A missed interval of this part of the tolerance is a corner: it has no arcs that are worth having.
CORNER = 1e-3
# A derivative of this part of the largest is zero, and a limit has to be taken.
STILL = 1e-10
# Places for that limit, in parts of the interval, for a polynomial through four of them.
NEAR_END = 2e-3 * 0.5 ** np.arange(4)
# What rounding of points makes of a tangent: this, times their size over the interval's length.
ROUGH = 64 * np.finfo(float).eps
# Limits are one tangent if they differ by no more than this [rad].
SAME_LIMIT = 1e-4
# Between two places lies no more than this part of an interval: a curve that rushes there could do
# anything unseen. It is more than a parametrization that starts from rest makes.
RUSH = 0.35
# A chord within this part of its length of the curve is a line; so is one within the rounding of
# the curve's points, if its direction is still known.
ON_CHORD = 1e-12
ROUNDING = 16 * np.finfo(float).eps
# Neighbours are on one line if their tangents [rad], and on one circle if their radii and the
# directions to their centres, differ by no more than this part; both are rounding. What is made of
# them must end where they did [m].
SAME_LINE = 1e-12
SAME_CIRCLE = 1e-10
SAME_POINT = 1e-11


def fit_arcs(curve: Curve, breaks: npt.ArrayLike, tolerance: float) -> Segments:
    """Lines and tangent arcs along a curve, within a tolerance of it and on it at its breaks.

    Every interval gets two arcs through its ends with its tangents; intervals are cut until these
    are near enough. Straight parts become one line, and neighbours on one circle one arc. There is
    a corner where the tangents at a break differ, and where the curve turns back on the spot;
    elsewhere neighbours are tangent.

    Args:
        curve: `curve(t, order)` gives points (order 0) or derivatives by t (order 1) for t of shape
            (n,), (n, 2) or (n, 3) [m]. It is smooth between two breaks.
        breaks: Increasing values of t, the first and last of which are its ends.
        tolerance: Largest distance between the curve and the arcs [m], both ways.

    Raises:
        InvalidInput: Breaks that do not increase, a curve that is not finite or has no length, or a
            tolerance below a nanometre or far too small for it.
    """
    at = _checks.numbers("breaks of a curve", breaks)
    if at.ndim != 1 or len(at) < 2 or (np.diff(at) <= 0).any():
        raise InvalidInput("The breaks of a curve must be two or more increasing numbers.")
    if _checks.positive("tolerance of a curve", tolerance, "m") < REPEATED_POINT:
        raise InvalidInput(
            f"The tolerance of a curve must be at least {REPEATED_POINT:g} m, but is "
            f"{tolerance:g} m."
        )
    return _fit(curve, at, tolerance, through=False)[0]


def fit_through(curve: Curve, breaks: FloatArray, tolerance: float) -> tuple[Segments, IntArray]:
    """Tangent arcs as `fit_arcs` makes them, with a vertex at every break of a smooth curve.

    Returns:
        The arcs, and which of their vertices the breaks are, (n,).
    """
    return _fit(curve, breaks, tolerance, through=True)


def _fit(
    curve: Curve, at: FloatArray, tolerance: float, *, through: bool
) -> tuple[Segments, IntArray]:
    """The segments, and the vertices between which neighbours may be one: at breaks or the ends."""
    with np.errstate(all="ignore"):
        intervals = _without_points(_split(curve, _whole(curve, at), tolerance, lines=not through))
        arcs, row = _arcs(intervals)
        kept = row[np.searchsorted(intervals.begin, at[:-1] if through else at[:1])]
        merged, rows = _merge(arcs, kept)
    return merged, np.append(np.searchsorted(rows, kept), len(merged))


@dataclass(frozen=True, slots=True, kw_only=True)
class _Intervals:
    """Intervals of a curve with points and tangents at their ends, and whether each is a line."""

    begin: FloatArray
    end: FloatArray
    p0: FloatArray
    p1: FloatArray
    t0: FloatArray
    t1: FloatArray
    line: BoolArray

    def of(self, chosen: Any, **changed: Any) -> _Intervals:
        """Some of them, with other values."""
        kept = {name: getattr(self, name)[chosen] for name in self.__slots__}
        return _Intervals(**{**kept, **changed})


def _whole(curve: Curve, at: FloatArray) -> _Intervals:
    """The intervals between the breaks, and between where the curve turns back."""
    at, turned = split_at_cusps(curve, at)
    points = np.array(curve(at, 0), dtype=np.float64)
    if not np.isfinite(points).all():
        raise InvalidInput("A curve must be finite at its breaks.")
    (t0, slack0), (t1, slack1) = _tangents(curve, at, points, turned)
    closed = length(points[-1] - points[0]) <= REPEATED_POINT
    if closed:
        points[-1] = points[0]
    # What differs by rounding is one tangent.
    last, first = (t1, np.roll(t0, -1, axis=0)) if closed else (t1[:-1], t0[1:])
    slack = np.maximum(slack1, np.roll(slack0, -1))[: len(last)]
    same = length(first - last) <= slack
    common = unit(first + last)
    n = len(t0)
    before = np.flatnonzero(same)
    t1[before], t0[(before + 1) % n] = common[same], common[same]
    return _Intervals(
        begin=at[:-1],
        end=at[1:],
        p0=points[:-1],
        p1=points[1:],
        t0=t0,
        t1=t1,
        line=np.zeros(n, dtype=bool),
    )


def _tangents(
    curve: Curve, at: FloatArray, points: FloatArray, turned: BoolArray
) -> list[tuple[FloatArray, FloatArray]]:
    """Tangents at starts and at ends of intervals, from within, and how sure they are [rad]."""
    begin, end = at[:-1], at[1:]
    span = end - begin
    places = begin[:, None] + span[:, None] * PLACES[1:-1]
    speed = length(curve(places.ravel(), 1)).reshape(places.shape).max(axis=1)
    size = np.abs(points).max()
    still = STILL * speed + ROUNDING * size / span
    found = []
    for here, sign, turns in ((begin, 1.0, turned[:-1]), (end, -1.0, turned[1:])):
        # The next number on that side: a derivative may jump at a break.
        derivative = curve(np.nextafter(here, here + sign * span), 1)
        weak = (length(derivative) <= still) | turns
        direction = unit(derivative)
        if weak.any():
            near = here[weak, None] + sign * span[weak, None] * NEAR_END
            nearby = unit(curve(near.ravel(), 1)).reshape(*near.shape, -1)
            direction[weak] = unit(_at_zero(nearby))
        slack = ROUGH * size / (span * length(derivative))
        slack = np.clip(slack, TANGENT_TOLERANCE, SAME_LIMIT)
        found.append((direction, np.where(weak, SAME_LIMIT, slack)))
    return found


def _at_zero(values: FloatArray) -> FloatArray:
    """Values at NEAR_END, (n, 4, dimension), continued to zero."""
    x = NEAR_END
    weights = [np.prod([-b / (a - b) for b in x if b != a]) for a in x]
    return np.asarray(np.einsum("k,nkd->nd", np.array(weights), values))


def _split(curve: Curve, todo: _Intervals, tolerance: float, *, lines: bool) -> _Intervals:
    """Intervals so short that each can be two arcs, or one line.

    A line takes the direction of its chord, which on a short one need not be tangent to the last
    digit; without lines, a straight interval is two arcs of no curvature.
    """
    done: list[_Intervals] = []
    count = 0
    while len(todo.begin):
        places = todo.begin[:, None] + (todo.end - todo.begin)[:, None] * PLACES[1:-1]
        points = np.asarray(curve(places.ravel(), 0)).reshape(*places.shape, -1)
        if not np.isfinite(points).all():
            raise InvalidInput("A curve must be finite between its breaks.")
        missed = _distances_from_arcs(todo, points)
        along = np.concatenate([todo.p0[:, None], points, todo.p1[:, None]], axis=1)
        extent = length(along - todo.p0[:, None]).max(axis=1)
        steps = length(np.diff(along, axis=1))
        missed[steps.max(axis=1) > RUSH * steps.sum(axis=1)] = np.inf
        corner = (extent <= REPEATED_POINT) | (
            (extent <= CORNER * tolerance) & (missed > SHARE * tolerance)
        )
        line = (_straight(todo, points) & np.isfinite(missed) & lines) | corner
        ready = line | (missed <= SHARE * tolerance)
        done.append(todo.of(ready, line=line[ready]))
        rest = ~ready
        todo = _parts(curve, todo.of(rest), missed[rest] / (SHARE * tolerance))
        count += int(ready.sum())
        if count + len(todo.begin) > MOST_INTERVALS:
            raise InvalidInput(
                f"A curve would need more than {2 * MOST_INTERVALS} arcs to be within "
                f"{tolerance:g} m: give it a larger tolerance."
            )
    names = _Intervals.__slots__
    whole = _Intervals(**{x: np.concatenate([getattr(part, x) for part in done]) for x in names})
    return whole.of(np.argsort(whole.begin, kind="stable"))


def _distances_from_arcs(intervals: _Intervals, points: FloatArray) -> FloatArray:
    """Largest distance of the curve from its arcs; infinite where they are none worth having."""
    x = intervals
    first, second = biarcs(x.p0, x.t0, x.p1, x.t1)
    apart = distance(points, first, second)
    # Past their ends it is the ends that count.
    for end, tangent in ((x.p0, x.t0), (x.p1, -x.t1)):
        v = points - end[:, None]
        outside = np.sum(v * tangent[:, None], axis=2) < 0
        apart = np.maximum(apart, np.where(outside, length(v), 0.0).max(axis=1))
    # Of arcs up to a quarter, each has its own part of the plane between the planes at its ends.
    quarter = np.pi / 2 * (1 + 1e-9)
    bent = np.maximum(first.curvatures * first.lengths, second.curvatures * second.lengths)
    return np.where(bent <= quarter, apart, np.inf)


def _straight(intervals: _Intervals, points: FloatArray) -> BoolArray:
    """Whether the curve is its chord, run through in one direction."""
    chord = intervals.p1 - intervals.p0
    size = length(chord)
    along = unit(chord)
    v = points - intervals.p0[:, None]
    x = np.sum(v * along[:, None], axis=2)
    across = length(v - x[..., None] * along[:, None]).max(axis=1)
    scale = np.abs(intervals.p0).max(axis=1)
    allowed = ON_CHORD * size + np.minimum(ROUNDING * scale, TANGENT_TOLERANCE * size / 16)
    onward = np.diff(np.column_stack([np.zeros(len(x)), x, size]), axis=1) >= 0
    return np.asarray((across <= allowed) & onward.all(axis=1))


def _parts(curve: Curve, intervals: _Intervals, excess: FloatArray) -> _Intervals:
    """Missed intervals in equal parts; the distance goes with the cube of their length."""
    parts = np.where(np.isfinite(excess), np.ceil(np.cbrt(excess)), 2)
    parts = np.clip(parts, 2, MOST_PARTS).astype(np.intp)
    i = np.repeat(np.arange(len(parts)), parts)
    k = np.arange(len(i)) - np.repeat(np.cumsum(parts) - parts, parts)
    old = intervals.of(i)
    first, last = k == 0, k == parts[i] - 1
    span = (old.end - old.begin) / parts[i]
    begin = old.begin + k * span
    end = np.where(last, old.end, old.begin + (k + 1) * span)
    if (begin >= end).any():
        point = tuple(np.round(old.p0[int(np.argmax(begin >= end))], 6).tolist())
        raise InvalidInput(f"A curve jumps near {point} m, or its derivative does not fit it.")
    inner = np.flatnonzero(~first)
    points, tangents = curve(begin[inner], 0), unit(curve(begin[inner], 1))
    p0, p1, t0, t1 = old.p0, old.p1, old.t0, old.t1
    p0[inner], t0[inner] = points, tangents
    p1[inner - 1], t1[inner - 1] = points, tangents
    return _Intervals(begin=begin, end=end, p0=p0, p1=p1, t0=t0, t1=t1, line=old.line)


def _without_points(intervals: _Intervals) -> _Intervals:
    """Intervals without the lines that are points; what is left still meets."""
    x = intervals
    p0, kept = close_up(x.p0, x.p1, ~x.line, REPEATED_POINT)
    if kept.all():
        return x
    if not kept.any():
        raise InvalidInput(f"A curve has no length at {tuple(x.p0[0].tolist())} m.")
    left = x.of(kept, p0=p0[kept])
    if length(x.p1[-1] - x.p0[0]) <= REPEATED_POINT:
        left.p1[-1] = left.p0[0]
    return left


def _arcs(intervals: _Intervals) -> tuple[Segments, IntArray]:
    """Lines and arcs of the intervals, and the first of each interval, (n,)."""
    x = intervals
    first, second = biarcs(x.p0, x.t0, x.p1, x.t1)
    chord, line = x.p1 - x.p0, x.line[:, None]
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


def _merge(arcs: Segments, kept: IntArray) -> tuple[Segments, IntArray]:
    """Lines and arcs with neighbours on one line or circle in one, and of which rows they are.

    Args:
        arcs: The lines and arcs.
        kept: Those that no arc before them takes in.
    """
    k, u = arcs.curvatures, arcs.lengths
    turn = k * u
    same = (
        (length(arcs.end_tangents[:-1] - arcs.tangents[1:]) <= SAME_LINE)
        & (np.abs(k[1:] - k[:-1]) <= SAME_CIRCLE * k[1:])
        & (length(arcs.normals_at(EVERY, u)[:-1] - arcs.normals[1:]) <= SAME_CIRCLE)
    )
    same[kept[1:] - 1] = False
    first = np.concatenate([[0], np.flatnonzero(~same) + 1])
    # No arc is more than its circle: a longer run is cut at three quarters of it, as what it is
    # made of are arcs of up to a quarter.
    run = np.cumsum(np.concatenate([[False], ~same]))
    whole = np.add.reduceat(turn, first)[run]
    before = np.cumsum(turn) - turn
    around = np.floor((before - before[first][run] + turn - SAME_CIRCLE) / (1.5 * np.pi))
    same &= (np.diff(around) <= 0) | (whole[1:] <= 2 * np.pi + SAME_CIRCLE)
    first = np.concatenate([[0], np.flatnonzero(~same) + 1])
    size = np.add.reduceat(u, first)
    bend = np.add.reduceat(turn, first) / size
    joined = arcs[first].replace(curvatures=bend, lengths=size)
    ends = np.concatenate([arcs.starts[first[1:]], arcs[-1:].ends])
    off = length(joined.ends - ends) > SAME_POINT
    # A run whose arc would end elsewhere stays as it is.
    run = np.cumsum(np.concatenate([[False], ~same]))
    rows = np.union1d(first, np.flatnonzero(off[run]))
    if len(rows) == len(u):
        return arcs, rows
    one = ~off[run[rows]]
    curvatures, lengths = k[rows], u[rows]
    curvatures[one], lengths[one] = bend[~off], size[~off]
    return arcs[rows].replace(curvatures=curvatures, lengths=lengths), rows
