"""What the compensators share: the times of the set-points, and the servo's inverse."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.motion import Trajectory
from armcontour.servo import ServoModel

# A set-point this close to a break of the trajectory, in periods, is taken at the break.
SNAP = 1e-9
# More set-points than this do not fit in memory with all that is computed from them.
MOST_SET_POINTS = 20_000_000


@dataclass(frozen=True, slots=True)
class SetPointTimes:
    """Times of set-points.

    Args:
        inside: Those within the motion, the first at 0, snapped to breaks next to them [s].
        after_end: From the end of the motion to the first set-point at or behind it [s].
    """

    inside: FloatArray
    after_end: float


def set_point_times(trajectory: Trajectory, period: float) -> SetPointTimes:
    """Multiples of the period up to the end of the motion.

    Raises:
        InvalidInput: There would be too many of them.
    """
    duration = trajectory.duration
    if duration / period > MOST_SET_POINTS:
        raise InvalidInput(
            f"{duration:g} s of motion at a command interval of {period:g} s would be "
            f"{duration / period:.3g} set-points, more than {MOST_SET_POINTS:g}: take a longer "
            "interval or a higher speed."
        )
    count = int(np.ceil(duration / period * (1 - 1e-15) - SNAP))
    grid = np.arange(max(count, 1)) * period
    breaks = trajectory.breaks
    near = np.clip(np.searchsorted(breaks, grid), 1, len(breaks) - 1)
    near -= grid - breaks[near - 1] < breaks[near] - grid
    close = np.abs(breaks[near] - grid) < SNAP * period
    return SetPointTimes(
        inside=np.where(close, breaks[near], grid),
        after_end=max(len(grid) * period - duration, SNAP * period),
    )


def inverse_servo(servo: ServoModel, q: FloatArray, dq: FloatArray, ddq: FloatArray) -> FloatArray:
    """The command that makes an unsaturated servo (6) move like q: `q + dq/K_p + ddq/(K_p K_v)`."""
    return np.asarray(q + dq / servo.kp + ddq / (servo.kp * servo.kv))
