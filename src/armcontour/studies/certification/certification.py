"""`certify`: fastest plan whose execution stays within a tolerance; `sweep`: several tolerances."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import numpy as np

from armcontour.control.compensation.compensator import INVERSE
from armcontour.core import checks
from armcontour.core.errors import ExecutionError, InvalidInput, NotRealizable
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.geometry import Path, RoundedPath, ShapedPath
from armcontour.jobs.alternatives import clearance_of
from armcontour.jobs.goal import CertificateGoal
from armcontour.jobs.job import ARC, FREE, Job, Rounding, Run, build_plant, choose_run
from armcontour.jobs.reuse import Reuse
from armcontour.jobs.run_plan import plan_one
from armcontour.jobs.study import evaluate_run, simulate_rigid_bodies
from armcontour.motion import Method
from armcontour.planning import Optimal, check_jerk_support
from armcontour.program import Program, contour_called
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.servo import ServoModel
from armcontour.simulation import RigidBodyPlant, simulate
from armcontour.studies.certification.box import execute_box
from armcontour.studies.certification.certificate import (
    Budget,
    Certificate,
    ContourCertificate,
    Uncertified,
)
from armcontour.studies.certification.certification_case import RESOLUTION, Case
from armcontour.studies.certification.derating import derated_intervals
from armcontour.studies.certification.limit_margins import (
    ProgramTrial,
    contour_errors,
    execute_trial,
    speed_ratios,
)
from armcontour.studies.certification.move_search import MoveSearch
from armcontour.studies.certification.plan_search import search_plan
from armcontour.verification.contour_errors import pieces_of
from armcontour.verification.error_profile import ErrorProfile

# A nearly continuous command has a cycle that is CONTINUOUS times shorter, but at least SHORTEST
# [s].
CONTINUOUS = 20
SHORTEST = 1e-4
# Shares of the tolerance for the servo if the goal has no servo budget. They are tried in order
# until a plan is certified, and further while the error is at least BUDGET_USE times its budget and
# the plan becomes faster.
SERVO_SHARES = (0.02, 0.06, 0.2, 0.6)
BUDGET_USE = 0.9
# After the search, the unused part of the tolerance is allotted to the shape. The servo budget
# becomes this multiple of the servo error of the found plan, because the plan changes. The second
# multiple is tried if the first results in no faster plan.
SERVO_MARGINS = (1.5, 6.0)
# Paths are rounded or shaped again if the unused part is at least this share of the tolerance.
LEAST_GAIN = 1e-3


# The proven trial of the whole program, and the moves of its search.
Proven = tuple[ProgramTrial, list[MoveSearch]]


@checked
def certify(
    job: Job | Path | Program,
    arm: Arm | None = None,
    servo: ServoModel | None = None,
    limits: Limits | None = None,
    *,
    run: str | None = None,
    goal: CertificateGoal | None = None,
    progress: Progress | None = None,
) -> Certificate:
    """Find the fastest plan whose execution stays within a tolerance.

    The plan has optimal timing, which is derated where required, and the compensation, cycle and
    limits of the run. The certificate is valid only for the job's independent servos. An experiment
    of the run executes the same set-points on rigid bodies.

    >>> certificate = ac.certify(ac.read_job("job.yaml"))
    >>> certificate.evaluation.contour_error.max < 0.1e-3
    True
    >>> ac.certify(path, arm, servo, limits, goal=ac.CertificateGoal(servo_error=0.1e-3)).kept
    True

    Args:
        job: The job; or a path or a program, which then needs an arm, a servo and a goal.
        arm: The arm of the path.
        servo: The servo of the arm.
        limits: Limits that replace those of the arm.
        run: Name of the run; by default that of the goal.
        goal: The goal; by default the certificate of the job. The corners of a path are rounded
            within its tolerance.
        progress: Called with a named step before every trial.

    Raises:
        InvalidInput: There is no goal, or the job has no run with this name.
        NotRealizable: No plan satisfies the goal; the message states the limiting constraint and
            remedies.
        ArmContourError: Tracing, planning or execution fails.
    """
    if not isinstance(job, Job):
        job = _job_of(job, arm, servo, limits, goal)
    elif (arm, servo, limits) != (None, None, None):
        raise InvalidInput("A job has an arm, a servo and limits. Remove these arguments.")
    goal = goal_of(job) if goal is None else goal
    chosen = run_of(job, goal.run if run is None else run)
    if chosen.duration is not None:
        raise InvalidInput(
            f"A certificate does not support runs with a duration, but run {chosen.name} has a "
            f"duration of {chosen.duration:g} s. Remove duration."
        )
    if chosen.rounding is not None and chosen.rounding.free:
        check_jerk_support(Method.SHAPED, chosen.limits)
    plant = None
    if chosen.experiment is not None:
        # The plant is built before the search, so that invalid options are reported early.
        plant = build_plant(
            chosen.experiment, job.arm, job.plant_servo, chosen.limits, chosen.feeds_gravity_forward
        )
    if goal.box is not None:
        goal.box.half_widths(job.plant_servo.for_joints(job.arm.dof), job.arm.dof)
    if chosen.default_compensation:
        options = replace(INVERSE, command_limits=chosen.compensation.command_limits)
        chosen = replace(chosen, compensation=options)
    # Derating replaces the reserve, so the reserve is not used.
    free = chosen.rounding is not None and chosen.rounding.free
    intervals = chosen.timing.intervals if free and isinstance(chosen.timing, Optimal) else None
    chosen = replace(chosen, timing=Optimal(intervals=intervals))
    report, shapes = subprogress(progress), [chosen]
    if free and chosen.rounding is not None:
        shapes.append(replace(chosen, rounding=chosen.rounding.with_arcs))
    best: tuple[Case, Proven] | None = None
    refusal: NotRealizable | None = None
    durations: dict[str, float] = {}
    for each in shapes:
        deadline = min(durations.values(), default=np.inf)
        try:
            case, proven, least = _find_fastest(job, each, goal, report, deadline)
        except NotRealizable as error:
            refusal = error
            continue
        durations[ARC if each.rounding is None else each.rounding.shape] = least
        if proven is not None and least < deadline:
            best = case, proven
    if best is None:
        assert refusal is not None
        raise refusal
    return _make_certificate(*best, durations if FREE in durations else {}, plant)


def _job_of(
    path: Path | Program,
    arm: Arm | None,
    servo: ServoModel | None,
    limits: Limits | None,
    goal: CertificateGoal | None,
) -> Job:
    """Job with one run of optimal timing, whose corners are rounded within the goal."""
    if arm is None or servo is None or goal is None:
        raise InvalidInput(
            "A certificate of a path requires an arm, a servo and a goal: certify(path, arm, "
            "servo, goal=CertificateGoal(tolerance=1e-3))."
        )
    rounding = None if goal.tolerance is None else Rounding(tolerance=goal.tolerance)
    run = Run(name="optimal", limits=resolve_limits("certify", arm, limits), rounding=rounding)
    return Job(name="path", arm=arm, path=path, servo=servo, runs=(run,))


def goal_of(job: Job, **overrides: Any) -> CertificateGoal:
    """Goal of the job's certificate (or a default goal) with some fields replaced."""
    names = tuple(x.name for x in fields(CertificateGoal))
    for name in overrides:
        checks.check_choice("An option of certify", name, names)
    if job.certificate is None:
        return CertificateGoal(**overrides)
    return replace(job.certificate, **overrides)


