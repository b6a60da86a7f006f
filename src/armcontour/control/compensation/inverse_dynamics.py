"""`InverseDynamics`: set-points by the inverse dynamics of the arm and its drives."""

# `armcontour.robot.nominal_robot` computes the exact command with which the drives follow the plan,
# at every time. Set-points are chosen so that their interpolation approximates this command best,
# see docs/concepts/compensation.md.

from __future__ import annotations

from typing import Annotated

import numpy as np

from armcontour.control.compensation.method import CompensationOptions
from armcontour.control.compensation.set_point_times import (
    SetPointTimes,
    advance_set_points,
    integrator_tail,
    time_advances,
)
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import ArmMismatch, InvalidInput
from armcontour.core.fields import declared
from armcontour.core.quantities import NO_KEY
from armcontour.core.quintics import solve_banded
from armcontour.motion import Trajectory
from armcontour.robot import Arm
from armcontour.robot.nominal_robot import Drives
from armcontour.robot.servo import ServoModel

# The mean of the interpolated command about a set-point is a weighted sum of this set-point and its
# neighbours at distances 1 and 2. The weights follow from Simpson's rule, because the middle of a
# line is the mean of its ends, and the middle of a cubic is
# `(-x[k-1] + 9 x[k] + 9 x[k+1] - x[k+2]) / 16`.
MEAN_WEIGHTS = {"linear": (4 / 6, 1 / 6), "cubic": (34 / 48, 8 / 48, -1 / 48)}


@declared(eq=False)
class InverseDynamics(CompensationOptions):
    """Inverse of drives that move the arm's rigid bodies; extends `CompensationOptions`.

    The method is most accurate for plans with jerk limits. With the first and the last set-point,
    the arm is at rest at the ends of the plan. The method requires an arm with masses and a servo
    of order "second".

    >>> options = ac.InverseDynamics(gravity_feedforward=True)
    >>> options.method
    'inverse_dynamics'

    Args:
        gravity_feedforward: Whether the controller adds the gravity torque.
        controller: The arm model of the controller, for example without a payload that was
            identified later; by default the nominal arm.
    """

    method = "inverse_dynamics"
    for_bodies = True
    gravity_feedforward: bool = True
    controller: Annotated[Arm | None, NO_KEY] = None

    @property
    def feeds_gravity_forward(self) -> bool:
        """True if the controller adds the gravity torque."""
        return self.gravity_feedforward

    def set_points(
        self, trajectory: Trajectory, servo: ServoModel, cycle: float, arm: Arm | None
    ) -> tuple[float, FloatArray]:
        """Compute set-points by the inverse dynamics of the arm and its drives."""
        return invert_dynamics(
            trajectory, servo, cycle, arm,
            gravity_feedforward=self.gravity_feedforward, controller=self.controller,
        )  # fmt: skip


def invert_dynamics(
    trajectory: Trajectory,
    servo: ServoModel,
    cycle: float,
    arm: Arm | None,
    *,
    gravity_feedforward: bool,
    controller: Arm | None,
) -> tuple[float, FloatArray]:
    """Return the first set-point's time [s], and set-points by inverse `Drives` [rad], (n, dof)."""
    if arm is None:
        raise InvalidInput(
            "The method inverse_dynamics requires an arm with masses, but no arm is given. "
            "Specify arm=."
        )
    if arm.dof != trajectory.dof:
        raise ArmMismatch(
            f"The arm and the trajectory must have the same joints, but the arm {arm.name} has "
            f"{arm.dof} joints and the trajectory has {trajectory.dof}."
        )
    drives = Drives(
        arm=arm, servo=servo, gravity_feedforward=gravity_feedforward, controller=controller
    )
    ends = trajectory([0.0]), trajectory([trajectory.duration], side="left")
    at_rest = np.zeros((1, arm.dof))
    # Friction at rest is unknown and assumed to be zero, so at rest the drives compensate only
    # gravity.
    hold, final = (drives.command(x, at_rest, at_rest) for x in ends)
    tail = np.arange(integrator_tail(servo, trajectory.duration, cycle)) * cycle

    def command_at(t: FloatArray) -> FloatArray:
        """Return the exact command at times t [rad], (n, dof)."""
        moving = (t >= 0) & (t < trajectory.duration)
        q = np.where((t < 0)[:, None], *ends)
        dq, ddq = np.zeros((2, *q.shape))
        q[moving], dq[moving], ddq[moving] = trajectory.motion(t[moving])
        return drives.command(q, dq, ddq, cycle / 2)

    def command(times: SetPointTimes, joints: IntArray) -> FloatArray:
        """Return the set-points of some joints at these times [rad], (n, len(joints))."""
        t = np.append(times.inside, trajectory.duration + times.after_end + tail)
        commands = final
        if len(t):
            exact = command_at(
                np.append(t[0] - [cycle, cycle / 2], np.stack([t, t + cycle / 2], 1))
            )
            set_points = _solve_set_points(
                exact[2::2], exact[1::2], hold, final, servo.interpolation
            )
            commands = np.concatenate([set_points, final])
        return commands[:, joints]

    return advance_set_points(
        trajectory, time_advances(servo, cycle), cycle, command, hold=hold[0], from_rest=True
    )


def _solve_set_points(
    points: FloatArray, halves: FloatArray, hold: FloatArray, final: FloatArray, interpolation: str
) -> FloatArray:
    """Return set-points whose interpolation has the means of the exact command [rad], (n, dof).

    For held set-points, a mean is over the interval of the set-point. For lines and cubics, a mean
    has triangular weights from the previous to the next set-point. With these weights, lines are
    the least-squares approximation of the command. Means are computed by Simpson's rule.

    - `points`: command at the set-points [rad], (n, dof).
    - `halves`: command half an interval before the first set-point and half an interval after each
      set-point [rad], (n + 1, dof).
    - `hold`, `final`: set-points before the first and after the last one [rad], (1, dof).
    - `interpolation`: "step", "linear" or "cubic".
    """
    if interpolation == "step":
        return np.asarray((halves[:-1] + 4 * points + halves[1:]) / 6)
    mean = (halves[:-1] + points + halves[1:]) / 3
    n = len(mean)
    weights = MEAN_WEIGHTS[interpolation]
    reach = len(weights) - 1
    for k in range(1, reach + 1):
        mean[:k] -= weights[k] * hold
        mean[max(n - k, 0) :] -= weights[k] * final
    solve_banded(np.tile(weights, (n, 1)), mean)
    return mean
