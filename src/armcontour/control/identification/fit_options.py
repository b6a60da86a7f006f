"""Options of identification, and checks of its logs."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Annotated, ClassVar

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Options
from armcontour.core.quantities import Choice, Interval, Quantity
from armcontour.motion.log import INTERPOLATIONS, Log
from armcontour.robot import Arm

# Orders of the candidate models for each value of the option `model`.
MODELS = {"auto": ("delay", "first", "second"), "second": ("second",), "first": ("first",)}
# Shortest and longest sample interval for identification [s]. No robot controller samples faster
# than 20 kHz. Below 10 Hz, the loops settle between two samples.
INTERVALS = (5e-5, 0.1)


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ServoFit(Options):
    """Options of `identify` for independent joint servos.

    >>> ac.ServoFit(model="first", longest_dead_time=0.05).model
    'first'

    Args:
        interpolation: Interpolation of set-points in the controller, "linear" or "step"; by default
            as stated in the log, otherwise linear.
        longest_dead_time: Longest dead time of the search [s].
        model: "second" or "first" allows only models of this order, "auto" allows all models.
        drive_cycle: Time between two computations of the drives' loops, from 0.25 to 8 ms [s]; by
            default the loops are continuous.
        kinematics: The arm whose tool is used for the contour error; by default the contour error
            is computed in joint space.
    """

    method: ClassVar[str] = "servo"
    interpolation: Annotated[str, Choice(INTERPOLATIONS)] | None = None
    longest_dead_time: Interval = 0.25
    model: Annotated[str, Choice(tuple(MODELS))] = "auto"
    drive_cycle: Annotated[float, Quantity("s", "1 ms", within=(2.5e-4, 8e-3))] | None = None
    kinematics: Arm | None = None


def list_logs(logs: Log | Sequence[Log]) -> tuple[Log, ...]:
    """The logs as a tuple; raises an error if a sample interval is outside INTERVALS."""
    every = checks.check_sequence("logs", (logs,) if isinstance(logs, Log) else logs, Log, "Logs")
    checks.raise_if(not every, "The identification requires at least one log, but logs is empty.")
    low, high = INTERVALS
    for log in every:
        # The factors allow for rounded times.
        if not low * (1 - 1e-6) <= log.interval <= high * (1 + 1e-6):
            raise InvalidInput(
                f"{log.source} has a sample every {log.interval:.3g} s and lasts "
                f"{log.t[-1] - log.t[0]:.3g} s, but the sample interval must be from {low:g} to "
                f"{high:g} s. Specify the unit of the column of times, such as t [s], or record at "
                "another rate.",
                needed=log.interval,
                allowed=high if log.interval > high else low,
            )
    return every


def choose_interpolation(logs: Sequence[Log], required: str | None) -> str:
    """Interpolation of set-points: as required, otherwise as the logs state, otherwise linear."""
    for log in logs:
        checks.raise_if(
            required is not None and log.interpolation not in (None, required),
            f"{log.source} states the interpolation {log.interpolation}, but the option "
            f"interpolation is {required}. Remove one of the two.",
        )
    kinds = {required or x.interpolation or "linear" for x in logs}
    if len(kinds) > 1:
        raise InvalidInput(
            "All logs must have the same interpolation of set-points, but they state different "
            "ones. Identify each log separately."
        )
    return kinds.pop()
