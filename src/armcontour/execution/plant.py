"""The base class of plants, and the function `execute` that runs taught data on a plant."""

from __future__ import annotations

from abc import ABC, abstractmethod

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.motion import Execution, FineMotion, TaughtData
from armcontour.servo import ServoModel

# Time that the joints get to come to rest after the last set-point [s], or in durations.
PATIENCE = 60.0
PATIENCE_IN_DURATIONS = 10.0
# A joint at this velocity [rad/s] falls, or its servo is unstable.
RUNAWAY = 1e3


class Plant(ABC):
    """A simulated robot: an arm with its drives."""

    @abstractmethod
    def run(self, taught: TaughtData, resolution: float) -> Execution:
        """Execute taught data from rest at the first set-point until rest at the last one.

        Args:
            taught: The set-points.
            resolution: Largest time between two results [s].
        """

    def motion_between(self, executed: Execution, which: IntArray) -> FineMotion | None:
        """The motion from some results of an execution on this plant to the next ones.

        Args:
            executed: The execution, with all of its results.
            which: Indices of the results before, increasing, (m,).

        Returns:
            The motion; None where the plant does not know it, as by default.
        """
        return None

    def __repr__(self) -> str:
        """The class, and the arm if it has one."""
        arm = getattr(self, "arm", None)
        return f"{type(self).__name__}({'' if arm is None else repr(arm)})"


def execute(
    taught: TaughtData,
    plant: Plant,
    *,
    resolution: float = 1e-3,
) -> Execution:
    """Execute taught data on a plant.

    Args:
        taught: The set-points.
        plant: The plant, which must not be the model by which the taught data was compensated.
        resolution: Largest time between two results [s]; it does not change the motion.

    Raises:
        InvalidInput: The taught data is for another number of joints, the gains are too large for
            the command interval, or there would be too many results.
        ExecutionError: Rigid bodies do not come to rest, or a drive is too weak to hold the arm.
    """
    if not isinstance(taught, TaughtData):
        raise InvalidInput(
            f"execute needs TaughtData, as compensate gives it, not {type(taught).__name__}."
        )
    _checks.refuse_other("execute", plant, Plant, "such as ServoPlant(arm, servo)")
    fine = _checks.positive("resolution", resolution, "s")
    span = (len(taught.q) - 1) * taught.period
    _checks.refuse_too_many(
        f"The simulation of {span:.4g} s of set-points with results every {fine:g} s",
        (span / taught.period + 1) * max(taught.period / fine, 1.0) * taught.q.shape[1],
        "take a coarser resolution or a higher speed, or leave the simulation out "
        "(--no-simulation)",
    )
    return plant.run(taught, fine)


def refuse_other_joints(taught: TaughtData, arm: Arm) -> None:
    """Refuse taught data whose number of joints is not that of the arm.

    Raises:
        InvalidInput: The numbers differ, or it is no taught data.
    """
    _checks.refuse_other("A plant", taught, TaughtData, "as compensate gives it")
    if taught.q.shape[1] != arm.dof:
        raise InvalidInput(
            f"The taught data is for {taught.q.shape[1]} joints, but the arm {arm.name} has "
            f"{arm.dof}."
        )


def refuse_too_heavy(weight: FloatArray, limit: FloatArray, where: str, t: float) -> None:
    """Refuse an arm whose drives are too weak to hold it against gravity.

    Args:
        weight: Absolute torques against gravity, (dof,) [N m].
        limit: Torque limits of the drives, (dof,) [N m].
        where: Name of the position, for the message.
        t: Time at which the arm is there [s].

    Raises:
        ExecutionError: A torque exceeds its limit.
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


def count_intervals(taught: TaughtData, servo: ServoModel) -> int:
    """Number of command intervals until the last set-point has reached all joints."""
    late = int(np.ceil(servo.dead_time.max() / taught.period * (1 - 1e-12)))
    return len(taught.q) - 1 + late


def patience(duration: float) -> float:
    """Time allowed for coming to rest after a motion of a duration [s]."""
    return max(PATIENCE, PATIENCE_IN_DURATIONS * duration)
