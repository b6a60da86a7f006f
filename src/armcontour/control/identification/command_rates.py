"""Largest velocities and accelerations that logs command."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray
from armcontour.motion.log import Log
from armcontour.robot.servo.model import MOVING_SHARE

# Spacing of the samples from which velocities and accelerations are computed [s].
SAMPLE_SPACING = 8e-3
# A log is slow, like programs in contrast to multisines, if its frequency is at most this multiple
# of the lowest frequency among the logs.
SLOW_RATIO = 3.0
# Lower bound of a velocity that is used as a divisor [rad/s].
LEAST_VELOCITY = 1e-9


class FastestMotion(NamedTuple):
    """Largest rates that logs command, (dof,) each."""

    velocity: FloatArray  # Largest velocity of all logs [rad/s]
    acceleration: FloatArray  # Largest acceleration of all logs [rad/s²]
    # Lowest frequency of the logs: largest acceleration divided by largest velocity [1/s]. A joint
    # that hardly moves in a log does not count there.
    frequency: FloatArray
    of_logs: FloatArray  # Smallest of these ratios in each log [1/s], (logs,)

    @property
    def slow_logs(self) -> BoolArray:
        """Mask of the logs that reverse about as slowly as the slowest log, (logs,)."""
        return np.asarray(self.of_logs <= SLOW_RATIO * self.of_logs.min())


def fastest_motion(logs: Sequence[Log]) -> FastestMotion:
    """Return the largest velocities and accelerations of commands, and smallest frequencies."""
    velocities = []
    accelerations = []
    for log in logs:
        spaced = slice(None, None, max(round(SAMPLE_SPACING / log.interval), 1))
        log_velocity = np.gradient(log.command[spaced], log.t[spaced], axis=0)
        log_acceleration = np.gradient(log_velocity, log.t[spaced], axis=0)
        velocities.append(np.abs(log_velocity).max(axis=0))
        accelerations.append(np.abs(log_acceleration).max(axis=0))
    velocity = np.array(velocities)
    acceleration = np.array(accelerations)
    frequency = acceleration / np.maximum(velocity, LEAST_VELOCITY)
    # Every joint counts in the log in which it is fastest.
    least = np.minimum(MOVING_SHARE * velocity.max(axis=1, keepdims=True), velocity.max(axis=0))
    frequency[velocity < least] = np.inf
    return FastestMotion(
        velocity.max(axis=0), acceleration.max(axis=0), frequency.min(axis=0), frequency.min(axis=1)
    )
