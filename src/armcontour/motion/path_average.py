"""Smoothing on a path: a moving average of the arc length over time."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.motion._averaging import average, whole
from armcontour.motion.joint_path import JointPath
from armcontour.motion.laws import LawAlongPath, PathLaw, join_path

# Breaks that differ by less than this fraction of the duration count as one.
SAME = 1e-13
# Steps of a search whose bracket is halved at least in every second step.
STEPS = 110


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class SmoothedLaw(LawAlongPath):
    """A law along a joint path, averaged over one time window, or over two in succession.

    The path stays the same, as s(t) is averaged and not the joints. Averaged path speeds and path
    accelerations never exceed the largest original ones; joint accelerations may, on a curved path.

    Args:
        law: The original law, from rest to rest.
        windows: Lengths of the longer window, and of the shorter window or 0 [s].

    Attributes:
        breaks: Times at which a window starts or ends at a break of the law, and at which the
            motion passes a break of the joint path [s], (n + 1,). The motion takes longer than the
            law by the sum of both windows.
        s: Arc lengths at the breaks [m], (n + 1,).
        integrals: Integrals of the original law over its intervals, see `_averaging.whole`.
    """

    law: PathLaw
    windows: tuple[float, float]
    breaks: FloatArray = field(init=False)
    s: FloatArray = field(init=False)
    integrals: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        first, second = self.windows
        object.__setattr__(self, "integrals", whole(self.law.breaks, self.law.rates))
        end = self.law.breaks[-1] + first + second
        shifts = [0.0, first] if second == 0 else [0.0, second, first, first + second]
        times = np.unique(np.concatenate([self.law.breaks + x for x in shifts]))
        times = times[np.append(True, np.diff(times) > SAME * end)]
        times[-1] = end
        way = np.maximum.accumulate(self._path(times)[:, 0])
        # The law must start and end exactly at the ends, in spite of rounding errors.
        way = np.clip(way, self.law.s[0], self.law.s[-1])
        way[0], way[-1] = self.law.s[0], self.law.s[-1]
        times, way = self._with_joints(times, way)
        object.__setattr__(self, "breaks", _checks.lock_floats(times))
        object.__setattr__(self, "s", _checks.lock_floats(way))

    @property
    def joint_path(self) -> JointPath:
        """The joint path of the law."""
        return self.law.joint_path

    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """S or a derivative at times `t`; `i` is the interval that contains each."""
        found = self._path(np.ravel(t))[:, order].reshape(np.shape(t))
        return np.clip(found, self.s[i], self.s[i + 1]) if order == 0 else found

    def path_motion(self, i: IntArray, t: FloatArray) -> FloatArray:
        """s, ds, dds and ddds at times `t`, (4, n); `i` is the interval that contains each."""
        found = self._path(np.ravel(t)).T.copy().reshape((4, *np.shape(t)))
        found[0] = np.clip(found[0], self.s[i], self.s[i + 1])
        return found

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Q or a derivative by the chain rule."""
        return join_path(self.joint_path, self.s[i + 1], self.path_motion(i, t), (order,))[0]

    def motion(self, i: IntArray, t: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """Q and its derivatives up to an order by the chain rule, (n, dof) each."""
        orders = tuple(range(order + 1))
        return join_path(self.joint_path, self.s[i + 1], self.path_motion(i, t), orders)

    def _reach_within(self, i: IntArray, s: FloatArray) -> FloatArray:
        """Times at which intervals `i` reach arc lengths inside them [s], (n,)."""
        return self._crossings(s, self.breaks[i], self.breaks[i + 1])

    def _crossings(self, s: FloatArray, low: FloatArray, high: FloatArray) -> FloatArray:
        """Times between `low` and `high` at which the averaged law is at `s` [s], (n,).

        By Newton's method; the bracket is halved if a step leaves it, and in every second step.
        """
        found, left, t = high.copy(), np.arange(len(s)), 0.5 * (low + high)
        for step in range(STEPS):
            way, speed = self._path(t)[:, :2].T
            missing = s[left] - way
            low, high = np.where(missing > 0.0, t, low), np.where(missing > 0.0, high, t)
            found[left] = high
            with np.errstate(divide="ignore", invalid="ignore"):
                new = t + missing / speed
            keeps = (low < new) & (new < high) & (speed > 0.0) & (step % 2 == 0)
            new = np.where(keeps, new, 0.5 * (low + high))
            more = (low < new) & (new < high) & (new != t)
            if not more.any():
                break
            left, low, high, t = left[more], low[more], high[more], new[more]
        return found

    def _path(self, t: FloatArray) -> FloatArray:
        """s, ds, dds and ddds of the averaged law at times `t`, (n, 4)."""
        at = np.ascontiguousarray(t, dtype=np.float64)
        law = self.law
        return average(at, law.breaks, law.s, law.rates, self.integrals, self.windows)

    def _with_joints(self, t: FloatArray, s: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Times and arc lengths of breaks, with those of the joint path's breaks added."""
        joints = self.joint_path.breaks
        joints = joints[(joints > s[0]) & (joints < s[-1])]
        k = np.searchsorted(s, joints, side="left")
        passed = self._crossings(joints, t[k - 1], t[k])
        # A break that equals one of the joint path's, up to rounding errors, is replaced by it.
        near = SAME * t[-1]
        apart = np.ones(len(t), dtype=bool)
        for side in (k - 1, k):
            apart[side[np.abs(t[side] - passed) <= near]] = False
        apart[[0, -1]] = True
        times, way = np.concatenate([t[apart], passed]), np.concatenate([s[apart], joints])
        order = np.argsort(times, kind="stable")
        return times[order], np.maximum.accumulate(way[order])
