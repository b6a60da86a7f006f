"""Proven bounds on velocity, acceleration and path speed along a joint path."""

from __future__ import annotations

from collections.abc import Iterable, Iterator
from functools import singledispatch
from typing import TypeAlias

import numpy as np
from numpy.polynomial.polynomial import polyval

from armcontour.core.checks import FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.motion import kernels
from armcontour.motion.execution import Execution
from armcontour.motion.joint_path import JointPath
from armcontour.motion.laws import LapLaw, Law, PathLaw
from armcontour.motion.trajectory import Trajectory

# Relative allowance of the bounds for rounding.
BOUND_ROUNDING = 1e-12
# How often an interval is halved at most. If the limit is then still not proven, the result is the
# interval's bound.
MAX_BOUND_HALVINGS = 40
# A function and its derivatives at n points, each (n,) or (dof, n).
Derivatives: TypeAlias = list[FloatArray]


def joint_travel(motion: Trajectory | Execution | JointPath) -> tuple[FloatArray, FloatArray]:
    """Return times [s], (n,), and upper bounds of each joint's travel until them [rad], (n, dof).

    Motion in both directions adds to the travel. The bound is linear between the times. A joint
    moves at most by the increase of the bound between any two times. Between the samples of an
    executed motion, accelerations are assumed to be at most the largest demand or sampled
    acceleration.

    Args:
        motion: A planned or executed motion, or a joint path, for which arc length replaces time.
    """
    # Bounds of the joint velocities in the intervals of each part of the motion [rad/s].
    velocity_bounds: Iterable[FloatArray]
    if isinstance(motion, Execution):
        t = motion.t
        dof = motion.q.shape[1]
        speeds = np.abs(motion.dq)
        speed_gain = largest_accelerations(motion) * (np.diff(t)[:, None] / 2)
        velocity_bounds = [np.maximum(speeds[:-1], speeds[1:]) + speed_gain]
    elif isinstance(motion, JointPath):
        t = motion.breaks
        dof = motion.dof
        velocity_bounds = [_bound_along(motion, t, np.ones(len(t) - 1))]
    else:
        laws = zip(motion.starts, motion.laws, strict=False)
        law_breaks = [start + law.breaks[:-1] for start, law in laws]
        t = np.append(np.concatenate(law_breaks), motion.starts[-1])
        dof = motion.dof
        velocity_bounds = map(bound_joint_velocities, motion.laws)
    # A single array saves memory, because a long motion has millions of intervals.
    travel = np.zeros((len(t), dof))
    row = 1
    for bounds in velocity_bounds:
        travel[row : row + len(bounds)] = bounds
        row += len(bounds)
    travel[1:] *= np.diff(t)[:, None] * (1 + BOUND_ROUNDING)
    np.cumsum(travel, axis=0, out=travel)
    return t, travel


def travel_in_parts(
    motion: Trajectory | Execution | JointPath, size: int
) -> Iterator[tuple[FloatArray, FloatArray]]:
    """Yield the parts of a motion with `size` intervals each, as `joint_travel`.

    The parts of a long trajectory need little memory, because only one exists at a time.

    Yields the times of a part [s], (n + 1,), and bounds of the travel since its start, (n + 1,
    dof).
    """
    if not isinstance(motion, Trajectory):
        t, travel = joint_travel(motion)
        for first in range(0, len(t) - 1, size):
            part = slice(first, first + size + 1)
            yield t[part], travel[part] - travel[first]
        return
    # Breaks and bounds of the velocities in the intervals after them, of laws that are not in a
    # part yet.
    breaks = list[FloatArray]()
    bounds = list[FloatArray]()
    count = 0
    for start, law in zip(motion.starts, motion.laws, strict=False):
        breaks.append(start + law.breaks[:-1])
        bounds.append(bound_joint_velocities(law))
        count += len(bounds[-1])
        # The end of the last interval of a part is the next break.
        while count > size:
            t = np.concatenate(breaks)
            speeds = np.concatenate(bounds)
            yield t[: size + 1], _add_up(t[: size + 1], speeds[:size])
            breaks = [t[size:]]
            bounds = [speeds[size:]]
            count -= size
    t = np.append(np.concatenate(breaks), motion.starts[-1])
    yield t, _add_up(t, np.concatenate(bounds))


