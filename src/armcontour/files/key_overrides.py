"""File keys that differ from the fields of their dataclasses in name, type or default."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from armcontour.control.compensation import PolePlacement
from armcontour.core.quantities import (
    Angle,
    AngularDistance,
    AtLeast,
    Choice,
    Distance,
    Inertia,
    Length,
    Pole,
    Ratio,
)
from armcontour.geometry import SegmentLimits
from armcontour.geometry.weave import Weave
from armcontour.jobs.placement_options import AXES, POINTS, PlaceSearch
from armcontour.program import Event, Lead, Process
from armcontour.robot import Limits
from armcontour.robot.chain import Payload
from armcontour.robot.servo import ServoModel
from armcontour.simulation.robustness.uncertainty import Uncertainty


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
class AnglesModel(LengthsModel):
    """Evenly spaced values of an angle; a whole turn omits the last value.

    Args:
        start: The first value [rad].
        end: The last value [rad].
    """

    start: Angle
    end: Angle


@dataclass(frozen=True, slots=True, kw_only=True)
class AxesModel:
    """The axes of a grid of positions, along the coordinates of the path.

    Args:
        x, y, z: Positions of the part along this axis.
        yaw: Rotation about z.
        tilt: Rotation about y of the turned part; the tool has `path.orientation`.
    """

    x: LengthsModel | None = None
    y: LengthsModel | None = None
    z: LengthsModel | None = None
    yaw: AnglesModel | None = None
    tilt: AnglesModel | None = None

    def ranges(self) -> dict[str, tuple[float, float, int]]:
        """First value, last value and number of values of each specified axis."""
        axes = {name: getattr(self, name) for name in AXES}
        return {name: (x.start, x.end, x.places) for name, x in axes.items() if x is not None}


@dataclass(frozen=True, slots=True, kw_only=True)
class PositionErrorModel:
    """Position error of a part.

    Args:
        x, y, z: Error to both sides along this axis [m].
        yaw: Error in both directions about z [rad].
        tilt: Error in both directions about y of the turned part; does not tilt the tool [rad].
    """

    x: Distance | None = None
    y: Distance | None = None
    z: Distance | None = None
    yaw: AngularDistance | None = None
    tilt: AngularDistance | None = None

    def sizes(self) -> dict[str, float]:
        """Position error of each specified axis [m or rad]."""
        axes = {name: getattr(self, name) for name in AXES}
        return {name: x for name, x in axes.items() if x is not None}


class PlantModel(ServoModel):
    """Servo of the simulated robot, without the figures of an identification."""


Point = Annotated[list[Length], Field(min_length=2, max_length=3)]
Place = Annotated[list[Length], Field(min_length=3, max_length=3)]
Poles = Annotated[list[Pole], Field(min_length=3, max_length=3)]
# Indices of the components xx, xy, xz, yy, yz and zz that form the symmetric tensor, (3, 3).
TENSOR = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]


@dataclass(frozen=True, slots=True, kw_only=True)
class KeyOverrides:
    """Differences between the keys of a file and the fields of their dataclass, by field."""

    # Names of keys, if they differ from the names of the fields
    names: Mapping[str, str] = field(default_factory=dict)
    # Annotations of keys, if they differ from those of the fields
    types: Mapping[str, Any] = field(default_factory=dict)
    # Defaults of keys, if they differ from those of the fields
    defaults: Mapping[str, Any] = field(default_factory=dict)
    # Descriptions of keys, if they differ from those of the fields
    texts: Mapping[str, str] = field(default_factory=dict)
    # Fields without a key
    omit: frozenset[str] = frozenset()


# Names of the keys for the ends of a range.
ENDS = {"start": "from", "end": "to"}
# Dataclasses that are not listed have keys that equal their fields.
KEY_OVERRIDES: dict[type, KeyOverrides] = {
    AnglesModel: KeyOverrides(names=ENDS),
    LengthsModel: KeyOverrides(names=ENDS),
    Uncertainty: KeyOverrides(
        names={"dead_time_shared": "shared"},
        types={"gains": Ratio | list[Ratio] | list[list[Ratio]]},
    ),
    SegmentLimits: KeyOverrides(omit=frozenset({"tag"})),
    Event: KeyOverrides(names={"s": "at"}),
    Lead: KeyOverrides(
        types={
            "length": Annotated[
                Literal["auto"] | Distance,
                Field(union_mode="left_to_right"),
                AfterValidator(lambda x: None if x == "auto" else x),
            ]
        },
        defaults={"length": "auto"},
    ),
    Payload: KeyOverrides(
        types={
            "center": Place,
            "inertia": Annotated[
                list[Inertia],
                Field(min_length=6, max_length=6),
                AfterValidator(lambda x: np.array(x)[TENSOR]),
            ],
        },
        texts={
            "inertia": "xx, xy, xz, yy, yz and zz about the centre of mass, along the axes of the "
            "tip [kg m²]; a point by default."
        },
    ),
    PlaceSearch: KeyOverrides(
        names={"what": "move", "refined": "refine"},
        types={
            "over": Annotated[AxesModel, AfterValidator(AxesModel.ranges)],
            "uncertainty": Annotated[PositionErrorModel, AfterValidator(PositionErrorModel.sizes)],
            "about": Annotated[str, Choice(POINTS)] | Place,
        },
    ),
    Limits: KeyOverrides(omit=frozenset({"tool_jerk", "path_jerk"})),
    PlantModel: KeyOverrides(
        omit=frozenset(
            {"model_error", "logged_velocity", "logged_acceleration", "contour_ratio", "programs"}
        )
    ),
    Weave: KeyOverrides(omit=frozenset({"tolerance"})),
    PolePlacement: KeyOverrides(types={"poles": Poles | list[Poles] | None}),
    Process: KeyOverrides(
        types={
            "begin": Annotated[
                Literal["auto", "drawn"] | Distance | Point, Field(union_mode="left_to_right")
            ]
        },
        omit=frozenset({"up", "layers"}),
    ),
}
