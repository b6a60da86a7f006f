"""Masses and inertias of links that are assumed to be uniform tubes."""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Tube:
    """A uniform round tube, which stands for a link whose mass and inertia are not known.

    Args:
        outer_diameter: Outer diameter [m].
        wall: Thickness of the wall [m].
        density: Density of the material [kg/m³].

    Raises:
        InvalidInput: A value is not above zero, or the wall is thicker than the outer radius.
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
        """Mass of a tube of this length [kg]."""
        outer, inner = self._radii()
        return self.density * math.pi * (outer**2 - inner**2) * length

    def inertia(self, length: float) -> FloatArray:
        """Inertia of a tube of this length along y, about its middle [kg m²], (3, 3)."""
        outer, inner = self._radii()
        mass, squares = self.mass(length), outer**2 + inner**2
        across = mass * (3 * squares + length**2) / 12
        return np.diag([across, mass * squares / 2, across])

    def _radii(self) -> tuple[float, float]:
        """Outer and inner radius [m]."""
        outer = self.outer_diameter / 2
        return outer, outer - self.wall
