"""Sticks that show the links and the tool of an arm whose shapes are unknown."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.frames import Frame
from armcontour.report.drawn_cell import SHORTEST, Body, DrawnCell, frame_along
from armcontour.report.triangles import cone_triangles, triangles_of
from armcontour.robot.scene import Cylinder

# Radius of a stick, as a factor of the arm's size.
STICK = 0.018
# Radius and length of the drum at a revolute joint, as factors of the radius of a stick.
DRUM_RADIUS = 1.7
DRUM_LENGTH = 4.0
# Radius of a tool's cone at the tool point, as a factor of its radius at the tip of the arm.
POINT = 1 / 6


def link_sticks(cell: DrawnCell, tip: Frame, size: float) -> Iterator[Body]:
    """Yield sticks between the arm's joints, and a drum at each revolute joint.

    Args:
        cell: The joints and links.
        tip: Frame of the tip in the last link.
        size: Size of the arm without external axes [m].
    """
    radius = STICK * size
    drum = Cylinder(radius=DRUM_RADIUS * radius, length=DRUM_LENGTH * radius)
    first = cell.positioner + cell.sliding
    for k, joint in enumerate(cell.joints[first:], start=first + 1):
        # The arm's base stands on the floor, or on the link of its last sliding joint.
        yield from _stick(joint.name, joint.parent, joint.origin.position, radius)
        if not joint.prismatic:
            yield Body(
                name=joint.name,
                link=k,
                kind="joint",
                place=Frame(rotation=frame_along(joint.axis)),
                triangles=triangles_of(drum),
            )
    yield from _stick("link", len(cell.joints), tip.position, radius)


def tool_cone(cell: DrawnCell, tip: Frame, tool: Frame, size: float) -> Iterator[Body]:
    """Yield a slim cone from the tip of the arm to the tool point, unless the points are equal.

    Args:
        cell: The joints and links.
        tip: Frame of the tip in the last link.
        tool: Frame of the tool in the last link.
        size: Size of the arm without external axes [m].
    """
    radius = STICK * size
    yield from _cone("tool", len(cell.joints), tip.position, tool.position, radius, POINT * radius)


def _stick(name: str, link: int, end: FloatArray, radius: float) -> Iterator[Body]:
    """Yield a stick from the origin of a link to a point, unless it has no length."""
    yield from _cone(name, link, np.zeros(3), end, radius, radius)


def _cone(
    name: str, link: int, start: FloatArray, end: FloatArray, radius: float, end_radius: float
) -> Iterator[Body]:
    """Yield a cone between two points in the frame of a link, unless it has no length."""
    along = end - start
    length = float(np.linalg.norm(along))
    if length < SHORTEST:
        return
    yield Body(
        name=name,
        link=link,
        kind="tool" if name == "tool" else "link",
        place=Frame(start, frame_along(along)),
        triangles=cone_triangles(radius, end_radius, length),
    )
