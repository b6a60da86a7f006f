"""Constructors of the tool orientation along a path whose corners are not rounded yet."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core._quintics import quintic
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import exp, log, rotations, shortest
from armcontour.geometry.biarcs import dot, unit
from armcontour.geometry.orientation import LINEAR, SAME_ORIENTATION, Orientation, value_of
from armcontour.geometry.segments import Segments

# Between orientations that differ by more than this there is no shortest rotation [rad].
HALF_TURN = np.pi - 1e-6
# Rotations by less than this are rounding errors [rad].
NO_TURN = 1e-14
# A transition turns about the axis of its bend, and not about that from its first tangent to its
# last, if the latter turn is this much smaller: then it bends to both sides.
NO_AXIS = 1e-6
# Tool in the frame of the path: its x axis along the path, its z axis (the tool axis) against `up`.
POINTING_DOWN = checks.frozen_array(np.diag([1.0, -1.0, -1.0]))


def orient(
    segments: Segments,
    waypoints: IntArray,
    merged: tuple[int, ...],
    values: Any,
    *,
    axis_only: bool,
) -> Orientation:
    """A constant orientation, or one per waypoint with the shortest rotations between them.

    Args:
        segments: Segments of the path.
        waypoints: Indices of the vertices at which the input points of the path lie.
        merged: Indices of the input points that repeat the point before them.
        values: Rotations as `rotations` takes them: one, or one per input point.
        axis_only: Rotation about the tool axis is free.

    Raises:
        InvalidInput: The values are not rotations, their number is wrong, a repeated point has two
            orientations, or neighbours differ by half a turn.
    """
    given = rotations("tool orientation", values)
    if given.ndim == 2:
        return _constant(segments, given, axis_only)
    at, names = _per_waypoint("tool orientation", given, waypoints, merged)
    turn = _check_turns(log(at[1:] @ np.swapaxes(at[:-1], 1, 2)), names)
    return _turn_evenly(segments, waypoints, at[:-1], turn, axis_only)


def point(
    segments: Segments, waypoints: IntArray, merged: tuple[int, ...], values: npt.ArrayLike
) -> Orientation:
    """A constant direction of the tool axis, or one per waypoint; rotation about it is free.

    Args:
        segments: As in `orient`.
        waypoints: As in `orient`.
        merged: As in `orient`.
        values: Directions of the tool axis: one, (3,), or one per input point, (n, 3).

    Raises:
        InvalidInput: As in `orient`, or a direction has no length.
    """
    given = checks.check_numbers("direction of the tool axis", values)
    if given.shape[-1:] != (3,) or given.ndim > 2:
        raise InvalidInput("The direction of the tool axis is 3 numbers, once or per waypoint.")
    if given.ndim == 1 and given.any():
        return _constant(segments, _pointing(*given.tolist()), axis_only=True)
    size = np.linalg.norm(given, axis=-1, keepdims=True)
    if (size == 0).any():
        raise InvalidInput("The direction of the tool axis has no length.")
    unit = given / size
    start = _pointing(*given[0].tolist())
    axes, names = _per_waypoint("direction of the tool axis", unit, waypoints, merged)
    turn = _check_turns(shortest(axes[:-1], axes[1:]), names)
    starts = np.empty((len(turn), 3, 3))
    steps = exp(turn)
    for i in range(len(turn)):
        starts[i] = start
        start = steps[i] @ start
    return _turn_evenly(segments, waypoints, starts, turn, axis_only=True)


@lru_cache(maxsize=1)
def _pointing(x: float, y: float, z: float) -> FloatArray:
    """The shortest rotation from the z axis to a direction; contours of a program share it."""
    direction = np.array([x, y, z])
    unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    return checks.frozen_array(exp(shortest([0.0, 0.0, 1.0], unit)))


def follow(
    segments: Segments, up: npt.ArrayLike, tool: Any | None = None, *, axis_only: bool = False
) -> Orientation:
    """An orientation that stays at a fixed angle to the tangent of a path.

    The tool never turns about the tangent: its orientation is constant on a line, turns with the
    tangent on an arc, and jumps by the turn at a corner until the corner is rounded.

    Args:
        segments: Segments of a path in space.
        up: Direction that, made perpendicular to the first tangent, is z of the path's frame, whose
            x is the tangent, (3,).
        tool: Rotation of the tool in the path's frame, as `rotations` takes it; by default its z
            axis points against `up` and its x axis along the path.
        axis_only: Rotation about the tool axis is free.

    Raises:
        InvalidInput: `up` lies along the first tangent, or the path turns back by 180°, where the
            frame could turn to either side.
    """
    in_path = POINTING_DOWN if tool is None else rotations("tool in the path's frame", tool)
    if in_path.shape != (3, 3):
        raise InvalidInput(
            "A tool that follows the tangent has one rotation for the whole path: give one."
        )
    upward, tangent = checks.check_numbers("up", up), segments.tangents[0]
    if upward.shape != (3,):
        raise InvalidInput("The direction up is 3 numbers.")
    z = upward - (upward @ tangent) * tangent
    size, least = np.linalg.norm(z), 1e-6 * np.linalg.norm(upward)
    if size < least or not least > 0:
        raise InvalidInput(
            "up lies along the first tangent of the path: give a direction across it."
        )
    z = z / size
    frame = np.stack([tangent, np.cross(z, tangent), z], axis=1)
    return carry(segments, frame @ in_path, axis_only=axis_only)


def carry(segments: Segments, frame: FloatArray, *, axis_only: bool = False) -> Orientation:
    """An orientation that turns with the tangent of a path and never about it.

    Args:
        segments: Segments of the path.
        frame: Rotation matrix of the tool at the path's start, (3, 3).
        axis_only: Rotation about the tool axis is free.

    Raises:
        InvalidInput: The path turns back by 180°, where the tool could turn to either side.
    """
    corners = shortest(segments.end_tangents[:-1], segments.tangents[1:])
    turn = np.linalg.norm(corners, axis=1)
    if (turn > HALF_TURN).any():
        i = int(np.argmax(turn > HALF_TURN))
        raise InvalidInput(
            f"At the vertex after segment {i + 1} the path turns back by 180°, where a tool "
            "that follows the tangent could turn either way: leave the tool's orientation fixed "
            "there, or split the path.",
            index=i,
            point=segments.starts[i + 1].tolist(),
        )
    return follow_on(segments, frame, exp(corners), {}, axis_only=axis_only)


def follow_on(
    segments: Segments,
    frame: FloatArray,
    corners: FloatArray | None,
    known: Mapping[int, FloatArray],
    *,
    axis_only: bool,
) -> Orientation:
    """An orientation that turns with the tangents of segments.

    Args:
        segments: The segments, n of them.
        frame: Rotation matrix at the start, (3, 3).
        corners: Rotations at the vertices between segments, (n - 1, 3, 3); None for none.
        known: Rotation matrices that are known at the starts of some segments, (3, 3) each.
        axis_only: Rotation about the tool axis is free.
    """
    columns = tangent_turns(segments)
    tilt, turn = (value_of(columns[x], segments.lengths)[:, None] for x in "fg")
    turns = exp(turn * columns["second"]) @ exp(tilt * columns["first"])
    if corners is not None:
        turns[:-1] = corners @ turns[:-1]
    starts = np.empty((len(segments), 3, 3))
    for k in range(len(segments)):
        starts[k] = frame = known.get(k, frame)
        frame = turns[k] @ frame
    return Orientation(
        breaks=segments.breaks, starts=starts, **columns, axis_only=axis_only, follows=True
    )


def tangent_rates(segments: Segments) -> FloatArray:
    """Angular rates of the tangents of lines and arcs [rad/m], (n, 3)."""
    return np.asarray(segments.curvatures[:, None] * np.cross(segments.tangents, segments.normals))


def tangent_turns(segments: Segments) -> dict[str, FloatArray]:
    """Turns of the tangents along segments, as `first`, `second`, `f` and `g` of an `Orientation`.

    On a transition `second` is the axis from its first tangent to its last, and `first` is that of
    the tilt out of this plane. Both angles are quintics: with the tangent and the curvature at both
    ends, and with the change of curvature there that both neighbours share, so that the derivative
    of the rate does not jump in a plane.
    """
    first, f = tangent_rates(segments), np.tile(LINEAR, (len(segments), 1))
    second, g = np.zeros_like(first), np.zeros_like(f)
    bent = np.flatnonzero(segments.bent)
    if len(bent):
        ends = np.zeros(len(bent)), segments.lengths[bent]
        tangents = [segments.at(bent, u, 1) for u in ends]
        rates = [np.cross(t, segments.at(bent, u, 2)) for t, u in zip(tangents, ends, strict=True)]
        axis = _axes_of_turns(segments, bent)
        tilt = np.cross(axis, tangents[0])
        t0, t1 = (unit(x) for x in tangents)
        turn = np.arctan2(dot(t1, tilt), dot(t1, t0))[:, None]
        out = -np.arcsin(dot(t1, axis).clip(-1, 1))[:, None]
        change = _shared_changes(segments)
        tilted = np.cos(turn) * tilt - np.sin(turn) * t0
        rate, bend = (
            [
                np.stack([dot(x, y), dot(x, axis)], axis=1)
                for x, y in zip(pair, (tilt, tilted), strict=True)
            ]
            for pair in (rates, (change[bent], change[bent + 1]))
        )
        angles = np.hstack([out, turn])
        none = np.zeros_like(angles)
        turned = quintic(ends[1], (none, rate[0], bend[0]), (angles, rate[1], bend[1]))
        f, g = (np.pad(x, ((0, 0), (0, 2))) for x in (f, g))
        f[bent], g[bent] = np.moveaxis(turned, 2, 0) / ends[1][:, None] ** np.arange(6)
        first[bent], second[bent] = tilt, axis
    return {"first": first, "second": second, "f": f, "g": g}


def _axes_of_turns(segments: Segments, bent: IntArray) -> FloatArray:
    """Unit vectors about which the tangents turn along transitions; zero where they do not."""
    lengths = segments.lengths[bent]
    into, out = segments.at(bent, 0 * lengths, 1), segments.at(bent, lengths, 1)
    found = np.cross(into, out)
    # A transition that bends to both sides may turn by nothing.
    for share in (0.0, 0.5, 1.0):
        u = share * lengths
        other = np.cross(segments.at(bent, u, 1), segments.at(bent, u, 2)) * lengths[:, None]
        size = [np.linalg.norm(x, axis=1, keepdims=True) for x in (found, other)]
        found = np.where(size[0] < NO_AXIS * size[1], other, found)
    across = found - dot(found, into)[:, None] * into / dot(into, into)[:, None]
    size = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(np.divide(across, size, out=np.zeros_like(found), where=size > 0))


def _shared_changes(segments: Segments) -> FloatArray:
    """Derivatives of the tangents' angular rates at all vertices [rad/m²], (n + 1, 3).

    At a vertex between transitions it is the mean of both; lines and arcs turn evenly, so that it
    is zero at their ends.
    """
    every = np.arange(len(segments))
    sides = [
        np.cross(segments.at(every, u, 1), segments.at(every, u, 3))
        for u in (segments.lengths, 0 * segments.lengths)
    ]
    bent = np.concatenate([segments.bent[:1], segments.bent, segments.bent[-1:]])
    before = np.concatenate([sides[1][:1], sides[0]])
    after = np.concatenate([sides[1], sides[0][-1:]])
    return np.where((bent[:-1] & bent[1:])[:, None], (before + after) / 2, 0.0)


def _constant(segments: Segments, rotation: FloatArray, axis_only: bool) -> Orientation:
    """The same rotation along the whole path."""
    n = len(segments)
    starts = np.tile(rotation, (n, 1, 1))
    return Orientation.even(segments.lengths, starts, np.zeros((n, 3)), axis_only=axis_only)


def _turn_evenly(
    segments: Segments, waypoints: IntArray, starts: FloatArray, turn: FloatArray, axis_only: bool
) -> Orientation:
    """An orientation with a constant angular rate from waypoint to waypoint.

    Args:
        segments: Segments of the path.
        waypoints: Indices of the vertices that are waypoints, (k + 1,).
        starts: Rotation matrices at all waypoints but the last, (k, 3, 3).
        turn: Rotation vectors from each waypoint to the next [rad], (k, 3).
        axis_only: Rotation about the tool axis is free.
    """
    first, breaks = waypoints[:-1], segments.breaks
    section = np.repeat(np.arange(len(turn)), np.diff(waypoints))
    rates = (turn / np.add.reduceat(segments.lengths, first)[:, None])[section]
    after = breaks[:-1] - breaks[first[section]]
    segment_starts = exp(after[:, None] * rates) @ starts[section]
    return Orientation.even(segments.lengths, segment_starts, rates, axis_only=axis_only)


def _per_waypoint(
    name: str, given: FloatArray, waypoints: IntArray, merged: tuple[int, ...]
) -> tuple[FloatArray, IntArray]:
    """One value per waypoint of the path, and the indices of these waypoints in the input points.

    Args:
        name: Name of the values in refusals.
        given: One value per input point, or per input point without repeated ones.
        waypoints: Indices of the vertices that are waypoints.
        merged: Indices of the input points that repeat the point before them.

    Raises:
        InvalidInput: The number of values is wrong, or two values at one point differ.
    """
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


def _check_turns(turn: FloatArray, names: IntArray) -> FloatArray:
    """Rotation vectors from waypoint to waypoint, with rounding errors set to zero.

    Raises:
        InvalidInput: A rotation is half a turn, so that no shortest rotation exists.
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
