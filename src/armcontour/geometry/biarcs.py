"""Biarcs and transitions: curves that join points with given tangents and curvatures.

A biarc is a pair of tangent arcs. A transition is a chain of quintics over arc length. Neighbouring
segments share point, tangent and curvature to the last digit. The norm of a quintic's derivative is
1 within `UNEVEN`, so its parameter is the arc length.
"""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.quintics import evaluate, quintic
from armcontour.core.sampled_data import number_parts
from armcontour.geometry.segments import Segments, bound_second_derivatives

# An arc is a line if its chord and its start tangent differ by less than this angle [rad].
STRAIGHT = 1e-12
# Largest relative difference between the arc length and the parameter of a transition.
UNEVEN = 1e-6
# Largest distance between a transition and the arcs that replace it [m]; no arm resolves a
# nanometre.
ARC_DEVIATION = 1e-9
# Along a curve of length w whose curvature changes evenly by d, the distance of the biarc from the
# curve is BIARC_ERROR d w². BIARC_SAFETY: safety factor for this distance.
BIARC_ERROR = 1 / 324
BIARC_SAFETY = 1.25

# Points, unit tangents and curvature vectors, (n, dimension) each.
Contact = tuple[FloatArray, FloatArray, FloatArray]


@np.errstate(divide="ignore", invalid="ignore")
def make_biarcs(
    p0: FloatArray,  # Start points [m], (n, dimension)
    t0: FloatArray,  # Unit tangents at the start points, (n, dimension)
    p1: FloatArray,  # End points [m], (n, dimension)
    t1: FloatArray,  # Unit tangents at the end points, (n, dimension)
    share: FloatArray | float = 1.0,
) -> tuple[Segments, Segments]:
    """Return the first and the second arcs of biarcs from p0 to p1.

    A biarc is a pair of tangent arcs (Bolton, "Biarc curves", Computer-Aided Design 7, 1975). The
    tangent length d of the second arc solves |p1 - p0 - d (w t0 + t1)| = (1 + w) d, where w is
    `share`. With the chord v = p1 - p0, this is a d² + 2 b d = c with a = 2 w (1 - t0.t1), b =
    v.(w t0 + t1) and c = v.v.

    The values are not finite where no biarc exists, such as for equal ends with equal tangents.

    `share` is the tangent length of the first arc divided by that of the second, (n,) or a number.
    """
    chord = p1 - p0
    w = np.asarray(share)[..., None]
    # The positive solution d, computed without cancellation.
    c = dot(chord, chord)
    b = dot(chord, w * t0 + t1)
    a = 2 * share * (1 - dot(t0, t1))
    root = np.sqrt(b * b + a * c)
    d = np.where(b > 0, c / (b + root), (root - b) / a)
    q0 = p0 + (share * d)[:, None] * t0
    q1 = p1 - d[:, None] * t1
    along = unit(q1 - q0)
    return _arc(p0, t0, along, share * d), _arc((q0 + w * q1) / (1 + w), along, t1, d)


def join_pairs(first: Segments, second: Segments) -> Segments:
    """Join pairs of segments, so that the second one of each pair follows the first."""
    return Segments.join([first, second])[np.arange(2 * len(first)).reshape(2, -1).T.ravel()]


def _arc(
    start: FloatArray, tangent: FloatArray, end_tangent: FloatArray, tangent_length: FloatArray
) -> Segments:
    """Return arcs from start points and tangents to end tangents, with given tangent lengths [m].

    The first three arguments have the shape (n, dimension), the last one (n,).
    """
    # Arcs are computed from tangents and not from end points. Therefore the tangents are equal
    # where two arcs meet, even if the arcs are very short.
    half = np.arctan2(length(end_tangent - tangent), length(end_tangent + tangent))
    bent = half > STRAIGHT
    normal = np.where(bent[:, None], unit_across(end_tangent, tangent), 0.0)
    curvature = np.tan(half) / tangent_length
    return Segments(
        starts=start,
        tangents=tangent,
        normals=normal,
        curvatures=np.where(bent, curvature, 0.0),
        lengths=np.where(bent, 2 * half / curvature, 2 * tangent_length),
    )


def biarc_distance(points: FloatArray, first: Segments, second: Segments) -> FloatArray:
    """Return the largest distance of k points per biarc from its full circles [m], (n,).

    Each point is compared with the circle of the arc that is on its side of the junction. The
    distance is infinite if the values of a biarc are not finite.

    `points` are the points of each biarc [m], (n, k, dimension).
    """
    after = dot(points - second.starts[:, None], second.tangents[:, None]) > 0
    distances = np.where(after, _from_circle(points, second), _from_circle(points, first))
    worst = np.asarray(distances.max(axis=1))
    return np.where(np.isfinite(worst) & _are_finite(first) & _are_finite(second), worst, np.inf)


def _from_circle(points: FloatArray, arcs: Segments) -> FloatArray:
    """Return the distances of points from the full circles or lines of arcs [m], (n, k).

    - `points`: k points per arc [m], (n, k, dimension).
    """
    v = points - arcs.starts[:, None]
    x = dot(v, arcs.tangents[:, None])
    y = dot(v, arcs.normals[:, None])
    out_of_plane = dot(v, v) - x * x - y * y
    k = arcs.curvatures[:, None]
    # This form of |p - c| - r has no cancellation if the radius is very large.
    power = k * (x * x + y * y) - 2 * y
    in_plane = power / (1 + np.sqrt(np.maximum(1 + k * power, 0.0)))
    line = np.where(k == 0, np.abs(y), np.abs(in_plane))
    return np.asarray(np.hypot(line, np.sqrt(np.maximum(out_of_plane, 0.0))))


