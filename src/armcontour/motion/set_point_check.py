"""Check of set-points against joint ranges and joint velocity limits."""

from __future__ import annotations

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import CompensationError
from armcontour.motion.execution import SetPoints
from armcontour.motion.trajectory import COMMAND_SLACK
from armcontour.robot import Limits
from armcontour.robot.limit_use import use_of


def check_set_points(set_points: SetPoints, limits: Limits | None = None) -> None:
    """Raise CompensationError for set-points outside a joint range or faster than a limit."""
    # A compensated command leads the joint by approximately `dq / K_p`, so it can exceed the limits
    # that the plan satisfies. A controller that checks its set-points would then stop.
    # `limits`: limits that replace those of the plan; by default the command limits of the
    # set-points.
    specified = set_points.command_limits if limits is None else limits
    dof, limits = set_points.q.shape[1], set_points.trajectory.limits_for(specified)
    lower, upper = limits.joint_range(dof)
    _check_joint_range(set_points, "joint_upper", set_points.q, upper)
    _check_joint_range(set_points, "joint_lower", -set_points.q, -lower)
    rate = np.diff(set_points.q, axis=0) / set_points.cycle
    use = use_of("joint_velocity", limits, rate)
    amounts, highest = use.value, np.asarray(use.limit)
    worst = _worst(amounts, highest)
    if worst is None:
        return
    k, j = worst
    allowed, t = float(np.broadcast_to(highest, rate.shape)[k, j]), float(set_points.t[k])
    needed = float(amounts[k, j])
    raise CompensationError(
        f"The set-points of joint {j + 1} move at {needed:.6g} rad/s from t = {t:.6g} s on, above "
        f"its joint_velocity of {allowed:.6g} rad/s. Plan with a joint_velocity lower by "
        f"{needed - allowed:.2g} rad/s, with smoother accelerations, or with slower poles.",
        t=t,
        joint=j,
        limit="joint_velocity",
        needed=needed,
        allowed=allowed,
    )


def describe_excess(set_points: SetPoints) -> str:
    """The message of `check_set_points` with its default limits; empty without an excess."""
    try:
        check_set_points(set_points)
    except CompensationError as error:
        return str(error)
    return ""


def _check_joint_range(
    set_points: SetPoints, name: str, values: FloatArray, bound: FloatArray
) -> None:
    """Raise CompensationError if set-points exceed the limit `name` of the joint range."""
    # For "joint_lower", values and bound are negated.
    worst = _worst(values, bound)
    if worst is None:
        return
    k, j = worst
    sign = 1.0 if name == "joint_upper" else -1.0
    needed, allowed, t = sign * float(values[k, j]), sign * float(bound[j]), float(set_points.t[k])
    raise CompensationError(
        f"The set-point of joint {j + 1} at t = {t:.6g} s is {needed:.6g} rad, beyond its {name} "
        f"of {allowed:.6g} rad. Plan a motion that stays {abs(needed - allowed):.2g} rad away from "
        "this limit, or is slower there.",
        t=t,
        joint=j,
        limit=name,
        needed=needed,
        allowed=allowed,
    )


def _worst(values: FloatArray, bounds: FloatArray) -> tuple[int, int] | None:
    """Row and column of the value with the largest excess over its limit; None without excess."""
    if not values.size:
        return None
    room = np.where(np.isfinite(bounds), COMMAND_SLACK * np.maximum(np.abs(bounds), 1.0), 0.0)
    over = values - bounds - room
    k, j = (int(x) for x in np.unravel_index(int(np.argmax(over)), over.shape))
    return (k, j) if over[k, j] > 0 else None
