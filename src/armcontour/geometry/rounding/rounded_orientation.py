"""Tool orientation of a rounded path, with a continuous angular rate.

Across a rounded vertex the orientation is `exp(g b) exp(f a) R`, where R is the orientation at the
vertex, and a and b are the angular rates before and after the vertex. f ends at 0 with slope 0, and
g starts at 0 with slope 0, so rate a fades out while rate b sets in. They are cubics. For
continuous curvature they are quintics with zero second derivatives at the ends, so the derivative
of the angular rate is continuous as well. A vertex has the index of the segment before it.
"""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import exp
from armcontour.core.quintics import quintic
from armcontour.geometry.orientation import (
    RATE_FLOOR,
    SAME_ORIENTATION,
    SAME_RATE,
    Orientation,
    fit_cubics,
    no_third_rotation,
    raise_degree,
    turns_between,
)
from armcontour.geometry.path import Path
from armcontour.geometry.rounding.warped_orientation import warp_orientation
from armcontour.geometry.segments import TANGENT_TOLERANCE, Segments

# If a blend of length l replaces the length t on either side, the polynomial f of `Orientation` is
# `l MIDDLE - t / 2` in its middle if f is a cubic.
MIDDLE = 1 / 8
# In the middle of such a blend, f is `l SMOOTH_MIDDLE - t / 2` if f is a quintic.
SMOOTH_MIDDLE = 5 / 32
# A remainder of a segment, or of constant rate, between two curves that is shorter than this is a
# rounding error and is discarded [m].
SLIVER = 1e-12
# Empty array of vertex indices.
NO_VERTICES = np.empty(0, dtype=np.intp)


def find_kinks(path: Path) -> IntArray:
    """Find the vertices at which the path's angular rate jumps; returns indices, (k,).

    The result is empty if the orientation follows the tangent, turns smoothly over pieces of its
    own, or is None.
    """
    orientation = path.orientation
    if orientation is None or orientation.follows or not turns_evenly(path):
        return NO_VERTICES
    return NO_VERTICES if orientation.fixed else np.flatnonzero(orientation.kinks > 0)


def turns_evenly(path: Path) -> bool:
    """Return whether the tool turns at a constant rate along each segment of a path."""
    orientation = path.orientation
    if orientation is None:
        return True
    fits = len(orientation) == len(path) and np.array_equal(orientation.breaks, path.breaks)
    return fits and not (orientation.second.any() or orientation.third.any())


def turns_smoothly(path: Path) -> bool:
    """Return whether the tool turns over pieces of its own; its rate may jump only at corners."""
    orientation = path.orientation
    if orientation is None or orientation.follows or turns_evenly(path):
        return False
    corners = path.breaks[1:-1][path.turns > TANGENT_TOLERANCE]
    return all(np.abs(corners - s).min(initial=np.inf) <= SLIVER for s in orientation.stops)


def check_even(path: Path) -> None:
    """Raise InvalidInput unless the tool turns at a constant rate along each segment."""
    orientation = path.orientation
    if orientation is None or orientation.follows or turns_evenly(path):
        return
    raise InvalidInput(
        "The corners of this path, or its orientation, are already rounded. Round the objective "
        "path instead."
    )


def jumps_at(path: Path, vertex: IntArray) -> FloatArray:
    """Return the angles by which a path's orientation jumps at vertices [rad], (n,).

    - `vertex`: index of the segment before each vertex, (n,).
    """
    orientation = path.orientation
    assert orientation is not None
    if turns_evenly(path):
        return np.asarray(orientation.jumps[vertex])
    s = path.breaks[vertex + 1]
    before = orientation(s, side="left")
    after = orientation(s)
    return turns_between(before, after, axis_only=orientation.axis_only)


def middle_fraction(smooth: bool) -> float:
    """Return c in `k = t / 2 - c l`, which determines a blend's middle; see `largest_blend`.

    If `smooth`, the derivative of the angular rate must not jump.
    """
    return SMOOTH_MIDDLE if smooth else MIDDLE


