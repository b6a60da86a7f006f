"""Lead-in and lead-out of a contour: a line along the tangent, or a tangent quarter circle."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.prescribed_orientation import tangent_rates
from armcontour.geometry.segments import Segments

# Angle of a quarter circle [rad].
QUARTER = np.pi / 2
# Smallest sine of the angle between tangent and `up`. Below it, left and right are undefined.
VERTICAL = 1e-6
# Largest sine of the angle by which a contour may turn at a vertex towards the side of an arc lead.
# With a larger angle, the contour would cross the arc where contact is not ignored (see
# `IGNORED_CONTACT` in kerf.py).
MAX_INWARD_TURN = 0.005


def lead_path(
    path: Path,
    length: float,  # Length of the lead [m]
    shape: str,
    side: str,  # Side of the path on which an arc lies, seen in the direction of travel
    up: FloatArray,  # In space, the upward direction, which defines left and right, (3,)
    *,
    after: bool,  # True for the lead-out
    beyond: FloatArray | None = None,
) -> Path:
    """The lead-in before a path, or the lead-out after the path."""
    # `beyond`: unit tangent of a closed contour on the other side of the vertex that the lead
    # touches. If the contour turns towards the side of the arc at this vertex, the lead becomes a
    # line along the bisector, because a tangent arc would cross the contour.
    s = path.length if after else 0.0
    direction = "left" if after else "right"
    point, tangent = path(s), path(s, 1, side=direction)
    row = -1 if after else 0
    if shape == "arc" and beyond is not None:
        entering, leaving = (tangent, beyond) if after else (beyond, tangent)
        if _side_vector(entering, side, up) @ leaving > MAX_INWARD_TURN:
            inwards = (leaving - entering) / np.linalg.norm(leaving - entering)
            shape, tangent = "line", inwards if after else -inwards
    if shape == "line":
        start = point if after else point - length * tangent
        normal, curvature, start_tangent = np.zeros_like(tangent), 0.0, tangent
    else:
        curvature = QUARTER / length
        normal = _side_vector(tangent, side, up)
        start, start_tangent = point, tangent
        if not after:
            # A lead-in is on the same circle: the quarter circle that ends at the point.
            start = point - (tangent - normal) / curvature
            start_tangent, normal = -normal, tangent
    lead = Path(
        segments=Segments(
            starts=start[None],
            tangents=start_tangent[None],
            normals=normal[None],
            curvatures=np.array([curvature]),
            lengths=np.array([length]),
            speeds=path.speeds[[row]],
            tolerances=path.tolerances[[row]],
            tags=np.array(["lead-out" if after else "lead-in"], dtype=object),
        )
    )
    if path.orientation is None:
        return lead
    rotation = path.orientation(s, side=direction)
    return replace(lead, orientation=_lead_orientation(path.orientation, rotation, lead, after))


def _side_vector(tangent: FloatArray, side: str, up: FloatArray) -> FloatArray:
    """Unit vector perpendicular to a tangent, towards `side`."""
    if len(tangent) == 2:
        normal = np.array([-tangent[1], tangent[0]])
    else:
        normal = np.cross(up, tangent)
        size = float(np.linalg.norm(normal))
        if size < VERTICAL:
            raise InvalidInput(
                "A lead in the shape of an arc has no side where the contour is parallel to the "
                "direction up. Use the shape line."
            )
        normal = normal / size
        normal -= (normal @ tangent) * tangent
        normal /= np.linalg.norm(normal)
    return np.asarray(normal if side == "left" else -normal)


def _lead_orientation(
    orientation: Orientation, rotation: FloatArray, lead: Path, after: bool
) -> Orientation:
    """Tool orientation along a lead, which follows the tangent or is constant like the path's."""
    rate = np.zeros(3)
    if orientation.follows and lead.curvatures[0] > 0:
        rate = tangent_rates(lead.segments)[0]
    start = rotation
    if not after and rate.any():
        from armcontour.core.frames import exp

        start = exp(-rate[None] * lead.length)[0] @ rotation
    return Orientation.even(
        lead.lengths,
        start[None],
        rate[None],
        axis_only=orientation.axis_only,
        follows=orientation.follows,
    )
