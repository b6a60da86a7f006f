"""`run`: executes all steps of a job, from its path to its contour errors."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType

import numpy as np

from armcontour.control.compensation import NoCompensation
from armcontour.control.compensation.compensator import unchecked_set_points
from armcontour.core.checks import FloatArray, comparable
from armcontour.core.errors import ArmContourError, ExecutionError, error_context
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.jobs.command_velocity import command_velocity, exceeded_command_velocity
from armcontour.jobs.job import Experiment, Job, Run, build_plant
from armcontour.jobs.program_points import program_points
from armcontour.jobs.run_notes import sample_rates
from armcontour.jobs.run_plan import ROUNDING_STEP, explain_plan, explained_reach, plan_one
from armcontour.jobs.run_record import ExpectedErrors, ExperimentResult
from armcontour.jobs.run_result import JobResult, RunResult
from armcontour.motion import Execution, SetPoints, Trajectory
from armcontour.program import Program
from armcontour.robot.servo.model import TRUSTED
from armcontour.simulation import RigidBodyPlant, ServoPlant, simulate
from armcontour.simulation.mujoco_model import import_mujoco
from armcontour.verification import Evaluation, evaluate
from armcontour.verification.clearance import Clearance
from armcontour.verification.unknown_gains import (
    UNKNOWN_SHARE,
    UnknownGains,
    worst_with_other_gains,
)

STEPS = (ROUNDING_STEP, "tracing", "timing", "clearance", "compensation", "execution", "evaluation")
EXPERIMENT = "experiment"
# Runs with equal values of these fields have the same plan.
PLAN_FIELDS = "limits", "timing", "rounding", "end_time", "speed_factor"
# Maximum time between two samples of a simulation [s], unless the drive cycle is longer.
SIMULATION_INTERVAL = 1e-3


@checked
def run(job: Job, *, simulate: bool = True, progress: Progress | None = None) -> JobResult:
    """Execute every run of a job, from the objective path to the evaluation.

    If the joints of an experiment do not come to rest, the error is the `failure` of its run.

    >>> result = ac.run(ac.read_job("job.yaml"))
    >>> list(result.runs)
    ['only']

    Args:
        job: The job.
        simulate: Whether to execute and evaluate; otherwise runs end with their set-points.
        progress: Called before each step with its names, such as ("proposed", "timing"). While a
            program is traced, planned or evaluated, called again after every contour with its
            number and the fraction that is done.

    Raises:
        ArmContourError: The error of the first run that fails.
    """
    plants = _plants(job, simulate)
    done = dict[str, RunResult]()
    for each in job.runs:
        report = subprogress(progress, each.name)
        with error_context(f"Run {each.name}"):
            planned = _plan(job, job.as_sent(each), list(done.values()), report)
            plant = plants.get(each.name)
            done[each.name] = _execute(job, planned, plant, report, simulate=simulate)
    return JobResult(job=job, runs=MappingProxyType(done))


def complete_run(job: Job, unchecked: RunResult, progress: Progress | None = None) -> RunResult:
    """Execute the rest of a run as `run` does: check its plan for collisions, and simulate it.

    - `job`: the job, with only this run; it is not resumed.
    - `unchecked`: the plan of `plan_one` without a check of collisions.
    """
    plants = _plants(job, True)
    (run,) = job.runs
    report = subprogress(progress, run.name)
    with error_context(f"Run {run.name}"):
        with explained_reach(job):
            planned = plan_one(job, job.as_sent(run), report, unchecked=unchecked)
        return _execute(job, planned, plants.get(run.name), report)


def _execute(
    job: Job,
    planned: RunResult,
    plant: RigidBodyPlant | None,
    progress: Progress,
    *,
    simulate: bool = True,
) -> RunResult:
    """Add what is sent to controllers to the plan of a run, and what they execute.

    Only set-points are simulated. Controllers of programs have no servo that could be simulated.

    - `plant`: simulated robot of the experiment; None without one.
    - `simulate`: whether set-points are simulated.
    """
    planned = with_program(job, planned)
    progress(Step(("compensation",)))
    set_points = compute_set_points(job, planned.run, planned.trajectory)
    if planned.sends_set_points:
        result = replace(planned, set_points=set_points, servo=job.servo)
        return _simulate(job, result, plant, progress) if simulate else result
    explanation = planned.explanation
    if simulate and explanation is None:
        explanation = explain_plan(job, planned, progress)
    return replace(planned, set_points=set_points, explanation=explanation)


def with_program(job: Job, planned: RunResult) -> RunResult:
    """Return the plan of a run with the points of the job's programs."""
    unsent = replace(planned, program=None)
    program = program_points(job, planned.run, planned.trajectory, unsent.verdict.allowed)
    return replace(planned, program=program)


