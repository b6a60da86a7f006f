"""Logs that do not fit an arm are refused, with what would mend them."""

from __future__ import annotations

import math
from collections.abc import Sequence

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.identification.checking import refuse_fast, refuse_misread
from armcontour.identification.choosing import FOLLOWS
from armcontour.motion import Log

# Shortest log [s], and longest sample interval [s]: between samples farther apart, nobody knows the
# command well enough.
SHORTEST = 2.0
COARSEST = 20e-3
# Longest time of all logs together [s], for memory: derivatives take 2 kB for a time and joint.
LONGEST = 240.0
# A joint may measure a little beyond its range [rad].
BEYOND = 0.1
# A joint moves if it moves by more than this [rad].
MOVES = 1e-3
# Dead time up to which joints are looked at for whether they follow other commands [s].
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
    if set(names) != set(own):
        other = next(x for x in names if x not in own)
        raise InvalidInput(
            f"{log.source} has a joint {other}, but the joints of the arm {arm.name} are "
            f"{', '.join(own)}: give the arm of the log."
        )
    order = [names.index(x) for x in own]
    return Log(
        t=log.t,
        command=log.command[:, order],
        measured=log.measured[:, order],
        joint_names=own,
        interpolation=log.interpolation,
        source=log.source,
    )


def check_logs(logs: Sequence[Log], arm: Arm) -> None:
    """Refuse logs from which the arm cannot be told.

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
                f"{log.source} covers {duration:.3g} s, but a robot can be told only from "
                f"{SHORTEST:g} s or more: record more.",
                needed=SHORTEST,
                allowed=duration,
            )
        if log.interval > COARSEST * (1 + 1e-6):
            raise InvalidInput(
                f"{log.source} has a sample every {log.interval * 1e3:.3g} ms, but a robot can be "
                f"told only from samples every {COARSEST * 1e3:g} ms or less: record faster.",
                needed=log.interval,
                allowed=COARSEST,
            )
        _check_range(log, arm)
        refuse_fast(log)
        for j in range(log.dof):
            if not _follows(log, j):
                refuse_misread(log, LONGEST_DEAD_TIME, j)
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
    for name in ("command", "measured"):
        values: FloatArray = getattr(log, name)
        for j, (low, high) in enumerate(np.stack(arm.limits.joint_range(arm.dof), axis=1)):
            own = values[:, j]
            i = int(np.argmax(np.maximum(low - own, own - high)))
            if low - BEYOND <= own[i] <= high + BEYOND:
                continue
            scaled = np.degrees([low, high]) if math.isfinite(high - low) else [-360.0, 360.0]
            hint = (
                "its unit seems to be degrees, so give the column its unit, such as [deg]"
                if scaled[0] <= own[i] <= scaled[1]
                else "mend the number, or give the arm of the log"
            )
            raise InvalidInput(
                f"{log.source}: the {name} position of {log.joint_names[j]} is {own[i]:.4g} rad at "
                f"t = {log.t[i]:g} s, outside the range of {arm.name} from {low:.4g} to "
                f"{high:.4g} rad: {hint}.",
                t=float(log.t[i]),
                joint=j + 1,
            )


def _follows(log: Log, j: int) -> bool:
    """Whether a joint follows its command, if it moves at all."""
    command, measured = log.command[:, j], log.measured[:, j]
    if max(np.ptp(command), np.ptp(measured)) < MOVES:
        return True
    return _left(command, measured) < 1 - FOLLOWS


def _left(command: FloatArray, measured: FloatArray) -> float:
    """Share of the variance of the measured position that its command, late, leaves over."""
    own = measured - measured.mean()
    power = max(float(own @ own), 1e-300)
    rate = np.gradient(command)
    a = np.stack([rate, np.ones_like(rate)], axis=1)
    left = measured - command
    left = left - a @ np.linalg.lstsq(a, left, rcond=None)[0]
    return float(left @ left) / power
