"""Robot model of the identification: drives and torque derivatives for values of the unknowns."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

import numpy as np

from armcontour.control.identification.estimates import LOGARITHMIC
from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.robot import Arm, Payload
from armcontour.robot.drives import Drives
from armcontour.robot.drives.response import NominalMotion
from armcontour.robot.servo import ServoModel

CENTER = ("payload_center_x", "payload_center_y", "payload_center_z")
JOINT_UNKNOWNS = ("kp", "kv", "viscous", "coulomb", "armature")
# Time step of the numerical derivative of the command by the dead time [s].
DELAY_STEP = 1e-3
# If the Coulomb friction of a joint is 0, the derivative by it is proportional to the velocity up
# to this velocity [rad/s], because the joint may also stick.
CREEP_SPEED = 1e-3
# The centre of a payload with less mass than this [kg] is undefined.
LEAST_MASS = 1e-6


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotUnknowns:
    """The nominal robot, and the names, joints and nominal values of the unknowns."""

    arm: Arm
    servo: ServoModel  # Servo of order "second" at which the search starts, with values per joint
    # fixed_kv: if True, K_v is fixed and viscous friction is unknown; if False, viscous friction is
    # fixed and K_v is unknown. A log determines only the sum of J K_v and viscous friction.
    fixed_kv: bool
    gravity: str  # Gravity feed-forward of the controller, one of GRAVITIES
    lag: float = 0.0  # Delay of the torques of the loops, half of the drive cycle [s]
    # inertia: J with which the controller scales its loops [kg m²], (dof,).
    inertia: FloatArray = field(init=False)
    # names: names of the unknowns, keys of UNITS, (unknowns,). The unknowns of the payload's centre
    # are the deviations of the centre from its nominal position, times the mass [kg m].
    names: Any = field(init=False)
    # joints: joint index of each unknown, -1 for the whole robot, (unknowns,). The unknown
    # "armature" of the whole robot is a common factor of the nominal drive inertias.
    joints: IntArray = field(init=False)
    # nominal: nominal values of the unknowns, logarithms for gains, (unknowns,).
    nominal: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.servo.check_orders("The identification of rigid bodies")
        object.__setattr__(self, "inertia", Drives(arm=self.arm, servo=self.servo).inertia)
        chain, load = self.arm.dynamics.chain, self.load
        kv = np.asarray(self.servo.kv)
        initial: dict[str, Any] = {"kp": np.log(self.servo.kp)}
        initial |= {"viscous": chain.viscous} if self.fixed_kv else {"kv": np.log(kv)}
        initial |= {
            "coulomb": chain.coulomb,
            "payload_mass": load.mass,
            **dict.fromkeys(CENTER, 0.0),
            "armature": 1.0 if self.scales else np.zeros(self.arm.dof),
            "dead_time": float(np.mean(self.servo.dead_time)),
        }
        values = [np.atleast_1d(x) for x in initial.values()]
        names = np.repeat(list(initial), [len(x) for x in values])
        joints = [
            np.arange(len(x))
            if y in JOINT_UNKNOWNS and np.ndim(initial[y])
            else np.full(len(x), -1)
            for y, x in zip(initial, values, strict=True)
        ]
        nominal = checks.frozen_array(np.concatenate(values))
        for name, x in (("names", names), ("joints", np.concatenate(joints)), ("nominal", nominal)):
            object.__setattr__(self, name, x)

    @property
    def scales(self) -> bool:
        """True if one factor of all drive inertias is unknown, False if each inertia is unknown."""
        return bool(np.any(np.asarray(self.arm.dynamics.chain.armature) > 0))

    @property
    def load(self) -> Payload:
        """The nominal payload."""
        return self.arm.dynamics.chain.payload or Payload(mass=0.0)

    def mask(self, *names: str) -> BoolArray:
        """Mask of the unknowns with one of these names, (unknowns,)."""
        return np.isin(self.names, names)

    @property
    def relative(self) -> BoolArray:
        """Mask of the unknowns with relative tolerances: gains, factor of inertias, (unknowns,)."""
        return self.mask(*LOGARITHMIC) | (self.mask("armature") & (self.joints < 0))

    def value(self, values: FloatArray, name: str) -> FloatArray:
        """Values of the unknowns with this name, (joints or 1,)."""
        # Logarithms of gains are converted to gains. The array is empty if no unknown has this
        # name.
        selected = values[self.names == name]
        return np.asarray(np.exp(selected) if name in LOGARITHMIC else selected)

    def payload(self, values: FloatArray) -> Payload:
        """The nominal payload with mass and centre from the unknowns."""
        mass = max(float(self.value(values, "payload_mass")[0]), 0.0)
        center = np.array(self.load.center)
        if mass > LEAST_MASS:
            center = center + values[self.mask(*CENTER)] / mass
        return Payload(mass=mass, center=center, inertia=self.load.inertia)

    def make_arm(self, values: FloatArray) -> Arm:
        """The arm with payload, Coulomb friction and drive inertias, but no viscous friction."""
        armature = np.maximum(self.value(values, "armature"), 0.0)
        if self.scales:
            armature = armature * np.asarray(self.arm.dynamics.chain.armature)
        return self.arm.with_dynamics(
            payload=self.payload(values),
            armature=armature,
            coulomb=np.maximum(self.value(values, "coulomb"), 0.0),
            viscous=np.zeros(self.arm.dof),
        )

    def viscous(self, values: FloatArray) -> FloatArray:
        """Viscous friction [N m s/rad], (dof,)."""
        if self.fixed_kv:
            return self.value(values, "viscous")
        return np.array(self.arm.dynamics.chain.viscous)

    def drives(self, values: FloatArray) -> Drives:
        """The drives of the robot for values of the unknowns."""
        changes = {"kp": self.value(values, "kp"), "inertia": self.inertia}
        if not self.fixed_kv:
            changes["kv"] = self.value(values, "kv")
        return Drives(
            arm=self.make_arm(values),
            servo=self.servo.replace(**changes),
            gravity_feedforward=self.gravity != "none",
            controller=self.arm if self.gravity == "nominal" else None,
        )

    def torques(
        self, values: FloatArray, motion: NominalMotion, lead: FloatArray, slope: FloatArray
    ) -> FloatArray:
        """Derivatives of the joint torques by the unknowns, (n, dof, unknowns)."""
        # lead: command less position [rad], (n, dof). slope: velocity of the command [rad/s],
        # (n, dof).
        drives = self.drives(values)
        load, each = self._load_torques(drives, motion), np.eye(self.arm.dof)
        spring = drives.stiffness * (lead + self.lag * motion.dq)
        delayed = motion.dq - self.lag * motion.ddq
        # If the current Coulomb friction is 0, added friction acts against the velocity.
        slow = np.clip(motion.dq / CREEP_SPEED, -1.0, 1.0)
        friction = np.sign(motion.friction) * ~motion.held
        slides = np.where(motion.friction.any(axis=0), friction, slow)
        scaled = -np.asarray(self.arm.dynamics.chain.armature) * motion.ddq
        columns = {
            "kp": spring[..., None] * each,
            "kv": (spring - drives.damping * delayed)[..., None] * each,
            "viscous": -motion.dq[..., None] * each,
            "coulomb": -slides[..., None] * each,
            "payload_mass": -load[:, :, :1],
            **{x: -load[:, :, 1 + k : 2 + k] for k, x in enumerate(CENTER)},
            "armature": scaled[..., None] if self.scales else -motion.ddq[..., None] * each,
            "dead_time": -(drives.stiffness * slope)[..., None],
        }
        return np.concatenate([columns[x] for x in dict.fromkeys(self.names.tolist())], axis=2)

    def _load_torques(self, drives: Drives, motion: NominalMotion) -> FloatArray:
        """Derivatives of joint torques by mass and first moments of the payload, (n, dof, 4)."""
        # First column: per mass at the nominal centre [N m/kg]. Others: per mass times deviation of
        # the centre along the axes of the tip [N m/(kg m)].
        dynamics, nominal = drives.arm.dynamics, self.load.center
        load, tip = dynamics.chain.payload, dynamics.chain.tip
        center = nominal if load is None else load.center
        regressor = dynamics.last_body_regressor(
            motion.q, motion.dq, motion.ddq, gravity=self.gravity != "loaded"
        )
        # per: derivatives of the mass (1), first moments (3) and inertia (6) of the last body by
        # the mass and the first moments of the payload, (10, 4).
        per = np.zeros((10, 4))
        position, away = tip.position + tip.rotation @ center, tip.rotation @ (center - nominal)
        per[0, 0], per[1:4, 0], per[1:4, 1:] = 1.0, position - away, tip.rotation
        per[4:, 0] = _symmetric_inertia(position, position - 2 * away)
        for i in range(3):
            per[4:, 1 + i] = 2 * _symmetric_inertia(position, tip.rotation[:, i])
        return np.asarray(regressor @ per)


def _symmetric_inertia(a: FloatArray, b: FloatArray) -> FloatArray:
    """Symmetric part of `(a · b) 1 - a bᵀ` as xx, xy, yy, xz, yz, zz, (6,)."""
    product = (np.outer(a, b) + np.outer(b, a)) / 2
    full = np.trace(product) * np.eye(3) - product
    return np.asarray(full[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])
