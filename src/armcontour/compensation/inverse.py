"""Set-points by the exact inverse of the servo, from means of the plan over command intervals.

See docs/concepts/compensation.md.
"""

from __future__ import annotations

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.compensation.set_points import (
    SNAP,
    SetPointTimes,
    advance_set_points,
    time_advances,
)
from armcontour.motion import Trajectory
from armcontour.servo import ServoModel

# A mean over a command interval T differs from the value by T² / 24 of the second derivative,
# interpolation by lines by T² / 12 more, and held set-points, which are means again, by T² / 24.
BIAS = {"linear": 1 / 8, "step": 1 / 12, "cubic": 1 / 24}
# Second derivatives that make up for it are those over so many command intervals to either side:
# over fewer, they would add more to what is asked for at a jump of acceleration.
REACH = 12


def inverse(trajectory: Trajectory, servo: ServoModel, period: float) -> tuple[float, FloatArray]:
    """Set-points by the inverse of the servo.

    A set-point is the mean of the exact command over the command interval about its time. That is
    the command of the plan's mean: the means of velocity and acceleration are differences of
    position and velocity, so that a jump of acceleration has its part in the set-points on both
    sides, wherever it is between them.

    Args:
        trajectory: Trajectory that the joints should follow.
        servo: Servo model with values per joint.
        period: Command interval [s].

    Returns:
        Time of the first set-point, which is the start of the plan [s], and set-points [rad],
        (n, dof).
    """
    final = trajectory([trajectory.duration], side="left")

    def command(times: SetPointTimes, joints: IntArray) -> FloatArray:
        t = times.inside
        if len(t) and times.after_end < period / 2:
            # The interval about the next set-point still has a part of the motion.
            t = np.append(t, trajectory.duration + times.after_end)
        found = servo.command(*_means(trajectory, t, period))
        found -= BIAS[servo.interpolation] * _bends(found, trajectory, t, period)
        return np.concatenate([found, final])[:, joints]

    return advance_set_points(
        trajectory, time_advances(servo, period), period, command, from_rest=True
    )


def _means(
    trajectory: Trajectory, t: FloatArray, period: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Means of q, dq and ddq over the intervals about times, also of the rest around the motion.

    Those of q are by Simpson's rule, which is exact up to third order.
    """
    # At all times at once, nearly in their order: a program has thousands of laws to look up.
    times = np.stack([t - period / 2, t, t + period / 2], axis=1)
    q, dq = trajectory.motion_with_rests(times.ravel(), 1)
    first, middle, last = (q[k::3] for k in range(3))
    before, after = dq[0::3], dq[2::3]
    return (first + 4 * middle + last) / 6, (last - first) / period, (after - before) / period


def _bends(u: FloatArray, trajectory: Trajectory, t: FloatArray, period: float) -> FloatArray:
    """Second differences of set-points, over up to REACH intervals of the same move, (n, dof).

    From the start of a move, and to its end, they fade: an arm at rest is where the plan is.
    """
    ends = trajectory.starts
    k = np.clip(np.searchsorted(ends, t, side="right"), 1, len(ends) - 1)
    inside = np.minimum(t - ends[k - 1], ends[k] - t) / period
    reach = np.clip(np.floor(inside + SNAP), 0, REACH).astype(np.intp)
    i = np.arange(len(t))
    weight = np.clip(inside / REACH, 0, 1) / np.maximum(reach, 1) ** 2
    return np.asarray(weight[:, None] * (u[i + reach] - 2 * u + u[i - reach]))
