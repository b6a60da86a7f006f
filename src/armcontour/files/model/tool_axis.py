"""Tool axes that follow from the faces at an edge: the bisector, or the normal of one face."""

from __future__ import annotations

from math import radians
from typing import TYPE_CHECKING, Annotated

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import Angle, Items, Size

if TYPE_CHECKING:
    from armcontour.files.model.edge_chains import Link

# Below this length, the sum of two unit normals has no direction.
OPPOSITE = 1e-3
# Largest travel and work angles [rad]; at 90 degrees the tool lies along the edge or on a face.
LARGEST_ANGLE = radians(85.0)
# Parallel vectors have a cross product below this.
PARALLEL = 1e-6


@declared()
class Bisector(Checked):
    """A tool axis that points from the middle between both faces into the edge.

    The contour has the first face on its left, seen from outside: with `seams` a face of the first
    part, with `face` this face. At a corner, where the faces change, the axis turns over a stated
    length.

    >>> from armcontour.files.model import Bisector
    >>> Bisector(travel=np.radians(-10)).blend
    0.01

    Args:
        work: Work angle: rotation of the axis about the direction of travel [rad]. A positive angle
            leans the tool over the first face.
        travel: Travel angle [rad]: positive if the tool points forwards (push), negative if it
            points backwards (drag).
        blend: Length before and after a corner over which the axis turns [m], at most half the
            distance to the next corner.

    Raises:
        InvalidInput: An angle exceeds 85 degrees, or the length is not above zero.
    """

    work: Angle = 0.0
    travel: Angle = 0.0
    blend: Size = 0.01

    def _check_together(self) -> None:
        for name in ("work", "travel"):
            angle = getattr(self, name)
            if abs(angle) > LARGEST_ANGLE:
                raise InvalidInput(
                    f"{name} must be between -85 and 85 deg, but is {np.degrees(angle):.4g} deg."
                )

    def outward(self, link: Link, v: FloatArray) -> FloatArray:
        """Return the directions from an edge to the tool, before work and travel angle, (n, 3).

        Args:
            link: The edge in its chain.
            v: Fractions of the edge in the direction of travel, (n,).
        """
        normals = link.normals(v)
        if len(normals) != 2:
            raise InvalidInput(
                f"Edge {link.index + 1} has {len(normals)} face{'s'[: len(normals) != 1]}, but a "
                "bisector requires two. Use the orientation face, or select other edges."
            )
        out = normals[0] + normals[1]
        size = np.linalg.norm(out, axis=1, keepdims=True)
        if (size < OPPOSITE).any():
            raise InvalidInput(
                f"The faces at edge {link.index + 1} are opposite, so they have no bisector. Use "
                "the orientation face, or select other edges."
            )
        return np.asarray(out / size)

    def axes(self, link: Link, v: FloatArray) -> FloatArray:
        """Return the directions of the tool axis, (n, 3), which point from the tool to the edge.

        With the axis z without these angles, the direction of travel t perpendicular to it, and
        b = z × t, the work angle w and the travel angle a:

            z' = cos w z + sin w b,  z'' = cos a z' + sin a t

        Args:
            link: The edge in its chain.
            v: Fractions of the edge in the direction of travel, (n,).
        """
        z = -self.outward(link, v)
        along = link.tangents(v)
        # Edges in files are not exactly on their faces, so their tangents are not exactly
        # perpendicular to the normals.
        along = along - np.sum(along * z, axis=1, keepdims=True) * z
        size = np.linalg.norm(along, axis=1, keepdims=True)
        if (size < PARALLEL).any():
            raise InvalidInput(f"A face at edge {link.index + 1} is perpendicular to the edge.")
        along = along / size
        leaned = np.cos(self.work) * z + np.sin(self.work) * np.cross(z, along)
        return np.asarray(np.cos(self.travel) * leaned + np.sin(self.travel) * along)


@declared()
class FaceNormal(Bisector):
    """A tool axis that is perpendicular to one face at the edge, and points into it.

    >>> from armcontour.files.model import FaceNormal
    >>> FaceNormal(up=[0, 0, 1]).work
    0.0

    Args:
        up: Of the two faces at an edge, the one whose outward normal is nearer to this direction;
            by default the face that the rule of the edge names.

    Raises:
        InvalidInput: `up` is zero or does not have three finite numbers, or as in `Bisector`.
    """

    up: Annotated[list[float], Items(3, 3)] | None = None

    def _check_together(self) -> None:
        Bisector._check_together(self)
        if self.up is None:
            return
        if len(self.up) != 3 or not any(self.up) or not np.isfinite(self.up).all():
            raise InvalidInput("up must be a direction of three finite numbers, not all zero.")

    def outward(self, link: Link, v: FloatArray) -> FloatArray:
        """Return the directions from an edge to the tool, as in `Bisector`."""
        normals = link.normals(v)
        if self.up is None:
            return normals[0]
        middle = link.normals(np.array([0.5]))
        # Without this division, products of huge numbers would overflow.
        up = np.array(self.up) / np.abs(self.up).max()
        return normals[int(np.argmax([x[0] @ up for x in middle]))]


# The default.
BISECTOR = Bisector()
