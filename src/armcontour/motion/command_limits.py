"""Limits of set-points: checks, and the nearest set-points within them."""

from __future__ import annotations

import numpy as np

from armcontour._bounded_differences import differences, nearest_within
from armcontour._checks import FloatArray
from armcontour.arms import Limits
from armcontour.arms.limits import JOINT_RANGE, UNITS, by_direction
from armcontour.errors import CompensationError, InvalidInput
from armcontour.motion.execution import TaughtData

# A set-point may exceed a limit by this fraction of the limit, or by this much [rad, rad/s], due to
# rounding errors.
SLACK = 1e-9
# Limits of commands by the order of the differences that they bound; order 0 has two.
BY_ORDER = ("", "joint_velocity", "joint_acceleration", "joint_jerk")
COMMAND_LIMITS = (*BY_ORDER[1:], *JOINT_RANGE)
# Decimals of set-points within limits [rad], which are those of written files.
DECIMALS = 12


def refuse_commands(taught: TaughtData, limits: Limits | None = None) -> None:
    """Refuse set-points outside a joint range, or that move faster than a velocity limit.

    A compensated command is ahead of the joint by about `dq / K_p`, and so can exceed the limits
    that the plan keeps. A controller that checks its set-points would then stop.

    Args:
        taught: The set-points.
        limits: Limits in place of those of the plan.

    Raises:
        CompensationError: A limit is exceeded; with the set-point of the largest excess.
    """
    dof, limits = taught.q.shape[1], taught.trajectory.limits_for(limits)
    lower, upper = limits.joint_range(dof)
    _refuse_beyond(taught, "joint_upper", taught.q, upper)
    _refuse_beyond(taught, "joint_lower", -taught.q, -lower)
    rate = np.diff(taught.q, axis=0) / taught.period
    amounts, most = by_direction(rate, limits.velocity_bounds(dof))
    at = _worst(amounts, most)
    if at is None:
        return
    k, j = at
    allowed, t = float(np.broadcast_to(most, rate.shape)[k, j]), float(taught.t[k])
    needed = float(amounts[k, j])
    raise CompensationError(
        f"The set-points of joint {j + 1} move at {needed:.6g} rad/s from t = {t:.6g} s on, above "
        f"its joint_velocity of {allowed:.6g} rad/s: plan with a joint_velocity lower by "
        f"{needed - allowed:.2g} rad/s, with smoother accelerations, or with slower poles.",
        t=t,
        joint=j,
        limit="joint_velocity",
        needed=needed,
        allowed=allowed,
    )


def describe_excess(taught: TaughtData) -> str:
    """The sentence of `refuse_commands` for the limits of the plan; empty if it refuses nothing."""
    try:
        refuse_commands(taught)
    except CompensationError as error:
        return str(error)
    return ""


def _refuse_beyond(taught: TaughtData, name: str, values: FloatArray, most: FloatArray) -> None:
    """Raise CompensationError if set-points exceed the end `name` of the joint range.

    Args:
        taught: The set-points.
        name: "joint_upper" or "joint_lower".
        values: The set-points, with the opposite sign for "joint_lower" [rad], (n, dof).
        most: The end of the range, with the opposite sign for "joint_lower" [rad], (dof,).
    """
    at = _worst(values, most)
    if at is None:
        return
    k, j = at
    sign = 1.0 if name == "joint_upper" else -1.0
    needed, allowed, t = sign * float(values[k, j]), sign * float(most[j]), float(taught.t[k])
    raise CompensationError(
        f"The set-point of joint {j + 1} at t = {t:.6g} s is {needed:.6g} rad, beyond its {name} "
        f"of {allowed:.6g} rad: plan {abs(needed - allowed):.2g} rad from it, or slower there.",
        t=t,
        joint=j,
        limit=name,
        needed=needed,
        allowed=allowed,
    )


def _worst(values: FloatArray, most: FloatArray) -> tuple[int, int] | None:
    """Row and column of the value with the largest excess over its limit; None without excess."""
    if not values.size:
        return None
    room = np.where(np.isfinite(most), SLACK * np.maximum(np.abs(most), 1.0), 0.0)
    over = values - most - room
    k, j = (int(x) for x in np.unravel_index(int(np.argmax(over)), over.shape))
    return (k, j) if over[k, j] > 0 else None


