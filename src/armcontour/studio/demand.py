"""Which shares of their limits joints use."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour.arms import Arm, Limits
from armcontour.arms.limit_use import use_of
from armcontour.motion import Trajectory
from armcontour.studio.thinning import evenly, thin
from armcontour.studio.view import short

# Largest number of breaks that are looked at, and about that of times that are drawn because of
# what happens there, besides those that are spread evenly.
MOST_BREAKS, MOST_TIMES = 2_000, 1_000


def demand_of(trajectory: Trajectory, arm: Arm, limits: Limits) -> dict[str, Any]:
    """Arrays of joint positions over time, and of the shares of limits that joints use.

    Args:
        trajectory: The motion.
        arm: The arm.
        limits: The limits.
    """
    breaks = trajectory.breaks
    if len(breaks) > MOST_BREAKS:
        breaks = breaks[np.linspace(0, len(breaks) - 1, MOST_BREAKS).astype(np.intp)]
    # The arm is played on straight lines between these, and few breaks are in a rapid.
    even = evenly(trajectory.duration)
    # Accelerations jump: both sides of every break, the one before it first.
    t = np.concatenate([breaks[1:], breaks[:-1], even])
    order = np.argsort(t, kind="stable")
    sides = trajectory.motion(breaks[1:], side="left"), trajectory.motion(t[len(breaks) - 1 :])
    t, is_even = t[order], order >= 2 * (len(breaks) - 1)
    q, dq, ddq = (np.concatenate(x)[order] for x in zip(*sides, strict=True))
    shares = {
        "usage_v": signed_shares("joint_velocity", limits, dq),
        "usage_a": signed_shares("joint_acceleration", limits, ddq),
    }
    if limits.joint_torque is not None and arm.has_bodies:
        shares["usage_torque"] = signed_shares("joint_torque", limits, arm.torque(q, dq, ddq))
    rows = [x for share in shares.values() for x in share.T]
    is_even[thin(np.zeros(len(t)), rows, MOST_TIMES)] = True
    kept = np.flatnonzero(is_even)
    return {
        "t": short(t[kept]),
        "q": np.ascontiguousarray(q[kept]),
        **{name: short(x[kept]) for name, x in shares.items()},
    }


def signed_shares(name: str, limits: Limits, values: FloatArray) -> FloatArray:
    """Shares of a limit of joints with the signs of the values, (n, dof)."""
    return np.copysign(use_of(name, limits, values).ratio, values)