def _plan(job: Job, run: Run, done: Sequence[RunResult], progress: Progress) -> RunResult:
    """Plan a run, or take the plan of an earlier run with the same limits, timing and rounding."""
    for earlier in done:
        if all(
            comparable(getattr(run, x)) == comparable(getattr(earlier.run, x)) for x in PLAN_FIELDS
        ) and _has_command_velocity(job, run, earlier):
            return replace(earlier, run=run, experiment=None, failure=None)
    with explained_reach(job):
        return plan_one(job, run, progress)


def _has_command_velocity(job: Job, run: Run, earlier: RunResult) -> bool:
    """Return whether an earlier plan has the same bounds of set-point velocities as this run."""
    if earlier.command_velocity is None:
        return exceeded_command_velocity(job, run, earlier.trajectory) is None
    return command_velocity(job, run) == earlier.command_velocity


def _plants(job: Job, simulate: bool) -> dict[str, RigidBodyPlant]:
    """Build the simulated robots of the experiments, by name of the run."""
    # All runs are checked before the first one is planned, because planning can take minutes.
    plants = {}
    for run in map(job.as_sent, job.runs):
        with error_context(f"Run {run.name}"):
            (run.shaping or run.timing).check_jerk(run.limits)
            if simulate and run.experiment is not None:
                with error_context(EXPERIMENT):
                    import_mujoco()
                    fed = run.feeds_gravity_forward
                    plants[run.name] = build_plant(
                        run.experiment, job.arm, job.plant_servo, run.limits, fed
                    )
    return plants


def _simulate(
    job: Job, planned: RunResult, plant: RigidBodyPlant | None, progress: Progress
) -> RunResult:
    """Simulate the set-points with the servo model and, if given, with `plant`."""
    run = planned.run
    path = planned.path
    objective = planned.objective
    progress(Step(("execution",)))
    executed = simulate_run(job, planned.set_points)
    progress(Step(("evaluation",)))
    evaluation = evaluate_run(run, executed, path, objective, progress)
    expected = expect_errors(job, run, executed, path, evaluation)
    unknown_gains = None
    # The logs of an identified servo tell how much the robot differs.
    if expected is None and not run.for_bodies:
        # A robot with other gains may be impossible, next to the largest gains of a servo.
        with suppress(ArmContourError):
            unknown_gains = estimate_unknown_gains(job, run, executed, path, evaluation)
    explanation = planned.explanation or explain_plan(job, planned, progress)
    progress(Step(("clearance",)))
    result = replace(
        planned,
        execution=executed,
        evaluation=evaluation,
        expected=expected,
        unknown_gains=unknown_gains,
        executed_clearance=_executed_clearance(job, planned, executed),
        explanation=explanation,
    )
    if plant is None:
        return result
    progress(Step((EXPERIMENT,)))
    try:
        with error_context(EXPERIMENT):
            judged = simulate_rigid_bodies(job, run, planned.set_points, path, objective, plant)
            return replace(result, experiment=judged)
    except ExecutionError as error:
        return replace(result, failure=error)


def compute_set_points(job: Job, run: Run, trajectory: Trajectory) -> SetPoints:
    """Compute the set-points of a plan with the compensation of the run, for all its targets."""
    return unchecked_set_points(
        trajectory,
        job.servo,
        run.compensation,
        cycle=run.cycle,
        arm=job.arm,
        rule=job.rule(run, trajectory.limits_for(None)),
    )


def simulate_run(job: Job, set_points: SetPoints, plant: RigidBodyPlant | None = None) -> Execution:
    """Simulate the execution of set-points; the default plant is the servo model of the job."""
    if plant is None:
        return simulate(
            set_points, ServoPlant(job.arm, job.plant_servo), resolution=SIMULATION_INTERVAL
        )
    # The resolution is at least the drive cycle, because the plant has no results within a cycle.
    return simulate(set_points, plant, resolution=max(SIMULATION_INTERVAL, plant.step))


def simulate_experiment(
    job: Job, run: Run, set_points: SetPoints, experiment: Experiment | None
) -> Execution:
    """Simulate set-points on the rigid bodies of an experiment, or with the servo model if None."""
    if experiment is None:
        return simulate_run(job, set_points)
    plant = build_plant(experiment, job.arm, job.plant_servo, run.limits, run.feeds_gravity_forward)
    return simulate_run(job, set_points, plant)


def evaluate_run(
    run: Run,
    executed: Execution,
    path: Program,
    objective: Program,
    progress: Progress | None = None,
) -> Evaluation:
    """Evaluate the executed motion of a run: contour errors and use of limits."""
    return evaluate(
        executed,
        path,
        objective=objective,
        end_time=run.end_time,
        limit_use=True,
        progress=progress,
    )


