"""The search of a certificate: propose, execute the whole program once, judge, tighten, prove.

A trial plans all moves within what is left of their limits, executes the program, and looks where
a limit, the budget or the box is exceeded. There more is derated, and the next trial is made. Moves
that are within keep their plans. See docs/concepts/certificate.md.
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
from armcontour.studies.certification import _bodies
from armcontour.studies.certification._case import Case
from armcontour.studies.certification._moves import (
    GOALS,
    Move,
    Steps,
    exceeded,
    lower_rapid,
    moves_of,
    plan_contour,
    plan_rapid,
    tighten,
)
from armcontour.studies.certification._proving import KEPT, POINTS
from armcontour.studies.certification._refusal import refuse
from armcontour.studies.certification._uses import (
    LimitMargins,
    Trial,
    run,
    run_on_box,
    uses_of,
)
from armcontour.verification import check
from armcontour.verification.contour_execution import pieces_of

# An attempt to derate a contour takes at most this many trials.
MOST_TRIALS = 25
# Errors go at least with the third power of speed and acceleration. Which steps lead to the fastest
# plan is not known: each contour takes all of these, and its best plan.
STEPS = (Steps(1 / 3, 0.7, True), Steps(1 / 3, 0.85, True), Steps(1 / 4, 0.85, False))
# Certified plans that take this share longer than the optimum are searched with further steps.
GAIN = 1e-4
# Where saturation is allowed an error has its cause anywhere before it, so accelerations are
# derated everywhere alike, to this share of what was left of them at a time; the share that is
# within is then found to this ratio.
COARSE_SHARE = 0.85
SHARE_PRECISION = 1.005
# A proof looks at more times and more robots than trials, and at all moves together. Moves that are
# outside are derated further, with goals closer by CLOSER, so many times at most.
MOST_PROOFS = 30
CLOSER = 0.998
# After a drive saturated, torque limits are lowered by this ratio at least.
SPARE = 1.01


def search(case: Case) -> tuple[Trial, list[Move]]:
    """The fastest plan of a program that keeps the goal, with its proof, and its moves.

    Raises:
        NotRealizable: No plan keeps the goal; the message names the contour.
        ArmContourError: Planning or execution fails.
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
        case.progress(Step((f"trial {sum(x.trials for x in contours)}",)))
        trial = execute_program(case, moves, robots)
        active = [x for x in contours if not x.done]
        if not active:
            proven = _prove(case, moves, trial, robots)
            if proven is not None:
                return proven, moves
            proofs += 1
        for x in active:
            with x.step.named():
                _judge(case, x, trial)
        left = [x for x in contours if not x.done or x.best is None]
        if left and left[0].done or proofs == MOST_PROOFS:
            with (left or moves)[0].step.named():
                refuse(case, (left or moves)[0])


def execute_program(
    case: Case, moves: Sequence[Move], robots: list[FloatArray] | None = None
) -> Trial:
    """Join the plans of all moves, compute their set-points, and execute the program.

    Args:
        case: The case.
        moves: The moves.
        robots: Robots of the box that are executed as rigid bodies; the first ones are appended.
    """
    joined, following = JoinedMoves(case.traced, case.arm), iter(moves)
    for step in case.traced.steps:
        if step.joint_path is None:
            joined.add(step, None)
            continue
        x = next(following)
        if x.pause > 0:
            joined.stand(x.pause)
        joined.add(step, x.plan)
    trajectory = joined.trajectory().limited(case.limits)
    set_points = case.compute_set_points(trajectory)
    executed, box = run(case, set_points), None
    if case.bodies and case.box is not None and robots is not None:
        if not robots:
            corners, moves[0].parts = _bodies.worst_corners(case, set_points)
            robots += list(corners[: _bodies.FIRST])
        box = _bodies.largest_errors(case, set_points, robots)
    return Trial(
        case=case,
        trajectory=trajectory,
        set_points=set_points,
        executed=executed,
        pieces=pieces_of(executed, case.program, None, None),
        groups=run_on_box(case, set_points),
        box=box,
    )


def _judge(case: Case, x: Move, trial: Trial) -> None:
    """Judge a trial of a contour, and propose its next plan."""
    assert x.number is not None
    uses = uses_of(case, trial, x.number, x.plan)
    worst = _remember(case, x, uses)
    if case.saturated and worst["error"] > 1.0:
        _next(case, x, within=False)
    elif max(worst.values()) > 1.0 or exceeded(case, x):
        _lower(case, x, uses)
    elif case.bodies and trial.executed.saturated_time.any():
        _spare_torque(case, x, uses, _bodies.torque_ratio(case, trial.executed))
    else:
        x.best = x.derating, x.factors, x.plan
        _next(case, x, within=True)
    _propose(case, x)


