"""`Experiment`: simulation of a run on the arm's rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass

from armcontour.control.compensation import CompensationOptions, InverseDynamics
from armcontour.control.compensation.compensator import INVERSE
from armcontour.core.fields import Checked
from armcontour.robot import Arm, Limits
from armcontour.robot.chain import Payload
from armcontour.robot.servo import ServoModel
from armcontour.simulation import RigidBodyPlant
from armcontour.simulation.rigid_body_plant import DEFAULT_STEP, DriveCycle


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Experiment(Checked):
    """Options of a simulation of the arm as rigid bodies with `RigidBodyPlant`.

    Plans, compensation and the controller of the robot use only the model of the arm: gravity
    feed-forward does not include this payload.

    Args:
        step: Cycle time of the drives [s].
        payload: Real payload at the tip, instead of the arm's payload; unknown to the controller.
            By default the arm's payload.

    Raises:
        InvalidInput: A step out of range.
    """

    step: DriveCycle = DEFAULT_STEP
    payload: Payload | None = None

    @property
    def unknown(self) -> str:
        """Text about properties of the robot that its controller does not model; may be empty."""
        return "" if self.payload is None else f"a payload of {self.payload.mass:g} kg"


def default_compensation(
    servo: ServoModel, arm: Arm, experiment: Experiment | None
) -> CompensationOptions:
    """Inverse of the plant that judges a run: of the arm's rigid bodies, or of the servo model."""
    if experiment is None or not arm.has_bodies or not servo.is_plain("second"):
        return INVERSE
    return InverseDynamics()


def build_plant(
    experiment: Experiment, arm: Arm, servo: ServoModel, limits: Limits, fed: bool
) -> RigidBodyPlant:
    """Build the simulated robot of an experiment.

    The plant has the payload of the experiment if it is given, else that of the arm. Its controller
    uses the model `arm`: J of its loops (unless the servo gives one), gravity feed-forward if
    `fed`, and torque limits that follow from acceleration limits.

    Raises:
        InvalidInput: The arm has no masses, or values do not fit the arm.
    """
    return RigidBodyPlant(
        arm.with_dynamics(payload=experiment.payload),
        servo,
        limits,
        step=experiment.step,
        gravity_feedforward=fed,
        controller=arm,
    )
