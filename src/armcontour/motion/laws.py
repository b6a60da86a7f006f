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
    """A joint path run along with a piecewise polynomial s(t): the tool stays on the path.

    Every joint between segments that lies on the way must be one of the breaks.

    Args:
        joint_path: The path.
        breaks: Interval ends, from 0 [s], (n + 1,).
        s: Arc lengths at the breaks [m], (n + 1,).
        rates: ds, dds, ddds at the start of every interval, (n, 3) [m/s, m/s², m/s³].
    """

    joint_path: JointPath
    breaks: FloatArray
    s: FloatArray
    rates: FloatArray

    def __post_init__(self) -> None:
        for name in ("breaks", "s", "rates"):
            object.__setattr__(self, name, _checks.locked(getattr(self, name)))
        _refuse_disorder(self.breaks)

    def path_position(self, i: IntArray, t: FloatArray, order: int = 0) -> FloatArray:
        """s, ds or dds at times `t` by the formula of interval `i`."""
        u = t - self.breaks[i]
        ds, dds, ddds = self.rates[i, 0], self.rates[i, 1], self.rates[i, 2]
        if order == 0:
            s = self.s[i] + u * (ds + u * (dds / 2 + u * ddds / 6))
            # Rounding must not carry s over a joint, whose two sides differ.
            return np.asarray(np.clip(s, self.s[i], self.s[i + 1]))
        return np.asarray(ds + u * (dds + u * ddds / 2) if order == 1 else dds + u * ddds)

    def on_interval(self, i: IntArray, t: FloatArray, order: int) -> FloatArray:
        """q, dq or ddq by the chain rule."""
        s = self.path_position(i, t)
        # Side of the joint path by interval: its middle tells which piece the interval is on.
        first = self.joint_path.locate(self.s[i], side="right")
        last = self.joint_path.locate(self.s[i + 1], side="left")
        piece = np.clip(self.joint_path.locate(s), first, last)
        if order == 0:
            return self.joint_path.on_interval(piece, s)
        ds = self.path_position(i, t, 1)[..., None]
        dq_ds = self.joint_path.on_interval(piece, s, 1)
        if order == 1:
            return np.asarray(dq_ds * ds)
        dds = self.path_position(i, t, 2)[..., None]
        return np.asarray(self.joint_path.on_interval(piece, s, 2) * ds**2 + dq_ds * dds)


def _refuse_disorder(breaks: FloatArray) -> None:
    if len(breaks) < 2 or breaks[0] != 0 or not (np.diff(breaks) > 0).all():
        raise InvalidInput("The breaks of a law must start at 0 and increase.")
