"""What a certificate is asked to hold."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from armcontour import _checks
from armcontour._quantities import Choice, Length
from armcontour.errors import InvalidInput
from armcontour.robustness.monte_carlo import Box

SATURATION = ("refuse", "report")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Goal:
    """What a certified plan has to hold.

    Args:
        tolerance: Largest distance of the tool from the objective path [m]: what servo and command
            interval do not need of it goes to the corners. None leaves the corners as the run has
            them.
        servo: Largest contour error that servo and command interval may make, over the box if there
            is one [m]; None leaves that open, where there is a tolerance.
        rms: Largest root mean square of that error over time, of the nominal robot [m].
        saturation: "refuse" certifies only plans that ask no joint for more than it has; "report"
            executes them with the saturation and says how long it lasts.
        box: How far the robot may be from its model; None is exactly as the model.
        samples: Robots drawn from the box to judge a plan by, beside its corners.
        seed: Seed of these robots.
        run: Name of the run of the job; None is the only one with the method "optimal".
        slowest: A plan that takes this many times as long as the uncertified optimum is none.

    Raises:
        InvalidInput: Nothing to hold, or a number that is not above zero.
    """

    tolerance: Length | None = None
    servo: Length | None = None
    rms: Length | None = None
    saturation: Annotated[str, Choice(SATURATION)] = "refuse"
    box: Box | None = None
    samples: int = 10_000
    seed: int = 0
    run: str | None = None
    slowest: float = 2.0

    def __post_init__(self) -> None:
        for name in ("tolerance", "servo", "rms"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, _checks.positive(name, value, "m"))
        if self.tolerance is None and self.servo is None:
            raise InvalidInput(
                "A certificate needs a tolerance, the largest distance from the objective path, "
                "or servo, the largest contour error of the execution, or both."
            )
        if self.tolerance is not None and (self.servo or 0.0) >= self.tolerance:
            raise InvalidInput(
                f"servo is {self.servo:g} m, but must leave something of the tolerance of "
                f"{self.tolerance:g} m for the corners."
            )
        _checks.choice("saturation", self.saturation, SATURATION)
        _checks.whole("samples", self.samples, 1, 10**7)
        _checks.whole("seed", self.seed, 0, 2**63 - 1)
        if _checks.positive("slowest", self.slowest) <= 1:
            raise InvalidInput(f"slowest must be above 1, but is {self.slowest:g}.")
