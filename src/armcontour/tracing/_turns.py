"""Compiled shifts of joint positions by whole turns."""

from __future__ import annotations

import math

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def shift_by_turns(
    q: FloatArray, lower: FloatArray, upper: FloatArray, start: FloatArray
) -> tuple[FloatArray, bool]:
    """Joint positions, each joint shifted by whole turns to a wanted place.

    That is as near to the start as possible if the joint then stays in its range; else as near as
    possible to the middle of its range, or, if the range has one end only, inside it.

    Args:
        q: Joint positions [rad], (n, dof).
        lower: Lower ends of the joint ranges, infinite without one [rad], (dof,).
        upper: Upper ends of the joint ranges [rad], (dof,).
        start: Where the first joint positions are wanted [rad], (dof,); (0,) if nowhere.

    Returns:
        The positions, (n, dof), and whether all are in their ranges.
    """
    n, dof = q.shape
    found, inside = np.empty((n, dof)), True
    for k in range(dof):
        low = high = q[0, k]
        for i in range(1, n):
            low, high = min(low, q[i, k]), max(high, q[i, k])
        middle, least, most = 0.0, -math.inf, math.inf
        if math.isfinite(lower[k]) and math.isfinite(upper[k]):
            middle = lower[k] / 2.0 + upper[k] / 2.0
        else:
            least = math.ceil((lower[k] - low) / (2.0 * math.pi)) if lower[k] > least else least
            most = math.floor((upper[k] - high) / (2.0 * math.pi)) if upper[k] < most else most
        turns = np.rint((middle - (low + high) / 2.0) / (2.0 * math.pi))
        shift = 2.0 * math.pi * min(max(turns, least), most)
        if len(start) > 0:
            near = 2.0 * math.pi * np.rint((start[k] - q[0, k]) / (2.0 * math.pi))
            if low + near >= lower[k] and high + near <= upper[k]:
                shift = near
        if low + shift < lower[k] or high + shift > upper[k]:
            inside = False
        for i in range(n):
            found[i, k] = q[i, k] + shift
    return found, inside
