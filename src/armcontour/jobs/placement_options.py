"""`PlaceSearch`: options of a placement search (grid, objective and uncertainty)."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from itertools import product
from typing import Annotated, Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.quantities import About, Choice
from armcontour.robot.scene import BASE, PART

# Axes of a search and their units. In a grid, the last axis changes fastest.
UNITS = {"x": "m", "y": "m", "z": "m", "yaw": "rad", "tilt": "rad"}
AXES = tuple(UNITS)
LENGTHS = AXES[:3]
# Axes for a planar arm.
IN_PLANE = ("x", "y", "yaw")
# Maximum number of candidates in a grid: 0.5 kB each, and an hour for the bounds of all.
MAX_PLACES = 500_000
# Number of decimals of coordinates in SI units.
DIGITS = 12
# Maximum amounts of coordinates, uncertainties and the anchor [m, rad]. Larger values are mistakes
# in a unit or a digit, and would cause rounding errors.
FARTHEST = {"m": 1e4, "rad": 1e3}
# If a range of angles differs from a full turn by less than this, its ends count as equal [rad].
SAME_DIRECTION = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axis:
    """Axis of the grid of a placement search.

    Args:
        name: "x", "y", "z", "yaw" or "tilt".
        values: The places on it, increasing [m, rad], (n,).
        whole_turn: Whether they go around, so that the first one follows the last.
    """

    name: str
    values: FloatArray
    whole_turn: bool = False

    @property
    def unit(self) -> str:
        """Unit of the axis."""
        return UNITS[self.name]

    @property
    def step(self) -> float:
        """Largest distance of adjacent values [m or rad]; 0 for a single value."""
        return float(np.diff(self.values).max()) if len(self.values) > 1 else 0.0


def read_axes(over: Mapping[str, Sequence[Any]], dimension: int) -> tuple[Axis, ...]:
    """Read the axes of a grid, in the order of `AXES`."""
    names = AXES if dimension == 3 else IN_PLANE
    if not isinstance(over, Mapping) or not over:
        raise InvalidInput(
            "over must be a mapping of the axes of the search to their ranges and numbers of "
            "places, such as over={'x': (-0.1, 0.1, 11)}. In a job file, use the key "
            "placement.over."
        )
    for name in over:
        _check_axis(name, names, "over")
    axes = tuple(_axis(x, over[x]) for x in names if x in over)
    count = math.prod(len(x.values) for x in axes)
    if count > MAX_PLACES:
        raise InvalidInput(
            f"over has {count:,} places, but at most {MAX_PLACES:,} are allowed. Use fewer steps, "
            "and refine around the best place.",
            needed=count,
            allowed=MAX_PLACES,
        )
    return axes


def read_uncertainty(deviations: Mapping[str, float], dimension: int) -> dict[str, float]:
    """Read the position uncertainty of the part by axis [m or rad]; zeros are omitted."""
    names = AXES if dimension == 3 else IN_PLANE
    for name in deviations:
        _check_axis(name, names, "uncertainty")
    sizes = {
        name: checks.check_range(
            f"uncertainty of {name}", deviations[name], 0, FARTHEST[UNITS[name]], UNITS[name]
        )
        for name in names
        if name in deviations
    }
    return {name: size for name, size in sizes.items() if size}


def corners_of(uncertainty: Mapping[str, float]) -> list[dict[str, float]]:
    """Corners of an uncertainty box, as shifts by axis [m or rad]; empty without uncertainty."""
    if not uncertainty:
        return []
    signs = product((-1.0, 1.0), repeat=len(uncertainty))
    return [
        {name: sign * size for sign, (name, size) in zip(corner, uncertainty.items(), strict=True)}
        for corner in signs
    ]


def _check_axis(name: str, names: tuple[str, ...], label: str) -> None:
    """Raise InvalidInput if an axis does not exist for this arm."""
    if name not in names:
        plane = " for a planar arm" if name in AXES else ""
        raise InvalidInput(f"{label} has no axis {name!r}{plane}. The axes are {', '.join(names)}.")


def _axis(name: str, limits: Sequence[Any]) -> Axis:
    """Read an axis; the last value of a full turn is omitted, because it equals the first one."""
    if isinstance(limits, str) or len(limits) != 3:
        raise InvalidInput(
            f"over {name} must have the first value, the last value and the number of places, such "
            "as (-0.1, 0.1, 11)."
        )
    unit = UNITS[name]
    far = FARTHEST[unit]
    low, high = (checks.check_range(f"over {name}", x, -far, far, unit) for x in limits[:2])
    count = checks.check_int(f"number of places along {name}", limits[2], 1, MAX_PLACES)
    if low > high:
        raise InvalidInput(
            f"The range of {name} from {low:g} to {high:g} {unit} is empty. Specify the smaller "
            "value first.",
            needed=low,
            allowed=high,
        )
    if (low == high) != (count == 1):
        raise InvalidInput(
            f"over {name} has {count} place{'s' * (count != 1)} from {low:g} to {high:g} {unit}. "
            "Specify at least two places for a range, or one place and the same value twice."
        )
    whole = unit == "rad" and abs(high - low - 2 * np.pi) < SAME_DIRECTION
    # Values are rounded, so that 0 is exactly 0 in spite of rounding errors of the steps.
    values = np.round(np.linspace(low, high, count, endpoint=not whole), DIGITS) + 0.0
    return Axis(name=name, values=checks.frozen_array(values), whole_turn=whole)


DURATION, MANIPULABILITY, CLEARANCE, TORQUE = "duration", "manipulability", "clearance", "torque"
OBJECTIVES = (DURATION, MANIPULABILITY, CLEARANCE, TORQUE)
# Objects that a search can move.
WHAT = (PART, BASE)
# Named points to which x, y, z and angles refer: middle of the path, or origin of its coordinates.
MIDDLE, ORIGIN = POINTS = ("middle", "origin")
SPACE = 3
# Help texts of options.
OVER = "Axis (x, y, z, yaw or tilt), range and number of places: 'x: -300 mm .. 300 mm, 25'."
OFF = "Position error of the part; the worst corner of it counts: 'x: 2 mm'; 0 removes an axis."


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PlaceSearch(Checked):
    """Options of a placement search: grid of placements, objective and uncertainty.

    >>> search = ac.PlaceSearch(over={"x": (-0.01, 0.01, 3)}, objective="duration")
    >>> search.objective
    'duration'

    Args:
        over: The axes of the grid, each with its first value, its last value and the number of
            values: "x", "y" and "z" [m], "yaw" about z and "tilt" about y of the turned part [rad],
            along the coordinates of the job's path.
        objective: Criterion: "duration", the shortest duration; "manipulability", the largest
            minimum of the smallest singular value along the path; "clearance", the largest minimum
            distance; or "torque", the largest unused share of the torque limits.
        uncertainty: Position error of the part, of some axes [m, rad]: each place is rated by its
            worst case, planned at the place and at each corner of this box. 0 ignores the axis.
        what: Moved object: the "part", with the obstacles that are fixed to it; or the "base" of
            the arm, relative to its cell.
        absolute: Whether x, y and z are the new coordinates of the point `about`; by default they
            are added to its coordinates.
        about: The point to which x, y and z refer and about which angles rotate: the "middle" of
            the path, the "origin" of its coordinates, or a point [m], (3,). A base rotates about
            its own origin.
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
            raise InvalidInput(
                f"about must be a point with 3 coordinates in m, but has {about.size}."
            )
        for axis in about:
            checks.check_range("about", axis, -FARTHEST["m"], FARTHEST["m"], "m")

    def check(self, dimension: int) -> None:
        """Check that the axes of the search exist for an arm.

        Args:
            dimension: Dimension of the tool motion of the arm, 2 or 3.

        Raises:
            InvalidInput: An axis does not exist.
        """
        if self.over:
            read_axes(self.over, dimension)
        read_uncertainty(self.uncertainty, dimension)
