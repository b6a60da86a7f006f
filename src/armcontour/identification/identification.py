"""Entry point `identify`: gains, dead time and acceleration limit of every joint from a log."""

from __future__ import annotations

import numpy as np

from armcontour import _checks
from armcontour._progress import Progress, Step, under
from armcontour.errors import InvalidInput
from armcontour.identification.choosing import choose
from armcontour.identification.correlation import find_period
from armcontour.identification.describing import described, nothing, why_still
from armcontour.identification.fitting import Data
from armcontour.identification.results import Identification, JointIdentification
from armcontour.motion.log import INTERPOLATIONS, Log

MODELS = ("auto", "second", "first")
# Range of the search for dead times [s]: up to LONGEST_DELAY, and down to BELOW_ZERO below zero, so
# that noise around a dead time of zero is not cut off on one side.
LONGEST_DELAY = 0.25
BELOW_ZERO = 10e-3
# Sample intervals [s] from which a servo can be identified. No controller samples faster than
# 1 MHz. Below 10 Hz the response to the gains happens between two samples.
INTERVALS = (1e-6, 0.1)


def identify(
    log: Log,
    *,
    model: str = "auto",
    interpolation: str | None = None,
    longest_dead_time: float = LONGEST_DELAY,
    progress: Progress | None = None,
) -> Identification:
    """Identify gains, dead time and acceleration limit of every joint from a log.

    The model of a joint is `ddq = sat(K_v (K_p (u(t - dead time) - q) - dq))`, or the lag
    `dq = K_p (u(t - dead time) - q)`. The model is simulated exactly from the set-points. The
    estimates minimize the sum of squared residuals.

    Args:
        log: The log, with set-points and measured positions.
        model: "second", "first", or "auto", which takes the lag unless the log supports the second
            order.
        interpolation: Interpolation of set-points in the controller, "linear" or "step"; by default
            that of the log, else linear.
        longest_dead_time: Largest dead time of the search [s].
        progress: Called with a step, the name of a joint, before each joint.

    Raises:
        InvalidInput: An unknown option, samples too far apart, or a log in which command and
            measurement cannot belong together.
    """
    _checks.choice("model", model, MODELS)
    between = _choose_interpolation(log, interpolation)
    longest = _checks.positive("longest dead time", longest_dead_time, "s")
    _refuse_interval(log)
    duration = float(log.t[-1] - log.t[0])
    delays = (-min(BELOW_ZERO, duration / 50), min(longest, duration / 4))
    tell, joints = under(progress), []
    for j in range(log.dof):
        tell(Step((log.joint_names[j],)))
        joints.append(_identify_joint(log, j, model, between == "linear", delays))
    return Identification(log=log, interpolation=between, joints=tuple(joints))


def _choose_interpolation(log: Log, interpolation: str | None) -> str:
    """Choose the interpolation of set-points: as given, else that of the log, else linear.

    Raises:
        InvalidInput: An unknown interpolation, or another one than in the log.
    """
    if interpolation is not None:
        _checks.choice("interpolation", interpolation, INTERPOLATIONS)
        if log.interpolation not in (None, interpolation):
            raise InvalidInput(
                f"{log.source} says that its interpolation is {log.interpolation}, but "
                f"{interpolation} is required: leave one of them out."
            )
    return interpolation or log.interpolation or "linear"


def _refuse_interval(log: Log) -> None:
    """Refuse a log with a sample interval outside INTERVALS.

    Raises:
        InvalidInput: The interval is too short or too long.
    """
    low, high = INTERVALS
    # Times are rounded.
    if not low * (1 - 1e-6) <= log.interval <= high * (1 + 1e-6):
        raise InvalidInput(
            f"{log.source} has a sample every {log.interval:.3g} s, but a servo can be told only "
            f"from samples every {low:g} s to {high:g} s: record at another rate, or give the "
            "column of times its unit, such as t [ms].",
            needed=log.interval,
            allowed=high if log.interval > high else low,
        )


def _identify_joint(
    log: Log, j: int, model: str, linear: bool, delays: tuple[float, float]
) -> JointIdentification:
    """Identify the joint j (from 0), with dead times in the range `delays` [s].

    Raises:
        InvalidInput: Command and measurement cannot belong together.
    """
    name = log.joint_names[j]
    command = np.ascontiguousarray(log.command[:, j])
    data = Data(
        t=np.ascontiguousarray(log.t - log.t[0]),
        u=command,
        y=np.ascontiguousarray(log.measured[:, j]),
        linear=linear,
        delays=delays,
        period=find_period(command),
    )
    still = why_still(data)
    if still:
        return nothing(data, log, name, still)
    try:
        choice = choose(data, model)
    except InvalidInput as error:
        raise InvalidInput(f"{log.source}, {name}: the log {error}", joint=j + 1) from None
    return described(data, log, name, choice)
