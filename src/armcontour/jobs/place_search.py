"""`PlaceSearch`: where a placement looks for the best place, and what is best."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from typing import Annotated, Any

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.quantities import About, Choice
from armcontour.jobs.axes import FARTHEST, read_axes, read_uncertainty
from armcontour.robot.scene.scene import BASE, PART

DURATION, MANIPULABILITY, CLEARANCE, TORQUE = "duration", "manipulability", "clearance", "torque"
OBJECTIVES = (DURATION, MANIPULABILITY, CLEARANCE, TORQUE)
# What can be moved.
WHAT = (PART, BASE)
# Points that x, y, z and angles are of: the middle of the path, or the origin of its coordinates.
MIDDLE, ORIGIN = POINTS = ("middle", "origin")
SPACE = 3
# Help of options.
OVER = "Axis (x, y, z, yaw or tilt), range and number of places: 'x: -300 mm .. 300 mm, 25'."
OFF = "Position error of the part, whose worst corner counts: 'x: 2 mm'; 0 takes an axis out."


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaceSearch(Checked):
    """Where a placement looks for the best place, and what is best.

    Args:
        over: The axes of the grid, each with its first value, its last value and the number of
            values: "x", "y" and "z" [m], "yaw" about z and "tilt" about y of the turned part [rad],
            along the coordinates of the job's path.
        objective: What is best: "duration", the shortest duration; "manipulability", the largest of
            the least singular values along the path; "clearance", the largest of the least
            distances; or "torque", the largest share of the torque limits that is left free.
        uncertainty: Position error of the part, of some axes [m, rad]: each place is rated by the
            worst of it and of the corners of this box, planned for each. 0 is as if the axis were
            not named.
        what: What is moved: the "part", with the obstacles that are fixed to it; or the "base" of
            the arm, whose cell stays.
        absolute: Whether x, y and z are coordinates of the point that they move; by default they
            are added to it.
        about: The point that they move, and that angles turn about: the "middle" of the path, the
            "origin" of its coordinates, or a point [m], (3,). A base turns about its own origin.
        every: Whether to plan every place, for a map without bounds; this takes far longer.
        refined: Whether to look for a better place between those of the grid.
        run: Name of the run; by default the only one, or the only one with the timing optimal.

    Raises:
        InvalidInput: No such axis, objective or point, an empty range, or too many places.
    """

    over: Annotated[
        Mapping[str, Sequence[Any]],
        About("--over", help=OVER, read="to_axes", key="*"),
    ] = field(default_factory=dict)
    objective: Annotated[str, Choice(OBJECTIVES), About("--objective")] = DURATION
    uncertainty: Annotated[
        Mapping[str, float], About("--uncertainty", help=OFF, read="to_offsets", key="*")
    ] = field(default_factory=dict)
    what: Annotated[str, Choice(WHAT), About("--move")] = PART
    absolute: Annotated[bool, About("--absolute/--relative")] = False
    about: Annotated[
        Annotated[str, Choice(POINTS)] | Sequence[float], About("--about", read="to_anchor")
    ] = MIDDLE
    every: Annotated[bool, About("--every/--no-every")] = False
    refined: Annotated[bool, About("--refine/--no-refine")] = True
    run: str | None = None

    def _check_together(self) -> None:
        self.check(SPACE)
        if isinstance(self.about, str):
            return
        about = checks.check_numbers("about", self.about, "m")
        if about.shape != (SPACE,):
            raise InvalidInput(f"about is a point of 3 coordinates in m, not {about.size}.")
        for x in about:
            checks.check_range("about", x, -FARTHEST["m"], FARTHEST["m"], "m")

    def check(self, dimension: int) -> None:
        """Refuse axes that an arm has not.

        Args:
            dimension: Dimension of the tool motion of the arm, 2 or 3.

        Raises:
            InvalidInput: There is such an axis.
        """
        if self.over:
            read_axes(self.over, dimension)
        read_uncertainty(self.uncertainty, dimension)
