"""Kernel of the override: the time scaling of a plan, cycle by cycle, within limits."""

from __future__ import annotations

import math
from typing import NamedTuple

from armcontour.core.checks import FloatArray
from armcontour.core.kernel_cache import compiled
from armcontour.planning.topp.limit_forms import HIGH, LOW, A, B

# Factors below this do not limit the slope.
SMALLEST_FACTOR = 1e-12
# Columns of the result: the plan's time [s], its rate dtau/dt [-] and the slope d2tau/dt2 [1/s] at
# the start of a cycle, and the duration of the cycle [s].
TIME, RATE, SLOPE, DURATION = range(4)


class OverrideTable(NamedTuple):
    """Limits of a part of a plan, on intervals of its time tau.

    With the rate r = dtau/dt and its slope d2tau/dt2, a row is `low <= a slope + b r² <= high`. The
    names of the forms are those of `topp.limit_forms`, with tau as the arc length.
    """

    tau: FloatArray  # Times of the plan at the ends of the intervals [s], (n + 1,)
    rows: FloatArray  # Linear rows at the starts and ends of the intervals, (n, 2, rows, 4)
    viscous: FloatArray  # Viscous friction of the first rows for rate 1, (n, 2, joints)
    rounds: FloatArray  # Vectors of limits on norms, (n, 2, rounds, 2, 3)
    radius: FloatArray  # Their radii, (n, rounds)


@compiled(inner=True)
def slopes_of_rows(
    table: OverrideTable, i: int, end: int, rate: float, low: float, high: float
) -> tuple[float, float]:
    """Reduce a range of slopes to that which satisfies the rows at one end of an interval."""
    square = rate * rate
    for r in range(table.rows.shape[2]):
        value = table.rows[i, end, r, B] * square
        if r < table.viscous.shape[2]:
            value += table.viscous[i, end, r] * rate
        up = max(table.rows[i, end, r, HIGH] - value, 0.0)
        down = max(value - table.rows[i, end, r, LOW], 0.0)
        factor = table.rows[i, end, r, A]
        if factor > SMALLEST_FACTOR:
            high = min(high, up / factor)
            low = max(low, -down / factor)
        elif factor < -SMALLEST_FACTOR:
            high = min(high, -down / factor)
            low = max(low, up / factor)
    return low, high


@compiled(inner=True)
def slopes_of_rounds(
    table: OverrideTable, i: int, end: int, rate: float, low: float, high: float
) -> tuple[float, float]:
    """Reduce a range of slopes to that which satisfies the norms at one end of an interval."""
    square = rate * rate
    for r in range(table.rounds.shape[2]):
        aa = ab = bb = 0.0
        for k in range(3):
            a = table.rounds[i, end, r, A, k]
            b = table.rounds[i, end, r, B, k] * square
            aa += a * a
            ab += a * b
            bb += b * b
        if aa <= SMALLEST_FACTOR * SMALLEST_FACTOR:
            continue
        # |a slope + b|² <= radius² is a quadratic inequality in the slope.
        radius = table.radius[i, r]
        root = math.sqrt(max(ab * ab - aa * (bb - radius * radius), 0.0))
        high = min(high, max((-ab + root) / aa, 0.0))
        low = max(low, min((-ab - root) / aa, 0.0))
    return low, high


@compiled(inner=True)
def slope_range(
    table: OverrideTable, first: int, reach: float, rate: float, end_rate: float
) -> tuple[float, float]:
    """Return the slopes that are within the limits from interval `first` to the time `reach`.

    Slope 0 always is: a plan within its limits is so at every constant rate up to 1. The limits are
    linear in the slope and the squared rate, so they hold for all rates between the two given ones.
    """
    low = -math.inf
    high = math.inf
    i = first
    while True:
        for end in range(2):
            low, high = slopes_of_rows(table, i, end, rate, low, high)
            low, high = slopes_of_rows(table, i, end, end_rate, low, high)
            low, high = slopes_of_rounds(table, i, end, rate, low, high)
            low, high = slopes_of_rounds(table, i, end, end_rate, low, high)
        i += 1
        if i >= len(table.tau) - 1 or table.tau[i] >= reach:
            break
    return min(low, 0.0), max(high, 0.0)


@compiled()
def follow_override(
    table: OverrideTable,
    state: tuple[float, float],
    target: float,
    cycle: float,
    result: FloatArray,
) -> int:
    """Change the rate towards a target as fast as the limits allow, with one slope per cycle.

    Ends after as many cycles as the result has rows, at the end of the table, or at rest if the
    target is 0. Returns the number of cycles; the last one is shorter if the table ends in it.

    - `state`: the plan's time [s] and the rate at the start.
    - `target`: the wanted rate, 0 to 1.
    - `cycle`: duration of a cycle [s].
    - `result`: is filled with the motion in each cycle, (cycles, 4).
    """
    tau, rate = state
    last = table.tau[-1]
    i = 0
    for k in range(len(result)):
        if target == 0.0 and rate == 0.0:
            return k
        while i < len(table.tau) - 2 and table.tau[i + 1] <= tau:
            i += 1
        # The limits at the rate at the start bound the rate at the end of the cycle. Those at both
        # rates also hold for a slope that changes the rate less.
        low, high = slope_range(table, i, tau + rate * cycle, rate, rate)
        slope = min(max((target - rate) / cycle, low), high)
        end_rate = rate + slope * cycle
        low, high = slope_range(table, i, tau + max(rate, end_rate) * cycle, rate, end_rate)
        slope = min(max(slope, low), high)
        result[k, TIME] = tau
        result[k, RATE] = rate
        result[k, SLOPE] = slope
        result[k, DURATION] = cycle
        reached = tau + cycle * (rate + cycle * slope / 2)
        if reached >= last:
            # The end is reached within the cycle, at a root of tau + rate d + slope d² / 2 = last.
            left = last - tau
            root = math.sqrt(max(rate * rate + 2 * slope * left, 0.0))
            result[k, DURATION] = min(2 * left / max(rate + root, SMALLEST_FACTOR), cycle)
            return k + 1
        tau = reached
        rate = rate + slope * cycle
        if abs(rate - target) < SMALLEST_FACTOR:
            rate = target
    return len(result)
