"""The command of a joint servo: set-points interpolated by polynomials, delayed by dead time.

The dead time shifts the command in continuous time.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray

# Times closer to a set-point than this, in command intervals, count as the set-point's time.
SNAP = 1e-9


def polynomials(q: FloatArray, period: float, interpolation: str) -> FloatArray:
    """The command in each interval, as a cubic in the time since the interval's start.

    Interval k lies between set-points k - 1 and k. The first interval is before all set-points and
    the last after them; the command is constant there.

    Args:
        q: Set-points [rad], (n, dof).
        period: Command interval [s].
        interpolation: As in `ServoModel`.

    Returns:
        Coefficients [rad, rad/s, rad/s², rad/s³], (dof, n + 1, 4).
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
            start, end = slope[:-1], slope[1:]
            inner[:, 1] = start
            inner[:, 2] = (3 * chord - 2 * start - end) / period
            inner[:, 3] = (start + end - 2 * chord) / period**2
    return np.ascontiguousarray(np.moveaxis(found, 2, 0))


def sample_command(
    pieces: FloatArray, period: float, dead_time: FloatArray, t: FloatArray
) -> FloatArray:
    """The delayed command that reaches the joints' servos at given times [rad], (len(t), dof).

    Args:
        pieces: Coefficients from `polynomials`, (dof, n + 1, 4).
        period: Command interval [s].
        dead_time: Dead time of each joint [s], (dof,).
        t: Times since the first set-point [s].
    """
    found = np.empty((len(t), len(pieces)))
    for j, own in enumerate(pieces):
        at = (t - dead_time[j]) / period
        k = np.clip(np.floor(at + SNAP), -1, len(own) - 2).astype(np.intp)
        # The command is constant in the first and the last interval.
        x = np.where((k < 0) | (k > len(own) - 3), 0.0, np.maximum(at - k, 0.0) * period)
        a = own[k + 1]
        found[:, j] = a[:, 0] + x * (a[:, 1] + x * (a[:, 2] + x * a[:, 3]))
    return found
