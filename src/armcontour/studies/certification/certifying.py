"""Entry point `certify`: finds the fastest plan whose execution keeps a tolerance on a model."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from concurrent.futures import Executor
from contextlib import suppress
from dataclasses import fields, replace
from typing import Any

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import ExecutionError, InvalidInput, NotRealizable
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.text import count_kinds
from armcontour.geometry import Path, RoundedPath, ShapedPath
from armcontour.jobs.alternatives import clearance_of
from armcontour.jobs.experiment import build_plant
from armcontour.jobs.goal import CertificateGoal
from armcontour.jobs.job import ARC, FREE, Job, Run, choose_run
from armcontour.jobs.reuse import Reuse
from armcontour.jobs.run_plan import plan_one
from armcontour.jobs.study import evaluate_run, simulate_rigid_bodies
from armcontour.motion import Method, SetPoints
from armcontour.planning import Optimal, check_jerk_support
from armcontour.program import Contour, Dwell, Event, Program, Rapid, contour_called
from armcontour.simulation import RigidBodyPlant, simulate
from armcontour.simulation.robustness.monte_carlo import spans_of
from armcontour.simulation.robustness.uncertainty import Uncertainty, Unknowns
from armcontour.studies.certification import _bodies
from armcontour.studies.certification._case import Case
from armcontour.studies.certification._moves import Move
from armcontour.studies.certification._search import execute_servos, search
from armcontour.studies.certification._uses import Trial, distances, run, speed_ratios
from armcontour.studies.certification.certificate import (
    Budget,
    Certificate,
    ContourCertificate,
    Uncertified,
)
from armcontour.studies.certification.lowering import find_lowered
from armcontour.verification.contour_execution import pieces_of
from armcontour.verification.error_profile import ErrorProfile

# A cycle this many times shorter counts as continuous; it is at least SHORTEST [s].
CONTINUOUS = 20
SHORTEST = 1e-4
# Shares of a total tolerance that the servo gets if the goal has no budget for the servo. They are
# tried in order until a plan is certified, and further while the error uses NEAR of its budget and
# the plan gets faster. The unused part goes to the shape.
SERVO_SHARES = (0.02, 0.06, 0.2, 0.6)
NEAR = 0.9
# When the unused part goes to the shape, the servo keeps this many times the part that it needed,
# because the plan changes a little; more if no faster plan is found with the first of them.
KEPT_FOR_SERVO = (1.5, 6.0)
# Paths are not rounded or shaped again for less than this share of the tolerance.
LEAST_GAIN = 1e-3


# A proven plan of a program, and its moves in the search.
Proven = tuple[Trial, list[Move]]


@checked
def certify(
    job: Job,
    run: str | None = None,
    *,
    goal: CertificateGoal | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Certificate:
    """Find the fastest plan of a job whose execution keeps its tolerance.

    Whatever timing the run has, the plan is an optimal one, derated where needed.
    Compensation, cycle and limits are those of the run. The certificate is valid for the
    job's plant: its servos, or its rigid bodies if the goal says so, and for no other model.

    >>> certificate = ac.certify(ac.read_job("job.yaml"))
    >>> certificate.evaluation.contour_error.max < 0.1e-3
    True

    Args:
        job: The job.
        run: Name of the run; by default that of the goal.
        goal: The goal; by default the certificate of the job.
        executor: An executor that executes robots of the box as rigid bodies, such as a
            `concurrent.futures.ProcessPoolExecutor`; by default processes of this machine do.
        progress: Called with a step, which has a few words as its name, before every trial.

    Raises:
        InvalidInput: There is no goal, or no such run.
        NotRealizable: No plan keeps the goal; the message says what binds and what would help.
        ArmContourError: Tracing, planning or execution fails.
    """
    goal = goal_of(job) if goal is None else goal
    this = run_of(job, goal.run if run is None else run)
    if this.duration is not None:
        raise InvalidInput(
            f"Run {this.name} has a duration of {this.duration:g} s, which a certified plan does "
            "not take: leave duration out."
        )
    if this.rounding is not None and this.rounding.free:
        check_jerk_support(Method.SHAPED, this.limits)
    plant = None
    if this.experiment is not None:
        # What refuses the robot of the experiment is said before the search.
        plant = build_plant(this.experiment, job.arm, job.plant_servo, this.limits)
    if goal.box is not None and goal.plant == "servo":
        # So is what does not fit the box.
        spans_of(goal.box, job.plant_servo.for_joints(job.arm.dof), job.arm, this.cycle)
    # A certified plan derates what it has to, so it leaves no reserve.
    free = this.rounding is not None and this.rounding.free
    intervals = this.timing.intervals if free and isinstance(this.timing, Optimal) else None
    this = replace(this, timing=Optimal(intervals=intervals))
    tell, shapes = subprogress(progress), [this]
    if free and this.rounding is not None:
        shapes.append(replace(this, rounding=this.rounding.with_arcs))
    best: tuple[Case, Proven] | None = None
    refusal: NotRealizable | None = None
    durations: dict[str, float] = {}
    for each in shapes:
        deadline = min(durations.values(), default=np.inf)
        try:
            case, proven, least = _fastest(job, each, goal, executor, tell, deadline)
        except NotRealizable as error:
            refusal = error
            continue
        durations[ARC if each.rounding is None else each.rounding.shape] = least
        if proven is not None and least < deadline:
            best = case, proven
    if best is None:
        assert refusal is not None
        raise refusal
    return _certificate(*best, durations if FREE in durations else {}, plant)


def goal_of(job: Job, **overrides: Any) -> CertificateGoal:
    """Make the goal of a certificate: that of the job, with some fields replaced.

    Raises:
        InvalidInput: There is no goal, or a goal has no field of a given name.
    """
    known = tuple(x.name for x in fields(CertificateGoal))
    for name in overrides:
        checks.check_choice("An option of certify", name, known)
    if job.certificate is None:
        return CertificateGoal(**overrides)
    return replace(job.certificate, **overrides)


def run_of(job: Job, name: str | None) -> Run:
    """Find the run of a name, or else the only run with the timing optimal.

    Raises:
        InvalidInput: There is no such run, or more than one.
    """
    return choose_run(
        job, name, "certified", [x for x in job.runs if isinstance(x.timing, Optimal)]
    )


def _fastest(
    job: Job,
    this: Run,
    goal: CertificateGoal,
    executor: Executor | None,
    tell: Progress,
    deadline: float,
) -> tuple[Case, Proven | None, float]:
    """Find the fastest plan of a run that keeps the goal, whatever its path's part of a tolerance.

    Args:
        job: The job.
        this: The run.
        goal: The goal.
        executor: Executor of robots of a box as rigid bodies.
        tell: Called with a step before each trial.
        deadline: Duration of a known plan [s]; slower programs are not searched.

    Returns:
        The case with the whole tolerance for the shape, the plan, and its duration [s]. If no plan
        is faster than the deadline, None and the duration of the fastest one with nothing derated.

    Raises:
        NotRealizable: No plan keeps the goal.
    """

    def case_of(servo: float) -> Case:
        shaped = _with_shape(this, goal, servo)
        planned = plan_one(job, shaped, reuse, tell, clear=False)
        return Case(job, planned, goal, servo, tell, executor)

    reuse = Reuse()
    # The certificate says what it costs compared to this plan. It comes first, since what refuses
    # it, such as an event before the start, would refuse the certificate at its end.
    base = case_of(0.0)
    least = base.planned.trajectory.duration
    if base.bodies:
        _refuse_other_programs(base)
        _refuse_start(base)
    free = this.rounding is not None and this.rounding.free
    bent = free or any(shape_part(x.path) > 0 for x in base.program.contours)
    if goal.tolerance is None or not bent:
        budget = goal.servo_error or goal.tolerance
        assert budget is not None
        if least >= deadline:
            return base, None, least
        alone = search(replace(base, servo_allowed=budget))
        return base, alone, alone[0].trajectory.duration
    tightest = _tightest(this, goal)
    budgets = (
        [x * tightest for x in SERVO_SHARES] if goal.servo_error is None else [goal.servo_error]
    )
    if np.isfinite(deadline):
        least = min(least, *(case_of(x).planned.trajectory.duration for x in budgets))
        if least >= deadline:
            return base, None, least
    best: Proven | None = None
    for budget in budgets:
        try:
            found = search(case_of(budget))
        except NotRealizable:
            if best is not None:
                break
            if budget == budgets[-1]:
                raise
            continue
        if best is not None and found[0].trajectory.duration >= best[0].trajectory.duration:
            break
        best = found
        if _worst(*best) + best[0].case.model_error < NEAR * budget:
            break
    assert best is not None
    # What the servo does not need goes to the shape, if the plan gets faster.
    for factor in KEPT_FOR_SERVO:
        case = best[0].case
        needed = factor * _worst(*best) + case.model_error
        if needed > case.servo_allowed - LEAST_GAIN * tightest:
            break
        with suppress(NotRealizable):
            better = search(case_of(needed))
            if better[0].trajectory.duration < best[0].trajectory.duration:
                best = better
                break
    return base, best, best[0].trajectory.duration


def _worst(proof: Trial, moves: Sequence[Move]) -> float:
    """Largest contour error of a proven plan, over the box if there is one [m]."""
    robots = [x for y in moves for x in (y.corners, y.spread) if x is not None]
    largest = [float(distances(x).max()) for x in proof.pieces]
    return max(largest + [float(x.max.max()) for x in robots])


def _tightest(this: Run, goal: CertificateGoal) -> float:
    """The smallest tolerance that shape and servo share [m]."""
    assert goal.tolerance is not None
    line = None if this.rounding is None else this.rounding.line_tolerance
    return goal.tolerance if line is None else min(line, goal.tolerance)


def _with_shape(this: Run, goal: CertificateGoal, servo: float) -> Run:
    """The run with the tolerances for the shape that the servo's part leaves [m]."""
    rounding = this.rounding
    if rounding is None or goal.tolerance is None:
        return this
    most = goal.tolerance - servo
    single = {k: min(x, most) for k, x in (rounding.at or {}).items()} or None
    line = None if rounding.line_tolerance is None else _tightest(this, goal) - servo
    shape = replace(rounding, tolerance=most, at=single, line_tolerance=line)
    return replace(this, rounding=shape)


