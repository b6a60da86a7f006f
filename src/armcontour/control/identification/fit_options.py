"""Options of identification: one class for servos, one for arms with masses."""

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

# Orders of the models that may be selected, by the option model.
MODELS = {"auto": ("delay", "first", "second"), "second": ("second",), "first": ("first",)}
# Gravity feed-forward of the controller: torque of the nominal arm, of the arm with its true load,
# or none.
GRAVITIES = ("nominal", "loaded", "none")
# Longest dead time of the search [s], and for arms with masses the smallest one.
LONGEST_DELAY, BELOW_ZERO = 0.25, 10e-3
# Drives that hold a torque for this time are usual [s]: 4 kHz.
DRIVE_CYCLE = 2.5e-4
# Sample intervals [s] from which a servo can be identified. No robot controller samples faster than
# 20 kHz. Below 10 Hz, the response of the loops is over between two samples.
INTERVALS = (5e-5, 0.1)


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class FitOptions(Options):
    """Options that both kinds of identification have: the base of `ServoFit` and `BodyFit`.

    Args:
        interpolation: Interpolation of set-points in the controller, "linear" or "step"; by default
            that of the log, else linear.
        longest_dead_time: Largest dead time of the search [s].
    """

    method: ClassVar[str]
    interpolation: Annotated[str, Choice(INTERPOLATIONS)] | None = None
    longest_dead_time: Interval = LONGEST_DELAY


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ServoFit(FitOptions):
    """Options of `identify`: independent servos; also those of `FitOptions`.

    >>> ac.ServoFit(model="first", longest_dead_time=0.05).model
    'first'

    Args:
        model: "second" or "first" for models of this order only, or "auto".
        drive_cycle: Time between two computations of the drives' loops, from 0.25 to 8 ms [s]; by
            default the loops are continuous.
        kinematics: The arm at whose tool the contour error is computed; by default it is computed
            in joint space.
    """

    method = "servo"
    model: Annotated[str, Choice(tuple(MODELS))] = "auto"
    drive_cycle: Annotated[float, Quantity("s", "1 ms", within=(2.5e-4, 8e-3))] | None = None
    kinematics: Arm | None = None


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class BodyFit(FitOptions):
    """Options of `identify_bodies`: an arm with masses; also those of `FitOptions`.

    >>> ac.BodyFit(gravity="nominal").drive_cycle
    0.00025

    Args:
        gravity: Gravity feed-forward of the controller: torque of the "nominal" arm, of the arm
            with its true load ("loaded"), or "none"; by default the one that the logs support.
        drive_cycle: Time for which the drives keep their torque, up to 2 ms [s]: half of it must be
            small against the time constant of a velocity loop.
    """

    method = "bodies"
    gravity: Annotated[str, Choice(GRAVITIES)] | None = None
    drive_cycle: Annotated[float, Quantity("s", "1 ms", within=(0.0, 2e-3))] = DRIVE_CYCLE


def list_logs(logs: Log | Sequence[Log]) -> tuple[Log, ...]:
    """The logs, each with a sample interval within INTERVALS."""
    every = checks.check_sequence("logs", (logs,) if isinstance(logs, Log) else logs, Log, "Logs")
    checks.raise_if(not every, "There is no log to identify from: give at least one.")
    low, high = INTERVALS
    for log in every:
        # Times are rounded.
        if not low * (1 - 1e-6) <= log.interval <= high * (1 + 1e-6):
            raise InvalidInput(
                f"{log.source} has a sample every {log.interval:.3g} s and lasts "
                f"{log.t[-1] - log.t[0]:.3g} s, but logs of robots have one every {low:g} s to "
                f"{high:g} s: give the column of times its unit, such as t [s], or record at "
                "another rate.",
                needed=log.interval,
                allowed=high if log.interval > high else low,
            )
    return every


def choose_interpolation(logs: Sequence[Log], required: str | None) -> str:
    """The interpolation of set-points: the required one, else that of the logs, else linear."""
    for log in logs:
        checks.raise_if(
            required is not None and log.interpolation not in (None, required),
            f"{log.source} states the interpolation {log.interpolation}, but {required} is required"
            ": remove one of them.",
        )
    kinds = {required or x.interpolation or "linear" for x in logs}
    if len(kinds) > 1:
        raise InvalidInput("The logs differ in their interpolation: identify them one by one.")
    return kinds.pop()


def dead_times(logs: Sequence[Log], longest: float) -> tuple[float, float]:
    """Smallest and largest dead time of the search [s]; the longest one of short logs is less."""
    duration = min(float(x.t[-1] - x.t[0]) for x in logs)
    return -min(BELOW_ZERO, duration / 50), min(longest, duration / 4)
