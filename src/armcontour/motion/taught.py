"""Taught data: the joint set-points that the controller receives."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray, Value
from armcontour._describing import brief, joint_rows, line_up, milliseconds, several
from armcontour.errors import InvalidInput
from armcontour.motion.trajectory import Trajectory

# The start of the plan counts as a set-point's time if they differ by less than this fraction of a
# command interval.
WHOLE = 1e-9
# Smallest and largest command interval [s]: shorter ones come near rounding errors of times; longer
# ones say nothing about the motion between set-points.
INTERVALS = (1e-6, 10.0)
# No controller takes set-points more slowly [s]; industrial ones take them every 1 to 40 ms.
LONGEST_CLOCK = 0.1


def check_interval(period: float) -> float:
    """A checked command interval [s].

    Raises:
        InvalidInput: The interval is not a number, or outside INTERVALS.
    """
    return _checks.between("command interval", period, *INTERVALS, "s")


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class TaughtData(Value):
    """Joint set-points at regular times.

    Args:
        period: Command interval [s].
        q: Set-points [rad], (n, dof); set-point k is due k periods after the first. Before the
            first and after the last set-point the command is constant.
        trajectory: The realizable trajectory that the joints should follow.
        method: Name of the compensation method that made the set-points.
        start_time: Time of the first set-point [s], not above 0. The planned motion starts at 0;
            set-points with a time advance start before.
        cut_off: Bound of each joint's error after the planned motion because the transient of its
            set-points is cut off [rad], (dof,); None if it is not.

    Raises:
        InvalidInput: The set-points are not finite numbers, (n, dof), the interval is outside
            INTERVALS, or the start time is above 0.
    """

    period: float
    q: FloatArray
    trajectory: Trajectory
    method: str
    start_time: float = 0.0
    cut_off: FloatArray | None = None

    def __post_init__(self) -> None:
        _checks.refuse_other("Taught data", self.trajectory, Trajectory, "as plan gives it")
        check_interval(self.period)
        values = _checks.numbers("set-points", self.q, "rad")
        if values.ndim != 2 or len(values) == 0:
            raise InvalidInput("Taught data needs at least one row of set-points, one per joint.")
        object.__setattr__(self, "q", _checks.lock_floats(values))
        start = _checks.number("start_time", self.start_time, "s")
        if start > 0:
            raise InvalidInput(
                f"start_time must not be above zero, when the plan starts, but is {start:g} s."
            )
        object.__setattr__(self, "start_time", start)
        if self.cut_off is not None:
            object.__setattr__(self, "cut_off", _checks.lock_floats(self.cut_off))

    def __str__(self) -> str:
        """Number and interval of the set-points, and where the joints are sent."""
        return line_up(self._title("Taught data"), self._rows)

    __repr__ = brief

    def _title(self, what: str) -> str:
        """What it is, with the number of set-points."""
        return f"{what}: {several(len(self.q), 'set-point')} every {milliseconds(self.period)}"

    @property
    def _rows(self) -> list[tuple[str, str]]:
        """Method, times and joint positions as names and values."""
        first, last = self.start_time, self.start_time + (len(self.q) - 1) * self.period
        return [
            ("compensation", self.method),
            ("times", f"{first:.4f} to {last:.4f} s"),
            ("plan", f"{self.trajectory.duration:.4f} s"),
            *joint_rows(self.q),
        ]

    @property
    def t(self) -> FloatArray:
        """Times of the set-points [s], (n,); the planned motion starts at 0."""
        return self.times(len(self.q), self.period)

    def times(self, count: int, step: float) -> FloatArray:
        """Regular times from the first set-point on [s], (count,).

        If the first time is a multiple of the step, all times are, without rounding errors.

        Args:
            count: Number of times.
            step: Time between two times [s].
        """
        number = np.arange(count, dtype=np.float64)
        before = self.start_time / step
        if abs(before - round(before)) < WHOLE:
            return np.asarray((number + round(before)) * step)
        return self.start_time + number * step
