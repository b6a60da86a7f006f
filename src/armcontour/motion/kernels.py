"""Compiled functions that evaluate time laws, and make, evaluate and bound joint paths."""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.kernel_cache import compiled

# Below this product of slope and squared duration, the series of a duration is exact.
SERIES_BELOW = 1e-4
# Below this angle, hyperbolic and circular functions are computed by their series.
SERIES_ANGLE = 1e-2


@compiled(inner=True)
def interval_time(width: float, begin: float, end: float, slope: float) -> float:
    """Return the duration of one interval [s], see `interval_times`.

    With the duration t0 at constant acceleration and z = k² t0² / 4, it is t0 atanh(√z) / √z.
    """
    uniform = 2 * width / (begin + end)
    z = slope * uniform * uniform / 4
    if abs(z) < SERIES_BELOW:
        return uniform * (1 + z * (1 / 3 + z * (1 / 5 + z * (1 / 7 + z / 9))))
    root = math.sqrt(abs(z))
    return uniform * (math.atanh(root) if z > 0 else math.atan(root)) / root


@compiled()
def interval_times(
    width: FloatArray, begin: FloatArray, end: FloatArray, slope: FloatArray
) -> FloatArray:
    """Return durations of intervals whose path acceleration is linear in s [s], (n,).

    The duration is `(2 / k) atanh(k width / (begin + end))` with `k² = slope`.

    Args:
        width: Interval lengths [m], (n,).
        begin: Path speeds at the starts [m/s], (n,).
        end: Path speeds at the ends [m/s], (n,).
        slope: Slopes of dds over s [1/s²], (n,).
    """
    times = np.empty(len(width))
    for i in range(len(width)):
        times[i] = interval_time(width[i], begin[i], end[i], slope[i])
    return times


@compiled(inner=True)
def write_law(
    s: FloatArray,  # Arc lengths at the breaks [m], (n + 1,)
    x: FloatArray,  # ds² at the breaks [m²/s²], (n + 1,)
    slope: FloatArray,  # Slopes of dds over s [1/s²], (n,)
    breaks: FloatArray,  # Output: the breaks [s], (n + 1,)
    ds: FloatArray,  # Output: path speeds at the starts of the intervals [m/s], (n,)
    dds: FloatArray,  # Output: path accelerations at the starts [m/s²], (n,)
) -> int:
    """Write the time law from squared path speeds; return the first interval at rest, or -1."""
    resting = -1
    begin = math.sqrt(x[0])
    breaks[0] = 0.0
    for i in range(len(slope)):
        width = s[i + 1] - s[i]
        end = math.sqrt(x[i + 1])
        if begin + end == 0.0 and resting < 0:
            resting = i
        ds[i] = begin
        dds[i] = (x[i + 1] - x[i]) / (2 * width) - slope[i] * width / 2
        breaks[i + 1] = breaks[i] + interval_time(width, begin, end, slope[i])
        begin = end
    return resting


@compiled()
def examine_pieces(
    breaks: FloatArray,  # Arc lengths at the ends of the pieces, (n + 1,)
    coefficients: FloatArray,  # Coefficients of the quintics, (n, 6, dof)
    kink: float,  # Smallest jump of dq_ds that counts, as a fraction of dq_ds
    no_direction: float,  # A dq_ds below this fraction of its summed terms is a rounding error
    kinks: BoolArray,  # Output: whether dq_ds jumps at each inner break, (n - 1,)
) -> tuple[bool, float]:
    """Check the pieces of a joint path, and mark the breaks at which dq_ds jumps.

    Returns whether all numbers are finite and the breaks increase, and the largest jump of a joint
    position at a break [rad].
    """
    n = coefficients.shape[0]
    dof = coefficients.shape[2]
    sound = True
    largest = 0.0
    terms_before = 0.0
    for i in range(n):
        width = breaks[i + 1] - breaks[i]
        jump = size = terms = 0.0
        for j in range(dof):
            total = 0.0
            for k in range(6):
                total += abs(coefficients[i, k, j])
                terms += k * abs(coefficients[i, k, j])
            sound = sound and total < float("inf")
            if i == 0:
                continue
            end = slope = 0.0
            for k in range(6):
                end += coefficients[i - 1, k, j]
                slope += k * coefficients[i - 1, k, j]
            before = slope / (breaks[i] - breaks[i - 1])
            after = coefficients[i, 1, j] / width
            largest = max(largest, abs(end - coefficients[i, 0, j]))
            jump += abs(after - before)
            size += abs(before) + abs(after)
        terms /= width
        if i > 0:
            kinks[i - 1] = jump > max(kink * size, no_direction * (terms_before + terms))
        terms_before = terms
        sound = sound and 0.0 < width < float("inf")
    return sound, largest


