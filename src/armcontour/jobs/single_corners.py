"""Corners with their own tolerances, identified by the waypoints of the original path."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import angle_between
from armcontour.geometry import Path
from armcontour.geometry.segments import REPEATED_POINT, TANGENT_TOLERANCE
from armcontour.program import Process, Program

# Directions of one corner on both paths differ by less [rad]: rounding errors of short segments.
SAME_DIRECTION = 1e-6


def corner_waypoints(path: Path, prepared: Path) -> IntArray:
    """Waypoint numbers of the vertices of a prepared path, from 1, or 0 for none, (vertices,)."""
    # A process changes the vertices of a path (leads, overlap, start), so that positions and
    # directions are matched.
    numbers, points, before, after = _waypoints(path)
    waypoints = np.zeros(len(prepared) - 1, dtype=np.intp)
    if np.array_equal(prepared.vertices, path.vertices):
        # Fast path for an unchanged path, as while a point is dragged.
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
        # An open contour may be run from its end.
        if forwards or (_alike(ahead[j], -after[k]) and _alike(behind[j], -before[k])):
            waypoints[j] = numbers[k]
    return waypoints


def corner_tolerances(
    path: Path, prepared: Path, tolerance: float, single: Mapping[int, float]
) -> FloatArray:
    """The tolerances of all vertices between segments of a prepared path [m], (vertices,)."""
    numbers = corner_waypoints(path, prepared)
    return np.array([single.get(int(k), tolerance) for k in numbers])


def check_corners(program: Program, process: Process, numbers: Sequence[int]) -> None:
    """Check that a path has corners at waypoints."""
    if len(program.contours) != 1:
        raise InvalidInput(
            f"corners.at is for a path of one contour, but {program.source or 'the job'} has "
            f"{len(program.contours)}: give layers a tolerance (path.layers), or choose a contour "
            "(path.names)."
        )
    layer = process.of_layer(program.contours[0].layer)
    if layer.kerf is not None or layer.weave is not None:
        key = "weave" if layer.kerf is None else "kerf"
        raise InvalidInput(
            f"corners.at goes without process.{key}, which moves the path off its waypoints: leave "
            "one of them out."
        )
    path = program.contours[0].path
    corners, *_ = _waypoints(path)
    count = len(path.waypoints) + len(path.merged)
    for number in numbers:
        if number not in corners:
            raise InvalidInput(f"corners.at: {_explain_no_corner(number, count, path)}.")


def check_found(path: Path, program: Program, numbers: Sequence[int]) -> None:
    """Check that the start of a closed path is a corner of the prepared path, if it is listed."""
    if 1 in numbers and not any(1 in corner_waypoints(path, x.path) for x in program.contours):
        raise InvalidInput(
            "corners.at: the path starts and ends at waypoint 1, so that this corner is not "
            "rounded: move the start by process.begin, or add process.overlap."
        )


def _waypoints(path: Path) -> tuple[IntArray, FloatArray, FloatArray, FloatArray]:
    """Waypoints with a corner: numbers from 1, points [m], directions before and after them."""
    numbers, vertices = _numbers(path), path.vertices
    ahead = np.concatenate([path.segments.end_tangents[-1:], path.segments.end_tangents])
    behind = np.concatenate([path.tangents, path.tangents[:1]])
    turned = angle_between(ahead, behind) > TANGENT_TOLERANCE
    closed = np.linalg.norm(vertices[-1] - vertices[0]) <= REPEATED_POINT
    # The start of a closed path has the number 1 only.
    turned[0], turned[-1] = turned[0] and closed, False
    mask = turned[path.waypoints]
    points = path.waypoints[mask]
    return numbers[mask], vertices[points], ahead[points], behind[points]


def _numbers(path: Path) -> IntArray:
    """The numbers of the points of a path that were kept, from 1, (waypoints,)."""
    count = len(path.waypoints) + len(path.merged)
    return np.delete(np.arange(count), path.merged) + 1


def _explain_no_corner(number: int, count: int, path: Path) -> str:
    """Reason why there is no corner at a waypoint."""
    if not 1 <= number <= count:
        return f"there is no waypoint {number}: the path has {count}, counted from 1"
    if number - 1 in path.merged:
        return f"waypoint {number} repeats the one before it: name that one"
    if number in (1, count):
        closed = np.linalg.norm(path.vertices[-1] - path.vertices[0]) <= REPEATED_POINT
        if closed and number == count:
            return f"waypoint {number} is the start of the closed path: name it 1"
        if not closed:
            return f"waypoint {number} is an end of the path, where it has no corner"
    return f"the path has no corner at waypoint {number}, so nothing is rounded there"


def _alike(one: FloatArray, other: FloatArray) -> bool:
    """True if two directions are the same."""
    return bool(np.linalg.norm(one - other) <= SAME_DIRECTION)
