"""Logs that make no sense as they are read are refused, with what would mend them."""

from __future__ import annotations

import math

import numpy as np

from armcontour._describing import clock
from armcontour._sampling import white_noise
from armcontour.errors import InvalidInput
from armcontour.motion.log import Log
from armcontour.motion.misreading import find_misreading

# No joint of an arm is faster than this [rad/s]: the last one of a fast delta robot turns at 60.
FASTEST = 100.0
# Velocities are taken over so many samples that noise alone shows this share of it,
NOISY = 0.05
# and over no fewer than these.
FEWEST = 5


def refuse_misread(log: Log, longest: float, j: int, *, alone: bool = True) -> None:
    """Refuse a log whose joint j does not follow its command, if another reading explains it.

    Args:
        log: The log.
        longest: Largest dead time [s].
        j: The joint, from 0.
        alone: Whether to consider other units and directions of this joint alone, too.

    Raises:
        InvalidInput: Its columns are in another order, unit or direction.
    """
    every = log.t, log.measured, log.command
    found = find_misreading(*every, names=log.joint_names, late=longest)
    if alone and not found:
        one = (x[:, j : j + 1] for x in every[1:])
        found = find_misreading(log.t, *one, names=log.joint_names[j : j + 1], late=longest)
    if found:
        raise InvalidInput(
            f"{log.source}: {log.joint_names[j]} does not follow its commands: {found}.", joint=j
        )


def refuse_fast(log: Log) -> None:
    """Refuse a log in which a joint moves faster than any does.

    Raises:
        InvalidInput: It does: its times are too short.
    """
    for j, y in enumerate(log.measured.T):
        window = math.ceil(2 * white_noise(y) / (NOISY * FASTEST * log.interval))
        k = min(max(window, FEWEST), len(y) - 1)
        speeds = np.abs(y[k:] - y[:-k]) / (log.t[k:] - log.t[:-k])
        i = int(np.argmax(speeds))
        if speeds[i] > FASTEST:
            raise InvalidInput(
                f"{log.source}: {log.joint_names[j]} moves at {speeds[i]:.3g} rad/s at t = "
                f"{clock(log.t[i])} s, but no joint is faster than {FASTEST:g} rad/s: give the "
                "columns the units that they have, such as t [s].",
                joint=j,
                t=float(log.t[i]),
                needed=float(speeds[i]),
                allowed=FASTEST,
            )
