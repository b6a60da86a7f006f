"""The compiled part of what a command asks of a servo that does not saturate."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour._kernels import compiled


@compiled()
def states(
    command: FloatArray, parts: int, width: float, own: FloatArray, driven: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """States of one joint, from rest, at the ends of equal parts of all command intervals.

    Args:
        command: In powers of the time in each interval, (n, 4).
        parts: Parts per interval.
        width: Length of a part [s].
        own: q and dq at the end of a part from those at its beginning, (2, 2).
        driven: The same from the command's coefficients there, (2, 4).

    Returns:
        q and dq at the beginning of every part and behind the last, (n * parts + 1, 2); the
        command's coefficients at the beginning of every part, (n * parts, 4).
    """
    n = len(command)
    found = np.empty((n * parts + 1, 2))
    given = np.empty((n * parts, 4))
    found[0, 0], found[0, 1] = command[0, 0], 0.0
    for k in range(n * parts):
        a = command[k // parts]
        t = (k % parts) * width
        u = given[k]
        u[0] = a[0] + t * (a[1] + t * (a[2] + t * a[3]))
        u[1] = a[1] + t * (2 * a[2] + 3 * t * a[3])
        u[2] = a[2] + 3 * t * a[3]
        u[3] = a[3]
        for i in range(2):
            total = own[i, 0] * found[k, 0] + own[i, 1] * found[k, 1]
            for m in range(4):
                total += driven[i, m] * u[m]
            found[k + 1, i] = total
    return found, given
