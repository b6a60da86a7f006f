"""Smoothing in the joints: a moving average of joint positions over time, near the same path."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, IntArray
from armcontour.motion.joint_path import JointPath
from armcontour.motion.laws import LawAlongPath, PathLaw
from armcontour.motion.path_average import SmoothedLaw

# Nodes and weights of Gauss quadrature over an interval from 0 to 1: exact for powers up to 5.
_X, _W = np.polynomial.legendre.leggauss(3)
NODES, WEIGHTS = (_X + 1) / 2, _W / 2


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class JointAverage(LawAlongPath):
    """A law whose joint positions are averaged over a time window.

    Joint velocities and accelerations are averages, too: never above the largest original ones,
    however the path bends. The tool leaves the path a little: for a window W and a tool
    acceleration a, by about a W² / 24. Its place is where the law whose s(t) is averaged is then.

    Args:
        law: The original law, from rest to rest: along the path, or averaged once already.
        window: Length of the window [s].
        way: The original law along the path with s(t) averaged over all windows so far.

    Attributes:
        breaks: Times of the breaks of `way` [s], (n + 1,).
        s: Its arc lengths there [m], (n + 1,).
        integrals: Integrals of the original positions up to its breaks [rad s], (m, dof).
    """

    law: PathLaw | JointAverage
    window: float
    way: SmoothedLaw
    breaks: FloatArray = field(init=False)
    s: FloatArray = field(init=False)
    integrals: FloatArray = field(init=False, repr=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "breaks", self.way.breaks)
        object.__setattr__(self, "s", self.way.s)
        i = np.arange(len(self.law.breaks) - 1)
        parts = self._integrate(i, self.law.breaks[1:])
        found = np.concatenate([np.zeros((1, parts.shape[1])), np.cumsum(parts, axis=0)])
        object.__setattr__(self, "integrals", _checks.lock_floats(found))

    @property
    def joint_path(self) -> JointPath:
        """The joint path of the law."""
        return self.law.joint_path

    @property
    def original(self) -> PathLaw:
        """The law that nothing was averaged of."""
        return self.law.original if isinstance(self.law, JointAverage) else self.law

    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """S or a derivative at times `t`; `i` is the interval that contains each."""
        return self.way.path_position(i, t, order)

    def path_motion(self, i: IntArray, t: FloatArray) -> FloatArray:
        """s, ds, dds and ddds at times `t`, (4, n); `i` is the interval that contains each."""
        return self.way.path_motion(i, t)

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """Q or a derivative: differences over the window of what is one order below."""
        return self._changes(t, (order,))[0]

    def motion(self, i: IntArray, t: FloatArray, order: int = 2) -> tuple[FloatArray, ...]:
        """Q and its derivatives up to an order, (n, dof) each."""
        return self._changes(t, tuple(range(order + 1)))

    def _changes(self, t: FloatArray, orders: tuple[int, ...]) -> tuple[FloatArray, ...]:
        """Differences over the window of what is one order below, for each of some orders."""
        end, shape = np.ravel(t), (*np.shape(t), -1)
        below = tuple(x - 1 for x in orders)
        late, early = self._original(end, below), self._original(end - self.window, below)
        return tuple(
            ((a - b) / self.window).reshape(shape) for a, b in zip(late, early, strict=True)
        )

    def _reach_within(self, i: IntArray, s: FloatArray) -> FloatArray:
        """Times at which intervals `i` reach arc lengths inside them [s], (n,)."""
        return self.way._reach_within(i, s)

    def _original(self, t: FloatArray, orders: tuple[int, ...]) -> tuple[FloatArray, ...]:
        """Integral (order -1), q, dq or ddq of the original law, which rests at both ends.

        The integral is that of positions from time 0 on.
        """
        law = self.law
        at = np.clip(t, 0.0, law.breaks[-1])
        i = np.clip(np.searchsorted(law.breaks, at, side="right") - 1, 0, len(law.breaks) - 2)
        states = law.motion(i, at, max(orders[-1], 0))
        inside = (at == t)[:, None]
        found = []
        for order in orders:
            if order < 0:
                resting = states[0] * (t - at)[:, None]
                found.append(self.integrals[i] + self._integrate(i, at) + resting)
            else:
                found.append(np.where(inside, states[order], 0.0) if order else states[0])
        return tuple(found)

    def _integrate(self, i: IntArray, t: FloatArray) -> FloatArray:
        """Integrals of the original positions from starts of intervals `i` to times t [rad s]."""
        begin = self.law.breaks[i]
        width = t - begin
        places = begin[:, None] + width[:, None] * NODES
        q = self.law.on_interval(np.repeat(i, len(NODES)), places.ravel(), 0)
        means = np.einsum("nkj,k->nj", q.reshape(len(i), len(NODES), -1), WEIGHTS)
        return np.asarray(means * width[:, None])


def average_joints(law: PathLaw, windows: tuple[float, float]) -> JointAverage:
    """A law with its joint positions averaged over one window, or over two in succession.

    Args:
        law: The law, from rest to rest.
        windows: Lengths of the longer window, and of the shorter window or 0 [s].
    """
    first, second = windows
    way = SmoothedLaw(law=law, windows=(first, 0.0))
    once = JointAverage(law=law, window=first, way=way)
    if second == 0:
        return once
    return JointAverage(law=once, window=second, way=SmoothedLaw(law=law, windows=windows))