def _add_up(t: FloatArray, speeds: FloatArray) -> FloatArray:
    """Add up the travel in intervals, (n + 1, dof), from bounds of the speeds, (n, dof)."""
    travel = np.zeros((len(t), speeds.shape[1]))
    np.multiply(speeds, np.diff(t)[:, None] * (1 + BOUND_ROUNDING), out=travel[1:])
    return np.cumsum(travel, axis=0, out=travel)


def largest_accelerations(motion: Execution) -> FloatArray:
    """Bound the joint accelerations of an executed motion [rad/s²], (dof,)."""
    demanded = np.abs(motion.demand_range).max(axis=0)
    sampled = np.abs(motion.ddq).max(axis=0)
    return np.asarray(np.maximum(demanded, sampled))


@singledispatch
def bound_joint_velocities(law: Law) -> FloatArray:
    """Bound the joint velocities in every interval of a law [rad/s], (n, dof)."""
    raise InvalidInput(
        f"The joint velocities of a law of the kind {type(law).__name__} have no known bound. Use "
        "the law of a plan."
    )


@bound_joint_velocities.register
def _(law: LapLaw) -> FloatArray:
    """Bound a `LapLaw`, whose velocities are linear between breaks."""
    end = law.dq + law.ddq * np.diff(law.breaks)[:, None]
    return np.asarray(np.maximum(np.abs(law.dq), np.abs(end)))


@bound_joint_velocities.register
def _(law: PathLaw) -> FloatArray:
    """Bound a `PathLaw` by the product of the bounds on dq_ds and ds."""
    return _bound_along(law.joint_path, law.s, _bound_path_speeds(law))


def _bound_path_speeds(law: PathLaw) -> FloatArray:
    """Bound the path speed in every interval [m/s], (n,).

    ds² is a parabola over s, or, with jerk, ds is a parabola over time. A parabola that opens
    downwards is below its peak, where the path acceleration is 0, and below its tangent at the
    start. The peak may be far behind the end of the interval, and the tangent is steep before a
    near peak.
    """
    ds, dds, slope, jerk = law.rates
    speeds = law.speeds
    with np.errstate(divide="ignore", invalid="ignore"):
        squared_peak = np.where(slope < 0, ds**2 - dds**2 / slope, 0.0)
        peak_over_time = ds - dds**2 / (2 * jerk)
    squared_tangent = ds**2 + 2 * np.maximum(dds, 0.0) * np.diff(law.s)
    over_s = np.sqrt(np.minimum(squared_peak, squared_tangent))
    over_time = np.minimum(peak_over_time, ds + dds * np.diff(law.breaks))
    inside = np.where(jerk < 0, over_time, over_s)
    return np.maximum(np.maximum(speeds[:-1], speeds[1:]), np.where(dds > 0, inside, 0.0))


def _bound_along(joint_path: JointPath, s: FloatArray, speeds: FloatArray) -> FloatArray:
    """Bound the joint velocities between neighbouring arc lengths [rad/s], (n, dof)."""
    return np.asarray(
        kernels.bound_joint_velocities(joint_path.breaks, joint_path.coefficients, s, speeds)
    )


