"""The compiled part of joint constraints: values at interval ends, and margins between them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Relative rounding error of x in differences of x.
ROUNDING = 2e-15


@compiled(inner=True, inline="always")
def write_derivatives(
    coefficients: FloatArray,
    breaks: FloatArray,
    k: int,
    s0: float,
    s1: float,
    before: int,
    row: int,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    fourth: FloatArray,
) -> None:
    """Write what `derivatives` gives for one interval, from s0 to s1 in piece k, into one row.

    Args:
        coefficients: Of the joint path, (pieces, 6, dof).
        breaks: Of the joint path, (pieces + 1,).
        k: The piece.
        s0: Start of the interval.
        s1: End of the interval.
        before: The row of the interval before, if it lies in the same piece; otherwise -1.
        row: The row to write.
        first: As in `derivatives`, as the next three.
        second: See above.
        third: See above.
        fourth: See above.
    """
    scale = 1.0 / (breaks[k + 1] - breaks[k])
    square = scale * scale
    cube, power = square * scale, square * square
    x0, x1 = (s0 - breaks[k]) * scale, (s1 - breaks[k]) * scale
    middle, half = 0.5 * (x0 + x1), 0.5 * (x1 - x0)
    for j in range(coefficients.shape[2]):
        a1, a2, a3 = coefficients[k, 1, j], coefficients[k, 2, j], coefficients[k, 3, j]
        a4, a5 = coefficients[k, 4, j], coefficients[k, 5, j]
        if before >= 0:
            first[0, row, j], second[0, row, j] = first[1, before, j], second[1, before, j]
        else:
            slope = a1 + x0 * (2 * a2 + x0 * (3 * a3 + x0 * (4 * a4 + x0 * 5 * a5)))
            bend = 2 * a2 + x0 * (6 * a3 + x0 * (12 * a4 + x0 * 20 * a5))
            first[0, row, j], second[0, row, j] = scale * slope, square * bend
        slope = a1 + x1 * (2 * a2 + x1 * (3 * a3 + x1 * (4 * a4 + x1 * 5 * a5)))
        bend = 2 * a2 + x1 * (6 * a3 + x1 * (12 * a4 + x1 * 20 * a5))
        first[1, row, j], second[1, row, j] = scale * slope, square * bend
        # Taylor about the middle: the fifth derivative is constant.
        f3 = abs(6 * a3 + middle * (24 * a4 + middle * 60 * a5))
        f4 = abs(24 * a4 + middle * 120 * a5)
        f5 = abs(120 * a5)
        third[row, j] = (f3 + half * (f4 + half * 0.5 * f5)) * cube
        fourth[row, j] = (f4 + half * f5) * power


@compiled()
def derivatives(
    coefficients: FloatArray,
    breaks: FloatArray,
    piece: IntArray,
    s: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    fourth: FloatArray,
) -> None:
    """dq_ds and d2q_ds2 at both ends of every interval, and bounds of the next two inside.

    Args:
        coefficients: Of the joint path, (pieces, 6, dof).
        breaks: Of the joint path, (pieces + 1,).
        piece: Piece of each interval, (n,).
        s: Interval ends, (n + 1,).
        first: Takes dq_ds, (2, n, dof).
        second: Takes d2q_ds2, (2, n, dof).
        third: Takes the bounds of |d3q_ds3|, (n, dof).
        fourth: Takes the bounds of |d4q_ds4|, (n, dof).
    """
    for i in range(len(piece)):
        k = piece[i]
        before = i - 1 if i > 0 and piece[i - 1] == k else -1
        ends = s[i], s[i + 1]
        write_derivatives(
            coefficients, breaks, k, ends[0], ends[1], before, i, first, second, third, fourth
        )


@compiled(inner=True, inline="always")
def write_bulge(
    width: float,
    x: float,
    u: float,
    skew: float,
    row: int,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    fourth: FloatArray,
    bulge: FloatArray,
) -> None:
    """Write what `acceleration_bulge` gives for one interval, whose derivatives are in `row`."""
    share, rounding = width * width / 8.0, ROUNDING * x / width
    for j in range(third.shape[1]):
        bend = max(abs(second[0, row, j]), abs(second[1, row, j])) + width * third[row, j]
        slope = max(abs(first[0, row, j]), abs(first[1, row, j]))
        rise = 5.0 * third[row, j] * u + fourth[row, j] * x + 4.0 * bend * abs(skew)
        bulge[row, j] = share * rise + rounding * slope


@compiled()
def acceleration_bulge(
    width: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    fourth: FloatArray,
    x: FloatArray,
    u: FloatArray,
    skew: FloatArray,
    bulge: FloatArray,
) -> None:
    """Write the largest rise of joint accelerations above their chords into `bulge`, (n, dof).

    The rounding error of u, which is a difference of x over the width, is added.

    With u linear in s, its second derivative is `5 q''' u + q'''' x + 4 q'' skew`; a function rises
    above its chord by at most width² / 8 times the largest amount of that.
    """
    for i in range(len(width)):
        write_bulge(width[i], x[i], u[i], skew[i], i, first, second, third, fourth, bulge)


@compiled(inner=True, inline="always")
def largest_u(
    x: float, row: int, first: FloatArray, second: FloatArray, low: FloatArray, high: FloatArray
) -> float:
    """What `path_acceleration_bound` gives for one interval, whose derivatives are in `row`."""
    least = math.inf
    for end in range(2):
        for j in range(first.shape[2]):
            room = max(high[j], -low[j]) + abs(second[end, row, j]) * x
            size = abs(first[end, row, j])
            if size * least > room:
                least = room / size
    return least


@compiled()
def path_acceleration_bound(
    first: FloatArray, second: FloatArray, low: FloatArray, high: FloatArray, x: FloatArray
) -> FloatArray:
    """Largest |u| that joint accelerations allow at either end of each interval, (n,).

    The lower one of both ends: where dq_ds vanishes at one of them, u is bounded by the other.
    """
    bound = np.empty(len(x))
    for i in range(len(x)):
        bound[i] = largest_u(x[i], i, first, second, low, high)
    return bound


@compiled(inner=True)
def _over_square(room: float, slope: float) -> Any:
    """`room / slope²`, zero without room, infinite without slope."""
    if room <= 0.0:
        return 0.0
    return room / (slope * slope) if slope != 0.0 else math.inf


@compiled()
def velocity_ceiling_at_ends(first: FloatArray, limit: FloatArray) -> FloatArray:
    """Largest x at both ends of each interval under joint velocity limits there, (2, n)."""
    n, dof = first.shape[1], first.shape[2]
    ceiling = np.empty((2, n))
    for end in range(2):
        for i in range(n):
            # The largest share of its limit that any joint takes at ds = 1.
            worst = 0.0
            for j in range(dof):
                worst = max(worst, abs(first[end, i, j]) / limit[j])
            ceiling[end, i] = 1.0 / (worst * worst) if worst > 0.0 else math.inf
    return ceiling


@compiled(inner=True, inline="always")
def lower_by_velocity(
    width: float,
    x: float,
    u: float,
    skew: float,
    row: int,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    limit: FloatArray,
) -> tuple[float, float, float]:
    """What `velocity_ceiling` gives for one interval, whose derivatives are in `row`.

    Returns:
        The ceilings at the start and at the end, and the share of them that margins have taken.
    """
    share = width * width / 8
    plain_start = plain_end = low_start = low_end = math.inf
    for j in range(first.shape[2]):
        if limit[j] == np.inf:
            continue
        v2 = limit[j] * limit[j]
        start, end, curve = abs(first[0, row, j]), abs(first[1, row, j]), third[row, j]
        slope = max(start, end) + share * curve
        bend = max(abs(second[0, row, j]), abs(second[1, row, j])) + width * curve
        rate = 8 * u * slope * bend + 2 * x * (bend * bend + slope * curve)
        bulge = share * (rate + 2 * abs(skew) * slope * slope)
        # A joint that lowers nothing by either of the rules below needs no divisions.
        if v2 - bulge >= max(low_start, low_end, plain_start, plain_end) * slope * slope:
            continue
        # Take either both ends with the bulge, or both ends slow enough for the largest dq_ds of
        # the interval. A mix of the two rules would prove nothing.
        at_start = _over_square(v2 - bulge, start)
        at_end = _over_square(v2 - bulge, end)
        tight = _over_square(v2, slope)
        if at_start + at_end < 2 * tight:
            at_start = at_end = tight
        low_start, low_end = min(low_start, at_start), min(low_end, at_end)
        plain_start = min(plain_start, _over_square(v2, start))
        plain_end = min(plain_end, _over_square(v2, end))
    lost = 0.0
    if low_start < plain_start:
        lost = 1.0 - low_start / plain_start
    if low_end < plain_end:
        lost = max(lost, 1.0 - low_end / plain_end)
    return low_start, low_end, lost


@compiled()
def velocity_ceiling(
    width: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    limit: FloatArray,
    x: FloatArray,
    u: FloatArray,
    skew: FloatArray,
) -> tuple[FloatArray, FloatArray]:
    """Largest x at both ends of each interval for joint velocity limits to hold all along it.

    Between the ends `h = x q'²` can rise above its chord by width² / 8 times the largest
    `|h''| <= 8 |u q' q''| + 2 x (q''² + |q' q'''|) + 2 |skew| q'²`, bounded with the largest values
    on the interval.

    Returns:
        The ceiling, (2, n), and the share of it that margins have taken, (n,).
    """
    n = len(width)
    ceiling, lost = np.empty((2, n)), np.empty(n)
    for i in range(n):
        ceiling[0, i], ceiling[1, i], lost[i] = lower_by_velocity(
            width[i], x[i], u[i], skew[i], i, first, second, third, limit
        )
    return ceiling, lost
