"""`certify`: the fastest plan whose execution stays within a tolerance."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from armcontour.control.compensation import INVERSE
from armcontour.core.errors import ExecutionError, InvalidInput, NotRealizable
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.render import number
from armcontour.geometry import Path
from armcontour.jobs.alternatives import clearance_of
from armcontour.jobs.certificate_goal import CertificateGoal
from armcontour.jobs.job import (
    ARC,
    CURVATURE,
    FREE,
    TRANSITION_TOLERANCE,
    Job,
    Rounding,
    Run,
    build_plant,
    choose_run,
)
from armcontour.jobs.run_job import evaluate_run, simulate_rigid_bodies
from armcontour.jobs.run_plan import explained_reach, plan_one
from armcontour.jobs.verdict import Deviation
from armcontour.planning import Optimal, explain
from armcontour.program import Program, contour_called
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.servo import ServoModel
from armcontour.simulation import RigidBodyPlant, simulate
from armcontour.studies.certification.box_errors import bound_box
from armcontour.studies.certification.case import PROOF_RESOLUTION, Case
from armcontour.studies.certification.certificate import (
    Budget,
    Certificate,
    ContourCertificate,
    Uncertified,
)
from armcontour.studies.certification.derating import DeratedLimits, derated_intervals
from armcontour.studies.certification.derating_search import (
    AttemptVerdict,
    SearchEnded,
    search_verdict,
)
from armcontour.studies.certification.even_slowing import slow_down
from armcontour.verification.contour_errors import ContourExecution, split_by_contour
from armcontour.verification.error_profile import ErrorProfile

# A nearly continuous command has a cycle that is CONTINUOUS times shorter, but at least
# SHORTEST_CYCLE [s].
CONTINUOUS = 20
SHORTEST_CYCLE = 1e-4
# Shares of the tolerance for the servo if the goal has no servo budget. They are tried in order
# until a plan is certified.
SERVO_SHARES = (0.02, 0.06, 0.2, 0.6)
# After that, the servo budget becomes this multiple of the servo error of the found plan, while the
# plans become faster.
SERVO_MARGIN = 1.5
# The search for a servo budget ends if the budget changes by at most this fraction of the
# tolerance.
LEAST_BUDGET_CHANGE = 1e-3


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
    >>> certificate.result.evaluation.contour_error.max < 0.1e-3
    True
    >>> ac.certify(path, arm, servo, limits, goal=ac.CertificateGoal(servo_error=0.1e-3)).kept
    True

    Args:
        job: The job; or a path or a program, which then needs an arm, a servo and a goal.
        arm: The arm of the path.
        servo: The servo of the arm.
        limits: Limits that replace those of the arm.
        run: Name of the run; by default that of the goal.
        goal: The goal; by default the certificate of the job, or a tolerance equal to its
            accuracy. The corners of a path are rounded within its tolerance.
        progress: Called with a named step before every trial.

    Raises:
        InvalidInput: There is no goal, or the job has no run with this name.
        NotRealizable: No plan satisfies the goal; the message states the limiting constraint and
            remedies.
        ArmContourError: Tracing, planning or execution fails.
    """
    job = _job_of(job, arm, servo, limits, goal)
    goal = goal_of(job, run) if goal is None else goal
    chosen = _choose_run(job, goal, run)
    # The plant is built before the search, so that invalid options are reported early.
    plant = _build_plant(job, chosen)
    if goal.box is not None:
        goal.box.half_widths(job.plant_servo.for_joints(job.arm.dof), job.arm.dof)
    fastest = _find_fastest_shape(job, _certifiable(chosen), goal, subprogress(progress))
    return _make_certificate(fastest, plant)


def _job_of(
    job: Job | Path | Program,
    arm: Arm | None,
    servo: ServoModel | None,
    limits: Limits | None,
    goal: CertificateGoal | None,
) -> Job:
    """Return the job, or make the job of a path with an arm, a servo and a goal."""
    if isinstance(job, Job):
        if (arm, servo, limits) != (None, None, None):
            raise InvalidInput("A job has an arm, a servo and limits. Remove these arguments.")
        return job
    if arm is None or servo is None or goal is None:
        raise InvalidInput(
            "A certificate of a path requires an arm, a servo and a goal: certify(path, arm, "
            "servo, goal=CertificateGoal(tolerance=1e-3))."
        )
    rounding = None if goal.tolerance is None else Rounding(tolerance=goal.tolerance)
    limits = resolve_limits("certify", arm, limits)
    run = Run(name="optimal", limits=limits, rounding=rounding)
    return Job(name="path", arm=arm, path=job, servo=servo, runs=(run,))


