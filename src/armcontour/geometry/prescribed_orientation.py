"""Tool orientation along a path before corner rounding: from rotations, axes or the tangent."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import lru_cache
from itertools import pairwise
from typing import Any

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.frames import (
    angle_between,
    exp,
    log,
    perpendicular,
    quaternions,
    rotations,
    shortest,
)
from armcontour.core.quintics import quintic
from armcontour.geometry.biarcs import dot, unit
from armcontour.geometry.orientation import (
    LINEAR,
    SAME_ORIENTATION,
    Orientation,
    evaluate_polynomials,
    no_third_rotation,
    rotate,
)
from armcontour.geometry.segments import TANGENT_TOLERANCE, Segments

# Orientations that differ by more than this have no unique shortest rotation [rad].
HALF_TURN = np.pi - 1e-6
# Rotations by less than this are rounding errors [rad].
NO_TURN = 1e-14
# Largest angle by which the tool turns between two knots along a spline [rad].
LARGEST_STEP = 0.2
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
    smooth = _smooth_waypoints(segments, waypoints)
    if smooth.any() and turn.any():
        return _turn_smoothly(segments, waypoints, matrices, smooth, axis_only)
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
    smooth = _smooth_waypoints(segments, waypoints)
    if smooth.any() and turn.any():
        return _turn_axes_smoothly(segments, waypoints, axes, smooth, start)
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
        out = -np.arcsin(dot(t1, axis).clip(-1, 1))[:, None]
        change = _shared_changes(segments)
        tilted = np.cos(turn) * tilt - np.sin(turn) * t0
        tilts = (tilt, tilted)
        rate = _along_tilt_and_axis(rates, tilts, axis)
        rate_change = _along_tilt_and_axis((change[bent], change[bent + 1]), tilts, axis)
        angles = np.hstack([out, turn])
        none = np.zeros_like(angles)
        turned = quintic(
            ends[1], (none, rate[0], rate_change[0]), (angles, rate[1], rate_change[1])
        )
        f, g = (np.pad(x, ((0, 0), (0, 2))) for x in (f, g))
        f[bent], g[bent] = np.moveaxis(turned, 2, 0) / ends[1][:, None] ** np.arange(6)
        first[bent] = tilt
        second[bent] = axis
    return {"first": first, "second": second, "f": f, "g": g}


def _along_tilt_and_axis(
    vectors: Sequence[FloatArray], tilts: Sequence[FloatArray], axis: FloatArray
) -> list[FloatArray]:
    """Return the components of vectors at both ends along the tilt and the axis, (k, 2)."""
    return [
        np.stack([dot(x, tilt), dot(x, axis)], axis=1)
        for x, tilt in zip(vectors, tilts, strict=True)
    ]


def _axes_of_turns(segments: Segments, bent: IntArray) -> FloatArray:
    """Return unit axes about which tangents turn along transitions; zero for straight ones."""
    lengths = segments.lengths[bent]
    into = segments.evaluate(bent, 0 * lengths, 1)
    out = segments.evaluate(bent, lengths, 1)
    axes = np.cross(into, out)
    # The first and last tangents of an S-shaped transition can be parallel, see `NO_AXIS`.
    for share in (0.0, 0.5, 1.0):
        u = share * lengths
        other = (
            np.cross(segments.evaluate(bent, u, 1), segments.evaluate(bent, u, 2))
            * lengths[:, None]
        )
        size = [np.linalg.norm(x, axis=1, keepdims=True) for x in (axes, other)]
        axes = np.where(size[0] < NO_AXIS * size[1], other, axes)
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
    """Make an orientation with the same rotation along the whole path."""
    n = len(segments)
    starts = np.tile(rotation, (n, 1, 1))
    return Orientation.even(segments.lengths, starts, np.zeros((n, 3)), axis_only=axis_only)


def _turn_evenly(
    segments: Segments, waypoints: IntArray, starts: FloatArray, turn: FloatArray, axis_only: bool
) -> Orientation:
    """Make an orientation with a constant angular rate from waypoint to waypoint."""
    first = waypoints[:-1]
    breaks = segments.breaks
    section = np.repeat(np.arange(len(turn)), np.diff(waypoints))
    rates = (turn / np.add.reduceat(segments.lengths, first)[:, None])[section]
    after = breaks[:-1] - breaks[first[section]]
    segment_starts = exp(after[:, None] * rates) @ starts[section]
    return Orientation.even(segments.lengths, segment_starts, rates, axis_only=axis_only)


def _smooth_waypoints(segments: Segments, waypoints: IntArray) -> BoolArray:
    """Return the mask of the inner waypoints at which the path is a spline, (waypoints - 2,)."""
    inner = waypoints[1:-1]
    bent = segments.is_transition
    tangent = angle_between(segments.end_tangents[inner - 1], segments.tangents[inner])
    return np.asarray(bent[inner - 1] & bent[inner] & (tangent <= TANGENT_TOLERANCE))


def _turn_axes_smoothly(
    segments: Segments, waypoints: IntArray, axes: FloatArray, smooth: BoolArray, frame: FloatArray
) -> Orientation:
    """Make an orientation whose tool axis turns at a continuous rate along splines.

    Along a spline, the axis is the cubic spline through the axes at the waypoints over arc length,
    divided by its length. At other waypoints its rate may jump.

    - `axes`: unit vectors of the tool axis at the waypoints, (n, 3).
    - `smooth`: mask of the inner waypoints on a spline, (n - 2,).
    - `frame`: rotation matrix at the start, (3, 3).
    """
    s = segments.breaks[waypoints]
    knots = []
    tables: list[dict[str, FloatArray]] = []
    for run in _splines_between_corners(smooth):
        motion = _spline_of_axes(s[run], axes[run])
        tables.append(_two_turns(motion))
        knots.append(motion.s[:-1])
    breaks = np.concatenate([*knots, s[-1:]])
    columns = {x: np.concatenate([table[x] for table in tables]) for x in tables[0]}
    lengths = np.diff(breaks)
    tilt, turn = (evaluate_polynomials(columns[x], lengths)[:, None] for x in "fg")
    steps = exp(turn * columns["second"]) @ exp(tilt * columns["first"])
    starts = np.empty((len(lengths), 3, 3))
    for k in range(len(lengths)):
        starts[k] = frame
        frame = steps[k] @ frame
    return Orientation(
        breaks=breaks,
        starts=starts,
        **columns,
        **no_third_rotation(len(lengths), 6),
        axis_only=True,
        follows=False,
    )


def _turn_smoothly(
    segments: Segments,
    waypoints: IntArray,
    matrices: FloatArray,
    smooth: BoolArray,
    axis_only: bool,
) -> Orientation:
    """Make an orientation with a continuous rate and derivative of the rate along splines.

    Along a spline, the unit quaternion is the cubic spline through the quaternions at the waypoints
    over arc length, divided by its norm. At other waypoints the rate may jump.

    - `matrices`: rotation matrices at the waypoints, (n, 3, 3).
    - `smooth`: mask of the inner waypoints on a spline, (n - 2,).
    """
    s = segments.breaks[waypoints]
    knots = []
    tables: list[dict[str, FloatArray]] = []
    for run in _splines_between_corners(smooth):
        motion = _spline_of_rotations(s[run], matrices[run])
        tables.append(_three_turns(motion))
        knots.append(motion.s[:-1])
    columns = {x: np.concatenate([table[x] for table in tables]) for x in tables[0]}
    return Orientation(
        breaks=np.concatenate([*knots, s[-1:]]), **columns, axis_only=axis_only, follows=False
    )


def _splines_between_corners(smooth: BoolArray) -> list[slice]:
    """Return the waypoints of each run between waypoints that are not smooth, ends included.

    - `smooth`: mask of the inner waypoints on a spline, (n - 2,).
    """
    ends = np.concatenate([[0], 1 + np.flatnonzero(~smooth), [len(smooth) + 1]])
    return [slice(first, last + 1) for first, last in pairwise(ends.tolist())]


def _subdivide(s: FloatArray, angles: FloatArray) -> FloatArray:
    """Return arc lengths [m] between which the tool turns by about `LARGEST_STEP` at most.

    - `s`: arc lengths of waypoints [m], (n,).
    - `angles`: angles by which the tool turns between them [rad], (n - 1,).
    """
    parts = np.maximum(np.ceil(angles / LARGEST_STEP), 1).astype(np.intp)
    inner = [np.linspace(s[i], s[i + 1], n, endpoint=False) for i, n in enumerate(parts)]
    return np.concatenate([*inner, s[-1:]])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Motion:
    """An axis or a rotation that turns smoothly, at k knots."""

    s: FloatArray  # Arc lengths of the knots [m], (k,)
    poses: FloatArray  # Unit vectors of the axis, (k, 3), or rotation matrices, (k, 3, 3)
    rates: FloatArray  # Angular rates [rad/m], (k, 3)
    changes: FloatArray  # Derivatives of the angular rates [rad/m²], (k, 3)


def _spline_of_rotations(s: FloatArray, matrices: FloatArray) -> _Motion:
    """Interpolate rotations by a spline, with knots between which the tool turns little.

    With a cubic spline p(s) through the unit quaternions at the points `s` and q = p / |p|, the
    angular rate is the vector part of 2 q' q* = 2 p' p* / |p|², where * conjugates. Its derivative
    is that of this expression. Between two points only, the rate is constant.
    """
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation

    turns = log(matrices[1:] @ np.swapaxes(matrices[:-1], 1, 2))
    knots = _subdivide(s, np.linalg.norm(turns, axis=1))
    if len(s) == 2:
        rates = np.tile(turns / (s[1] - s[0]), (len(knots), 1))
        rotation = exp((knots - s[0])[:, None] * rates) @ matrices[0]
        return _Motion(s=knots, poses=rotation, rates=rates, changes=np.zeros_like(rates))
    points = quaternions(matrices)
    # A quaternion and its negative are the same rotation. The shortest turn keeps the sign.
    flips = np.sum(points[1:] * points[:-1], axis=1) < 0
    points[1:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
    curve = CubicSpline(s, points)
    value, first, second = (curve(knots, order) for order in range(3))
    norm2 = np.sum(value * value, axis=1, keepdims=True)
    rate = 2 * _quotient(first, value) / norm2
    change = (2 * _quotient(second, value) - 2 * dot(first, value)[:, None] * rate) / norm2
    rotation = Rotation.from_quat(value).as_matrix()
    return _Motion(s=knots, poses=rotation, rates=rate, changes=change)


def _quotient(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the vector part of the quaternion product a b*, where * conjugates, (n, 3).

    - `a`, `b`: quaternions x, y, z, w, (n, 4).
    """
    v = a[:, :3]
    w = b[:, :3]
    return np.asarray(b[:, 3:] * v - a[:, 3:] * w - np.cross(v, w))


