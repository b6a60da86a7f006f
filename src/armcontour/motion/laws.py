"""Time laws: joint positions, and for most laws the arc length, over time."""

from __future__ import annotations

from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from typing import Any, NamedTuple, Self

import numpy as np
import numpy.typing as npt

from armcontour.core import checks
from armcontour.core.checks import FloatArray, Frozen, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.guesses import ExplainedABC
from armcontour.core.quantities import Interval
from armcontour.motion.joint_path import JointPath
from armcontour.motion.kernels import (
    JointDerivatives,
    interval_times,
    joint_motions,
    path_motions,
)


class Law(Frozen, ABC, metaclass=ExplainedABC):
    """Joint positions over time, from 0 to the last break; smooth between breaks.

    Attributes:
        breaks: Times at the interval ends, from 0 [s], (n + 1,).
    """

    breaks: FloatArray

    @abstractmethod
    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Return joint positions at `t` of interval `i`, or the derivative `order`, (n, dof).

        Args:
            i: Indices of intervals, (n,).
            t: Times from 0 [s], (n,), each in its interval or at its ends.
            order: Order of the derivative, 0 (position) to 3.
        """

    def motion(self, i: IntArray, t: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """Return joint positions and derivatives up to `order` at `t` of interval `i`.

        Every array has shape (n, dof). This is faster than `on_interval` for every order.
        """
        return tuple(self.on_interval(i, t, k) for k in range(order + 1))

    def stretched(self, speed_factor: float) -> Law:
        """Return the same motion at a fraction of its speed: q(f t), with f = `speed_factor`.

        Derivatives of order k are multiplied by f^k.
        """
        return StretchedLaw(
            law=self, speed_factor=speed_factor, breaks=np.asarray(self.breaks) / speed_factor
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class StretchedLaw(Law):
    """Another law at a fraction of its speed.

    Args:
        law: The law.
        speed_factor: Ratio of its new speed to its old speed.
        breaks: Breaks of `law` divided by the speed factor [s], (n + 1,).
    """

    law: Law
    speed_factor: float
    breaks: FloatArray

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Return the joint positions or a derivative of `law`, by the chain rule, (n, dof)."""
        law_t = np.clip(t * self.speed_factor, self.law.breaks[i], self.law.breaks[i + 1])
        return np.asarray(self.speed_factor**order * self.law.on_interval(i, law_t, order))


