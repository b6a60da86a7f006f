"""`Unknowns`: the parameters in which the rigid-body robots of a box differ, and those robots."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.robot import Arm
from armcontour.robot.chain import Payload
from armcontour.robot.servo import ServoModel
from armcontour.simulation.robustness.box import Uncertainty

# Kinds of unknowns, in the order of their columns.
KINDS = ("payload", "friction", "kp", "kv", "armature", "dead time")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unknowns:
    """The parameters in which the robots of a box differ; errors have one column for each.

    Args:
        box: The box.
        arm: The nominal arm, with masses.
        servo: The nominal servo, of second order, with values per joint.
        kinds: Kind of each parameter, of `KINDS`.
        joints: Joint of each parameter; -1 for one that all joints share.
        low, high: Least and largest error: relative, in s or in kg; of friction, the share, (k,).
    """

    box: Uncertainty
    arm: Arm
    servo: ServoModel
    kinds: tuple[str, ...]
    joints: tuple[int, ...]
    low: FloatArray
    high: FloatArray

    @classmethod
    def of(cls, box: Uncertainty, arm: Arm, servo: ServoModel) -> Unknowns:
        """Find the parameters of a box that vary.

        Args:
            box: The box.
            arm: The nominal arm.
            servo: The nominal servo.

        Raises:
            InvalidInput: The box does not fit the arm or the servo.
        """
        own = servo.for_joints(arm.dof)
        _refuse_unfit(box, arm, own)
        # Those that all joints share, before and after those of joints.
        first, last = {("payload", -1): np.asarray(box.payload)}, {}
        if box.friction_shared:
            rubs = np.any(box.viscous) or np.any(box.coulomb)
            first["friction", -1] = np.asarray(box.friction) * rubs
        if box.dead_time_shared:
            last["dead time", -1] = np.max(box.dead_time) * np.array([-1.0, 1.0])
        each = {
            (kind, j): ends
            for kind, (low, high) in _ranges(box, arm.dof).items()
            if (kind, -1) not in first | last
            for j, ends in enumerate(zip(low, high, strict=True))
        }
        found = (first | each | last).items()
        varied = [(*key, *ends) for key, ends in found if ends[1] > ends[0]]
        kinds, joints, least, most = zip(*varied, strict=True) if varied else ((),) * 4
        return cls(
            box=box,
            arm=arm,
            servo=own,
            kinds=kinds,
            joints=joints,
            low=checks.frozen_array(least),
            high=checks.frozen_array(most),
        )

    def __len__(self) -> int:
        """Number of parameters."""
        return len(self.kinds)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters, in messages."""
        return tuple(
            kind if j < 0 else f"{kind} of joint {j + 1}"
            for kind, j in zip(self.kinds, self.joints, strict=True)
        )

    def corners(self) -> FloatArray:
        """Errors in all corners of the box, (2^k, k)."""
        k = len(self)
        upper = np.arange(2**k)[:, None] >> np.arange(k) & 1
        return np.where(upper == 1, self.high, self.low).reshape(-1, k)

    def draw(self, samples: int, seed: int) -> FloatArray:
        """Errors of random robots, (samples, k).

        Args:
            samples: Number of robots.
            seed: Seed of the random numbers.
        """
        unit = np.random.default_rng(seed).uniform(size=(samples, len(self)))
        return np.asarray(self.low + unit * (self.high - self.low))

    def robot(self, errors: FloatArray) -> tuple[Arm, Arm, ServoModel]:
        """A robot: its arm, the arm as its controller knows it, and its servo.

        Args:
            errors: Errors of the parameters, (k,).
        """
        dof, servo, chain = self.arm.dof, self.servo, self.arm.chain
        assert chain is not None and servo.kv is not None
        of = {kind: np.zeros(dof) for kind in KINDS}
        for kind, j, error in zip(self.kinds, self.joints, errors, strict=True):
            of[kind][slice(None) if j < 0 else j] = error
        payload = self.payload(float(of["payload"][0]))
        true = self.arm.with_dynamics(
            payload=payload,
            viscous=np.asarray(chain.viscous) + of["friction"] * self.box.viscous,
            coulomb=np.asarray(chain.coulomb) + of["friction"] * self.box.coulomb,
            armature=np.asarray(chain.armature) * (1 + of["armature"]),
        )
        known = self.arm.with_dynamics(payload=payload) if self.box.payload_known else self.arm
        # Below zero by rounding only; larger errors have been refused.
        late = np.maximum(servo.dead_time + of["dead time"] * self.late_share, 0.0)
        return (
            true,
            known,
            servo.replace(
                kp=servo.kp * (1 + of["kp"]), kv=servo.kv * (1 + of["kv"]), dead_time=late
            ),
        )

    @property
    def late_share(self) -> FloatArray:
        """Error of each joint's dead time over that of a parameter, (dof,)."""
        late = np.broadcast_to(np.asarray(self.box.dead_time), (self.arm.dof,))
        most = float(late.max())
        return late / most if self.box.dead_time_shared and most > 0 else np.ones(self.arm.dof)

    def payload(self, more: float) -> Payload | None:
        """The load at the tip with so much more mass [kg]; None as long as there is none."""
        chain = self.arm.chain
        assert chain is not None
        load = chain.payload
        if load is None:
            return None if more == 0.0 else Payload(mass=more, center=chain.tool.position)
        mass = max(load.mass + more, 0.0)
        return Payload(mass=mass, center=load.center, inertia=load.inertia)


