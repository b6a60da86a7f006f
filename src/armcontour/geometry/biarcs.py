"""Biarcs: pairs of tangent arcs with given ends and end tangents."""

from __future__ import annotations

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.geometry.segments import Segments

# A chord that leaves its tangent by less than this angle [rad] is a line.
STRAIGHT = 1e-12


def biarcs(
    p0: FloatArray, t0: FloatArray, p1: FloatArray, t1: FloatArray
) -> tuple[Segments, Segments]:
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


def _arc(start: FloatArray, tangent: FloatArray, onward: FloatArray, reach: FloatArray) -> Segments:
    """Arcs from a point with a tangent to another tangent, by their tangent lengths.

    Made of tangents and not of points, so that the tangents are the same where two arcs meet,
    however short they are.
    """
    half = np.arctan2(length(onward - tangent), length(onward + tangent))
    bent = half > STRAIGHT
    across = onward - dot(onward, tangent)[:, None] * tangent
    normal = np.where(bent[:, None], unit(across), 0.0)
    # A normal must be at right angles to the tangent to the last digit.
    normal = normal - dot(normal, tangent)[:, None] * tangent
    normal = np.where(bent[:, None], unit(normal), 0.0)
    share = np.tan(half) / reach
    curvature = np.where(bent, share, 0.0)
    along = np.where(bent, 2 * half / share, 2 * reach)
    return Segments(
        starts=start, tangents=tangent, normals=normal, curvatures=curvature, lengths=along
    )


def distance(points: FloatArray, first: Segments, second: Segments) -> FloatArray:
    """Largest distance of points, (n, k, dimension), from the circles of each pair of arcs, (n,).

    Infinite where there are no arcs.
    """
    after = np.sum((points - second.starts[:, None]) * second.tangents[:, None], axis=2) > 0
    apart = np.where(after, _from_circle(points, second), _from_circle(points, first))
    worst = np.asarray(apart.max(axis=1))
    return np.where(np.isfinite(worst) & _finite(first) & _finite(second), worst, np.inf)


def _from_circle(points: FloatArray, arcs: Segments) -> FloatArray:
    """Distance of points from the circles, or lines, of arcs."""
    v = points - arcs.starts[:, None]
    x = np.sum(v * arcs.tangents[:, None], axis=2)
    y = np.sum(v * arcs.normals[:, None], axis=2)
    rest = np.sum(v * v, axis=2) - x * x - y * y
    k = arcs.curvatures[:, None]
    # (|p - c| - r) without the large numbers of flat arcs.
    power = k * (x * x + y * y) - 2 * y
    in_plane = power / (1 + np.sqrt(np.maximum(1 + k * power, 0.0)))
    line = np.where(k == 0, np.abs(y), np.abs(in_plane))
    return np.asarray(np.hypot(line, np.sqrt(np.maximum(rest, 0.0))))


def _finite(arcs: Segments) -> BoolArray:
    """Where there is an arc at all, (n,)."""
    columns = (arcs.starts, arcs.tangents, arcs.normals, arcs.curvatures, arcs.lengths)
    rows = [np.isfinite(x).reshape(len(arcs), -1).all(axis=1) for x in columns]
    return np.asarray(np.logical_and.reduce(rows))


def unit(v: FloatArray) -> FloatArray:
    """Vectors of length 1, along the last axis; not finite for zero."""
    return np.asarray(v / np.linalg.norm(v, axis=-1, keepdims=True))


def length(v: FloatArray) -> FloatArray:
    """Lengths of vectors."""
    return np.asarray(np.linalg.norm(v, axis=-1))


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Products of vectors."""
    return np.asarray(np.sum(a * b, axis=-1))
