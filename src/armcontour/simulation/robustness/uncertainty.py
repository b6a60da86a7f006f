"""`Uncertainty`: error ranges of the parameters; `Unknowns`: parameters of rigid-body robots."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, quantities
from armcontour.core.quantities import (
    COULOMB,
    DEAD_TIME,
    GAIN_ERROR,
    MORE_PAYLOAD,
    SHARE,
    VISCOUS,
    Axes,
    Duration,
)
from armcontour.core.render import number_range
from armcontour.robot import Arm
from armcontour.robot.chain import Payload
from armcontour.robot.servo import ServoModel

# Clauses on the errors of joints: independent, or shared.
EACH = (" (independent for each joint)", " (the same error for all joints)")


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertainty(Checked):
    """The uncertainty set (box): ranges of the errors of a robot's parameters.

    Errors are distributed uniformly over their ranges. Friction and armature apply to rigid bodies
    only.

    Args:
        gains: Relative error of the servo gains, plus and minus, 0.1 for 10 %: one number, one per
            joint (for kp and kv), or two rows for kp and for kv, (2, dof) or (2, 1). The errors of
            all joints and loops are independent.
        dead_time: Error of the dead time, plus and minus [s], one number or one per joint.
        dead_time_shared: If true, the dead times of all joints have the same error, in proportion
            to `dead_time`; otherwise their errors are independent.
        payload: Error of the payload's mass [kg]: one number for plus and minus, or the smallest
            and the largest error, such as 0 and 2 for up to 2 kg of unknown payload. The mass is at
            the tool, or for rigid bodies at the centre of the payload.
        payload_known: If true, the controller uses the true payload for the gravity torque; for
            rigid bodies only.
        jitter: Error of the arrival time of a set-point, plus and minus [s], less than half a
            cycle. The errors of the set-points are independent, except for the first set-point,
            which has none. All joints have the same error.
        viscous: Unknown viscous friction of the joints [N m s/rad], one number or one per joint.
        coulomb: Unknown Coulomb friction of the joints [N m], one number or one per joint.
        friction: Smallest and largest fraction of `viscous` and `coulomb` that a joint has in
            addition to the friction of the nominal arm.
        friction_shared: If true, all joints have the same fraction; otherwise the fractions are
            independent.
        armature: Relative error of the drives' inertias, plus and minus, one number or one per
            joint; independent for each joint.

    Raises:
        InvalidInput: A largest error is negative, the relative error of a gain or an armature is
            not below 1, or the ends of a range are not in ascending order.
    """

    gains: Annotated[FloatArray | float, GAIN_ERROR, Axes(...)] = 0.0
    dead_time: Annotated[FloatArray | float, DEAD_TIME] = 0.0
    dead_time_shared: bool = False
    payload: Annotated[FloatArray | float, MORE_PAYLOAD] = 0.0
    payload_known: bool = False
    jitter: Duration = 0.0
    viscous: Annotated[FloatArray | float, VISCOUS] = 0.0
    coulomb: Annotated[FloatArray | float, COULOMB] = 0.0
    friction: Annotated[FloatArray | float, SHARE] = (0.0, 1.0)  # type: ignore[assignment]
    friction_shared: bool = False
    armature: Annotated[FloatArray | float, GAIN_ERROR] = 0.0

    def _check_together(self) -> None:
        shape = np.shape(self.gains)
        if len(shape) > 2 or 0 in shape:
            raise InvalidInput(
                f"gains of a box must have the shape (), (dof,) or (2, dof), but have {shape}."
            )
        for name in ("payload", "friction"):
            object.__setattr__(self, name, _range(name, getattr(self, name)))

    def __str__(self) -> str:
        """Ranges of the errors, and whether all joints share an error."""
        rubs = self.friction_shared
        shared = {"dead_time": self.dead_time_shared, "viscous": rubs, "coulomb": rubs}
        signs = {"payload": "", "viscous": "up to ", "coulomb": "up to "}
        ranges = {
            x: np.unique(getattr(self, x)) for x in quantities(Uncertainty) if x != "friction"
        }
        return "; ".join(
            f"{name.replace('_', ' ')} {signs.get(name, '±')}"
            + number_range(values, quantities(Uncertainty)[name].unit)
            + ("" if name in ("payload", "jitter") else EACH[shared.get(name, False)])
            for name, values in ranges.items()
            if values.any()
        )

    def gains_of(self, dof: int) -> FloatArray:
        """Largest relative errors of kp and kv, (2, dof)."""
        try:
            return np.broadcast_to(np.asarray(self.gains), (2, dof))
        except ValueError:
            raise InvalidInput(
                f"gains of the box must be one number, {dof} numbers (one per joint), or two rows "
                f"for kp and kv, but have the shape {np.shape(self.gains)}."
            ) from None

    def dead_time_of(self, servo: ServoModel, dof: int) -> FloatArray:
        """Largest errors of the dead times [s], (dof,), which must not exceed the dead times."""
        error = checks.per_joint("dead_time of the box", self.dead_time, dof, "s")
        if (servo.dead_time < error).any():
            j = int(np.argmin(servo.dead_time - error))
            raise InvalidInput(
                f"The error of a dead time must not exceed the dead time, but joint {j + 1} has a "
                f"dead time of {servo.dead_time[j]:g} s and an error of {error[j]:g} s. Specify a "
                "longer dead time of the servo (an equal change for all joints does not change "
                "contours), or a smaller error of the box."
            )
        return error

    def check_payload(self, arm: Arm) -> None:
        """Raise an error if the payload can become negative."""
        load = None if arm.chain is None else arm.chain.payload
        lowest, highest = np.asarray(self.payload).tolist()
        carried, reduction = 0.0 if load is None else load.mass, -lowest
        if reduction > carried:
            raise InvalidInput(
                f"The error of the payload may reduce it by at most the {carried:g} kg that the "
                f"arm {arm.name} carries, but the box reduces it by {reduction:g} kg. Specify the "
                "payload in the middle of the range for the arm, or a range for the box, such as 0 "
                f"kg to {highest:g} kg.",
                needed=reduction,
                allowed=carried,
            )

    @property
    def of_bodies(self) -> tuple[str, ...]:
        """Names of the specified fields that apply only to rigid bodies."""
        errors = {"viscous": self.viscous, "coulomb": self.coulomb, "armature": self.armature}
        names = [name for name, values in errors.items() if np.any(values)]
        return (*names, "payload_known") if self.payload_known else tuple(names)


def _range(name: str, values: FloatArray) -> FloatArray:
    """Smallest and largest error, (2,), from two values or from one value for plus and minus."""
    ends = np.array([-values, values]) if values.ndim == 0 else values
    if ends.shape != (2,) or ends[0] > ends[1]:
        raise InvalidInput(
            f"{name} of a box must be one nonnegative number for plus and minus, or the smallest "
            f"and the largest error, but is {values.tolist()}."
        )
    return checks.frozen_array(ends)


# Kinds of varying parameters, in the order of their columns.
KINDS = ("payload", "friction", "kp", "kv", "armature", "dead time")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unknowns:
    """The k varying parameters of rigid-body robots; errors have one column per parameter."""

    box: Uncertainty
    arm: Arm  # The nominal arm, with masses
    servo: ServoModel  # The nominal servo, of order "second", with values per joint
    kinds: tuple[str, ...]  # Kind of each parameter, one of KINDS
    joints: tuple[int, ...]  # Joint index of each parameter; -1 if all joints share it
    # low, high: smallest and largest error of each parameter, (k,): relative for gains and
    # armature, in s for dead times, in kg for the payload, and the fraction for friction.
    low: FloatArray
    high: FloatArray

    @classmethod
    def from_uncertainty(cls, box: Uncertainty, arm: Arm, servo: ServoModel) -> Unknowns:
        """Make the list of the parameters that vary in a box; checks arm and servo."""
        joint_servo = servo.for_joints(arm.dof)
        _check_bodies(box, arm, joint_servo)
        # Parameters shared by all joints are listed before and after those of single joints.
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
        ranges = (first | each | last).items()
        varied = [(*key, *ends) for key, ends in ranges if ends[1] > ends[0]]
        kinds, joints, lowest, highest = zip(*varied, strict=True) if varied else ((),) * 4
        return cls(
            box=box,
            arm=arm,
            servo=joint_servo,
            kinds=kinds,
            joints=joints,
            low=checks.frozen_array(lowest),
            high=checks.frozen_array(highest),
        )

    def __len__(self) -> int:
        """Number of varying parameters."""
        return len(self.kinds)

    @property
    def names(self) -> tuple[str, ...]:
        """Names of the parameters for messages, such as "kp of joint 1"."""
        return tuple(
            kind if j < 0 else f"{kind} of joint {j + 1}"
            for kind, j in zip(self.kinds, self.joints, strict=True)
        )

    def corners(self) -> FloatArray:
        """Errors at all corners of the box, (2^k, k)."""
        k = len(self)
        upper = np.arange(2**k)[:, None] >> np.arange(k) & 1
        return np.where(upper == 1, self.high, self.low).reshape(-1, k)

    def draw(self, samples: int, seed: int) -> FloatArray:
        """Errors of robots that are drawn uniformly from the box, (samples, k)."""
        unit = np.random.default_rng(seed).uniform(size=(samples, len(self)))
        return np.asarray(self.low + unit * (self.high - self.low))

    def make_robot(self, errors: FloatArray) -> tuple[Arm, Arm, ServoModel]:
        """Arm, controller's model of the arm, and servo for errors of the parameters, (k,)."""
        dof, servo, chain = self.arm.dof, self.servo, self.arm.chain
        assert chain is not None and servo.kv is not None
        errors_by_kind = {kind: np.zeros(dof) for kind in KINDS}
        for kind, j, error in zip(self.kinds, self.joints, errors, strict=True):
            errors_by_kind[kind][slice(None) if j < 0 else j] = error
        payload = self.payload(float(errors_by_kind["payload"][0]))
        true = self.arm.with_dynamics(
            payload=payload,
            viscous=np.asarray(chain.viscous) + errors_by_kind["friction"] * self.box.viscous,
            coulomb=np.asarray(chain.coulomb) + errors_by_kind["friction"] * self.box.coulomb,
            armature=np.asarray(chain.armature) * (1 + errors_by_kind["armature"]),
        )
        controller = self.arm.with_dynamics(payload=payload) if self.box.payload_known else self.arm
        # Values are negative only by rounding errors, because `dead_time_of` checks the range.
        dead_time = np.maximum(
            servo.dead_time + errors_by_kind["dead time"] * self.dead_time_ratio, 0.0
        )
        return (
            true,
            controller,
            servo.replace(
                kp=servo.kp * (1 + errors_by_kind["kp"]),
                kv=servo.kv * (1 + errors_by_kind["kv"]),
                dead_time=dead_time,
            ),
        )

    @property
    def dead_time_ratio(self) -> FloatArray:
        """Ratio of the error of each joint's dead time to the error of its parameter, (dof,)."""
        errors = np.broadcast_to(np.asarray(self.box.dead_time), (self.arm.dof,))
        largest = float(errors.max())
        return (
            errors / largest if self.box.dead_time_shared and largest > 0 else np.ones(self.arm.dof)
        )

    def payload(self, extra_mass: float) -> Payload | None:
        """The payload with additional mass [kg]; None without any payload."""
        chain = self.arm.chain
        assert chain is not None
        load = chain.payload
        if load is None:
            return (
                None if extra_mass == 0.0 else Payload(mass=extra_mass, center=chain.tool.position)
            )
        mass = max(load.mass + extra_mass, 0.0)
        return Payload(mass=mass, center=load.center, inertia=load.inertia)


