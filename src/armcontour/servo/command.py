"""The command of a joint servo: set-points interpolated by polynomials, delayed by dead time.

The dead time shifts the command in continuous time.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray

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


def command_weights(
    count: int, period: float, interpolation: str, dead_time: float, t: FloatArray
) -> tuple[IntArray, FloatArray]:
    """Weights of the set-points in the delayed command of one joint at given times.

    Args:
        count: Number of set-points.
        period: Command interval [s].
        interpolation: As in `ServoModel`.
        dead_time: Dead time [s].
        t: Times since the first set-point [s], (n,).

    Returns:
        Indices of four set-points, which may repeat, and their weights, (n, 4) each.
    """
    at = np.clip((t - dead_time) / period, 0.0, count - 1)
    k = np.minimum(np.floor(at + SNAP), max(count - 2, 0)).astype(np.intp)
    x = np.clip(at - k, 0.0, 1.0)
    index = np.clip(k[:, None] + np.arange(-1, 3), 0, count - 1)
    weight = np.zeros((len(t), 4))
    if interpolation == "step":
        # The last set-point is reached at the end of the last interval.
        late = (x >= 1 - SNAP).astype(np.float64)
        weight[:, 1], weight[:, 2] = 1 - late, late
        return index, weight
    weight[:, 1], weight[:, 2] = 1 - x, x
    if interpolation == "cubic":
        weight[:, 1], weight[:, 2] = 1 - x**2 * (3 - 2 * x), x**2 * (3 - 2 * x)
        start, end = x * (1 - x) ** 2 / 2, x**2 * (x - 1) / 2
        # The slopes at the first and the last set-point are 0.
        start, end = np.where(k > 0, start, 0.0), np.where(k < count - 2, end, 0.0)
        weight[:, 0] -= start
        weight[:, 2] += start
        weight[:, 1] -= end
        weight[:, 3] += end
    return index, weight