def _refuse_other_programs(case: Case) -> None:
    """Refuse a program that certificates on rigid bodies are not made for.

    Raises:
        InvalidInput: The program has several contours, rapids or events between, or the arm or
            the servo has no rigid bodies.
    """
    program = case.program
    others = [x for x in program.moves if not isinstance(x, Contour | Dwell)]
    if len(program.contours) > 1 or others:
        raise InvalidInput(
            "A certificate on rigid bodies is for one contour, with or without dwells, but "
            f"this program has {_list_moves(program)}, or certify with plant: servo."
        )
    Unknowns.from_uncertainty(case.box or Uncertainty(), case.arm, case.servo)
    case.plant()


def _refuse_start(case: Case) -> None:
    """Refuse rigid bodies that do not rest where the contour starts.

    Raises:
        ExecutionError: Their drives cannot hold them there, or do not settle.
        NotRealizable: They rest too far from it.
    """
    (contour,) = case.program.contours
    off = _bodies.rest_at_start(
        case, contour.path, case.compute_set_points(case.planned.trajectory)
    )
    allowed = case.goal.servo_error or case.goal.tolerance
    assert allowed is not None
    work = case.work_of(contour)
    if (work is None or work[0] <= 0) and off > allowed:
        raise NotRealizable(
            f"At rest at the start of its path the tool is {off * 1e3:.4g} mm from it, since "
            f"gravity is not fed forward, and {allowed * 1e3:.4g} mm is allowed: feed gravity "
            "forward (gravity_feedforward: true), raise kp, or allow more.",
            limit="contour error",
            needed=off,
            allowed=allowed,
        )


