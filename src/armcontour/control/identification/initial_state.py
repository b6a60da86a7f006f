"""Prediction of log segments by a servo, with a fitted initial state."""

from __future__ import annotations

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


def predict(segment: LogSegment, servo: JointServo, order: str, drive_cycle: float) -> FloatArray:
    """Predicted positions in a log segment [rad], (n,); offset and initial state are fitted."""
    return fit_initial_state(segment, servo, order, drive_cycle)[0]


def fit_initial_state(
    segment: LogSegment, servo: JointServo, order: str, drive_cycle: float
) -> tuple[FloatArray, float]:
    """Fit the initial state of a log segment; positions [rad], (n,), and encoder offset [rad]."""
    count = INITIAL_VALUES[order] + int(servo.ki > 0)
    free = np.isinf(servo.acceleration_limit)
    scale = INITIAL_SCALES[:count]
    used = segment.use
    y = segment.y
    steps = np.diag(INITIAL_SCALES)[:count] * (1.0 if free else DERIVATIVE_STEP)
    steps[0] = 0.0

    def simulate(begins: FloatArray) -> FloatArray:
        offset, q0, dq0, ddq0 = begins.T
        q = follow(segment.command, servo, q0, dq0, drive_cycle, ddq0)
        return np.asarray(q + offset[:, None])

    x = np.array([0.0, y[0], segment.velocity, 0.0])
    q = simulate(x + steps)
    # Without saturation the motion is linear in its initial state, so one iteration is sufficient.
    for _ in range(1 if free else MAX_STATE_STEPS):
        slopes = (q - q[0]) / np.maximum(steps.sum(axis=1), 1e-300)[:, None]
        slopes[0] = 1.0
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
    return np.asarray(q[0]), float(x[0])
