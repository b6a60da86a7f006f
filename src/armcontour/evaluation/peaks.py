"""The largest value of an error between the samples of an execution.

A sampled error is largest between two samples. Where that can be is told by how the error bends: it
is taken to be no more bent between two samples than around them, with one kink at most. Only there
the motion is looked at more closely, as its plant computes it, until nothing can be higher.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial
from typing import NamedTuple

import numpy as np

from armcontour._checks import FloatArray, IntArray

# What is between samples may be higher than what was found by this share, or by so much [m or rad].
CLOSE, ROUNDING = 3e-7, 1e-13
# Parts of an interval that is looked at, and how often such parts are cut again, at most.
PARTS = 32
MOST_CUTS = 12
# A path that turns by more than this between two samples [rad] may have a peak of the error there
# of which neither sample shows anything.
SHARP = 0.2
# Where smooth functions are looked at first, as shares of the time; and how often, each time in a
# sixteenth of the time.
FEW = np.arange(9) / 8
CLOSER = 3
# Where an interval is looked at; and where next, around the guesses of a peak. Shares of its width.
SHARES = np.arange(PARTS + 1) / PARTS
AROUND = np.array([0.0, -0.03, 0.03])[:, None, None]
# The ends of an interval are known, and so is what is so near to them, as shares of its width.
NEAR = 0.01


class Peak(NamedTuple):
    """An error at one time: time [s], value [m or rad] and place on the path [m]."""

    t: float
    value: float
    s: float


# Some samples, (m,), and by how much an error may be higher after each, (m,).
Hidden = tuple[IntArray, FloatArray]
# Errors and places at times within the interval after a sample, (n,) each.
Measure = Callable[[int, FloatArray], tuple[FloatArray, FloatArray] | None]


def find_peak(
    t: FloatArray,
    values: FloatArray,
    measure: Measure,
    *,
    since: float,
    until: float,
    hidden: Hidden | None = None,
) -> Peak | None:
    """Find a value that is higher than those of all samples.

    Args:
        t: Times of the samples [s], (n,).
        values: The error at these times [m or rad], (n,).
        measure: Gives errors and places at times between sample i and the next one; i may be -1,
            or n - 1. None where the motion is not known.
        since: Nothing before this time counts [s].
        until: Nothing after this time counts [s].
        hidden: Samples between each of which and the next one the error can be higher though no
            sample shows it, and by how much [m or rad].

    Returns:
        The peak; None if no value is higher, or if times do not increase.
    """
    if len(t) < 3 or (t[1:] <= t[:-1]).any():
        return None
    counts = slice(0, int(t.searchsorted(until, side="right")))
    sampled = float(values[counts].max(initial=-np.inf))
    best, found = sampled, None
    high, _, bound = _tops(t, values)
    # Where the bend turns round, ripple is not resolved by the samples.
    bend = np.pad((values[2:] - values[1:-1]) - (values[1:-1] - values[:-2]), 1, mode="edge")
    ripple = np.maximum(values[:-1], values[1:]) + (abs(bend[:-1]) + abs(bend[1:])) / 4
    unsure = np.flatnonzero((ripple > _above(best)) & (bend[:-1] * bend[1:] <= 0))
    high, bound = np.append(high, unsure), np.append(bound, ripple[unsure])
    if hidden is not None and len(hidden[0]):
        sharp, more = hidden
        high = np.append(high, sharp)
        bound = np.append(bound, (values[sharp] + values[sharp + 1]) / 2 + more)
    # What is beyond the first and the last sample goes on as beside it.
    for i, a, b in ((-1, 0, 1), (len(t) - 1, -1, -2)):
        end = since - t[0] if i < 0 else until - t[-1]
        if (end < 0) == (i < 0) and end != 0:
            rise = abs((values[b] - values[a]) / (t[b] - t[a]) * end)
            high, bound = np.append(high, i), np.append(bound, values[a] + 2 * rise)
    for k in np.argsort(-bound).tolist():
        if bound[k] <= _above(best):
            break
        i = int(high[k])
        first = max(float(t[i]) if i >= 0 else since, since)
        last = min(float(t[i + 1]) if i + 1 < len(t) else until, until)
        if first < last:
            higher = _climb(first, last, partial(measure, i), best)
            if higher is not None:
                best, found = higher.value, higher
    # Higher by a rounding error only: one of the samples, computed once more.
    return found if best > _above(sampled) else None


def _climb(
    first: float,
    last: float,
    measure: Callable[[FloatArray], tuple[FloatArray, FloatArray] | None],
    best: float,
) -> Peak | None:
    """Find a value that is higher than the best one between two times; None if there is none."""
    found = None
    t, values = np.zeros(0), np.zeros(0)
    at = first + (last - first) * SHARES
    for _ in range(MOST_CUTS):
        seen = measure(at)
        if seen is None:
            return None
        k = int(seen[0].argmax())
        if seen[0][k] > best:
            best = float(seen[0][k])
            found = Peak(float(at[k]), best, float(seen[1][k]))
        t, values = np.append(t, at), np.append(values, seen[0])
        order = t.argsort(kind="stable")
        t, values = t[order], values[order]
        high, guesses, bound = _tops(t, values)
        width = t[high + 1] - t[high]
        left = (bound > _above(best)) & (width > PARTS * 4 * np.spacing(t[-1]))
        if not left.any():
            break
        low, width = t[high[left]], width[left]
        at = low + width * np.clip(guesses[:, left] + AROUND, NEAR, 1 - NEAR)
        at = np.unique(at)
    return found


def climb_smooth(
    first: FloatArray, last: FloatArray, measure: Callable[[FloatArray], FloatArray]
) -> FloatArray:
    """The largest value of smooth functions between two times each, (m,), by parabolas.

    Args:
        first: The first times [s], (m,).
        last: The last times [s], (m,).
        measure: Gives the values at times of each function, both (m, n).
    """
    step, rows = (last - first) * FEW[1], np.arange(len(first))
    at, best = first[:, None] + (last - first)[:, None] * FEW, np.full(len(first), -np.inf)
    for _ in range(CLOSER):
        found = measure(at)
        best = np.maximum(best, found.max(axis=1))
        k = np.clip(found.argmax(axis=1), 1, len(FEW) - 2)
        low, top, high = (found[rows, k + side] for side in (-1, 0, 1))
        bend = low + high - 2 * top
        shift = np.where(bend < 0, (low - high) / np.where(bend < 0, 2 * bend, 1.0), 0.0)
        middle = at[rows, k] + np.clip(shift, -1, 1) * step
        step = step / 16
        at = middle[:, None] + step[:, None] * (FEW - 0.5) * (len(FEW) - 1)
        at = np.clip(at, first[:, None], last[:, None])
    return best


def _above(best: float) -> float:
    """What must be exceeded to be looked at."""
    return best + CLOSE * abs(best) + ROUNDING


def _tops(t: FloatArray, values: FloatArray) -> tuple[IntArray, FloatArray, FloatArray]:
    """Where the values between two samples may be higher than at both.

    No higher than where the line through the two samples before meets that through the two after:
    there is a kink, if the values have one; a parabola is a quarter as high above its samples.

    Args:
        t: Times of the samples [s], (n,) with n > 2.
        values: Values there, (n,).

    Returns:
        Indices of the first sample of these intervals, (m,); shares of their width at which a kink
        and the top of a parabola would be, (2, m); how high the values may be, (m,).
    """
    rises = values[1:] - values[:-1]
    last = len(rises) - 1
    # The values rise before and fall after the interval; at the ends anything may be.
    top = (rises[:-2] > 0) & (rises[2:] < 0)
    top = np.concatenate([[0], np.flatnonzero(top) + 1, [last]])
    width = t[top + 1] - t[top]
    slope = rises[top] / width
    before, after = np.maximum(top - 1, 0), np.minimum(top + 1, last)
    a, b = (rises[i] / (t[i + 1] - t[i]) for i in (before, after))
    # Beyond the ends the values are as bent as beside.
    a[0], b[-1] = 2 * slope[0] - b[0], 2 * slope[-1] - a[-1]
    falls = (a > 0) & (b < 0)
    top, slope, a, b, width = (x[falls] for x in (top, slope, a, b, width))
    kink = np.clip((slope - b) / (a - b), 0.0, 1.0)
    bound = np.maximum(values[top] + a * width * kink, np.maximum(values[top], values[top + 1]))
    return top, np.stack([kink, np.clip(0.5 + 2 * slope / (a - b), 0.0, 1.0)]), bound
