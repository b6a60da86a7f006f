"""Limits files: YAML with the keys that `limits` has in a job file, and deviations."""

from __future__ import annotations

from pathlib import Path as FilePath

from pydantic import ValidationError

from armcontour._files import read_text
from armcontour._yaml import load
from armcontour.arms import Arm, Limits
from armcontour.errors import InvalidInput
from armcontour.io.job_model import LimitsModel
from armcontour.io.problems import first_problem
from armcontour.io.units import Angle, Length

DEVIATIONS = {"deviation", "orientation_deviation"}


class LimitsFileModel(LimitsModel):
    """A limits file, with the tool's largest distance and angle from its path."""

    deviation: Length | None = None
    orientation_deviation: Angle | None = None


def read_limits(file: str | FilePath, arm: Arm) -> tuple[Limits, float | None, float | None]:
    """The limits in a YAML file, and the largest deviations from the path [m], [rad] if it has any.

    Limits of the joints that the file does not give are the arm's own, and null lifts one, as in a
    job file.

    Raises:
        InvalidInput: No such file, not YAML, an unknown key, or a value that is not a limit.
    """
    place = FilePath(file)
    text = read_text(place, "limits file")
    data = load(text, place.name)
    if not isinstance(data, dict):
        raise InvalidInput(f"{place.name} must hold a mapping of limits such as speed: 0.15 m/s.")
    try:
        model = LimitsFileModel.model_validate(data)
    except ValidationError as error:
        raise InvalidInput(f"{place.name}: {first_problem(error, LimitsFileModel)}") from None
    given = model.model_dump(exclude_unset=True, exclude=DEVIATIONS)
    try:
        limits = arm.limits.replace(**given).for_joints(arm.dof)
    except InvalidInput as error:
        raise InvalidInput(f"{place.name}: {error}") from None
    return limits, model.deviation, model.orientation_deviation
