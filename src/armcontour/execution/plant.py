"""What every plant can do: take taught data, and say what the joints did."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from armcontour import _checks, _memory
from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.motion import Execution, TaughtData
from armcontour.servo import ServoModel

# After the last set-point the joints get this long to come to rest [s], or this many durations.
PATIENCE = 60.0
PATIENCE_IN_DURATIONS = 10.0
# No joint of an arm is that fast [rad/s]: it falls, or its servo is unstable.
RUNAWAY = 1e3
# What a result takes while it is computed and judged [bytes], measured: of every joint six numbers,
# some of them copied once; of the tool its place, its errors and arc lengths.
RESULT, OF_JOINT = 150.0, 100.0
# Decay of what is left of a motion by so many time constants is rest, to REST_DISTANCE of a radian.
SETTLED = 20.0


class Plant(ABC):
    """A robot, simulated: an arm with its drives."""

    @abstractmethod
    def run(self, taught: TaughtData, resolution: float) -> Execution:
        """Execute taught data, from rest at its first set-point until rest at its last.

        Args:
            taught: The set-points.
            resolution: Largest time between two results [s].
        """

    def memory(self, span: float, period: float, resolution: float) -> float:
        """What an execution takes, about [bytes].

        Args:
            span: Time between the first and the last set-point [s].
            period: Command interval [s].
            resolution: Largest time between two results [s].
        """
        # A plant of somebody else's: its joints are not known.
        return results(span, period, resolution) * (RESULT + OF_JOINT)


def execute(
    taught: TaughtData,
    plant: Plant,
    *,
    resolution: float = 1e-3,
    memory: float = _memory.DEFAULT,
) -> Execution:
    """Execute taught data on a plant.

    Args:
        taught: The set-points.
        plant: The plant, never the model that the taught data was compensated with.
        resolution: Largest time between two results [s]; the motion itself does not depend on it.
        memory: What the program may take while it executes and judges [bytes].

    Raises:
        InvalidInput: Taught data for another number of joints, gains too large for its command
            interval, or more results than the memory takes.
        ExecutionError: The joints do not come to rest.
    """
    if not isinstance(taught, TaughtData):
        raise InvalidInput(
            f"execute needs TaughtData, as compensate gives it, not {type(taught).__name__}."
        )
    if not isinstance(plant, Plant):
        raise InvalidInput(f"A plant is needed to execute on, not {type(plant).__name__}.")
    fine = _checks.positive("resolution", resolution, "s")
    span = (len(taught.q) - 1) * taught.period
    refuse_too_long(plant, span, taught.period, fine, memory, 0.0)
    return plant.run(taught, fine)


def results(span: float, period: float, resolution: float) -> float:
    """How many results an execution has, about.

    Args:
        span: Time that it takes [s].
        period: Command interval [s].
        resolution: Largest time between two results [s].
    """
    return (span / period + 1) * max(period / resolution, 1.0)


def refuse_too_long(
    plant: Plant, span: float, period: float, resolution: float, memory: float, more: float
) -> None:
    """Refuse an execution of more results than the memory takes.

    Args:
        plant: The plant.
        span: Time between the first and the last set-point [s].
        period: Command interval [s].
        resolution: Largest time between two results [s].
        memory: Bound of the program's memory [bytes].
        more: What else the program has by then [bytes].

    Raises:
        InvalidInput: More.
    """
    _memory.refuse_above(
        memory,
        more + plant.memory(span, period, resolution),
        f"The simulation of {span:.4g} s of set-points, with results every {resolution:g} s,",
        "take a coarser resolution or a higher speed, leave the simulation out (--no-simulation)",
    )


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
    """Time to come to rest after set-points that take `duration` [s]."""
    return max(PATIENCE, PATIENCE_IN_DURATIONS * duration)
