"""Search for a certified plan, see docs/concepts/certificate.md.

Each trial plans all moves within derated limits and executes the program. Moves that exceed a limit
or the error budget are derated further. The final plan is proven on more robots of the box.
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
    CHECK_POINTS,
    LIMIT_TOLERANCE,
    LimitMargins,
    ProgramTrial,
    compute_margins,
    execute_on_box,
    execute_trial,
)
from armcontour.studies.certification.move_search import (
    GOALS,
    MoveSearch,
    StepSizes,
    derate_contour,
    derate_rapid,
    lower_aims,
    plan_contour,
    plan_moves,
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
from armcontour.verification.contour_errors import pieces_of

# Largest number of trials of a contour with the same step sizes.
MAX_TRIALS = 25
# Step sizes. Each contour tries all of them, because the best step sizes are not known in advance.
# Errors grow at least with the third power of speed and acceleration.
STEPS = (StepSizes(1 / 3, 0.7, True), StepSizes(1 / 3, 0.85, True), StepSizes(1 / 4, 0.85, False))
# The remaining step sizes are tried if a certified plan is slower than the uncertified optimum by
# more than this share.
OPTIMUM_EXCESS = 1e-4
# If saturation is allowed, an error can have its cause at any earlier time. Therefore accelerations
# are derated uniformly: by the factor COARSE_SHARE per trial, then by bisection until the ratio of
# the bounds is SHARE_PRECISION.
COARSE_SHARE = 0.85
SHARE_PRECISION = 1.005
# MAX_PROOFS: largest number of proofs. A proof samples more times and robots than a trial.
# AIM_STEP: factor of the aimed shares of limits after a proof has rejected a move.
MAX_PROOFS = 30
AIM_STEP = 0.998
# Smallest factor by which torque limits are divided after a drive has saturated.
TORQUE_STEP = 1.01


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
    robots: list[FloatArray] = []
    proofs = 0
    while True:
        case.progress(Step((f"trial {sum(move.trials for move in contours)}",)))
        trial = execute_program(case, moves, robots)
        active = [x for x in contours if not x.done]
        if not active:
            proven = _prove_trial(case, moves, trial, robots)
            if proven is not None:
                return proven, moves
            proofs += 1
        for move in active:
            with move.step.named():
                _rate_trial(case, move, trial)
        uncertified = [x for x in contours if not x.done or x.best is None]
        if uncertified and uncertified[0].done or proofs == MAX_PROOFS:
            with (uncertified or moves)[0].step.named():
                refuse(case, (uncertified or moves)[0])


def execute_program(
    case: Case, moves: Sequence[MoveSearch], robots: list[FloatArray] | None = None
) -> ProgramTrial:
    """Join the plans of all moves, compensate them, and execute the program.

    `robots`: robots of the box that are executed as rigid bodies; if the list is empty, the worst
    corners are appended to it.
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


def _rate_trial(case: Case, move: MoveSearch, trial: ProgramTrial) -> None:
    """Rate a trial of a contour, and plan its next trial."""
    assert move.number is not None
    margins = compute_margins(case, trial, move.number, move.plan)
    worst = _record_ratios(case, move, margins)
    if case.allows_saturation and worst["error"] > 1.0:
        _next_attempt(case, move, within=False)
    elif max(worst.values()) > 1.0 or lower_aims(case, move):
        _derate_contour(case, move, margins)
    elif case.bodies and trial.executed.saturated_time.any():
        _reduce_torque(case, move, margins, torque_ratio(case, trial.executed))
    else:
        move.best = move.derating, move.factors, move.plan
        _next_attempt(case, move, within=True)
    _plan_next(case, move)


def _record_ratios(case: Case, move: MoveSearch, margins: LimitMargins) -> dict[str, float]:
    """Largest ratio by kind of limit; also recorded in `move` for the message of a refusal."""
    worst = margins.worst()
    kind = max(worst, key=lambda x: worst[x])
    if case.allows_saturation and worst["error"] > 1.0:
        kind = "error"
    move.active_limit = kind, worst[kind]
    largest = max(float(margins.error.max()), worst["box"]) * case.budget
    move.smallest_error = min(move.smallest_error, largest)
    return worst


def _derate_contour(case: Case, move: MoveSearch, margins: LimitMargins) -> None:
    """Derate a contour further in the cells in which it exceeds limits."""
    move.derating = derate_contour(case, move, margins, STEPS[min(move.attempt, len(STEPS) - 1)])
    move.attempt_trials += 1


