"""The robot of an identification: from its unknowns to drives, and to torques per unknown."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.arms import Arm, Payload
from armcontour.drives import Drives
from armcontour.drives.simulation import Simulation
from armcontour.servo import ServoModel

# What the controller adds against gravity: the torque of the nominal arm, that of the arm with its
# true load, or nothing.
GRAVITIES = ("nominal", "loaded", "none")
UNITS = {
    "kp": "1/s",
    "kv": "1/s",
    "viscous": "N m s/rad",
    "coulomb": "N m",
    "payload_mass": "kg",
    "payload_center": "m",
    "armature": "kg m²",
    "dead_time": "s",
}
AXES = "xyz"
# Gains are sought as logarithms.
LOGARITHMIC = ("kp", "kv")
# Time by which commands are shifted for the derivative by the dead time [s].
SHIFT = 1e-3
# A joint without friction whose speed is below this [rad/s] might as well stick.
CREEP = 1e-3
# Below this mass [kg] a payload has no centre.
LEAST_MASS = 1e-6


@dataclass(frozen=True, slots=True)
class Unknown:
    """A parameter that is sought.

    Args:
        name: A key of UNITS. Of the payload's centre the mass times its deviation from the nominal
            centre is sought [kg m].
        index: Joint or axis, from 0; -1 for a parameter of the whole robot. Of "armature" -1 means
            a factor of all nominal drive inertias.
    """

    name: str
    index: int = -1


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Model:
    """The nominal robot, and what is sought of it.

    Args:
        arm: The nominal arm.
        servo: The servo at which the search starts, of order "second", with values per joint.
        keep_kv: Whether K_v is kept and viscous friction sought, or the other way round: a log
            shows their sum only.
        gravity: What the controller adds against gravity, one of GRAVITIES.
        lag: Time by which the torques of the loops come late [s].

    Attributes:
        inertia: J, with which the controller scales its loops [kg m²], (dof,).
        unknowns: What is sought.
        nominal: Nominal values of the unknowns, (unknowns,).
    """

    arm: Arm
    servo: ServoModel
    keep_kv: bool
    gravity: str
    lag: float = 0.0
    inertia: FloatArray = field(init=False)
    unknowns: tuple[Unknown, ...] = field(init=False)
    nominal: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        self.servo.refuse_mixed("The identification of rigid bodies")
        object.__setattr__(self, "inertia", Drives(arm=self.arm, servo=self.servo).inertia)
        chain, load = self.arm.dynamics.chain, self.load
        kv = np.asarray(self.servo.kv)
        loops = {"kp": np.log(self.servo.kp)}
        loops |= {"viscous": np.asarray(chain.viscous)} if self.keep_kv else {"kv": np.log(kv)}
        loops["coulomb"] = np.asarray(chain.coulomb)
        known = [
            (Unknown(name, j), float(x))
            for name, values in loops.items()
            for j, x in enumerate(np.asarray(values))
        ]
        known.append((Unknown("payload_mass"), load.mass))
        known += [(Unknown("payload_center", i), 0.0) for i in range(3)]
        if self.scales:
            known.append((Unknown("armature"), 1.0))
        else:
            known += [(Unknown("armature", j), 0.0) for j in range(self.arm.dof)]
        known.append((Unknown("dead_time"), float(np.mean(self.servo.dead_time))))
        object.__setattr__(self, "unknowns", tuple(x for x, _ in known))
        object.__setattr__(self, "nominal", _checks.lock_floats([x for _, x in known]))

    @property
    def scales(self) -> bool:
        """Whether one factor of the nominal drive inertias is sought; else those of all joints."""
        return bool(np.any(np.asarray(self.arm.dynamics.chain.armature) > 0))

    @property
    def load(self) -> Payload:
        """The nominal payload."""
        return self.arm.dynamics.chain.payload or Payload(mass=0.0)

    def value(self, values: FloatArray, name: str) -> FloatArray:
        """The values of the unknowns of one name, (joints, axes or 1,); empty if not sought."""
        found = [x for u, x in zip(self.unknowns, values, strict=True) if u.name == name]
        return np.exp(found) if name in LOGARITHMIC else np.array(found)

    def payload(self, values: FloatArray) -> Payload:
        """The payload: the nominal one with another mass and centre, with the same inertia."""
        mass = max(float(self.value(values, "payload_mass")[0]), 0.0)
        center = np.array(self.load.center)
        if mass > LEAST_MASS:
            center = center + self.value(values, "payload_center") / mass
        return Payload(mass=mass, center=center, inertia=self.load.inertia)

    def with_bodies(self, values: FloatArray) -> Arm:
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
        if self.keep_kv:
            return self.value(values, "viscous")
        return np.array(self.arm.dynamics.chain.viscous)

    def drives(self, values: FloatArray) -> Drives:
        """The drives of the robot with some values of the unknowns."""
        changes = {"kp": self.value(values, "kp"), "inertia": self.inertia}
        if not self.keep_kv:
            changes["kv"] = self.value(values, "kv")
        return Drives(
            arm=self.with_bodies(values),
            servo=self.servo.replace(**changes),
            gravity_feedforward=self.gravity != "none",
            known=self.arm if self.gravity == "nominal" else None,
        )

    def torques(
        self, values: FloatArray, motion: Simulation, lead: FloatArray, slope: FloatArray
    ) -> FloatArray:
        """Torques on the joints per unit of the unknowns, (n, dof, unknowns).

        Args:
            values: Values of the unknowns.
            motion: The motion with these values.
            lead: Command less position [rad], (n, dof).
            slope: Rate of the command [rad/s], (n, dof).
        """
        drives = self.drives(values)
        load, armature = self._load_torques(drives, motion), self.arm.dynamics.chain.armature
        found = np.zeros((*motion.q.shape, len(self.unknowns)))
        spring = drives.stiffness * (lead + self.lag * motion.dq)
        for k, x in enumerate(self.unknowns):
            j = x.index
            if x.name == "kp":
                found[:, j, k] = spring[:, j]
            elif x.name == "kv":
                late = motion.dq[:, j] - self.lag * motion.ddq[:, j]
                found[:, j, k] = spring[:, j] - drives.damping[j] * late
            elif x.name == "viscous":
                found[:, j, k] = -motion.dq[:, j]
            elif x.name == "coulomb":
                # Without friction so far, it would act against the velocity.
                acts = np.sign(motion.friction[:, j]) * ~motion.held[:, j]
                if not np.any(motion.friction[:, j]):
                    acts = np.clip(motion.dq[:, j] / CREEP, -1.0, 1.0)
                found[:, j, k] = -acts
            elif x.name == "payload_mass":
                found[:, :, k] = -load[:, :, 0]
            elif x.name == "payload_center":
                found[:, :, k] = -load[:, :, 1 + j]
            elif x.name == "armature" and j < 0:
                found[:, :, k] = -np.asarray(armature) * motion.ddq
            elif x.name == "armature":
                found[:, j, k] = -motion.ddq[:, j]
            else:
                found[:, :, k] = -drives.stiffness * slope
        return found

    def _load_torques(self, drives: Drives, motion: Simulation) -> FloatArray:
        """Joint torques per mass of the payload and per mass times deviation of its centre.

        Returns:
            Torques per mass at the nominal centre [N m/kg], and per moment along the tip's axes
            [N m/(kg m)], (n, dof, 4).
        """
        dynamics, nominal = drives.arm.dynamics, self.load.center
        load, tip = dynamics.chain.payload, dynamics.chain.tip
        center = nominal if load is None else load.center
        found = dynamics.last_body_regressor(
            motion.q, motion.dq, motion.ddq, gravity=self.gravity != "loaded"
        )
        # Mass, first moments and inertia of the last body per mass and moment of the payload.
        per = np.zeros((10, 4))
        place, away = tip.position + tip.rotation @ center, tip.rotation @ (center - nominal)
        per[0, 0], per[1:4, 0], per[1:4, 1:] = 1.0, place - away, tip.rotation
        per[4:, 0] = _inertia(place, place - 2 * away)
        for i in range(3):
            per[4:, 1 + i] = 2 * _inertia(place, tip.rotation[:, i])
        return np.asarray(found @ per)


def _inertia(a: FloatArray, b: FloatArray) -> FloatArray:
    """The symmetric part of `a b 1 - a bᵀ` as xx, xy, yy, xz, yz, zz, (6,)."""
    product = (np.outer(a, b) + np.outer(b, a)) / 2
    full = np.trace(product) * np.eye(3) - product
    return np.asarray(full[[0, 0, 1, 0, 1, 2], [0, 1, 1, 2, 2, 2]])
