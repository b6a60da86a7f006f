"""Ways to say how the tool is held along a path, before its corners are rounded."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.frames import exp, log, rotations, shortest
from armcontour.geometry.orientation import SAME_ORIENTATION, Orientation
from armcontour.geometry.segments import Segments

# Orientations that differ by half a turn have no shortest rotation between them [rad].
HALF_TURN = np.pi - 1e-6
# Rotations closer than this differ by rounding [rad].
NO_TURN = 1e-14
# The tool's x axis along the path and its z axis, the tool axis, against `up`.
POINTING_DOWN = _checks.lock_floats(np.diag([1.0, -1.0, -1.0]))


def orient(
    segments: Segments,
    waypoints: IntArray,
    merged: tuple[int, ...],
    values: Any,
    *,
    axis_only: bool,
) -> Orientation:
    """One rotation for the whole path, or one per waypoint with the shortest rotation between.

    Args:
        segments: The path's segments.
        waypoints: Vertices at which the points that the path was given lie.
        merged: Indices of given points that repeat the one before.
        values: Anything that `rotations` takes; one, or one per point that the path was given.
        axis_only: Turning about the tool axis is free.

    Raises:
        InvalidInput: No rotations, a wrong number of them, two orientations at one point, or
            neighbours that differ by half a turn.
    """
    given = rotations("tool orientation", values)
    if given.ndim == 2:
        return _constant(segments, given, axis_only)
    at, names = _per_waypoint("tool orientation", given, waypoints, merged)
    turn = _between(log(at[1:] @ np.swapaxes(at[:-1], 1, 2)), names)
    return _turning(segments, waypoints, at[:-1], turn, axis_only)


def point(
    segments: Segments, waypoints: IntArray, merged: tuple[int, ...], values: npt.ArrayLike
) -> Orientation:
    """A direction of the tool axis for the whole path, or one per waypoint; turning about it free.

    Args:
        segments: As in `orient`.
        waypoints: As in `orient`.
        merged: As in `orient`.
        values: (3,), or one per point that the path was given.

    Raises:
        InvalidInput: As in `orient`, or a direction of no length.
    """
    given = _checks.numbers("direction of the tool axis", values)
    if given.shape[-1:] != (3,) or given.ndim > 2:
        raise InvalidInput("The direction of the tool axis is 3 numbers, once or per waypoint.")
    size = np.linalg.norm(given, axis=-1, keepdims=True)
    if (size == 0).any():
        raise InvalidInput("The direction of the tool axis has no length.")
    unit = given / size
    start = exp(shortest([0.0, 0.0, 1.0], unit[0] if unit.ndim == 2 else unit))
    if unit.ndim == 1:
        return _constant(segments, start, axis_only=True)
    axes, names = _per_waypoint("direction of the tool axis", unit, waypoints, merged)
    turn = _between(shortest(axes[:-1], axes[1:]), names)
    starts = np.empty((len(turn), 3, 3))
    steps = exp(turn)
    for i in range(len(turn)):
        starts[i] = start
        start = steps[i] @ start
    return _turning(segments, waypoints, starts, turn, axis_only=True)


def follow(
    segments: Segments, up: npt.ArrayLike, tool: Any | None = None, *, axis_only: bool = False
) -> Orientation:
    """An orientation that keeps its angle to the tangent of a path.

    It is carried along without turning about the tangent: on a line it stays as it is, on an arc it
    turns with it, at a corner it jumps by the turn until the corner is rounded.

    Args:
        segments: Those of a path in space.
        up: Direction that, made perpendicular to the first tangent, is z of the path's frame; its x
            is the tangent.
        tool: The tool in the path's frame, one of what `rotations` takes; by default its z axis
            points against `up` and its x axis along the path.
        axis_only: Turning about the tool axis is free.

    Raises:
        InvalidInput: `up` along the first tangent, or a corner of 180°, at which the frame can turn
            either way.
    """
    in_path = POINTING_DOWN if tool is None else rotations("tool in the path's frame", tool)
    if in_path.shape != (3, 3):
        raise InvalidInput("The tool is held in one way along the whole path: give one rotation.")
    upward = _checks.numbers("up", up)
    if upward.shape != (3,):
        raise InvalidInput("The direction up is 3 numbers.")
    x = segments.tangents[0]
    z = upward - (upward @ x) * x
    if np.linalg.norm(z) < 1e-6 * np.linalg.norm(upward) or not np.linalg.norm(upward) > 0:
        raise InvalidInput(
            "up lies along the first tangent of the path: give a direction across it."
        )
    z = z / np.linalg.norm(z)
    frame = np.stack([x, np.cross(z, x), z], axis=1) @ in_path
    n = len(segments)
    rates = tangent_rates(segments)
    corners = shortest(segments.end_tangents[:-1], segments.tangents[1:])
    about = np.linalg.norm(corners, axis=1)
    if (about > HALF_TURN).any():
        first = int(np.argmax(about > HALF_TURN))
        raise InvalidInput(
            f"At the vertex after segment {first + 1} the path turns back by 180°, where a tool "
            "that follows the tangent could turn either way: leave the tool's orientation fixed "
            "there, or split the path.",
            index=first,
            point=segments.starts[first + 1].tolist(),
        )
    starts = np.empty((n, 3, 3))
    along, around = exp(rates * segments.lengths[:, None]), exp(corners)
    for k in range(n):
        starts[k] = frame
        if k + 1 < n:
            frame = around[k] @ along[k] @ frame
    return Orientation.even(segments.lengths, starts, rates, axis_only=axis_only, follows=True)


def tangent_rates(segments: Segments) -> FloatArray:
    """Rotation vectors per length by which the tangents of segments turn [rad/m], (n, 3)."""
    return np.asarray(segments.curvatures[:, None] * np.cross(segments.tangents, segments.normals))


def _constant(segments: Segments, rotation: FloatArray, axis_only: bool) -> Orientation:
    """One rotation all along."""
    n = len(segments)
    starts = np.tile(rotation, (n, 1, 1))
    return Orientation.even(segments.lengths, starts, np.zeros((n, 3)), axis_only=axis_only)


def _turning(
    segments: Segments, waypoints: IntArray, starts: FloatArray, turn: FloatArray, axis_only: bool
) -> Orientation:
    """Turning that is even over arc length from waypoint to waypoint.

    Args:
        segments: The path's segments.
        waypoints: Vertices between which the tool turns evenly, (k + 1,).
        starts: Rotations at all waypoints but the last, (k, 3, 3).
        turn: How the tool turns from each to the next [rad], (k, 3).
        axis_only: Turning about the tool axis is free.
    """
    first, breaks = waypoints[:-1], segments.breaks
    of = np.repeat(np.arange(len(turn)), np.diff(waypoints))
    rates = (turn / np.add.reduceat(segments.lengths, first)[:, None])[of]
    after = breaks[:-1] - breaks[first[of]]
    rotations_there = exp(after[:, None] * rates) @ starts[of]
    return Orientation.even(segments.lengths, rotations_there, rates, axis_only=axis_only)


def _per_waypoint(
    name: str, given: FloatArray, waypoints: IntArray, merged: tuple[int, ...]
) -> tuple[FloatArray, IntArray]:
    """One value per waypoint of the path, from one per given point, and what users call them."""
    kept = len(waypoints)
    points = kept + len(merged)
    if len(given) not in (points, kept):
        raise InvalidInput(
            f"{name} has {len(given)} values, but the path has {points} waypoints: give one for "
            f"the whole path or {points}."
        )
    if len(given) == kept:
        return given, np.arange(kept)
    for i in merged:
        if np.abs(given[i] - given[i - 1]).max() > SAME_ORIENTATION:
            raise InvalidInput(
                f"Waypoint {i + 1} is the same point as the one before but with another {name}: a "
                "path cannot turn the tool on the spot; move the point or split the path.",
                index=i,
            )
    names = np.delete(np.arange(points), merged)
    return given[names], names


def _between(turn: FloatArray, names: IntArray) -> FloatArray:
    """Turns from waypoint to waypoint, without those that are rounding of what was given.

    Raises:
        InvalidInput: One of half a turn, which has no shortest way.
    """
    angle = np.linalg.norm(turn, axis=1)
    if (angle > HALF_TURN).any():
        i = int(np.argmax(angle > HALF_TURN))
        raise InvalidInput(
            f"The tool orientations at waypoints {names[i] + 1} and {names[i + 1] + 1} differ by "
            "half a turn, between which there is no shortest rotation: put a waypoint between "
            "them.",
            index=int(names[i]),
        )
    return np.where(angle[:, None] < NO_TURN, 0.0, turn)
