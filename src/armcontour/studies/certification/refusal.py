"""Refusal of a certificate: the limiting constraint, and changes that would help."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from armcontour.control.compensation import InverseDynamics, NoCompensation
from armcontour.core.errors import NotRealizable
from armcontour.studies.certification.certification_case import Case
from armcontour.studies.certification.limit_margins import SPEED_SLACK
from armcontour.studies.certification.move_search import MoveSearch

# Smallest share of an error that is reported.
REPORTED = 0.01
LONGER = "a larger slowest"


# A clause; and a limit with its allowed and its required value.
Reason = tuple[str, str, float, float]


def refuse(case: Case, move: MoveSearch) -> NoReturn:
    """Raise NotRealizable after a search, with the limiting constraint and possible changes."""
    text, limit, allowed, needed = REASONS.get(move.binds[0], _acceleration)(case, move)
    slow = f"within {case.goal.slowest:g} times the {move.fastest.duration:.4g} s of the"
    raise NotRealizable(
        f"No plan {slow} uncertified optimum is certified: {text}.",
        limit=limit,
        needed=needed,
        allowed=allowed,
    )


def _acceleration(case: Case, move: MoveSearch) -> Reason:
    ratio, shorter = move.binds[1], _shorter(case)
    held = " and are held" if case.servo.interpolation == "step" else ""
    if isinstance(case.run.compensation, InverseDynamics) and not case.bodies:
        shorter = "compensation inverse, as inverse_dynamics is for rigid bodies"
    text = (
        f"its set-points would need {ratio:.4g} times a joint's acceleration limit, as they come "
        f"every {case.run.cycle * 1e3:g} ms{held}: take {shorter}, saturation: report, or "
        f"{LONGER}"
    )
    return text, "joint_acceleration", 1.0, ratio


def _speed(case: Case, move: MoveSearch) -> Reason:
    ratio = move.binds[1]
    text = (
        f"a bound of its speed is exceeded by {ratio - 1:.2g} of it, or a command is outside a "
        "joint's range: raise the limit, move the path away from the ends of the joints' ranges, "
        f"or take {LONGER}"
    )
    return text, "speed", 1.0, ratio


def _torque(case: Case, move: MoveSearch) -> Reason:
    ratio, fix = move.binds[1], "raise joint_torque"
    if case.limits.joint_torque is None:
        fix = (
            "give the limits joint_torque (without it drives are as strong as the acceleration "
            "limits need them, with no friction and no payload)"
        )
    text = (
        f"a robot's drive would need {ratio:.4g} times its torque limit: {fix}, lower the "
        "acceleration limits, or take a smaller box"
    )
    return text, "joint_torque", 1.0, ratio


def _tool_speed(case: Case, move: MoveSearch) -> Reason:
    # The ratio is one of squares.
    faster, allowed = (1 + SPEED_SLACK) * move.binds[1] ** 0.5, 1 + SPEED_SLACK
    text = (
        f"the executed tool runs at {faster:.5g} times the velocity that is assigned where it is, "
        f"and {allowed:g} times are allowed: {_follow(case)}, let the assigned velocity fall in "
        f"smaller steps, or take {LONGER}"
    )
    return text, "speed", allowed, faster


def _error(case: Case, move: MoveSearch) -> Reason:
    budget, box = case.budget, move.binds[0] == "box"
    # Trials with a smaller error exceeded another limit, or only their estimate was within.
    reached = move.reached if move.reached > budget else move.binds[1] * budget
    if box and reached <= budget:
        reached = move.outside
    over = " of the worst robot of the box" if box else ""
    advice = _reduce_box_error(case, move) if box else _follow(case)
    text = (
        f"the largest contour error{over} comes down to {reached * 1e3:.4g} mm, and "
        f"{budget * 1e3:.4g} mm is allowed: {advice}, take {LONGER}, or allow more"
    )
    return text, "contour error", budget, reached


# By the kind of limit that the last trials exceeded.
REASONS: dict[str, Callable[[Case, MoveSearch], Reason]] = {
    "acceleration": _acceleration,
    "speed": _speed,
    "torque": _torque,
    "tool": _tool_speed,
    "error": _error,
    "box": _error,
}


def _shorter(case: Case) -> str:
    """Advice for a finer command."""
    held = case.servo.interpolation == "step"
    return "linear interpolation" if held else "a shorter cycle"


def _follow(case: Case) -> str:
    """Advice for a smaller contour error; without compensation the lag causes it."""
    lags = isinstance(case.run.compensation, NoCompensation)
    return "compensate the lag of the servo" if lags else f"take {_shorter(case)}"


def _reduce_box_error(case: Case, move: MoveSearch) -> str:
    """Advice for a smaller error over a box, on rigid bodies with the parts of the unknowns."""
    advice = "know the robot more closely (a smaller box), slow down the assigned velocity"
    if not move.parts:
        return advice
    largest = sorted(move.parts.items(), key=lambda x: -x[1])
    least = REPORTED * sum(move.parts.values())
    parts = ", ".join(f"{name} {value * 1e3:.3g} mm" for name, value in largest if value > least)
    box, first = case.box, largest[0][0]
    if first == "payload" and box is not None and not box.payload_known:
        advice = f"let the controller weigh its payload (payload_known: true), or {advice}"
    return f"its parts are {parts}; {advice}"
