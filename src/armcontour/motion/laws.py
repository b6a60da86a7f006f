"""Laws of motion: the pieces of which a trajectory is made, each callable in its own time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.motion.joint_path import JointPath

# Halvings of a lap's time that find when a place is reached, to the last digit.
HALVINGS = 50


class Law(ABC):
    """Joint positions over time, from 0 to the last of `breaks`; smooth between two breaks."""

    breaks: FloatArray

    @abstractmethod
    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """q, dq or ddq at times `t` [s] by the formula of interval `i`, (n, dof)."""


class LawAlongPath(Law):
    """A law that knows its arc length s(t), which never falls.

    Attributes:
        s: Arc lengths at the breaks [m], (n + 1,).
    """

    s: FloatArray

    @abstractmethod
    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """s, ds or dds at times `t` [s] by the formula of interval `i`, (n,)."""

    @abstractmethod
    def _reach_within(self, i: IntArray, s: FloatArray) -> FloatArray:
        """Times at which interval `i` reaches arc lengths that lie inside it, (n,) [s]."""

    def reach(self, s: FloatArray, side: str = "left") -> tuple[IntArray, FloatArray]:
        """Intervals and times at which the law reaches arc lengths from its start to its end.

        Args:
            s: Arc lengths [m], (n,).
            side: "left" for when the law gets there, "right" for when the law goes on from there.

        Returns:
            Intervals (n,) and times (n,) [s].
        """
        found = np.searchsorted(self.s, s, side=_checks.side(side)) - 1
        i = np.clip(found, 0, len(self.breaks) - 2)
        t = self.breaks[i]
        # The times of breaks are known without a formula, and exactly.
        t = np.where(s >= self.s[i + 1], self.breaks[i + 1], t)
        inside = (s > self.s[i]) & (s < self.s[i + 1])
        if inside.any():
            at = i[inside]
            times = self._reach_within(at, s[inside])
            t[inside] = np.clip(times, self.breaks[at], self.breaks[at + 1])
        return i, t


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
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))
        _refuse_disorder(self.breaks)

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """q, dq or ddq (21)."""
        u = (t - self.breaks[i])[..., None]
        if order == 0:
            return np.asarray(self.q[i] + u * (self.dq[i] + u * self.ddq[i] / 2))
        if order == 1:
            return np.asarray(self.dq[i] + u * self.ddq[i])
        return np.asarray(self.ddq[i])


def stand_still(q: FloatArray, duration: float) -> LapLaw:
    """The law of joints that stand still.

    Args:
        q: Where they stand [rad], (dof,).
        duration: For so long [s].
    """
    rest = np.zeros((1, len(q)))
    return LapLaw(breaks=np.array([0.0, duration]), q=np.tile(q, (2, 1)), dq=rest, ddq=rest)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LineLaw(LapLaw, LawAlongPath):
    """Laps along a straight line of the tool path: s is how far along the line the tool is.

    Between knots uniform joint accelerations leave the line a little; s is then the arc length of
    the nearest point of the line.

    Args:
        arm: The arm, whose tool follows the line.
        ends: Arc lengths at the first and the last knot [m].
        point: Point of the line at the first of them [m], (dimension,).
        direction: Unit vector along the line, (dimension,).
    """

    arm: Arm
    ends: tuple[float, float]
    point: FloatArray
    direction: FloatArray
    s: FloatArray = field(init=False)

    def __post_init__(self) -> None:
        # `super` without arguments does not work in a dataclass with slots.
        LapLaw.__post_init__(self)
        for name in ("point", "direction"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))
        # A traced path has its knots on the line but for rounding.
        s = np.maximum.accumulate(np.clip(self._along(self.q), *self.ends))
        s[0], s[-1] = self.ends
        object.__setattr__(self, "s", _checks.lock_floats(s))

    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """s, ds or dds: the tool's position, velocity or acceleration along the line."""
        q = self.on_interval(i, t, 0)
        if order == 0:
            return np.clip(self._along(q), self.s[i], self.s[i + 1])
        dq = self.on_interval(i, t, 1)
        if order == 1:
            return np.asarray(self.arm.tool_velocity(q, dq) @ self.direction)
        found = self.arm.tool_acceleration(q, dq, self.on_interval(i, t, 2))
        return np.asarray(found @ self.direction)

    def _reach_within(self, i: IntArray, s: FloatArray) -> FloatArray:
        low, high = self.breaks[i], self.breaks[i + 1]
        for _ in range(HALVINGS):
            middle = (low + high) / 2
            short = self._along(self.on_interval(i, middle, 0)) < s
            low, high = np.where(short, middle, low), np.where(short, high, middle)
        return high

    def _along(self, q: FloatArray) -> FloatArray:
        """Arc lengths of the line's points nearest to the tool, (n,) [m]."""
        return np.asarray(self.ends[0] + (self.arm.forward(q) - self.point) @ self.direction)


class Rates(NamedTuple):
    """How intervals of a `PathLaw` begin, and how their path acceleration changes.

    Args:
        ds: Path speed at the start of every interval [m/s], (n,).
        dds: Path acceleration there [m/s²], (n,).
        slope: Slope of dds over s on the interval [1/s²], (n,).
    """

    ds: FloatArray
    dds: FloatArray
    slope: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathLaw(LawAlongPath):
    """A joint path run along with a path acceleration that is linear in s on every interval.

    Every joint between segments that lies on the way must be one of the breaks.

    Args:
        joint_path: The path.
        breaks: Interval ends, from 0 [s], (n + 1,).
        s: Arc lengths at the breaks [m], (n + 1,).
        rates: Path speed and path acceleration at the start of every interval, and the slope of the
            acceleration over s.

    Raises:
        InvalidInput: Breaks that do not start at 0 and increase, or rates that do not fit.
    """

    joint_path: JointPath
    breaks: FloatArray
    s: FloatArray
    rates: Rates

    def __post_init__(self) -> None:
        for name in ("breaks", "s"):
            object.__setattr__(self, name, _checks.lock_floats(getattr(self, name)))
        _refuse_disorder(self.breaks)
        n = len(self.breaks) - 1
        if not isinstance(self.rates, Rates) or any(np.shape(x) != (n,) for x in self.rates):
            raise InvalidInput(f"A path law of {n} intervals needs Rates of {n} values each.")
        object.__setattr__(self, "rates", Rates(*(_checks.lock_floats(x) for x in self.rates)))

    @property
    def speeds(self) -> FloatArray:
        """Ds at the breaks, (n + 1,) [m/s]."""
        last = np.array([len(self.breaks) - 2])
        return np.append(self.rates.ds, self.path_position(last, self.breaks[-1:], 1))

    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """s, ds or dds at times `t` by the formula of interval `i`."""
        u = t - self.breaks[i]
        ds, dds, slope = (x[i] for x in self.rates)
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

    def _reach_within(self, i: IntArray, s: FloatArray) -> FloatArray:
        ds, dds, slope = (x[i] for x in self.rates)
        width = s - self.s[i]
        # ds² grows by the integral of 2 dds over s, in which dds is linear.
        end = np.sqrt(np.maximum(ds * ds + width * (2 * dds + slope * width), 0.0))
        return np.asarray(self.breaks[i] + interval_times(width, ds, end, slope))


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