def _certificate(
    base: Case, found: Proven, shapes: Mapping[str, float], plant: RigidBodyPlant | None
) -> Certificate:
    """Evaluate a proven plan as a whole, run the experiment, and make the certificate."""
    proof, moves = found
    case, job, this = proof.case, proof.case.job, proof.case.run
    case.progress(Step(("evaluation",)))
    judged = replace(this, limits=case.limits)
    result = evaluate_run(judged, proof.executed, case.program, case.planned.objective)
    experiment, failure = None, None
    if plant is not None:
        case.progress(Step(("experiment",)))
        try:
            experiment = simulate_rigid_bodies(
                job, this, proof.set_points, case.program, case.planned.objective, plant
            )
        except ExecutionError as error:
            failure = error
    assert proof.check is not None
    return Certificate(
        job=job,
        run=this,
        goal=case.goal,
        model=model_of(case),
        objective=case.planned.objective,
        path=case.program,
        trajectory=proof.trajectory,
        set_points=proof.set_points,
        execution=proof.executed,
        evaluation=result,
        check=proof.check,
        contours=tuple(_contours(base, proof, [x for x in moves if x.number is not None])),
        rapids=tuple(x.factors for x in moves if x.number is None),
        uncertified=_uncertified(base),
        shapes=shapes,
        experiment=experiment,
        failure=failure,
        clearance=clearance_of(job, proof.trajectory),
    )