def _three_turns(motion: _Motion) -> dict[str, FloatArray]:
    """Compute the rotations and polynomials of an `Orientation` between the knots of a motion.

    The third axis c is that of the whole turn, and the axes a and b of the first and second
    rotation complete it to a right-handed frame. At the start and at the end of a piece, where
    f = g = 0, the rate w and its derivative d in this frame, turned by the third rotation, are

        w = (f', g', h'),  d = (f'' - g' h', g'' + h' f', h'' - f' g').
    """
    lengths = np.diff(motion.s)
    turn = log(motion.poses[1:] @ np.swapaxes(motion.poses[:-1], 1, 2))
    angle = np.linalg.norm(turn, axis=1)
    # Without a turn, any axes serve.
    third = np.where(angle[:, None] > NO_TURN, turn, [0.0, 0.0, 1.0])
    third = unit(third)
    first = unit(perpendicular(third))
    second = np.cross(third, first)
    axes = np.stack([first, second, third], axis=1)
    rates = []
    changes = []
    turned = axes @ np.swapaxes(exp(angle[:, None] * third), 1, 2)
    for frame, knots in ((axes, slice(-1)), (turned, slice(1, None))):
        w = rotate(frame, motion.rates[knots])
        products = np.stack([w[:, 1] * w[:, 2], -w[:, 2] * w[:, 0], w[:, 0] * w[:, 1]], axis=1)
        rates.append(w)
        changes.append(rotate(frame, motion.changes[knots]) + products)
    none = np.zeros_like(third)
    angles = np.where([False, False, True], angle[:, None], none)
    turns = quintic(lengths, (none, rates[0], changes[0]), (angles, rates[1], changes[1]))
    f, g, h = np.moveaxis(turns, 2, 0) / lengths[:, None] ** np.arange(6)
    axes_by_name = {"first": first, "second": second, "third": third}
    return {"starts": motion.poses[:-1], **axes_by_name, "f": f, "g": g, "h": h}