def middle_of_half_length(smooth: bool) -> float:
    """Return k divided by the half length t of a blend that replaces no corner.

    The path does not change along such a blend, so its length is l = 2 t, and
    `k = t / 2 - c l = (1 / 2 - 2 c) t` with c from `middle_fraction`.
    """
    return 0.5 - 2 * middle_fraction(smooth)


def largest_blend(path: Path, vertex: IntArray, allowed: float) -> FloatArray:
    """Return the largest k within the angular tolerance at each corner's middle [m], (n,).

    The orientation in the middle of a curve is `exp(k b) exp(-k a) R`: R is the orientation at the
    vertex, a and b are the angular rates before and after it. With tangent length t and length l of
    the curve, `k = t / 2 - l / 8`, or, for a continuous derivative of the rate, `k = t / 2 - 5 l /
    32`. The largest k is infinite if the rate does not jump or the orientation follows the tangent,
    and 0 where the orientation jumps, because the tool stops there. It is also infinite for an
    orientation that turns smoothly over pieces of its own, which is unchanged at the middle.

    - `vertex`: indices of the vertices, (n,).
    - `allowed`: largest angle between the orientation and its value at the vertex [rad].
    """
    orientation = path.orientation
    if orientation is None or orientation.follows or not len(vertex):
        return np.full(len(vertex), np.inf)
    blends = np.full(len(vertex), np.inf)
    if turns_evenly(path):
        blends = _largest_blend(orientation, vertex, allowed)
    return np.where(jumps_at(path, vertex) > SAME_ORIENTATION, 0.0, blends)


def round_orientation(
    objective: Path,
    vertex: IntArray,  # Indices of the rounded vertices, (k,)
    tangent: FloatArray,  # Tangent length of each vertex [m], (k,); 0 for a vertex that stays sharp
    length: FloatArray,  # Length of the curve that replaces each vertex [m], (k,)
    whole: float,  # Length of the rounded path [m]
    *,
    smooth: bool = False,  # True if the derivative of the angular rate must not jump
) -> tuple[Orientation, FloatArray]:
    """Round an orientation that does not follow the tangent, along a rounded path.

    Returns the orientation, and the angle between it and the vertex's orientation in the middle of
    each blend [rad], (k,). For a path that prescribes the tool axis only, the angle is between the
    axes.
    """
    orientation = objective.orientation
    assert orientation is not None
    if not turns_evenly(objective):
        corners = objective.breaks[vertex + 1]
        warped = warp_orientation(orientation, corners, tangent, length)
        return warped, np.zeros(len(vertex))
    lengths = objective.lengths
    n = len(objective)
    if not orientation.first.any() and not (orientation.jumps > SAME_ORIENTATION).any():
        constant = Orientation.even(
            np.array([whole]),
            orientation.starts[:1],
            np.zeros((1, 3)),
            axis_only=orientation.axis_only,
        )
        return constant.with_cone(orientation.cone), np.zeros(len(vertex))
    cut = np.zeros(n - 1)
    blend = np.zeros(n - 1)
    cut[vertex] = tangent
    blend[vertex] = length
    angles = _middle_angles(orientation, vertex, tangent / 2 - length * middle_fraction(smooth))
    return _insert_blends(lengths, orientation, cut, blend, smooth=smooth), angles


def follow_rounded(
    rounded: Segments,  # The segments of the rounded path, n of them
    objective: Path,
    segment: IntArray,
    cut: FloatArray,  # Length that a corner replaces at the start of each objective segment [m]
    allowed: float,
    *,
    smooth: bool = False,  # True if the derivative of the angular rate must not jump
) -> Orientation:
    """Round an orientation that follows the tangent, along a rounded path.

    - `objective`: the path before rounding.
    - `segment`: for each segment of the rounded path, index of the objective segment that contains
      it, or that is before its corner, (n,).
    - `allowed`: largest angle between the orientation and an orientation that follows the tangent
      exactly [rad].
    """
    from armcontour.geometry.prescribed_orientation import follow_tangents

    orientation = objective.orientation
    assert orientation is not None
    # After the curve at a corner, the frame equals that of the next objective segment, except for
    # rounding errors. The frames of the objective are used, so rounding errors do not add up.
    frames = orientation.on_piece(np.arange(len(objective)), cut)
    first = np.flatnonzero(np.diff(segment)) + 1
    start_frames = dict(zip(first.tolist(), frames[segment[first]], strict=True))
    sharp = follow_tangents(
        rounded, orientation.starts[0], None, start_frames, axis_only=orientation.axis_only
    )
    half_lengths = largest_half_lengths(sharp, allowed, smooth=smooth)
    blended = blend_kinks(sharp, half_lengths, smooth=smooth)[0]
    return blended.with_cone(orientation.cone)