def check_command_limits(limits: Limits, dof: int) -> Limits:
    """Checked limits of commands, with one value per joint and all other limits lifted.

    Args:
        limits: The limits.
        dof: Number of joints.

    Raises:
        InvalidInput: A limit that is none of commands, no limit, or a wrong number of values.
    """
    given = [x for x in UNITS if getattr(limits, x) is not None]
    if others := [x for x in given if x not in COMMAND_LIMITS]:
        raise InvalidInput(
            f"command_limits has {others[0]}, but it limits set-points by "
            f"{', '.join(COMMAND_LIMITS)}: give {others[0]} in limits."
        )
    return Limits.only(**{x: getattr(limits, x) for x in given}).for_joints(dof)


def command_bounds(limits: Limits, dof: int) -> FloatArray:
    """Lower and upper bounds of set-points and their derivatives of orders 1 to 3, (4, 2, dof).

    Args:
        limits: The limits.
        dof: Number of joints.
    """
    jerk = np.full(dof, np.inf if limits.joint_jerk is None else limits.joint_jerk)
    return np.array(
        [
            limits.joint_range(dof),
            limits.velocity_bounds(dof),
            limits.acceleration_bounds(dof),
            (-jerk, jerk),
        ]
    )


def command_use(q: FloatArray, period: float, limits: Limits) -> dict[str, FloatArray]:
    """Largest share of each limit that set-points use, per joint, by names of `BY_ORDER`.

    Args:
        q: Set-points [rad], (n, dof); constant before and after.
        period: Command interval [s].
        limits: Limits of commands.
    """
    found = {}
    for order, bounds in enumerate(command_bounds(limits, q.shape[1])):
        if order and np.isfinite(bounds).any():
            shares = differences(q, order)[:, None] / (bounds * period**order)
            found[BY_ORDER[order]] = np.asarray(shares.max(axis=(0, 1)))
    return found


def excess(q: FloatArray, period: float, bounds: FloatArray) -> tuple[int, int, int, float] | None:
    """Order, row and joint of the set-point farthest beyond its bound, and its value.

    Args:
        q: Set-points [rad], (n, dof).
        period: Command interval [s].
        bounds: As of `command_bounds`; the first orders are enough.

    Returns:
        The row is that of the last set-point of the difference. None if all bounds are satisfied.
    """
    worst, found = SLACK, None
    for order, (low, high) in enumerate(bounds):
        if not (np.isfinite(low).any() or np.isfinite(high).any()):
            continue
        x = differences(q, order) / period**order if order else q
        upper, lower = (np.where(np.isfinite(y) & (order > 0), np.abs(y), 1.0) for y in (high, low))
        beyond = np.maximum((x - high) / upper, (low - x) / lower)
        k, j = (int(i) for i in np.unravel_index(int(np.argmax(beyond)), beyond.shape))
        if beyond[k, j] > worst:
            row = min(k + (order == 0), len(q) - 1)
            worst, found = float(beyond[k, j]), (order, row, j, float(x[k, j]))
    return found


def nearest_commands(
    q: FloatArray, period: float, bounds: FloatArray, otherwise: FloatArray | None = None
) -> tuple[FloatArray, int | None]:
    """The set-points nearest to given ones, in the mean square, within bounds.

    Joints within their bounds keep their set-points to the last bit. Others get set-points that are
    rounded to DECIMALS, and satisfy the bounds with this rounding.

    Args:
        q: Set-points [rad], (n, dof), at rest before and after.
        period: Command interval [s].
        bounds: As of `command_bounds`.
        otherwise: Set-points of the joints for which none satisfy the bounds.

    Returns:
        Set-points [rad], (n, dof), and the first joint for which none satisfy the bounds, or None.
    """
    found = q.copy()
    for j in range(q.shape[1]):
        own, one = bounds[:, :, j], q[:, j : j + 1]
        if excess(one, period, own[:, :, None]) is None:
            continue
        steps, digit = period ** np.arange(len(own))[:, None], 10.0**-DECIMALS
        margin = digit * 2.0 ** np.arange(len(own))[:, None] + SLACK * np.abs(own * steps)
        inside = own * steps + np.where(np.isfinite(own), margin, 0.0) * (1.0, -1.0)
        nearest = nearest_within(one[:, 0], [(float(x), float(y)) for x, y in inside])
        if nearest is None:
            if otherwise is None:
                return found, j
            found[:, j] = otherwise[:, j]
            continue
        found[:, j] = np.round(nearest, DECIMALS)
    return found, None
