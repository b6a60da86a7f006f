"""Blends across corners beside arcs: pairs of tangent arcs, or connections, within a corner error.

A blend replaces the tangent length t of both segments at a corner by two arcs, each of which bends
more than the segment beside it by nearly the same curvature. Where there is no corner, the blend
is the two segments; between two lines it is the one arc of (10)-(16). Where the curvature must not
jump, a blend is a connection (connecting.py). See docs/concepts/rounding.md.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray, IntArray
from armcontour.geometry.biarcs import biarcs, dot, length, unit
from armcontour.geometry.connecting import around_vertices, connect, draw_connections
from armcontour.geometry.segments import EVERY, REPEATED_POINT, Segments, share_demand

# A search for a tangent length may end this fraction below it; halving alone comes there from a
# nanometre to a kilometre in fewer than a third of these steps.
NEAR = 1e-9
STEPS = 120
# Shorter tangent lengths are not made: they come near the distance of repeated points [m].
SHORTEST = 2 * REPEATED_POINT
# Largest angle by which a blend's arcs and the parts of arcs that it replaces turn [rad]: none of
# them turns back, so that the corner is where blend and path are farthest apart.
WIDEST = np.pi / 2
ROUNDING = 1e-9
# Shares of each half of a connection at which it is compared with what it replaces.
LOOKS = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Blends:
    """The blends of n corners.

    Args:
        rows: Their segments in order.
        of: The blend of each segment.
        lengths: Lengths of the blends [m], (n,).
        radius: Smallest radii of the blends [m], infinite for a straight one, (n,).
        error: Distance from each corner to its blend [m], (n,).
        bend: Largest curvature towards the inside of the corner [1/m], (n,).
    """

    rows: Segments
    of: IntArray
    lengths: FloatArray
    radius: FloatArray
    error: FloatArray
    bend: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pairs:
    """Pairs of tangent arcs across n corners.

    Args:
        first: The arcs that leave the segments before the corners.
        second: The arcs that lead into the segments after the corners.
        error: Distance from each corner to its arcs [m], (n,).
        bend: Largest curvature towards the inside of the corner [1/m], (n,).
    """

    first: Segments
    second: Segments
    error: FloatArray
    bend: FloatArray

    @property
    def lengths(self) -> FloatArray:
        """Lengths of the pairs [m], (n,)."""
        return np.asarray(self.first.lengths + self.second.lengths)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Bounds:
    """What n blends have to keep.

    Args:
        error: Largest corner errors [m], (n,).
        radius: Radii that are large enough for the corner speeds [m], infinite without one, (n,).
        turn: Largest `t / 2 - middle length`, which the tool's orientation allows [m], (n,).
        tangent: Largest tangent lengths [m], (n,).
        middle: The factor of the length there; see `rounded_orientation.middle_of`.
        smooth: Whether the blends have continuous curvature.
    """

    error: FloatArray
    radius: FloatArray
    turn: FloatArray
    tangent: FloatArray
    middle: float
    smooth: bool

    def __getitem__(self, rows: IntArray) -> Bounds:
        """The bounds of the selected corners."""
        return Bounds(
            error=self.error[rows],
            radius=self.radius[rows],
            turn=self.turn[rows],
            tangent=self.tangent[rows],
            middle=self.middle,
            smooth=self.smooth,
        )


def make_blends(before: Segments, after: Segments, t: FloatArray, smooth: BoolArray) -> Blends:
    """Blends with given tangent lengths.

    Args:
        before: Segments before the corners.
        after: Segments after the corners.
        t: Tangent lengths, no longer than the segments [m], (n,).
        smooth: Mask of the blends with continuous curvature; the others are pairs of arcs, (n,).
    """
    if not len(t):
        none = np.zeros(0)
        of = np.zeros(0, dtype=np.intp)
        return Blends(rows=before, of=of, lengths=none, radius=none, error=none, bend=none)
    plain, bent = np.flatnonzero(~smooth), np.flatnonzero(smooth)
    pairs = _make_pairs(before[plain], after[plain], t[plain])
    found = connect(before[bent], after[bent], t[bent])
    nearest = found.nearest
    drawn, of, _ = draw_connections(found, after.starts[bent], nearest)
    drawn = drawn.replace(**share_demand(before[bent[of]], after[bent[of]]))
    rows = Segments.join([pairs.first, pairs.second, drawn])
    which = np.concatenate([plain, plain, bent[of]])
    lengths = np.bincount(which, rows.lengths, minlength=len(t))
    error, bend, tightest = np.empty(len(t)), np.empty(len(t)), np.empty(len(t))
    error[plain], bend[plain] = pairs.error, pairs.bend
    tightest[plain] = np.maximum(pairs.first.curvatures, pairs.second.curvatures)
    error[bent] = length(found.begin + found.at(EVERY, nearest))
    bend[bent] = tightest[bent] = found.largest_bend
    order = np.argsort(which, kind="stable")
    with np.errstate(divide="ignore"):
        radius = 1 / tightest
    return Blends(
        rows=rows[order],
        of=which[order],
        lengths=np.asarray(lengths, dtype=float),
        radius=radius,
        error=error,
        bend=bend,
    )


def _make_pairs(before: Segments, after: Segments, t: FloatArray) -> _Pairs:
    """Pairs of tangent arcs with given tangent lengths [m], (n,)."""
    corner, inward = after.starts, after.tangents - before.end_tangents
    # Points relative to the corner, so that even tiny blends keep their digits.
    back, ahead = around_vertices(before, after)
    p0, t0 = back.at(EVERY, t), -unit(back.at(EVERY, t, 1))
    p1, t1 = ahead.at(EVERY, t), unit(ahead.at(EVERY, t, 1))
    share = _tangent_length(back, t) / _tangent_length(ahead, t)
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = biarcs(p0, t0, p1, t1, share)
        error = _distance(first, second)
    bend = np.maximum(_inward(first, inward), _inward(second, inward))
    demand = share_demand(before, after)
    return _Pairs(
        first=first.replace(starts=first.starts + corner, **demand),
        second=second.replace(starts=second.starts + corner, **demand),
        error=error,
        bend=bend,
    )


def widest_blends(before: Segments, after: Segments, bounds: Bounds) -> FloatArray:
    """Largest tangent lengths of blends within bounds [m], (n,); 0 where none fits.

    Args:
        before: Segments before the corners.
        after: Segments after the corners.
        bounds: What the blends have to keep.
    """
    with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
        bent = WIDEST / np.maximum(before.curvatures, after.curvatures)
        high = np.minimum(bent, np.minimum(before.lengths, after.lengths))
        high = np.minimum(high, bounds.tangent)
        excess = _excess(before, after, high, bounds)
        if (excess[0] <= 0).all():
            return high
        low = np.minimum(SHORTEST, high)
        need = _excess(before, after, low, bounds)
        # A vertex that hardly turns is smooth enough for any speed with the shortest blend.
        found = np.where(need[1] <= 0, low, 0.0)
        found[excess[0] <= 0] = high[excess[0] <= 0]
        left = np.flatnonzero((need[0] <= 0) & (excess[0] > 0))
        if len(left):
            ends = np.stack([low[left], high[left]]), np.stack([need[0][left], excess[0][left]])
            found[left] = _search(before[left], after[left], bounds[left], *ends)
    return found


def _search(
    before: Segments, after: Segments, bounds: Bounds, ends: FloatArray, excess: FloatArray
) -> FloatArray:
    """Largest tangent lengths within bounds, between one that fits and one that does not [m], (n,).

    False position in logarithms, in which errors are nearly straight lines; every third step
    halves.

    Args:
        before: Segments before the corners.
        after: Segments after the corners.
        bounds: What the blends have to keep.
        ends: The tangent lengths that do and do not fit [m], (2, n).
        excess: What `_excess` says of them, (2, n).
    """
    state = np.concatenate([np.log(ends), excess])
    active = np.arange(len(before))
    for step in range(STEPS):
        low, high, under, over = state[:, active]
        near = low + (high - low) * (-NEAR / 2 - under) / (over - under)
        halve = ~((near > low) & (near < high)) | (step % 3 == 2)
        middle = np.where(halve, (low + high) / 2, near)
        found, _ = _excess(before[active], after[active], np.exp(middle), bounds[active])
        fits = found <= 0
        state[0::2, active[fits]] = middle[fits], found[fits]
        state[1::2, active[~fits]] = middle[~fits], found[~fits]
        low, high, under, _ = state
        active = np.flatnonzero((under < -NEAR) & (high - low > NEAR))
        if not len(active):
            break
    return np.asarray(np.exp(state[0]))


def _excess(
    before: Segments, after: Segments, t: FloatArray, bounds: Bounds
) -> tuple[FloatArray, FloatArray]:
    """By how much blends exceed their bounds, as logarithms, (n,): none where it is not above 0.

    Args:
        before: Segments before the corners.
        after: Segments after the corners.
        t: Tangent lengths [m], (n,).
        bounds: What the blends have to keep.

    Returns:
        The excess, and that without regard to the radius.
    """
    excess = _excess_of_connections if bounds.smooth else _excess_of_pairs
    any_radius, bend = excess(before, after, t, bounds)
    need = 1 / (bounds.radius * np.maximum(bend, 0.0))
    wide = np.where(np.isfinite(bounds.radius), need, 0.0)
    both = np.log(np.maximum(any_radius, wide)), np.log(any_radius)
    return tuple(np.where(np.isnan(x), np.inf, x) for x in both)  # type: ignore[return-value]


def _excess_of_pairs(
    before: Segments, after: Segments, t: FloatArray, bounds: Bounds
) -> tuple[FloatArray, FloatArray]:
    """The largest share of a bound that pairs of arcs take, and their bend [1/m], (n,)."""
    found = _make_pairs(before, after, t)
    turns = [x.curvatures * x.lengths / (WIDEST + ROUNDING) for x in (found.first, found.second)]
    off = t / 2 - bounds.middle * found.lengths
    shares = [*turns, found.error / bounds.error, off / bounds.turn]
    return np.max(shares, axis=0), found.bend


def _excess_of_connections(
    before: Segments, after: Segments, t: FloatArray, bounds: Bounds
) -> tuple[FloatArray, FloatArray]:
    """The largest share of a bound that connections take, and their bend [1/m], (n,)."""
    found = connect(before, after, t)
    back, ahead = around_vertices(before, after)
    x, peaks = found.nearest, []
    for begin, end, old, old_begin in ((0 * x, x, back, t), (x, 1 + 0 * x, ahead, 0 * t)):
        # A half and what it replaces, both passed evenly.
        places = [begin + share * (end - begin) for share in LOOKS]
        olds = [np.abs(old_begin - share * t) for share in LOOKS]
        off = np.stack(
            [
                length(found.begin + found.at(EVERY, own) - old.at(EVERY, u))
                for own, u in zip(places, olds, strict=True)
            ]
        )
        peaks.append(_peak(off))
    turn = t / 2 - bounds.middle * found.lengths_to(EVERY, np.ones(len(t)))
    shares = [np.max(peaks, axis=0) / bounds.error, turn / bounds.turn]
    largest = np.where(found.sound, np.max(shares, axis=0), np.inf)
    return largest, found.largest_bend


def _peak(values: FloatArray) -> FloatArray:
    """Largest values of smooth functions that are known at even places, (n,).

    Between places a peak is higher than the place next to it by an eighth of the second difference.

    Args:
        values: Values at the places, (places, n).
    """
    inner = values[1:-1]
    more = np.abs(values[2:] - 2 * inner + values[:-2]) / 6
    found = inner + np.where((inner >= values[2:]) & (inner >= values[:-2]), more, 0.0)
    # At an end the values may fall towards it.
    for ends, beside in ((values[:3], more[0]), (values[:-4:-1], more[-1])):
        falls = 3 * ends[0] < 4 * ends[1] - ends[2]
        found = np.concatenate([found, [ends[0] + np.where(falls, beside, 0.0)]])
    return np.asarray(found.max(axis=0))


def _distance(first: Segments, second: Segments) -> FloatArray:
    """Distance of the corner, which is the origin, from the two arcs of each blend [m], (n,).

    Measured from the point where the arcs meet, which is near the corner, so that no digits are
    lost.
    """
    v = -second.starts
    x = dot(v, second.tangents)
    after = x > 0
    normals = np.where(after[:, None], second.normals, first.normals_at(EVERY, first.lengths))
    k = np.where(after, second.curvatures, first.curvatures)
    y = dot(v, normals)
    power = k * (x * x + y * y) - 2 * y
    in_plane = power / (1 + np.sqrt(np.maximum(1 + k * power, 0.0)))
    across = v - x[:, None] * second.tangents - y[:, None] * normals
    found = np.hypot(in_plane, length(across))
    return np.asarray(np.where(np.isfinite(found), found, np.inf))


def _tangent_length(rows: Segments, t: FloatArray) -> FloatArray:
    """Tangent lengths of the parts of length t of lines and arcs [m]."""
    half = rows.curvatures * t / 2
    return np.asarray(t / 2 * np.sinc(half / np.pi) / np.cos(half))


def _inward(arcs: Segments, inward: FloatArray) -> FloatArray:
    """Curvatures of arcs [1/m], below zero for those that bend away from a direction."""
    return np.asarray(np.where(dot(arcs.normals, inward) >= 0, 1, -1) * arcs.curvatures)
