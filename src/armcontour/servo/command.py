"""What a controller makes of set-points: a command that is a polynomial between any two of them.

Dead time is a shift of the command in continuous time.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray

# An instant this close to a set-point, in periods, is that of the set-point.
SNAP = 1e-9


def polynomials(q: FloatArray, period: float, interpolation: str) -> FloatArray:
    """The command in powers of the time since each interval's first set-point.

    Interval k is between the set-points k - 1 and k: the first is before all of them and the last
    after them, both constant.

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


def sample_command(
    pieces: FloatArray, period: float, dead_time: FloatArray, t: FloatArray
) -> FloatArray:
    """The command that the joints' servos see at some times, (len(t), dof) [rad].

    Args:
        pieces: As `polynomials` gives them, (dof, n + 1, 4).
        period: Command interval [s].
        dead_time: Of every joint, (dof,) [s].
        t: Times since the first set-point [s].
    """
    found = np.empty((len(t), len(pieces)))
    for j, own in enumerate(pieces):
        at = (t - dead_time[j]) / period
        k = np.clip(np.floor(at + SNAP), -1, len(own) - 2).astype(np.intp)
        # Nothing moves in the first interval, nor in the last.
        x = np.where((k < 0) | (k > len(own) - 3), 0.0, np.maximum(at - k, 0.0) * period)
        a = own[k + 1]
        found[:, j] = a[:, 0] + x * (a[:, 1] + x * (a[:, 2] + x * a[:, 3]))
    return found
