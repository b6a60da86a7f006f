"""Biarcs: pairs of tangent arcs with given ends and end tangents."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import BoolArray, FloatArray

# A chord that leaves its tangent by less than this angle [rad] is a line.
STRAIGHT = 1e-12


@dataclass(frozen=True, slots=True, kw_only=True)
class Arcs:
    """Lines and arcs as a path holds them: see `Path`."""

    starts: FloatArray
    tangents: FloatArray
    inwards: FloatArray
    curvatures: FloatArray
    lengths: FloatArray

    @property
    def finite(self) -> BoolArray:
        """Where there is an arc at all, (n,)."""
        n = len(self.lengths)
        rows = [np.isfinite(getattr(self, x)).reshape(n, -1).all(axis=1) for x in self.__slots__]
        return np.asarray(np.logical_and.reduce(rows))


def pairs(p0: FloatArray, t0: FloatArray, p1: FloatArray, t1: FloatArray) -> tuple[Arcs, Arcs]:
    """Two arcs from each p0 with tangent t0 to p1 with tangent t1, with equal tangent lengths.

    Not finite where there are none: ends that are one point with one tangent.
    """
    chord = p1 - p0
    # |chord - d (t0 + t1)| = 2 d, solved for the positive d without cancellation.
    c, b = dot(chord, chord), dot(chord, t0 + t1)
    a = 2 * (1 - dot(t0, t1))
    root = np.sqrt(b * b + a * c)
    d = np.where(b > 0, c / (b + root), (root - b) / a)
    q0, q1 = p0 + d[:, None] * t0, p1 - d[:, None] * t1
    along = unit(q1 - q0)
    return _arc(p0, t0, along, d), _arc((q0 + q1) / 2, along, t1, d)


def _arc(start: FloatArray, tangent: FloatArray, onward: FloatArray, reach: FloatArray) -> Arcs:
    """Arcs from a point with a tangent to another tangent, by their tangent lengths.

    Made of tangents and not of points, so that the tangents are the same where two arcs meet,
    however short they are.
    """
    half = np.arctan2(length(onward - tangent), length(onward + tangent))
    bent = half > STRAIGHT
    across = onward - dot(onward, tangent)[:, None] * tangent
    inward = np.where(bent[:, None], unit(across), 0.0)
    # An inward vector must be at right angles to the tangent to the last digit.
    inward = inward - dot(inward, tangent)[:, None] * tangent
    inward = np.where(bent[:, None], unit(inward), 0.0)
    share = np.tan(half) / reach
    curvature = np.where(bent, share, 0.0)
    along = np.where(bent, 2 * half / share, 2 * reach)
    return Arcs(starts=start, tangents=tangent, inwards=inward, curvatures=curvature, lengths=along)


def distance(points: FloatArray, first: Arcs, second: Arcs) -> FloatArray:
    """Largest distance of points, (n, k, dimension), from the circles of each pair of arcs, (n,).

    Infinite where there are no arcs.
    """
    behind = np.sum((points - second.starts[:, None]) * second.tangents[:, None], axis=2) > 0
    apart = np.where(behind, _from_circle(points, second), _from_circle(points, first))
    worst = np.asarray(apart.max(axis=1))
    return np.where(np.isfinite(worst) & first.finite & second.finite, worst, np.inf)


def _from_circle(points: FloatArray, arcs: Arcs) -> FloatArray:
    """Distance of points from the circles, or lines, of arcs."""
    v = points - arcs.starts[:, None]
    x = np.sum(v * arcs.tangents[:, None], axis=2)
    y = np.sum(v * arcs.inwards[:, None], axis=2)
    rest = np.sum(v * v, axis=2) - x * x - y * y
    k = arcs.curvatures[:, None]
    # (|p - c| - r) without the large numbers of flat arcs.
    power = k * (x * x + y * y) - 2 * y
    in_plane = power / (1 + np.sqrt(np.maximum(1 + k * power, 0.0)))
    line = np.where(k == 0, np.abs(y), np.abs(in_plane))
    return np.asarray(np.hypot(line, np.sqrt(np.maximum(rest, 0.0))))


def in_turn(first: Arcs, second: Arcs) -> Arcs:
    """First and second arcs of all pairs in the order of the path."""

    def both(name: str) -> FloatArray:
        a, b = getattr(first, name), getattr(second, name)
        return np.stack([a, b], axis=1).reshape(2 * len(a), *a.shape[1:])

    return Arcs(**{name: both(name) for name in Arcs.__slots__})


def unit(v: FloatArray) -> FloatArray:
    """Vectors of length 1, along the last axis; not finite for zero."""
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def length(v: FloatArray) -> FloatArray:
    """Lengths of vectors."""
    return np.asarray(np.linalg.norm(v, axis=-1))


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of vectors."""
    return np.asarray(np.sum(a * b, axis=-1))
