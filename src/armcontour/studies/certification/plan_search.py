"""Search for a certified plan, see docs/concepts/certificate.md.

Each trial plans all moves within derated limits and executes the program. Moves that exceed a limit
or the error budget are derated further. The final plan is proven on more robots of the box.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from contextlib import suppress
from dataclasses import replace
from typing import NoReturn

from armcontour.control.compensation import InverseDynamics, NoCompensation
from armcontour.core.errors import NotRealizable
from armcontour.core.progress import Step
from armcontour.planning.program_timing import JoinedMoves
from armcontour.simulation import simulate
from armcontour.studies.certification.box import execute_box
from armcontour.studies.certification.certification_case import RESOLUTION, Case
from armcontour.studies.certification.limit_margins import (
    CHECK_POINTS,
    LIMIT_TOLERANCE,
    SPEED_SLACK,
    LimitMargins,
    ProgramTrial,
    compute_margins,
    execute_on_box,
    execute_trial,
)
from armcontour.studies.certification.move_search import (
    GOALS,
    MoveSearch,
    derate_contour,
    derate_rapid,
    lower_aims,
    plan_contour,
    plan_moves,
    plan_rapid,
)
from armcontour.verification import check
from armcontour.verification.contour_errors import pieces_of

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


# Largest number of trials of a contour between two proofs.
MAX_TRIALS = 25
# MAX_PROOFS: largest number of proofs. A proof samples more times and robots than a trial.
# AIM_STEP: factor of the aimed shares of limits after a proof has rejected a move.
MAX_PROOFS = 30
AIM_STEP = 0.998


def search_plan(case: Case) -> tuple[ProgramTrial, list[MoveSearch]]:
    """Search for the fastest plan that satisfies the goal; returns its proof and its moves.

    Raises NotRealizable if no plan satisfies the goal; the message names the contour.
    """
    if case.budget <= 0:
        raise NotRealizable(
            f"The errors across the path that the servo model does not explain must be less than "
            f"the allowed {case.servo_allowed * 1e3:.4g} mm, but can be up to "
            f"{case.model_error * 1e3:.4g} mm. Allow a larger error, or use a servo model with a "
            "smaller `model_error`.",
            limit="contour error",
            needed=case.model_error,
            allowed=case.servo_allowed,
        )
    moves = plan_moves(case)
    contours = [x for x in moves if x.number is not None]
    proofs = 0
    while True:
        case.progress(Step((f"trial {sum(move.trials for move in contours)}",)))
        trial = execute_program(case, moves)
        active = [x for x in contours if not x.done]
        if not active:
            proven = _prove_trial(case, moves, trial)
            if proven is not None:
                return proven, moves
            proofs += 1
        for move in active:
            with move.step.named():
                _rate_trial(case, move, trial)
        if proofs == MAX_PROOFS:
            rejected = next((x for x in contours if not x.done), moves[0])
            with rejected.step.named():
                refuse(case, rejected)


def execute_program(case: Case, moves: Sequence[MoveSearch]) -> ProgramTrial:
    """Join the plans of all moves, compensate them, and execute the program."""
    joined, following = JoinedMoves(case.traced, case.arm), iter(moves)
    for step in case.traced.steps:
        if step.joint_path is None:
            joined.add(step, None)
            continue
        move = next(following)
        if move.pause > 0:
            joined.add_dwell(move.pause)
        joined.add(step, move.plan)
    trajectory = joined.trajectory().limited(case.limits)
    set_points = case.compute_set_points(trajectory)
    executed = execute_trial(case, set_points)
    return ProgramTrial(
        case=case,
        trajectory=trajectory,
        set_points=set_points,
        executed=executed,
        pieces=pieces_of(executed, case.program, None, None),
        groups=execute_on_box(case, set_points),
    )


def _rate_trial(case: Case, move: MoveSearch, trial: ProgramTrial) -> None:
    """Rate a trial of a contour, and plan its next trial."""
    assert move.number is not None
    margins = compute_margins(case, trial, move.number, move.plan)
    worst = _record_ratios(case, move, margins)
    if max(worst.values()) > 1.0 or lower_aims(case, move):
        _derate_further(case, move, margins)
    else:
        move.done = True


def _record_ratios(case: Case, move: MoveSearch, margins: LimitMargins) -> dict[str, float]:
    """Largest ratio by kind of limit; also recorded in `move` for the message of a refusal."""
    worst = margins.worst()
    kind = max(worst, key=lambda x: worst[x])
    move.active_limit = kind, worst[kind]
    largest = max(float(margins.error.max()), worst["box"]) * case.budget
    move.smallest_error = min(move.smallest_error, largest)
    return worst


def _derate_further(case: Case, move: MoveSearch, margins: LimitMargins) -> None:
    """Plan a contour derated where it exceeds limits; refuse if no plan is fast enough."""
    move.derating = derate_contour(case, move, margins)
    move.attempt_trials += 1
    if move.attempt_trials < MAX_TRIALS:
        move.trials += 1
        with suppress(NotRealizable):
            plan = plan_contour(case, move.joint_path, move.derating, move.factors)
            if plan.duration < case.goal.slowest * move.fastest.duration:
                move.plan = plan
                return
    refuse(case, move)


def _continue_search(
    case: Case, move: MoveSearch, margins: LimitMargins, box_error: float | None = None
) -> None:
    """Continue the search of a contour whose plan a proof rejected, with lower aims.

    `box_error`: error of a robot of the box that exceeds the budget [m]; None for other limits.
    """
    worst = _record_ratios(case, move, margins)
    move.done, move.attempt_trials = False, 0
    if box_error is None:
        aims = {kind: AIM_STEP for kind in ("error", "tool") if worst[kind] > 1.0}
    else:
        aims = {"box": GOALS["box"] * case.budget / box_error}
        move.smallest_excess = min(move.smallest_excess, box_error)
        move.active_limit = "box", box_error / case.budget
    for kind, factor in aims.items():
        move.aims[kind] *= factor
    move.tightness = move.aims.copy()
    _derate_further(case, move, margins)


def _prove_trial(
    case: Case, moves: Sequence[MoveSearch], trial: ProgramTrial
) -> ProgramTrial | None:
    """Proof of a trial; None if the proof rejects moves, which are then derated further."""
    contours = [x for x in moves if x.number is not None]
    fine = simulate(trial.set_points, case.plant(), resolution=RESOLUTION)
    proven = replace(trial, executed=fine, pieces=pieces_of(fine, case.program, None, None))
    outside = _derate_rapids(case, moves, trial)
    for move in contours:
        assert move.number is not None
        for executed in (trial, proven):
            margins = compute_margins(case, executed, move.number, move.plan)
            if max(margins.worst().values()) > 1.0:
                with move.step.named():
                    _continue_search(case, move, margins)
                outside = True
                break
    if outside:
        return None
    checked = check(trial.trajectory, case.arm, case.limits, points=CHECK_POINTS)
    if any(x.ratio > 1 + LIMIT_TOLERANCE for x in checked.uses):
        # This should not occur, because each move has been checked.
        raise NotRealizable(
            f"The plan of the whole program must satisfy all limits, but exceeds one: {checked}."
        )
    if case.box is not None:
        case.progress(Step(("robots of the box",)))
        for move, robots in zip(contours, execute_box(case, trial.set_points), strict=True):
            move.robots, worst = robots, float(robots.max.max())
            if worst > case.budget:
                assert move.number is not None
                margins = compute_margins(case, trial, move.number, move.plan)
                with move.step.named():
                    _continue_search(case, move, margins, worst)
                outside = True
    return None if outside else replace(proven, check=checked)


def _derate_rapids(case: Case, moves: Sequence[MoveSearch], trial: ProgramTrial) -> bool:
    """Derate rapids that exceed a joint limit in the whole program; True if any was derated."""
    spans = [x for x in trial.trajectory.spans if x.kind != "dwell"]
    outside = False
    for move, span in zip(moves, spans, strict=True) if len(moves) > 1 else ():
        if move.number is None:
            factors = derate_rapid(
                case, move.factors, move.plan, trial.set_points, trial.all_runs, span.t
            )
            if factors is not None:
                move.factors, outside = factors, True
                move.plan = plan_rapid(case, move.joint_path, move.factors, move.rise)
    return outside
