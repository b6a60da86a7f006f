"""Keys of files that differ from the fields of their dataclasses, in name, type or default."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import AfterValidator, Field

from armcontour._quantities import Choice, Distance, Inertia, Length, Pole, Ratio
from armcontour.arms.chain import Payload
from armcontour.compensation import PolePlacement
from armcontour.geometry import Demand
from armcontour.io.place_axes import AnglesModel, AxesModel, LengthsModel, OffModel
from armcontour.jobs.place_search import POINTS, PlaceSearch
from armcontour.program import Event, Lead, Process
from armcontour.robustness.box import Box

Point = Annotated[list[Length], Field(min_length=2, max_length=3)]
Place = Annotated[list[Length], Field(min_length=3, max_length=3)]
Poles = Annotated[list[Pole], Field(min_length=3, max_length=3)]
# Indices of xx, xy, xz, yy, yz and zz in a symmetric matrix.
TENSOR = [[0, 1, 2], [1, 3, 4], [2, 4, 5]]


@dataclass(frozen=True, slots=True, kw_only=True)
class Form:
    """Differences between the keys of a file and the fields of their dataclass.

    Args:
        names: Keys with another name than the field, by the fields.
        types: Annotations of keys with another type than the field, by the fields.
        defaults: Defaults of such keys, by the fields.
        texts: Descriptions of such keys, by the fields.
        omit: Fields without a key.
    """

    names: Mapping[str, str] = field(default_factory=dict)
    types: Mapping[str, Any] = field(default_factory=dict)
    defaults: Mapping[str, Any] = field(default_factory=dict)
    texts: Mapping[str, str] = field(default_factory=dict)
    omit: frozenset[str] = frozenset()


# Ends of a range.
ENDS = {"start": "from", "end": "to"}
# For every other dataclass the keys are its fields.
FORMS: dict[type, Form] = {
    AnglesModel: Form(names=ENDS),
    LengthsModel: Form(names=ENDS),
    Box: Form(
        names={"dead_time_shared": "shared"},
        types={"gains": Ratio | list[Ratio] | list[list[Ratio]]},
    ),
    Demand: Form(omit=frozenset({"tag"})),
    Event: Form(names={"s": "at"}),
    Lead: Form(
        types={
            "length": Annotated[
                Literal["auto"] | Distance,
                Field(union_mode="left_to_right"),
                AfterValidator(lambda x: None if x == "auto" else x),
            ]
        },
        defaults={"length": "auto"},
    ),
    Payload: Form(
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
    PlaceSearch: Form(
        names={"what": "move", "refined": "refine"},
        types={
            "over": Annotated[AxesModel, AfterValidator(AxesModel.ranges)],
            "uncertainty": Annotated[OffModel, AfterValidator(OffModel.sizes)],
            "about": Annotated[str, Choice(POINTS)] | Place,
        },
    ),
    PolePlacement: Form(types={"poles": Poles | list[Poles] | None}),
    Process: Form(
        types={
            "begin": Annotated[
                Literal["auto", "drawn"] | Distance | Point, Field(union_mode="left_to_right")
            ]
        },
        omit=frozenset({"up", "layers"}),
    ),
}