def run_of(job: Job, name: str | None) -> Run:
    """The named run; without a name, the only run with optimal timing."""
    return choose_run(
        job, name, "certified", [x for x in job.runs if isinstance(x.timing, Optimal)]
    )


def _find_fastest(
    job: Job,
    run: Run,
    goal: CertificateGoal,
    report: Progress,
    deadline: float,
) -> tuple[Case, Proven | None, float]:
    """Find the fastest plan of a run for a goal, over all splits of the tolerance.

    Returns the case in which the shape has the whole tolerance, the proven plan, and its duration
    [s]. If no plan is faster than `deadline` [s], the plan is None, and the duration is a lower
    bound.
    """

    def case_of(servo: float) -> Case:
        shaped = _reduce_shape(run, goal, servo)
        planned = plan_one(job, shaped, reuse, report, clear=False)
        return Case(job, planned, goal, servo, report)

    reuse = Reuse()
    # The plan without derating is the reference of the certificate's cost. It is planned first,
    # because its errors, such as an event before the start, also apply to the certificate.
    base = case_of(0.0)
    least = base.planned.trajectory.duration
    free = run.rounding is not None and run.rounding.free
    bent = free or any(shape_part(x.path) > 0 for x in base.program.contours)
    if goal.tolerance is None or not bent:
        budget = goal.servo_error or goal.tolerance
        assert budget is not None
        if least >= deadline:
            return base, None, least
        alone = search_plan(replace(base, servo_allowed=budget))
        return base, alone, alone[0].trajectory.duration
    tightest = goal.tolerance
    budgets = (
        [x * tightest for x in SERVO_SHARES] if goal.servo_error is None else [goal.servo_error]
    )
    if np.isfinite(deadline):
        least = min(least, *(case_of(x).planned.trajectory.duration for x in budgets))
        if least >= deadline:
            return base, None, least
    best = _search_budgets(case_of, budgets)
    # Allot the unused part of the tolerance to the shape if this makes the plan faster.
    for factor in SERVO_MARGINS:
        case = best[0].case
        needed = factor * _worst_error(*best) + case.model_error
        if needed > case.servo_allowed - LEAST_GAIN * tightest:
            break
        with suppress(NotRealizable):
            better = search_plan(case_of(needed))
            if better[0].trajectory.duration < best[0].trajectory.duration:
                best = better
                break
    return base, best, best[0].trajectory.duration


