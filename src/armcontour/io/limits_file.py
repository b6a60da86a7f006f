"""Limits files: YAML with the keys that `limits` has in a job file, and deviations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath

from armcontour._files import read_text
from armcontour._quantities import Angle, Length
from armcontour._yaml import load
from armcontour.arms import Arm, Limits
from armcontour.errors import InvalidInput, locate_errors
from armcontour.io.keys import Given, read_keys


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitsFile(Limits):
    """A limits file.

    Args:
        deviation: Largest distance of the tool from its path [m].
        orientation_deviation: Largest angle of the tool from its orientation along the path [rad].
    """

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
    given = read_keys(Given(LimitsFile), data, place.name)
    deviations = [given.pop(name, None) for name in ("deviation", "orientation_deviation")]
    with locate_errors(place.name):
        limits = arm.limits.replace(**given).for_joints(arm.dof)
    return limits, *deviations
