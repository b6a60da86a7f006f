"""Taught data: what the controller is given."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.errors import InvalidInput
from armcontour.motion.trajectory import Trajectory

# The plan begins at a set-point if that is off by less than this part of an interval.
WHOLE = 1e-9
# Command intervals that controllers have [s]: below, times of set-points run into their rounding;
# above, nothing between two of them is told.
INTERVALS = (1e-6, 10.0)


def check_interval(period: float) -> float:
    """A command interval [s].

    Raises:
        InvalidInput: Not a number, or outside INTERVALS.
    """
    return _checks.between("command interval", period, *INTERVALS, "s")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TaughtData:
    """Joint set-points at regular times.

    Args:
        period: Command interval [s].
        q: Set-points [rad], (n, dof); the k-th holds k periods after the first, the first before
            that, the last from then on.
        trajectory: The realizable trajectory they are to bring about.
        method: Name of the compensation that made them.
        start_time: Time of the first set-point [s], not above 0: the plan's motion begins at 0, and
            a command that leads it begins before.

    Raises:
        InvalidInput: Not one finite set-point per time and joint, an interval outside
            INTERVALS, or a start after the plan's.
    """

    period: float
    q: FloatArray
    trajectory: Trajectory
    method: str
    start_time: float = 0.0

    def __post_init__(self) -> None:
        check_interval(self.period)
        values = _checks.numbers("set-points", self.q, "rad")
        if values.ndim != 2 or len(values) == 0:
            raise InvalidInput("Taught data needs at least one row of set-points, one per joint.")
        object.__setattr__(self, "q", _checks.lock_floats(values))
        start = _checks.number("start_time", self.start_time, "s")
        if start > 0:
            raise InvalidInput(
                f"start_time must not be above zero, when the plan begins, but is {start:g} s."
            )
        object.__setattr__(self, "start_time", start)

    @property
    def t(self) -> FloatArray:
        """Times of the set-points [s], (n,); 0 is when the plan begins."""
        return self.times(len(self.q), self.period)

    def times(self, count: int, step: float) -> FloatArray:
        """So many times from the first set-point on, `step` apart [s], (count,).

        They are multiples of the step, without rounding, if the first one is.

        Args:
            count: Number of times.
            step: Time between two of them [s].
        """
        number = np.arange(count, dtype=np.float64)
        before = self.start_time / step
        if abs(before - round(before)) < WHOLE:
            return np.asarray((number + round(before)) * step)
        return self.start_time + number * step
