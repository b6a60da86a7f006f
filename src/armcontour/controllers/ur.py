"""Universal Robots as a controller: `servoj` every 2 ms, with RTDE and a program on the robot."""

from __future__ import annotations

import numpy as np

from armcontour.controllers.controller import Controller
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerRefused
from armcontour.core.render import number
from armcontour.core.result import Row
from armcontour.motion.nearest_commands import find_range_or_speed_excess
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import use_of

DOF = 6


class Ur(Controller):
    """A robot from Universal Robots in remote control.

    Written from the vendor's documentation and tested against a double of its protocol. It has
    never run on a robot.

    Args:
        address: Address of the robot.
    """

    name = "ur"
    cycle = 2e-3
    ahead = 5

    def check(self, arm: Arm, limits: Limits, q: FloatArray) -> list[Row]:
        """Compare the number of joints, and the set-points with ranges and speeds of the arm."""
        self._check_joints(arm, DOF)
        excess = find_range_or_speed_excess(q, self.cycle, arm.limits)
        if excess is not None:
            joint, needed, allowed = excess.joint, excess.needed, excess.allowed
            sentence = (
                f"Set-points move joint {joint + 1} with {number(needed, 'rad/s')}, above the "
                f"{number(allowed, 'rad/s')} of the robot: lower joint_velocity, or give the plan "
                "a larger reserve."
            )
            if not excess.order:
                sentence = (
                    f"A set-point of joint {joint + 1} is {number(abs(needed - allowed), 'rad')} "
                    "outside the range of the robot: move the path."
                )
            raise ControllerRefused(sentence, joint=joint, needed=needed, allowed=allowed)
        use = use_of("joint_velocity", arm.limits, np.diff(q, axis=0) / self.cycle)
        return [Row("ur.speed", float(use.ratio.max()), "1", "speed of the robot's limit")]
