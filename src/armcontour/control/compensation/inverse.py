"""`Inverse`: set-points by the inverse of the servo."""

from __future__ import annotations

import numpy as np

from armcontour.control.compensation.method import CompensationOptions
from armcontour.control.compensation.set_point_times import (
    SNAP,
    SetPointTimes,
    advance_set_points,
    integrator_tail,
    time_advances,
)
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.fields import declared
from armcontour.core.pool import split_evenly
from armcontour.motion import Trajectory
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.model import without_integral

# Factor k of the bias k T² x'' of interpolated set-points with the cycle T: a mean over a cycle
# contributes 1 / 24, linear interpolation 1 / 12, and held set-points 1 / 24.
BIAS = {"linear": 1 / 8, "step": 1 / 12, "cubic": 1 / 24}
# Largest half-width of the second differences that correct this bias [cycles]. A smaller half-width
# would increase the commanded acceleration at jumps of acceleration.
HALF_WIDTH = 12
# Largest number of set-points whose means are computed at once, which limits the memory.
TIMES_AT_ONCE = 10_000


@declared(eq=False)
class Inverse(CompensationOptions):
    """Exact inverse of the unsaturated servo; options are those of `CompensationOptions`.

    The inverse is applied to the mean of the trajectory over a cycle about each set-point. If
    accelerations of the plan jump, the servo commands accelerations about 1 % above those of the
    plan. The first set-point, one cycle before time 0, is the start of the plan.

    >>> ac.compensate(planned, servo, ac.Inverse()).method
    'inverse'
    """

    method = "inverse"
    is_local = True

    def set_points(
        self, trajectory: Trajectory, servo: ServoModel, cycle: float, arm: Arm | None
    ) -> tuple[float, FloatArray]:
        """Compute set-points by the inverse of the servo."""
        return invert_servo(trajectory, servo, cycle)


INVERSE = Inverse()


def invert_servo(
    trajectory: Trajectory, servo: ServoModel, cycle: float
) -> tuple[float, FloatArray]:
    """Return the first set-point's time [s], and set-points by the inverse servo [rad], (n, dof).

    The saturation of the servo is ignored.
    """
    # A set-point is the mean of the exact command over the cycle about its time. Because the servo
    # is linear, this mean is the command for the means of the plan. The means of velocity and
    # acceleration are differences of position and velocity. Therefore, if the acceleration jumps
    # within such a cycle, each of its values is weighted by its duration in the cycle.
    final = trajectory([trajectory.duration], side="left")
    tail = np.zeros((integrator_tail(servo, trajectory.duration, cycle), trajectory.dof))

    def command(times: SetPointTimes, joints: IntArray) -> FloatArray:
        """Return the set-points of some joints at these times [rad], (n, len(joints))."""
        t = times.inside
        if len(t) and times.after_end < cycle / 2:
            # The cycle about the first set-point after the motion contains a part of the motion.
            t = np.append(t, trajectory.duration + times.after_end)
        # A drive holds its acceleration over a drive cycle, so the plan's acceleration is taken
        # half a drive cycle later.
        ahead = servo.drive_cycle / 2
        commands = np.empty((len(t) + len(tail) + 1, trajectory.dof))
        if len(tail):
            # The integrators depend on all previous set-points.
            q, dq, ddq = _means(trajectory, t, cycle, ahead)
            q = np.concatenate([q, tail + final])
            dq = np.concatenate([dq, tail])
            ddq = np.concatenate([ddq, tail])
            commands[:-1] = servo.command(q, dq, without_integral(dq, ddq, servo, cycle))
        else:
            for group in _groups(len(t)):
                commands[group] = servo.command(*_means(trajectory, t[group], cycle, ahead))
        commands[-1] = final
        moving = commands[: len(t)]
        moving -= _biases(moving, trajectory, t, cycle, BIAS[servo.interpolation])
        return commands if len(joints) == trajectory.dof else commands[:, joints]

    return advance_set_points(
        trajectory, time_advances(servo, cycle), cycle, command, from_rest=True
    )


def _groups(count: int) -> list[slice]:
    """Divide times into groups of at most TIMES_AT_ONCE."""
    return split_evenly(count, -(-count // TIMES_AT_ONCE))


def _means(
    trajectory: Trajectory, t: FloatArray, cycle: float, ahead: float
) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Return the means of q, dq and ddq over the cycles about times t, (n, dof) each.

    Before and after the motion, the joints rest. Means of q are computed by Simpson's rule, which
    is exact up to third order. Means of ddq are for cycles that are shifted by `ahead` [s].
    """
    shifts = cycle / 2 * np.arange(-1, 2)
    if ahead:
        shifts = np.append(shifts, ahead + shifts[::2])
    count = len(shifts)
    q_means, dq_means, ddq_means = (np.empty((len(t), trajectory.dof)) for _ in range(3))
    # A program has thousands of motion laws, so many times are evaluated at once.
    for group in _groups(len(t)):
        q, dq = trajectory.motion_with_rests((t[group, None] + shifts).ravel(), 1)
        start, middle, end = (q[k::count] for k in range(3))
        # Velocities at the start and end of the shifted cycle, or of the cycle itself without a
        # shift.
        before = dq[count // 4 * 3 :: count]
        after = dq[count - 1 :: count]
        q_means[group] = (start + 4 * middle + end) / 6
        dq_means[group] = (end - start) / cycle
        ddq_means[group] = (after - before) / cycle
    return q_means, dq_means, ddq_means


def _biases(
    u: FloatArray, trajectory: Trajectory, t: FloatArray, cycle: float, factor: float
) -> FloatArray:
    """Return the biases of set-points by their weighted second differences [rad], (n, dof).

    - `u`: set-points at times t [rad], (n, dof).
    - `factor`: factor of the second differences per squared cycle.
    """
    # Their half-width is at most HALF_WIDTH cycles, and they are within one move. They decrease to
    # 0 towards both ends of the move, because set-points at rest have no bias.
    ends = trajectory.starts
    k = np.clip(np.searchsorted(ends, t, side="right"), 1, len(ends) - 1)
    cycles_to_end = np.minimum(t - ends[k - 1], ends[k] - t) / cycle
    half_width = np.clip(np.floor(cycles_to_end + SNAP), 0, HALF_WIDTH).astype(np.intp)
    i = np.arange(len(t))
    before = i - half_width
    after = i + half_width
    weight = np.clip(cycles_to_end / HALF_WIDTH, 0, 1) / np.maximum(half_width, 1) ** 2
    biases = np.empty_like(u)
    for group in _groups(len(t)):
        differences = u[after[group]] - 2 * u[group] + u[before[group]]
        biases[group] = factor * (weight[group, None] * differences)
    return biases
