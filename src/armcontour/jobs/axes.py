"""Where a part or a base may be placed: axes with ranges, and the grid of all places."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import product
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput

# The axes, with their units; in a grid the last one changes fastest.
UNITS = {"x": "m", "y": "m", "z": "m", "yaw": "rad", "tilt": "rad"}
AXES = tuple(UNITS)
LENGTHS = AXES[:3]
# In the plane of a planar arm.
IN_PLANE = ("x", "y", "yaw")
# Largest number of places of a grid: about 0.5 kB each, and an hour of bounds.
MOST_PLACES = 500_000
# Decimals of places in SI units.
DIGITS = 12
# Places, uncertainties and the anchor are no farther away than this [m, rad]: more is a mistake in
# a unit or a digit, and rounds.
FARTHEST = {"m": 1e4, "rad": 1e3}
# Ends of a range of angles count as the same direction within this [rad].
SAME_DIRECTION = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Axis:
    """One axis of a grid.

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
        """Its unit."""
        return UNITS[self.name]

    @property
    def step(self) -> float:
        """Distance of neighbouring places; 0 for a single one."""
        return float(np.diff(self.values).max()) if len(self.values) > 1 else 0.0


def read_axes(over: Mapping[str, Sequence[Any]], dimension: int) -> tuple[Axis, ...]:
    """The axes of a grid, in the order of `AXES`.

    Args:
        over: Of some axes the first value, the last value and the number of values.
        dimension: Dimension of the tool motion of the arm, 2 or 3.

    Raises:
        InvalidInput: No axis, an unknown one, an empty range, or too many places.
    """
    known = AXES if dimension == 3 else IN_PLANE
    if not isinstance(over, Mapping) or not over:
        raise InvalidInput(
            "over names the axes along which to place, each with its range and number of places, "
            "such as over={'x': (-0.1, 0.1, 11)}; in a job file they are the key placement.over."
        )
    for name in over:
        _refuse_axis(name, known, "over")
    found = tuple(_axis(x, over[x]) for x in known if x in over)
    count = math.prod(len(x.values) for x in found)
    if count > MOST_PLACES:
        raise InvalidInput(
            f"over has {count:,} places, but at most {MOST_PLACES:,} are compared: take fewer "
            "steps, and refine around the best place.",
            needed=count,
            allowed=MOST_PLACES,
        )
    return found


def read_uncertainty(given: Mapping[str, float], dimension: int) -> dict[str, float]:
    """By how much a part may be off its place, of some axes [m, rad]; zeros are left out.

    Raises:
        InvalidInput: An unknown axis, or a value below zero.
    """
    known = AXES if dimension == 3 else IN_PLANE
    for name in given:
        _refuse_axis(name, known, "uncertainty")
    sizes = {
        name: checks.check_range(
            f"uncertainty of {name}", given[name], 0, FARTHEST[UNITS[name]], UNITS[name]
        )
        for name in known
        if name in given
    }
    return {name: size for name, size in sizes.items() if size}


def corners_of(uncertainty: Mapping[str, float]) -> list[dict[str, float]]:
    """The corners of the box of an uncertainty, as differences [m, rad]; none without one."""
    if not uncertainty:
        return []
    signs = product((-1.0, 1.0), repeat=len(uncertainty))
    return [
        {name: sign * size for sign, (name, size) in zip(of, uncertainty.items(), strict=True)}
        for of in signs
    ]


def _refuse_axis(name: str, known: tuple[str, ...], what: str) -> None:
    """Refuse an axis that is not there.

    Raises:
        InvalidInput: The axis is unknown.
    """
    if name not in known:
        plane = " for an arm in the plane" if name in AXES else ""
        raise InvalidInput(f"{what} has no axis {name!r}{plane}: axes are {', '.join(known)}.")


def _axis(name: str, given: Sequence[Any]) -> Axis:
    """An axis: a whole turn ends before its start, as both are one direction.

    Raises:
        InvalidInput: An empty range, or no whole number of places above zero.
    """
    if isinstance(given, str) or len(given) != 3:
        raise InvalidInput(
            f"over {name} takes the first value, the last value and the number of places, such as "
            "(-0.1, 0.1, 11)."
        )
    unit = UNITS[name]
    far = FARTHEST[unit]
    low, high = (checks.check_range(f"over {name}", x, -far, far, unit) for x in given[:2])
    count = checks.check_int(f"number of places along {name}", given[2], 1, MOST_PLACES)
    if low > high:
        raise InvalidInput(
            f"The range of {name} from {low:g} to {high:g} {unit} is empty: give the smaller value "
            "first.",
            needed=low,
            allowed=high,
        )
    if (low == high) != (count == 1):
        raise InvalidInput(
            f"{count} place{'s' * (count != 1)} along {name} from {low:g} to {high:g} {unit}: give "
            "two places or more of a range, or the same value twice and one place."
        )
    whole = unit == "rad" and abs(high - low - 2 * np.pi) < SAME_DIRECTION
    # Without the rounding errors of steps: 0 is 0.
    values = np.round(np.linspace(low, high, count, endpoint=not whole), DIGITS) + 0.0
    return Axis(name=name, values=checks.frozen_array(values), whole_turn=whole)
