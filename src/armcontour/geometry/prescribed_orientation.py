"""Tool orientation along a path before corner rounding: from rotations, axes or the tangent."""

from __future__ import annotations

from collections.abc import Mapping
from functools import lru_cache
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import exp, log, rotations, shortest
from armcontour.core.quintics import quintic
from armcontour.geometry.biarcs import dot, unit
from armcontour.geometry.orientation import (
    LINEAR,
    SAME_ORIENTATION,
    Orientation,
    evaluate_polynomials,
    no_third_rotation,
)
from armcontour.geometry.segments import Segments
from armcontour.geometry.spline_orientation import (
    NO_TURN,
    along_tilt_and_axis,
    smooth_waypoints,
    turn_axes_smoothly,
    turn_smoothly,
)

# Orientations that differ by more than this have no unique shortest rotation [rad].
HALF_TURN = np.pi - 1e-6
# The first and last tangents of an S-shaped transition can be parallel, so their cross product
# gives no axis. If its norm is below this fraction of the curvature times the length, the axis of
# the curvature is used instead.
NO_AXIS = 1e-6
# Default rotation of the tool in the path's frame: its x axis points along the path, and its z axis
# (the tool axis) is opposite to `up`.
POINTING_DOWN = checks.frozen_array(np.diag([1.0, -1.0, -1.0]))


def orient_by_rotations(
    segments: Segments,
    waypoints: IntArray,  # Indices of the vertices at which the input points of the path lie
    merged: tuple[int, ...],  # Indices of the input points that repeat the point before them
    values: Any,  # Rotations in a form that `rotations` accepts: one, or one per input point
    *,
    axis_only: bool,  # True if rotation about the tool axis is free
) -> Orientation:
    """Make a constant orientation, or one per waypoint with the shortest rotations between."""
    specified = rotations("tool orientation", values)
    if specified.ndim == 2:
        return _constant(segments, specified, axis_only)
    matrices, names = _per_waypoint("tool orientation", specified, waypoints, merged)
    turn = _check_turns(log(matrices[1:] @ np.swapaxes(matrices[:-1], 1, 2)), names)
    smooth = smooth_waypoints(segments, waypoints)
    if smooth.any() and turn.any():
        return turn_smoothly(segments, waypoints, matrices, smooth, axis_only)
    return _turn_evenly(segments, waypoints, matrices[:-1], turn, axis_only)


def orient_by_axes(
    segments: Segments, waypoints: IntArray, merged: tuple[int, ...], values: npt.ArrayLike
) -> Orientation:
    """Make a constant tool axis, or one per waypoint; rotation about it is free.

    `values` is one direction of the tool axis, (3,), or one per input point, (n, 3).
    """
    directions = checks.check_numbers("direction of the tool axis", values)
    if directions.shape[-1:] != (3,) or directions.ndim > 2:
        raise InvalidInput(
            "The direction of the tool axis must be 3 numbers, once or per waypoint, but has the "
            f"shape {directions.shape}."
        )
    if directions.ndim == 1 and directions.any():
        return _constant(segments, _pointing(*directions.tolist()), axis_only=True)
    size = np.linalg.norm(directions, axis=-1, keepdims=True)
    if (size == 0).any():
        raise InvalidInput("The direction of the tool axis has no length. It must not be zero.")
    unit = directions / size
    start = _pointing(*directions[0].tolist())
    axes, names = _per_waypoint("direction of the tool axis", unit, waypoints, merged)
    turn = _check_turns(shortest(axes[:-1], axes[1:]), names)
    smooth = smooth_waypoints(segments, waypoints)
    if smooth.any() and turn.any():
        return turn_axes_smoothly(segments, waypoints, axes, smooth, start)
    starts = np.empty((len(turn), 3, 3))
    steps = exp(turn)
    for i in range(len(turn)):
        starts[i] = start
        start = steps[i] @ start
    return _turn_evenly(segments, waypoints, starts, turn, axis_only=True)


