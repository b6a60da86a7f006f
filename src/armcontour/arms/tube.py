"""Links of which nothing is known but a rule: uniform tubes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tube:
    """A uniform round tube, a body to assume where a link's own is not known.

    Args:
        outer_diameter: [m].
        wall: Its thickness [m].
        density: [kg/m³].

    Raises:
        InvalidInput: Not above zero, or a wall that is thicker than the tube.
    """

    outer_diameter: float
    wall: float
    density: float

    def __post_init__(self) -> None:
        units = {"outer_diameter": "m", "wall": "m", "density": "kg/m³"}
        for name, unit in units.items():
            object.__setattr__(self, name, _checks.positive(name, getattr(self, name), unit))
        if 2 * self.wall > self.outer_diameter:
            raise InvalidInput(
                f"The wall of a tube must be at most half its outer diameter of "
                f"{self.outer_diameter:g} m, but is {self.wall:g} m."
            )

    def mass(self, length: float) -> float:
        """Mass of a piece of it [kg]."""
        outer, inner = self._radii()
        return self.density * math.pi * (outer**2 - inner**2) * length

    def inertia(self, length: float) -> FloatArray:
        """Inertia of a piece along y, about its middle [kg m²], (3, 3)."""
        outer, inner = self._radii()
        mass, squares = self.mass(length), outer**2 + inner**2
        across = mass * (3 * squares + length**2) / 12
        return np.diag([across, mass * squares / 2, across])

    def _radii(self) -> tuple[float, float]:
        outer = self.outer_diameter / 2
        return outer, outer - self.wall
