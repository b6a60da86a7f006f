"""`Exports`: the files for robot controllers that a job requests."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from pathlib import PurePath
from typing import Annotated

from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import About, AtLeast, Factor, Interval, Quantity
from armcontour.core.text import show

# Extensions of exported files by the name of the format.
ENDINGS = {
    "csv": ".csv",
    "ros-yaml": ".yaml",
    "urscript": ".script",
    "kuka": ".src",
    "abb": ".mod",
}
# Extension of a template of the user.
TEMPLATE = ".j2"
PointTolerance = Annotated[float, Quantity("rad", "0.1 mrad", "positive")]
# Sections of the help for options that set these keys.
FILES, POINTS = "Files for robot controllers", "Points of these files"


def ending_of(format: str) -> str:
    """Extension of the file of a format or template, such as ".src" for "house.src.j2"."""
    if format in ENDINGS:
        return ENDINGS[format]
    if not format.endswith(TEMPLATE):
        raise InvalidInput(
            f"There is no format {show(format)}. The formats are {', '.join(ENDINGS)}, and "
            f"templates of your own, such as house{TEMPLATE}."
        )
    return PurePath(format.removesuffix(TEMPLATE)).suffix or ".txt"


@declared(eq=False)
class Exports(Checked):
    """Files for robot controllers that `run` writes.

    Args:
        formats: Formats: csv, ros-yaml, urscript, kuka, abb, or a template such as house.j2.
        outputs: Output of each event and analog output of the process, by name, such as `{laser: 0,
            power: AO0}`.
        tolerances: With ros-yaml, ratio of the tolerances of a FollowJointTrajectory goal to the
            predicted joint errors, at least 1; by default no goal.
        cycle: Time between points of the plan [s]; by default the cycle of the run.
        derivatives: Highest derivative of the positions: 2, 1 or 0; by default 2, or 0 for
            set-points with command limits.
        points: With ros-yaml, largest number of points.
        point_tolerance: With `points`, largest difference that fewer points cause at any joint
            [rad].
        call: With urscript, whether the program is called at the end of its file, for the script
            file of a pendant.
    """

    formats: Annotated[Sequence[str], About("--export", FILES, read="to_formats")] = ()
    outputs: Mapping[str, int | str] = field(default_factory=dict)
    tolerances: Annotated[Factor | None, About("--tolerances", FILES)] = None
    cycle: Annotated[Interval | None, About("--cycle", POINTS)] = None
    derivatives: Annotated[Annotated[int, AtLeast(0, 2)] | None, About("--derivatives", POINTS)] = (
        None
    )
    points: Annotated[Annotated[int, AtLeast(2)] | None, About("--points", POINTS)] = None
    point_tolerance: Annotated[PointTolerance | None, About("--point-tolerance", POINTS)] = None
    call: Annotated[bool, About("--call", POINTS)] = False

    def _check_together(self) -> None:
        taken: dict[str, str] = {}
        for name in self.formats:
            other = taken.setdefault(ending_of(name), name)
            if other is not name:
                raise InvalidInput(
                    f"The formats {other} and {name} are written to the same file. Remove one of "
                    "them, or use a template with another extension, such as cell.txt.j2."
                )
        if (self.points is None) != (self.point_tolerance is None):
            raise InvalidInput("points and point_tolerance require each other. Specify both.")
        if self.tolerances is not None and self.tolerances < 1:
            raise InvalidInput(
                f"tolerances must be at least 1, but is {self.tolerances:g}.", allowed=1.0
            )
        for key, format in (
            ("tolerances", "ros-yaml"),
            ("points", "ros-yaml"),
            ("call", "urscript"),
        ):
            if self.formats and getattr(self, key) and format not in self.formats:
                raise InvalidInput(
                    f"{key} requires the format {format}. Remove {key}, or export {format}."
                )
