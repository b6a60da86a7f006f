"""Triangles of shapes, for drawings in space."""

from __future__ import annotations

from functools import lru_cache
from itertools import product

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.robot.scene import Box, Capsule, Cylinder, Mesh, Shape, Sphere

# Number of sides of polygons that approximate circles.
SIDES = 24
# Meshes with more triangles are drawn as convex hulls.
MAX_TRIANGLES = 4_000


@lru_cache(maxsize=64)
def triangles_of(shape: Shape) -> FloatArray:
    """Return a shape's triangles with outward normals [m], (n, 3, 3); of large meshes the hull."""
    match shape:
        case Mesh() if shape.triangles is not None and len(shape.triangles) <= MAX_TRIANGLES:
            return np.asarray(shape.points[shape.triangles])
        case Mesh():
            points = shape.points
        case Box():
            points = shape.size / 2 * np.array(list(product((-1, 1), repeat=3)))
        case Cylinder():
            points = _ends(shape.length, _rings(shape.radius, np.zeros(1)))
        case Sphere() | Capsule():
            rings = _rings(shape.radius, np.linspace(-np.pi / 2, np.pi / 2, SIDES // 2 + 1))
            points = rings if isinstance(shape, Sphere) else _ends(shape.length, rings)
        case _:
            raise TypeError(f"A {type(shape).__name__} cannot be drawn as triangles.")
    return _hull_triangles(points)


def cone_triangles(start_radius: float, end_radius: float, length: float) -> FloatArray:
    """Return the triangles of a cut cone along z, from z = 0 to its length [m], (n, 3, 3)."""
    start = _rings(start_radius, np.zeros(1))
    end = _rings(end_radius, np.zeros(1)) + [0.0, 0.0, length]
    return _hull_triangles(np.concatenate([start, end]))


def _hull_triangles(points: FloatArray) -> FloatArray:
    """Return the triangles of the convex hull of points, with outward normals [m], (n, 3, 3)."""
    from scipy.spatial import ConvexHull

    hull = ConvexHull(points)
    corners = hull.points[hull.simplices]
    # The normals in `equations` point outwards, but the vertex order of the simplices is arbitrary.
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    inside_out = np.einsum("ij,ij->i", across, hull.equations[:, :3]) < 0
    corners[inside_out] = corners[inside_out][:, ::-1]
    return np.asarray(corners)


def _rings(radius: float, heights: FloatArray) -> FloatArray:
    """Return points on circles of latitude of a sphere about the origin [m], (n, 3)."""
    angle, height = np.meshgrid(np.arange(SIDES) * 2 * np.pi / SIDES, heights)
    flat = np.cos(height)
    parts = (flat * np.cos(angle), flat * np.sin(angle), np.sin(height))
    return radius * np.stack(parts, axis=-1).reshape(-1, 3)


def _ends(length: float, points: FloatArray) -> FloatArray:
    """Move points to both ends of a body along z."""
    half = np.array([0.0, 0.0, length / 2])
    return np.concatenate([points - half, points + half])
