"""Limits of set-points: their differences, and the nearest set-points within bounds."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from armcontour.core.bounded_differences import differences, nearest_within
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.motion.trajectory import COMMAND_SLACK
from armcontour.robot import Limits
from armcontour.robot.limit_use import use_of
from armcontour.robot.limits import JOINT_RANGE, UNITS

# Limits of commands by the order of the differences that they bound. Order 0 has two limits, the
# ends of the joint range.
BY_ORDER = ("", "joint_velocity", "joint_acceleration", "joint_jerk")
COMMAND_LIMITS = (*BY_ORDER[1:], *JOINT_RANGE)
# Number of decimals of set-points within limits [rad], the same as in written files.
DECIMALS = 12


def check_command_limits(limits: Limits, dof: int) -> Limits:
    """Checked limits of commands, with one value per joint."""
    names = [x for x in UNITS if getattr(limits, x) is not None]
    if others := [x for x in names if x not in COMMAND_LIMITS]:
        raise InvalidInput(
            f"command_limits has {others[0]}, but supports only {', '.join(COMMAND_LIMITS)}. "
            f"Specify {others[0]} in limits."
        )
    return limits.for_joints(dof)


def command_bounds(limits: Limits, dof: int) -> FloatArray:
    """Lower and upper bounds of set-points and their derivatives of orders 1 to 3, (4, 2, dof)."""
    return np.array([limits.joint_range(dof), *(limits.bounds(x, dof) for x in BY_ORDER[1:])])


def command_use(q: FloatArray, cycle: float, limits: Limits) -> dict[str, FloatArray]:
    """Largest ratio of set-points to each limit, {name of `BY_ORDER`: ratio per joint, (dof,)}."""
    # `q`: set-points [rad], (n, dof), constant before and after; `cycle`: cycle [s].
    return {
        name: use_of(name, limits, differences(q, order) / cycle**order).largest
        for order, name in enumerate(BY_ORDER)
        if name and getattr(limits, name) is not None
    }


class Excess(NamedTuple):
    """Set-points, or a difference of set-points, that exceed a limit."""

    name: str  # Name of the limit
    order: int  # Order of the difference; 0 for positions
    row: int  # Row of the set-point at which the difference begins
    joint: int
    needed: float  # The position, or the absolute value of the derivative
    allowed: float


def find_excess(
    q: FloatArray, cycle: float, bounds: FloatArray, share: float = 0.0
) -> Excess | None:
    """The largest excess of set-points over their bounds; None if all bounds are satisfied."""
    # `q`: set-points [rad], (n, dof); `cycle`: cycle [s]; `bounds`: as from `command_bounds`, or
    # its first orders; `share`: allowed excess of derivatives, as a share of their bounds.
    worst, excess = COMMAND_SLACK, None
    for order, (low, high) in enumerate(bounds):
        if not (np.isfinite(low).any() or np.isfinite(high).any()):
            continue
        values = differences(q, order) / cycle**order if order else q
        upper, lower = (np.where(np.isfinite(y) & (order > 0), np.abs(y), 1.0) for y in (high, low))
        beyond = np.maximum((values - high) / upper, (low - values) / lower) - share * (order > 0)
        k, j = (int(i) for i in np.unravel_index(int(np.argmax(beyond)), beyond.shape))
        if beyond[k, j] > worst:
            worst, value = float(beyond[k, j]), float(values[k, j])
            end = int(value > high[j])
            limit, row = float(bounds[order, end, j]), min(k, len(q) - 1)
            sign = -1.0 if order and value < 0 else 1.0
            name = BY_ORDER[order] or JOINT_RANGE[end]
            excess = Excess(name, order, row, j, sign * value, sign * limit)
    return excess


def find_range_or_speed_excess(q: FloatArray, cycle: float, limits: Limits) -> Excess | None:
    """The largest excess of set-points over the joint ranges, or else over the joint velocities."""
    bounds = command_bounds(limits, q.shape[1])[:2]
    return find_excess(q, cycle, bounds[:1]) or find_excess(q, cycle, bounds)


def nearest_commands(
    q: FloatArray, cycle: float, bounds: FloatArray, otherwise: FloatArray | None = None
) -> tuple[FloatArray, int | None]:
    """Set-points within bounds, with the smallest mean squared difference from `q`."""
    # The set-points of joints within their bounds are not changed. Other set-points are rounded to
    # DECIMALS, and satisfy the bounds after this rounding.
    # `q`: set-points [rad], (n, dof), at rest before and after; `cycle`: cycle [s]; `bounds`: as
    # from `command_bounds`; `otherwise`: set-points for joints whose bounds cannot be satisfied.
    # Returns set-points [rad], (n, dof), and None; without `otherwise`, the search stops at the
    # first joint whose bounds cannot be satisfied and returns the index of this joint.
    commands = q.copy()
    for j in range(q.shape[1]):
        joint_bounds, one = bounds[:, :, j], q[:, j : j + 1]
        if find_excess(one, cycle, joint_bounds[:, :, None]) is None:
            continue
        steps, digit = cycle ** np.arange(len(joint_bounds))[:, None], 10.0**-DECIMALS
        margin = digit * 2.0 ** np.arange(len(joint_bounds))[:, None] + COMMAND_SLACK * np.abs(
            joint_bounds * steps
        )
        inside = joint_bounds * steps + np.where(np.isfinite(joint_bounds), margin, 0.0) * (
            1.0,
            -1.0,
        )
        nearest = nearest_within(one[:, 0], [(float(x), float(y)) for x, y in inside])
        if nearest is None:
            if otherwise is None:
                return commands, j
            commands[:, j] = otherwise[:, j]
            continue
        commands[:, j] = np.round(nearest, DECIMALS)
    return commands, None
