"""An execution: what the joints did."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import BoolArray, FloatArray
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.motion.taught import TaughtData


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Execution:
    """The motion of the joints under a plant, from the first set-point until rest.

    Args:
        arm: The arm that moved.
        taught: The set-points it was given.
        t: Regular times [s], (n,).
        q, dq, ddq: What the joints did, (n, dof).
        demand: Acceleration that the servo asked for, before saturation, (n, dof) [rad/s²].
        demand_range: Its lowest and its highest value at any time, not only at `t`, (2, dof)
            [rad/s²].
        saturated_time: Time for which each joint was saturated, (dof,) [s].
        torque: What the drives gave, (n, dof) [N m]; None from a plant without torques.
        torque_demand: The same before saturation; given with it.

    Raises:
        InvalidInput: Torques without what was asked for, or the other way round.
    """

    arm: Arm
    taught: TaughtData
    t: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray
    demand: FloatArray
    demand_range: FloatArray
    saturated_time: FloatArray
    torque: FloatArray | None = None
    torque_demand: FloatArray | None = None

    def __post_init__(self) -> None:
        if (self.torque is None) != (self.torque_demand is None):
            raise InvalidInput("An execution has both torque and torque_demand, or neither.")
        for name in ("t", "q", "dq", "ddq", "demand", "demand_range", "saturated_time"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))
        for name in ("torque", "torque_demand"):
            if getattr(self, name) is not None:
                object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))

    @property
    def peak_demand(self) -> FloatArray:
        """Largest amount of the demand at any time, either way, (dof,) [rad/s²]."""
        return np.asarray(np.abs(self.demand_range).max(axis=0))

    @property
    def tool(self) -> FloatArray:
        """Tool points [m], (n, dimension)."""
        return self.arm.forward(self.q)

    @property
    def tool_speed(self) -> FloatArray:
        """Tool speed [m/s], (n,)."""
        return np.asarray(np.linalg.norm(self.arm.tool_velocity(self.q, self.dq), axis=1))

    @property
    def saturated(self) -> BoolArray:
        """Where the servo asked for more than it got, (n, dof)."""
        asked, given = self.demand, self.ddq
        if self.torque is not None and self.torque_demand is not None:
            asked, given = self.torque_demand, self.torque
        return np.asarray(np.abs(asked - given) > 1e-9 * np.abs(asked))
