"""The refusal of a certificate: the limit that binds, and what would help."""

from __future__ import annotations

from collections.abc import Callable
from typing import NamedTuple, NoReturn

from armcontour.certification._search import Search
from armcontour.certification._uses import SPEED_SLACK
from armcontour.compensation import InverseDynamics, NoCompensation
from armcontour.errors import NotRealizable

# Smaller shares of an error are not said.
SAID = 0.01
LONGER = "a larger slowest"


class Reason(NamedTuple):
    """Why no plan is certified: a sentence, and a limit with its needed and its allowed value."""

    text: str
    limit: str
    allowed: float
    needed: float | None = None


def refuse(search: Search) -> NoReturn:
    """Refuse a certificate after a search, with the limit that binds and what would help.

    Raises:
        NotRealizable: Always.
    """
    text, limit, allowed, needed = REASONS[search.binds[0]](search)
    slow = f"within {search.goal.slowest:g} times the {search.optimum:.4g} s of the"
    raise NotRealizable(
        f"No plan {slow} uncertified optimum is certified: {text}.",
        limit=limit,
        needed=needed,
        allowed=allowed,
    )


def _acceleration(search: Search) -> Reason:
    setting, ratio, shorter = search.setting, search.binds[1], _shorter(search)
    held = " and are held" if setting.servo.interpolation == "step" else ""
    if isinstance(setting.run.compensation, InverseDynamics) and not setting.bodies:
        shorter = "compensation inverse, as inverse_dynamics is for rigid bodies"
    text = (
        f"its set-points would need {ratio:.4g} times a joint's acceleration limit, as they come "
        f"every {setting.run.period * 1e3:g} ms{held}: take {shorter}, saturation: report, or "
        f"{LONGER}"
    )
    return Reason(text, "joint_acceleration", 1.0, ratio)


def _speed(search: Search) -> Reason:
    ratio = search.binds[1]
    text = (
        "a bound of its speed, or a command outside a joint's range, is exceeded by "
        f"{ratio - 1:.2g} of it: raise the limit, keep the path further from the ends of the "
        f"joints' ranges, or take {LONGER}"
    )
    return Reason(text, "speed", 1.0, ratio)


def _torque(search: Search) -> Reason:
    ratio, mend = search.binds[1], "raise joint_torque"
    if search.setting.limits.joint_torque is None:
        mend = (
            "give the limits joint_torque (without it drives are as strong as the acceleration "
            "limits need them, with no friction and no payload)"
        )
    text = (
        f"a robot's drive would need {ratio:.4g} times its torque limit: {mend}, lower the "
        "acceleration limits, or take a smaller box"
    )
    return Reason(text, "joint_torque", 1.0, ratio)


def _tool_speed(search: Search) -> Reason:
    # The ratio is one of squares.
    faster, allowed = (1 + SPEED_SLACK) * search.binds[1] ** 0.5, 1 + SPEED_SLACK
    text = (
        f"the executed tool runs at {faster:.5g} times the velocity that is assigned where it is, "
        f"and {allowed:g} times are allowed: {_follow(search)}, let the assigned velocity fall in "
        f"smaller steps, or take {LONGER}"
    )
    return Reason(text, "speed", allowed, faster)


def _error(search: Search) -> Reason:
    budget, box = search.setting.budget, search.binds[0] == "box"
    # Trials with a smaller error exceeded another limit, or only an estimate of them was inside.
    reached = search.reached if search.reached > budget else search.binds[1] * budget
    if box and reached <= budget:
        reached = search.outside
    over = " of the worst robot of the box" if box else ""
    text = (
        f"the largest contour error{over} comes down to {reached * 1e3:.4g} mm, and "
        f"{budget * 1e3:.4g} mm is allowed: {_mend_box(search) if box else _follow(search)}, take "
        f"{LONGER}, or allow more"
    )
    return Reason(text, "contour error", budget, reached)


# By the kind of use that the last trials exceeded.
REASONS: dict[str, Callable[[Search], Reason]] = {
    "acceleration": _acceleration,
    "speed": _speed,
    "torque": _torque,
    "tool": _tool_speed,
    "error": _error,
    "box": _error,
}


def _shorter(search: Search) -> str:
    """What brings set-points closer together."""
    held = search.setting.servo.interpolation == "step"
    return "linear interpolation" if held else "a shorter command interval"


def _follow(search: Search) -> str:
    """What helps the tool to follow the plan: without compensation, errors are those of the lag."""
    lags = isinstance(search.setting.run.compensation, NoCompensation)
    return "compensate the lag of the servo" if lags else f"take {_shorter(search)}"


def _mend_box(search: Search) -> str:
    """What helps against errors over a box; on rigid bodies, what each unknown takes first."""
    closer = "know the robot more closely (a smaller box), slow down the assigned velocity"
    if search.shares is None:
        return closer
    largest = sorted(search.shares.items(), key=lambda x: -x[1])
    least = SAID * sum(search.shares.values())
    parts = ", ".join(f"{name} {value * 1e3:.3g} mm" for name, value in largest if value > least)
    box, first = search.setting.box, largest[0][0]
    if first == "payload" and box is not None and not box.payload_known:
        closer = f"let the controller weigh its payload (payload_known: true), or {closer}"
    return f"the linear model of the last plan has {parts}; {closer}"
