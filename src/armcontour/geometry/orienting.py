"""Ways to say how the tool is held along a path, before its corners are rounded."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np
import numpy.typing as npt

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.frames import exp, log, rotations, shortest
from armcontour.geometry.orientation import SAME_ORIENTATION, Orientation

if TYPE_CHECKING:
    from armcontour.geometry.path import Path

# Orientations that differ by half a turn have no shortest rotation between them [rad].
HALF_TURN = np.pi - 1e-6
# Rotations closer than this differ by rounding [rad].
NO_TURN = 1e-14
# The tool's x axis along the path and its z axis, the tool axis, against `up`.
POINTING_DOWN = _checks.locked(np.diag([1.0, -1.0, -1.0]))


def held(path: Path, values: Any, *, axis_only: bool) -> Orientation:
    """One rotation for the whole path, or one per waypoint with the shortest rotation between.

    Args:
        path: The path.
        values: Anything that `rotations` takes; one, or one per point that the path was given.
        axis_only: Turning about the tool axis is free.

    Raises:
        InvalidInput: No rotations, a wrong number of them, two orientations at one point, or
            neighbours that differ by half a turn.
    """
    given = rotations("tool orientation", values)
    if given.ndim == 2:
        return _still(path, given, axis_only)
    at, names = _per_waypoint("tool orientation", given, path)
    turn = _between(log(at[1:] @ np.swapaxes(at[:-1], 1, 2)), names)
    return _spread(path, at[:-1], turn, axis_only)


def pointing(path: Path, values: npt.ArrayLike) -> Orientation:
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
    start = exp(shortest([0.0, 0.0, 1.0], unit[0] if unit.ndim == 2 else unit))
    if unit.ndim == 1:
        return _still(path, start, axis_only=True)
    axes, names = _per_waypoint("direction of the tool axis", unit, path)
    turn = _between(shortest(axes[:-1], axes[1:]), names)
    starts = np.empty((len(turn), 3, 3))
    steps = exp(turn)
    for i in range(len(turn)):
        starts[i] = start
        start = steps[i] @ start
    return _spread(path, starts, turn, axis_only=True)


def following(
    path: Path, up: npt.ArrayLike, tool: Any | None = None, *, axis_only: bool = False
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
            f"At the joint behind segment {first + 1} the path turns back by 180°, where a tool "
            "that follows the tangent could turn either way: leave the tool's orientation fixed "
            "there, or split the path.",
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


def turning_of_tangents(path: Path) -> FloatArray:
    """Rotation vectors per length by which the tangents of segments turn [rad/m], (n, 3)."""
    return np.asarray(path.curvatures[:, None] * np.cross(path.tangents, path.inwards))


def _still(path: Path, turned: FloatArray, axis_only: bool) -> Orientation:
    """One rotation all along."""
    n = len(path)
    starts = np.tile(turned, (n, 1, 1))
    return Orientation.even(path.lengths, starts, np.zeros((n, 3)), axis_only=axis_only)


def _spread(path: Path, starts: FloatArray, turn: FloatArray, axis_only: bool) -> Orientation:
    """Turning that is even over arc length from waypoint to waypoint.

    Args:
        path: The path.
        starts: Rotations at all waypoints but the last, (k, 3, 3).
        turn: How the tool turns from each to the next [rad], (k, 3).
        axis_only: Turning about the tool axis is free.
    """
    first = path.waypoints[:-1]
    of = np.repeat(np.arange(len(turn)), np.diff(path.waypoints))
    rates = (turn / np.add.reduceat(path.lengths, first)[:, None])[of]
    behind = path.breaks[:-1] - path.breaks[first[of]]
    begun = exp(behind[:, None] * rates) @ starts[of]
    return Orientation.even(path.lengths, begun, rates, axis_only=axis_only)


def _per_waypoint(name: str, given: FloatArray, path: Path) -> tuple[FloatArray, IntArray]:
    """One value per waypoint of the path, from one per given point, and what users call them."""
    kept = len(path.waypoints)
    points = kept + len(path.merged)
    if len(given) not in (points, kept):
        raise InvalidInput(
            f"{name} has {len(given)} values, but the path has {points} waypoints: give one for "
            f"the whole path or {points}."
        )
    if len(given) == kept:
        return given, np.arange(kept)
    for i in path.merged:
        if np.abs(given[i] - given[i - 1]).max() > SAME_ORIENTATION:
            raise InvalidInput(
                f"Waypoint {i + 1} is the same point as the one before but with another {name}: a "
                "path cannot turn the tool on the spot; move the point or split the path.",
                index=i,
            )
    names = np.delete(np.arange(points), path.merged)
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