def _spline_of_axes(s: FloatArray, axes: FloatArray) -> _Motion:
    """Interpolate unit vectors by a spline, with knots between which the axis turns little.

    The knots are the points `s`, (k,), with the unit vectors `axes`, (k, 3), and points between
    them, so that the axis turns by LARGEST_STEP at most. Between two points only, the axis turns in
    their plane at a constant rate.
    """
    from scipy.interpolate import CubicSpline

    knots = _subdivide(s, angle_between(axes[1:], axes[:-1]))
    if len(s) == 2:
        turn = shortest(axes[:1], axes[1:])
        rate = turn / (s[1] - s[0])
        axis = np.squeeze(exp((knots - s[0])[:, None] * rate) @ axes[0][:, None], axis=-1)
        slope = np.cross(rate, axis)
        return _axis_motion(knots, axis, slope, np.cross(rate, slope))
    curve = CubicSpline(s, axes)
    value, first, second = (curve(knots, order) for order in range(3))
    size = np.linalg.norm(value, axis=1, keepdims=True)
    axis = value / size
    # Derivatives of value / |value|.
    growth = dot(axis, first)[:, None]
    slope = (first - growth * axis) / size
    bending = dot(axis, second)[:, None] + (slope * first).sum(axis=1, keepdims=True)
    bend = (second - bending * axis - 2 * growth * slope) / size
    return _axis_motion(knots, axis, slope, bend)


