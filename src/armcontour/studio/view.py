"""How points of the path get on the screen.

Points are metres in a plane: u along its x and v along its y from its origin. Rows of points are
relative to a centre, so that 32 bits are enough.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any, Protocol

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.geometry import Path

# The box of a path is computed from so many of its points, and from the ends of its segments.
LOOKS = 41


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
    # Boxes of paths by their identity; the paths are kept so that no other one has it.
    _boxes: dict[int, tuple[Path, FloatArray]] = field(default_factory=dict, init=False)

    def uv(self, points: FloatArray) -> FloatArray:
        """Points in the plane [m], (n, 2)."""
        axes = np.stack([self.plane.x, self.plane.y], axis=1)
        return np.asarray((in_space(points) - self.plane.origin) @ axes)

    def drawn(self, points: FloatArray) -> FloatArray:
        """Points relative to the centre, for the screen, (n, 2)."""
        return np.asarray(self.uv(points) - self.centre, dtype=np.float32)

    def box(self, path: Path) -> FloatArray:
        """Least and largest u and v of a path, and some more, from the centre [m], (4,)."""
        if id(path) not in self._boxes:
            s = np.linspace(0.0, path.length, LOOKS)
            uv = self.uv(path(np.union1d(path.breaks, s))) - self.centre
            # No point is farther from all of these than half a piece.
            more = np.full(2, path.length / (LOOKS - 1) / 2)
            self._boxes[id(path)] = path, np.append(uv.min(0) - more, uv.max(0) + more)
        return self._boxes[id(path)][1]

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