@compiled()
def spline_pieces(
    knots: FloatArray, points: FloatArray, clamped: bool, repeated: float, coefficients: FloatArray
) -> bool:
    """Write the cubic spline through points as coefficients of a `JointPath`, (n, 6, dof).

    Returns false, and writes nothing, if the parameters of the points do not increase.

    The second derivatives solve a diagonally dominant tridiagonal system by forward elimination and
    back substitution.

    - `knots`: parameters of the points, (n + 1,).
    - `points`: the points, (n + 1, dof).
    - `clamped`: true if the slopes at both ends are zero; otherwise the second derivatives are
      zero.
    - `repeated`: differences of parameters up to this fraction of the largest are rounding errors.
    - `coefficients`: output, initially zero.
    """
    n = len(knots) - 1
    # If they increase, the largest is at an end.
    shortest = repeated * max(abs(knots[0]), abs(knots[n]))
    for i in range(n):
        if not knots[i + 1] - knots[i] > shortest:
            return False
    dof = points.shape[1]
    second = np.zeros((n + 1, dof))
    diagonal = np.empty(n + 1)
    # First and last point with an unknown second derivative.
    first, last = (0, n) if clamped else (1, n - 1)
    for i in range(first, last + 1):
        before = knots[i] - knots[i - 1] if i > 0 else 0.0
        after = knots[i + 1] - knots[i] if i < n else 0.0
        factor = before / diagonal[i - 1] if i > first else 0.0
        diagonal[i] = 2 * (before + after) - factor * before
        for j in range(dof):
            # Beyond a clamped end the spline has zero slope.
            slope = (points[i, j] - points[i - 1, j]) / before if i > 0 else 0.0
            next_slope = (points[i + 1, j] - points[i, j]) / after if i < n else 0.0
            second[i, j] = 6 * (next_slope - slope) - factor * second[i - 1, j]
    for i in range(last, first - 1, -1):
        after = knots[i + 1] - knots[i] if i < last else 0.0
        for j in range(dof):
            second[i, j] = (second[i, j] - after * second[min(i + 1, n), j]) / diagonal[i]
    for i in range(n):
        width = knots[i + 1] - knots[i]
        for j in range(dof):
            slope = (points[i + 1, j] - points[i, j]) / width
            start = second[i, j]
            end = second[i + 1, j]
            coefficients[i, 0, j] = points[i, j]
            coefficients[i, 1, j] = (slope - width * (2 * start + end) / 6) * width
            coefficients[i, 2, j] = start / 2 * width**2
            coefficients[i, 3, j] = (end - start) / 6 * width**2
    return True


class JointDerivatives(NamedTuple):
    """Joint positions and their derivatives over time, (n, dof) each; (0, dof) if not requested."""

    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    dddq: FloatArray


