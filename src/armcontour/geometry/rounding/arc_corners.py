"""Blends at corners next to arcs: pairs of tangent arcs, or connections, within a corner error.

A blend replaces the length t of both segments at a corner by two tangent arcs. Each arc is more
curved than the segment next to it, and the increase of both curvatures is nearly the same. If the
corner does not turn, the blend equals the segments. Between two lines, the blend is the single arc
of (10)-(16) of the paper. Where the curvature must not jump, a blend is a connection
(connections.py). See docs/concepts/corners.md.
"""

from __future__ import annotations

from abc import abstractmethod
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.geometry.biarcs import dot, join_pairs, length, make_biarcs, unit
from armcontour.geometry.rounding.connections import around_vertices, connect, draw_connections
from armcontour.geometry.rounding.line_corners import CornerBounds, CornerCurves, CornerKind
from armcontour.geometry.rounding.rounded_orientation import middle_fraction
from armcontour.geometry.segments import EVERY, REPEATED_POINT, Segments, combine_limits

# Relative error of the search for a tangent length, and largest number of its steps. Every third
# step is a bisection. Between a nanometre and a kilometre, these bisections alone are sufficient.
SEARCH_ERROR = 1e-9
SEARCH_STEPS = 120
# Smallest tangent length [m]. Shorter blends approach the distance of repeated points.
SHORTEST_TANGENT = 2 * REPEATED_POINT
# Largest turn of an arc in a blend, and of an arc that a blend replaces [rad]. With this limit no
# arc turns back, so the distance between blend and path is largest at the corner.
LARGEST_ARC_TURN = np.pi / 2
# Rounding error of a turn [rad].
TURN_ROUNDING = 1e-9
# A blend counts as not shrunk if it reaches a bound within this relative tolerance, which includes
# the error of the search.
BOUND_REACHED = 1e-6
# Fractions of each connection half at which its distance from the path is evaluated.
SAMPLES = np.linspace(0.0, 1.0, 17)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Pairs:
    """Pairs of tangent arcs across n corners."""

    first: Segments  # The arcs that leave the segments before the corners
    second: Segments  # The arcs that lead into the segments after the corners
    error: FloatArray  # Distance from each corner to its arcs [m], (n,)
    bend: FloatArray  # Largest curvature towards the inside of the corner [1/m], (n,)


