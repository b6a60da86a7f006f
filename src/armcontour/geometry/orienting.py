"""Ways to say how the tool is held along a path, before its corners are rounded."""

from __future__ import annotations

from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.frames import exp, log, rotations, shortest
from armcontour.geometry.orientation import SAME_ORIENTATION, Orientation

# Orientations that differ by half a turn have no shortest rotation between them [rad].
HALF_TURN = np.pi - 1e-6
# Rotations closer than this differ by rounding [rad].
NO_TURN = 1e-14
# The tool's x axis along the path and its z axis, the tool axis, against `up`.
POINTING_DOWN = _checks.locked(np.diag([1.0, -1.0, -1.0]))


def held(values: Any, lengths: FloatArray, merged: tuple[int, ...], axis_only: bool) -> Orientation:
    """One rotation for the whole path, or one per waypoint with the shortest rotation between.

    Args:
        values: Anything that `rotations` takes; one, or one per point that the path was given.
        lengths: Of the path's segments [m], (n,).
        merged: Indices of the given points that repeat the one before.
        axis_only: Turning about the tool axis is free.

    Raises:
        InvalidInput: No rotations, a wrong number of them, two orientations at one point, or
            neighbours that differ by half a turn.
    """
    given = rotations("tool orientation", values)
    n = len(lengths)
    if given.ndim == 2:
        return Orientation.even(
            lengths, np.tile(given, (n, 1, 1)), np.zeros((n, 3)), axis_only=axis_only
        )
    at = _per_waypoint("tool orientation", given, n, merged)
    turn = log(at[1:] @ np.swapaxes(at[:-1], 1, 2))
    # Rounding of the given rotations is no turning, however short the segment.
    turn[np.linalg.norm(turn, axis=1) < NO_TURN] = 0.0
    _refuse_half_turns(turn)
    return Orientation.even(lengths, at[:-1], turn / lengths[:, None], axis_only=axis_only)


def pointing(values: npt.ArrayLike, lengths: FloatArray, merged: tuple[int, ...]) -> Orientation:
    """A direction of the tool axis for the whole path, or one per waypoint; turning about it free.

    Raises:
        InvalidInput: As in `held`, or a direction of no length.
    """
    given = _checks.numbers("direction of the tool axis", values)
    if given.shape[-1:] != (3,) or given.ndim > 2:
        raise InvalidInput("The direction of the tool axis is 3 numbers, once or per waypoint.")
    size = np.linalg.norm(given, axis=-1, keepdims=True)
    if (size == 0).any():
        raise InvalidInput("The direction of the tool axis has no length.")
    unit = given / size
    n = len(lengths)
    start = exp(shortest([0.0, 0.0, 1.0], unit[0] if unit.ndim == 2 else unit))
    if unit.ndim == 1:
        return Orientation.even(
            lengths, np.tile(start, (n, 1, 1)), np.zeros((n, 3)), axis_only=True
        )
    axes = _per_waypoint("direction of the tool axis", unit, n, merged)
    turn = shortest(axes[:-1], axes[1:])
    turn[np.linalg.norm(turn, axis=1) < NO_TURN] = 0.0
    _refuse_half_turns(turn)
    starts = np.empty((n, 3, 3))
    steps = exp(turn)
    for i in range(n):
        starts[i] = start
        start = steps[i] @ start
    return Orientation.even(lengths, starts, turn / lengths[:, None], axis_only=True)


def following(
    path: Any, up: npt.ArrayLike, tool: Any | None = None, *, axis_only: bool = False
) -> Orientation:
    """An orientation that keeps its angle to the tangent of a path.

    It is carried along without turning about the tangent: on a line it stays as it is, on an arc it
    turns with it, at a corner it jumps by the turn until the corner is rounded.

    Args:
        path: A path in space.
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
    x = path.tangents[0]
    z = upward - (upward @ x) * x
    if np.linalg.norm(z) < 1e-6 * np.linalg.norm(upward) or not np.linalg.norm(upward) > 0:
        raise InvalidInput(
            "up lies along the first tangent of the path: give a direction across it."
        )
    z = z / np.linalg.norm(z)
    frame = np.stack([x, np.cross(z, x), z], axis=1) @ in_path
    n = len(path)
    rates = turning_of_tangents(path)
    i = np.arange(n - 1)
    ends = path.on_segment(i, path.lengths[:-1], 1)
    corners = shortest(ends, path.tangents[1:])
    about = np.linalg.norm(corners, axis=1)
    if (about > HALF_TURN).any():
        first = int(np.argmax(about > HALF_TURN))
        raise InvalidInput(
            f"At the joint behind segment {first} the path turns back by 180°, where a tool that "
            "follows the tangent could turn either way: leave the tool's orientation fixed there, "
            "or split the path.",
            index=first,
            point=path.starts[first + 1].tolist(),
        )
    starts = np.empty((n, 3, 3))
    along, around = exp(rates * path.lengths[:, None]), exp(corners)
    for k in range(n):
        starts[k] = frame
        if k + 1 < n:
            frame = around[k] @ along[k] @ frame
    return Orientation.even(path.lengths, starts, rates, axis_only=axis_only, follows=True)


def turning_of_tangents(path: Any) -> FloatArray:
    """Rotation vectors per length by which the tangents of segments turn [rad/m], (n, 3)."""
    return np.asarray(path.curvatures[:, None] * np.cross(path.tangents, path.inwards))


def _per_waypoint(
    name: str, given: FloatArray, segments: int, merged: tuple[int, ...]
) -> FloatArray:
    """One value per waypoint of the path, from one per given point."""
    points = segments + 1 + len(merged)
    if len(given) not in (points, segments + 1):
        raise InvalidInput(
            f"{name} has {len(given)} values, but the path has {points} waypoints: give one for "
            f"the whole path or {points}."
        )
    if len(given) == segments + 1:
        return given
    for i in merged:
        if np.abs(given[i] - given[i - 1]).max() > SAME_ORIENTATION:
            raise InvalidInput(
                f"Waypoint {i} is the same point as the one before but with another {name}: a "
                "path cannot turn the tool on the spot; move the point or split the path.",
                index=i,
            )
    return np.asarray(np.delete(given, merged, axis=0))


def _refuse_half_turns(turn: FloatArray) -> None:
    angle = np.linalg.norm(turn, axis=1)
    if (angle > HALF_TURN).any():
        i = int(np.argmax(angle > HALF_TURN))
        raise InvalidInput(
            f"The tool orientations at waypoints {i} and {i + 1} differ by half a turn, between "
            "which there is no shortest rotation: put a waypoint between them.",
            index=i,
        )