def largest_half_lengths(sharp: Orientation, allowed: float, *, smooth: bool = False) -> FloatArray:
    """Return the blends' largest half lengths within an angular tolerance [m], (n - 1,).

    The path, and with it the length of each piece, does not change. The half length is 0 where the
    rate does not jump.

    - `sharp`: the orientation of constant rates, n pieces.
    - `allowed`: largest angle between the blended and the original orientation [rad].
    - `smooth`: true if the derivative of the angular rate must not jump.
    """
    vertex = np.arange(len(sharp) - 1)
    half_lengths = _largest_blend(sharp, vertex, allowed) / middle_of_half_length(smooth)
    return np.where(sharp.kinks > 0, half_lengths, 0.0)


def blend_kinks(
    sharp: Orientation, requested: FloatArray, *, smooth: bool = False
) -> tuple[Orientation, FloatArray]:
    """Insert a blend wherever the angular rate of an orientation jumps.

    A blend replaces at most half of either piece; there is no blend where the orientation jumps.
    Its largest deviation from the constant rates is at the break.

    Returns the orientation, and its deviation at each break between pieces [rad], (n - 1,); between
    the tool axes if only they are prescribed.

    - `sharp`: the orientation of constant rates, n pieces; the rate may change along a piece if it
      does not jump at either end.
    - `requested`: half length of each blend [m], (n - 1,).
    - `smooth`: true if the derivative of the angular rate must not jump.
    """
    vertex = np.arange(len(sharp) - 1)
    lengths = np.diff(sharp.breaks)
    cut = np.minimum(requested, np.minimum(lengths[:-1], lengths[1:]) / 2)
    uneven = np.any((sharp.second != 0) | (sharp.third != 0), axis=1)
    cut[(sharp.jumps > SAME_ORIENTATION) | uneven[:-1] | uneven[1:]] = 0.0
    blended = _insert_blends(lengths, sharp, cut, 2 * cut, smooth=smooth)
    return blended, _middle_angles(sharp, vertex, cut * middle_of_half_length(smooth))


def _middle_angles(sharp: Orientation, vertex: IntArray, k: FloatArray) -> FloatArray:
    """Return the angle of `exp(k b) exp(-k a)` in each blend's middle [rad], (k,).

    For an orientation that prescribes the tool axis only, the angle is between the axes.
    """
    a = sharp.first[vertex]
    b = sharp.first[vertex + 1]
    rotation = sharp.starts[vertex + 1]
    middle = exp(k[:, None] * b) @ exp(-k[:, None] * a)
    return turns_between(middle @ rotation, rotation, axis_only=sharp.axis_only)


def _largest_blend(sharp: Orientation, vertex: IntArray, allowed: float) -> FloatArray:
    """Return the largest k with an angle of `exp(k b) exp(-k a)` up to `allowed` [m], (k,).

    Two rotations differ by at most the distance between their rotation vectors, so the angle is at
    most `k |b - a|`. The tool axis alone turns by at most `k d + k² e m / 2`: d and e are the
    components of b - a perpendicular and parallel to the axis, and m is the smaller of the rates at
    which a and b tilt the axis. See docs/concepts/corners.md.
    """
    if sharp.fixed:
        return np.full(len(vertex), np.inf)
    a = sharp.first[vertex]
    b = sharp.first[vertex + 1]
    step = b - a
    size = np.linalg.norm(step, axis=1)
    # Rates that differ by rounding errors only do not limit k.
    rates = np.linalg.norm(a, axis=1) + np.linalg.norm(b, axis=1)
    rounding = SAME_RATE * rates + RATE_FLOOR
    with np.errstate(divide="ignore", invalid="ignore"):
        largest = np.where(size > rounding, allowed / size, np.inf)
        if sharp.axis_only and np.isfinite(allowed):
            axis = sharp.starts[vertex + 1][:, :, 2]
            across = sharp.kinks[vertex]
            along = np.abs(np.sum(step * axis, axis=1))
            tilt = np.minimum(*(np.linalg.norm(np.cross(x, axis), axis=1) for x in (a, b)))
            quadratic = along * np.where(tilt > rounding, tilt, 0.0)
            root = across + np.sqrt(across**2 + 2 * allowed * quadratic)
            free = np.where(root > 0, 2 * allowed / root, np.where(quadratic > 0, 0.0, np.inf))
            largest = np.maximum(largest, free)
    return np.asarray(largest)


