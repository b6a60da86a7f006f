"""Search for a certified plan, see docs/concepts/certificate.md.

Each trial plans all moves within derated limits and executes the program. Moves are derated further
where they exceed a limit, the budget or the box; the final plan is proven on more robots.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import NotRealizable
from armcontour.core.progress import Step
from armcontour.motion import SetPoints, Span
from armcontour.planning.program_timing import JoinedMoves
from armcontour.simulation import simulate
from armcontour.simulation.robustness.monte_carlo import MonteCarloResult, spread, worst_corner
from armcontour.studies.certification.certification_case import Case
from armcontour.studies.certification.limit_margins import (
    KEPT,
    POINTS,
    LimitMargins,
    ProgramTrial,
    execute_on_box,
    execute_trial,
    margins_of,
)
from armcontour.studies.certification.move_search import (
    GOALS,
    MoveSearch,
    StepSizes,
    aim_lower,
    derate_contour,
    derate_rapid,
    moves_of,
    plan_contour,
    plan_rapid,
)
from armcontour.studies.certification.refusal import refuse
from armcontour.studies.certification.rigid_body_robots import (
    ADDED_ROBOTS,
    FIRST_CORNERS,
    draw_robots,
    execute_bodies,
    largest_errors,
    torque_ratio,
    worst_corners,
)
from armcontour.verification import check
from armcontour.verification.contour_execution import pieces_of

# Largest number of trials per attempt to derate a contour.
MAX_TRIALS = 25
# Errors grow at least with the third power of speed and acceleration. The best step sizes are not
# known in advance, so each contour tries all of these.
STEPS = (StepSizes(1 / 3, 0.7, True), StepSizes(1 / 3, 0.85, True), StepSizes(1 / 4, 0.85, False))
# Relative excess over the optimum above which a certified plan is searched with further steps.
GAIN = 1e-4
# If saturation is allowed, the cause of an error can be anywhere before it, so accelerations are
# derated uniformly: by this factor per trial, then by bisection to this ratio.
COARSE_SHARE = 0.85
SHARE_PRECISION = 1.005
# Largest number of proofs, and the factor of aims after a proof rejected a move. A proof samples
# more times and robots than a trial, and all moves together.
MAX_PROOFS = 30
AIM_STEP = 0.998
# Smallest ratio by which torque limits are reduced after a drive saturated.
TORQUE_STEP = 1.01


def search(case: Case) -> tuple[ProgramTrial, list[MoveSearch]]:
    """Fastest plan of a program that satisfies the goal, with its proof, and its moves.

    Raises NotRealizable if none does; the message names the contour.
    """
    if case.budget <= 0:
        raise NotRealizable(
            f"The servo model does not explain errors of up to {case.model_error * 1e3:.4g} mm "
            f"across the path, and {case.servo_allowed * 1e3:.4g} mm is allowed: allow more, or "
            "give the servo a model with a smaller `model_error`.",
            limit="contour error",
            needed=case.model_error,
            allowed=case.servo_allowed,
        )
    moves = moves_of(case)
    contours = [x for x in moves if x.number is not None]
    robots: list[FloatArray] = []
    proofs = 0
    while True:
        case.progress(Step((f"trial {sum(move.trials for move in contours)}",)))
        trial = execute_program(case, moves, robots)
        active = [x for x in contours if not x.done]
        if not active:
            proven = _prove(case, moves, trial, robots)
            if proven is not None:
                return proven, moves
            proofs += 1
        for move in active:
            with move.step.named():
                _rate(case, move, trial)
        uncertified = [x for x in contours if not x.done or x.best is None]
        if uncertified and uncertified[0].done or proofs == MAX_PROOFS:
            with (uncertified or moves)[0].step.named():
                refuse(case, (uncertified or moves)[0])


def execute_program(
    case: Case, moves: Sequence[MoveSearch], robots: list[FloatArray] | None = None
) -> ProgramTrial:
    """Join the plans of all moves, compensate them, and execute the program.

    `robots` of the box are executed as rigid bodies; an empty list gets the first ones.
    """
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
    executed, box = execute_trial(case, set_points), None
    if case.bodies and case.box is not None and robots is not None:
        if not robots:
            corners, moves[0].parts = worst_corners(case, set_points)
            robots += list(corners[:FIRST_CORNERS])
        box = largest_errors(case, set_points, robots)
    return ProgramTrial(
        case=case,
        trajectory=trajectory,
        set_points=set_points,
        executed=executed,
        pieces=pieces_of(executed, case.program, None, None),
        groups=execute_on_box(case, set_points),
        box=box,
    )


def _rate(case: Case, move: MoveSearch, trial: ProgramTrial) -> None:
    """Rate a trial of a contour, and plan its next one."""
    assert move.number is not None
    margins = margins_of(case, trial, move.number, move.plan)
    worst = _record_ratios(case, move, margins)
    if case.saturated and worst["error"] > 1.0:
        _next_attempt(case, move, within=False)
    elif max(worst.values()) > 1.0 or aim_lower(case, move):
        _derate(case, move, margins)
    elif case.bodies and trial.executed.saturated_time.any():
        _reduce_torque(case, move, margins, torque_ratio(case, trial.executed))
    else:
        move.best = move.derating, move.factors, move.plan
        _next_attempt(case, move, within=True)
    _plan_next(case, move)


def _record_ratios(case: Case, move: MoveSearch, margins: LimitMargins) -> dict[str, float]:
    """Largest ratios of a contour, recorded for a refusal."""
    worst = margins.worst()
    kind = max(worst, key=lambda x: worst[x])
    if case.saturated and worst["error"] > 1.0:
        kind = "error"
    move.binds = kind, worst[kind]
    largest = max(float(margins.error.max()), worst["box"]) * case.budget
    move.reached = min(move.reached, largest)
    return worst


def _derate(case: Case, move: MoveSearch, margins: LimitMargins) -> None:
    """Derate a contour where it exceeds limits."""
    move.derating = derate_contour(case, move, margins, STEPS[min(move.attempt, len(STEPS) - 1)])
    move.tries += 1


def _reduce_torque(case: Case, move: MoveSearch, margins: LimitMargins, ratio: float) -> None:
    """Reduce torque limits after a drive saturated; `ratio` is that of the largest torque."""
    move.binds = "torque", max(ratio, 1.0)
    if case.limits.joint_torque is None:
        _next_attempt(case, move, within=False)
        return
    share = move.factors.get("joint_torque", 1.0) / max(ratio, TORQUE_STEP)
    move.factors = {**move.factors, "joint_torque": share}
    _derate(case, move, margins)


def _plan_next(case: Case, move: MoveSearch) -> None:
    """Plan a contour within its derating and faster than its best plan, or try the next steps."""
    while not move.done:
        if move.tries < MAX_TRIALS:
            move.trials += 1
            best = np.inf if move.best is None else move.best[2].duration
            with suppress(NotRealizable):
                plan = plan_contour(case, move.joint_path, move.derating, move.factors)
                if plan.duration < min(best, case.goal.slowest * move.fastest.duration):
                    move.plan = plan
                    return
        _next_attempt(case, move, within=False, slow=True)


def _next_attempt(case: Case, move: MoveSearch, *, within: bool, slow: bool = False) -> None:
    """Begin the next attempt to derate a contour, or end its search with its best plan.

    `within` states that the last plan satisfied all limits, `slow` that no plan was fast enough.
    """
    if case.saturated:
        low, high = (move.share, move.bracket[1]) if within else (move.bracket[0], move.share)
        move.bracket = low, high
        narrow = high <= low * SHARE_PRECISION
        over = narrow or move.proving if low else slow or move.binds[0] != "error"
        smaller = 1 / SHARE_PRECISION if move.proving else COARSE_SHARE
        move.share = float(np.sqrt(low * high)) if low else move.share * smaller
    else:
        move.attempt += 1
        near = within and move.plan.duration <= move.fastest.duration * (1 + GAIN)
        over = near or move.proving or move.attempt == len(STEPS)
    move.tightness, move.tries, move.done = move.aims.copy(), 0, over
    move.derating, move.factors = move.nothing, {}
    if case.saturated and move.share < 1.0:
        move.derating = move.nothing.with_share(move.share, "error")
    if over and move.best is not None:
        move.derating, move.factors, move.plan = move.best


def _reopen(
    case: Case, move: MoveSearch, margins: LimitMargins, aims: Mapping[str, float] | None = None
) -> None:
    """Derate a contour further whose plan a proof rejected; `aims` are factors by cause."""
    worst = _record_ratios(case, move, margins)
    move.best, move.done, move.proving, move.tries = None, False, True, 0
    if aims is None:
        aims = {kind: AIM_STEP for kind in ("error", "tool") if worst[kind] > 1.0}
    for kind, factor in aims.items():
        move.aims[kind] *= factor
    move.tightness = move.aims.copy()
    if case.saturated and worst["error"] > 1.0:
        move.bracket = 0.0, move.share
        _next_attempt(case, move, within=False)
    else:
        _derate(case, move, margins)
    _plan_next(case, move)


def _prove(
    case: Case, moves: Sequence[MoveSearch], trial: ProgramTrial, robots: list[FloatArray]
) -> ProgramTrial | None:
    """Proof of a trial; None if it rejects moves, which are then derated further."""
    contours = [x for x in moves if x.number is not None]
    proven = trial
    if not case.bodies:
        fine = simulate(trial.set_points, case.plant(), resolution=case.resolution)
        pieces = pieces_of(fine, case.program, None, None)
        proven = replace(trial, executed=fine, pieces=pieces)
    outside = _derate_rapids(case, moves, trial)
    for move in contours:
        assert move.number is not None
        for executed in (trial,) if proven is trial else (trial, proven):
            margins = margins_of(case, executed, move.number, move.plan)
            if max(margins.worst().values()) > 1.0:
                with move.step.named():
                    _reopen(case, move, margins)
                outside = True
                break
    if outside:
        return None
    checked = check(trial.trajectory, case.arm, case.limits, points=POINTS)
    if any(x.ratio > 1 + KEPT for x in checked.uses):
        # Each move was checked already.
        raise NotRealizable(f"The plan of the whole program exceeds a limit: {checked}.")
    for move in contours:
        with move.step.named():
            outside |= case.box is not None and not _prove_box(case, move, trial, robots)
    return None if outside else replace(proven, check=checked)


def _derate_rapids(case: Case, moves: Sequence[MoveSearch], trial: ProgramTrial) -> bool:
    """Derate rapids that exceed a joint limit in the whole program; True if there are any."""
    if case.saturated or case.bodies:
        return False
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


def _prove_box(case: Case, move: MoveSearch, trial: ProgramTrial, robots: list[FloatArray]) -> bool:
    """Execute a contour in corners of the box and on robots drawn from it; reopen it on failure.

    The worst robot need not be in a corner. Returns True if all robots satisfy the budget.
    """
    assert move.number is not None
    for name in ("corners", "spread"):
        runs = _execute_box(case, move, trial, drawn=name == "spread")
        setattr(move, name, runs)
        worst = float(runs.max.max())
        saturated = case.bodies and runs.saturated.any()
        if worst <= case.budget and not saturated:
            continue
        aims = {"box": GOALS["box"] * case.budget / worst}
        if case.bodies:
            # Later trials execute the robots that exceed the budget.
            order = np.argsort(-runs.max)[:ADDED_ROBOTS]
            robots += [runs.deviations[k] for k in order if runs.max[k] > case.budget]
            box = largest_errors(case, trial.set_points, robots)
            trial, aims = replace(trial, box=box), {"box": AIM_STEP}
        margins = margins_of(case, trial, move.number, move.plan)
        if saturated:
            move.best, move.done, move.proving, move.tries = None, False, True, 0
            _reduce_torque(case, move, margins, float(runs.demand_ratio.max()))
            _plan_next(case, move)
        else:
            _reopen(case, move, margins, aims)
            move.outside = min(move.outside, worst)
            move.binds = "box", worst / case.budget
        return False
    return True


def _execute_box(
    case: Case, move: MoveSearch, trial: ProgramTrial, *, drawn: bool
) -> MonteCarloResult:
    """Execute a contour in the corners of the box, or on robots drawn from it."""
    assert move.number is not None and case.box is not None
    goal = case.goal
    if case.bodies:
        if drawn:
            robots = draw_robots(case)
            return execute_bodies(case, trial.set_points, robots, goal.seed)
        corners, move.parts = worst_corners(case, trial.set_points)
        return execute_bodies(case, trial.set_points, corners)
    span = trial.trajectory.contour_spans[move.number]
    if not drawn:
        return execute_servos(case, trial.set_points, move.number, span)
    case.progress(Step((f"{goal.samples} robots of the box",)))
    return execute_servos(case, trial.set_points, move.number, span, goal.samples)


def execute_servos(
    case: Case, set_points: SetPoints, number: int, span: Span, samples: int | None = None
) -> MonteCarloResult:
    """Execute a contour on robots of the box with servos; by default in its corners."""
    assert case.box is not None and span.trajectory is not None and span.work is not None
    since, end_time = None, None
    if case.program.single_path is None:
        since, end_time = (x - span.t[0] for x in span.work)
    stretch = case.stretch(set_points, span.t, span.trajectory)
    path = case.program.contours[number].path
    arguments = stretch, path, case.arm, case.servo, case.limits, case.box
    if samples is None:
        return worst_corner(*arguments, since=since, end_time=end_time)
    return spread(*arguments, samples=samples, seed=case.goal.seed, since=since, end_time=end_time)
