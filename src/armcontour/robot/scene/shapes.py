"""Shapes of bodies, each in a frame of its own."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import Annotated

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked
from armcontour.core.quantities import Axes, Quantity, Size

# A mesh whose largest size [m] is outside this range was probably read in another unit.
SMALLEST, LARGEST = 1e-3, 20.0


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Shape(Checked, ABC):
    """A shape in a frame of its own."""

    @property
    @abstractmethod
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a ball that holds the shape."""


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Sphere(Shape):
    """A ball about the origin.

    Args:
        radius: Its radius [m].
    """

    radius: Size = field(kw_only=False)

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of the ball itself."""
        return np.zeros(3), self.radius


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Capsule(Shape):
    """All points near a stretch of the z axis, half of which is above the origin.

    Args:
        radius: Distance of the surface from the stretch [m].
        length: Length of the stretch, without the round ends [m].
    """

    radius: Size = field(kw_only=False)
    length: Size = field(kw_only=False)

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a ball that holds the capsule."""
        return np.zeros(3), self.length / 2 + self.radius


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Cylinder(Shape):
    """A round cylinder along the z axis, half of which is above the origin.

    Args:
        radius: Its radius [m].
        length: Its length [m].
    """

    radius: Size = field(kw_only=False)
    length: Size = field(kw_only=False)

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a ball that holds the cylinder."""
        return np.zeros(3), float(np.hypot(self.length / 2, self.radius))


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Box(Shape):
    """A box about the origin.

    Args:
        size: Its lengths along x, y and z [m], (3,).
    """

    size: Annotated[FloatArray, Quantity("m", "5 mm", "positive"), Axes(3)] = field(kw_only=False)

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a ball that holds the box."""
        return np.zeros(3), float(np.linalg.norm(self.size) / 2)


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class HalfSpace(Shape):
    """All points below the plane z = 0, such as a table or a floor."""

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """No ball holds a half-space: its radius is infinite."""
        return np.zeros(3), np.inf


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False, weakref_slot=True)
class Mesh(Shape):
    """A body within triangles; distances are those of its convex hull, or of the triangles.

    Args:
        points: Corners of the triangles [m], (n, 3).
        triangles: Indices of the three corners of each triangle, (m, 3); none for the convex hull
            of the points.
        source: Where the mesh comes from, for messages.

    Raises:
        InvalidInput: Fewer than 4 points, points in a plane, or triangles of other points.
    """

    points: Annotated[FloatArray, Quantity("m"), Axes("points", 3)] = field(kw_only=False)
    triangles: Annotated[IntArray, Axes("triangles", 3)] | None = None
    source: str = ""
    _hull: Mesh | None = field(init=False, default=None, repr=False)

    def _check_together(self) -> None:
        who, points, corners = self.source or "a mesh", self.points, self.triangles
        if len(points) < 4:
            raise InvalidInput(f"{who} needs at least 4 points of 3 coordinates [m].")
        spread = np.linalg.svd(points - points.mean(axis=0), compute_uv=False)
        if spread[2] <= 1e-9 * spread[0]:
            raise InvalidInput(f"All points of {who} lie in a plane: a body has a volume.")
        if corners is None:
            return
        if not len(corners) or corners.min() < 0 or corners.max() >= len(points):
            raise InvalidInput(f"A triangle of {who} has a corner that is none of its points.")

    @property
    def hull(self) -> Mesh:
        """Its convex hull: the same points, without triangles."""
        if self.triangles is None:
            return self
        if self._hull is None:
            # Kept, as libraries keep what they compute of a mesh for as long as it lives.
            object.__setattr__(self, "_hull", Mesh(points=self.points, source=self.source))
        assert self._hull is not None
        return self._hull

    @property
    def size(self) -> float:
        """The largest of its lengths along x, y and z [m]."""
        return float(np.ptp(self.points, axis=0).max())

    @property
    def ball(self) -> tuple[FloatArray, float]:
        """Centre [m], (3,), and radius [m] of a ball that holds all points."""
        middle = (self.points.max(axis=0) + self.points.min(axis=0)) / 2
        return middle, float(np.linalg.norm(self.points - middle, axis=1).max())