@lru_cache(maxsize=1)
def _pointing(x: float, y: float, z: float) -> FloatArray:
    """Return the shortest rotation from the z axis to a direction, (3, 3), read-only."""
    # The result is cached, because all contours of a program have the same direction.
    direction = np.array([x, y, z])
    unit = direction / np.linalg.norm(direction, axis=-1, keepdims=True)
    return checks.frozen_array(exp(shortest([0.0, 0.0, 1.0], unit)))


def follow_tangent(
    segments: Segments, up: npt.ArrayLike, tool: Any | None = None, *, axis_only: bool = False
) -> Orientation:
    """Make an orientation at a fixed angle to the tangent of a path.

    The tool never turns about the tangent. Its orientation is constant on a line, turns with the
    tangent on an arc, and jumps by the turn at a corner that is not rounded.

    - `segments`: segments of a path in space.
    - `up`: direction whose component perpendicular to the first tangent is the z axis of the path's
      frame, (3,); the x axis of this frame is the tangent.
    - `tool`: rotation of the tool in the path's frame, in a form that `rotations` accepts, by
      default `POINTING_DOWN`.
    - `axis_only`: true if rotation about the tool axis is free.
    """
    in_path = POINTING_DOWN if tool is None else rotations("tool in the path's frame", tool)
    if in_path.shape != (3, 3):
        raise InvalidInput(
            "A tool that follows the tangent has one rotation for the whole path, so `tool` must "
            "be one rotation."
        )
    upward = checks.check_numbers("up", up)
    tangent = segments.tangents[0]
    if upward.shape != (3,):
        raise InvalidInput(f"The direction up must be 3 numbers, but has the shape {upward.shape}.")
    z = upward - (upward @ tangent) * tangent
    size = np.linalg.norm(z)
    smallest = 1e-6 * np.linalg.norm(upward)
    if size < smallest or not smallest > 0:
        raise InvalidInput(
            "up lies along the first tangent of the path or is zero. Specify a direction that is "
            "not parallel to the tangent."
        )
    z = z / size
    frame = np.stack([tangent, np.cross(z, tangent), z], axis=1)
    return carry_frame(segments, frame @ in_path, axis_only=axis_only)


def carry_frame(segments: Segments, frame: FloatArray, *, axis_only: bool = False) -> Orientation:
    """Make an orientation that turns with the tangent of a path and never about it.

    - `frame`: rotation matrix of the tool at the path's start, (3, 3).
    - `axis_only`: true if rotation about the tool axis is free.
    """
    corners = shortest(segments.end_tangents[:-1], segments.tangents[1:])
    turn = np.linalg.norm(corners, axis=1)
    if (turn > HALF_TURN).any():
        i = int(np.argmax(turn > HALF_TURN))
        raise InvalidInput(
            f"At the vertex after segment {i + 1} the path turns back by 180°, so the rotation of "
            "a tool that follows the tangent is ambiguous. Use a constant tool orientation, or "
            "split the path there.",
            index=i,
            point=segments.starts[i + 1].tolist(),
        )
    return follow_tangents(segments, frame, exp(corners), {}, axis_only=axis_only)


def follow_tangents(
    segments: Segments,
    frame: FloatArray,  # Rotation matrix at the start, (3, 3)
    corners: FloatArray | None,
    frames: Mapping[int, FloatArray],
    *,
    axis_only: bool,  # True if rotation about the tool axis is free
) -> Orientation:
    """Make an orientation that turns with the tangents of segments.

    - `corners`: rotations at the vertices between the n segments, (n - 1, 3, 3), or None if there
      are none.
    - `frames`: rotation matrices at the starts of some segments, {index: (3, 3)}, which replace the
      computed ones.
    """
    columns = tangent_turns(segments)
    tilt, turn = (evaluate_polynomials(columns[x], segments.lengths)[:, None] for x in "fg")
    turns = exp(turn * columns["second"]) @ exp(tilt * columns["first"])
    if corners is not None:
        turns[:-1] = corners @ turns[:-1]
    starts = np.empty((len(segments), 3, 3))
    for k in range(len(segments)):
        starts[k] = frame = frames.get(k, frame)
        frame = turns[k] @ frame
    return Orientation(
        breaks=segments.breaks,
        starts=starts,
        **columns,
        **no_third_rotation(len(segments), columns["f"].shape[1]),
        axis_only=axis_only,
        follows=True,
        cone=0.0,
    )


