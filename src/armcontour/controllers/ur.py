"""Universal Robots as a controller: `servoj` every 2 ms, with RTDE and a program on the robot."""

from __future__ import annotations

from pathlib import Path as FilePath

import numpy as np

from armcontour.controllers.controller import Controller, FeederCommand
from armcontour.core.checks import FloatArray
from armcontour.core.fields import checked
from armcontour.core.result import Row
from armcontour.motion import Servoj
from armcontour.motion.nearest_commands import command_bounds
from armcontour.robot import Arm, Limits
from armcontour.robot.limit_use import use_of


class Ur(Controller):
    """A robot from Universal Robots in remote control.

    Written from the vendor's documentation and tested against a double of its protocol. It has
    never run on a robot.

    Args:
        address: Address of the robot.
        servoj: Arguments of `servoj`.
    """

    name = "ur"
    cycle = 2e-3
    ahead = 5

    @checked
    def __init__(self, address: str, servoj: Servoj = Servoj()) -> None:
        super().__init__(address)
        self.servoj = servoj

    def _command(self, arm: Arm, start: FloatArray, folder: FilePath) -> FeederCommand:
        """Return the command of the feeder, with the arguments of `servoj`."""
        command, environment = super()._command(arm, start, folder)
        values = [repr(self.servoj.lookahead), repr(self.servoj.gain)]
        return [*command, *values], environment

    def check(self, arm: Arm, limits: Limits, q: FloatArray) -> list[Row]:
        """Compare the set-points with ranges and speeds of the arm."""
        self._check_within(q, command_bounds(arm.limits, arm.dof)[:2])
        use = use_of("joint_velocity", arm.limits, np.diff(q, axis=0) / self.cycle)
        return [Row("ur.speed", float(use.ratio.max()), "1", "speed of the robot's limit")]