def _remember(case: Case, x: Move, uses: LimitMargins) -> dict[str, float]:
    """The largest uses of a contour, which tell later why no plan is certified."""
    worst = uses.worst()
    kind = max(worst, key=lambda x: worst[x])
    if case.saturated and worst["error"] > 1.0:
        kind = "error"
    x.binds = kind, worst[kind]
    largest = max(float(uses.error.max()), worst["box"]) * case.budget
    x.reached = min(x.reached, largest)
    return worst


def _lower(case: Case, x: Move, uses: LimitMargins) -> None:
    """Derate a contour where its uses are too large."""
    x.derating = tighten(case, x, uses, STEPS[min(x.attempt, len(STEPS) - 1)])
    x.tries += 1


def _spare_torque(case: Case, x: Move, uses: LimitMargins, ratio: float) -> None:
    """Lower torque limits after a drive saturated.

    Args:
        case: The case.
        x: The contour.
        uses: Its uses.
        ratio: Largest torque over its limit.
    """
    x.binds = "torque", max(ratio, 1.0)
    if case.limits.joint_torque is None:
        _next(case, x, within=False)
        return
    left = x.factors.get("joint_torque", 1.0) / max(ratio, SPARE)
    x.factors = {**x.factors, "joint_torque": left}
    _lower(case, x, uses)


def _propose(case: Case, x: Move) -> None:
    """Plan a contour within its derating, faster than its best plan; else try the next steps."""
    while not x.done:
        if x.tries < MOST_TRIALS:
            x.trials += 1
            best = np.inf if x.best is None else x.best[2].duration
            with suppress(NotRealizable):
                plan = plan_contour(case, x.joint_path, x.derating, x.factors)
                if plan.duration < min(best, case.goal.slowest * x.fastest.duration):
                    x.plan = plan
                    return
        _next(case, x, within=False, late=True)


def _next(case: Case, x: Move, *, within: bool, late: bool = False) -> None:
    """Begin the next attempt to derate a contour, or end its search with its best plan.

    Args:
        case: The case.
        x: The contour.
        within: Whether the last attempt led to a plan that is within all uses.
        late: Whether it led to no plan that is fast enough.
    """
    if case.saturated:
        low, high = (x.share, x.bracket[1]) if within else (x.bracket[0], x.share)
        x.bracket = low, high
        narrow = high <= low * SHARE_PRECISION
        over = narrow or x.proving if low else late or x.binds[0] != "error"
        smaller = 1 / SHARE_PRECISION if x.proving else COARSE_SHARE
        x.share = float(np.sqrt(low * high)) if low else x.share * smaller
    else:
        x.attempt += 1
        near = within and x.plan.duration <= x.fastest.duration * (1 + GAIN)
        over = near or x.proving or x.attempt == len(STEPS)
    x.tightness, x.tries, x.done = x.aims.copy(), 0, over
    x.derating, x.factors = x.nothing, {}
    if case.saturated and x.share < 1.0:
        x.derating = x.nothing.with_share(x.share, "error")
    if over and x.best is not None:
        x.derating, x.factors, x.plan = x.best


def _reopen(
    case: Case, x: Move, uses: LimitMargins, aims: Mapping[str, float] | None = None
) -> None:
    """Derate a contour further whose plan is outside in a proof.

    Args:
        case: The case.
        x: The contour.
        uses: Its uses.
        aims: Factors by which trials aim lower, by causes; by default CLOSER for errors and for
            the speed of the tool where they are too large.
    """
    worst = _remember(case, x, uses)
    x.best, x.done, x.proving, x.tries = None, False, True, 0
    if aims is None:
        aims = {kind: CLOSER for kind in ("error", "tool") if worst[kind] > 1.0}
    for kind, factor in aims.items():
        x.aims[kind] *= factor
    x.tightness = x.aims.copy()
    if case.saturated and worst["error"] > 1.0:
        x.bracket = 0.0, x.share
        _next(case, x, within=False)
    else:
        _lower(case, x, uses)
    _propose(case, x)


