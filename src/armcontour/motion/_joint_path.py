"""Compiled functions of joint paths: their check, and the cubic spline through positions."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.core.kernels import compiled


@compiled()
def examine(
    breaks: FloatArray,
    coefficients: FloatArray,
    kink: float,
    no_direction: float,
    kinks: BoolArray,
) -> tuple[bool, float]:
    """Check the pieces of a joint path, and mark the breaks at which dq_ds jumps.

    Args:
        breaks: Arc lengths of the ends of the pieces, (n + 1,).
        coefficients: Coefficients of the quintics, (n, 6, dof).
        kink: Jumps of dq_ds above this share of dq_ds count.
        no_direction: A dq_ds below this share of the sum of its terms is rounding.
        kinks: Output: whether dq_ds jumps at each inner break, (n - 1,).

    Returns:
        Whether all numbers are finite and the breaks increase, and the largest jump of a joint
        position at a break [rad].
    """
    n, dof = coefficients.shape[0], coefficients.shape[2]
    sound, largest, terms_before = True, 0.0, 0.0
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
def spline_pieces(at: FloatArray, points: FloatArray, clamped: bool) -> FloatArray:
    """Coefficients of the cubic spline through points as those of a `JointPath`, (n, 6, dof).

    Second derivatives solve a tridiagonal system; its diagonal outweighs the rest of every row, so
    it is solved from one end to the other and back.

    Args:
        at: Parameters of the points, which increase, (n + 1,).
        points: The points, (n + 1, dof).
        clamped: Whether the slopes are zero at both ends, where otherwise the second derivatives
            are.
    """
    n, dof = len(at) - 1, points.shape[1]
    found, bend, own = np.zeros((n, 6, dof)), np.zeros((n + 1, dof)), np.empty(n + 1)
    # The second derivatives at these points are not known to be zero.
    first, last = (0, n) if clamped else (1, n - 1)
    for i in range(first, last + 1):
        before = at[i] - at[i - 1] if i > 0 else 0.0
        after = at[i + 1] - at[i] if i < n else 0.0
        share = before / own[i - 1] if i > first else 0.0
        own[i] = 2 * (before + after) - share * before
        for j in range(dof):
            # Beyond a clamped end the spline goes on without slope.
            slope = (points[i, j] - points[i - 1, j]) / before if i > 0 else 0.0
            next_ = (points[i + 1, j] - points[i, j]) / after if i < n else 0.0
            bend[i, j] = 6 * (next_ - slope) - share * bend[i - 1, j]
    for i in range(last, first - 1, -1):
        after = at[i + 1] - at[i] if i < last else 0.0
        for j in range(dof):
            bend[i, j] = (bend[i, j] - after * bend[min(i + 1, n), j]) / own[i]
    for i in range(n):
        width = at[i + 1] - at[i]
        for j in range(dof):
            slope = (points[i + 1, j] - points[i, j]) / width
            start, end = bend[i, j], bend[i + 1, j]
            found[i, 0, j] = points[i, j]
            found[i, 1, j] = (slope - width * (2 * start + end) / 6) * width
            found[i, 2, j] = start / 2 * width**2
            found[i, 3, j] = (end - start) / 6 * width**2
    return found
