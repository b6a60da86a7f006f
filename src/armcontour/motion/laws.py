"""Laws of motion: the pieces of which a trajectory is made, each callable in its own time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.motion.joint_path import JointPath


class Law(ABC):
    """Joint positions over time, from 0 to the last of `breaks`; smooth between two breaks."""

    breaks: FloatArray

    @abstractmethod
    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """q, dq or ddq at times `t` [s] by the formula of interval `i`, (n, dof)."""


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LapLaw(Law):
    """Laps of uniform joint acceleration between knots, (21).

    Args:
        breaks: Knot times, from 0 [s], (n + 1,).
        q: Joint positions at the knots [rad], (n + 1, dof).
        dq: Joint velocities at the start of each lap [rad/s], (n, dof).
        ddq: Joint accelerations in each lap [rad/s²], (n, dof).
    """

    breaks: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray

    def __post_init__(self) -> None:
        for name in ("breaks", "q", "dq", "ddq"):
            object.__setattr__(self, name, _checks.locked(getattr(self, name)))
        _refuse_disorder(self.breaks)

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """q, dq or ddq (21)."""
        u = (t - self.breaks[i])[..., None]
        if order == 0:
            return np.asarray(self.q[i] + u * (self.dq[i] + u * self.ddq[i] / 2))
        if order == 1:
            return np.asarray(self.dq[i] + u * self.ddq[i])
        return np.asarray(self.ddq[i])


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathLaw(Law):
    """A joint path run along with a path acceleration that is linear in s on every interval.

    Every joint between segments that lies on the way must be one of the breaks.

    Args:
        joint_path: The path.
        breaks: Interval ends, from 0 [s], (n + 1,).
        s: Arc lengths at the breaks [m], (n + 1,).
        rates: ds and dds at the start of every interval, and the slope of dds over s on it, (n, 3)
            [m/s, m/s², 1/s²].
    """

    joint_path: JointPath
    breaks: FloatArray
    s: FloatArray
    rates: FloatArray

    def __post_init__(self) -> None:
        for name in ("breaks", "s", "rates"):
            object.__setattr__(self, name, _checks.locked(getattr(self, name)))
        _refuse_disorder(self.breaks)

    @property
    def speeds(self) -> FloatArray:
        """Ds at the breaks, (n + 1,) [m/s]."""
        last = np.array([len(self.breaks) - 2])
        return np.append(self.rates[:, 0], self.path_position(last, self.breaks[-1:], 1))

    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """s, ds or dds at times `t` by the formula of interval `i`."""
        u = t - self.breaks[i]
        ds, dds, slope = self.rates[i, 0], self.rates[i, 1], self.rates[i, 2]
        # The solution of `dds = dds_i + slope (s - s_i)`: hyperbolic or circular functions.
        c, h, p = _linear_motion(slope, u)
        if order == 0:
            s = self.s[i] + ds * h + dds * p
            # Rounding must not carry s over a joint, whose two sides differ.
            return np.asarray(np.clip(s, self.s[i], self.s[i + 1]))
        return np.asarray(ds * c + dds * h if order == 1 else ds * slope * h + dds * c)

    def path_motion(self, i: IntArray, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
        """s, ds and dds at times `t` by the formula of interval `i`."""
        return self.path_position(i, t), self.path_position(i, t, 1), self.path_position(i, t, 2)

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """q, dq or ddq by the chain rule."""
        s = self.path_position(i, t)
        ds = self.path_position(i, t, 1) if order else s
        dds = self.path_position(i, t, 2) if order == 2 else s
        return path_states(self.joint_path, (self.s[i], self.s[i + 1]), s, ds, dds, order)


def path_states(
    joint_path: JointPath,
    ends: tuple[FloatArray, FloatArray],
    s: FloatArray,
    ds: FloatArray,
    dds: FloatArray,
    order: int,
) -> FloatArray:
    """q, dq or ddq along a joint path by the chain rule.

    Args:
        joint_path: The path.
        ends: Between which s each place lies: at a joint of the joint path they decide which side
            is meant.
        s: Places [m].
        ds: Their rates, if the order is 1 or 2 [m/s].
        dds: The rates of these, if the order is 2 [m/s²].
        order: 0, 1 or 2.
    """
    first = joint_path.locate(ends[0], side="right")
    last = joint_path.locate(ends[1], side="left")
    piece = np.clip(joint_path.locate(s), first, last)
    if order == 0:
        return joint_path.on_interval(piece, s)
    dq_ds = joint_path.on_interval(piece, s, 1)
    if order == 1:
        return np.asarray(dq_ds * ds[..., None])
    bend = joint_path.on_interval(piece, s, 2)
    return np.asarray(bend * ds[..., None] ** 2 + dq_ds * dds[..., None])


def _refuse_disorder(breaks: FloatArray) -> None:
    if len(breaks) < 2 or breaks[0] != 0 or not (np.diff(breaks) > 0).all():
        raise InvalidInput("The breaks of a law must start at 0 and increase.")


def interval_times(
    width: FloatArray, begin: FloatArray, end: FloatArray, slope: FloatArray
) -> FloatArray:
    """Times of intervals run with a path acceleration linear in s.

    Args:
        width: Lengths [m], (n,).
        begin: ds at the starts [m/s], (n,).
        end: ds at the ends [m/s], (n,).
        slope: Slope of dds over s [1/s²], (n,).

    Returns:
        `(2 / k) atanh(k width / (begin + end))` with `k² = slope`, (n,) [s].
    """
    simple = 2 * width / (begin + end)
    z = slope * simple**2 / 4
    series = 1 + z * (1 / 3 + z * (1 / 5 + z * (1 / 7 + z / 9)))
    small = np.abs(z) < 1e-4
    if small.all():
        return np.asarray(simple * series)
    size = np.sqrt(np.abs(z))
    with np.errstate(divide="ignore", invalid="ignore"):
        exact = np.where(z > 0, np.arctanh(size), np.arctan(size)) / size
    return np.asarray(simple * np.where(small, series, exact))


def _linear_motion(slope: FloatArray, t: FloatArray) -> tuple[FloatArray, FloatArray, FloatArray]:
    """cosh(k t), sinh(k t) / k and (cosh(k t) - 1) / k², `k² = slope`, for any sign of it."""
    z = slope * t * t
    size = np.sqrt(np.abs(z))
    half = size / 2
    safe = np.where(size < 1e-2, 1.0, size)
    c = np.where(z > 0, np.cosh(size), np.cos(size))
    h = np.where(z > 0, np.sinh(size), np.sin(size)) / safe
    p = 2 * (np.where(z > 0, np.sinh(half), np.sin(half)) / safe) ** 2
    near = size < 1e-2
    c = np.where(near, 1 + z / 2 * (1 + z / 12 * (1 + z / 30)), c)
    h = np.where(near, 1 + z / 6 * (1 + z / 20 * (1 + z / 42)), h)
    p = np.where(near, 0.5 * (1 + z / 12 * (1 + z / 30 * (1 + z / 56))), p)
    return c, t * h, t * t * p
