"""The compiled part of joint constraints: values at interval ends, and how far they can bulge."""

from __future__ import annotations

import math
from typing import Any

import numpy as np
from numba import njit

from armcontour._checks import FloatArray, IntArray


@njit(cache=True, error_model="numpy")
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
    n = len(piece)
    dof = coefficients.shape[2]
    for i in range(n):
        k = piece[i]
        scale = 1.0 / (breaks[k + 1] - breaks[k])
        x0 = (s[i] - breaks[k]) * scale
        x1 = (s[i + 1] - breaks[k]) * scale
        middle = 0.5 * (x0 + x1)
        half = 0.5 * (x1 - x0)
        for j in range(dof):
            a1, a2, a3 = coefficients[k, 1, j], coefficients[k, 2, j], coefficients[k, 3, j]
            a4, a5 = coefficients[k, 4, j], coefficients[k, 5, j]
            for end in range(2):
                x = x0 if end == 0 else x1
                first[end, i, j] = scale * (
                    a1 + x * (2 * a2 + x * (3 * a3 + x * (4 * a4 + x * 5 * a5)))
                )
                second[end, i, j] = (
                    scale * scale * (2 * a2 + x * (6 * a3 + x * (12 * a4 + x * 20 * a5)))
                )
            # Taylor about the middle: the fifth derivative is constant.
            f3 = abs(6 * a3 + middle * (24 * a4 + middle * 60 * a5))
            f4 = abs(24 * a4 + middle * 120 * a5)
            f5 = abs(120 * a5)
            third[i, j] = (f3 + half * (f4 + half * 0.5 * f5)) * scale**3
            fourth[i, j] = (f4 + half * f5) * scale**4


@njit(cache=True, error_model="numpy")
def acceleration_bulge(
    width: FloatArray,
    second: FloatArray,
    third: FloatArray,
    fourth: FloatArray,
    x: FloatArray,
    u: FloatArray,
    skew: FloatArray,
    bulge: FloatArray,
) -> None:
    """Write how far joint accelerations can rise above their chords into `bulge`, (n, dof).

    With u linear in s, its second derivative is `5 q''' u + q'''' x + 4 q'' skew`; a function rises
    above its chord by at most width² / 8 times the largest amount of that.
    """
    n, dof = third.shape
    for i in range(n):
        share = width[i] * width[i] / 8.0
        for j in range(dof):
            bend = max(abs(second[0, i, j]), abs(second[1, i, j])) + width[i] * third[i, j]
            bulge[i, j] = share * (
                5.0 * third[i, j] * u[i] + fourth[i, j] * x[i] + 4.0 * bend * abs(skew[i])
            )


@njit(cache=True, error_model="numpy")
def path_acceleration_bound(
    first: FloatArray, second: FloatArray, low: FloatArray, high: FloatArray, x: FloatArray
) -> FloatArray:
    """Largest |u| that joint accelerations allow at the start of each interval, (n,)."""
    n, dof = first.shape[1], first.shape[2]
    bound = np.empty(n)
    for i in range(n):
        least = math.inf
        for j in range(dof):
            room = max(high[j], -low[j]) + abs(second[0, i, j]) * x[i]
            size = abs(first[0, i, j])
            if size * least > room:
                least = room / size
        bound[i] = least
    return bound


@njit(cache=True, error_model="numpy")
def _over_square(room: float, slope: float) -> Any:
    """`room / slope²`, zero without room, infinite without slope."""
    if room <= 0.0:
        return 0.0
    return room / (slope * slope) if slope != 0.0 else math.inf


@njit(cache=True, error_model="numpy")
def velocity_ceiling(
    width: FloatArray,
    first: FloatArray,
    second: FloatArray,
    third: FloatArray,
    limit: FloatArray,
    x: FloatArray,
    u: FloatArray,
    skew: FloatArray,
    narrow: bool,
) -> FloatArray:
    """Largest x at both ends of each interval under joint velocity limits, (2, n).

    Between the ends `h = x q'²` can rise above its chord by width² / 8 times the largest
    `|h''| <= 8 |u q' q''| + 2 x (q''² + |q' q'''|) + 2 |skew| q'²`, bounded with the largest values
    on the interval.
    """
    n, dof = first.shape[1], first.shape[2]
    ceiling = np.full((2, n), np.inf)
    for i in range(n):
        d = width[i]
        for j in range(dof):
            if limit[j] == np.inf:
                continue
            v2 = limit[j] * limit[j]
            bulge = 0.0
            slope = max(abs(first[0, i, j]), abs(first[1, i, j])) + d * d / 8 * third[i, j]
            if narrow:
                bend = max(abs(second[0, i, j]), abs(second[1, i, j])) + d * third[i, j]
                rate = 8 * u[i] * slope * bend + 2 * x[i] * (bend * bend + slope * third[i, j])
                bulge = d * d / 8 * (rate + 2 * abs(skew[i]) * slope * slope)
            # Both ends by the first rule, or both slow enough for the steepest place of the
            # interval: one end by the one and the other by the other would prove nothing.
            at_start = _over_square(v2 - bulge, first[0, i, j])
            at_end = _over_square(v2 - bulge, first[1, i, j])
            if narrow:
                tight = _over_square(v2, slope)
                if at_start + at_end < 2 * tight:
                    at_start = at_end = tight
            ceiling[0, i] = min(ceiling[0, i], at_start)
            ceiling[1, i] = min(ceiling[1, i], at_end)
    return ceiling


@njit(cache=True, error_model="numpy")
def margin_lost(
    low: FloatArray,
    high: FloatArray,
    narrow_low: FloatArray,
    narrow_high: FloatArray,
    ceiling: FloatArray,
    narrow_ceiling: FloatArray,
    a: FloatArray,
    change: FloatArray,
) -> FloatArray:
    """Largest share of any limit that margins take on each interval, (n,).

    It is 1 where the change of u over half an interval alone would break a bound at rest, so that
    the stage of the interval would have no state that is safe for certain.
    """
    n = low.shape[1]
    lost = np.zeros(n)
    for end in range(2):
        for i in range(n):
            worst = lost[i]
            for k in range(low.shape[2]):
                up, down = high[end, i, k], -low[end, i, k]
                left = min(narrow_high[end, i, k], -narrow_low[end, i, k])
                worst = max(worst, (up - narrow_high[end, i, k]) / up)
                worst = max(worst, (down + narrow_low[end, i, k]) / down)
                if abs(a[end, i, k] * change[i]) > left:
                    worst = max(worst, 1.0)
            if narrow_ceiling[end, i] < ceiling[end, i]:
                worst = max(worst, 1.0 - narrow_ceiling[end, i] / ceiling[end, i])
            lost[i] = worst
    return lost
