"""`ArmOptions`, the options for loading an arm, and their checks."""

from __future__ import annotations

from dataclasses import dataclass, fields
from pathlib import Path as FilePath

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked

# Extension of robot descriptions.
DESCRIPTION = ".urdf"
# Maximum length of the name of a robot, joint or link [characters]. It is large, because some
# packages add prefixes to names.
MAX_CHARACTERS = 1000
# Options that are valid for any arm; the others are only for robot descriptions.
ANY_OPTIONS = ("joint_limits", "srdf", "calibration")


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class ArmOptions(Checked):
    """Options for loading an arm.

    >>> options = ac.ArmOptions(tip="tool0")
    >>> options.tip
    'tool0'

    Args:
        tip: Link at the end of the arm, for a robot description (.urdf); by default `tool0`, or
            `flange` if there is no `tool0`.
        base: Fixed link at the start of the arm, for a robot description; by default the root.
        joint_limits: A joint_limits.yaml of MoveIt, which replaces limits of the arm's own file.
            Its default scaling factors are not applied.
        calibration: File of UR's `ur_calibration` for a built-in UR arm (.yaml): the transforms of
            the six links of your robot, which differ from the nominal ones by up to centimetres at
            the tool.
        srdf: A file of MoveIt (.srdf) with the pairs of links that may touch each other.

    Raises:
        InvalidInput: A value has the wrong type.
    """

    tip: str | None = None
    base: str | None = None
    joint_limits: str | FilePath | None = None
    calibration: str | FilePath | None = None
    srdf: str | FilePath | None = None

    @property
    def limits_file(self) -> FilePath | None:
        """Path of `joint_limits`; None if it is not specified."""
        return None if self.joint_limits is None else FilePath(self.joint_limits)


def check_options(options: ArmOptions, arm: str) -> None:
    """Check that only options of any arm are specified; `arm` is for messages."""
    for option in fields(ArmOptions):
        if option.name not in ANY_OPTIONS and getattr(options, option.name):
            raise InvalidInput(
                f"{arm} has no option {option.name}, which is valid only for .urdf files."
            )
