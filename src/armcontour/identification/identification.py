"""Entry point `identify`: gains, dead time and acceleration limit of every joint from a log."""

from __future__ import annotations

import numpy as np

from armcontour import _checks
from armcontour._progress import Progress, Step, under
from armcontour.errors import InvalidInput
from armcontour.identification.choosing import choose
from armcontour.identification.describing import described, nothing, why_still
from armcontour.identification.fitting import Data
from armcontour.identification.log import INTERPOLATIONS, Log
from armcontour.identification.results import Identification, JointIdentification

MODELS = ("auto", "second", "first")
# Dead times up to this [s] are looked for, and down to this far below zero [s]: so that noise about
# a dead time of zero is not cut off on one side.
LONGEST_DELAY = 0.25
BELOW_ZERO = 10e-3
# Times between samples [s] from which a servo can be told. Faster than 1 MHz no controller samples.
# Slower than 10 Hz, all that the gains decide happens between two samples.
INTERVALS = (1e-6, 0.1)


def identify(
    log: Log,
    *,
    model: str = "auto",
    interpolation: str | None = None,
    longest_dead_time: float = LONGEST_DELAY,
    progress: Progress | None = None,
) -> Identification:
    """Gains, dead time and acceleration limit of every joint, from what it was told and did.

    The model of a joint is `ddq = sat(K_v (K_p (u(t - dead time) - q) - dq))`, or the lag
    `dq = K_p (u(t - dead time) - q)`. It is simulated exactly from the set-points; the estimates
    make the squares of the residuals least.

    Args:
        log: The log.
        model: "second", "first", or "auto", which takes the lag where the log does not speak for
            more.
        interpolation: What the controller does between set-points, "linear" or "step"; by default
            as the log says, else linear.
        longest_dead_time: Dead times are looked for up to this [s].
        progress: Called with a step, the name of a joint, before each joint.

    Raises:
        InvalidInput: An unknown option, samples too far apart, or a log in which command and
            measurement cannot belong together.
    """
    _checks.choice("model", model, MODELS)
    between = _between(log, interpolation)
    longest = _checks.positive("longest dead time", longest_dead_time, "s")
    _refuse_interval(log)
    duration = float(log.t[-1] - log.t[0])
    delays = (-min(BELOW_ZERO, duration / 50), min(longest, duration / 4))
    tell, joints = under(progress), []
    for j in range(log.dof):
        tell(Step((log.joint_names[j],)))
        joints.append(_joint(log, j, model, between == "linear", delays))
    return Identification(log=log, interpolation=between, joints=tuple(joints))


def _between(log: Log, interpolation: str | None) -> str:
    """What the controller does between set-points.

    Raises:
        InvalidInput: An unknown word, or not what the log says.
    """
    if interpolation is not None:
        _checks.choice("interpolation", interpolation, INTERPOLATIONS)
        if log.interpolation not in (None, interpolation):
            raise InvalidInput(
                f"{log.source} says that its interpolation is {log.interpolation}, but "
                f"{interpolation} was asked for: leave one of them out."
            )
    return interpolation or log.interpolation or "linear"


def _refuse_interval(log: Log) -> None:
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


def _joint(
    log: Log, j: int, model: str, linear: bool, delays: tuple[float, float]
) -> JointIdentification:
    name = log.joint_names[j]
    data = Data(
        t=np.ascontiguousarray(log.t - log.t[0]),
        u=np.ascontiguousarray(log.command[:, j]),
        y=np.ascontiguousarray(log.measured[:, j]),
        linear=linear,
        delays=delays,
    )
    still = why_still(data)
    if still:
        return nothing(data, log, name, still)
    try:
        choice = choose(data, model)
    except InvalidInput as error:
        raise InvalidInput(f"{log.source}, {name}: the log {error}", joint=j + 1) from None
    return described(data, log, name, choice)