def expect_errors(
    job: Job, run: Run, executed: Execution, path: Program, evaluation: Evaluation
) -> ExpectedErrors | None:
    """Estimate the robot's contour errors; None if the logs do not support an estimate.

    `executed`, `evaluation`: simulation with the servo model, and its evaluation.
    """
    servo = job.servo
    plan = executed.set_points.trajectory
    unexplained = evaluation.model_error
    ratio = servo.contour_ratio
    program_ratio = ratio if servo.program_ratio is None else servo.program_ratio
    is_similar = servo.is_similar(*sample_rates(plan))
    if not run.compensation.compensates or not is_similar:
        return None
    if ratio is None or ratio > TRUSTED or unexplained is None:
        return None
    assert program_ratio is not None
    uncompensated = _simulate_uncompensated(job, run, plan, path, None)
    # The offset is an error at rest, which remains with any compensation.
    with_offset = replace(executed, q=executed.q + servo.offset, plant=None)
    static = evaluate(with_offset, path, end_time=run.end_time)
    worst = evaluation.contour_error.max + unexplained[1]
    pairs = zip(uncompensated.contours, static.contours, strict=True)
    contours = tuple(min(math.hypot(program_ratio * x.max, y.max), worst) for x, y in pairs)
    return ExpectedErrors(contours=contours, worst=worst)


def estimate_unknown_gains(
    job: Job, run: Run, executed: Execution, path: Program, evaluation: Evaluation
) -> UnknownGains | None:
    """Estimate the contour error if the gains of the joints differ; None if that is impossible.

    `executed`, `evaluation`: simulation with the servo model of the job, and its evaluation.
    """
    servo = job.plant_servo
    set_points = executed.set_points
    gains = {
        name: values
        for name, values in (("kp", servo.kp), ("kv", servo.kv))
        if values is not None and np.isfinite(values).any()
    }
    if servo.order == "unknown" or not gains:
        return None

    def execute(changed: Mapping[str, FloatArray]) -> Execution:
        """Simulate a robot with other gains."""
        plant = ServoPlant(job.arm, servo.replace(**changed))
        # Times between set-points add little to an estimate.
        return simulate(set_points, plant, resolution=set_points.cycle)

    spreads = {"kp": servo.kp_spread, "kv": servo.kv_spread}
    measured = any(spreads[name] is not None for name in gains)
    shares = {name: spreads[name] or UNKNOWN_SHARE for name in gains}
    others = [execute({name: (1.0 + shares[name]) * x}) for name, x in gains.items()]
    found = worst_with_other_gains(executed, others, evaluation.contour_error, shares, measured)
    if found is None or not found.saturates:
        return found
    for signs in (found.signs, -found.signs):
        pairs = zip(gains.items(), signs, strict=True)
        robot = execute({name: (1.0 + shares[name] * sign) * x for (name, x), sign in pairs})
        error = evaluate(robot, path, end_time=run.end_time).contour_error
        if error.max > found.max:
            found = replace(found, max=error.max, t_max=error.t_max)
    return found


def _simulate_uncompensated(
    job: Job, run: Run, plan: Trajectory, path: Program, plant: RigidBodyPlant | None
) -> Evaluation:
    """Simulate a plan without compensation, and evaluate it."""
    uncompensated_run = replace(run, compensation=NoCompensation())
    set_points = compute_set_points(job, uncompensated_run, plan)
    executed = simulate_run(job, set_points, plant)
    return evaluate(executed, path, end_time=run.end_time)


def _executed_clearance(job: Job, planned: RunResult, executed: Execution) -> Clearance | None:
    """Check the clearance of the executed motion; None if the plan was not checked.

    Raises Collision if bodies touch.
    """
    if planned.clearance is None:
        return None
    clearance = job.cell.check(executed)
    if any(x.high <= 0 for x in clearance.too_near):
        with error_context("as executed"):
            clearance.refuse()
    return clearance


def simulate_rigid_bodies(
    job: Job,
    run: Run,
    set_points: SetPoints,
    path: Program,
    objective: Program,
    plant: RigidBodyPlant,
) -> ExperimentResult:
    """Simulate set-points with rigid bodies, and the same plan without compensation."""
    executed = simulate_run(job, set_points, plant)
    uncompensated = None
    if run.compensation.compensates:
        with suppress(ExecutionError):
            plan = set_points.trajectory
            uncompensated = _simulate_uncompensated(job, run, plan, path, plant)
    return ExperimentResult(
        plant=plant,
        execution=executed,
        evaluation=evaluate_run(run, executed, path, objective),
        uncompensated=uncompensated,
    )
