"""Read limits files: YAML with the keys of `limits` in a job file, and largest deviations."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path as FilePath

from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.file_access import read_text
from armcontour.core.quantities import Angle, Length
from armcontour.core.yaml_layout import load
from armcontour.files.keys import Given, read_keys
from armcontour.robot import Arm, Limits, resolve_limits


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LimitsFile(Limits):
    """Keys of a limits file.

    Args:
        deviation: Largest distance of the tool from its path [m].
        orientation_deviation: Largest angle between the tool and its required orientation [rad].
    """

    deviation: Length | None = None
    orientation_deviation: Angle | None = None


def read_limits(file: str | FilePath, arm: Arm) -> tuple[Limits, float | None, float | None]:
    """Read limits from a YAML file.

    Limits that the file leaves out are the arm's own; infinity lifts a limit, as in a job file.

    Args:
        file: The file.
        arm: The arm.

    Returns:
        The limits, and the largest deviation from the path [m] and from the required orientation
        [rad]; None where the file gives none.

    Raises:
        InvalidInput: No such file, not YAML, an unknown key, or a value that is not a limit.
    """
    place = FilePath(file)
    text = read_text(place, "limits file")
    data = load(text, place.name)
    if not isinstance(data, dict):
        raise InvalidInput(f"{place.name} must hold a mapping of limits such as speed: 0.15 m/s.")
    if "joint_limits" in data:
        raise InvalidInput(
            f"{place.name} is a file of joint limits of MoveIt, which belongs to the arm: give it "
            "with --joint-limits."
        )
    given = read_keys(Given(LimitsFile), data, place.name)
    deviations = [given.pop(name, None) for name in ("deviation", "orientation_deviation")]
    with error_context(place.name):
        limits = resolve_limits(place.name, arm, Limits(**given))
    return limits, *deviations
