"""Refusal of a certificate: the limiting constraint, and possible remedies."""

from __future__ import annotations

from collections.abc import Callable
from typing import NoReturn

from armcontour.control.compensation import InverseDynamics, NoCompensation
from armcontour.core.errors import NotRealizable
from armcontour.studies.certification.certification_case import Case
from armcontour.studies.certification.limit_margins import SPEED_SLACK
from armcontour.studies.certification.move_search import MoveSearch

BOX_ADVICE = "Reduce the uncertainty of the robot (a smaller box), reduce the assigned velocity"


# A clause with its remedies; the name of a limit, its allowed and its required value.
Reason = tuple[str, str, float, float]


def refuse(case: Case, move: MoveSearch) -> NoReturn:
    """Raise NotRealizable after a search, with the limiting constraint and remedies."""
    text, limit, allowed, needed = REASONS.get(move.active_limit[0], _acceleration)(case, move)
    slow = f"within {case.goal.slowest:g} times the {move.fastest.duration:.4g} s of the"
    raise NotRealizable(
        f"No plan {slow} uncertified optimum is certified, because {text}.",
        limit=limit,
        needed=needed,
        allowed=allowed,
    )


def _acceleration(case: Case, move: MoveSearch) -> Reason:
    ratio, shorter = move.active_limit[1], _advise_finer_command(case)
    held = ", which are held," if case.servo.interpolation == "step" else ""
    if isinstance(case.run.compensation, InverseDynamics):
        shorter = "compensation inverse (inverse_dynamics is for rigid bodies)"
    text = (
        f"set-points every {case.run.cycle * 1e3:g} ms{held} require {ratio:.4g} times the "
        f"acceleration limit of a joint. Use {shorter}"
    )
    return text, "joint_acceleration", 1.0, ratio


def _speed(case: Case, move: MoveSearch) -> Reason:
    ratio = move.active_limit[1]
    text = (
        f"a limit of speed or joint velocity is exceeded by {ratio - 1:.2g} of its value, or a "
        "command is outside a joint range. Increase the limit, or move the path away from the "
        "ends of the joint ranges"
    )
    return text, "speed", 1.0, ratio


def _tool_speed(case: Case, move: MoveSearch) -> Reason:
    # active_limit[1] is a ratio of squared speeds.
    faster, allowed = (1 + SPEED_SLACK) * move.active_limit[1] ** 0.5, 1 + SPEED_SLACK
    text = (
        f"the executed tool moves at {faster:.5g} times the assigned velocity, but at most "
        f"{allowed:g} times is allowed. {_advise_contour_error(case)}, or reduce the "
        "assigned velocity in smaller steps"
    )
    return text, "speed", allowed, faster


def _error(case: Case, move: MoveSearch) -> Reason:
    budget, box = case.budget, move.active_limit[0] == "box"
    # If a trial had an error within the budget, it exceeded another limit, or its error over the
    # box was only an estimate. Then the error of the last trial is reported.
    reached = move.smallest_error if move.smallest_error > budget else move.active_limit[1] * budget
    if box and reached <= budget:
        reached = move.smallest_excess
    over = " of the worst robot of the box" if box else ""
    advice = BOX_ADVICE if box else _advise_contour_error(case)
    text = (
        f"the largest contour error{over} must be at most {budget * 1e3:.4g} mm, but is at least "
        f"{reached * 1e3:.4g} mm. {advice}, or allow a larger error"
    )
    return text, "contour error", budget, reached


# Functions for the reason by the kind of limit that the last trial exceeded.
REASONS: dict[str, Callable[[Case, MoveSearch], Reason]] = {
    "acceleration": _acceleration,
    "speed": _speed,
    "tool": _tool_speed,
    "error": _error,
    "box": _error,
}


def _advise_finer_command(case: Case) -> str:
    """Remedy for the coarseness of the command, as a noun phrase."""
    held = case.servo.interpolation == "step"
    return "linear interpolation" if held else "a shorter cycle"


def _advise_contour_error(case: Case) -> str:
    """Remedy for a contour error, as the start of a sentence; without compensation, for lag."""
    lags = isinstance(case.run.compensation, NoCompensation)
    return "Compensate the lag of the servo" if lags else f"Use {_advise_finer_command(case)}"
