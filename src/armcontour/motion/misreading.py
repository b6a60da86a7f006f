"""What is wrong with measured positions that do not belong to what joints were told or should do.

Units, signs and the order of columns are tried; a reading is believed only if it leaves far less.
"""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray

# Another reading of the numbers explains them if it leaves at most this share of the difference.
BETTER = 0.3
# and of the variance of what moves, this: a lag is not all that a joint does.
UNEXPLAINED = 0.2
# A joint follows its command like a lag of one of these times [s], or none, after a dead time.
LAGS = (0.0, 0.01, 0.014, 0.02, 0.028, 0.04, 0.056, 0.08, 0.11, 0.16)
# Dead times that are tried, and neighbouring samples that are compared.
DEAD_TIMES = 26
SAMPLES = 8000
# Of two orders of columns that are as good, that of the file is preferred by this share.
AS_GOOD = 1e-6


def find_misreading(
    t: FloatArray,
    measured: FloatArray,
    wanted: FloatArray,
    *,
    names: Sequence[str] = (),
    late: float | None = None,
) -> str:
    """What explains measured positions better than that they are read rightly, and what mends it.

    Args:
        t: Times [s], (n,).
        measured: Measured positions [rad], (n, dof).
        wanted: What the joints should do [rad], or, with `late`, what they are told, (n, dof).
        names: Names of the joints; their numbers by default.
        late: Largest dead time of joints that follow commands, with any lag and offset [s]; without
            it positions are compared as they are.

    Returns:
        What is wrong, as a part of a sentence; empty if no other reading explains the positions.
    """
    names = names or [str(j + 1) for j in range(wanted.shape[1])]
    if late is not None:
        piece = _liveliest(wanted)
        t, measured, wanted = t[piece], measured[piece], wanted[piece]
    found = _Comparison(t, measured, wanted, late)
    plain = found.apart()
    own, turn = np.diag(plain), 180 / math.pi
    enough = np.minimum(BETTER**2 * own.mean(), UNEXPLAINED * found.power.mean())
    for factor, what in (
        (1 / turn, "the measured positions look like degrees"),
        (turn, "the measured positions look like radians, but those they belong to like degrees"),
    ):
        # As a share of what is measured, whatever its unit.
        left = np.diag(found.apart(factor)).mean() / factor**2
        if left < min(BETTER * own.mean(), UNEXPLAINED * found.power.mean()):
            return f"{what}, so give their columns the right unit"
    order = _order(plain)
    if plain[order, np.arange(len(order))].mean() < enough:
        return (
            f"its columns fit the joints in the order {', '.join(names[k] for k in order)}, so "
            "name them, or put them in that order"
        )
    mirrored = np.diag(found.apart(-1.0))
    turned = mirrored < np.minimum(BETTER**2 * own, UNEXPLAINED * found.power)
    if np.where(turned, mirrored, own).mean() < enough:
        of = ", ".join(x for x, y in zip(names, turned, strict=True) if y)
        return f"commands and measured positions of {of} have opposite signs, so turn one of them"
    if late is not None:
        back = _Comparison(t, wanted, measured, late)
        left = np.diag(back.apart()).mean()
        if left < min(BETTER**2 * own.mean(), UNEXPLAINED * back.power.mean()):
            return "commands and measured positions are exchanged, so exchange their names"
    return ""


class _Comparison:
    """Second moments of measured and wanted positions, for every way in which joints may follow.

    Attributes:
        power: Mean squares of the measured columns [rad²], (dof,).
    """

    def __init__(self, t: FloatArray, y: FloatArray, u: FloatArray, late: float | None) -> None:
        pairs = [(y, u)] if late is None else _followed(t, y, u, late)
        self._yy = np.array([(a**2).mean(axis=0) for a, _ in pairs])[:, :, None]
        self._uu = np.array([(b**2).mean(axis=0) for _, b in pairs])[:, None, :]
        self._yu = np.array([a.T @ b / len(a) for a, b in pairs])
        self.power = self._yy[0, :, 0]

    def apart(self, factor: float = 1.0) -> FloatArray:
        """Mean squares by which each measured column, times a factor, is off each wanted one."""
        off = factor**2 * self._yy - 2 * factor * self._yu + self._uu
        return np.asarray(np.maximum(off, 0.0).min(axis=0))


def _followed(
    t: FloatArray, y: FloatArray, u: FloatArray, late: float
) -> list[tuple[FloatArray, FloatArray]]:
    """Measured positions, and what joints do that follow u, both without their means."""
    step, pairs = float(t[-1] - t[0]) / (len(t) - 1), []
    delays = np.unique(np.round(np.linspace(0.0, late, DEAD_TIMES) / step).astype(int))
    for lag in LAGS:
        x = _lagged(t, u, lag)
        for k in delays[delays < len(t) // 2]:
            a, b = y[k:], x[: len(x) - k]
            pairs.append((a - a.mean(axis=0), b - b.mean(axis=0)))
    return pairs


def _lagged(t: FloatArray, u: FloatArray, lag: float) -> FloatArray:
    """Commands after a first-order lag [s], at rest before, (n, dof)."""
    from scipy.linalg import solve_banded

    if lag == 0.0:
        return u
    share = np.exp(-np.diff(t) / lag)
    # Row by row: what is left of the position before, and the rest of the command.
    matrix = np.ones((2, len(u)))
    matrix[1, :-1] = -share
    driven = np.array(u)
    driven[1:] *= 1 - share[:, None]
    return np.asarray(solve_banded((1, 0), matrix, driven))


def _liveliest(u: FloatArray) -> slice:
    """As many samples as are compared, where commands move most."""
    moved = np.concatenate([[0.0], np.cumsum(np.sum(np.diff(u, axis=0) ** 2, axis=1))])
    count = min(SAMPLES, len(u))
    first = int(np.argmax(moved[count - 1 :] - moved[: len(moved) - count + 1]))
    return slice(first, first + count)


def _order(apart: FloatArray) -> list[int]:
    """Which column fits each joint best, all in all."""
    from scipy.optimize import linear_sum_assignment

    other = AS_GOOD * apart.max() * (1 - np.eye(len(apart)))
    return [int(k) for k in linear_sum_assignment((apart + other).T)[1]]
