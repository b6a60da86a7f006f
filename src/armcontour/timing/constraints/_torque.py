"""The compiled rows of joint torque limits with viscous friction, and their bounds of dds.

The rows of the planner are linear in x, but viscous friction is `viscous q' sqrt(x)`. On every
interval, one line bounds the root from above and one from below, `offset + slope x`, while x is
within a bracket.
"""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled

# Keeps divisions finite where a bracket is empty; its square root is far below any path speed.
TINY = 1e-300
# The line above viscous friction may take this share of the torque that is left at rest. So every
# row allows rest, on which the compiled planner relies.
SHARE_AT_REST = 0.5


@compiled()
def at_rest(c: FloatArray, limit: FloatArray) -> tuple[FloatArray, FloatArray, bool]:
    """What gravity leaves of the lower and upper limits, (2, n, dof), and whether it keeps them.

    Args:
        c: Torques of gravity at the starts and ends of all intervals, (2, n, dof).
        limit: Largest torques, (dof,).
    """
    low, high, kept = np.empty_like(c), np.empty_like(c), True
    for end in range(2):
        for i in range(c.shape[1]):
            for j in range(c.shape[2]):
                low[end, i, j], high[end, i, j] = -limit[j] - c[end, i, j], limit[j] - c[end, i, j]
                kept &= abs(c[end, i, j]) <= limit[j]
    return low, high, kept


@compiled()
def largest_u(
    a: FloatArray,
    b: FloatArray,
    c: FloatArray,
    drag: FloatArray,
    limit: FloatArray,
    dry: FloatArray,
    x: FloatArray,
) -> FloatArray:
    """Largest |u| that limits of torque allow at both ends of each interval, (n,).

    Args:
        a: Coefficients of u at the starts and ends, (2, n, dof).
        b: Coefficients of x there, (2, n, dof).
        c: Torques of gravity there, (2, n, dof).
        drag: Viscous friction at ds = 1 there, (2, n, dof), or without intervals for none.
        limit: Largest torques, (dof,).
        dry: Coulomb friction, (dof,).
        x: Largest x on each interval, (n,).
    """
    n, dof = a.shape[1], a.shape[2]
    viscous = drag.shape[1] == n
    found = np.empty(n)
    for i in range(n):
        least, root = math.inf, math.sqrt(x[i])
        for end in range(2):
            for j in range(dof):
                room = limit[j] + abs(c[end, i, j]) + abs(b[end, i, j]) * x[i] + dry[j]
                if viscous:
                    room += abs(drag[end, i, j]) * root
                size = abs(a[end, i, j])
                if size * least > room:
                    least = room / size
        found[i] = least
    return found


@compiled(inner=True)
def _tangent(least: float, most: float, cap: float) -> tuple[float, float]:
    """Offset and slope of a line above the root of x from `least` on, near the root up to `most`.

    The line is the tangent that is as far above the root at `least` as at `most`. If its offset
    exceeds `cap`, the line is the tangent of offset `cap`, at a smaller x. If that x is below
    `least`, the line is the steeper one of offset `cap` that meets the root at `least`.
    """
    low, high = math.sqrt(least), math.sqrt(max(most, TINY))
    offset = min((low + high) / 4, cap)
    return offset, 1 / (4 * offset) if offset >= low / 2 else (low - offset) / least


@compiled(inner=True)
def _chord(least: float, most: float) -> tuple[float, float]:
    """Offset and slope of a line below the root of x for x from `least` to `most`."""
    low, high = math.sqrt(least), math.sqrt(max(most, TINY))
    return low * high / (low + high), 1 / (low + high)


@compiled()
def dragged_rows(
    b: FloatArray,
    low: FloatArray,
    high: FloatArray,
    drag: FloatArray,
    largest: FloatArray,
    departs: FloatArray,
    sign: FloatArray,
    least: FloatArray,
    most: FloatArray,
    turning: bool,
) -> tuple[FloatArray, FloatArray, FloatArray, FloatArray, FloatArray]:
    """Rows with lines for viscous friction, first those of all upper, then of all lower limits.

    Args:
        b: Coefficients of x at the starts and ends without viscous friction, (2, n, dof).
        low: Lower limits there, (2, n, dof).
        high: Upper limits there, (2, n, dof).
        drag: Viscous friction at ds = 1 there, (2, n, dof).
        largest: Bound of the viscous friction at ds = 1 on each interval, without sign, (n, dof).
        departs: Bound of its distance from its chord, (n, dof).
        sign: Direction of the joint, 1 or -1, or 0 where it may turn round, (n, dof).
        least: Smallest x of the bracket of each interval, (n,).
        most: Largest x, (n,).
        turning: Whether the rows count friction where a joint may turn round. The first pass leaves
            it out, so that rest is allowed where gravity takes all the torque.

    Returns:
        Coefficients of x, lower and upper limits, (2, n, 2 dof) each; what the lines add to the
        rises of coefficients of x and of constants, (n, 2 dof) each.
    """
    n, dof = largest.shape
    shape = (2, n, 2 * dof)
    coefficients, floor, ceiling = np.empty(shape), np.empty(shape), np.empty(shape)
    along, aside = np.empty((n, 2 * dof)), np.empty((n, 2 * dof))
    for i in range(n):
        below, fastest = _chord(least[i], most[i]), math.sqrt(most[i])
        for side in range(2):
            towards = 1.0 - 2.0 * side
            for j in range(dof):
                k = side * dof + j
                if side == 0:
                    room = min(high[0, i, j], high[1, i, j])
                else:
                    room = min(-low[0, i, j], -low[1, i, j])
                cap = math.inf
                if room > 0 and largest[i, j] > 0:
                    cap = max(SHARE_AT_REST * room / largest[i, j], TINY)
                offset, slope = below
                if sign[i, j] == towards:
                    offset, slope = _tangent(least[i], most[i], cap)
                along[i, k], aside[i, k] = departs[i, j] * slope, departs[i, j] * offset
                for end in range(2):
                    value, extra = drag[end, i, j] * offset, drag[end, i, j] * slope
                    if sign[i, j] == 0:
                        # At most that at the largest speed.
                        value, extra = towards * largest[i, j] * fastest if turning else 0.0, 0.0
                    coefficients[end, i, k] = b[end, i, j] + extra
                    floor[end, i, k] = low[end, i, j] - value if side == 1 else -math.inf
                    ceiling[end, i, k] = high[end, i, j] - value if side == 0 else math.inf
    return coefficients, floor, ceiling, along, aside