def _axis_motion(
    knots: FloatArray, axis: FloatArray, slope: FloatArray, bend: FloatArray
) -> _Motion:
    """Return the motion of a unit vector.

    - `knots`: arc lengths [m], (k,).
    - `axis`, `slope`, `bend`: the vector and its first and second derivative there, (k, 3) each.
    """
    return _Motion(s=knots, poses=axis, rates=np.cross(axis, slope), changes=np.cross(axis, bend))


def _two_turns(motion: _Motion) -> dict[str, FloatArray]:
    """Compute `first`, `second`, `f` and `g` of an `Orientation` between the knots of an axis.

    The second rotation turns from the first direction to the last, and the first rotation tilts
    out of this plane, as in `tangent_turns`.
    """
    lengths = np.diff(motion.s)
    start = motion.poses[:-1]
    last = motion.poses[1:]
    axis = np.cross(start, last)
    size = np.linalg.norm(axis, axis=1, keepdims=True)
    # Without a turn, any axis across the direction serves.
    across = np.cross(start, np.eye(3)[np.abs(start).argmin(axis=1)])
    axis = unit(np.where(size > NO_TURN, axis, across))
    tilt = np.cross(axis, start)
    turn = np.arctan2(dot(last, tilt), dot(last, start))[:, None]
    out = -np.arcsin(dot(last, axis).clip(-1, 1))[:, None]
    tilts = tilt, np.cos(turn) * tilt - np.sin(turn) * start
    rate = _along_tilt_and_axis((motion.rates[:-1], motion.rates[1:]), tilts, axis)
    change = _along_tilt_and_axis((motion.changes[:-1], motion.changes[1:]), tilts, axis)
    angles = np.hstack([out, turn])
    none = np.zeros_like(angles)
    turned = quintic(lengths, (none, rate[0], change[0]), (angles, rate[1], change[1]))
    f, g = np.moveaxis(turned, 2, 0) / lengths[:, None] ** np.arange(6)
    return {"first": tilt, "second": axis, "f": f, "g": g}


def _per_waypoint(
    name: str, values: FloatArray, waypoints: IntArray, merged: tuple[int, ...]
) -> tuple[FloatArray, IntArray]:
    """Return one value per waypoint, and the index of each waypoint among the input points."""
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
    """Replace rotation vectors below rounding errors by zero; raise InvalidInput for half turns."""
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