def tangent_rates(segments: Segments) -> FloatArray:
    """Return the angular rates of the tangents on lines and arcs [rad/m], (n, 3)."""
    return np.asarray(segments.curvatures[:, None] * np.cross(segments.tangents, segments.normals))


def tangent_turns(segments: Segments) -> dict[str, FloatArray]:
    """Return the tangents' rotations as columns `first`, `second`, `f`, `g` of an `Orientation`.

    On a transition, `second` is the axis that turns the first tangent to the last, and `first`
    tilts the tangent out of this plane. Both angles are quintics that match the tangent, the
    curvature and, in a plane, the shared derivative of the angular rate at both ends.
    """
    first = tangent_rates(segments)
    f = np.tile(LINEAR, (len(segments), 1))
    second = np.zeros_like(first)
    g = np.zeros_like(f)
    bent = np.flatnonzero(segments.is_transition)
    if len(bent):
        ends = np.zeros(len(bent)), segments.lengths[bent]
        tangents = [segments.evaluate(bent, u, 1) for u in ends]
        rates = [
            np.cross(t, segments.evaluate(bent, u, 2)) for t, u in zip(tangents, ends, strict=True)
        ]
        axis = _axes_of_turns(segments, bent)
        tilt = np.cross(axis, tangents[0])
        t0, t1 = (unit(x) for x in tangents)
        turn = np.arctan2(dot(t1, tilt), dot(t1, t0))[:, None]
        tilt_angle = -np.arcsin(dot(t1, axis).clip(-1, 1))[:, None]
        change = _shared_changes(segments)
        tilted = np.cos(turn) * tilt - np.sin(turn) * t0
        tilts = (tilt, tilted)
        rate = along_tilt_and_axis(rates, tilts, axis)
        rate_change = along_tilt_and_axis((change[bent], change[bent + 1]), tilts, axis)
        angles = np.hstack([tilt_angle, turn])
        zeros = np.zeros_like(angles)
        quintics = quintic(
            ends[1], (zeros, rate[0], rate_change[0]), (angles, rate[1], rate_change[1])
        )
        f, g = (np.pad(x, ((0, 0), (0, 2))) for x in (f, g))
        f[bent], g[bent] = np.moveaxis(quintics, 2, 0) / ends[1][:, None] ** np.arange(6)
        first[bent] = tilt
        second[bent] = axis
    return {"first": first, "second": second, "f": f, "g": g}


def _axes_of_turns(segments: Segments, bent: IntArray) -> FloatArray:
    """Return unit axes about which tangents turn along transitions; zero for straight ones."""
    lengths = segments.lengths[bent]
    into = segments.evaluate(bent, 0 * lengths, 1)
    out = segments.evaluate(bent, lengths, 1)
    axes = np.cross(into, out)
    # The first and last tangents of an S-shaped transition can be parallel, see `NO_AXIS`.
    for share in (0.0, 0.5, 1.0):
        u = share * lengths
        curvature_axes = (
            np.cross(segments.evaluate(bent, u, 1), segments.evaluate(bent, u, 2))
            * lengths[:, None]
        )
        size = [np.linalg.norm(x, axis=1, keepdims=True) for x in (axes, curvature_axes)]
        axes = np.where(size[0] < NO_AXIS * size[1], curvature_axes, axes)
    across = axes - dot(axes, into)[:, None] * into / dot(into, into)[:, None]
    size = np.linalg.norm(across, axis=1, keepdims=True)
    return np.asarray(np.divide(across, size, out=np.zeros_like(axes), where=size > 0))


