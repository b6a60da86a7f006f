"""External axes of an arm's cell: a rail that carries the arm, a positioner that turns the part."""

from __future__ import annotations

from dataclasses import field, replace
from typing import Annotated, ClassVar

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.frames import Frame
from armcontour.core.quantities import (
    NO_KEY,
    Acceleration,
    Angle,
    AngularAcceleration,
    AngularJerk,
    AngularRate,
    Axes,
    Direction,
    Force,
    Items,
    Jerk,
    Length,
    Mass,
    Name,
    Quantity,
    Speed,
    Torque,
)
from armcontour.core.text import capitalise
from armcontour.robot.bodies import TENSOR, Payload, check_inertia

# Joint limits, each with the field of an external axis that specifies it
FIELDS = {
    "joint_lower": "lower",
    "joint_upper": "upper",
    "joint_velocity": "velocity",
    "joint_acceleration": "acceleration",
    "joint_jerk": "jerk",
    "joint_torque": "torque",
}
Point = Annotated[FloatArray, Quantity("m", "5 mm"), Axes(3)]
# Angle between the tool axis and gravity [rad].
Tilt = Annotated[float, Quantity("rad", "10 deg", within=(1e-3, np.pi))]


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
        mass: Mass of carriage and arm base, which the force accelerates [kg].

    Raises:
        InvalidInput: The axis is zero, or the range is empty.
    """

    fields: ClassVar = {**FIELDS, "joint_torque": "force"}
    axis: Direction
    upper: Length
    velocity: Speed
    acceleration: Acceleration
    lower: Length = 0.0
    jerk: Jerk | None = None
    force: Force | None = None
    origin: Point = field(default_factory=lambda: np.zeros(3))
    mass: Mass = 0.0

    def _check_together(self) -> None:
        _check_axis("a rail", "m", self)


@declared(eq=False)
class PositionerAxis(Checked):
    """An axis that moves the part, or the next axis, with all axes of the positioner at 0.

    It turns about `axis`, or slides along it if it is prismatic. For a prismatic axis, m replaces
    rad, N replaces N m, and kg replaces kg m².

    >>> turn = ac.PositionerAxis(
    ...     name="turn", axis=(0.0, 0.0, 1.0), origin=(0.8, 0.0, 0.0), lower=-6.0, upper=6.0,
    ...     velocity=1.0, acceleration=2.0,
    ... )
    >>> turn.jerk is None
    True

    Args:
        name: Name of the joint.
        axis: Direction of the axis, in coordinates of the arm's base, or of the rail if the arm has
            one. All positions here have the same coordinates.
        origin: A point of the axis [m], (3,).
        lower, upper: Ends of its range [rad]; by default it turns endlessly, as a turntable.
        velocity: Largest velocity [rad/s].
        acceleration: Largest acceleration [rad/s²].
        jerk: Largest jerk [rad/s³]; by default unlimited.
        torque: Largest torque of its drive [N m]; by default unlimited.
        mass: Mass of the body between this axis and the next one, or of the table [kg].
        center: Its centre of mass [m], (3,); by default the origin.
        inertia: Its inertia about the centre of mass [kg m²], (3, 3); that of a point by default.
        prismatic: Whether the axis slides; by default it turns.

    Raises:
        InvalidInput: The axis is zero, the range is empty, a prismatic axis has no range, or no
            body can have the inertia.
    """

    fields: ClassVar = FIELDS
    name: Name
    axis: Direction
    origin: Point
    velocity: AngularRate
    acceleration: AngularAcceleration
    lower: Angle | None = None
    upper: Angle | None = None
    jerk: AngularJerk | None = None
    torque: Torque | None = None
    mass: Mass = 0.0
    center: Point | None = None
    inertia: Annotated[FloatArray, Quantity("kg m^2"), Axes(3, 3), TENSOR] = field(
        default_factory=lambda: np.zeros((3, 3))
    )
    prismatic: Annotated[bool, NO_KEY] = False

    def _check_together(self) -> None:
        called = f"the axis {self.name} of a positioner"
        if self.prismatic and (self.lower is None or self.upper is None):
            raise InvalidInput(
                f"{capitalise(called)} slides, so it requires the ends lower and upper of its "
                "range."
            )
        _check_axis(called, "m" if self.prismatic else "rad", self)
        check_inertia(f"the body after {self.name}", self.inertia)


@declared(eq=False)
class Positioner(Checked):
    """Axes between the floor and the part, which move the part while the arm works on it.

    Paths, tool speeds and tool limits are relative to the part. The axes are the first joints of
    the arm, in the order from the part to the floor.

    >>> turntable = ac.PositionerAxis(
    ...     name="turn", axis=(0.0, 0.0, 1.0), origin=(0.8, 0.0, 0.0), lower=-6.0, upper=6.0,
    ...     velocity=1.0, acceleration=2.0,
    ... )
    >>> ac.load_arm("ur10e").with_positioner(ac.Positioner(axes=(turntable,))).dof
    7

    Args:
        axes: The axes, from the floor to the part.
        part: Load of the part, in the frame of the part: the work frame of the arm, or in a job
            `path.frame`, as for obstacles that are fixed to the part. The load moves with the last
            axis.
        tilt: Largest angle between the tool axis and gravity [rad]: the positioner turns the part
            so that the tool points downwards. By default any angle is allowed.

    Raises:
        InvalidInput: `axes` is empty, or two axes have the same name.
    """

    axes: Annotated[tuple[PositionerAxis, ...], Items(1, 6)]
    part: Payload | None = None
    tilt: Tilt | None = None

    def seen_from(self, frame: Frame) -> Positioner:
        """Return the positioner with its axes in the coordinates of another frame.

        Args:
            frame: The other frame, in the frame of the axes.
        """
        to_frame = frame.inverse
        turned = to_frame.rotation
        axes = []
        for axis in self.axes:
            center = None if axis.center is None else turned @ axis.center + to_frame.position
            axes.append(
                replace(
                    axis,
                    axis=turned @ axis.axis,
                    origin=turned @ axis.origin + to_frame.position,
                    center=center,
                    inertia=turned @ axis.inertia @ turned.T,
                )
            )
        return replace(self, axes=tuple(axes))

    def _check_together(self) -> None:
        names = [x.name for x in self.axes]
        if len(set(names)) < len(names):
            raise InvalidInput(f"Axes of the positioner have the same name: {', '.join(names)}.")


def _check_axis(called: str, unit: str, axis: Rail | PositionerAxis) -> None:
    """Check direction and range of an axis; `called` and `unit` are for messages."""
    if not np.linalg.norm(axis.axis) > 0:
        raise InvalidInput(f"The axis of {called} must be a direction, but is zero.")
    lower = -np.inf if axis.lower is None else axis.lower
    upper = np.inf if axis.upper is None else axis.upper
    if lower >= upper:
        raise InvalidInput(
            f"The range of {called} is empty: lower ({lower:g} {unit}) must be less than upper "
            f"({upper:g} {unit})."
        )
