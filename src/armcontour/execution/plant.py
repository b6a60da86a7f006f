"""What every plant can do: take taught data, and say what the joints did."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.motion import Execution, TaughtData
from armcontour.servo import ServoModel

# Behind the last set-point the joints get this long to come to rest [s], or this many durations.
PATIENCE = 60.0
PATIENCE_IN_DURATIONS = 10.0
# No joint of an arm is that fast [rad/s]: it falls, or its servo is unstable.
RUNAWAY = 1e3


class Plant(ABC):
    """A robot, simulated: an arm with its drives."""

    @abstractmethod
    def run(self, taught: TaughtData, resolution: float) -> Execution:
        """Execute taught data, from rest at its first set-point until rest at its last.

        Args:
            taught: The set-points.
            resolution: Largest time between two results [s].
        """


def execute(taught: TaughtData, plant: Plant, *, resolution: float = 1e-3) -> Execution:
    """Execute taught data on a plant.

    Args:
        taught: The set-points.
        plant: The plant, never the model that the taught data was compensated with.
        resolution: Largest time between two results [s]; the motion itself does not depend on it.

    Raises:
        InvalidInput: Taught data for another number of joints.
        ExecutionError: The joints do not come to rest.
    """
    if not isinstance(taught, TaughtData):
        raise InvalidInput(
            f"execute needs TaughtData, as compensate gives it, not {type(taught).__name__}."
        )
    if not isinstance(plant, Plant):
        raise InvalidInput(f"A plant is needed to execute on, not {type(plant).__name__}.")
    return plant.run(taught, _checks.positive("resolution", resolution, "s"))


def refuse_other_joints(taught: TaughtData, arm: Arm) -> None:
    """Refuse taught data for another arm.

    Raises:
        InvalidInput: Another number of joints.
    """
    if taught.q.shape[1] != arm.dof:
        raise InvalidInput(
            f"The taught data is for {taught.q.shape[1]} joints, but the arm {arm.name} has "
            f"{arm.dof}."
        )


def refuse_too_heavy(weight: FloatArray, limit: FloatArray, where: str, t: float) -> None:
    """Refuse an arm that its drives do not hold.

    Args:
        weight: Amounts of torque against gravity, (dof,) [N m].
        limit: What the drives give, (dof,) [N m].
        where: A place, for the message.
        t: When the arm is there [s].

    Raises:
        ExecutionError: A weight above its limit.
    """
    heavy = weight > limit
    if heavy.any():
        j = int(np.argmax(heavy))
        raise ExecutionError(
            f"Joint {j + 1} takes {weight[j]:.4g} N m to be held against gravity at {where}, but "
            f"its drive gives at most {limit[j]:.4g} N m: raise its torque limit or lighten its "
            "load.",
            t=t,
            joint=j + 1,
            limit="joint_torque",
            needed=float(weight[j]),
            allowed=float(limit[j]),
        )


def intervals(taught: TaughtData, servo: ServoModel) -> int:
    """Command intervals until the last set-point has reached every joint."""
    late = int(np.ceil(servo.dead_time.max() / taught.period * (1 - 1e-12)))
    return len(taught.q) - 1 + late


def patience(duration: float) -> float:
    """Time to come to rest behind set-points that take `duration` [s]."""
    return max(PATIENCE, PATIENCE_IN_DURATIONS * duration)
