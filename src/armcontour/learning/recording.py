"""`Recording`: what the joints did in a run, from an execution or a log."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._describing import brief, joint_rows, line_up, several
from armcontour.errors import InvalidInput
from armcontour.motion import Execution, Log, TaughtData

# Set-points of an execution differ from the taught ones by less than this [rad].
SAME = 1e-9


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Recording:
    """Measured joint positions over time.

    Args:
        t: Times [s], increasing, (n,).
        q: Measured joint positions [rad], (n, dof).
        command: Set-points at the same times [rad], (n, dof), by which the clock is found; None if
            they were not recorded.
        in_plan_time: Whether `t` counts from the start of the plan, without error.
        exact: Whether `q` are the true positions of a simulation, without measurement noise.
        source: Where it comes from, for messages.

    Raises:
        InvalidInput: The arrays are not finite numbers, or do not fit each other.
    """

    t: FloatArray
    q: FloatArray
    command: FloatArray | None = None
    in_plan_time: bool = False
    exact: bool = False
    source: str = "the log"

    def __post_init__(self) -> None:
        t = _checks.numbers(f"{self.source}: t", self.t, "s")
        if t.ndim != 1 or len(t) < 2 or (np.diff(t) <= 0).any():
            raise InvalidInput(f"{self.source} needs at least two times, which must increase.")
        object.__setattr__(self, "t", _checks.lock_floats(t))
        for name in ("q", "command"):
            if getattr(self, name) is None:
                continue
            values = _checks.numbers(f"{self.source}: {name}", getattr(self, name), "rad")
            if values.ndim != 2 or len(values) != len(t):
                raise InvalidInput(
                    f"{self.source}: {name} has shape {values.shape}, but must have one row for "
                    f"each of the {len(t)} times."
                )
            object.__setattr__(self, name, _checks.lock_floats(values))

    def __str__(self) -> str:
        """Where it comes from, its times, and where the joints were."""
        times = f"t = {self.t[0]:.4f} to {self.t[-1]:.4f} s"
        return line_up(
            f"Recording: {several(len(self.t), 'sample')}, {times}",
            [
                ("source", self.source),
                ("clock", "that of the plan" if self.in_plan_time else "its own"),
                ("set-points", "not recorded" if self.command is None else "recorded"),
                *joint_rows(self.q),
            ],
        )

    __repr__ = brief

    @property
    def interval(self) -> float:
        """The usual time between two samples [s]."""
        return float(np.median(np.diff(self.t)))


def record(executed: Execution | Log | Recording, taught: TaughtData) -> Recording:
    """What the joints did.

    Args:
        executed: An execution of the set-points, a log of the robot, or a recording.
        taught: The set-points.

    Raises:
        InvalidInput: It is something else, of another number of joints, or of other set-points.
    """
    if isinstance(executed, Execution):
        own = executed.taught
        same = own.q.shape == taught.q.shape and own.period == taught.period
        if not same or np.abs(own.q - taught.q).max() > SAME:
            raise InvalidInput(
                "The execution is one of other set-points: give the taught data that was executed."
            )
        found = Recording(
            t=executed.t + taught.start_time - own.start_time,
            # Encoders of drives see the motors.
            q=executed.q if executed.motor_q is None else executed.motor_q,
            in_plan_time=True,
            exact=True,
            source="the execution",
        )
    elif isinstance(executed, Log):
        executed.refuse_gaps()
        found = Recording(
            t=executed.t, q=executed.measured, command=executed.command, source=executed.source
        )
    elif isinstance(executed, Recording):
        found = executed
    else:
        raise InvalidInput(
            f"learn needs an Execution, a Log or a Recording, not {type(executed).__name__}."
        )
    if found.q.shape[1] != taught.q.shape[1]:
        raise InvalidInput(
            f"{found.source} has {found.q.shape[1]} joints, but the taught data has "
            f"{taught.q.shape[1]}: give the log of this job."
        )
    return found
