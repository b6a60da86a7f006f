"""The refusal of a certificate: the limit that binds, and what would help."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from armcontour.control.compensation import InverseDynamics, NoCompensation
from armcontour.core.errors import NotRealizable
from armcontour.studies.certification.certification_case import Case
from armcontour.studies.certification.limit_margins import SPEED_SLACK
from armcontour.studies.certification.move_search import MoveSearch

# Smaller shares of an error are not said.
SAID = 0.01
LONGER = "a larger slowest"


# A sentence, and a limit with its allowed and its needed value.
Reason = tuple[str, str, float, float]


def refuse(case: Case, x: MoveSearch) -> NoReturn:
    """Refuse a certificate after a search, with the limit that binds and what would help."""
    text, limit, allowed, needed = REASONS.get(x.binds[0], _acceleration)(case, x)
    slow = f"within {case.goal.slowest:g} times the {x.fastest.duration:.4g} s of the"
    raise NotRealizable(
        f"No plan {slow} uncertified optimum is certified: {text}.",
        limit=limit,
        needed=needed,
        allowed=allowed,
    )


def _acceleration(case: Case, x: MoveSearch) -> Reason:
    ratio, shorter = x.binds[1], _shorter(case)
    held = " and are held" if case.servo.interpolation == "step" else ""
    if isinstance(case.run.compensation, InverseDynamics) and not case.bodies:
        shorter = "compensation inverse, as inverse_dynamics is for rigid bodies"
    text = (
        f"its set-points would need {ratio:.4g} times a joint's acceleration limit, as they come "
        f"every {case.run.cycle * 1e3:g} ms{held}: take {shorter}, saturation: report, or "
        f"{LONGER}"
    )
    return text, "joint_acceleration", 1.0, ratio


def _speed(case: Case, x: MoveSearch) -> Reason:
    ratio = x.binds[1]
    text = (
        "a bound of its speed, or a command outside a joint's range, is exceeded by "
        f"{ratio - 1:.2g} of it: raise the limit, keep the path further from the ends of the "
        f"joints' ranges, or take {LONGER}"
    )
    return text, "speed", 1.0, ratio


def _torque(case: Case, x: MoveSearch) -> Reason:
    ratio, mend = x.binds[1], "raise joint_torque"
    if case.limits.joint_torque is None:
        mend = (
            "give the limits joint_torque (without it drives are as strong as the acceleration "
            "limits need them, with no friction and no payload)"
        )
    text = (
        f"a robot's drive would need {ratio:.4g} times its torque limit: {mend}, lower the "
        "acceleration limits, or take a smaller box"
    )
    return text, "joint_torque", 1.0, ratio


def _tool_speed(case: Case, x: MoveSearch) -> Reason:
    # The ratio is one of squares.
    faster, allowed = (1 + SPEED_SLACK) * x.binds[1] ** 0.5, 1 + SPEED_SLACK
    text = (
        f"the executed tool runs at {faster:.5g} times the velocity that is assigned where it is, "
        f"and {allowed:g} times are allowed: {_follow(case)}, let the assigned velocity fall in "
        f"smaller steps, or take {LONGER}"
    )
    return text, "speed", allowed, faster


def _error(case: Case, x: MoveSearch) -> Reason:
    budget, box = case.budget, x.binds[0] == "box"
    # Trials with a smaller error exceeded another limit, or only an estimate of them was inside.
    reached = x.reached if x.reached > budget else x.binds[1] * budget
    if box and reached <= budget:
        reached = x.outside
    over = " of the worst robot of the box" if box else ""
    text = (
        f"the largest contour error{over} comes down to {reached * 1e3:.4g} mm, and "
        f"{budget * 1e3:.4g} mm is allowed: {_mend_box(case, x) if box else _follow(case)}, take "
        f"{LONGER}, or allow more"
    )
    return text, "contour error", budget, reached


# By the kind of use that the last trials exceeded.
REASONS: dict[str, Callable[[Case, MoveSearch], Reason]] = {
    "acceleration": _acceleration,
    "speed": _speed,
    "torque": _torque,
    "tool": _tool_speed,
    "error": _error,
    "box": _error,
}


def _shorter(case: Case) -> str:
    """What brings set-points closer together."""
    held = case.servo.interpolation == "step"
    return "linear interpolation" if held else "a shorter cycle"


def _follow(case: Case) -> str:
    """What helps the tool to follow the plan: without compensation, errors are those of the lag."""
    lags = isinstance(case.run.compensation, NoCompensation)
    return "compensate the lag of the servo" if lags else f"take {_shorter(case)}"


def _mend_box(case: Case, x: MoveSearch) -> str:
    """What helps against errors over a box; on rigid bodies, what each unknown takes first."""
    closer = "know the robot more closely (a smaller box), slow down the assigned velocity"
    if not x.parts:
        return closer
    largest = sorted(x.parts.items(), key=lambda x: -x[1])
    least = SAID * sum(x.parts.values())
    parts = ", ".join(f"{name} {value * 1e3:.3g} mm" for name, value in largest if value > least)
    box, first = case.box, largest[0][0]
    if first == "payload" and box is not None and not box.payload_known:
        closer = f"let the controller weigh its payload (payload_known: true), or {closer}"
    return f"its parts are {parts}; {closer}"
