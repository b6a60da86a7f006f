"""`NoCompensation`: set-points on the trajectory."""

from __future__ import annotations

import numpy as np

from armcontour.control.compensation.method import CompensationOptions
from armcontour.control.compensation.set_point_times import set_point_times
from armcontour.core.checks import FloatArray
from armcontour.core.fields import declared
from armcontour.motion import Trajectory
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel


@declared(eq=False)
class NoCompensation(CompensationOptions):
    """Set-points on the trajectory without time advance; options as in `CompensationOptions`.

    >>> sent = ac.compensate(planned, servo, ac.NoCompensation())
    >>> bool(np.allclose(sent.q[-1], planned(planned.duration)))
    True
    """

    method = "none"
    compensates = False
    is_local = True

    def set_points(
        self, trajectory: Trajectory, servo: ServoModel, cycle: float, arm: Arm | None
    ) -> tuple[float, FloatArray]:
        """Compute set-points on the trajectory, of which the last one is its end."""
        t = set_point_times(trajectory, cycle).inside
        end = trajectory([trajectory.duration], side="left")
        return 0.0, np.concatenate([trajectory(t), end])
