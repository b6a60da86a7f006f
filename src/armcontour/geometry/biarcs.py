"""Biarcs: pairs of tangent arcs with given end points and end tangents."""

from __future__ import annotations

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour.geometry.segments import Segments

# An arc is a line if its chord and its start tangent differ by less than this angle [rad].
STRAIGHT = 1e-12


def biarcs(
    p0: FloatArray,
    t0: FloatArray,
    p1: FloatArray,
    t1: FloatArray,
    share: FloatArray | float = 1.0,
) -> tuple[Segments, Segments]:
    """First and second arcs of the biarcs from p0 to p1 with a given share of tangent lengths.

    The values are not finite where no biarc exists: for equal ends with equal tangents.

    Args:
        p0: Start points [m], (n, dimension).
        t0: Unit tangents at the start points, (n, dimension).
        p1: End points [m], (n, dimension).
        t1: Unit tangents at the end points, (n, dimension).
        share: Tangent length of the first arc over that of the second, (n,) or one for all.
    """
    chord, w = p1 - p0, np.asarray(share)[..., None]
    # |chord - d (w t0 + t1)| = (1 + w) d, solved for the positive d without cancellation.
    c, b = dot(chord, chord), dot(chord, w * t0 + t1)
    a = 2 * share * (1 - dot(t0, t1))
    root = np.sqrt(b * b + a * c)
    with np.errstate(divide="ignore", invalid="ignore"):
        d = np.where(b > 0, c / (b + root), (root - b) / a)
    q0, q1 = p0 + (share * d)[:, None] * t0, p1 - d[:, None] * t1
    along = unit(q1 - q0)
    return _arc(p0, t0, along, share * d), _arc((q0 + w * q1) / (1 + w), along, t1, d)


def _arc(
    start: FloatArray, tangent: FloatArray, end_tangent: FloatArray, tangent_length: FloatArray
) -> Segments:
    """Arcs from start points and tangents to end tangents, with given tangent lengths.

    Arcs are computed from tangents and not from end points, so that even very short arcs have equal
    tangents where they meet.
    """
    half = np.arctan2(length(end_tangent - tangent), length(end_tangent + tangent))
    bent = half > STRAIGHT
    across = end_tangent - dot(end_tangent, tangent)[:, None] * tangent
    normal = np.where(bent[:, None], unit(across), 0.0)
    # The normal must be perpendicular to the tangent to the last digit.
    normal = normal - dot(normal, tangent)[:, None] * tangent
    normal = np.where(bent[:, None], unit(normal), 0.0)
    bend = np.tan(half) / tangent_length
    return Segments(
        starts=start,
        tangents=tangent,
        normals=normal,
        curvatures=np.where(bent, bend, 0.0),
        lengths=np.where(bent, 2 * half / bend, 2 * tangent_length),
    )


def distance(points: FloatArray, first: Segments, second: Segments) -> FloatArray:
    """Largest distance of the k points of each biarc from its two circles [m], (n,).

    The distance is infinite where a biarc is not finite.

    Args:
        points: Points to compare with each biarc [m], (n, k, dimension).
        first: First arcs of the biarcs.
        second: Second arcs of the biarcs.
    """
    after = dot(points - second.starts[:, None], second.tangents[:, None]) > 0
    distances = np.where(after, _from_circle(points, second), _from_circle(points, first))
    worst = np.asarray(distances.max(axis=1))
    return np.where(np.isfinite(worst) & _finite(first) & _finite(second), worst, np.inf)


def _from_circle(points: FloatArray, arcs: Segments) -> FloatArray:
    """Distances of points, (n, k, dimension), from the full circles or lines of arcs, (n, k)."""
    v = points - arcs.starts[:, None]
    x = dot(v, arcs.tangents[:, None])
    y = dot(v, arcs.normals[:, None])
    rest = dot(v, v) - x * x - y * y
    k = arcs.curvatures[:, None]
    # |p - c| - r, without cancellation if the radius is very large.
    power = k * (x * x + y * y) - 2 * y
    in_plane = power / (1 + np.sqrt(np.maximum(1 + k * power, 0.0)))
    line = np.where(k == 0, np.abs(y), np.abs(in_plane))
    return np.asarray(np.hypot(line, np.sqrt(np.maximum(rest, 0.0))))


def _finite(arcs: Segments) -> BoolArray:
    """True for arcs whose values are all finite, (n,)."""
    vectors = (arcs.starts, arcs.tangents, arcs.normals)
    rows = [np.isfinite(x).all(axis=1) for x in vectors]
    rows += [np.isfinite(x) for x in (arcs.curvatures, arcs.lengths)]
    return np.asarray(np.logical_and.reduce(rows))


def unit(v: FloatArray) -> FloatArray:
    """Unit vectors along the last axis; not finite for zero vectors."""
    return np.asarray(v / length(v)[..., None])


def length(v: FloatArray) -> FloatArray:
    """Lengths of vectors along the last axis."""
    return np.asarray(np.sqrt(dot(v, v)))


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Scalar products of vectors along the last axis."""
    # For arrays of short vectors faster than a sum along an axis.
    return np.asarray(np.einsum("...k,...k->...", a, b))
