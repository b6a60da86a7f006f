"""`CertificateGoal`: the requirements that a certified plan meets."""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Annotated

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.quantities import About, AtLeast, PlainNumber, Tolerance
from armcontour.simulation.robustness.uncertainty import Uncertainty


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class CertificateGoal(Checked):
    """Requirements that a certified plan meets.

    >>> goal = ac.CertificateGoal(servo_error=0.1e-3)
    >>> goal.samples
    10000

    Args:
        tolerance: Largest distance of the tool from the objective path [m]. The part that servo and
            cycle do not use is available to the corners. None keeps the corners of the run.
        servo_error: Largest contour error from servo and cycle [m], over the whole box if there is
            one. None sets no limit of its own; then a tolerance is needed.
        rms: Largest root mean square of the contour error over time, of the nominal robot [m].
        box: Uncertainty of the robot's parameters; None assumes that the model is exact.
        samples: Number of robots drawn from the box, in addition to the corners of the box.
        seed: Seed of these robots.
        run: Name of the run to certify; None is the only run with the method "optimal".
        slowest: Largest duration of a certified plan, as a multiple of the uncertified optimum.

    Raises:
        InvalidInput: Neither tolerance nor servo_error, or a number that is not above zero.
    """

    tolerance: Annotated[Tolerance | None, About("--total-tolerance")] = field(
        default=None, kw_only=False
    )
    servo_error: Annotated[Tolerance | None, About("--servo-error")] = None
    rms: Tolerance | None = None
    box: Uncertainty | None = None
    samples: Annotated[int, AtLeast(1, 10**7)] = 10_000
    seed: Annotated[int, AtLeast(0)] = 0
    run: str | None = None
    slowest: PlainNumber = 2.0

    def _check_together(self) -> None:
        if self.tolerance is None and self.servo_error is None:
            raise InvalidInput(
                "A certificate requires a tolerance (largest distance from the objective path), "
                "servo_error (largest contour error of the execution), or both. Specify them in "
                "the key `certificate` of the job, such as certificate: {servo_error: 0.05 mm}, or "
                "on the command line with --servo-error (certify takes --total-tolerance too)."
            )
        if self.tolerance is not None and (self.servo_error or 0.0) >= self.tolerance:
            raise InvalidInput(
                f"servo_error is {self.servo_error:g} m, but must be below the tolerance of "
                f"{self.tolerance:g} m, because the corners need a part of the tolerance."
            )
        if self.slowest <= 1:
            raise InvalidInput(f"slowest must be above 1, but is {self.slowest:g}.")