def _ranges(box: Uncertainty, dof: int) -> dict[str, tuple[FloatArray, FloatArray]]:
    """Smallest and largest errors of the parameters of joints, by kind, (dof,) each."""
    gains = box.gains_of(dof)
    rubs = np.broadcast_to(np.maximum(box.viscous, box.coulomb), (dof,)) > 0
    lowest, highest = np.asarray(box.friction)
    armature, dead_time = (
        np.broadcast_to(np.asarray(x), (dof,)) for x in (box.armature, box.dead_time)
    )
    return {
        "friction": (lowest * rubs, highest * rubs),
        "kp": (-gains[0], gains[0]),
        "kv": (-gains[1], gains[1]),
        "armature": (-armature, armature),
        "dead time": (-dead_time, dead_time),
    }


def _check_bodies(box: Uncertainty, arm: Arm, servo: ServoModel) -> None:
    """Raise an error if the arm has no masses, or arm or servo do not support the box."""
    dof, chain = arm.dof, arm.chain
    if chain is None or not arm.has_bodies:
        raise InvalidInput(
            "A box of rigid bodies requires an arm with masses. Specify masses and inertias in the "
            "file of the arm, or certify with plant: servo."
        )
    servo.check_orders("A box of rigid bodies")
    if box.jitter:
        raise InvalidInput(
            "Jitter is not supported for rigid bodies. Remove jitter from the box, or certify with "
            "plant: servo."
        )
    box.gains_of(dof)
    per_joint = {
        name: checks.per_joint(f"{name} of the box", getattr(box, name), dof, unit)
        for name, unit in (("viscous", "N m s/rad"), ("coulomb", "N m"), ("armature", ""))
    }
    lowest = np.asarray(box.friction)[0]
    for name, unit in (("viscous", "N m s/rad"), ("coulomb", "N m")):
        friction = getattr(chain, name) + lowest * per_joint[name]
        if (friction < 0).any():
            j = int(np.argmin(friction))
            raise InvalidInput(
                f"With the smallest fraction of friction in the box ({lowest:g}), the {name} "
                f"friction of joint {j + 1} is negative ({friction[j]:g} {unit}). Increase the "
                "friction of the arm to the middle of its range, or set the smallest fraction to "
                "at least 0."
            )
    box.dead_time_of(servo, dof)
    if np.any(per_joint["armature"] * (chain.armature == 0)):
        raise InvalidInput(
            f"The box has errors of drive inertias, but the arm {arm.name} has no drive inertias. "
            "Specify armature in the file of the arm, or remove armature from the box."
        )
    box.check_payload(arm)
