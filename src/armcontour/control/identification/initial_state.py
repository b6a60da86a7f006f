"""Prediction of log segments by a servo, with a fitted initial state."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armcontour.control.identification.joint_fit import (
    DERIVATIVE_STEP,
    INITIAL_SCALES,
    INITIAL_VALUES,
)
from armcontour.control.identification.log_segments import LogSegment
from armcontour.core.checks import FloatArray
from armcontour.robot.servo.simulation import JointServo, follow

# Search of the initial state of a segment with saturation: largest number of steps.
MAX_STATE_STEPS = 8
# Search of the initial state: fractions of a step that are tried, until one reduces the error.
STEP_FRACTIONS = (1.0, 0.3, 0.1, 0.01)
# Search of the initial state: singular values below this fraction of the largest one count as zero.
NULL_RATIO = 1e-14


class SegmentPrediction(NamedTuple):
    """Predicted motion of a servo in a log segment."""

    positions: FloatArray  # Measured positions that the servo predicts [rad], (n,)
    offset: float  # Fitted offset of the encoder [rad]


def predict(segment: LogSegment, servo: JointServo, order: str, drive_cycle: float) -> FloatArray:
    """Return predicted positions in a log segment [rad], (n,), see `fit_initial_state`."""
    return fit_initial_state(segment, servo, order, drive_cycle).positions


def fit_initial_state(
    segment: LogSegment, servo: JointServo, order: str, drive_cycle: float
) -> SegmentPrediction:
    """Predict a log segment with the offset and the initial state that fit it best.

    The Gauss-Newton method minimizes the squared errors of the used samples. Without saturation the
    motion is linear in its initial state, so one step is sufficient.

    - `order`: order of the model, which determines how many initial values are fitted.
    - `drive_cycle`: cycle of the drives [s]; 0 for continuous loops.
    """
    count = INITIAL_VALUES[order] + int(servo.ki > 0)
    unsaturated = np.isinf(servo.acceleration_limit)
    scale = INITIAL_SCALES[:count]
    used = segment.use
    y = segment.y
    step_sizes = scale * (1.0 if unsaturated else DERIVATIVE_STEP)
    # Row 0 has no step. Row k > 0 is a step of initial value k. The offset, value 0, needs no step,
    # because it shifts the positions.
    steps = np.zeros((count, len(INITIAL_SCALES)))
    values = np.arange(1, count)
    steps[values, values] = step_sizes[1:]

    def simulate(initial: FloatArray) -> FloatArray:
        """Return predicted positions with initial values, (m, 4), as (m, n) [rad]."""
        offset, q0, dq0, ddq0 = initial.T
        q = follow(segment.command, servo, q0, dq0, drive_cycle, ddq0)
        return np.asarray(q + offset[:, None])

    x = np.array([0.0, y[0], segment.velocity, 0.0])
    q = simulate(x + steps)
    for _ in range(1 if unsaturated else MAX_STATE_STEPS):
        slopes = _position_slopes(q, step_sizes)
        # Normal equations of the step, and the squared error.
        rows = np.concatenate([slopes[:, used] * scale[:, None], (y - q[0])[None, used]])
        gram = np.einsum("ik,jk->ij", rows, rows)
        inverse = np.linalg.pinv(gram[:count, :count], NULL_RATIO, hermitian=True)
        step = np.zeros(len(x))
        step[:count] = inverse @ gram[:count, count] * scale
        for fraction in STEP_FRACTIONS:
            trial = simulate(x + fraction * step + steps)
            if np.sum((y - trial[0])[used] ** 2) <= gram[count, count]:
                x = x + fraction * step
                q = trial
                break
        else:
            break
    return SegmentPrediction(positions=np.asarray(q[0]), offset=float(x[0]))


def _position_slopes(q: FloatArray, step_sizes: FloatArray) -> FloatArray:
    """Return the derivatives of positions by the initial values, (values, n).

    - `q`: predicted positions [rad], (values, n): row 0 without a step, row k with a step of
      initial value k.
    - `step_sizes`: sizes of the steps, (values,).
    """
    slopes = np.ones_like(q)  # By the offset, the derivative is 1.
    slopes[1:] = (q[1:] - q[0]) / step_sizes[1:, None]
    return slopes
