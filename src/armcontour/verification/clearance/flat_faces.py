"""Distances of convex bodies from the flat faces of boxes and half-spaces, in closed form."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.robot.scene import Box, HalfSpace, Shape


class FaceDistances:
    """Distances of a convex body from the flat faces of another body, for many placements at once.

    Of all points of the body, let x be the nearest to the plane of a face. Its height above the
    plane is a lower bound of the distance of the bodies, because the plane separates them. If the
    foot of x lies in the face, two points of the bodies have this distance, so it is exact.

    Args:
        flat: The body with flat faces.
        body: The other body, convex and bounded.
        flat_moves: Whether placements are those of `flat` in the frame of `body`, not the reverse.
    """

    def __init__(self, flat: Box | HalfSpace, body: Shape, flat_moves: bool) -> None:
        self._body = body
        self._flat_moves = flat_moves
        self._middle = body.ball[0]
        # A half-space has only its upper face, which is unbounded.
        self._bounded = isinstance(flat, Box)
        # Distances of the faces from the origin of `flat` [m], (3,).
        self._faces = flat.size / 2 if isinstance(flat, Box) else np.array([np.inf, np.inf, 0.0])

    def measure(self, rotations: FloatArray, positions: FloatArray) -> FloatArray:
        """Return the distances [m], (n,); NaN where no point of a face is the nearest.

        - `rotations`, `positions`: placements, (n, 3, 3), and [m], (n, 3).
        """
        if self._flat_moves:
            rotations = np.swapaxes(rotations, 1, 2)
            positions = -(rotations @ positions[:, :, None])[:, :, 0]
        rows = np.arange(len(positions))
        axes, sides = self._nearest_faces(rotations @ self._middle + positions)
        # The direction towards the face, in the frame of the body.
        towards = -sides[:, None] * rotations[rows, axes]
        nearest = (rotations @ self._body.farthest(towards)[:, :, None])[:, :, 0] + positions
        heights = sides * nearest[rows, axes] - self._faces[axes]
        outside = np.abs(nearest) > self._faces
        outside[rows, axes] = self._bounded & (heights <= 0)
        return np.where(outside.any(axis=1), np.nan, heights)

    def _nearest_faces(self, middles: FloatArray) -> tuple[IntArray, FloatArray]:
        """Return the axes of the faces' normals and their sides (1 or -1), (n,) each.

        - `middles`: middles of the body in the frame of `flat` [m], (n, 3).
        """
        if not self._bounded:
            return np.full(len(middles), 2), np.ones(len(middles))
        axes = np.argmax(np.abs(middles) - self._faces, axis=1)
        return axes, np.copysign(1.0, middles[np.arange(len(middles)), axes])


def face_distances(first: Shape, second: Shape) -> FaceDistances | None:
    """Return the distances of two convex bodies from flat faces of one; None if none is flat.

    - `first`, `second`: the bodies. Placements are those of the second in the frame of the first.
    """
    for kind in (HalfSpace, Box):
        if isinstance(first, kind) and not isinstance(second, HalfSpace):
            return FaceDistances(first, second, flat_moves=False)
        if isinstance(second, kind) and not isinstance(first, HalfSpace):
            return FaceDistances(second, first, flat_moves=True)
    return None