def _shared_changes(segments: Segments) -> FloatArray:
    """Return derivatives of the tangents' angular rates at all vertices [rad/m²], (n + 1, 3).

    At a vertex between transitions this is the mean of both sides. Lines and arcs turn at a
    constant rate, so the derivative is zero at their ends.
    """
    every = np.arange(len(segments))
    sides = [
        np.cross(segments.evaluate(every, u, 1), segments.evaluate(every, u, 3))
        for u in (segments.lengths, 0 * segments.lengths)
    ]
    bent = np.concatenate(
        [segments.is_transition[:1], segments.is_transition, segments.is_transition[-1:]]
    )
    before = np.concatenate([sides[1][:1], sides[0]])
    after = np.concatenate([sides[1], sides[0][-1:]])
    return np.where((bent[:-1] & bent[1:])[:, None], (before + after) / 2, 0.0)


def _constant(segments: Segments, rotation: FloatArray, axis_only: bool) -> Orientation:
    """Make an orientation with the same rotation matrix along the whole path."""
    n = len(segments)
    starts = np.tile(rotation, (n, 1, 1))
    return Orientation.even(segments.lengths, starts, np.zeros((n, 3)), axis_only=axis_only)


def _turn_evenly(
    segments: Segments, waypoints: IntArray, starts: FloatArray, turn: FloatArray, axis_only: bool
) -> Orientation:
    """Make an orientation with a constant angular rate from waypoint to waypoint.

    - `waypoints`: indices of the vertices at the waypoints, (n + 1,).
    - `starts`: rotation matrices at the waypoints except the last one, (n, 3, 3).
    - `turn`: rotation vectors from waypoint to waypoint [rad], (n, 3).
    """
    first = waypoints[:-1]
    breaks = segments.breaks
    section = np.repeat(np.arange(len(turn)), np.diff(waypoints))
    rates = (turn / np.add.reduceat(segments.lengths, first)[:, None])[section]
    after = breaks[:-1] - breaks[first[section]]
    segment_starts = exp(after[:, None] * rates) @ starts[section]
    return Orientation.even(segments.lengths, segment_starts, rates, axis_only=axis_only)


def _per_waypoint(
    name: str, values: FloatArray, waypoints: IntArray, merged: tuple[int, ...]
) -> tuple[FloatArray, IntArray]:
    """Return one value per waypoint, and the index of each waypoint among the input points.

    - `name`: name of the values, for messages.
    - `values`: one value per waypoint, or one per input point.
    - `merged`: indices of the input points that repeat the point before them.
    """
    count = len(waypoints)
    points = count + len(merged)
    if len(values) not in (points, count):
        raise InvalidInput(
            f"{name} has {len(values)} values, but the path has {points} waypoints. Specify one "
            f"value for the whole path, or {points} values."
        )
    if len(values) == count:
        return values, np.arange(count)
    for i in merged:
        if np.abs(values[i] - values[i - 1]).max() > SAME_ORIENTATION:
            raise InvalidInput(
                f"Waypoint {i + 1} repeats the previous point with another {name}, but a path "
                "cannot turn the tool on the spot. Move the point, or split the path.",
                index=i,
            )
    names = np.delete(np.arange(points), merged)
    return values[names], names


def _check_turns(turn: FloatArray, names: IntArray) -> FloatArray:
    """Return rotation vectors, with zero for rounding errors [rad], (n, 3).

    Raises InvalidInput for half turns.

    - `turn`: rotation vectors from waypoint to waypoint [rad], (n, 3).
    - `names`: index of each waypoint among the input points, (n + 1,).
    """
    angle = np.linalg.norm(turn, axis=1)
    if (angle > HALF_TURN).any():
        i = int(np.argmax(angle > HALF_TURN))
        raise InvalidInput(
            f"The tool orientations at waypoints {names[i] + 1} and {names[i + 1] + 1} differ by "
            "half a turn, so there is no unique shortest rotation between them. Insert a waypoint "
            "between them.",
            index=int(names[i]),
        )
    return np.where(angle[:, None] < NO_TURN, 0.0, turn)