def _contours(base: Case, proof: Trial, contours: Sequence[Move]) -> Iterator[ContourCertificate]:
    """The certificates of all contours."""
    case, fastest = proof.case, base.planned.trajectory.contour_spans
    spans = proof.trajectory.contour_spans
    # Nearly continuous set-points show the part of the servo.
    own = case.run.cycle
    cycle = max(own / CONTINUOUS, min(SHORTEST, own))
    smooth = run(
        case, case.compute_set_points(proof.trajectory, cycle), max(cycle, case.resolution)
    )
    pieces = pieces_of(smooth, case.program, None, None)
    for k, (x, piece, span) in enumerate(zip(contours, proof.pieces, spans, strict=True)):
        assert span.work is not None
        error, coverage_error = piece.contour_error, piece.coverage_error
        nominal = max(error.max, coverage_error.max)
        worst = [float(y.max.max()) for y in (x.corners, x.spread) if y is not None]
        servo = max(pieces[k].contour_error.max, pieces[k].coverage_error.max)
        yield ContourCertificate(
            name=contour_called(case.program.contours[k], k),
            t=span.t,
            work=span.work,
            path=piece.path,
            joint_path=x.joint_path,
            derating=x.derating,
            factors=x.factors,
            lowered=find_lowered(
                x.derating, x.factors, x.squares, x.plan, span.t[0], case.arm.joint_names
            ),
            trajectory=x.plan,
            set_points=case.stretch(proof.set_points, span.t, x.plan),
            error=error,
            coverage_error=coverage_error,
            speed_ratio=float(speed_ratios(case, piece).max()),
            budget=Budget(
                rounding=shape_part(piece.path),
                servo=servo,
                sampling=nominal - servo,
                box=max(0.0, *(y - nominal for y in worst), 0.0),
                model_error=case.model_error,
                allowed=case.goal.tolerance,
                servo_allowed=case.servo_allowed,
            ),
            optimum=fastest[k].t[1] - fastest[k].t[0],
            corners=x.corners,
            spread=x.spread,
            trials=x.trials,
        )


def _uncertified(case: Case) -> Uncertified:
    """Execute the fastest plan, with nothing derated."""
    fastest = case.planned.trajectory
    set_points = case.compute_set_points(fastest)
    resolution = max(min(1e-3, case.run.cycle), case.resolution)
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
        box=_worst_of_box(case, set_points),
    )


def _worst_of_box(case: Case, set_points: SetPoints) -> float | None:
    """Largest contour error in the corners of the box [m]; None without one."""
    if case.box is None:
        return None
    if case.bodies:
        corners, _ = _bodies.worst_corners(case, set_points)
        return float(
            _bodies.largest_errors(case, set_points, list(corners[: _bodies.FIRST]))[1].max()
        )
    spans = set_points.trajectory.contour_spans
    robots = (execute_servos(case, set_points, k, x) for k, x in enumerate(spans))
    return max(float(x.max.max()) for x in robots)


def model_of(case: Case) -> str:
    """The model of the robot for which a certificate is valid, in words."""
    servo = case.servo
    held = {"linear": "interpolated linearly", "cubic": "interpolated by cubics", "step": "held"}
    if case.bodies:
        return _model_of_bodies(case, held[servo.interpolation])
    parts = [
        f"independent joint servos{' of order second' * (servo.order == 'second')} with {servo}",
        f"set-points every {case.run.cycle * 1e3:g} ms, " + held[servo.interpolation],
    ]
    if np.isfinite(case.demand_bounds).any():
        parts.append("accelerations that saturate at the joints' limits")
    if case.box is not None:
        parts.append("and every such robot of the box that was executed")
    return "; ".join(parts)


def _model_of_bodies(case: Case, held: str) -> str:
    """The model of rigid bodies for which a certificate is valid, in words."""
    fed = case.drive_options.get("gravity_feedforward", True)
    parts = [
        f"the rigid bodies of {case.arm.name} with {case.servo}, simulated by MuJoCo",
        f"set-points every {case.run.cycle * 1e3:g} ms, {held}",
    ]
    if case.box is None:
        parts.append("gravity fed forward" if fed else "gravity not fed forward")
        return "; ".join(parts)
    if fed:
        weighed = "of the true payload" if case.box.payload_known else "of the nominal payload"
        parts.append(f"gravity {weighed} fed forward")
    parts.append("and every such robot of the box that was executed")
    return "; ".join(parts)


def shape_part(path: Path) -> float:
    """Bound of the distance of a path from its objective path, in either direction [m]."""
    if isinstance(path, ShapedPath):
        pairs = ((x.vertices, x.curvatures) for x in (path, path.objective))
        same = all(np.array_equal(a, b) for a, b in zip(*pairs, strict=True))
        return 0.0 if same else path.tolerance
    if not isinstance(path, RoundedPath) or not len(path.corners):
        return 0.0
    return float(path.corners.error.max())


def _list_moves(program: Program) -> str:
    """List the moves of a program, and state which to remove so that one contour remains."""
    kinds = {"contour": Contour, "rapid": Rapid, "dwell": Dwell, "event": Event}
    counts = {word: sum(isinstance(x, kind) for x in program.moves) for word, kind in kinds.items()}
    leave = []
    if counts["rapid"]:
        leave.append("process.approach and process.retract")
    mend = f"leave out {' and '.join(leave)}" if leave else ""
    if counts["contour"] > 1 or not leave:
        mend = "make a job of each contour" + (f", {mend}" if mend else "")
    return f"{count_kinds(counts)}: {mend}"
