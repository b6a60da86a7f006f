"""The compiled part of joint constraints: values at interval ends, and margins between them."""

from __future__ import annotations

import math
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled

# Relative rounding error of x in differences of x.
ROUNDING = 2e-15


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
    n, dof = third.shape
    for i in range(n):
        share = width[i] * width[i] / 8.0
        for j in range(dof):
            bend = max(abs(second[0, i, j]), abs(second[1, i, j])) + width[i] * third[i, j]
            bulge[i, j] = share * (
                5.0 * third[i, j] * u[i] + fourth[i, j] * x[i] + 4.0 * bend * abs(skew[i])
            )
            slope = max(abs(first[0, i, j]), abs(first[1, i, j]))
            bulge[i, j] += ROUNDING * x[i] / width[i] * slope


@compiled()
def path_acceleration_bound(
    first: FloatArray, second: FloatArray, low: FloatArray, high: FloatArray, x: FloatArray
) -> FloatArray:
    """Largest |u| that joint accelerations allow at either end of each interval, (n,).

    The lower one of both ends: where dq_ds vanishes at one of them, u is bounded by the other.
    """
    n, dof = first.shape[1], first.shape[2]
    bound = np.empty(n)
    for i in range(n):
        least = math.inf
        for end in range(2):
            for j in range(dof):
                room = max(high[j], -low[j]) + abs(second[end, i, j]) * x[i]
                size = abs(first[end, i, j])
                if size * least > room:
                    least = room / size
        bound[i] = least
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
    n, dof = first.shape[1], first.shape[2]
    ceiling = np.full((2, n), np.inf)
    lost = np.zeros(n)
    for i in range(n):
        share = width[i] * width[i] / 8
        plain_start = math.inf
        plain_end = math.inf
        for j in range(dof):
            if limit[j] == np.inf:
                continue
            v2 = limit[j] * limit[j]
            start, end = abs(first[0, i, j]), abs(first[1, i, j])
            slope = max(start, end) + share * third[i, j]
            bend = max(abs(second[0, i, j]), abs(second[1, i, j])) + width[i] * third[i, j]
            rate = 8 * u[i] * slope * bend + 2 * x[i] * (bend * bend + slope * third[i, j])
            bulge = share * (rate + 2 * abs(skew[i]) * slope * slope)
            # Take either both ends with the bulge, or both ends slow enough for the largest dq_ds
            # of the interval. A mix of the two rules would prove nothing.
            at_start = _over_square(v2 - bulge, start)
            at_end = _over_square(v2 - bulge, end)
            tight = _over_square(v2, slope)
            if at_start + at_end < 2 * tight:
                at_start = at_end = tight
            ceiling[0, i] = min(ceiling[0, i], at_start)
            ceiling[1, i] = min(ceiling[1, i], at_end)
            plain_start = min(plain_start, _over_square(v2, start))
            plain_end = min(plain_end, _over_square(v2, end))
        if ceiling[0, i] < plain_start:
            lost[i] = 1.0 - ceiling[0, i] / plain_start
        if ceiling[1, i] < plain_end:
            lost[i] = max(lost[i], 1.0 - ceiling[1, i] / plain_end)
    return ceiling, lost


@compiled()
def margin_lost(
    low: FloatArray, high: FloatArray, margin: FloatArray, a: FloatArray, change: FloatArray
) -> FloatArray:
    """Largest share of any bound that margins take on each interval, (n,).

    The share is 1 where the change of u over half an interval alone would break a bound at rest,
    so that no state of the interval is certainly allowed.
    """
    n = low.shape[1]
    lost = np.zeros(n)
    for end in range(2):
        for i in range(n):
            worst = lost[i]
            turn = abs(change[i])
            for k in range(low.shape[2]):
                least = min(high[end, i, k], -low[end, i, k])
                if margin[i, k] > worst * least:
                    worst = margin[i, k] / least
                if abs(a[end, i, k]) * turn > least - margin[i, k]:
                    worst = max(worst, 1.0)
            lost[i] = worst
    return lost