def largest_shares(
    law: PathLaw, limits: FloatArray, speeds: FloatArray, allowed: float
) -> FloatArray:
    """Return the largest ratios of a whole law to its joint and path speed limits, (6,).

    A result of at most `allowed` is proven for all times of the law, up to rounding errors, because
    intervals whose bound exceeds `allowed` are halved. A larger result is the ratio at a point, or
    a bound.

    The result has the ratios to the four limits of joints, then to both path speeds.

    Args:
        law: The law.
        limits: Each joint's lower and upper acceleration [rad/s²] and velocity [rad/s] bounds,
            infinite without one, (4, dof).
        speeds: Two highest path speeds in every interval of the joint path [m/s], (m, 2).
        allowed: Largest allowed ratio, such as 1.
    """
    i = np.arange(len(law.breaks) - 1)
    begin = law.breaks[:-1]
    end = law.breaks[1:]
    largest = np.zeros(6)
    for _ in range(MAX_BOUND_HALVINGS):
        middle = (begin + end) / 2
        ratios = _ratios_and_bounds(law, i, (begin, middle, end), limits, speeds)
        at_middle = ratios[:, :6]
        bounds = ratios[:, 6:]
        largest = np.maximum(largest, at_middle.max(axis=0))
        unproven = ((bounds > allowed) & (at_middle <= allowed)).any(axis=1)
        if not unproven.any():
            break
        largest_bound = np.maximum(largest, bounds[unproven].max(axis=0))
        i = np.tile(i[unproven], 2)
        begin = np.concatenate([begin[unproven], middle[unproven]])
        end = np.concatenate([middle[unproven], end[unproven]])
    else:
        return np.asarray(largest_bound)
    return np.asarray(largest)


def _ratios_and_bounds(
    law: PathLaw,
    i: IntArray,
    t: tuple[FloatArray, FloatArray, FloatArray],
    limits: FloatArray,
    speeds: FloatArray,
) -> FloatArray:
    """Return the ratios of `largest_shares` on n interval parts, (n, 12).

    The first six columns are the ratios at the middle of each part, the others are bounds of these
    ratios on the part. Joint velocity, joint acceleration and path speed are bounded by quadratics
    about the middle, plus the third-order terms. In this function, `v` contains s and its
    derivatives over time, and `q` the joint positions and their derivatives over s.

    - `i`: interval of each part, (n,).
    - `t`: start, middle and end of each part [s], (n,) each.
    """
    path = law.joint_path
    begin, middle, end = t
    half = np.maximum(middle - begin, end - middle)
    v = [*law.path_motion(i, middle)[:3], *path_rates(law, i, middle, half)]
    path_bounds = _bound_derivatives(v, half)
    # The intervals of `law` must not contain breaks of the joint path, as in optimal plans.
    first = path.locate(law.s[i], side="right")
    piece = np.clip(path.locate(v[0]), first, path.locate(law.s[i + 1], side="left"))
    q = _derivatives_along(path, piece, v[0])
    joint_bounds = _bound_derivatives(q, half * path_bounds[1])
    cube = half**3 / 6
    ds = q[1] * v[1]
    dds = q[2] * v[1] ** 2 + q[1] * v[2]
    ddds = q[3] * v[1] ** 3 + 3 * q[2] * v[1] * v[2] + q[1] * v[3]
    fourth = _fourth_derivative(q, v)
    acceleration_margin = _fifth_derivative(joint_bounds, path_bounds) * cube
    velocity_margin = _fourth_derivative(joint_bounds, path_bounds) * cube
    values = []
    ends = []
    for f, margin in (
        ([dds, ddds, fourth], acceleration_margin),
        ([ds, dds, ddds], velocity_margin),
    ):
        for sign in (-1, 1):
            values.append(f[0])
            ends.append(sign * (_bound_quadratics([sign * x for x in f], half) + margin))
    joints = [
        x / y for x, y in zip(values + ends, np.tile(limits, (2, 1))[:, :, None], strict=True)
    ]
    at_middle, bounds = np.maximum([x.max(axis=0) for x in joints], 0.0).reshape(2, 4, -1)
    along = _bound_quadratics(v[1:4], half) + path_bounds[4] * cube
    highest = speeds[piece].T
    return np.concatenate([at_middle, v[1] / highest, bounds, along / highest]).T