def _search_budgets(case_of: Callable[[float], Case], budgets: Sequence[float]) -> Proven:
    """Search with increasing servo budgets while plans become faster and use most of the budget."""
    best: Proven | None = None
    for budget in budgets:
        try:
            proven = search_plan(case_of(budget))
        except NotRealizable:
            if best is not None:
                break
            if budget == budgets[-1]:
                raise
            continue
        if best is not None and proven[0].trajectory.duration >= best[0].trajectory.duration:
            break
        best = proven
        if _worst_error(*best) + best[0].case.model_error < BUDGET_USE * budget:
            break
    assert best is not None
    return best


def _worst_error(proof: ProgramTrial, moves: Sequence[MoveSearch]) -> float:
    """Largest contour error of a proven plan on all executed robots [m]."""
    robots = [float(x.robots.max.max()) for x in moves if x.robots is not None]
    return max(robots + [float(contour_errors(x).max()) for x in proof.pieces])


def _reduce_shape(run: Run, goal: CertificateGoal, servo: float) -> Run:
    """The run with its shape tolerances reduced by `servo`, the part of the servo [m]."""
    rounding = run.rounding
    if rounding is None or goal.tolerance is None:
        return run
    tolerance = goal.tolerance - servo
    return replace(run, rounding=replace(rounding, tolerance=tolerance))


def _make_certificate(
    base: Case, proven: Proven, shapes: Mapping[str, float], plant: RigidBodyPlant | None
) -> Certificate:
    """Evaluate a proven plan, run the experiment, and make the certificate."""
    proof, moves = proven
    case, job, chosen = proof.case, proof.case.job, proof.case.run
    case.progress(Step(("evaluation",)))
    judged = replace(chosen, limits=case.limits)
    result = evaluate_run(judged, proof.executed, case.program, case.planned.objective)
    experiment, failure = None, None
    if plant is not None:
        case.progress(Step(("experiment",)))
        try:
            experiment = simulate_rigid_bodies(
                job, chosen, proof.set_points, case.program, case.planned.objective, plant
            )
        except ExecutionError as error:
            failure = error
    assert proof.check is not None
    return Certificate(
        job=job,
        run=chosen,
        goal=case.goal,
        model=describe_model(case),
        objective=case.planned.objective,
        path=case.program,
        trajectory=proof.trajectory,
        set_points=proof.set_points,
        execution=proof.executed,
        evaluation=result,
        check=proof.check,
        contours=tuple(_make_contours(base, proof, [x for x in moves if x.number is not None])),
        uncertified=_execute_uncertified(base),
        shapes=shapes,
        experiment=experiment,
        failure=failure,
        clearance=clearance_of(job, proof.trajectory),
    )


