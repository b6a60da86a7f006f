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
    # Row k is a step of initial value k; that of the offset needs no simulation.
    steps = np.diag(INITIAL_SCALES)[:count] * (1.0 if unsaturated else DERIVATIVE_STEP)
    steps[0] = 0.0

    def simulate(initial: FloatArray) -> FloatArray:
        offset, q0, dq0, ddq0 = initial.T
        q = follow(segment.command, servo, q0, dq0, drive_cycle, ddq0)
        return np.asarray(q + offset[:, None])

    x = np.array([0.0, y[0], segment.velocity, 0.0])
    q = simulate(x + steps)
    for _ in range(1 if unsaturated else MAX_STATE_STEPS):
        slopes = (q - q[0]) / np.maximum(steps.sum(axis=1), 1e-300)[:, None]
        slopes[0] = 1.0
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
