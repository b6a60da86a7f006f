"""Compiled third-order filter of pole placement, exact for piecewise polynomial inputs."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.kernels import compiled

# Largest step of the Taylor series of the filter's state, in shortest time constants of the filter.
LARGEST_STEP = 0.25
# Terms after which the series converges to rounding errors, for inputs up to fifth order; and the
# share of the state below which they are none.
TERMS = 22
NOTHING = 1e-20


@compiled()
def run_filter(
    width: FloatArray,
    coefficients: FloatArray,
    damping: FloatArray,
    rate: FloatArray,
    fastest: FloatArray,
    start: FloatArray,
) -> FloatArray:
    """States of `x''' / p³ + d2 x'' / p² + d1 x' / p + x = q` at the ends of all intervals.

    Args:
        width: Lengths of the intervals [s], (n,).
        coefficients: Coefficients of the input in powers of x = u / width, (n, 6, dof).
        damping: d1 and d2 of each joint, (dof, 2).
        rate: p of each joint [1/s], (dof,).
        fastest: Absolute value of the filter's largest pole of each joint [1/s], (dof,).
        start: Input value before the first interval, at which the filter is at rest, (dof,).

    Returns:
        x, x' / p and x'' / p² at the n + 1 ends of the intervals, (n + 1, dof, 3).
    """
    n, dof = len(width), len(rate)
    states = np.empty((n + 1, dof, 3))
    series = np.empty((TERMS + 1, 3))
    now, local = np.empty(3), np.empty(6)
    for j in range(dof):
        p, d1, d2 = rate[j], damping[j, 0], damping[j, 1]
        now[0], now[1], now[2] = start[j], 0.0, 0.0
        for c in range(3):
            states[0, j, c] = now[c]
        for i in range(n):
            steps = max(int(np.ceil(width[i] * fastest[j] / LARGEST_STEP)), 1)
            h = width[i] / steps
            for step in range(steps):
                # The input over this step in powers of v = u / h.
                x0 = step / steps
                share = 1.0 / steps
                for k in range(6):
                    local[k] = 0.0
                for k in range(5, -1, -1):
                    for m in range(5, 0, -1):
                        local[m] = local[m] * x0 + local[m - 1] * share
                    local[0] = local[0] * x0 + coefficients[i, k, j]
                x1, x2, x3 = now[0], now[1], now[2]
                least = NOTHING * (abs(x1) + abs(x2) + abs(x3) + abs(local[0]))
                terms = TERMS
                for k in range(TERMS):
                    series[k, 0], series[k, 1], series[k, 2] = x1, x2, x3
                    source = local[k] if k < 6 else 0.0
                    scale = p * h / (k + 1)
                    x1, x2, x3 = (
                        scale * x2,
                        scale * x3,
                        scale * (source - x1 - d1 * x2 - d2 * x3),
                    )
                    if k > 5 and abs(x1) + abs(x2) + abs(x3) <= least:
                        terms = k + 1
                        break
                series[terms, 0], series[terms, 1], series[terms, 2] = x1, x2, x3
                x1 = x2 = x3 = 0.0
                for k in range(terms, -1, -1):
                    x1 += series[k, 0]
                    x2 += series[k, 1]
                    x3 += series[k, 2]
                now[0], now[1], now[2] = x1, x2, x3
            for c in range(3):
                states[i + 1, j, c] = now[c]
    return states
