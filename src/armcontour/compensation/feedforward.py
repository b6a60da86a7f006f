"""Set-points for a servo with feed-forward, from those for the same servo without.

See docs/concepts/compensation.md.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray
from armcontour.compensation.set_points import SETTLING
from armcontour.servo import ServoModel
from armcontour.servo.command import polynomials

# What a set-point leaves of the end of the motion after its tail [rad].
SETTLED = 1e-10
# Corrections of the first solution for cubics, of which each leaves a small share of the error, and
# the error at which they end [rad].
MOST_CORRECTIONS = 50
EXACT = 1e-13


def for_feedforward(plain: FloatArray, period: float, servo: ServoModel) -> FloatArray:
    """Set-points to which a servo responds as one without feed-forward responds to others.

    In every command interval the mean of the command with what feed-forward adds is that of the
    command without feed-forward. These equations are solved forward from rest, which is stable for
    any feed-forward.

    Args:
        plain: Set-points for the servo without feed-forward [rad], (n, dof); at rest before the
            first and after the last one.
        period: Command interval [s].
        servo: Servo model with values per joint.

    Returns:
        Set-points [rad], (m, dof), with m >= n: their difference to the last one decays with the
        time constant `velocity_feedforward / kp`.
    """
    rows = int(np.ceil(_tail(servo, period)))
    want = _means(np.concatenate([plain, np.tile(plain[-1], (rows, 1))]), period, _without(servo))
    start = plain[0]
    found = _solved(want - start, period, servo) + start
    if servo.interpolation == "cubic":
        for _ in range(MOST_CORRECTIONS):
            error = want - _means(found, period, servo)
            found += _solved(error, period, servo)
            if np.abs(error).max() <= EXACT:
                break
    moves = np.flatnonzero((np.abs(found - plain[-1]) > SETTLED).any(axis=1))
    found = found[: max(len(plain), moves[-1] + 2 if len(moves) else 0)]
    found[-1] = plain[-1]
    return np.asarray(found)


def tail_duration(servo: ServoModel) -> float:
    """Longest time for which set-points go on after the motion because of feed-forward [s]."""
    return SETTLING * float(servo.lead[0].max())


def _tail(servo: ServoModel, period: float) -> float:
    """Number of set-points after which the slowest transient has decayed."""
    return tail_duration(servo) / period + SETTLING


def _without(servo: ServoModel) -> ServoModel:
    """The same servo without feed-forward."""
    return servo.replace(velocity_feedforward=0.0, acceleration_feedforward=0.0).for_joints(
        len(servo.kp)
    )


def _means(q: FloatArray, period: float, servo: ServoModel) -> FloatArray:
    """Means of the command over the intervals that end at each set-point [rad], (n, dof)."""
    pieces = polynomials(q, period, servo)[:, :-1]
    return np.asarray((pieces @ (period ** np.arange(4) / np.arange(1, 5))).T)


def _solved(means: FloatArray, period: float, servo: ServoModel) -> FloatArray:
    """Set-points of which the command has given means over the intervals that end there.

    Args:
        means: Means less the position before the first set-point [rad], (n, dof).
        period: Command interval [s].
        servo: Servo model with values per joint; cubics count as lines.
    """
    from scipy.signal import lfilter

    found = np.empty_like(means)
    held = servo.interpolation == "step"
    for j, (a, b) in enumerate(zip(*servo.lead, strict=True)):
        # Shares of the velocity and acceleration of the command, in differences of set-points.
        first, second = a / period, b / period**2
        if held:
            # The interval that ends at a set-point holds the one before it.
            found[:-1, j] = lfilter([1.0], [1 + first, -first], means[1:, j])
            found[-1, j] = means[-1, j]
            continue
        equation = [0.5 + first + second, 0.5 - first - 2 * second, second]
        found[:, j] = lfilter([1.0], equation, means[:, j])
    return found