@compiled()
def path_motions(
    i: IntArray,
    t: FloatArray,
    breaks: FloatArray,
    s: FloatArray,
    ds: FloatArray,
    dds: FloatArray,
    slope: FloatArray,
    jerk: FloatArray,
) -> FloatArray:
    """Return s and its first three derivatives at times `t` [s] of intervals `i`, (4, n).

    Args:
        i: Indices of intervals, (n,).
        t: Times [s], (n,).
        breaks: Breaks of the law [s], (m + 1,).
        s: Arc lengths at the breaks [m], (m + 1,).
        ds: Path speeds at the interval starts [m/s], (m,).
        dds: Path accelerations at the interval starts [m/s²], (m,).
        slope: Slopes of dds over s [1/s²], (m,).
        jerk: Slopes of dds over time [m/s³], (m,).
    """
    motions = np.empty((4, len(t)))
    for k in range(len(t)):
        j = i[k]
        u = t[k] - breaks[j]
        # At the time u in the interval, `dds = dds_j + slope (s - s_j)` is solved by
        # c = cosh(w u), h = sinh(w u) / w and p = (cosh(w u) - 1) / w² with `w² = slope`. If the
        # slope is negative, these are circular functions. h and p are first divided by u and u².
        z = slope[j] * u * u
        size = math.sqrt(abs(z))
        if size < SERIES_ANGLE:
            c = 1 + z / 2 * (1 + z / 12 * (1 + z / 30))
            h = 1 + z / 6 * (1 + z / 20 * (1 + z / 42))
            p = 0.5 * (1 + z / 12 * (1 + z / 30 * (1 + z / 56)))
        elif z > 0.0:
            c = math.cosh(size)
            h = math.sinh(size) / size
            p = 2 * (math.sinh(size / 2) / size) ** 2
        else:
            c = math.cos(size)
            h = math.sin(size) / size
            p = 2 * (math.sin(size / 2) / size) ** 2
        h = u * h
        p = u * u * p
        distance = s[j] + ds[j] * h + dds[j] * p + jerk[j] * u**3 / 6
        # Rounding errors must not move s past a break, at which derivatives may jump.
        motions[0, k] = min(max(distance, s[j]), s[j + 1])
        speed = ds[j] * c + dds[j] * h + jerk[j] * u**2 / 2
        motions[1, k] = speed
        motions[2, k] = ds[j] * slope[j] * h + dds[j] * c + jerk[j] * u
        motions[3, k] = slope[j] * speed + jerk[j]
    return motions


@compiled(inner=True, inline="always")
def value_and_slopes(
    a0: float, a1: float, a2: float, a3: float, a4: float, a5: float, x: float
) -> tuple[float, float, float]:
    """Return the polynomial `a0 + a1 x + ... + a5 x⁵` and its first two derivatives at x."""
    # Horner's rule computes all three together.
    slope = a5
    value = a5 * x + a4
    second = 0.0
    second = second * x + 2 * slope
    slope = slope * x + value
    value = value * x + a3
    second = second * x + 2 * slope
    slope = slope * x + value
    value = value * x + a2
    second = second * x + 2 * slope
    slope = slope * x + value
    value = value * x + a1
    second = second * x + 2 * slope
    slope = slope * x + value
    value = value * x + a0
    return value, slope, second