def _reduce_torque(case: Case, move: MoveSearch, margins: LimitMargins, ratio: float) -> None:
    """Reduce torque limits after saturation; `ratio`: largest ratio of required torque to limit."""
    move.active_limit = "torque", max(ratio, 1.0)
    if case.limits.joint_torque is None:
        _next_attempt(case, move, within=False)
        return
    share = move.factors.get("joint_torque", 1.0) / max(ratio, TORQUE_STEP)
    move.factors = {**move.factors, "joint_torque": share}
    _derate_contour(case, move, margins)


def _plan_next(case: Case, move: MoveSearch) -> None:
    """Plan a contour within its derating; try the next step sizes if the plan is not faster."""
    while not move.done:
        if move.attempt_trials < MAX_TRIALS:
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

    `within`: True if the last plan satisfied all limits. `slow`: True if no plan was fast enough.
    """
    if case.allows_saturation:
        low, high = (move.share, move.bracket[1]) if within else (move.bracket[0], move.share)
        move.bracket = low, high
        narrow = high <= low * SHARE_PRECISION
        over = narrow or move.rejected if low else slow or move.active_limit[0] != "error"
        smaller = 1 / SHARE_PRECISION if move.rejected else COARSE_SHARE
        move.share = float(np.sqrt(low * high)) if low else move.share * smaller
    else:
        move.attempt += 1
        near = within and move.plan.duration <= move.fastest.duration * (1 + OPTIMUM_EXCESS)
        over = near or move.rejected or move.attempt == len(STEPS)
    move.tightness, move.attempt_trials, move.done = move.aims.copy(), 0, over
    move.derating, move.factors = move.nothing, {}
    if case.allows_saturation and move.share < 1.0:
        move.derating = move.nothing.with_share(move.share, "error")
    if over and move.best is not None:
        move.derating, move.factors, move.plan = move.best


def _continue_search(
    case: Case, move: MoveSearch, margins: LimitMargins, aims: Mapping[str, float] | None = None
) -> None:
    """Continue the search of a contour whose plan a proof rejected, with lower aims.

    `aims`: factors of the aimed shares by cause; by default AIM_STEP for exceeded limits.
    """
    worst = _record_ratios(case, move, margins)
    move.best, move.done, move.rejected, move.attempt_trials = None, False, True, 0
    if aims is None:
        aims = {kind: AIM_STEP for kind in ("error", "tool") if worst[kind] > 1.0}
    for kind, factor in aims.items():
        move.aims[kind] *= factor
    move.tightness = move.aims.copy()
    if case.allows_saturation and worst["error"] > 1.0:
        move.bracket = 0.0, move.share
        _next_attempt(case, move, within=False)
    else:
        _derate_contour(case, move, margins)
    _plan_next(case, move)


def _prove_trial(
    case: Case, moves: Sequence[MoveSearch], trial: ProgramTrial, robots: list[FloatArray]
) -> ProgramTrial | None:
    """Proof of a trial; None if the proof rejects moves, which are then derated further."""
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
    for move in contours:
        with move.step.named():
            outside |= case.box is not None and not _prove_box(case, move, trial, robots)
    return None if outside else replace(proven, check=checked)


def _derate_rapids(case: Case, moves: Sequence[MoveSearch], trial: ProgramTrial) -> bool:
    """Derate rapids that exceed a joint limit in the whole program; True if any was derated."""
    if case.allows_saturation or case.bodies:
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
    """True if a contour satisfies the budget in corners of the box and on robots drawn from it.

    Otherwise the search of the contour is continued. Robots are drawn because the worst robot need
    not be in a corner.
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
            # Robots that exceed the budget are executed in later trials.
            order = np.argsort(-runs.max)[:ADDED_ROBOTS]
            robots += [runs.deviations[k] for k in order if runs.max[k] > case.budget]
            box = largest_errors(case, trial.set_points, robots)
            trial, aims = replace(trial, box=box), {"box": AIM_STEP}
        margins = compute_margins(case, trial, move.number, move.plan)
        if saturated:
            move.best, move.done, move.rejected, move.attempt_trials = None, False, True, 0
            _reduce_torque(case, move, margins, float(runs.demand_ratio.max()))
            _plan_next(case, move)
        else:
            _continue_search(case, move, margins, aims)
            move.smallest_excess = min(move.smallest_excess, worst)
            move.active_limit = "box", worst / case.budget
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
    """Execute a contour on `samples` independent servos drawn from the box, or in its corners."""
    assert case.box is not None and span.trajectory is not None and span.work is not None
    since, end_time = None, None
    if case.program.single_path is None:
        since, end_time = (x - span.t[0] for x in span.work)
    stretch = case.move_set_points(set_points, span.t, span.trajectory)
    path = case.program.contours[number].path
    arguments = stretch, path, case.arm, case.servo, case.limits, case.box
    if samples is None:
        return worst_corner(*arguments, since=since, end_time=end_time)
    return spread(*arguments, samples=samples, seed=case.goal.seed, since=since, end_time=end_time)
