"""Leads: a line along the tangent, or a quarter of a circle that touches it."""

from __future__ import annotations

import dataclasses

import numpy as np

from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.geometry import Path
from armcontour.geometry.orientation import Orientation
from armcontour.geometry.orienting import tangent_rates
from armcontour.geometry.segments import Segments

SHAPES = ("line", "arc")
SIDES = ("left", "right")
# The side on which what is cut out falls away.
WASTE = "waste"
# How far a quarter of a circle turns [rad].
QUARTER = np.pi / 2
# Below this sine the tangent goes straight up, and has no side.
UPRIGHT = 1e-6


def lead_path(
    path: Path, length: float, shape: str, side: str, up: FloatArray, *, after: bool
) -> Path:
    """The lead before a path, or after it.

    Args:
        path: The path.
        length: Of the lead [m].
        shape: "line" or "arc".
        side: Of the path, seen along it, on which an arc lies.
        up: In space, the direction about which "left" is to the left, (3,).
        after: Whether it comes after the path.

    Raises:
        InvalidInput: An arc beside a tangent that goes straight up.
    """
    at = path.length if after else 0.0
    which = "left" if after else "right"
    point, tangent = path(at), path(at, 1, side=which)
    i = -1 if after else 0
    if shape == "line":
        start = point if after else point - length * tangent
        normal, curvature, first = np.zeros_like(tangent), 0.0, tangent
    else:
        curvature = QUARTER / length
        normal = _beside(tangent, side, up)
        start, first = point, tangent
        if not after:
            # The same circle, run a quarter earlier: it comes in from its side.
            start = point - (tangent - normal) / curvature
            first, normal = -normal, tangent
    lead = Path(
        segments=Segments(
            starts=start[None],
            tangents=first[None],
            normals=normal[None],
            curvatures=np.array([curvature]),
            lengths=np.array([length]),
            speeds=path.speeds[[i]],
            tolerances=path.tolerances[[i]],
            tags=np.array(["lead-out" if after else "lead-in"], dtype=object),
        )
    )
    if path.orientation is None:
        return lead
    held = path.orientation(at, side=which)
    return dataclasses.replace(
        lead, orientation=_lead_orientation(path.orientation, held, lead, after)
    )


def _beside(tangent: FloatArray, side: str, up: FloatArray) -> FloatArray:
    """Unit vector to one side of a tangent."""
    if len(tangent) == 2:
        left = np.array([-tangent[1], tangent[0]])
    else:
        left = np.cross(up, tangent)
        size = float(np.linalg.norm(left))
        if size < UPRIGHT:
            raise InvalidInput(
                "A lead in the shape of an arc has no side where the contour goes straight up: "
                "take the shape line."
            )
        left = left / size
        left -= (left @ tangent) * tangent
        left /= np.linalg.norm(left)
    return np.asarray(left if side == "left" else -left)


def _lead_orientation(
    orientation: Orientation, held: FloatArray, lead: Path, after: bool
) -> Orientation:
    """The tool held as at the end of the path, or going on to follow the tangent."""
    rate = np.zeros(3)
    if orientation.follows and lead.curvatures[0] > 0:
        rate = tangent_rates(lead.segments)[0]
    start = held
    if not after and rate.any():
        from armcontour.frames import exp

        start = exp(-rate[None] * lead.length)[0] @ held
    return Orientation.even(
        lead.lengths,
        start[None],
        rate[None],
        axis_only=orientation.axis_only,
        follows=orientation.follows,
    )