def _insert_blends(
    lengths: FloatArray, sharp: Orientation, cut: FloatArray, blend: FloatArray, *, smooth: bool
) -> Orientation:
    """Shorten the pieces of an orientation, and insert a blend between each two of them.

    - `lengths`: lengths of the n pieces [m], (n,).
    - `sharp`: the orientation of n pieces.
    - `cut`: length by which both pieces at each break are shortened [m], (n - 1,).
    - `blend`: length of the blend at each break [m], (n - 1,).
    """
    n = len(lengths)
    # Pieces have even rows, and blends have odd rows.
    size = 2 * n - 1
    degree = 5 if smooth else sharp.f.shape[1] - 1
    before = np.append(0.0, cut)
    after = np.append(cut, 0.0)
    spans = np.zeros(size)
    spans[::2] = lengths - before - after
    spans[::2][spans[::2] <= SLIVER] = 0.0
    spans[1::2] = blend
    starts = np.empty((size, 3, 3))
    first = np.empty((size, 3))
    second = np.zeros((size, 3))
    f = np.zeros((size, degree + 1))
    g = np.zeros((size, degree + 1))
    starts[::2] = exp(before[:, None] * sharp.first) @ sharp.starts
    starts[1::2] = sharp.starts[1:]
    first[::2] = sharp.first
    first[1::2] = sharp.first[:-1]
    second[::2] = sharp.second
    second[1::2] = sharp.first[1:]
    f[::2], g[::2] = (raise_degree(x, degree) for x in (sharp.f, sharp.g))
    with np.errstate(divide="ignore", invalid="ignore"):
        f[1::2], g[1::2] = (
            raise_degree(x, degree) for x in _fade_polynomials(cut, blend, smooth=smooth)
        )
    used = spans > 0
    return Orientation(
        breaks=np.concatenate([[0.0], np.cumsum(spans[used])]),
        starts=starts[used],
        first=first[used],
        second=second[used],
        f=f[used],
        g=g[used],
        **no_third_rotation(int(used.sum()), degree + 1),
        axis_only=sharp.axis_only,
        follows=sharp.follows,
        cone=sharp.cone,
    )


def _fade_polynomials(
    cut: FloatArray, blend: FloatArray, *, smooth: bool
) -> tuple[FloatArray, FloatArray]:
    """Return f, which fades out the rate before a vertex, and g for the rate after it.

    - `cut`, `blend`: as in `_insert_blends`, (k,).

    Both results are coefficients of 1, u, u², ..., (k, degree + 1).
    """
    zeros = np.zeros_like(cut)
    ones = np.ones_like(cut)
    if not smooth:
        return fit_cubics(blend, (-cut, ones), (zeros, zeros)), fit_cubics(
            blend, (zeros, zeros), (cut, ones)
        )
    # Values and slopes of f and g at the ends of the blends; the second derivatives are zero.
    ends = [
        np.stack(x, axis=1)
        for x in ((zeros, zeros), (-cut, zeros), (ones, zeros), (zeros, cut), (zeros, ones))
    ]
    no_curvature, begin_values, begin_slopes, end_values, end_slopes = ends
    coefficients = quintic(
        blend, (begin_values, begin_slopes, no_curvature), (end_values, end_slopes, no_curvature)
    )
    f, g = np.moveaxis(coefficients / blend[:, None, None] ** np.arange(6)[:, None], 2, 0)
    return f, g
