"""What a log does not tell of a command between its samples, and what that does to estimates.

Lines between samples cut off the bends of a command. To the loops that is as if the command u were
u + c T² u'', with the sample interval T. If the bends are at the samples c is 0, if they are in the
middle 1/8, and 1/12 for a smooth command. A held set-point may come up to T before the sample that
shows it first.
"""

from __future__ import annotations

import math
from dataclasses import replace

import numpy as np

from armcontour._checks import FloatArray
from armcontour.identification.fitting import Data, Fit, fit

# Largest c: of bends in the middle of samples; of a command that moves on while it seems held.
BENT = 1 / 8
HELD = 1 / 24


def find_shifts(data: Data, found: Fit) -> dict[str, float]:
    """How far estimates may be off by what was commanded between samples.

    Args:
        data: The log of the joint.
        found: Its fit.

    Returns:
        The farthest changes, by "kp", "kv", "delay": logarithms of gains, and seconds.
    """
    other = fit(replace(data, u=sharpened(data.u, BENT if data.linear else HELD)), found.state)
    shifts: dict[str, float] = {
        x: math.log(getattr(other.state, x) / getattr(found.state, x))
        for x in ("kp", "kv")
        if x in found.state.free
    }
    shifts["delay"] = other.state.delay - found.state.delay
    if not data.linear:
        shifts["delay"] += data.interval
    return shifts


def sharpened(u: FloatArray, share: float) -> FloatArray:
    """A command less `share` of its second differences, and what belongs to that of its fourth.

    Of bends in the middle of samples, that is 1 / cos(ω T / 2) at a frequency ω.

    Args:
        u: Set-points, (n,).
        share: Share of the second differences.
    """
    second = _second(u)
    return np.asarray(u - share * second + 1.5 * share**2 * _second(second))


def _second(u: FloatArray) -> FloatArray:
    """Second differences of values that stay as they are before and after, (n,)."""
    return np.diff(np.pad(u, 1, mode="edge"), 2)
