"""`Uncertainty`: error ranges of a robot's parameters; `Unknowns`: those of rigid bodies."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
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
from armcontour.robot import Arm
from armcontour.robot.chain import Payload
from armcontour.robot.servo import ServoModel


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertainty(Checked):
    """The uncertainty set: ranges of the errors of a robot's parameters.

    Errors are distributed uniformly over their ranges. Friction and armature apply to rigid bodies
    only.

    Args:
        gains: Relative error of the servo gains, plus and minus, 0.1 for 10 %: one number; one per
            joint, for kp and kv; or two rows for kp and for kv, (2, dof) or (2, 1). The errors of
            all joints and loops are independent.
        dead_time: Error of the dead time, plus and minus [s], one number or one per joint.
        dead_time_shared: Whether the dead times of all joints have the same error, in proportion to
            `dead_time`; otherwise their errors are independent.
        payload: Error of the payload's mass [kg]: one number for plus and minus, or the smallest
            and the largest error, such as 0 and 2 for up to 2 kg of unknown payload. It is a point
            mass at the tool, or at the centre of the payload of rigid bodies.
        payload_known: Whether the controller knows the true payload and uses it for the gravity
            torque; for rigid bodies only.
        jitter: Error of the arrival time of a set-point, plus and minus [s], less than half a
            cycle. It is independent for each set-point but the first one, and the same
            for all joints.
        viscous: Unknown viscous friction of the joints [N m s/rad], one number or one per joint.
        coulomb: Unknown Coulomb friction of the joints [N m], one number or one per joint.
        friction: Smallest and largest fraction of `viscous` and `coulomb` that a joint has in
            addition to the friction of the arm's model.
        friction_shared: Whether all joints have the same fraction; otherwise the fractions are
            independent.
        armature: Relative error of the drives' inertias, plus and minus, one number or one per
            joint; independent for each joint.

    Raises:
        InvalidInput: A largest error is negative, the relative error of a gain or an armature is
            not below 1, or a range is not in order.
    """

    gains: Annotated[FloatArray | float, GAIN_ERROR, Axes(...)] = 0.0
    dead_time: Annotated[FloatArray | float, DEAD_TIME] = 0.0
    dead_time_shared: bool = True
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
                f"gains of a box must have shape (), (dof,) or (2, dof), not {shape}."
            )
        for name in ("payload", "friction"):
            object.__setattr__(self, name, _range(name, getattr(self, name)))

    def gains_of(self, dof: int) -> FloatArray:
        """Largest errors of kp and of kv, (2, dof)."""
        try:
            return np.broadcast_to(np.asarray(self.gains), (2, dof))
        except ValueError:
            raise InvalidInput(
                f"gains of the box have the shape {np.shape(self.gains)}, but the arm has {dof} "
                f"joints: give one number, {dof} of them, or two rows for kp and kv."
            ) from None

    def dead_time_of(self, servo: ServoModel, dof: int) -> FloatArray:
        """Largest errors of the dead times [s], (dof,); the dead times stay positive."""
        error = checks.per_joint("dead_time of the box", self.dead_time, dof, "s")
        if (servo.dead_time < error).any():
            j = int(np.argmin(servo.dead_time - error))
            raise InvalidInput(
                f"The dead time of joint {j + 1} is {servo.dead_time[j]:g} s and its error "
                f"{error[j]:g} s, but a dead time cannot be negative: give the servo a larger one "
                "(the same for all joints changes no contour), or the box a smaller error."
            )
        return error

    def check_payload(self, arm: Arm) -> None:
        """Check that the payload cannot become negative."""
        load = None if arm.chain is None else arm.chain.payload
        lowest, highest = np.asarray(self.payload).tolist()
        carried, reduction = 0.0 if load is None else load.mass, -lowest
        if reduction > carried:
            raise InvalidInput(
                f"The payload of the box may be {reduction:g} kg less than the arm's, but the arm "
                f"{arm.name} carries only {carried:g} kg: give it the payload in the middle of the "
                f"range, or the box a range, such as 0 kg to {highest:g} kg more.",
                needed=reduction,
                allowed=carried,
            )

    @property
    def of_bodies(self) -> tuple[str, ...]:
        """Names of the specified errors that apply to rigid bodies only."""
        errors = {"viscous": self.viscous, "coulomb": self.coulomb, "armature": self.armature}
        names = [name for name, values in errors.items() if np.any(values)]
        return (*names, "payload_known") if self.payload_known else tuple(names)


def _range(name: str, values: FloatArray) -> FloatArray:
    """Smallest and largest error, (2,), from both or from one number for plus and minus."""
    ends = np.array([-values, values]) if values.ndim == 0 else values
    if ends.shape != (2,) or ends[0] > ends[1]:
        raise InvalidInput(
            f"{name} of a box must be one number that is not negative, for plus and minus, or the "
            f"least and the largest error, but is {values.tolist()}."
        )
    return checks.frozen_array(ends)


# Kinds of unknowns, in the order of their columns.
KINDS = ("payload", "friction", "kp", "kv", "armature", "dead time")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Unknowns:
    """The varying parameters of rigid-body robots; errors have one column per parameter."""

    box: Uncertainty
    arm: Arm  # The nominal arm, with masses
    servo: ServoModel  # The nominal servo, of second order, with values per joint
    kinds: tuple[str, ...]  # Kind of each parameter, of `KINDS`
    joints: tuple[int, ...]  # Joint of each parameter; -1 for one that all joints share
    # low, high: smallest and largest error: relative, in s or in kg; for friction the fraction,
    # (k,).
    low: FloatArray
    high: FloatArray

    @classmethod
    def from_uncertainty(cls, box: Uncertainty, arm: Arm, servo: ServoModel) -> Unknowns:
        """Find the parameters of a box that vary."""
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
        """Errors at all corners of the uncertainty set, (2^k, k)."""
        k = len(self)
        upper = np.arange(2**k)[:, None] >> np.arange(k) & 1
        return np.where(upper == 1, self.high, self.low).reshape(-1, k)

    def draw(self, samples: int, seed: int) -> FloatArray:
        """Errors of random robots, (samples, k)."""
        unit = np.random.default_rng(seed).uniform(size=(samples, len(self)))
        return np.asarray(self.low + unit * (self.high - self.low))

    def robot(self, errors: FloatArray) -> tuple[Arm, Arm, ServoModel]:
        """Arm, controller's model of the arm, and servo for some errors."""
        # errors (k,).
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
        # Negative by rounding only; `dead_time_of` checks the range.
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
        """Error of each joint's dead time relative to that of the parameter, (dof,)."""
        errors = np.broadcast_to(np.asarray(self.box.dead_time), (self.arm.dof,))
        largest = float(errors.max())
        return (
            errors / largest if self.box.dead_time_shared and largest > 0 else np.ones(self.arm.dof)
        )

    def payload(self, extra_mass: float) -> Payload | None:
        """The payload with additional mass [kg]; None if there is none."""
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
    """Smallest and largest errors of the parameters of every joint, by kind, (dof,) each."""
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
    """Check that the arm has bodies, and that the arm and the servo support the uncertainty set."""
    dof, chain = arm.dof, arm.chain
    if chain is None or not arm.has_bodies:
        raise InvalidInput(
            "Rigid bodies need an arm with masses: give the arm's file masses and inertias, or "
            "certify with plant: servo."
        )
    servo.check_orders("A box of rigid bodies")
    if box.jitter:
        raise InvalidInput(
            "Rigid bodies are executed without jitter: remove jitter from the box, or certify "
            "with plant: servo."
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
                f"The least share of friction, {lowest:g}, leaves joint {j + 1} a {name} friction "
                f"of {friction[j]:g} {unit}: give the arm the friction in the middle of the range, "
                "or the box a share from 0 on."
            )
    box.dead_time_of(servo, dof)
    if np.any(per_joint["armature"] * (chain.armature == 0)):
        raise InvalidInput(
            f"The box has errors of drive inertias, but the arm {arm.name} has none: give its "
            "file armature, or remove armature from the box."
        )
    box.check_payload(arm)
