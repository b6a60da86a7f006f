"""Checks of logs against the arm."""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.identification.checking import refuse_misread
from armcontour.motion import Log

# Shortest log [s], and longest sample interval [s]: between samples farther apart the
# command is not known well enough.
SHORTEST = 2.0
COARSEST = 20e-3
# Longest time of all logs together [s], for memory: derivatives take 2 kB for a time and joint.
LONGEST = 240.0
# A joint may measure a little beyond its range [rad].
BEYOND = 0.1
# A joint moves if it moves by more than this [rad].
MOVES = 1e-3
# Share of the variance of a position that a command with a lag explains, if the joint follows it.
FOLLOWS = 0.5
# Longest dead time of a joint that follows the command of another joint [s].
LONGEST_DEAD_TIME = 0.25


def arranged(log: Log, arm: Arm) -> Log:
    """The log with its joints in the order of the arm, if it names them as the arm does.

    Raises:
        InvalidInput: The log has other joints.
    """
    log.refuse_gaps()
    names, own = log.joint_names, arm.joint_names
    if log.dof != arm.dof:
        raise InvalidInput(
            f"{log.source} has {log.dof} joints ({', '.join(names)}), but the arm {arm.name} has "
            f"{arm.dof} ({', '.join(own)}): give a log of all joints, or the arm of the log."
        )
    if not set(names) & set(own):
        return log
    if other := [x for x in names if x not in own]:
        raise InvalidInput(
            f"{log.source} has a joint {other[0]}, but the joints of the arm {arm.name} are "
            f"{', '.join(own)}: give the arm of the log."
        )
    order = [names.index(x) for x in own]
    return replace(
        log, command=log.command[:, order], measured=log.measured[:, order], joint_names=own
    )


def check_logs(logs: Sequence[Log], arm: Arm) -> None:
    """Refuse logs from which the arm cannot be identified.

    Args:
        logs: Logs with as many joints as the arm.
        arm: The nominal arm.

    Raises:
        InvalidInput: A log is too short, too coarse or too long, or its positions are not those of
            the arm.
    """
    for log in logs:
        duration = float(log.t[-1] - log.t[0])
        if duration < SHORTEST:
            raise InvalidInput(
                f"{log.source} covers {duration:.3g} s, but a robot is identified only from "
                f"{SHORTEST:g} s or more: record more.",
                needed=SHORTEST,
                allowed=duration,
            )
        if log.interval > COARSEST * (1 + 1e-6):
            raise InvalidInput(
                f"{log.source} has a sample every {log.interval * 1e3:.3g} ms, but a robot is "
                f"identified only from samples every {COARSEST * 1e3:g} ms or less: record faster.",
                needed=log.interval,
                allowed=COARSEST,
            )
        _check_range(log, arm)
        _refuse_misread(log)
    total = sum(float(x.t[-1] - x.t[0]) for x in logs)
    if total > LONGEST:
        raise InvalidInput(
            f"The logs cover {total:.4g} s, but at most {LONGEST:g} s are used: choose a part, by "
            "--from and --to or Log.between.",
            needed=total,
            allowed=LONGEST,
        )


def _check_range(log: Log, arm: Arm) -> None:
    """Refuse positions that the arm cannot have.

    Raises:
        InvalidInput: A joint is outside its range.
    """
    ranges = np.stack(arm.limits.joint_range(arm.dof))
    for name in ("command", "measured"):
        values: FloatArray = getattr(log, name)
        beyond = np.maximum(ranges[0] - values, values - ranges[1])
        i, j = np.unravel_index(np.argmax(beyond), beyond.shape)
        if beyond[i, j] <= BEYOND:
            continue
        value, (low, high) = float(values[i, j]), ranges[:, j]
        scaled = np.degrees([low, high]) if math.isfinite(high - low) else [-360.0, 360.0]
        hint = (
            "its unit seems to be degrees, so give the column its unit, such as [deg]"
            if scaled[0] <= value <= scaled[1]
            else "correct the number, or give the arm of the log"
        )
        raise InvalidInput(
            f"{log.source}: the {name} position of {log.joint_names[j]} is {value:.4g} rad at "
            f"t = {log.t[i]:g} s, outside the range of {arm.name} from {low:.4g} to "
            f"{high:.4g} rad: {hint}.",
            t=float(log.t[i]),
            joint=int(j),
        )


def _refuse_misread(log: Log) -> None:
    """Refuse a log that only another order, unit or direction of its columns explains.

    Raises:
        InvalidInput: A joint moves, but does not follow its command with a lag.
    """
    for j, (command, measured) in enumerate(zip(log.command.T, log.measured.T, strict=True)):
        rate, left = np.gradient(command), measured - command
        a = np.stack([rate, np.ones_like(rate)], axis=1)
        left = left - a @ np.linalg.lstsq(a, left, rcond=None)[0]
        moves = max(np.ptp(command), np.ptp(measured)) >= MOVES
        if not moves or np.sum(left**2) < (1 - FOLLOWS) * np.sum((measured - measured.mean()) ** 2):
            continue
        refuse_misread(log, LONGEST_DEAD_TIME, j, alone=False)
