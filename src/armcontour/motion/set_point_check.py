"""Check of set-points against joint ranges and joint velocity limits."""

from __future__ import annotations

from armcontour.core.errors import CompensationError
from armcontour.motion.execution import SetPoints
from armcontour.motion.nearest_commands import find_range_or_speed_excess
from armcontour.robot import Limits
from armcontour.robot.arm import unit_of


def check_set_points(set_points: SetPoints, limits: Limits | None = None) -> None:
    """Raise CompensationError for set-points outside a joint range or faster than a limit.

    A compensated command leads the joint by approximately `dq / K_p`, so it can exceed the limits
    that the plan satisfies. A controller that checks its set-points would then stop.

    `limits` are the limits that replace those of the plan; by default the command limits of the
    set-points.
    """
    specified = set_points.command_limits if limits is None else limits
    found = find_range_or_speed_excess(
        set_points.q, set_points.cycle, set_points.trajectory.limits_for(specified)
    )
    if found is None:
        return
    joint, t = found.joint + 1, float(set_points.t[found.row])
    more = found.needed - found.allowed
    unit = unit_of(set_points.trajectory.arm, "rad/s" if found.order else "rad", found.joint)
    if found.order:
        sentence = (
            f"The set-points of joint {joint} move at {found.needed:.6g} {unit} from t = {t:.6g} s "
            f"on, above its joint_velocity of {found.allowed:.6g} {unit}. Plan with a "
            f"joint_velocity lower by {more:.2g} {unit}, with smoother accelerations, or with "
            "slower poles."
        )
    else:
        sentence = (
            f"The set-point of joint {joint} at t = {t:.6g} s is {found.needed:.6g} {unit}, beyond "
            f"its {found.name} of {found.allowed:.6g} {unit}. Plan a motion that stays "
            f"{abs(more):.2g} {unit} away from this limit, or is slower there."
        )
    raise CompensationError(
        sentence,
        t=t,
        joint=found.joint,
        limit=found.name,
        needed=found.needed,
        allowed=found.allowed,
    )


def describe_excess(set_points: SetPoints) -> str:
    """The message of `check_set_points` with its default limits; empty without an excess."""
    try:
        check_set_points(set_points)
    except CompensationError as error:
        return str(error)
    return ""