def _derivatives_along(path: JointPath, piece: IntArray, s: FloatArray) -> Derivatives:
    """Return the joint positions and their five derivatives by arc length, (dof, n) each.

    - `piece`: interval of the joint path for each arc length, (n,).
    - `s`: arc lengths [m], (n,).
    """
    width = np.diff(path.breaks)[piece]
    x = (s - path.breaks[piece]) / width
    # Arrays of shape (dof, n) for all joints, because long rows are fast.
    coefficients = np.ascontiguousarray(np.moveaxis(path.coefficients[piece], 0, -1))
    derivatives: Derivatives = []
    for _ in range(6):
        values = polyval(x, coefficients, tensor=False)
        derivatives.append(np.asarray(values, dtype=np.float64))
        degrees = np.arange(1, len(coefficients))[:, None, None]
        coefficients = degrees * coefficients[1:] / width
    return derivatives


def path_rates(law: PathLaw, i: IntArray, t: FloatArray, half: FloatArray) -> Derivatives:
    """Return the third and fourth time derivatives of a law's arc length, and bound the fifth.

    Args:
        law: The law.
        i: Indices of intervals, (n,).
        t: Times in the intervals [s], (n,).
        half: The bound is valid from t - half to t + half [s], (n,).
    """
    ds, dds, ddds = law.path_motion(i, t)[1:]
    slope = law.rates.slope[i]
    # ds is a sum of cosh and sinh if `slope` is positive, and of cos and sin if it is negative. The
    # bound for cosh and sinh is valid for both.
    root = np.sqrt(np.abs(slope))
    with np.errstate(invalid="ignore"):
        growth = np.where(root > 0, np.sinh(root * half) / root, half)
    highest_speed = np.abs(ds) * np.cosh(root * half) + np.abs(dds) * growth
    return [ddds, slope * dds, slope**2 * highest_speed]


def _bound_derivatives(values: Derivatives, reach: FloatArray) -> Derivatives:
    """Return the function, and bound its derivatives within `reach` by Taylor polynomials."""
    n = len(values)
    magnitudes = [np.abs(x) for x in values]
    powers = [np.ones_like(reach)]
    for k in range(1, n):
        powers.append(powers[-1] * reach / k)
    bounds = [sum(magnitudes[m] * powers[m - k] for m in range(k, n)) for k in range(1, n)]
    return [values[0], *map(np.asarray, bounds)]


def _bound_quadratics(f: Derivatives, half: FloatArray) -> FloatArray:
    """Bound `f0 + f1 u + f2 u² / 2` for u from -half to half, shaped like f0."""
    f0, f1, f2 = f
    ends = f0 + np.abs(f1) * half + f2 * half**2 / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((f2 < 0) & (np.abs(f1) < -f2 * half), f0 - f1**2 / (2 * f2), ends)


def _fifth_derivative(q: Derivatives, v: Derivatives) -> FloatArray:
    """Return the fifth time derivative of q(s(t)) from derivatives `q` of q(s), `v` of s(t)."""
    return np.asarray(
        q[5] * v[1] ** 5
        + 10 * q[4] * v[1] ** 3 * v[2]
        + q[3] * (10 * v[1] ** 2 * v[3] + 15 * v[1] * v[2] ** 2)
        + q[2] * (10 * v[2] * v[3] + 5 * v[1] * v[4])
        + q[1] * v[5]
    )


def _fourth_derivative(q: Derivatives, v: Derivatives) -> FloatArray:
    """Return the fourth time derivative of q(s(t)) from derivatives `q` of q(s), `v` of s(t)."""
    return np.asarray(
        q[4] * v[1] ** 4
        + 6 * q[3] * v[1] ** 2 * v[2]
        + q[2] * (3 * v[2] ** 2 + 4 * v[1] * v[3])
        + q[1] * v[4]
    )
