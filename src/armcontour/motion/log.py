"""A recorded motion: commanded and measured positions of each joint."""

from __future__ import annotations

import math
from dataclasses import field, replace
from itertools import product
from typing import Annotated, Any

import numpy as np

from armcontour.core import checks
from armcontour.core.checks import BoolArray, FloatArray, IntArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, declared
from armcontour.core.quantities import Axes, Choice, Name, Quantity
from armcontour.core.text import clock, short_repr, show
from armcontour.motion.log_checks import GAP, check_samples, refuse_wrapped

# Interpolation of the command between two samples of a log.
INTERPOLATIONS = ("linear", "step")
POSITIONS = ("command", "measured")
# Smallest number of samples; fewer samples cannot separate four parameters and the noise.
FEWEST = 50


@declared(eq=False)
class Log(Checked):
    """Set-points and measured positions of joints at the same times.

    A log may have gaps, as from lost packets, in which the commands are unknown.

    >>> t = np.arange(250) * 4e-3
    >>> ac.Log(t=t, command=np.sin(t)[:, None], measured=np.sin(t - 0.01)[:, None]).dof
    1

    Args:
        t: Times [s], increasing, (n,).
        command: Set-points [rad], (n, dof).
        measured: Measured positions [rad], (n, dof).
        joint_names: One per joint; "joint 1", ... by default.
        interpolation: Interpolation of the controller between set-points, "linear" or "step"; None
            if unknown.
        source: Origin of the log, for messages.
        notes: Notes of a reader on recognised and ignored parts of the file.

    Raises:
        InvalidInput: Times do not increase or are too near to each other, angles wrap, or there are
            too few samples.
    """

    t: Annotated[FloatArray, Quantity("s"), Axes("n")] = field(kw_only=False)
    command: Annotated[FloatArray, Quantity("rad"), Axes(...)] = field(kw_only=False)
    measured: Annotated[FloatArray, Quantity("rad"), Axes(...)]
    joint_names: tuple[Name, ...] = ()
    interpolation: Annotated[str, Choice(INTERPOLATIONS)] | None = None
    source: str = "the log"
    notes: tuple[str, ...] = ()

    def _check_together(self) -> None:
        if len(self.t) < FEWEST:
            raise InvalidInput(
                f"{self.source} has {len(self.t)} samples, but at least {FEWEST} are needed. "
                "Record a longer motion."
            )
        for name in POSITIONS:
            object.__setattr__(self, name, self._check_rows(name))
        dof = self.dof
        if self.measured.shape[1] != dof:
            raise InvalidInput(
                f"{self.source} has commands for {dof} joints, but measured positions of "
                f"{self.measured.shape[1]} joints. Both need the same joints."
            )
        names = self.joint_names or tuple(f"joint {j + 1}" for j in range(dof))
        if len(names) != dof or len(set(names)) != dof:
            raise InvalidInput(
                f"{self.source} needs {dof} different joint names, not {', '.join(names)}."
            )
        object.__setattr__(self, "joint_names", names)
        check_samples(self.t, {x: getattr(self, x) for x in POSITIONS}, self._name_value)
        for j, name in product(range(dof), POSITIONS):
            position = f"{self.source}: the {name} position of {names[j]}"
            refuse_wrapped(position, self.t, getattr(self, name)[:, j], j)

    __repr__ = short_repr

    @property
    def dof(self) -> int:
        """Number of joints."""
        return int(self.command.shape[1])

    @property
    def interval(self) -> float:
        """The usual time between two samples [s]."""
        return float(np.median(np.diff(self.t)))

    @property
    def gaps(self) -> IntArray:
        """Indices of the samples after which there is a gap, (gaps,)."""
        return np.flatnonzero(np.diff(self.t) > GAP * self.interval)

    def between(self, start: float = -math.inf, end: float = math.inf) -> Log:
        """The part of the log from `start` to `end` [s].

        Args:
            start: First time to keep [s].
            end: Last time to keep [s].
        """
        mask = _time_mask(self.t, start, end, self.source)
        return replace(
            self, t=self.t[mask], command=self.command[mask], measured=self.measured[mask]
        )

    def _check_rows(self, name: str) -> FloatArray:
        """Positions as a read-only array, (n, dof); raise InvalidInput for another shape."""
        values = getattr(self, name)
        values = values[:, None] if values.ndim == 1 else values
        if values.ndim != 2 or len(values) != len(self.t) or values.shape[1] == 0:
            raise InvalidInput(
                f"{self.source}: {name} has shape {values.shape}, but must have one row for "
                f"each of the {len(self.t)} times and one column per joint."
            )
        return checks.frozen_array(np.ascontiguousarray(values))

    def _name_value(self, name: str, i: int, j: int) -> str:
        """Name of a time or a position for messages."""
        if name == "t":
            return f"{self.source}: the time of sample {i + 1}"
        moment = f"at t = {clock(self.t[i])} s"
        return f"{self.source}: the {name} position of {self.joint_names[j]} {moment}"


def cut_log(
    t: FloatArray,  # Times [s]
    command: FloatArray,  # Set-points [rad]
    measured: FloatArray,  # Measured positions [rad]
    window: tuple[float, float],  # First and last time to use [s]
    *,
    source: str = "the log",
    **fields: Any,
) -> Log:
    """Make a log from a part of arrays; the complete arrays need not be a valid log."""
    # `fields`: other fields of `Log`.
    used = _time_mask(t, *window, source)
    command, measured = np.asarray(command)[used], np.asarray(measured)[used]
    return Log(t=np.asarray(t)[used], command=command, measured=measured, source=source, **fields)


def _time_mask(t: FloatArray, start: float, end: float, source: str) -> BoolArray:
    """Mask of the samples from `start` to `end`, (n,); raise InvalidInput if there are none."""
    for name, value in (("first", start), ("last", end)):
        if not isinstance(value, int | float | np.number):
            raise InvalidInput(
                f"The {name} time of {source} must be a number in s, not {show(value)}."
            )
        # NaN fails the comparison; NumPy cannot compare larger integers.
        if not abs(value) <= (checks.LARGEST if isinstance(value, int) else math.inf):
            raise InvalidInput(
                f"The {name} time to use must be a number of seconds, not {show(value)}."
            )
    used = (np.asarray(t) >= start) & (np.asarray(t) <= end)
    if len(t) and not used.any():
        raise InvalidInput(
            f"{source} has no sample from {start:g} s to {end:g} s. Its times are from "
            f"{clock(np.min(t))} s to {clock(np.max(t))} s."
        )
    return np.asarray(used)
