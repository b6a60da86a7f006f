"""Tool orientation along splines: an axis or a rotation per waypoint, turned at a smooth rate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise
from typing import TYPE_CHECKING

import numpy as np

from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.frames import angle_between, exp, log, perpendicular, quaternions, shortest
from armcontour.core.quintics import quintic
from armcontour.geometry.biarcs import dot, unit
from armcontour.geometry.orientation import (
    Orientation,
    evaluate_polynomials,
    no_third_rotation,
    rotate,
)
from armcontour.geometry.segments import TANGENT_TOLERANCE, Segments

if TYPE_CHECKING:
    from scipy.interpolate import CubicSpline

# Rotations by less than this are rounding errors [rad].
NO_TURN = 1e-14
# Largest angle by which the tool turns between two knots along a spline [rad].
LARGEST_TURN_STEP = 0.2


def smooth_waypoints(segments: Segments, waypoints: IntArray) -> BoolArray:
    """Return the mask of the inner waypoints at which the path is a spline, (waypoints - 2,)."""
    inner = waypoints[1:-1]
    bent = segments.is_transition
    tangent = angle_between(segments.end_tangents[inner - 1], segments.tangents[inner])
    return np.asarray(bent[inner - 1] & bent[inner] & (tangent <= TANGENT_TOLERANCE))


def turn_axes_smoothly(
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
    runs = [AxisRun(s=s[run], axes=axes[run]) for run in _splines_between_corners(smooth)]
    return turn_axes_along(runs, frame)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Motion:
    """An axis or a rotation that turns smoothly, at k knots.

    Args:
        s: Arc lengths of the knots [m], (k,).
        poses: Unit vectors of the axis, (k, 3), or rotation matrices, (k, 3, 3).
        rates: Angular rates [rad/m], (k, 3).
        changes: Derivatives of the angular rates [rad/m²], (k, 3).
    """

    s: FloatArray
    poses: FloatArray
    rates: FloatArray
    changes: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class AxisRun:
    """Directions of the tool axis along a part of a path on which it turns smoothly.

    Args:
        s: Arc lengths [m], increasing, (n,).
        axes: Unit vectors of the tool axis there, (n, 3).
        periodic: Whether the axis turns at the same rate at both ends, which have the same axis.
    """

    s: FloatArray
    axes: FloatArray
    periodic: bool = False


def turn_axes_along(runs: Sequence[AxisRun], frame: FloatArray) -> Orientation:
    """Make an orientation whose tool axis follows consecutive runs; rotation about it is free.

    - `frame`: rotation matrix at the start, (3, 3), whose third column is the first axis.
    """
    motions = [_spline_of_axes(run) for run in runs]
    return _join_two_turns(motions, frame)


def orient_between_knots(motions: Sequence[Motion], *, axis_only: bool) -> Orientation:
    """Make an orientation with given rotations, rates and changes at the knots of motions.

    - `motions`: consecutive motions of rotation matrices.
    - `axis_only`: true if rotation about the tool axis is free.
    """
    if axis_only:
        return _join_two_turns([_motion_of_axis(x) for x in motions], motions[0].poses[0])
    tables = [_three_turns(x) for x in motions]
    breaks = np.concatenate([*(x.s[:-1] for x in motions), motions[-1].s[-1:]])
    columns = {x: np.concatenate([table[x] for table in tables]) for x in tables[0]}
    return Orientation(breaks=breaks, **columns, axis_only=False, follows=False, cone=0.0)


def _motion_of_axis(motion: Motion) -> Motion:
    """Return the motion of the tool axis of rotations.

    The axis a, which turns at the rate w, has the derivatives a' = w × a and
    a'' = w' × a + w × a'.
    """
    axis = motion.poses[:, :, 2]
    slope = np.cross(motion.rates, axis)
    bend = np.cross(motion.changes, axis) + np.cross(motion.rates, slope)
    return _axis_motion(motion.s, axis, slope, bend)


def _join_two_turns(motions: Sequence[Motion], frame: FloatArray) -> Orientation:
    """Make an orientation whose tool axis has given directions, rates and changes at knots.

    - `motions`: consecutive motions of unit vectors.
    - `frame`: rotation matrix at the start, (3, 3).
    """
    tables = [_two_turns(x) for x in motions]
    breaks = np.concatenate([*(x.s[:-1] for x in motions), motions[-1].s[-1:]])
    columns = {x: np.concatenate([table[x] for table in tables]) for x in tables[0]}
    # The axis can jump between motions.
    first_rows = np.cumsum([0, *(len(x.s) - 1 for x in motions[:-1])])
    first_axes = {int(k): x.poses[0] for k, x in zip(first_rows, motions, strict=True)}
    lengths = np.diff(breaks)
    tilt, turn = (evaluate_polynomials(columns[x], lengths)[:, None] for x in "fg")
    steps = exp(turn * columns["second"]) @ exp(tilt * columns["first"])
    starts = np.empty((len(lengths), 3, 3))
    for k in range(len(lengths)):
        if k in first_axes:
            frame = exp(shortest(frame[:, 2], first_axes[k])) @ frame
        starts[k] = frame
        frame = steps[k] @ frame
    return Orientation(
        breaks=breaks,
        starts=starts,
        **columns,
        **no_third_rotation(len(lengths), 6),
        axis_only=True,
        follows=False,
        cone=0.0,
    )


def turn_smoothly(
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
    runs = [(s[run], matrices[run]) for run in _splines_between_corners(smooth)]
    return _turn_along(runs, axis_only=axis_only)


def turn_through(s: FloatArray, matrices: FloatArray, *, axis_only: bool) -> Orientation:
    """Make an orientation that turns at a continuous rate through rotations.

    - `s`: arc lengths [m], increasing from 0, (n,).
    - `matrices`: rotation matrices there, (n, 3, 3).
    - `axis_only`: true if rotation about the tool axis is free. The tool axis is then the spline,
      and not the rotation.
    """
    if axis_only:
        return turn_axes_along([AxisRun(s=s, axes=matrices[:, :, 2])], matrices[0])
    return _turn_along([(s, matrices)], axis_only=False)


def _turn_along(runs: Sequence[tuple[FloatArray, FloatArray]], *, axis_only: bool) -> Orientation:
    """Make an orientation that follows consecutive splines of rotations.

    - `runs`: arc lengths [m], (n,), and rotation matrices, (n, 3, 3), of each spline.
    - `axis_only`: true if rotation about the tool axis is free.
    """
    knots = []
    tables: list[dict[str, FloatArray]] = []
    for s, matrices in runs:
        motion = _spline_of_rotations(s, matrices)
        tables.append(_three_turns(motion))
        knots.append(motion.s[:-1])
    columns = {x: np.concatenate([table[x] for table in tables]) for x in tables[0]}
    last = runs[-1][0][-1:]
    return Orientation(
        breaks=np.concatenate([*knots, last]),
        **columns,
        axis_only=axis_only,
        follows=False,
        cone=0.0,
    )


def _splines_between_corners(smooth: BoolArray) -> list[slice]:
    """Return the waypoints of each run between waypoints that are not smooth, ends included.

    - `smooth`: mask of the inner waypoints on a spline, (n - 2,).
    """
    ends = np.concatenate([[0], 1 + np.flatnonzero(~smooth), [len(smooth) + 1]])
    return [slice(first, last + 1) for first, last in pairwise(ends.tolist())]


def _subdivide(s: FloatArray, angles: FloatArray) -> FloatArray:
    """Return arc lengths [m] between which the tool turns by about `LARGEST_TURN_STEP` at most.

    - `s`: arc lengths of waypoints [m], (n,).
    - `angles`: angles by which the tool turns between them [rad], (n - 1,).
    """
    parts = np.maximum(np.ceil(angles / LARGEST_TURN_STEP), 1).astype(np.intp)
    inner = [np.linspace(s[i], s[i + 1], n, endpoint=False) for i, n in enumerate(parts)]
    return np.concatenate([*inner, s[-1:]])


def _spline_of_rotations(s: FloatArray, matrices: FloatArray) -> Motion:
    """Interpolate rotations by a spline, with knots between which the tool turns little.

    With a cubic spline p(s) through the unit quaternions at the points `s` and q = p / |p|, the
    angular rate is the vector part of 2 q' q* = 2 p' p* / |p|², where * is the conjugate. Its
    derivative is that of this expression. Between two points only, the rate is constant.
    """
    from scipy.interpolate import CubicSpline
    from scipy.spatial.transform import Rotation

    turns = log(matrices[1:] @ np.swapaxes(matrices[:-1], 1, 2))
    knots = _subdivide(s, np.linalg.norm(turns, axis=1))
    if len(s) == 2:
        rates = np.tile(turns / (s[1] - s[0]), (len(knots), 1))
        rotation = exp((knots - s[0])[:, None] * rates) @ matrices[0]
        return Motion(s=knots, poses=rotation, rates=rates, changes=np.zeros_like(rates))
    points = quaternions(matrices)
    # A quaternion and its negative are the same rotation. The shortest turn keeps the sign.
    flips = np.sum(points[1:] * points[:-1], axis=1) < 0
    points[1:] *= np.where(np.cumsum(flips) % 2, -1.0, 1.0)[:, None]
    curve = CubicSpline(s, points)
    value, first, second = (curve(knots, order) for order in range(3))
    norm2 = np.sum(value * value, axis=1, keepdims=True)
    rate = 2 * _vector_of_product(first, value) / norm2
    change = (2 * _vector_of_product(second, value) - 2 * dot(first, value)[:, None] * rate) / norm2
    rotation = Rotation.from_quat(value).as_matrix()
    return Motion(s=knots, poses=rotation, rates=rate, changes=change)


def _vector_of_product(a: FloatArray, b: FloatArray) -> FloatArray:
    """Return the vector part of the quaternion product a b*, where * is the conjugate, (n, 3).

    - `a`, `b`: quaternions x, y, z, w, (n, 4).
    """
    v = a[:, :3]
    w = b[:, :3]
    return np.asarray(b[:, 3:] * v - a[:, 3:] * w - np.cross(v, w))


def _three_turns(motion: Motion) -> dict[str, FloatArray]:
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
    third = unit(np.where(angle[:, None] > NO_TURN, turn, [0.0, 0.0, 1.0]))
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
    zeros = np.zeros_like(third)
    angles = np.where([False, False, True], angle[:, None], zeros)
    turns = quintic(lengths, (zeros, rates[0], changes[0]), (angles, rates[1], changes[1]))
    f, g, h = np.moveaxis(turns, 2, 0) / lengths[:, None] ** np.arange(6)
    axes_by_name = {"first": first, "second": second, "third": third}
    return {"starts": motion.poses[:-1], **axes_by_name, "f": f, "g": g, "h": h}


def _spline_of_axes(run: AxisRun) -> Motion:
    """Interpolate unit vectors by a spline, with knots between which the axis turns little.

    The knots are the points of the run, and points between them, so that the axis turns by
    LARGEST_TURN_STEP at most. Between two points only, the axis turns in their plane at a constant
    rate.
    """
    s = run.s
    axes = run.axes
    knots = _subdivide(s, angle_between(axes[1:], axes[:-1]))
    if len(s) == 2:
        turn = shortest(axes[:1], axes[1:])
        rate = turn / (s[1] - s[0])
        axis = np.squeeze(exp((knots - s[0])[:, None] * rate) @ axes[0][:, None], axis=-1)
        slope = np.cross(rate, axis)
        return _axis_motion(knots, axis, slope, np.cross(rate, slope))
    curve = axis_spline(run)
    value, first, second = (curve(knots, order) for order in range(3))
    size = np.linalg.norm(value, axis=1, keepdims=True)
    axis = value / size
    # Derivatives of value / |value|.
    growth = dot(axis, first)[:, None]
    slope = (first - growth * axis) / size
    bending = dot(axis, second)[:, None] + (slope * first).sum(axis=1, keepdims=True)
    bend = (second - bending * axis - 2 * growth * slope) / size
    return _axis_motion(knots, axis, slope, bend)


def axis_spline(run: AxisRun) -> CubicSpline:
    """Return the cubic spline through the unit vectors of a run of at least three points."""
    from scipy.interpolate import CubicSpline

    if not run.periodic:
        return CubicSpline(run.s, run.axes)
    axes = np.concatenate([run.axes[:-1], run.axes[:1]])
    return CubicSpline(run.s, axes, bc_type="periodic")


def _axis_motion(
    knots: FloatArray, axis: FloatArray, slope: FloatArray, bend: FloatArray
) -> Motion:
    """Return the motion of a unit vector.

    - `knots`: arc lengths [m], (k,).
    - `axis`, `slope`, `bend`: the vector and its first and second derivative there, (k, 3) each.
    """
    return Motion(s=knots, poses=axis, rates=np.cross(axis, slope), changes=np.cross(axis, bend))


def _two_turns(motion: Motion) -> dict[str, FloatArray]:
    """Compute `first`, `second`, `f` and `g` of an `Orientation` between the knots of an axis.

    The second rotation turns from the first direction to the last, and the first rotation tilts
    out of this plane, as in `prescribed_orientation.tangent_turns`.
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
    turn_angle = np.arctan2(dot(last, tilt), dot(last, start))[:, None]
    tilt_angle = -np.arcsin(dot(last, axis).clip(-1, 1))[:, None]
    tilts = tilt, np.cos(turn_angle) * tilt - np.sin(turn_angle) * start
    rate = along_tilt_and_axis((motion.rates[:-1], motion.rates[1:]), tilts, axis)
    change = along_tilt_and_axis((motion.changes[:-1], motion.changes[1:]), tilts, axis)
    angles = np.hstack([tilt_angle, turn_angle])
    zeros = np.zeros_like(angles)
    quintics = quintic(lengths, (zeros, rate[0], change[0]), (angles, rate[1], change[1]))
    f, g = np.moveaxis(quintics, 2, 0) / lengths[:, None] ** np.arange(6)
    return {"first": tilt, "second": axis, "f": f, "g": g}


def along_tilt_and_axis(
    vectors: Sequence[FloatArray], tilts: Sequence[FloatArray], axis: FloatArray
) -> list[FloatArray]:
    """Return the components of vectors along the tilt and the axis, (k, 2) for each end.

    - `vectors`: vectors at the starts and at the ends of pieces, (k, 3) each.
    - `tilts`: unit vectors of the tilt at the starts and at the ends, (k, 3) each.
    - `axis`: unit vectors of the axes, (k, 3).
    """
    return [
        np.stack([dot(x, tilt), dot(x, axis)], axis=1)
        for x, tilt in zip(vectors, tilts, strict=True)
    ]