class _Blend(CornerKind):
    """A curve at a corner next to an arc; `fit` determines its tangent length by a search."""

    @abstractmethod
    def bound_ratios(self, bounds: CornerBounds, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest ratio to a bound, and the inward curvature [1/m], (n,) each.

        - `t`: tangent lengths [m], (n,).
        """

    def shortest(self, half: FloatArray) -> FloatArray:
        """Return the resolution of a point for every corner [m], (n,)."""
        return np.full(len(half), REPEATED_POINT)

    def fit(self, bounds: CornerBounds) -> FloatArray:
        """Return the largest tangent lengths within bounds [m], (n,); 0 where no blend fits.

        The bounds are checked at the largest and at the smallest possible lengths first. Only the
        corners that satisfy them at the smallest length alone need a search.
        """
        before, after = bounds.before, bounds.after
        with np.errstate(divide="ignore", invalid="ignore", over="ignore"):
            widest_arc = LARGEST_ARC_TURN / np.maximum(before.curvatures, after.curvatures)
            high = np.minimum(widest_arc, np.minimum(before.lengths, after.lengths))
            high = np.minimum(high, bounds.tangent)
            excess_at_high = self._excess(bounds, high)[0]
            if (excess_at_high <= 0).all():
                return high
            low = np.minimum(SHORTEST_TANGENT, high)
            excess_at_low, excess_without_radius = self._excess(bounds, low)
            # The bound of the radius does not apply to the shortest blend, because at a tiny turn
            # this blend is permitted at any speed.
            tangents = np.where(excess_without_radius <= 0, low, 0.0)
            tangents[excess_at_high <= 0] = high[excess_at_high <= 0]
            remaining = np.flatnonzero((excess_at_low <= 0) & (excess_at_high > 0))
            if len(remaining):
                ends = np.log(np.stack([low, high])[:, remaining])
                excesses = np.stack([excess_at_low, excess_at_high])[:, remaining]
                state = np.concatenate([ends, excesses])
                tangents[remaining] = self._search(bounds[remaining], state)
        return tangents

    def _search(self, bounds: CornerBounds, state: FloatArray) -> FloatArray:
        """Search for the largest tangent lengths within bounds [m], (n,).

        The search uses false position on logarithms, in which the excess is nearly linear; every
        third step is a bisection. `state`, (4, n): logarithms of a length that satisfies the bounds
        and of a length that violates them, then the excesses at these two lengths.
        """
        active = np.arange(len(bounds.half))
        for step in range(SEARCH_STEPS):
            low, high, under, over = state[:, active]
            false_position = low + (high - low) * (-SEARCH_ERROR / 2 - under) / (over - under)
            is_inside = (false_position > low) & (false_position < high)
            bisects = ~is_inside | (step % 3 == 2)
            middle = np.where(bisects, (low + high) / 2, false_position)
            excess, _ = self._excess(bounds[active], np.exp(middle))
            fits = excess <= 0
            state[0::2, active[fits]] = middle[fits], excess[fits]
            state[1::2, active[~fits]] = middle[~fits], excess[~fits]
            low, high, under, _ = state
            active = np.flatnonzero((under < -SEARCH_ERROR) & (high - low > SEARCH_ERROR))
            if not len(active):
                break
        return np.asarray(np.exp(state[0]))

    def _excess(self, bounds: CornerBounds, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return logarithms of the largest ratio to a bound, (n,) each.

        They are positive if a bound is exceeded. The first one includes the bound of the radius,
        the second one does not.

        - `t`: tangent lengths [m], (n,).
        """
        ratio, curvature = self.bound_ratios(bounds, t)
        radius_ratio = 1 / (bounds.radius * np.maximum(curvature, 0.0))
        radius_ratio = np.where(np.isfinite(bounds.radius), radius_ratio, 0.0)
        with_radius = np.log(np.maximum(ratio, radius_ratio))
        without_radius = np.log(ratio)
        return (
            np.where(np.isnan(with_radius), np.inf, with_radius),
            np.where(np.isnan(without_radius), np.inf, without_radius),
        )


class _Pair(_Blend):
    """A pair of tangent arcs."""

    smooth = False

    def bound_ratios(self, bounds: CornerBounds, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest ratio to a bound, and the inward curvature [1/m], (n,) each.

        The bounds are the largest turn of an arc, the corner error and the angular tolerance.
        """
        pairs = _make_pairs(bounds.before, bounds.after, t)
        turns = [
            x.curvatures * x.lengths / (LARGEST_ARC_TURN + TURN_ROUNDING)
            for x in (pairs.first, pairs.second)
        ]
        turn = t / 2 - middle_fraction(False) * (pairs.first.lengths + pairs.second.lengths)
        ratios = [*turns, pairs.error / bounds.error, turn / bounds.turn]
        return np.max(ratios, axis=0), pairs.bend

    def draw(self, bounds: CornerBounds, tangent: FloatArray) -> CornerCurves:
        """Draw pairs of tangent arcs with given tangent lengths [m], (n,)."""
        pairs = _make_pairs(bounds.before, bounds.after, tangent)
        return _make_curves(
            bounds,
            join_pairs(pairs.first, pairs.second),
            np.repeat(np.arange(len(tangent)), 2),
            np.maximum(pairs.first.curvatures, pairs.second.curvatures),
            pairs.error,
            pairs.bend,
        )


class _Connection(_Blend):
    """A connection with continuous curvature."""

    smooth = True

    def bound_ratios(self, bounds: CornerBounds, t: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Return the largest ratio to a bound, and the largest curvature [1/m], (n,) each.

        The bounds are the corner error and the angular tolerance. The ratio is infinite if the
        connection has a loop or a cusp.
        """
        connections = connect(bounds.before, bounds.after, t)
        back, ahead = around_vertices(bounds.before, bounds.after)
        middle = connections.nearest
        zeros = np.zeros_like(t)
        # Each connection half from `begin` to `end`, and the distance from the vertex at which the
        # part of the old segment starts.
        halves = (
            (zeros, middle, back, t),
            (middle, np.ones_like(t), ahead, zeros),
        )
        peaks = []
        for begin, end, old, old_begin in halves:
            # Deviation of one connection half from the path part that it replaces. Points at the
            # same fractions of both are compared.
            deviations = [
                connections.begin
                + connections.evaluate(EVERY, begin + share * (end - begin))
                - old.evaluate(EVERY, np.abs(old_begin - share * t))
                for share in SAMPLES
            ]
            peaks.append(_bound_peaks(length(np.stack(deviations))))
        turn = t / 2 - middle_fraction(True) * connections.lengths_to(EVERY, np.ones(len(t)))
        ratios = [np.max(peaks, axis=0) / bounds.error, turn / bounds.turn]
        largest = np.where(connections.valid, np.max(ratios, axis=0), np.inf)
        return largest, connections.largest_curvature

    def draw(self, bounds: CornerBounds, tangent: FloatArray) -> CornerCurves:
        """Draw connections with given tangent lengths [m], (n,)."""
        connections = connect(bounds.before, bounds.after, tangent)
        nearest = connections.nearest
        curvature = connections.largest_curvature
        rows, corner, _ = draw_connections(connections, bounds.after.starts, nearest)
        rows = rows.replace(**combine_limits(bounds.before[corner], bounds.after[corner]))
        error = length(connections.begin + connections.evaluate(EVERY, nearest))
        return _make_curves(bounds, rows, corner, curvature, error, curvature)


# Replaces a corner next to an arc by a pair of tangent arcs.
PAIR = _Pair()
# Replaces a corner next to an arc by a connection with continuous curvature.
CONNECTION = _Connection()


def _make_curves(
    bounds: CornerBounds,
    rows: Segments,
    corner: IntArray,
    tightest: FloatArray,
    error: FloatArray,
    curvature: FloatArray,
) -> CornerCurves:
    """Make `CornerCurves` of n corners.

    - `rows`: segments of all curves.
    - `corner`: index of the corner of each segment.
    - `tightest`: largest curvature of each curve [1/m], (n,).
    - `error`: corner errors [m], (n,).
    - `curvature`: largest curvature of each curve towards the inside of its corner [1/m], (n,).
    """
    reaches_error = error >= bounds.error * (1 - BOUND_REACHED)
    reaches_radius = curvature <= (1 + BOUND_REACHED) / bounds.radius
    full = reaches_error | reaches_radius
    with np.errstate(divide="ignore"):
        return CornerCurves(
            rows=rows, corner=corner, radius=1 / tightest, error=error, shrunk=~full
        )


def _make_pairs(before: Segments, after: Segments, t: FloatArray) -> _Pairs:
    """Make pairs of tangent arcs with given tangent lengths [m], (n,)."""
    corner = after.starts
    inward = after.tangents - before.end_tangents
    # Points are relative to the corner, so even tiny blends have full precision.
    back, ahead = around_vertices(before, after)
    p0 = back.evaluate(EVERY, t)
    t0 = -unit(back.evaluate(EVERY, t, 1))
    p1 = ahead.evaluate(EVERY, t)
    t1 = unit(ahead.evaluate(EVERY, t, 1))
    share = _tangent_length(back, t) / _tangent_length(ahead, t)
    with np.errstate(divide="ignore", invalid="ignore"):
        first, second = make_biarcs(p0, t0, p1, t1, share)
        error = _corner_distances(first, second)
    curvature = np.maximum(_signed_curvatures(first, inward), _signed_curvatures(second, inward))
    segment_limits = combine_limits(before, after)
    return _Pairs(
        first=first.replace(starts=first.starts + corner, **segment_limits),
        second=second.replace(starts=second.starts + corner, **segment_limits),
        error=error,
        bend=curvature,
    )


def _bound_peaks(values: FloatArray) -> FloatArray:
    """Bound n smooth functions from evenly spaced samples `values`, (samples, n)."""
    # Between samples, a peak exceeds the nearest sample by at most about an eighth of the second
    # difference; a sixth is a safe bound.
    inner = values[1:-1]
    rise = np.abs(values[2:] - 2 * inner + values[:-2]) / 6
    peaks = inner + np.where((inner >= values[2:]) & (inner >= values[:-2]), rise, 0.0)
    # If the values decrease towards an end, the peak can be between the end and the next sample.
    for ends, end_rise in ((values[:3], rise[0]), (values[:-4:-1], rise[-1])):
        falls = 3 * ends[0] < 4 * ends[1] - ends[2]
        peaks = np.concatenate([peaks, [ends[0] + np.where(falls, end_rise, 0.0)]])
    return np.asarray(peaks.max(axis=0))


def _corner_distances(first: Segments, second: Segments) -> FloatArray:
    """Return each blend's distance from its corner, which is the origin [m], (n,).

    - `first`, `second`: both arcs of each blend.
    """
    # Coordinates are relative to the point where the arcs meet. This point is near the corner, so
    # no significant digits are lost.
    v = -second.starts
    x = dot(v, second.tangents)
    after = x > 0
    normals = np.where(after[:, None], second.normals, first.normals_at(EVERY, first.lengths))
    k = np.where(after, second.curvatures, first.curvatures)
    y = dot(v, normals)
    power = k * (x * x + y * y) - 2 * y
    in_plane = power / (1 + np.sqrt(np.maximum(1 + k * power, 0.0)))
    across = v - x[:, None] * second.tangents - y[:, None] * normals
    distances = np.hypot(in_plane, length(across))
    return np.asarray(np.where(np.isfinite(distances), distances, np.inf))


def _tangent_length(rows: Segments, t: FloatArray) -> FloatArray:
    """Return tangent lengths for arcs or lines with the arc lengths t [m], (n,).

    For a radius R and half the turn h = t / (2 R), the tangent length is R tan(h).
    """
    half = rows.curvatures * t / 2
    return np.asarray(t / 2 * np.sinc(half / np.pi) / np.cos(half))


def _signed_curvatures(arcs: Segments, inward: FloatArray) -> FloatArray:
    """Return the curvatures of arcs [1/m], negative if they bend away from `inward`, (n,)."""
    return np.asarray(np.where(dot(arcs.normals, inward) >= 0, 1, -1) * arcs.curvatures)
