"""`Experiment`: simulation with rigid bodies whose properties the controller does not know."""

from __future__ import annotations

import dataclasses
from dataclasses import dataclass
from typing import Annotated, Any

import numpy as np

from armcontour.control.compensation import CompensationOptions, InverseDynamics
from armcontour.control.compensation.compensator import INVERSE
from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.quantities import (
    AtLeast,
    CoulombFrictions,
    JointArmatures,
    JointDampings,
    JointStiffnesses,
    ViscousFrictions,
)
from armcontour.robot import Arm, Limits
from armcontour.robot.chain import Payload
from armcontour.robot.servo import ServoModel
from armcontour.simulation import RigidBodyPlant
from armcontour.simulation.rigid_body_plant import DriveCycle, PositionNoise, check_damping

# Properties per joint, with their unit and their name in sentences.
PER_JOINT = {
    "armature": ("kg m²", "drive inertias of"),
    "viscous": ("N m s/rad", "viscous friction of"),
    "coulomb": ("N m", "Coulomb friction of"),
    "joint_stiffness": ("N m/rad", "a stiffness of joints of"),
    "joint_damping": ("N m s/rad", "a damping of joints of"),
}


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Experiment(Checked):
    """Options of a simulation of the arm as rigid bodies with `RigidBodyPlant`.

    The simulated robot can have another payload, friction or drive inertia than the arm, and joints
    that are not rigid. Values given here replace those of the arm. Plans, compensation and the
    controller of the robot use only the model of the arm: gravity feed-forward does not include
    this payload.

    Args:
        step: Cycle time of the drives [s].
        gravity_feedforward: Whether the controller adds the gravity torque of the arm.
        friction: Whether the simulation includes joint friction.
        noise: Standard deviation of measured joint positions [rad].
        seed: Seed of the noise.
        payload: Real payload at the tip, instead of the arm's payload; unknown to the controller.
            By default the arm's payload.
        armature: Real inertia of each drive, reflected to its joint [kg m²], one for all joints or
            one per joint; by default the arm's.
        viscous: Real viscous friction of the joints [N m s/rad], one for all joints or one per
            joint; by default the arm's.
        coulomb: Real Coulomb friction of the joints [N m], one for all joints or one per joint; by
            default the arm's.
        joint_stiffness: Stiffness between each drive and its link [N m/rad], one for all joints or
            one per joint; rigid by default. The drives must have inertias (armature), and encoders
            see the motors, not the links.
        joint_damping: Damping between each drive and its link [N m s/rad], one for all joints or
            one per joint; by default 0.1 ms times the stiffness.

    Raises:
        InvalidInput: A step or a noise out of range, a negative friction, inertia or damping, a
            stiffness that is not above zero, or values of a friction that is switched off.
    """

    step: DriveCycle = 2.5e-4
    gravity_feedforward: bool = True
    friction: bool = True
    noise: PositionNoise = 0.0
    seed: Annotated[int, AtLeast(0)] = 0
    payload: Payload | None = None
    armature: JointArmatures | None = None
    viscous: ViscousFrictions | None = None
    coulomb: CoulombFrictions | None = None
    joint_stiffness: JointStiffnesses | None = None
    joint_damping: JointDampings | None = None

    def _check_together(self) -> None:
        check_damping(self.joint_stiffness, self.joint_damping)
        if not self.friction and (self.viscous is not None or self.coulomb is not None):
            raise InvalidInput(
                "The experiment specifies friction (viscous or coulomb), but friction: false "
                "disables it. Remove one of them."
            )

    def for_joints(self, dof: int) -> Experiment:
        """The same experiment with one value per joint.

        Raises:
            InvalidInput: The number of values is not 1 or `dof`.
        """
        changes: dict[str, Any] = {
            name: checks.per_joint(name, values, dof, unit)
            for name, (unit, _) in PER_JOINT.items()
            if (values := getattr(self, name)) is not None
        }
        return dataclasses.replace(self, **changes)

    @property
    def unknown(self) -> str:
        """Text about properties of the robot that its controller does not model; may be empty."""
        parts = [] if self.payload is None else [f"a payload of {self.payload.mass:g} kg"]
        for name, (unit, words) in PER_JOINT.items():
            values = getattr(self, name)
            if values is not None:
                # Equal values of all joints are listed once.
                listed = values if np.ptp(values) else values.ravel()[:1]
                parts.append(f"{words} {', '.join(f'{x:g}' for x in listed.ravel())} {unit}")
        return "; ".join(parts)


def default_compensation(
    servo: ServoModel, arm: Arm, experiment: Experiment | None
) -> CompensationOptions:
    """Inverse of the plant that judges a run: of the arm's rigid bodies, or of the servo model."""
    if experiment is None or not arm.has_bodies or not servo.is_plain("second"):
        return INVERSE
    return InverseDynamics(gravity_feedforward=experiment.gravity_feedforward)


def build_plant(
    experiment: Experiment, arm: Arm, servo: ServoModel, limits: Limits | None = None
) -> RigidBodyPlant:
    """Build the simulated robot of an experiment.

    The plant has the payload, friction and drive inertias of the experiment if they are given,
    else those of the arm, and the joint stiffness of the experiment. Its controller uses the model
    `arm`: J of its loops (unless the servo gives one), gravity feed-forward, and torque limits that
    follow from acceleration limits.

    Raises:
        InvalidInput: The arm has no masses, or values do not fit the arm.
    """
    true_arm = arm.with_dynamics(
        payload=experiment.payload,
        armature=experiment.armature,
        viscous=experiment.viscous,
        coulomb=experiment.coulomb,
    )
    return RigidBodyPlant(
        true_arm,
        servo,
        limits,
        step=experiment.step,
        gravity_feedforward=experiment.gravity_feedforward,
        friction=experiment.friction,
        noise=experiment.noise,
        seed=experiment.seed,
        controller=arm,
        joint_stiffness=experiment.joint_stiffness,
        joint_damping=experiment.joint_damping,
    )
