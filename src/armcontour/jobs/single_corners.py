"""Tolerances of single corners, which are identified by waypoint numbers of the original path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import angle_between
from armcontour.geometry import Path
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.program import Process, Program

# Maximum difference of equal directions [rad], due to rounding errors of short segments.
SAME_DIRECTION = 1e-6


def corner_waypoints(path: Path, prepared: Path) -> IntArray:
    """Waypoint number, from 1, of each inner vertex of `prepared`, (vertices,); 0 if no corner."""
    # Positions and directions are compared, because leads, overlap and start of the process change
    # the vertices of a path.
    numbers, points, before, after = _waypoints(path)
    waypoints = np.zeros(len(prepared) - 1, dtype=np.intp)
    if np.array_equal(prepared.vertices, path.vertices):
        # A fast algorithm for an unchanged path, for example while a point is dragged.
        inside = np.isin(path.waypoints, np.arange(1, len(path)))
        numbers_inside = _numbers(path)[inside]
        waypoints[path.waypoints[inside] - 1] = np.where(
            np.isin(numbers_inside, numbers), numbers_inside, 0
        )
        return waypoints
    if not len(waypoints) or not len(points):
        return waypoints
    from armcontour.geometry.near_points import pairs_within

    vertices = prepared.vertices[1:-1]
    ahead, behind = prepared.segments.end_tangents[:-1], prepared.tangents[1:]
    for j, k in zip(*pairs_within(vertices, points, REPEATED_POINT), strict=True):
        forwards = _alike(ahead[j], before[k]) and _alike(behind[j], after[k])
        # The direction of an open contour may be reversed.
        if forwards or (_alike(ahead[j], -after[k]) and _alike(behind[j], -before[k])):
            waypoints[j] = numbers[k]
    return waypoints


def corner_tolerances(
    path: Path, prepared: Path, tolerance: float, single: Mapping[int, float]
) -> FloatArray:
    """Tolerance of each vertex between segments of a prepared path [m], (vertices,)."""
    numbers = corner_waypoints(path, prepared)
    return np.array([single.get(int(k), tolerance) for k in numbers])


def check_corners(program: Program, process: Process, numbers: Sequence[int]) -> None:
    """Raise InvalidInput if a program does not have corners at waypoints with given numbers."""
    if len(program.contours) != 1:
        raise InvalidInput(
            f"corners.at requires a path with one contour, but {program.source or 'the job'} has "
            f"{len(program.contours)} contours. Specify tolerances of layers (path.layers), or "
            "choose a contour (path.names)."
        )
    layer = process.of_layer(program.contours[0].layer)
    if layer.kerf is not None or layer.weave is not None:
        key = "weave" if layer.kerf is None else "kerf"
        raise InvalidInput(
            f"corners.at cannot be combined with process.{key}, which moves the path away from its "
            "waypoints. Remove one of them."
        )
    path = program.contours[0].path
    corners, *_ = _waypoints(path)
    count = len(path.waypoints) + len(path.merged)
    for number in numbers:
        if number not in corners:
            raise InvalidInput(f"corners.at: {_explain_no_corner(number, count, path)}.")


def check_found(path: Path, program: Program, numbers: Sequence[int]) -> None:
    """Raise InvalidInput if waypoint 1 is listed but is not a corner of the prepared path."""
    if 1 in numbers and not any(1 in corner_waypoints(path, x.path) for x in program.contours):
        raise InvalidInput(
            "corners.at: waypoint 1 cannot be rounded, because the path starts and ends there. "
            "Move the start with process.begin, or add process.overlap."
        )


def _waypoints(path: Path) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Waypoints that are corners: numbers from 1, points [m], and directions before and after."""
    numbers, vertices = _numbers(path), path.vertices
    ahead = np.concatenate([path.segments.end_tangents[-1:], path.segments.end_tangents])
    behind = np.concatenate([path.tangents, path.tangents[:1]])
    turned = angle_between(ahead, behind) > TANGENT_TOLERANCE
    # The start of a closed path counts only once, with number 1.
    turned[0], turned[-1] = turned[0] and path.segments.closed, False
    mask = turned[path.waypoints]
    points = path.waypoints[mask]
    return numbers[mask], vertices[points], ahead[points], behind[points]


def _numbers(path: Path) -> IntArray:
    """Numbers of the waypoints of a path, from 1, (waypoints,); merged points are skipped."""
    count = len(path.waypoints) + len(path.merged)
    return np.delete(np.arange(count), path.merged) + 1


def _explain_no_corner(number: int, count: int, path: Path) -> str:
    """Reason why there is no corner at a waypoint."""
    if not 1 <= number <= count:
        return f"waypoint numbers must be from 1 to {count}, but one is {number}"
    if number - 1 in path.merged:
        return (
            f"waypoint {number} repeats the previous waypoint, or a line or an arc replaced it. "
            "Use the number of a corner"
        )
    if number in (1, count):
        if not path.segments.closed:
            return f"waypoint {number} is an end of the path, which is not a corner"
        if number == count:
            return f"waypoint {number} is the start of the closed path. Use the number 1"
    return f"the path has no corner at waypoint {number} that could be rounded"


def _alike(one: FloatArray, other: FloatArray) -> bool:
    """True if two unit vectors are equal except for rounding errors."""
    return bool(np.linalg.norm(one - other) <= SAME_DIRECTION)
