"""`CertificateGoal`: the accuracy that a certificate requires, and for which robots."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared, quantities
from armcontour.core.quantities import (
    DEAD_TIME,
    GAIN_ERROR,
    Axes,
    Key,
    PlainNumber,
    Tolerance,
)
from armcontour.core.render import number_range
from armcontour.robot.servo import ServoModel

# Clauses that say whether joints have independent errors or share one.
EACH = (" (independent for each joint)", " (the same error for all joints)")


@declared(eq=False)
class Uncertainty(Checked):
    """The uncertainty set (box): how far a servo's parameters may be from its model.

    >>> str(Uncertainty(gains=0.1))
    'gains ±10 % (independent for each joint)'

    Args:
        gains: Relative error of the servo gains, plus and minus, 0.1 for 10 %: one number, one per
            joint (for kp and kv), or two rows for kp and for kv, (2, dof) or (2, 1). The errors of
            all joints and loops are independent.
        dead_time: Error of the dead time, plus and minus [s], one number or one per joint.
        dead_time_shared: If true, the dead times of all joints have the same error, in proportion
            to `dead_time`; otherwise their errors are independent.

    Raises:
        InvalidInput: A largest error is negative, or the relative error of a gain is not below 1.
    """

    gains: Annotated[FloatArray | float, GAIN_ERROR, Axes(...)] = 0.0
    dead_time: Annotated[FloatArray | float, DEAD_TIME] = 0.0
    dead_time_shared: Annotated[bool, Key("shared")] = False

    def _check_together(self) -> None:
        """Refuse errors of the gains that have a wrong shape."""
        shape = np.shape(self.gains)
        if len(shape) > 2 or 0 in shape:
            raise InvalidInput(
                f"gains of a box must have the shape (), (dof,) or (2, dof), but have {shape}."
            )

    def __str__(self) -> str:
        """Write the ranges of the errors, and whether all joints share an error."""
        ranges = {x: np.unique(getattr(self, x)) for x in quantities(Uncertainty)}
        clauses = {"gains": EACH[0], "dead_time": EACH[self.dead_time_shared]}
        return "; ".join(
            f"{name.replace('_', ' ')} ±"
            f"{number_range(values, quantities(Uncertainty)[name].unit)}{clauses[name]}"
            for name, values in ranges.items()
            if values.any()
        )

    def half_widths(self, servo: ServoModel, dof: int) -> FloatArray:
        """Return the largest errors of kp, kv (relative) and dead time [s] per joint, (3, dof)."""
        try:
            gains = np.broadcast_to(np.asarray(self.gains), (2, dof))
        except ValueError:
            raise InvalidInput(
                f"gains of the box must be one number, {dof} numbers (one per joint), or two rows "
                f"for kp and kv, but have the shape {np.shape(self.gains)}."
            ) from None
        error = checks.per_joint("dead_time of the box", self.dead_time, dof, "s")
        if (servo.dead_time < error).any():
            j = int(np.argmin(servo.dead_time - error))
            raise InvalidInput(
                f"The error of a dead time must not exceed the dead time, but joint {j + 1} has a "
                f"dead time of {servo.dead_time[j]:g} s and an error of {error[j]:g} s. Specify a "
                "longer dead time of the servo (an equal change for all joints does not change "
                "contours), or a smaller error of the box."
            )
        return np.concatenate([gains if servo.kv is not None else gains * [[1.0], [0.0]], [error]])


@declared(eq=False)
class CertificateGoal(Checked):
    """Requirements that a certified plan meets.

    >>> goal = ac.CertificateGoal(servo_error=0.1e-3)
    >>> goal.slowest
    2.0

    Args:
        tolerance: Largest distance of the tool from the objective path [m]. The part that servo and
            cycle do not use is available to the corners. None keeps the corners of the run.
        servo_error: Largest contour error from servo and cycle [m], for every robot of the box if
            there is one. None sets no limit of its own; then a tolerance is needed.
        rms: Largest root mean square of the contour error over time, of the nominal robot [m].
        box: Uncertainty of the robot's parameters; None assumes that the model is exact.
        run: Name of the run to certify; None is the only run with the method "optimal".
        slowest: Largest duration of a certified plan, as a multiple of the uncertified optimum.

    Raises:
        InvalidInput: Neither tolerance nor servo_error, or a number that is not above zero.
    """

    tolerance: Tolerance | None = field(default=None, kw_only=False)
    servo_error: Tolerance | None = None
    rms: Tolerance | None = None
    box: Uncertainty | None = None
    run: str | None = None
    slowest: PlainNumber = 2.0

    def _check_together(self) -> None:
        """Refuse a goal without requirement, or with requirements that exclude each other."""
        if self.tolerance is None and self.servo_error is None:
            raise InvalidInput(
                "A certificate requires a tolerance (largest distance from the objective path), "
                "servo_error (largest contour error of the execution), or both. Specify them in "
                "the key `certificate` of the job, such as certificate: {servo_error: 0.05 mm}, or "
                "on the command line with --servo-error (certify also takes --total-tolerance)."
            )
        if self.tolerance is not None and (self.servo_error or 0.0) >= self.tolerance:
            raise InvalidInput(
                f"servo_error is {self.servo_error:g} m, but must be below the tolerance of "
                f"{self.tolerance:g} m, because the corners need a part of the tolerance."
            )
        if self.slowest <= 1:
            raise InvalidInput(f"slowest must be above 1, but is {self.slowest:g}.")