class LawAlongPath(Law):
    """A law with a known arc length s(t), which never decreases.

    Attributes:
        s: Arc lengths at the breaks [m], (n + 1,).
    """

    s: FloatArray

    @abstractmethod
    def stretched(self, speed_factor: float) -> LawAlongPath:
        """Return the same motion along the path at the fraction `speed_factor` of its speed."""

    @abstractmethod
    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """Return the arc length at `t` [s] of interval `i`, or the derivative `order`, (n,)."""

    @abstractmethod
    def _reach_within(self, i: IntArray, s: FloatArray) -> FloatArray:
        """Return the times at which intervals `i` reach arc lengths inside them [s], (n,)."""

    def reach(self, s: FloatArray, side: str = "left") -> tuple[IntArray, FloatArray]:
        """Return the intervals and times at which the law reaches or leaves arc lengths.

        Args:
            s: Arc lengths between the start and the end of the law [m], (n,).
            side: "left" for the time at which the law reaches s, "right" for the time at which it
                leaves s.

        Returns:
            Indices of intervals, (n,), and times [s], (n,).
        """
        index = np.searchsorted(self.s, s, side=checks.check_side(side)) - 1
        i = np.clip(index, 0, len(self.breaks) - 2)
        t = self.breaks[i]
        # The times at breaks are known exactly.
        t = np.where(s >= self.s[i + 1], self.breaks[i + 1], t)
        inside = (s > self.s[i]) & (s < self.s[i + 1])
        if inside.any():
            rows = i[inside]
            times = self._reach_within(rows, s[inside])
            t[inside] = np.clip(times, self.breaks[rows], self.breaks[rows + 1])
        return i, t


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LapLaw(Law):
    """Laps of uniform joint acceleration between knots, (21).

    Args:
        breaks: Knot times, from 0 [s], (n + 1,).
        q: Joint positions at the knots [rad], (n + 1, dof).
        dq: Joint velocities at the start of each interval [rad/s], (n, dof).
        ddq: Joint accelerations in each interval [rad/s²], (n, dof).
    """

    breaks: FloatArray
    q: FloatArray
    dq: FloatArray
    ddq: FloatArray

    def _check_together(self) -> None:
        _check_breaks(self.breaks)

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Return joint positions or a derivative, (n, dof), by (21); the third derivative is 0."""
        u = (t - self.breaks[i])[..., None]
        if order == 0:
            return np.asarray(self.q[i] + u * (self.dq[i] + u * self.ddq[i] / 2))
        if order == 1:
            return np.asarray(self.dq[i] + u * self.ddq[i])
        return np.asarray(self.ddq[i] if order == 2 else np.zeros_like(self.ddq[i]))

    def stretched(self, speed_factor: float) -> Self:
        """Return the same laps at a fraction of their speed."""
        return replace(
            self,
            breaks=self.breaks / speed_factor,
            dq=self.dq * speed_factor,
            ddq=self.ddq * speed_factor**2,
        )


@checked
def dwell_law(q: FloatArray, duration: Interval) -> LapLaw:
    """Make the law of joints at rest.

    >>> rest = ac.dwell_law(np.array([0.1, 1.0]), 0.5)
    >>> ac.Trajectory(laws=(rest,), method="rest").duration
    0.5

    Args:
        q: Joint positions [rad], (dof,).
        duration: Duration of the rest [s].

    Raises:
        InvalidInput: No row of joint positions, or no duration above zero.
    """
    position = checks.shaped(
        "joint positions", checks.check_numbers("joint positions", q, "rad"), (None,)
    )
    zeros = np.zeros((1, len(position)))
    return LapLaw(
        breaks=np.array([0.0, duration]), q=np.tile(position, (2, 1)), dq=zeros, ddq=zeros
    )


class Rates(NamedTuple):
    """Path speed and path acceleration of a `PathLaw` on its n intervals.

    Args:
        ds: Path speed at the start of every interval [m/s], (n,).
        dds: Path acceleration at the start of every interval [m/s²], (n,).
        slope: Slope of dds over s on every interval [1/s²], (n,).
        jerk: Slope of dds over time [m/s³], (n,); not zero only on intervals with slope 0 in a
            motion of uniform jerk from rest or to rest.
    """

    ds: FloatArray
    dds: FloatArray
    slope: FloatArray
    jerk: FloatArray


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class PathLaw(LawAlongPath):
    """Motion along a joint path with a path acceleration that is linear in s on every interval.

    Next to a rest, the path acceleration can be linear in time instead, so it is zero at the rest.

    Every break of the joint path between the start and the end of the law must be a break of the
    law.

    Args:
        joint_path: The joint path.
        breaks: Times at the interval ends, from 0 [s], (n + 1,).
        s: Arc lengths at the breaks [m], (n + 1,).
        rates: Path speed, path acceleration and its slope in every interval.

    Raises:
        InvalidInput: The breaks do not start at 0 and increase, or the rates have wrong shapes.
    """

    joint_path: JointPath
    breaks: FloatArray
    s: FloatArray
    rates: Rates

    def _check_together(self) -> None:
        _check_breaks(self.breaks)
        n = len(self.breaks) - 1
        rates = [checks.frozen_array(x) for x in self.rates]
        if not isinstance(self.rates, Rates) or any(x.shape != (n,) for x in rates):
            raise InvalidInput(f"A path law of {n} intervals needs Rates of {n} values each.")
        object.__setattr__(self, "rates", Rates(*rates))

    @classmethod
    def from_plan(
        cls, joint_path: JointPath, breaks: FloatArray, s: FloatArray, rates: Rates
    ) -> PathLaw:
        """Make the law of a plan whose path acceleration is linear in s on every interval.

        The arrays are not checked or copied, and become read-only.

        Args:
            joint_path: The joint path.
            breaks: Increasing times at the ends of the intervals [s], from 0, (n + 1,).
            s: Arc lengths at these times [m], (n + 1,).
            rates: Derivatives of s at the starts of the intervals.
        """
        for values in rates:
            values.setflags(write=False)
        return checks.make_unchecked(cls, joint_path=joint_path, breaks=breaks, s=s, rates=rates)

    @classmethod
    def over_time(cls, joint_path: JointPath) -> PathLaw:
        """Make the law of a `joint_path` whose parameter is the time [s], from 0."""
        breaks = joint_path.breaks
        ones = np.ones(len(breaks) - 1)
        zeros = np.zeros(len(breaks) - 1)
        rates = Rates(ds=ones, dds=zeros, slope=zeros, jerk=zeros)
        return cls(joint_path=joint_path, breaks=breaks, s=breaks, rates=rates)

    @property
    def speeds(self) -> FloatArray:
        """Path speeds at the breaks [m/s], (n + 1,)."""
        last = np.array([len(self.breaks) - 2])
        return np.append(self.rates.ds, self.path_position(last, self.breaks[-1:], 1))

    @property
    def passages(self) -> FloatArray:
        """Times at which the law passes those breaks of the joint path that are not its own [s]."""
        breaks = self.joint_path.breaks
        inside = breaks[(breaks > self.s[0]) & (breaks < self.s[-1])]
        passed = inside[self.s[np.searchsorted(self.s, inside)] != inside]
        return self.reach(passed)[1] if len(passed) else passed

    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """Return the arc length or a derivative at times `t` by interval `i`'s formula, (n,)."""
        return np.asarray(self.path_motion(i, t)[order])

    def path_motion(self, i: IntArray, t: FloatArray) -> FloatArray:
        """Return s, ds, dds and ddds at times `t` by interval `i`'s formula, (4, n)."""
        shape = np.shape(t)
        intervals = flatten(i, shape, np.intp)
        motion = path_motions(intervals, flatten(t, shape), self.breaks, self.s, *self.rates)
        return np.asarray(motion.reshape(4, *shape))

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Return joint positions or a derivative by the chain rule, (n, dof)."""
        return chain_rule_motion(self.joint_path, self.s[i + 1], self.path_motion(i, t), (order,))[
            0
        ]

    def motion(self, i: IntArray, t: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """Return joint positions and derivatives up to `order` by the chain rule, (n, dof) each."""
        orders = tuple(range(order + 1))
        return chain_rule_motion(self.joint_path, self.s[i + 1], self.path_motion(i, t), orders)

    def stretched(self, speed_factor: float) -> PathLaw:
        """Return the same motion along the path at a fraction of its speed."""
        rates = Rates(
            ds=self.rates.ds * speed_factor,
            dds=self.rates.dds * speed_factor**2,
            slope=self.rates.slope * speed_factor**2,
            jerk=self.rates.jerk * speed_factor**3,
        )
        return replace(self, breaks=self.breaks / speed_factor, rates=rates)

    def _reach_within(self, i: IntArray, s: FloatArray) -> FloatArray:
        """Solve in closed form for the times at which intervals `i` reach arc lengths [s], (n,)."""
        ds, dds, slope, jerk = (x[i] for x in self.rates)
        width = s - self.s[i]
        # ds² increases by the integral of 2 dds over s, and dds is linear in s.
        end = np.sqrt(np.maximum(ds * ds + width * (2 * dds + slope * width), 0.0))
        with np.errstate(divide="ignore", invalid="ignore"):
            times = self.breaks[i] + interval_times(width, ds, end, slope)
            # With uniform jerk, an interval starts or ends at rest, and s changes with the third
            # power of the time since or until this rest.
            since_rest = dds / jerk
            jerk_times = self.breaks[i] + np.cbrt(since_rest**3 + 6 * width / jerk) - since_rest
        return np.asarray(np.where(jerk != 0, jerk_times, times))


def chain_rule_motion(
    joint_path: JointPath, end: FloatArray, along: FloatArray, orders: tuple[int, ...]
) -> tuple[FloatArray, ...]:
    """Differentiate joint positions along a joint path over time, by the chain rule.

    Returns an array (n, dof) for each order.

    Args:
        joint_path: The joint path.
        end: Arc length at which the law's interval ends, for each point [m], (n,). If a point is at
            a break of the joint path and the interval ends there, the value before the break is
            returned.
        along: s and its derivatives over time up to the third, (4, n).
        orders: Requested orders, 0 for the positions.
    """
    shape = np.shape(along)[1:]
    dof = joint_path.dof
    count = along[0].size
    motion = JointDerivatives(*(np.empty((count if k in orders else 0, dof)) for k in range(4)))
    # `joint_motions` evaluates several joint paths. Here, all points belong to path 0.
    path_indices = np.zeros(count, dtype=np.intp)
    rows = np.array([0, len(joint_path.breaks)])
    joint_motions(
        along.reshape(4, count),
        flatten(end, shape),
        path_indices,
        rows,
        joint_path.breaks,
        joint_path.coefficients,
        motion,
    )
    # Where possible, the results own their data, so that `frozen_array` does not copy them.
    return tuple(motion[k] if len(shape) == 1 else motion[k].reshape((*shape, dof)) for k in orders)


def flatten(
    values: npt.ArrayLike, shape: tuple[int, ...], dtype: npt.DTypeLike = np.float64
) -> npt.NDArray[Any]:
    """Broadcast values to a shape and `dtype`, as one read-only row for compiled functions."""
    array = np.asarray(values, dtype=dtype)
    if array.shape != shape:
        array = np.broadcast_to(array, shape)
    row = np.ascontiguousarray(array).reshape(-1)
    row.setflags(write=False)
    return row


def _check_breaks(breaks: FloatArray) -> None:
    """Raise InvalidInput unless breaks start at 0 and increase."""
    if len(breaks) < 2 or breaks[0] != 0 or not (breaks[1:] > breaks[:-1]).all():
        raise InvalidInput("The breaks of a law must start at 0 and increase.")
