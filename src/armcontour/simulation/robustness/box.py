"""`Uncertainty`: how far a robot may be from its model."""

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
from armcontour.robot.servo import ServoModel


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertainty(Checked):
    """The uncertainty set: ranges of the errors of a robot's parameters.

    Errors are distributed uniformly over their ranges. Friction and armature are those of rigid
    bodies: a servo of one joint has none.

    Args:
        gains: Relative error of the servo gains, plus and minus, 0.1 for 10 %: one number; one per
            joint, for kp and kv; or two rows for kp and for kv, (2, dof) or (2, 1). The errors of
            all joints and loops are independent.
        dead_time: Error of the dead time, plus and minus [s], one number or one per joint.
        dead_time_shared: Whether the dead times of all joints have the same error, in proportion to
            `dead_time`; otherwise their errors are independent.
        payload: Error of the payload's mass [kg]: one number for plus and minus, or the least and
            the largest error, such as 0 and 2 for up to 2 kg that nobody told the robot of. It is a
            point mass at the tool; of rigid bodies that carry a payload, at the centre of that.
        payload_known: Whether the controller weighs the payload: its gravity torque is then that of
            the true one. Only rigid bodies sag.
        jitter: Error of the arrival time of a set-point, plus and minus [s], less than half a
            cycle. It is independent for each set-point but the first one, and the same
            for all joints.
        viscous: Viscous friction of the joints that is not known [N m s/rad], one number or one per
            joint.
        coulomb: Coulomb friction of the joints that is not known [N m], one number or one per
            joint.
        friction: Least and largest share of `viscous` and `coulomb` that a joint has in addition to
            the friction that the arm knows.
        friction_shared: Whether all joints have the same share; otherwise those of all joints are
            independent.
        armature: Relative error of the drives' inertias, plus and minus, one number or one per
            joint; those of all joints are independent.

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
        """Largest errors of kp and of kv, (2, dof).

        Args:
            dof: Number of joints.

        Raises:
            InvalidInput: They do not fit so many joints.
        """
        try:
            return np.broadcast_to(np.asarray(self.gains), (2, dof))
        except ValueError:
            raise InvalidInput(
                f"gains of the box have the shape {np.shape(self.gains)}, but the arm has {dof} "
                f"joints: give one number, {dof} of them, or two rows for kp and kv."
            ) from None

    def dead_time_of(self, servo: ServoModel, dof: int) -> FloatArray:
        """Largest errors of the dead times [s], (dof,).

        Args:
            servo: The nominal servo, with values per joint.
            dof: Number of joints.

        Raises:
            InvalidInput: A dead time would be below zero.
        """
        late = checks.per_joint("dead_time of the box", self.dead_time, dof, "s")
        if (servo.dead_time < late).any():
            j = int(np.argmin(servo.dead_time - late))
            raise InvalidInput(
                f"The dead time of joint {j + 1} is {servo.dead_time[j]:g} s and its error "
                f"{late[j]:g} s, but a dead time cannot be negative: give the servo a larger one "
                "(the same for all joints changes no contour), or the box a smaller error."
            )
        return late

    def check_payload(self, arm: Arm) -> None:
        """Refuse an arm that carries less than the box takes from its payload.

        Args:
            arm: The nominal arm.

        Raises:
            InvalidInput: The least payload is negative.
        """
        load = None if arm.chain is None else arm.chain.payload
        least, most = np.asarray(self.payload).tolist()
        carried, less = 0.0 if load is None else load.mass, -least
        if less > carried:
            raise InvalidInput(
                f"The payload of the box may be {less:g} kg less than the arm's, but the arm "
                f"{arm.name} carries only {carried:g} kg: give it the payload in the middle of the "
                f"range, or the box a range, such as 0 kg to {most:g} kg more.",
                needed=less,
                allowed=carried,
            )

    @property
    def of_bodies(self) -> tuple[str, ...]:
        """Names of the given errors that only rigid bodies have."""
        given = {"viscous": self.viscous, "coulomb": self.coulomb, "armature": self.armature}
        found = [name for name, values in given.items() if np.any(values)]
        return (*found, "payload_known") if self.payload_known else tuple(found)


def _range(name: str, values: FloatArray) -> FloatArray:
    """The least and the largest error, (2,), from both or from one number for plus and minus.

    Raises:
        InvalidInput: There are other numbers of values, or the least is above the largest.
    """
    found = np.array([-values, values]) if values.ndim == 0 else values
    if found.shape != (2,) or found[0] > found[1]:
        raise InvalidInput(
            f"{name} of a box must be one number that is not negative, for plus and minus, or the "
            f"least and the largest error, but is {values.tolist()}."
        )
    return checks.frozen_array(found)