def _choose_run(job: Job, goal: CertificateGoal, name: str | None) -> Run:
    """Choose the run of a name, or of the goal; refuse what a certificate does not support."""
    optimal = [x for x in job.runs if isinstance(x.timing, Optimal)]
    run = choose_run(job, goal.run if name is None else name, "certified", optimal)
    if run.duration is not None:
        raise InvalidInput(
            f"A certificate does not support runs with a duration, but run {run.name} has a "
            f"duration of {run.duration:g} s. Remove duration."
        )
    if run.speed_factor not in (None, 1.0):
        raise InvalidInput(
            f"A certificate is for the full speed, but run {run.name} has a speed factor of "
            f"{number(run.speed_factor, '1')}. Remove speed_factor."
        )
    if run.shaping is not None:
        run.shaping.check_jerk(run.limits)
    return run


def _build_plant(job: Job, run: Run) -> RigidBodyPlant | None:
    """Build the plant for a run's experiment; None if it has none."""
    if run.experiment is None:
        return None
    return build_plant(
        run.experiment, job.arm, job.plant_servo, run.limits, run.feeds_gravity_forward
    )


def _certifiable(run: Run) -> Run:
    """Return the run with the timing and the compensation of a certificate."""
    if run.default_compensation:
        options = replace(INVERSE, command_limits=run.compensation.command_limits)
        run = replace(run, compensation=options)
    # Derating replaces the reserve, so the reserve is not used.
    intervals = None if run.shaping is None else run.shaping.intervals
    return replace(run, timing=Optimal(intervals=intervals))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class _Found:
    """The fastest plan of a run that satisfies the goal."""

    verdict: AttemptVerdict
    uncertified: Uncertified  # The plan without derating
    # Durations of both shapes, free corners and arcs [s]; empty if only one was tried. The shape
    # that was not chosen has a lower bound of its duration.
    shapes: Mapping[str, float] = field(default_factory=dict)


def _find_fastest_shape(job: Job, run: Run, goal: CertificateGoal, report: Progress) -> _Found:
    """Find the fastest plan of a run; with free corners, arcs are tried as well."""
    shapes = [run]
    if run.rounding is not None and run.rounding.free:
        shapes.append(replace(run, rounding=run.rounding.with_arcs))
    best: _Found | None = None
    refusals: list[NotRealizable] = []
    durations: dict[str, float] = {}
    for shaped_run in shapes:
        deadline = min(durations.values(), default=np.inf)
        try:
            # The plan without derating is the reference of the certificate's cost. It is planned
            # first, because its errors, such as an event before the start, also apply to the
            # certificate.
            base = _plan_case(job, shaped_run, goal, report, 0.0)
            duration = base.planned.trajectory.duration
            found = _find_fastest(base, shaped_run) if duration < deadline else None
        except NotRealizable as error:
            refusals.append(error)
            continue
        if found is not None:
            duration = found.verdict.duration
        shape = ARC if shaped_run.rounding is None else shaped_run.rounding.shape
        durations[shape] = duration
        if found is not None and duration < deadline:
            best = found
    if best is None:
        raise refusals[-1]
    return replace(best, shapes=durations if FREE in durations else {})


def goal_of(job: Job, run: str | None, /, **overrides: Any) -> CertificateGoal:
    """Return the job's goal, or the accuracy of its runs as tolerance, with fields replaced."""
    if job.certificate is not None:
        return replace(job.certificate, **overrides)
    if overrides.get("tolerance") is None and overrides.get("servo_error") is None:
        known = [x.accuracy for x in job.runs if x.accuracy is not None and run in (None, x.name)]
        overrides["tolerance"] = min(known, default=None)
    return CertificateGoal(**overrides)


def _find_fastest(base: Case, run: Run) -> _Found:
    """Find the fastest plan of a run for a goal, over all splits of the tolerance.

    `base` is the case whose corners have the whole tolerance.
    """
    goal = base.goal
    tolerance = goal.tolerance
    uncertified = _execute_uncertified(base)
    pairs = zip(base.program.contours, base.planned.objective.contours, strict=True)
    is_rounded = any(Deviation.of_path(x.path, drawn.path).total > 0 for x, drawn in pairs)
    if tolerance is None or not is_rounded:
        # The servo may use the whole tolerance.
        case = replace(base, servo_allowed=goal.servo_error or tolerance or 0.0)
        return _Found(verdict=find_verdict(case), uncertified=uncertified)
    verdict = _split_tolerance(base, run, tolerance)
    return _Found(verdict=verdict, uncertified=uncertified)


