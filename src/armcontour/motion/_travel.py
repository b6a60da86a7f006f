"""The compiled part of bounds of joint motion: of dq_ds between arc lengths, and of path speeds."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled
from armcontour.motion._laws import linear_motion, speed_after


@compiled(inner=True)
def _steepest_within(c: FloatArray, j: int, x: float, h: float) -> float:
    """The bound of |dq_dx| of joint j from x to x + h on a piece, by its Bernstein coefficients.

    The derivative is a polynomial of degree 4: over an interval it is between the least and the
    largest of these.

    Args:
        c: Coefficients of the piece over 0 to 1 [rad], (6, dof).
        j: The joint.
        x: Start of the interval, from 0 to 1.
        h: Its width.
    """
    a, b, d, e, f = c[1, j], 2 * c[2, j], 3 * c[3, j], 4 * c[4, j], 5 * c[5, j]
    # Coefficients about the start of the interval.
    e += x * f
    d += x * e
    b += x * d
    a += x * b
    e += x * f
    d += x * e
    b += x * d
    e += x * f
    d += x * e
    e += x * f
    # Coefficients over 0 to 1 within it.
    b, d, e, f = h * b, h * h * d, h * h * h * e, h * h * h * h * f
    found: float = max(abs(a), abs(a + b / 4))
    found = max(found, abs(a + b / 2 + d / 6))
    found = max(found, abs(a + 3 * b / 4 + d / 2 + e / 4))
    found = max(found, abs(a + b + d + e + f))
    return found


@compiled()
def fastest_joints(
    breaks: FloatArray, coefficients: FloatArray, s: FloatArray, speeds: FloatArray
) -> FloatArray:
    """Bounds of the joint velocities between neighbouring arc lengths [rad/s], (n, dof).

    Args:
        breaks: Of the joint path [m], (pieces + 1,).
        coefficients: Of its pieces [rad], (pieces, 6, dof).
        s: Arc lengths, which do not decrease [m], (n + 1,).
        speeds: Bounds of the path speed between them [m/s], (n,).
    """
    n, dof, last = len(s) - 1, coefficients.shape[2], len(breaks) - 2
    found = np.empty((n, dof))
    piece = 0
    for i in range(n):
        for j in range(dof):
            found[i, j] = 0.0
        begin, end = s[i], s[i + 1]
        while piece < last and breaks[piece + 1] <= begin:
            piece += 1
        k = piece
        while True:
            # Most laws have the breaks of their joint path, and those of uniform speed may not.
            until = end if k == last else min(end, breaks[k + 1])
            width = breaks[k + 1] - breaks[k]
            x, h = (begin - breaks[k]) / width, (until - begin) / width
            for j in range(dof):
                value = _steepest_within(coefficients[k], j, x, h) / width
                found[i, j] = max(found[i, j], value)
            if until >= end:
                break
            k, begin = k + 1, until
        for j in range(dof):
            found[i, j] *= speeds[i]
    return found


@compiled()
def fastest_along(
    breaks: FloatArray, speeds: FloatArray, dds: FloatArray, slope: FloatArray, jerk: FloatArray
) -> FloatArray:
    """Bounds of the path speed within every interval of a law along a joint path [m/s], (n,).

    Args:
        breaks: Times of the ends of the intervals [s], (n + 1,).
        speeds: Path speeds at the starts of the intervals [m/s], (n,).
        dds: Path accelerations there [m/s²], (n,).
        slope: Their slopes over s [1/s²], (n,).
        jerk: Their slopes over time, on intervals without the other slope [m/s³], (n,).
    """
    n = len(dds)
    found = np.empty(n)
    for i in range(n):
        ds, a = speeds[i], dds[i]
        if i + 1 < n:
            end = speeds[i + 1]
        else:
            t = breaks[n] - breaks[i]
            c, h, _ = linear_motion(slope[i], t)
            end = speed_after(ds, a, jerk[i], c, h, t)
        fastest = max(ds, end)
        # ds² is a parabola over s, or ds one over time; with a peak where the acceleration is 0.
        if a > 0.0 and jerk[i] < 0.0:
            fastest = max(fastest, ds - a * a / (2.0 * jerk[i]))
        elif a > 0.0 and slope[i] < 0.0:
            fastest = max(fastest, math.sqrt(ds * ds - a * a / slope[i]))
        found[i] = fastest
    return found
