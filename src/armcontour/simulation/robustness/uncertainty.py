"""`Uncertainty`: error ranges of a robot's parameters."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, quantities
from armcontour.core.quantities import (
    DEAD_TIME,
    GAIN_ERROR,
    MORE_PAYLOAD,
    Axes,
    Duration,
)
from armcontour.core.render import number_range
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel

# Clauses on the errors of joints: independent, or shared.
EACH = (" (independent for each joint)", " (the same error for all joints)")


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertainty(Checked):
    """The uncertainty set (box): ranges of the errors of a robot's parameters.

    Errors are distributed uniformly over their ranges.

    Args:
        gains: Relative error of the servo gains, plus and minus, 0.1 for 10 %: one number, one per
            joint (for kp and kv), or two rows for kp and for kv, (2, dof) or (2, 1). The errors of
            all joints and loops are independent.
        dead_time: Error of the dead time, plus and minus [s], one number or one per joint.
        dead_time_shared: If true, the dead times of all joints have the same error, in proportion
            to `dead_time`; otherwise their errors are independent.
        payload: Error of the payload's mass [kg]: one number for plus and minus, or the smallest
            and the largest error, such as 0 and 2 for up to 2 kg of unknown payload. The mass is at
            the tool.
        jitter: Error of the arrival time of a set-point, plus and minus [s], less than half a
            cycle. The errors of the set-points are independent, except for the first set-point,
            which has none. All joints have the same error.

    Raises:
        InvalidInput: A largest error is negative, the relative error of a gain is not below 1, or
            the ends of the payload are not in ascending order.
    """

    gains: Annotated[FloatArray | float, GAIN_ERROR, Axes(...)] = 0.0
    dead_time: Annotated[FloatArray | float, DEAD_TIME] = 0.0
    dead_time_shared: bool = False
    payload: Annotated[FloatArray | float, MORE_PAYLOAD] = 0.0
    jitter: Duration = 0.0

    def _check_together(self) -> None:
        shape = np.shape(self.gains)
        if len(shape) > 2 or 0 in shape:
            raise InvalidInput(
                f"gains of a box must have the shape (), (dof,) or (2, dof), but have {shape}."
            )
        payload = np.asarray(self.payload)
        ends = np.array([-payload, payload]) if payload.ndim == 0 else payload
        if ends.shape != (2,) or ends[0] > ends[1]:
            raise InvalidInput(
                "payload of a box must be one nonnegative number for plus and minus, or the "
                f"smallest and the largest error, but is {payload.tolist()}."
            )
        object.__setattr__(self, "payload", checks.frozen_array(ends))

    def __str__(self) -> str:
        """Ranges of the errors, and whether all joints share an error."""
        ranges = {x: np.unique(getattr(self, x)) for x in quantities(Uncertainty)}
        clauses = {"gains": EACH[0], "dead_time": EACH[self.dead_time_shared]}
        return "; ".join(
            f"{name.replace('_', ' ')} {'' if name == 'payload' else '±'}"
            f"{number_range(values, quantities(Uncertainty)[name].unit)}{clauses.get(name, '')}"
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