def _plan_case(job: Job, run: Run, goal: CertificateGoal, report: Progress, servo: float) -> Case:
    """Plan the case in which corners have the tolerance that the servo does not need.

    - `servo`: part of the tolerance for the servo [m].
    """
    shaped = run
    if run.rounding is not None and goal.tolerance is not None:
        corners = goal.tolerance - servo
        if run.continuity == CURVATURE:
            # Corners leave room for transitions, which are within their own tolerance.
            corners = max(corners - TRANSITION_TOLERANCE, corners / 2)
        shaped = replace(run, rounding=replace(run.rounding, tolerance=corners))
    with explained_reach(job):
        planned = plan_one(job, shaped, report, clear=False)
    return Case(job, planned, goal, servo, report)


def _split_tolerance(base: Case, run: Run, tolerance: float) -> AttemptVerdict:
    """Find the servo budget of the fastest plan: the tolerance [m] less that of the corners.

    The first budget with a certified plan is replaced by what this plan needs, while the plans
    become faster.
    """
    goal = base.goal
    budgets = [x * tolerance for x in SERVO_SHARES]
    if goal.servo_error is not None:
        budgets = [goal.servo_error]
    largest = budgets[-1]
    fastest = None
    while budgets:
        budget = budgets.pop(0)
        is_last = fastest is None and not budgets
        try:
            case = _plan_case(base.job, run, goal, base.progress, budget)
            verdict = find_verdict(case) if is_last else search_verdict(case)
        except NotRealizable:
            if is_last:
                raise
            continue
        if fastest is not None and verdict.duration >= fastest.duration:
            break
        fastest = verdict
        # The servo gets more than its error, because another budget changes the plan.
        needed = SERVO_MARGIN * verdict.largest_error + verdict.case.model_error
        needed = min(needed, largest)
        budgets = [needed] if abs(needed - budget) > LEAST_BUDGET_CHANGE * tolerance else []
    assert fastest is not None
    return fastest


def find_verdict(case: Case) -> AttemptVerdict:
    """Find the fastest attempt that is certified; return its verdict.

    If derating does not satisfy the goal, the whole motion is slowed down evenly.

    Raises NotRealizable if no plan satisfies the goal; the message names the contour.
    """
    try:
        return search_verdict(case)
    except SearchEnded as refusal:
        return slow_down(case, refusal)


def _make_certificate(found: _Found, plant: RigidBodyPlant | None) -> Certificate:
    """Evaluate a certified plan, run the experiment, and make the certificate."""
    verdict = found.verdict
    case = verdict.case
    run = case.run
    arm = case.job.arm
    set_points = verdict.attempt.set_points
    trajectory = verdict.attempt.trajectory
    objective = case.planned.objective
    case.progress(Step(("evaluation",)))
    experiment = None
    failure = None
    if plant is not None:
        case.progress(Step(("experiment",)))
        try:
            experiment = simulate_rigid_bodies(
                case.job, run, set_points, case.program, objective, plant
            )
        except ExecutionError as error:
            failure = error
    contours = tuple(_make_contours(verdict, found.uncertified))
    derated = DeratedLimits([(x.joint_path, x.derating) for x in contours], run.limits)
    judged = replace(run, limits=case.limits)
    result = replace(
        case.planned,
        trajectory=trajectory,
        explanation=explain(trajectory, arm, constraints=[derated]),
        set_points=set_points,
        servo=case.job.servo,
        execution=verdict.executed,
        evaluation=evaluate_run(judged, verdict.executed, case.program, objective),
        experiment=experiment,
        failure=failure,
        clearance=clearance_of(case.job, trajectory),
    )
    return Certificate(
        job=case.job,
        result=result,
        goal=case.goal,
        model=describe_model(case),
        check=verdict.check,
        contours=contours,
        uncertified=found.uncertified,
        shapes=found.shapes,
    )


