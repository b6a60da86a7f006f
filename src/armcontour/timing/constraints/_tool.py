"""The compiled part of tool limits: speed and acceleration of the tool at ds = 1."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import BoolArray, FloatArray
from armcontour._kernels import compiled
from armcontour.timing.constraints._rows import ROUNDING


@compiled()
def measure(velocity: FloatArray, acceleration: FloatArray) -> FloatArray:
    """Speed, and acceleration at right angles to the motion and along it, without sign, (3, n).

    Args:
        velocity: Velocities of the tool, (n, dimension).
        acceleration: Accelerations of the tool, (n, dimension).
    """
    n, dimension = velocity.shape
    found = np.empty((3, n))
    for i in range(n):
        square = along = across = 0.0
        for k in range(dimension):
            square += velocity[i, k] * velocity[i, k]
        speed = math.sqrt(square)
        for k in range(dimension):
            along += acceleration[i, k] * (velocity[i, k] / speed)
        for k in range(dimension):
            across += (acceleration[i, k] - along * (velocity[i, k] / speed)) ** 2
        found[0, i], found[1, i], found[2, i] = speed, math.sqrt(across), abs(along)
    return found


@compiled()
def bound_on_pieces(
    velocity: FloatArray, acceleration: FloatArray, flat: float, even: float
) -> tuple[FloatArray, BoolArray]:
    """Bounds of what `measure` gives on pieces, and whether the curvature varies on each.

    A bound is the largest sample of a piece plus the spread of its samples, as a margin between
    them.

    Args:
        velocity: Velocities of the tool at some places of every piece, (places, pieces, dimension).
        acceleration: Accelerations there.
        flat: Curvatures below this do not vary.
        even: Nor do those that vary by less than this share.

    Returns:
        The bounds, (3, pieces), and whether the curvature varies, (pieces,).
    """
    places, pieces, dimension = velocity.shape
    found, uneven = np.empty((3, pieces)), np.empty(pieces, np.bool_)
    rows = places * pieces, dimension
    samples = measure(velocity.reshape(rows), acceleration.reshape(rows))
    for i in range(pieces):
        for k in range(3):
            least = most = samples[k, i]
            for place in range(1, places):
                value = samples[k, place * pieces + i]
                least, most = min(least, value), max(most, value)
            found[k, i] = 2 * most - least
            if k == 1:
                uneven[i] = most > flat and most - least > even * most
    return found, uneven


@compiled()
def touch_chords(chords: FloatArray, share: float) -> FloatArray:
    """Tangents of the bound of x where the curvature is linear, see `ToolMetric.curvature_on`.

    Args:
        chords: Curvatures at both ends of intervals, (2, n).
        share: A tangent touches where the curvature is at least this share of its largest.
    """
    n = chords.shape[1]
    found = np.empty((2, n))
    for i in range(n):
        begin, end = chords[0, i], chords[1, i]
        touch = max((begin + end) / 2, share * max(begin, end))
        for k in range(2):
            found[k, i] = touch * touch / (2 * touch - chords[k, i]) if touch > 0.0 else 0.0
    return found


@compiled()
def shrink_discs(
    width: FloatArray,
    curvature: FloatArray,
    radius: FloatArray,
    stretch: FloatArray,
    uneven: BoolArray,
    x: FloatArray,
    u: FloatArray,
    skew: FloatArray,
    found: FloatArray,
) -> None:
    """Write the radii of discs that are kept between the ends of intervals, too.

    Where the curvature is even the left side of `(c x)² + u² <= r²` is convex without skew, so it
    is largest at an end. With skew its second derivative is at least `-4 c² x |skew|`. Elsewhere
    the curvature times x is at most that at an end; skew adds to x, and to |u| at the other end.

    Args:
        width: Lengths of the intervals, (n,).
        curvature: c at the starts and ends, (2, n).
        radius: r without margins, (n,).
        stretch: Bounds of the tool's acceleration along the motion for x = 1, (n,).
        uneven: Whether the curvature varies, (n,).
        x: Largest x on each interval, (n,).
        u: Largest |u|, (n,).
        skew: Slope of u over s, (n,).
        found: Takes the radii, (n,).
    """
    for i in range(len(width)):
        play = stretch[i] + ROUNDING / width[i]
        left, slope = max(radius[i] - play * x[i], 0.0), abs(skew[i])
        most, square = max(curvature[0, i], curvature[1, i]), width[i] ** 2
        rise = square / 2 * most**2 * x[i] * slope
        if uneven[i]:
            rise += (most * square / 4 * slope) ** 2 + 2 * width[i] * u[i] * slope
        found[i] = math.sqrt(max(left**2 - rise, 0.0))
