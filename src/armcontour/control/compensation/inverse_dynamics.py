"""Set-points by the inverse of the drives that move the arm's bodies."""

# The command with which the drives follow the plan is known at every time, see
# `armcontour.robot.drives`. Set-points are those whose interpolation is nearest to this command,
# see docs/concepts/compensation.md.

from __future__ import annotations

import numpy as np

from armcontour.control.compensation.set_points import (
    SetPointTimes,
    advance_set_points,
    integrator_tail,
    time_advances,
)
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quintics import solve_banded
from armcontour.motion import Trajectory
from armcontour.robot import Arm
from armcontour.robot.drives import Drives
from armcontour.robot.servo import ServoModel

# Weights of a set-point and its neighbours in the mean about it. The middle of a line is the mean
# of its ends; the middle of a cubic is `(-x[k-1] + 9 x[k] + 9 x[k+1] - x[k+2]) / 16`.
MEANS = {"linear": (4 / 6, 1 / 6), "cubic": (34 / 48, 8 / 48, -1 / 48)}


def inverse_dynamics(
    trajectory: Trajectory,
    servo: ServoModel,
    cycle: float,
    arm: Arm | None,
    gravity_feedforward: bool = True,
    controller: Arm | None = None,
) -> tuple[float, FloatArray]:
    """Time of the first set-point [s], set-points [rad], (n, dof), by the inverse of `Drives`."""
    if arm is None:
        raise InvalidInput(
            "The method inverse_dynamics needs the masses of the robot: give compensate the arm."
        )
    if arm.dof != trajectory.dof:
        raise InvalidInput(
            f"The arm {arm.name} has {arm.dof} joints, but the trajectory has {trajectory.dof}."
        )
    drives = Drives(
        arm=arm, servo=servo, gravity_feedforward=gravity_feedforward, controller=controller
    )
    ends = trajectory([0.0]), trajectory([trajectory.duration], side="left")
    still = np.zeros((1, arm.dof))
    # Friction at rest is unknown and assumed zero: the drives hold the arm against gravity only.
    hold, final = (drives.command(x, still, still) for x in ends)
    tail = np.arange(integrator_tail(servo, trajectory.duration, cycle)) * cycle

    def command_at(t: FloatArray) -> FloatArray:
        """The exact command at times, (n, dof)."""
        moving = (t >= 0) & (t < trajectory.duration)
        q = np.where((t < 0)[:, None], *ends)
        dq, ddq = np.zeros((2, *q.shape))
        q[moving], dq[moving], ddq[moving] = trajectory.motion(t[moving])
        return drives.command(q, dq, ddq, cycle / 2)

    def command(times: SetPointTimes, joints: IntArray) -> FloatArray:
        t = np.append(times.inside, trajectory.duration + times.after_end + tail)
        commands = final
        if len(t):
            exact = command_at(
                np.append(t[0] - [cycle, cycle / 2], np.stack([t, t + cycle / 2], 1))
            )
            set_points = _nearest(exact[2::2], exact[1::2], hold, final, servo.interpolation)
            commands = np.concatenate([set_points, final])
        return commands[:, joints]

    return advance_set_points(
        trajectory, time_advances(servo, cycle), cycle, command, hold=hold[0], from_rest=True
    )


def _nearest(
    points: FloatArray, halves: FloatArray, hold: FloatArray, final: FloatArray, interpolation: str
) -> FloatArray:
    """Set-points whose interpolation has the same means as a command about every set-point."""
    # For held set-points, these are means over their intervals. For lines and cubics, they have
    # triangular weights from the previous to the next set-point, so that lines are the
    # least-squares approximation of the command. Means are by Simpson's rule in each half: `points`
    # are at the set-points, `halves` half an interval before the first one and after each.
    if interpolation == "step":
        return np.asarray((halves[:-1] + 4 * points + halves[1:]) / 6)
    mean = (halves[:-1] + points + halves[1:]) / 3
    n, weights = len(mean), MEANS[interpolation]
    reach = len(weights) - 1
    for k in range(1, reach + 1):
        mean[:k] -= weights[k] * hold
        mean[max(n - k, 0) :] -= weights[k] * final
    solve_banded(np.tile(weights, (n, 1)), mean)
    return mean
