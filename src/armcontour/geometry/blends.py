"""Blends across corners beside arcs: pairs of tangent arcs, or connections, within a corner error.

A blend replaces the tangent length t of both segments at a corner by two arcs, each of which bends
more than the segment beside it by nearly the same curvature. Where there is no corner, the blend
is the two segments; between two lines it is the one arc of (10)-(16). Where the curvature must not
jump, a blend is a connection (connecting.py). See docs/concepts/rounding.md.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.geometry.biarcs import biarcs, dot, length, unit
from armcontour.geometry.connecting import around_vertices, connect, draw_connections
from armcontour.geometry.corner_curves import Bounds, CornerKind, Drawn
from armcontour.geometry.rounded_orientation import middle_of
from armcontour.geometry.segments import EVERY, REPEATED_POINT, Segments, share_limits

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
# A blend counts as one that uses its tolerance within this fraction, by which its search may miss.
FULL = 1e-6
# Shares of each half of a connection at which it is compared with what it replaces.
LOOKS = np.linspace(0.0, 1.0, 17)


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


class _Blend(CornerKind):
    """A kind of blend."""

    @abstractmethod
    def shares(self, bounds: Bounds, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """The largest share of a bound that blends take, and their bend [1/m], (n,)."""

    def shortest(self, half: FloatArray) -> FloatArray:
        return np.full(len(half), REPEATED_POINT)

    def fit(self, bounds: Bounds) -> FloatArray:
        before, after = bounds.before, bounds.after
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            bent = WIDEST / np.maximum(before.curvatures, after.curvatures)
            high = np.minimum(bent, np.minimum(before.lengths, after.lengths))
            high = np.minimum(high, bounds.tangent)
            over = self._excess(bounds, high)[0]
            if (over <= 0).all():
                return high
            low = np.minimum(SHORTEST, high)
            under, least = self._excess(bounds, low)
            # A vertex that hardly turns is smooth enough for any speed with the shortest blend.
            found = np.where(least <= 0, low, 0.0)
            found[over <= 0] = high[over <= 0]
            left = np.flatnonzero((under <= 0) & (over > 0))
            if len(left):
                ends = np.log(np.stack([low, high])[:, left])
                state = np.concatenate([ends, np.stack([under, over])[:, left]])
                found[left] = self._search(bounds[left], state)
        return found

    def _search(self, bounds: Bounds, state: FloatArray) -> FloatArray:
        """Largest tangent lengths within bounds [m], (n,).

        False position in logarithms, in which errors are nearly straight lines; every third step
        halves.

        Args:
            bounds: What the blends have to keep.
            state: Logarithms of tangent lengths that do and that do not fit, and the excess of
                both, (4, n).
        """
        active = np.arange(len(bounds.half))
        for step in range(STEPS):
            low, high, under, over = state[:, active]
            near = low + (high - low) * (-NEAR / 2 - under) / (over - under)
            halve = ~((near > low) & (near < high)) | (step % 3 == 2)
            middle = np.where(halve, (low + high) / 2, near)
            found, _ = self._excess(bounds[active], np.exp(middle))
            fits = found <= 0
            state[0::2, active[fits]] = middle[fits], found[fits]
            state[1::2, active[~fits]] = middle[~fits], found[~fits]
            low, high, under, _ = state
            active = np.flatnonzero((under < -NEAR) & (high - low > NEAR))
            if not len(active):
                break
        return np.asarray(np.exp(state[0]))

    def _excess(self, bounds: Bounds, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """By how much blends exceed their bounds, as logarithms, (n,): not above 0 if they fit.

        Returns:
            The excess, and that without regard to the radius.
        """
        any_radius, bend = self.shares(bounds, t)
        need = 1 / (bounds.radius * np.maximum(bend, 0.0))
        wide = np.where(np.isfinite(bounds.radius), need, 0.0)
        both = np.log(np.maximum(any_radius, wide)), np.log(any_radius)
        return tuple(np.where(np.isnan(x), np.inf, x) for x in both)  # type: ignore[return-value]


class _Pair(_Blend):
    """Two tangent arcs."""

    smooth = False

    def shares(self, bounds: Bounds, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        found = _make_pairs(bounds.before, bounds.after, t)
        turns = [
            x.curvatures * x.lengths / (WIDEST + ROUNDING) for x in (found.first, found.second)
        ]
        off = t / 2 - middle_of(False) * (found.first.lengths + found.second.lengths)
        shares = [*turns, found.error / bounds.error, off / bounds.turn]
        return np.max(shares, axis=0), found.bend

    def draw(self, bounds: Bounds, tangent: FloatArray) -> Drawn:
        found = _make_pairs(bounds.before, bounds.after, tangent)
        order = np.arange(2 * len(tangent)).reshape(2, -1).T.ravel()
        return _drawn(
            bounds,
            Segments.join([found.first, found.second])[order],
            np.repeat(np.arange(len(tangent)), 2),
            np.maximum(found.first.curvatures, found.second.curvatures),
            found.error,
            found.bend,
        )


class _Connection(_Blend):
    """A connection, whose curvature nowhere jumps."""

    smooth = True

    def shares(self, bounds: Bounds, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        found = connect(bounds.before, bounds.after, t)
        back, ahead = around_vertices(bounds.before, bounds.after)
        x, peaks = found.nearest, []
        for begin, end, old, old_begin in ((0 * x, x, back, t), (x, 1 + 0 * x, ahead, 0 * t)):
            # A half and what it replaces, both passed evenly.
            off = [
                found.begin
                + found.at(EVERY, begin + share * (end - begin))
                - old.at(EVERY, np.abs(old_begin - share * t))
                for share in LOOKS
            ]
            peaks.append(_peak(length(np.stack(off))))
        turn = t / 2 - middle_of(True) * found.lengths_to(EVERY, np.ones(len(t)))
        shares = [np.max(peaks, axis=0) / bounds.error, turn / bounds.turn]
        largest = np.where(found.sound, np.max(shares, axis=0), np.inf)
        return largest, found.largest_bend

    def draw(self, bounds: Bounds, tangent: FloatArray) -> Drawn:
        found = connect(bounds.before, bounds.after, tangent)
        nearest, bend = found.nearest, found.largest_bend
        rows, of, _ = draw_connections(found, bounds.after.starts, nearest)
        rows = rows.replace(**share_limits(bounds.before[of], bounds.after[of]))
        error = length(found.begin + found.at(EVERY, nearest))
        return _drawn(bounds, rows, of, bend, error, bend)


PAIR, CONNECTION = _Pair(), _Connection()


def _drawn(
    bounds: Bounds,
    rows: Segments,
    of: IntArray,
    tightest: FloatArray,
    error: FloatArray,
    bend: FloatArray,
) -> Drawn:
    """Blends with their largest curvatures, corner errors and bends, (n,) each."""
    full = (error >= bounds.error * (1 - FULL)) | (bend <= (1 + FULL) / bounds.radius)
    with np.errstate(divide="ignore"):
        return Drawn(rows=rows, of=of, radius=1 / tightest, error=error, shrunk=~full)


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
    segment_limits = share_limits(before, after)
    return _Pairs(
        first=first.replace(starts=first.starts + corner, **segment_limits),
        second=second.replace(starts=second.starts + corner, **segment_limits),
        error=error,
        bend=bend,
    )


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
