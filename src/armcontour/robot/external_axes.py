"""External axes of an arm's cell: a rail that carries the arm."""

from __future__ import annotations

from dataclasses import field
from typing import Annotated

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import (
    Acceleration,
    Axes,
    Direction,
    Force,
    Jerk,
    Length,
    Mass,
    Quantity,
    Speed,
)

Weight = Annotated[float, Quantity("", sign="positive")]


@declared(eq=False)
class Rail(Checked):
    """A linear axis that carries the base of an arm, as its first joint.

    >>> rail = ac.Rail(axis=(1.0, 0.0, 0.0), upper=3.0, velocity=1.0, acceleration=2.0)
    >>> ac.load_arm("ur10e").with_rail(rail).dof
    7

    Args:
        axis: Direction of the rail, along the axes of the arm's base.
        upper: Upper end of its range [m].
        velocity: Largest velocity [m/s].
        acceleration: Largest acceleration [m/s²].
        lower: Lower end of its range [m].
        jerk: Largest jerk [m/s³]; by default unlimited.
        force: Largest force of its drive [N]; by default unlimited.
        origin: Position of the arm's base with the rail at 0 [m], (3,). The frame of the rail
            replaces the frame of the arm's base in the work frame and in the scene.
        mass: Mass of the carriage and of the arm's base, which the force accelerates [kg].
        weight: Weight of the motion of the rail, relative to that of the other joints. With a
            larger weight the rail moves less, and the arm reaches farther.

    Raises:
        InvalidInput: The axis is zero, or the range is empty.
    """

    axis: Direction
    upper: Length
    velocity: Speed
    acceleration: Acceleration
    lower: Length = 0.0
    jerk: Jerk | None = None
    force: Force | None = None
    origin: Annotated[FloatArray, Quantity("m", "5 mm"), Axes(3)] = field(
        default_factory=lambda: np.zeros(3)
    )
    mass: Mass = 0.0
    weight: Weight = 1.0

    def _check_together(self) -> None:
        if not np.linalg.norm(self.axis) > 0:
            raise InvalidInput("The axis of a rail must be a direction, but is zero.")
        if self.lower >= self.upper:
            raise InvalidInput(
                f"The range of a rail is empty. lower ({self.lower:g} m) must be less than upper "
                f"({self.upper:g} m)."
            )