def _are_finite(arcs: Segments) -> BoolArray:
    """Return the mask of the arcs whose values are all finite, (n,)."""
    vectors = (arcs.starts, arcs.tangents, arcs.normals)
    masks = [np.isfinite(x).all(axis=1) for x in vectors]
    masks += [np.isfinite(x) for x in (arcs.curvatures, arcs.lengths)]
    return np.asarray(np.logical_and.reduce(masks))


def unit(v: FloatArray) -> FloatArray:
    """Return unit vectors along the last axis; not finite for zero vectors."""
    return np.asarray(v / length(v)[..., None])


def unit_across(v: FloatArray, along: FloatArray) -> FloatArray:
    """Return unit vectors along `v` that are perpendicular to `along` to the last digit.

    At a small angle between `v` and `along`, rounding errors tilt the first result.
    """
    for _ in range(2):
        v = unit(v - dot(v, along)[..., None] * along)
    return v


def length(v: FloatArray) -> FloatArray:
    """Return lengths of vectors along the last axis."""
    return np.asarray(np.sqrt(dot(v, v)))


def dot(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return scalar products of vectors along the last axis."""
    # For arrays of short vectors, einsum is faster than a sum along an axis.
    return np.asarray(np.einsum("...k,...k->...", a, b))


def join_by_quintics(begin: Contact, end: Contact, lengths: FloatArray) -> Segments:
    """Return quintics with given contacts at both ends, without limits and tags.

    - `begin`: contacts at the starts.
    - `end`: contacts at the ends, whose points are relative to the starts, so even tiny quintics
      have full precision.
    - `lengths`: arc lengths [m], (n,).
    """
    none = np.zeros_like(begin[0])
    coefficients = quintic(lengths, (none, *begin[1:]), end)
    curvature = length(begin[2])
    normals = np.divide(begin[2], curvature[:, None], out=none.copy(), where=curvature[:, None] > 0)
    return Segments(
        starts=begin[0],
        tangents=begin[1],
        normals=normals,
        curvatures=bound_second_derivatives(coefficients, lengths),
        lengths=lengths,
        quintics=coefficients,
    )


def draw_arcs(segments: Segments) -> tuple[Segments, FloatArray]:
    """Replace transitions by arcs within `ARC_DEVIATION`.

    Returns a table of lines and arcs, which is `segments` if there are no transitions, and for each
    line and arc the arc length on the original path at which it starts [m], (n,). An arc is never
    longer than the part that it replaces.
    """
    bent = segments.is_transition
    if not bent.any():
        return segments, segments.breaks[:-1]
    quintics = segments.quintics[bent]
    lengths = segments.lengths[bent]
    # If the curvature changes by c per length, the biarc of a part of length h deviates by
    # BIARC_ERROR c h³.
    changes = bound_third_derivatives(quintics, lengths)
    parts = lengths * np.cbrt(BIARC_SAFETY * BIARC_ERROR * changes / ARC_DEVIATION)
    count = np.maximum(np.ceil(parts), 1).astype(np.intp)
    row, number = number_parts(count)
    step = (lengths / count)[row]
    # Points and unit tangents at the start and at the end of each part.
    ends: list[FloatArray] = []
    for k in (number, number + 1):
        ends.append(evaluate(quintics[row], lengths[row], k * step, 0))
        ends.append(unit(evaluate(quintics[row], lengths[row], k * step, 1)))
    with np.errstate(invalid="ignore"):  # A straight quintic has no normal.
        halves = make_biarcs(*ends)
    source = np.flatnonzero(bent)[row]
    columns = segments[source].limit_columns
    share = step / (halves[0].lengths + halves[1].lengths)
    breaks = segments.breaks
    others = np.flatnonzero(~bent)
    first = breaks[source] + number * step
    middle = first + share * halves[0].lengths
    drawn = [
        x.replace(
            starts=x.starts + segments.starts[source],
            lengths=x.lengths * np.minimum(share, 1.0),
            **columns,
        )
        for x in halves
    ]
    none = np.zeros(len(others), dtype=np.intp)
    order = np.lexsort(
        [
            np.concatenate([none, np.zeros_like(row), np.ones_like(row)]),
            np.concatenate([none, number, number]),
            np.concatenate([others, source, source]),
        ]
    )
    plain = segments[~bent].replace(quintics=np.empty((len(others), 0, 0)))
    begin = np.concatenate([breaks[others], first, middle])
    return Segments.join([plain, *drawn])[order], begin[order]


def tangent_and_curvature(first: FloatArray, second: FloatArray) -> tuple[FloatArray, FloatArray]:
    """Return unit tangents and curvature vectors [1/m] from the derivatives of curves.

    - `first`, `second`: first and second derivatives by any parameter, (..., dimension) each.
    """
    speed2 = dot(first, first)
    across = second - (dot(first, second) / speed2)[..., None] * first
    return first / np.sqrt(speed2)[..., None], across / speed2[..., None]


def bound_third_derivatives(quintics: FloatArray, lengths: FloatArray) -> FloatArray:
    """Return upper bounds of quintics' third derivatives by arc length [1/m²], (n,)."""
    c3 = quintics[:, 3]
    c4 = quintics[:, 4]
    c5 = quintics[:, 5]
    control = np.stack([6 * c3, 6 * c3 + 12 * c4, 6 * c3 + 24 * c4 + 60 * c5], axis=1)
    return np.asarray(np.linalg.norm(control, axis=2).max(axis=1) / lengths**3)
