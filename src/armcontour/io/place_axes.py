"""Keys of the axes of a placement, as dataclasses."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from armcontour._quantities import Angle, AngularDistance, AtLeast, Distance, Length
from armcontour.jobs.axes import AXES


@dataclass(frozen=True, slots=True, kw_only=True)
class LengthsModel:
    """Evenly spaced values of a length.

    Args:
        start: The first value [m].
        end: The last value [m].
        places: Number of values.
    """

    start: Length
    end: Length
    places: Annotated[int, AtLeast(1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class AnglesModel:
    """Evenly spaced values of an angle; of a whole turn the last is left out, as it is the first.

    Args:
        start: The first value [rad].
        end: The last value [rad].
        places: Number of values.
    """

    start: Angle
    end: Angle
    places: Annotated[int, AtLeast(1)]


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesModel:
    """The axes of a grid of places, along the coordinates of the path.

    Args:
        x, y, z: Where the part is tried along this axis.
        yaw: How far it is turned about z.
        tilt: How far it is turned about y of the turned part.
    """

    x: LengthsModel | None = None
    y: LengthsModel | None = None
    z: LengthsModel | None = None
    yaw: AnglesModel | None = None
    tilt: AnglesModel | None = None

    def ranges(self) -> dict[str, tuple[float, float, int]]:
        """The first value, the last value and the number of values of each axis."""
        axes = {name: getattr(self, name) for name in AXES}
        return {name: (x.start, x.end, x.places) for name, x in axes.items() if x is not None}


@dataclass(frozen=True, slots=True, kw_only=True)
class OffModel:
    """By how much a part may be off its place.

    Args:
        x, y, z: To both sides along this axis [m].
        yaw: In both directions about z [rad].
        tilt: In both directions about y of the turned part [rad].
    """

    x: Distance | None = None
    y: Distance | None = None
    z: Distance | None = None
    yaw: AngularDistance | None = None
    tilt: AngularDistance | None = None

    def sizes(self) -> dict[str, float]:
        """The position error along each axis."""
        axes = {name: getattr(self, name) for name in AXES}
        return {name: x for name, x in axes.items() if x is not None}