def _make_contours(
    verdict: AttemptVerdict, uncertified: Uncertified
) -> Iterator[ContourCertificate]:
    """Make the certificates of all contours."""
    case = verdict.case
    attempt = verdict.attempt
    continuous = _execute_continuously(verdict)
    spans = attempt.trajectory.contour_spans
    names = case.arm.joint_names
    for k, (move, piece, span) in enumerate(
        zip(attempt.contours, verdict.pieces, spans, strict=True)
    ):
        assert span.work is not None
        robots = verdict.robots[k] if verdict.robots else None
        worst = 0.0 if robots is None else robots.largest
        drawn = case.planned.objective.contours[k].path
        derating = move.derating
        yield ContourCertificate(
            name=contour_called(case.program.contours[k], k),
            t=span.t,
            work=span.work,
            path=piece.path,
            joint_path=move.joint_path,
            derating=derating,
            derated=derated_intervals(derating, move.fastest, move.plan, span.t[0], names),
            trajectory=move.plan,
            error=piece.contour_error,
            coverage_error=piece.coverage_error,
            speed_ratio=float(piece.speed_ratios(case.limits.speed, between=True).max()),
            budget=_make_budget(case, piece, continuous[k], drawn, worst),
            optimum=uncertified.contours[k],
            robots=robots,
            trials=move.trials,
        )


def _make_budget(
    case: Case, piece: ContourExecution, continuous: ContourExecution, drawn: Path, worst: float
) -> Budget:
    """Make the budget of a contour from its execution and the execution without a cycle.

    - `drawn`: the contour before rounding.
    - `worst`: largest error of the robots of the box [m]; 0 without a box.
    """
    deviation = Deviation.of_path(piece.path, drawn)
    servo = _larger_error(continuous)
    nominal = _larger_error(piece)
    return Budget(
        rounding=deviation.rounding or 0.0,
        smoothing=deviation.smoothing,
        servo=servo,
        sampling=nominal - servo,
        box=max(0.0, worst - nominal),
        model_error=case.model_error,
        allowed=case.goal.tolerance,
        servo_allowed=case.servo_allowed,
    )


def _larger_error(piece: ContourExecution) -> float:
    """Return the larger of contour error and coverage error [m]."""
    return max(piece.contour_error.max, piece.coverage_error.max)


def _execute_continuously(verdict: AttemptVerdict) -> Sequence[ContourExecution]:
    """Execute nearly continuous set-points, whose error is that of the servo without a cycle."""
    case = verdict.case
    cycle = max(case.run.cycle / CONTINUOUS, min(SHORTEST_CYCLE, case.run.cycle))
    smooth = simulate(
        case.compute_set_points(verdict.attempt.trajectory, cycle),
        case.plant(ideal=True),
        resolution=max(cycle, PROOF_RESOLUTION),
    )
    return split_by_contour(smooth, case.program, None, None)


def _execute_uncertified(case: Case) -> Uncertified:
    """Execute the fastest plan without derating."""
    fastest = case.planned.trajectory
    set_points = case.compute_set_points(fastest, saturates=True)
    resolution = max(min(1e-3, case.run.cycle), PROOF_RESOLUTION)
    executed = simulate(set_points, case.plant(), resolution=resolution)
    pieces = split_by_contour(executed, case.program, None, None)
    error = ErrorProfile.join([x.contour_error for x in pieces])
    coverage_error = max(x.coverage_error.max for x in pieces)
    return Uncertified(
        duration=fastest.duration,
        contours=tuple(x.t[1] - x.t[0] for x in fastest.contour_spans),
        contour_error=(max(error.max, coverage_error), error.rms),
        saturated=executed.saturated_time / (executed.t[-1] - executed.t[0]),
        robots=tuple(bound_box(case, set_points)),
    )


def describe_model(case: Case) -> str:
    """Describe the robot model for which a certificate is valid."""
    servo = case.servo
    order = " of order second" * (servo.order == "second")
    interpolations = {
        "linear": "interpolated linearly",
        "cubic": "interpolated by cubics",
        "step": "held",
    }
    parts = [
        f"independent joint servos{order} with {servo.describe(case.arm.chain.prismatic)}",
        f"set-points every {case.run.cycle * 1e3:g} ms, " + interpolations[servo.interpolation],
    ]
    if np.isfinite(case.servo.saturate(*case.limits.acceleration_bounds(case.arm.dof))).any():
        parts.append("accelerations that saturate at the joints' limits")
    if case.goal.box is not None:
        parts.append(f"and all robots of the box: {case.goal.box}")
    return "; ".join(parts)
