"""Largest distance of one curve's points from another curve, as a close upper bound.

The curves are chains of pieces x(s) with bounded second derivatives. An interval of the first curve
from s to s + h and the part of the other curve from t to t' are both passed evenly, where t and t'
are the nearest points to the interval's ends. The difference of their points is linear up to its
second derivative and the jumps J of the first derivative, so the distance is at most

    max(a, b) + (max |x''| h² + max |y''| (t' - t)²) / 8 + sum(J) |t' - t| / 4,

with the distances a and b at the ends. Where the nearest point jumps to another part, it is at most
(a + b + max |x'| h) / 2, because a distance changes by at most the length of the way. Intervals
whose bound exceeds the largest distance found by more than the resolution are halved.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.quintics import to_bernstein
from armcontour.geometry.path import Path
from armcontour.geometry.projection import Projection

# Number of intervals of even length that are measured first.
PLACES = 2_000
# Largest number of halvings of an interval, and of intervals that are halved at one time.
MAX_HALVINGS = 40
MAX_INTERVALS = 200_000


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PieceBounds:
    """Bounds of the derivatives of a curve's n pieces along its parameter s.

    Args:
        breaks: Parameters at the ends of the pieces [m], (n + 1,).
        rate: Largest |x'| of each piece, 1 for arc length, (n,).
        bend: Largest |x''| of each piece [1/m], (n,).
        jumps: Jump |x'| at the start of each piece, 0 at the first, (n,).
    """

    breaks: FloatArray
    rate: FloatArray
    bend: FloatArray
    jumps: FloatArray

    @classmethod
    def of_path(cls, path: Path) -> PieceBounds:
        """Return the bounds of lines and arcs."""
        return cls(
            breaks=path.breaks,
            rate=np.ones(len(path)),
            bend=np.abs(path.curvatures),
            jumps=np.append(0.0, 2 * np.sin(path.turns / 2)),
        )

    @classmethod
    def of_quintics(cls, breaks: FloatArray, coefficients: FloatArray) -> PieceBounds:
        """Return the bounds of quintics, as their Bernstein points have them.

        - `breaks`: parameters at the ends of the quintics [m], (n + 1,).
        - `coefficients`: as from `quintic` [m], (n, 6, dimension).
        """
        width = np.diff(breaks)[:, None, None]
        powers = np.arange(1, 6)[:, None]
        first = coefficients[:, 1:] * powers / width
        second = first[:, 1:] * powers[:4] / width
        slopes = np.einsum("bp,npd->nbd", to_bernstein(4), first)
        bends = np.einsum("bp,npd->nbd", to_bernstein(3), second)
        jumps = np.linalg.norm(slopes[1:, 0] - slopes[:-1, -1], axis=1)
        return cls(
            breaks=breaks,
            rate=np.linalg.norm(slopes, axis=2).max(axis=1),
            bend=np.linalg.norm(bends, axis=2).max(axis=1),
            jumps=np.append(0.0, jumps),
        )

    def excess(self, s: FloatArray, t: FloatArray) -> FloatArray:
        """Return how far the curve from s to t can be from an even motion along its chord [m].

        - `s`, `t`: parameters of both ends [m], (n,) each.
        """
        last = len(self.bend) - 1
        low = np.minimum(s, t)
        high = np.maximum(s, t)
        first_piece = np.clip(np.searchsorted(self.breaks, low, side="right") - 1, 0, last)
        last_piece = np.clip(np.searchsorted(self.breaks, high, side="left") - 1, first_piece, last)
        ranges = np.stack([first_piece, last_piece + 1], axis=1).ravel()
        bend = np.maximum.reduceat(np.append(self.bend, 0.0), ranges)[::2]
        jumped = np.cumsum(self.jumps)
        jump = jumped[last_piece] - jumped[first_piece]
        length = high - low
        return np.asarray(length * (bend * length / 2 + jump) / 4)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class MeasuredCurve:
    """A curve whose distance from another one is measured.

    Args:
        points: Returns the points at n parameters, (n, dimension).
        nearest: Returns the distances from n points to the curve, and the parameters there.
        bounds: Bounds of the derivatives.
    """

    points: Callable[[FloatArray], FloatArray]
    nearest: Callable[[FloatArray], Projection]
    bounds: PieceBounds

    @classmethod
    def of_path(cls, path: Path) -> MeasuredCurve:
        """Return the curve of a path of lines and arcs."""
        return cls(points=path, nearest=path.project, bounds=PieceBounds.of_path(path))


@dataclass(frozen=True, slots=True, kw_only=True)
class LargestDistance:
    """Largest distance of a curve's points from another curve.

    Args:
        measured: Largest distance at points [m].
        bound: Upper bound for all points [m].
    """

    measured: float
    bound: float


def largest_distance(
    curve: MeasuredCurve, other: MeasuredCurve, resolution: float
) -> LargestDistance:
    """Return the largest distance of a curve's points from another curve.

    The bound exceeds the measured distance by at most `resolution` [m], unless the curves are
    nearly parallel over so many points that MAX_INTERVALS would be exceeded.
    """
    breaks = curve.bounds.breaks
    s = np.union1d(np.linspace(breaks[0], breaks[-1], PLACES + 1), breaks)
    found = other.nearest(curve.points(s))
    # Both ends of each interval: parameter, distance, and parameter of the nearest point, (n, 3).
    rows = np.stack([s, found.distance, found.s], axis=1)
    low = rows[:-1]
    high = rows[1:]
    measured = float(found.distance.max())
    closed = 0.0  # Largest bound of intervals that are not halved
    for halvings in range(MAX_HALVINGS + 1):
        bounds = _interval_bounds(curve.bounds, other.bounds, low, high)
        is_open = bounds > measured + resolution
        count = int(is_open.sum())
        if not count or count > MAX_INTERVALS or halvings == MAX_HALVINGS:
            closed = max(closed, float(bounds.max(initial=0.0)))
            break
        closed = max(closed, float(bounds[~is_open].max(initial=0.0)))
        low = low[is_open]
        high = high[is_open]
        s = (low[:, 0] + high[:, 0]) / 2
        found = other.nearest(curve.points(s))
        measured = max(measured, float(found.distance.max()))
        middle = np.stack([s, found.distance, found.s], axis=1)
        low = np.concatenate([low, middle])
        high = np.concatenate([middle, high])
    return LargestDistance(measured=measured, bound=max(measured, closed))


def _interval_bounds(
    own: PieceBounds, other: PieceBounds, low: FloatArray, high: FloatArray
) -> FloatArray:
    """Bound the distances of n intervals of a curve from another one [m], (n,).

    - `own`: bounds of the curve, on one of whose pieces each interval lies.
    - `low`, `high`: both ends: parameter, distance, and parameter of the nearest point [m], (n, 3).
    """
    piece = np.searchsorted(own.breaks, (low[:, 0] + high[:, 0]) / 2) - 1
    length = high[:, 0] - low[:, 0]
    even = np.maximum(low[:, 1], high[:, 1]) + own.bend[piece] * length**2 / 8
    even += other.excess(low[:, 2], high[:, 2])
    far = (low[:, 1] + high[:, 1] + own.rate[piece] * length) / 2
    return np.asarray(np.minimum(even, far))