def _make_contours(
    base: Case, proof: ProgramTrial, contours: Sequence[MoveSearch]
) -> Iterator[ContourCertificate]:
    """Make the certificates of all contours."""
    case, fastest = proof.case, base.planned.trajectory.contour_spans
    spans = proof.trajectory.contour_spans
    # An execution of nearly continuous set-points has the error of the servo without the error that
    # the cycle adds.
    run_cycle = case.run.cycle
    cycle = max(run_cycle / CONTINUOUS, min(SHORTEST, run_cycle))
    smooth = execute_trial(
        case, case.compute_set_points(proof.trajectory, cycle), max(cycle, RESOLUTION)
    )
    pieces = pieces_of(smooth, case.program, None, None)
    for k, (move, piece, span) in enumerate(zip(contours, proof.pieces, spans, strict=True)):
        assert span.work is not None
        error, coverage_error = piece.contour_error, piece.coverage_error
        nominal = max(error.max, coverage_error.max)
        worst = 0.0 if move.robots is None else float(move.robots.max.max())
        servo = max(pieces[k].contour_error.max, pieces[k].coverage_error.max)
        yield ContourCertificate(
            name=contour_called(case.program.contours[k], k),
            t=span.t,
            work=span.work,
            path=piece.path,
            joint_path=move.joint_path,
            derating=move.derating,
            factors=move.factors,
            lowered=derated_intervals(
                move.derating,
                move.factors,
                move.squares,
                move.plan,
                span.t[0],
                case.arm.joint_names,
            ),
            trajectory=move.plan,
            set_points=case.move_set_points(proof.set_points, span.t, move.plan),
            error=error,
            coverage_error=coverage_error,
            speed_ratio=float(speed_ratios(case, piece).max()),
            budget=Budget(
                rounding=shape_part(piece.path),
                servo=servo,
                sampling=nominal - servo,
                box=max(0.0, worst - nominal),
                model_error=case.model_error,
                allowed=case.goal.tolerance,
                servo_allowed=case.servo_allowed,
            ),
            optimum=fastest[k].t[1] - fastest[k].t[0],
            robots=move.robots,
            trials=move.trials,
        )


def _execute_uncertified(case: Case) -> Uncertified:
    """Execute the fastest plan without derating."""
    fastest = case.planned.trajectory
    set_points = case.compute_set_points(fastest)
    resolution = max(min(1e-3, case.run.cycle), RESOLUTION)
    executed = simulate(set_points, case.plant(), resolution=resolution)
    t = executed.t
    pieces = pieces_of(executed, case.program, None, None)
    error = ErrorProfile.join([x.contour_error for x in pieces])
    coverage_error = max(x.coverage_error.max for x in pieces)
    return Uncertified(
        duration=fastest.duration,
        contours=tuple(x.t[1] - x.t[0] for x in fastest.contour_spans),
        contour_error=(max(error.max, coverage_error), error.rms),
        saturated=executed.saturated_time / (t[-1] - t[0]),
        box=(
            None
            if case.box is None
            else max(float(x.max.max()) for x in execute_box(case, set_points))
        ),
    )


def describe_model(case: Case) -> str:
    """Description of the robot model for which a certificate is valid."""
    servo = case.servo
    held = {"linear": "interpolated linearly", "cubic": "interpolated by cubics", "step": "held"}
    parts = [
        f"independent joint servos{' of order second' * (servo.order == 'second')} with {servo}",
        f"set-points every {case.run.cycle * 1e3:g} ms, " + held[servo.interpolation],
    ]
    if np.isfinite(case.demand_bounds).any():
        parts.append("accelerations that saturate at the joints' limits")
    if case.box is not None:
        parts.append(f"and the executed robots of the box: {case.box}")
    return "; ".join(parts)


def shape_part(path: Path) -> float:
    """Bound of the distances between a path and its objective path, in both directions [m]."""
    if isinstance(path, ShapedPath):
        pairs = ((x.vertices, x.curvatures) for x in (path, path.objective))
        same = all(np.array_equal(a, b) for a, b in zip(*pairs, strict=True))
        return 0.0 if same else path.tolerance
    return path.deviation if isinstance(path, RoundedPath) else 0.0
