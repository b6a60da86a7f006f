"""Command intervals and gains that are possible, but probably mistaken: in sentences."""

from __future__ import annotations

import numpy as np

from armcontour._text import list_some
from armcontour.errors import InvalidInput
from armcontour.motion import LONGEST_CLOCK
from armcontour.servo import ServoModel

# A joint of less damping swings past its set-points by more than 30 % of a step. Drives of robots
# have 0.5 and more, most of them 1; with exchanged gains it is a quarter of one over that.
LEAST_DAMPING = 0.35
# Durations are sums with rounding errors: an interval that is longer by this share is as long.
SAME = 1e-9
# So many joints are named in one sentence.
MOST_NAMES = 4


def refuse_long_interval(period: float, duration: float) -> None:
    """Refuse a command interval that leaves no set-point within the motion.

    Args:
        period: The command interval [s].
        duration: Duration of the motion [s].

    Raises:
        InvalidInput: It is longer than the motion, and than that of any controller.
    """
    if period > max(duration * (1 + SAME), LONGEST_CLOCK):
        raise InvalidInput(
            f"The command interval of {period:g} s is longer than the motion of {duration:.6g} s, "
            f"so that no set-point lies within it; it is in seconds: {in_milliseconds(period)}.",
            needed=period,
            allowed=max(duration, LONGEST_CLOCK),
        )


def doubt_interval(period: float) -> list[str]:
    """A sentence on a command interval that no controller has, or none.

    Args:
        period: The command interval [s].
    """
    if period <= LONGEST_CLOCK:
        return []
    return [
        f"the command interval of {period:g} s is longer than that of any controller; it is in "
        f"seconds: {in_milliseconds(period)}."
    ]


def in_milliseconds(period: float) -> str:
    """How to write a command interval that was given in ms by mistake [s]."""
    return f"for {period:g} ms give {period / 1e3:g}, in a job `command_interval: {period:g} ms`"


def doubt_gains(servo: ServoModel) -> list[str]:
    """A sentence on the joints whose servo is hardly damped, or none.

    Args:
        servo: The servo, with gains per joint or one for all.
    """
    if servo.kv is None:
        return []
    kp, kv = (np.atleast_1d(x) for x in np.broadcast_arrays(servo.kp, servo.kv))
    damping = np.sqrt(kv / kp) / 2
    weak = np.flatnonzero(damping < LEAST_DAMPING)
    if not len(weak):
        return []
    j = int(np.argmin(damping))
    least = float(damping[j])
    past = np.exp(-np.pi * least / np.sqrt(1 - least**2))
    every = len(weak) == len(damping)
    of = "" if every else f" of {list_some([f'joint {k + 1}' for k in weak], MOST_NAMES)}"
    return [
        f"the servo{of} has kp = {kp[j]:g} 1/s and kv = {kv[j]:g} 1/s, which is a damping "
        f"√(kv / kp) / 2 of {least:.2g}: it swings past a step by {past * 100:.0f} % of it. Drives "
        "of robots have 0.5 or more: see whether kp and kv are exchanged."
    ]