@compiled()
def joint_motions(
    along: FloatArray,  # s and its derivatives over time up to the third, (4, n)
    end: FloatArray,
    law: IntArray,  # Each point's law, as an index, (n,)
    rows: IntArray,
    breaks: FloatArray,  # Breaks of all joint paths [m], each counted from its own start, (m,)
    coefficients: FloatArray,
    out: JointDerivatives,  # Output; arrays without rows are not computed
) -> None:
    """Write joint positions and their time derivatives along joint paths, by the chain rule.

    The coefficients after the last break of a joint path are not read, and may be missing.

    - `end`: arc length at which the law's interval ends, for each point [m], (n,). If this is a
      break of the joint path, the point belongs to the piece before the break.
    - `rows`: index of the first break of each law's joint path, and the total number of breaks,
      (laws + 1,).
    - `coefficients`: coefficients after each break, (m, 6, dof).
    """
    orders = len(out.q) > 0, len(out.dq) > 0, len(out.ddq) > 0, len(out.dddq) > 0
    piece = 0
    for k in range(along.shape[1]):
        s = along[0, k]
        ds = along[1, k]
        dds = along[2, k]
        ddds = along[3, k]
        low = rows[law[k]]
        high = rows[law[k] + 1] - 2
        # Find the last piece that begins before s. It is usually the piece of the previous point.
        if low <= piece <= high and breaks[piece] <= s and breaks[piece] < end[k]:
            low = piece
        if s < breaks[low + 1] or end[k] <= breaks[low + 1]:
            high = low
        while low < high:
            middle = (low + high + 1) // 2
            if breaks[middle] <= s and breaks[middle] < end[k]:
                low = middle
            else:
                high = middle - 1
        piece = low
        width = breaks[piece + 1] - breaks[piece]
        x = (s - breaks[piece]) / width
        for j in range(coefficients.shape[2]):
            c0 = coefficients[piece, 0, j]
            c1 = coefficients[piece, 1, j]
            c2 = coefficients[piece, 2, j]
            c3 = coefficients[piece, 3, j]
            c4 = coefficients[piece, 4, j]
            c5 = coefficients[piece, 5, j]
            value, slope, second = value_and_slopes(c0, c1, c2, c3, c4, c5, x)
            slope = slope / width
            second = second / (width * width)
            if orders[0]:
                out.q[k, j] = value
            if orders[1]:
                out.dq[k, j] = slope * ds
            if orders[2]:
                out.ddq[k, j] = second * (ds * ds) + slope * dds
            if orders[3]:
                third = (((60 * c5) * x + 24 * c4) * x + 6 * c3) / (width * width * width)
                out.dddq[k, j] = third * (ds * ds * ds) + 3 * second * ds * dds + slope * ddds


@compiled()
def bound_joint_velocities(
    breaks: FloatArray, coefficients: FloatArray, s: FloatArray, speeds: FloatArray
) -> FloatArray:
    """Bound the joint velocities between neighbouring arc lengths `s` [rad/s], (n, dof).

    On each piece dq_ds is a polynomial of degree 4, which lies between its smallest and its largest
    Bernstein coefficient over an interval.

    - `breaks`, `coefficients`: as in `JointPath`.
    - `s`: increasing arc lengths at the interval ends [m], (n + 1,).
    - `speeds`: bound of the path speed in each interval [m/s], (n,).
    """
    c = coefficients
    last = len(breaks) - 2
    n = len(s) - 1
    dof = c.shape[2]
    bounds = np.empty((n, dof))
    piece = 0
    for i in range(n):
        for j in range(dof):
            bounds[i, j] = 0.0
        begin = s[i]
        end = s[i + 1]
        while piece < last and breaks[piece + 1] <= begin:
            piece += 1
        k = piece
        while True:
            # An interval with uniform speed can contain breaks of the joint path.
            until = end if k == last else min(end, breaks[k + 1])
            width = breaks[k + 1] - breaks[k]
            x = (begin - breaks[k]) / width
            h = (until - begin) / width
            for j in range(dof):
                # Coefficients of dq_ds on the piece, multiplied by its width.
                a0 = c[k, 1, j]
                a1 = 2 * c[k, 2, j]
                a2 = 3 * c[k, 3, j]
                a3 = 4 * c[k, 4, j]
                a4 = 5 * c[k, 5, j]
                # Coefficients about the start of the interval, by repeated division by z - x.
                a3 += x * a4
                a2 += x * a3
                a1 += x * a2
                a0 += x * a1
                a3 += x * a4
                a2 += x * a3
                a1 += x * a2
                a3 += x * a4
                a2 += x * a3
                a3 += x * a4
                # Coefficients for a parameter from 0 to 1 over the interval.
                a1 = h * a1
                a2 = h * h * a2
                a3 = h * h * h * a3
                a4 = h * h * h * h * a4
                # Bernstein coefficients.
                largest = max(abs(a0), abs(a0 + a1 / 4), abs(a0 + a1 / 2 + a2 / 6))
                largest = max(largest, abs(a0 + 3 * a1 / 4 + a2 / 2 + a3 / 4))
                largest = max(largest, abs(a0 + a1 + a2 + a3 + a4))
                bounds[i, j] = max(bounds[i, j], largest / width)
            if until >= end:
                break
            k = k + 1
            begin = until
        for j in range(dof):
            bounds[i, j] *= speeds[i]
    return bounds
