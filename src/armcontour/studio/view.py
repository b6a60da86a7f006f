"""How points of the path get on the screen.

Points are metres in a plane: u along its x and v along its y from its origin. Rows of points are
relative to a centre, so that 32 bits are enough.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, Protocol

import numpy as np

from armcontour._checks import FloatArray


class Plane(Protocol):
    """A plane in the coordinates of the path: its origin [m], and its axes, (3,) each."""

    @property
    def origin(self) -> FloatArray:
        """A point of it [m]."""

    @property
    def x(self) -> FloatArray:
        """Direction of u."""

    @property
    def y(self) -> FloatArray:
        """Direction of v."""


@dataclass(frozen=True, slots=True, eq=False)
class View:
    """How points get on the screen.

    Args:
        plane: The plane of the picture.
        centre: The point of the plane that arrays of points are relative to [m], (2,).
    """

    plane: Plane
    centre: FloatArray

    def uv(self, points: FloatArray) -> FloatArray:
        """Points in the plane [m], (n, 2)."""
        axes = np.stack([self.plane.x, self.plane.y], axis=1)
        return np.asarray((in_space(points) - self.plane.origin) @ axes)

    def drawn(self, points: FloatArray) -> FloatArray:
        """Points relative to the centre, for the screen, (n, 2)."""
        return np.asarray(self.uv(points) - self.centre, dtype=np.float32)

    def offsets(self, vectors: FloatArray) -> FloatArray:
        """Vectors in the plane, for the screen, (n, 2)."""
        axes = np.stack([self.plane.x, self.plane.y], axis=1)
        return np.asarray(in_space(vectors) @ axes, dtype=np.float32)

    def is_flat(self, points: FloatArray) -> bool:
        """Whether points are in the plane, but for what nobody sees."""
        if points.shape[-1] == 2:
            return True
        away = (in_space(points) - self.plane.origin) @ np.cross(self.plane.x, self.plane.y)
        return bool(np.abs(away).max(initial=0.0) < 1e-7)

    @property
    def header(self) -> dict[str, Any]:
        """The plane and the centre."""
        plane = self.plane
        return {
            "plane": {"origin": plane.origin, "x": plane.x, "y": plane.y},
            "centre": self.centre,
        }


def in_space(points: FloatArray) -> FloatArray:
    """Points of the plane in space, with z = 0, (n, 3)."""
    if points.shape[-1] == 3:
        return points
    return np.concatenate([points, np.zeros((*points.shape[:-1], 1))], axis=-1)


def short(values: FloatArray) -> Any:
    """Values in 32 bits, for the screen."""
    return np.ascontiguousarray(values, dtype=np.float32)
