"""What a controller makes of set-points: a command that is a polynomial between any two of them."""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray


def polynomials(q: FloatArray, period: float, interpolation: str) -> FloatArray:
    """The command in powers of the time since each interval's first set-point.

    Interval k is between the set-points k - 1 and k: the first is before all of them and the last
    behind them, both constant.

    Args:
        q: Set-points, (n, dof) [rad].
        period: Time between them [s].
        interpolation: As in `ServoModel`.

    Returns:
        (dof, n + 1, 4) [rad, rad/s, rad/s², rad/s³].
    """
    n, dof = q.shape
    found = np.zeros((n + 1, 4, dof))
    found[0, 0] = q[0]
    found[1:, 0] = q
    inner = found[1:-1]
    if interpolation != "step":
        chord = np.diff(q, axis=0) / period
        inner[:, 1] = chord
        if interpolation == "cubic" and n > 1:
            slope = np.zeros_like(q)
            slope[1:-1] = (q[2:] - q[:-2]) / (2 * period)
            begin, end = slope[:-1], slope[1:]
            inner[:, 1] = begin
            inner[:, 2] = (3 * chord - 2 * begin - end) / period
            inner[:, 3] = (begin + end - 2 * chord) / period**2
    return np.ascontiguousarray(np.moveaxis(found, 2, 0))
