"""Bounds of what a motion along a joint path takes of limits, at all times."""

from __future__ import annotations

from typing import TypeAlias

import numpy as np
from numpy.polynomial.polynomial import polyval

from armcontour.core.checks import FloatArray, IntArray
from armcontour.motion.laws import PathLaw

# Intervals are halved so often at most. What is not below its limit then counts with its bound.
HALVINGS = 40

# A function and its derivatives at some places, each (n,) or (dof, n).
Derivatives: TypeAlias = list[FloatArray]


def largest_shares(
    law: PathLaw, limits: FloatArray, speeds: FloatArray, allowed: float
) -> FloatArray:
    """The largest shares of limits that a law takes: of joints' limits, and of path speeds.

    A share that is at most `allowed` is proven for all times of the law, but for the rounding of
    numbers: an interval whose bound is above it is halved. A larger one is that of a place, or a
    bound.

    Args:
        law: The law.
        limits: Lower and upper bounds of acceleration [rad/s²] and of velocity [rad/s] of every
            joint, infinite without one, (4, dof).
        speeds: Two highest path speeds on every interval of the joint path [m/s], (m, 2).
        allowed: The share that is to be proven.

    Returns:
        Of these four and of both path speeds, (6,).
    """
    i = np.arange(len(law.breaks) - 1)
    begin, end = law.breaks[:-1], law.breaks[1:]
    largest = np.zeros(6)
    for _ in range(HALVINGS):
        middle = (begin + end) / 2
        shares = _shares(law, i, (begin, middle, end), limits, speeds)
        here, bound = shares[:, :6], shares[:, 6:]
        largest = np.maximum(largest, here.max(axis=0))
        unknown = ((bound > allowed) & (here <= allowed)).any(axis=1)
        if not unknown.any():
            break
        highest = np.maximum(largest, bound[unknown].max(axis=0))
        i = np.tile(i[unknown], 2)
        begin = np.concatenate([begin[unknown], middle[unknown]])
        end = np.concatenate([middle[unknown], end[unknown]])
    else:
        return np.asarray(highest)
    return np.asarray(largest)


def _shares(
    law: PathLaw,
    i: IntArray,
    t: tuple[FloatArray, FloatArray, FloatArray],
    limits: FloatArray,
    speeds: FloatArray,
) -> FloatArray:
    """Shares of limits in the middle of parts of intervals, and bounds of them on these parts.

    A joint's velocity and acceleration, and the path speed, are quadratics about the middle, plus
    the most that their third derivative can add.

    Args:
        law: The law.
        i: Intervals, (n,).
        t: Begin, middle and end of a part of each [s], (n,) each.
        limits: As in `largest_shares`.
        speeds: As in `largest_shares`.

    Returns:
        The largest shares of the limits of all joints and of both path speeds in the middle, then
        the bounds of the six, (n, 12).
    """
    path, (begin, middle, end) = law.joint_path, t
    half = np.maximum(middle - begin, end - middle)
    v = [*law.path_motion(i, middle)[:3], *path_rates(law, i, middle, half)]
    most = _bound(v, half)
    # No break of the joint path lies within an interval of a law.
    first = path.locate(law.s[i], side="right")
    piece = np.clip(path.locate(v[0]), first, path.locate(law.s[i + 1], side="left"))
    width = np.diff(path.breaks)[piece]
    x, coefficients = (v[0] - path.breaks[piece]) / width, path.coefficients[piece]
    # Of all joints, (dof, n): rows of many numbers are fast.
    c, q = np.ascontiguousarray(np.moveaxis(coefficients, 0, -1)), []
    for _ in range(6):
        q.append(polyval(x, c, tensor=False))
        c = np.arange(1, len(c))[:, None, None] * c[1:] / width
    far, cube = _bound(q, half * most[1]), half**3 / 6
    ds, dds = q[1] * v[1], q[2] * v[1] ** 2 + q[1] * v[2]
    ddds = q[3] * v[1] ** 3 + 3 * q[2] * v[1] * v[2] + q[1] * v[3]
    fourth, more, rest = _fourth(q, v), _fifth(far, most) * cube, _fourth(far, most) * cube
    values, ends = [], []
    for f, left in (([dds, ddds, fourth], more), ([ds, dds, ddds], rest)):
        for sign in (-1, 1):
            values.append(f[0])
            ends.append(sign * (_highest([sign * x for x in f], half) + left))
    joints = [
        x / y for x, y in zip(values + ends, np.tile(limits, (2, 1))[:, :, None], strict=True)
    ]
    here, bounds = np.maximum([x.max(axis=0) for x in joints], 0.0).reshape(2, 4, -1)
    along, highest = _highest(v[1:4], half) + most[4] * cube, speeds[piece].T
    return np.concatenate([here, v[1] / highest, bounds, along / highest]).T


def path_rates(law: PathLaw, i: IntArray, t: FloatArray, half: FloatArray) -> Derivatives:
    """The third and the fourth derivative of a law's arc length, and a bound of the fifth one.

    Args:
        law: The law.
        i: Intervals, (n,).
        t: Times in them [s], (n,).
        half: The bound is valid so long before and after each of the times [s], (n,).
    """
    ds, dds, ddds = law.path_motion(i, t)[1:]
    slope = law.rates.slope[i]
    # ds is a sum of cosh and sinh, or of cos and sin, whose bounds are smaller.
    root = np.sqrt(np.abs(slope))
    with np.errstate(invalid="ignore"):
        growth = np.where(root > 0, np.sinh(root * half) / root, half)
    highest_speed = np.abs(ds) * np.cosh(root * half) + np.abs(dds) * growth
    return [ddds, slope * dds, slope**2 * highest_speed]


def _bound(values: Derivatives, reach: FloatArray) -> Derivatives:
    """The function, and bounds of its derivatives within `reach`, by Taylor's polynomial."""
    n = len(values)
    own, powers = [np.abs(x) for x in values], [np.ones_like(reach)]
    for k in range(1, n):
        powers.append(powers[-1] * reach / k)
    bounds = [sum(own[m] * powers[m - k] for m in range(k, n)) for k in range(1, n)]
    return [values[0], *map(np.asarray, bounds)]


def _highest(f: Derivatives, half: FloatArray) -> FloatArray:
    """The largest values of f0 + f1 u + f2 u² / 2 for u from -half to half."""
    f0, f1, f2 = f
    ends = f0 + np.abs(f1) * half + f2 * half**2 / 2
    with np.errstate(divide="ignore", invalid="ignore"):
        return np.where((f2 < 0) & (np.abs(f1) < -f2 * half), f0 - f1**2 / (2 * f2), ends)


def _fifth(q: Derivatives, v: Derivatives) -> FloatArray:
    """The fifth derivative of q(s(t)), from those of q over s and of s over time."""
    return np.asarray(
        q[5] * v[1] ** 5
        + 10 * q[4] * v[1] ** 3 * v[2]
        + q[3] * (10 * v[1] ** 2 * v[3] + 15 * v[1] * v[2] ** 2)
        + q[2] * (10 * v[2] * v[3] + 5 * v[1] * v[4])
        + q[1] * v[5]
    )


def _fourth(q: Derivatives, v: Derivatives) -> FloatArray:
    """The fourth derivative of q(s(t))."""
    return np.asarray(
        q[4] * v[1] ** 4
        + 6 * q[3] * v[1] ** 2 * v[2]
        + q[2] * (3 * v[2] ** 2 + 4 * v[1] * v[3])
        + q[1] * v[4]
    )
