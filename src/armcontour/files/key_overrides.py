"""File keys that differ from the fields of their dataclasses in name, type or default."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from armcontour.control.compensation import PolePlacement
from armcontour.core.quantities import (
    Distance,
    Inertia,
    Length,
    Pole,
    Ratio,
)
from armcontour.geometry import SegmentLimits
from armcontour.geometry.weave import Weave
from armcontour.jobs import CertificateGoal, Uncertainty
from armcontour.program import Event, Lead, Process
from armcontour.robot.chain import Payload
from armcontour.robot.servo import ServoModel


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


# Dataclasses that are not listed have keys that equal their fields.
KEY_OVERRIDES: dict[type, KeyOverrides] = {
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
    CertificateGoal: KeyOverrides(omit=frozenset({"slowest"})),
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
