"""The compiled part of bounding: Taylor's polynomials over time, and what they leave out."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._kernels import compiled
from armcontour.motion._averaging import advance
from armcontour.motion.laws import Rates

# m! / (m - n)!, the factor of x^(m - n) in the n-th derivative of x^m.
FALLING = np.array([[math.perm(m, n) for m in range(6)] for n in range(6)], dtype=np.float64)


@compiled()
def path_rates(
    t: FloatArray,
    half: FloatArray,
    breaks: FloatArray,
    rates: Rates,
    windows: tuple[float, float],
) -> FloatArray:
    """The third and the fourth derivative of an averaged law, and a bound of the fifth one.

    Without windows these are the law's own. A window turns the n-th derivative into the difference
    of the (n - 1)-th at the window's ends, divided by the window's length.

    Args:
        t: Times [s], (n,).
        half: The bound holds so long before and after each of the times [s], (n,).
        breaks: Of the law that is averaged [s], (m + 1,).
        rates: Of its intervals.
        windows: The longer one, and the shorter one or 0; both 0 if nothing is averaged [s].

    Returns:
        (n, 3).
    """
    found = np.zeros((len(t), 3))
    first, second = windows
    count = 1 if first == 0.0 else (2 if second == 0.0 else 4)
    area = 1.0 if first == 0.0 else (first if second == 0.0 else first * second)
    lags = np.array([0.0, first if second == 0.0 else second, first, first + second])
    signs = np.array([1.0, -1.0, -1.0, 1.0])
    # d[1:6] are the law's own derivatives.
    d = np.zeros(6)
    last = len(breaks) - 1
    order = 3 if count == 1 else (2 if count == 2 else 1)
    for k in range(len(t)):
        for edge in range(count):
            at = t[k] - lags[edge]
            if at <= breaks[0] or at >= breaks[last]:
                continue
            i = int(np.searchsorted(breaks, at, side="right")) - 1
            slope, jerk = rates.slope[i], rates.jerk[i]
            d[2], d[1] = advance(rates, i, at - breaks[i])[:2]
            d[3], d[4] = slope * d[1] + jerk, slope * d[2]
            found[k, 0] += signs[edge] * d[order] / area
            found[k, 1] += signs[edge] * d[order + 1] / area
            # ds and dds are sums of cosh and sinh, or of cos and sin, which are less.
            root = math.sqrt(abs(slope))
            c, h = math.cosh(root * half[k]), math.sinh(root * half[k])
            speed = abs(d[1]) * c + (abs(d[2]) * h / root if root > 0.0 else abs(d[2]) * half[k])
            if order == 3:
                found[k, 2] += slope * slope * speed / area
            elif order == 2:
                found[k, 2] += abs(slope) * (abs(d[2]) * c + abs(d[1]) * root * h) / area
            else:
                found[k, 2] += (abs(slope) * speed + abs(jerk)) / area
    return found


@compiled(inner=True)
def _grow(values: FloatArray, reach: float) -> None:
    """Turn a function's derivatives at a place, from the first on, into bounds within `reach`."""
    last = len(values) - 1
    for k in range(1, last + 1):
        total, factor = 0.0, 1.0
        for n in range(k, last + 1):
            total += abs(values[n]) * factor
            factor *= reach / (n - k + 1)
        values[k] = total


@compiled(inner=True)
def _highest(f0: float, f1: float, f2: float, half: float) -> float:
    """The largest value of f0 + f1 u + f2 u² / 2 for u from -half to half."""
    found = f0 + abs(f1) * half + 0.5 * f2 * half * half
    if f2 < 0.0 and abs(f1) < -f2 * half:
        found = f0 - 0.5 * f1 * f1 / f2
    return found


@compiled(inner=True)
def _fifth(q: FloatArray, v: FloatArray) -> float:
    """The fifth derivative of q(s(t)), from those of q over s and of s over time."""
    return float(
        q[5] * v[1] ** 5
        + 10.0 * q[4] * v[1] ** 3 * v[2]
        + q[3] * (10.0 * v[1] ** 2 * v[3] + 15.0 * v[1] * v[2] ** 2)
        + q[2] * (10.0 * v[2] * v[3] + 5.0 * v[1] * v[4])
        + q[1] * v[5]
    )


@compiled(inner=True)
def _fourth(q: FloatArray, v: FloatArray) -> float:
    """The fourth derivative of q(s(t))."""
    return float(
        q[4] * v[1] ** 4
        + 6.0 * q[3] * v[1] ** 2 * v[2]
        + q[2] * (3.0 * v[2] ** 2 + 4.0 * v[1] * v[3])
        + q[1] * v[4]
    )


@compiled()
def bound_motion(
    half: FloatArray,
    along: FloatArray,
    piece: IntArray,
    breaks: FloatArray,
    coefficients: FloatArray,
    limits: FloatArray,
    speeds: FloatArray,
) -> FloatArray:
    """Shares of limits in the middle of intervals of time, and bounds of them on the intervals.

    A joint's velocity and acceleration, and the path speed, are quadratics about the middle, plus
    the most that their third derivative can add.

    Args:
        half: Half the lengths of the intervals [s], (n,).
        along: s and its four derivatives in the middle, and a bound of the fifth, (n, 6).
        piece: The interval of the joint path, (n,).
        breaks: Of the joint path [m].
        coefficients: Of the joint path, (m, 6, dof).
        limits: Highest acceleration, deceleration and velocity of every joint, (3, dof).
        speeds: Highest path speeds, on every interval of the joint path, (m, 2).

    Returns:
        Of all joints the largest share of acceleration, deceleration and velocity in the middle,
        the shares of both path speeds there, then the bounds of the five, (n, 10).
    """
    found = np.zeros((len(half), 10))
    q, most = np.empty(6), np.empty(6)
    for k in range(len(half)):
        p, r, v = piece[k], half[k], along[k]
        width = breaks[p + 1] - breaks[p]
        x = (v[0] - breaks[p]) / width
        fastest = v.copy()
        _grow(fastest, r)
        for j in range(2):
            found[k, 3 + j] = v[1] / speeds[p, j]
            peak = _highest(v[1], v[2], v[3], r) + fastest[4] * r**3 / 6.0
            found[k, 8 + j] = peak / speeds[p, j]
        for j in range(coefficients.shape[2]):
            for n in range(6):
                total = 0.0
                for m in range(5, n - 1, -1):
                    total = total * x + FALLING[n, m] * coefficients[p, m, j]
                q[n] = total / width**n
                most[n] = q[n]
            _grow(most, r * fastest[1])
            speed = q[1] * v[1]
            f0 = q[2] * v[1] ** 2 + q[1] * v[2]
            f1 = q[3] * v[1] ** 3 + 3.0 * q[2] * v[1] * v[2] + q[1] * v[3]
            f2 = _fourth(q, v)
            more = _fifth(most, fastest) * r**3 / 6.0
            rest = _fourth(most, fastest) * r**3 / 6.0
            up, down, pace = limits[0, j], limits[1, j], limits[2, j]
            found[k, 0] = max(found[k, 0], f0 / up)
            found[k, 1] = max(found[k, 1], -f0 / down)
            found[k, 2] = max(found[k, 2], abs(speed) / pace)
            found[k, 5] = max(found[k, 5], (_highest(f0, f1, f2, r) + more) / up)
            found[k, 6] = max(found[k, 6], (_highest(-f0, -f1, -f2, r) + more) / down)
            peak = max(_highest(speed, f0, f1, r), _highest(-speed, -f0, -f1, r))
            found[k, 7] = max(found[k, 7], (peak + rest) / pace)
    return found