def _ranges(box: Uncertainty, dof: int) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Least and largest errors of the parameters of every joint, by their kinds, (dof,) each."""
    gains = box.gains_of(dof)
    given = np.broadcast_to(np.maximum(box.viscous, box.coulomb), (dof,)) > 0
    least, most = np.asarray(box.friction)
    armature, late = (np.broadcast_to(np.asarray(x), (dof,)) for x in (box.armature, box.dead_time))
    return {
        "friction": (least * given, most * given),
        "kp": (-gains[0], gains[0]),
        "kv": (-gains[1], gains[1]),
        "armature": (-armature, armature),
        "dead time": (-late, late),
    }


def _refuse_unfit(box: Uncertainty, arm: Arm, servo: ServoModel) -> None:
    """Refuse a box that does not fit the arm or the servo.

    Raises:
        InvalidInput: A shape does not fit, or a robot of the box cannot be.
    """
    dof, chain = arm.dof, arm.chain
    if chain is None or not arm.has_bodies:
        raise InvalidInput(
            "Rigid bodies need an arm with masses: give the arm's file masses and inertias, or "
            "certify with plant: servo."
        )
    servo.check_orders("A box of rigid bodies")
    if box.jitter:
        raise InvalidInput(
            "Rigid bodies are executed without jitter: leave jitter out of the box, or certify "
            "with plant: servo."
        )
    box.gains_of(dof)
    per_joint = {
        name: checks.per_joint(f"{name} of the box", getattr(box, name), dof, unit)
        for name, unit in (("viscous", "N m s/rad"), ("coulomb", "N m"), ("armature", ""))
    }
    least = np.asarray(box.friction)[0]
    for name, unit in (("viscous", "N m s/rad"), ("coulomb", "N m")):
        left = getattr(chain, name) + least * per_joint[name]
        if (left < 0).any():
            j = int(np.argmin(left))
            raise InvalidInput(
                f"The least share of friction, {least:g}, leaves joint {j + 1} a {name} friction "
                f"of {left[j]:g} {unit}: give the arm the friction in the middle of the range, or "
                "the box a share from 0 on."
            )
    box.dead_time_of(servo, dof)
    if np.any(per_joint["armature"] * (chain.armature == 0)):
        raise InvalidInput(
            f"The box has errors of drive inertias, but the arm {arm.name} has none: give its "
            "file armature, or leave armature out of the box."
        )
    box.check_payload(arm)