def _prove(
    case: Case, moves: Sequence[Move], trial: Trial, robots: list[FloatArray]
) -> Trial | None:
    """The trial, executed as a proof; None if moves are outside, which are then derated further.

    The proof looks at all moves together, at more times than trials, and at all robots of the box.

    Args:
        case: The case.
        moves: All moves.
        trial: A trial of their best plans.
        robots: Robots of the box that trials execute as rigid bodies; worse ones are appended.
    """
    contours = [x for x in moves if x.number is not None]
    proven = trial
    if not case.bodies:
        fine = simulate(trial.set_points, case.plant(), resolution=case.resolution)
        pieces = pieces_of(fine, case.program, None, None)
        proven = replace(trial, executed=fine, pieces=pieces)
    outside = _lower_rapids(case, moves, trial)
    for x in contours:
        assert x.number is not None
        for executed in (trial,) if proven is trial else (trial, proven):
            uses = uses_of(case, executed, x.number, x.plan)
            if max(uses.worst().values()) > 1.0:
                with x.step.named():
                    _reopen(case, x, uses)
                outside = True
                break
    if outside:
        return None
    checked = check(trial.trajectory, case.arm, case.limits, points=POINTS)
    if any(x.ratio > 1 + KEPT for x in checked.uses):
        # Each move was checked already.
        raise NotRealizable(f"The plan of the whole program exceeds a limit: {checked}.")
    for x in contours:
        with x.step.named():
            outside |= case.box is not None and not _prove_box(case, x, trial, robots)
    return None if outside else replace(proven, check=checked)


def _lower_rapids(case: Case, moves: Sequence[Move], trial: Trial) -> bool:
    """Derate rapids that exceed a joint limit in the whole program; whether there are any."""
    if case.saturated or case.bodies:
        return False
    spans = [x for x in trial.trajectory.spans if x.kind != "dwell"]
    outside = False
    for x, span in zip(moves, spans, strict=True) if len(moves) > 1 else ():
        if x.number is None:
            less = lower_rapid(case, x.factors, x.plan, trial.set_points, trial.all_runs, span.t)
            if less is not None:
                x.factors, outside = less, True
                x.plan = plan_rapid(case, x.joint_path, x.factors, x.rise)
    return outside


def _prove_box(case: Case, x: Move, trial: Trial, robots: list[FloatArray]) -> bool:
    """Whether all robots of the box that are executed are within; else a contour is reopened.

    Corners of the box need not be the worst of it, so robots drawn from it are executed, too.
    """
    assert x.number is not None
    for name in ("corners", "spread"):
        found = _execute_box(case, x, trial, drawn=name == "spread")
        setattr(x, name, found)
        worst = float(found.max.max())
        saturated = case.bodies and found.saturated.any()
        if worst <= case.budget and not saturated:
            continue
        aims = {"box": GOALS["box"] * case.budget / worst}
        if case.bodies:
            # Trials execute the robots that are outside.
            order = np.argsort(-found.max)[: _bodies.MORE]
            robots += [found.deviations[k] for k in order if found.max[k] > case.budget]
            box = _bodies.largest_errors(case, trial.set_points, robots)
            trial, aims = replace(trial, box=box), {"box": CLOSER}
        uses = uses_of(case, trial, x.number, x.plan)
        if saturated:
            x.best, x.done, x.proving, x.tries = None, False, True, 0
            _spare_torque(case, x, uses, float(found.demand_ratio.max()))
            _propose(case, x)
        else:
            _reopen(case, x, uses, aims)
            x.outside = min(x.outside, worst)
            x.binds = "box", worst / case.budget
        return False
    return True


def _execute_box(case: Case, x: Move, trial: Trial, *, drawn: bool) -> MonteCarloResult:
    """Execute a contour in the corners of the box, or on robots drawn from it."""
    assert x.number is not None and case.box is not None
    goal = case.goal
    if case.bodies:
        if drawn:
            robots = _bodies.draw(case)
            return _bodies.execute_robots(case, trial.set_points, robots, goal.seed)
        corners, x.parts = _bodies.worst_corners(case, trial.set_points)
        return _bodies.execute_robots(case, trial.set_points, corners)
    span = trial.trajectory.contour_spans[x.number]
    if not drawn:
        return execute_servos(case, trial.set_points, x.number, span)
    case.progress(Step((f"{goal.samples} robots of the box",)))
    return execute_servos(case, trial.set_points, x.number, span, goal.samples)


def execute_servos(
    case: Case, set_points: SetPoints, number: int, span: Span, samples: int | None = None
) -> MonteCarloResult:
    """Execute a contour on robots of the box with servos.

    Args:
        case: The case.
        set_points: Set-points of the whole program.
        number: Index of the contour.
        span: Times of the contour.
        samples: Number of robots that are drawn; None is the corners of the box.
    """
    assert case.box is not None and span.trajectory is not None and span.work is not None
    since, end_time = None, None
    if case.program.single_path is None:
        since, end_time = (x - span.t[0] for x in span.work)
    stretch = case.stretch(set_points, span.t, span.trajectory)
    path = case.program.contours[number].path
    own = stretch, path, case.arm, case.servo, case.limits, case.box
    if samples is None:
        return worst_corner(*own, since=since, end_time=end_time)
    return spread(*own, samples=samples, seed=case.goal.seed, since=since, end_time=end_time)
