"""The compiled check of a joint path: whether it is finite, where it jumps, where dq_ds does."""

from __future__ import annotations

from armcontour._checks import BoolArray, FloatArray
from armcontour._kernels import compiled


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
