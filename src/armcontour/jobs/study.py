"""`run`: the whole way of a job, from its path to its contour errors.

Files are read and written by `io`; all steps between are called from here, in their order.
"""

from __future__ import annotations

from contextlib import suppress
from dataclasses import replace
from types import MappingProxyType
from typing import Any

from armcontour.control.compensation import NoCompensation
from armcontour.control.compensation.compensator import teach
from armcontour.core.errors import ExecutionError, error_context
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.jobs.experiment import build_plant
from armcontour.jobs.job import Job, Run
from armcontour.jobs.planned import Planned
from armcontour.jobs.planning import ROUNDING, SHAPING, explain_plan, plan_one
from armcontour.jobs.results import ExperimentResult, JobResult, RunResult
from armcontour.jobs.reuse import Reuse
from armcontour.motion import Execution, Method, SetPoints, Trajectory
from armcontour.planning import check_jerk_support
from armcontour.program import Program
from armcontour.simulation import RigidBodyPlant, ServoPlant, simulate
from armcontour.simulation.rigid_body_plant import require_mujoco
from armcontour.verification import Evaluation, evaluate
from armcontour.verification.clearance import Clearance

STEPS = (ROUNDING, "tracing", "timing", "clearance", "compensation", "execution", "evaluation")
TEACHING = STEPS[:5]
EXPERIMENT = "experiment"
# Largest time between two results of an execution [s], unless the drives on bodies are slower.
RESOLUTION = 1e-3


@checked
def run(job: Job, *, simulate: bool = True, progress: Progress | None = None) -> JobResult:
    """Do every run of a job, from the objective path to the evaluation.

    An experiment whose joints do not come to rest raises no error: it is the `failure` of its run.

    Args:
        job: The job.
        simulate: Whether to execute and evaluate; otherwise runs end with their set-points.
        progress: Called before each step with its names, such as ("proposed", "timing"). While a
            program is traced or planned, called again with the share that is done.

    Raises:
        ArmContourError: The error of the first run that fails.
    """
    plants = _plants(job, simulate)
    reuse, done = Reuse(len(job.runs)), dict[str, RunResult]()
    for this in job.runs:
        tell = subprogress(progress, this.name)
        with error_context(f"Run {this.name}"):
            planned = plan_one(job, this, reuse, tell)
            tell(Step(("compensation",)))
            set_points = compute_set_points(job, this, planned.trajectory)
            simulated: dict[str, Any] = {}
            if simulate:
                simulated = _simulate(job, planned, set_points, plants.get(this.name), tell)
                simulated["explanation"] = explain_plan(job, planned.trajectory, reuse)
            done[this.name] = RunResult.of(
                planned, set_points=set_points, servo=job.servo, **simulated
            )
    return JobResult(job=job, runs=MappingProxyType(done))


def _plants(job: Job, simulate: bool) -> dict[str, RigidBodyPlant]:
    """The simulated robots of the experiments, by the names of the runs.

    What is known to fail is refused before any work, which can take minutes.

    Raises:
        ArmContourError: A timing method that keeps no limits of jerk where there are some, or an
            experiment that cannot be simulated.
    """
    plants = {}
    for x in job.runs:
        with error_context(f"Run {x.name}"):
            check_jerk_support(Method.SHAPED if x.is_shaped else x.timing.method, x.limits)
            if simulate and x.experiment is not None:
                with error_context(EXPERIMENT):
                    require_mujoco()
                    plants[x.name] = build_plant(x.experiment, job.arm, job.plant_servo, x.limits)
    return plants


def _simulate(
    job: Job,
    planned: Planned,
    set_points: SetPoints,
    plant: RigidBodyPlant | None,
    progress: Progress,
) -> dict[str, Any]:
    """Fields of a `RunResult`: how the servo executes set-points, and rigid bodies if given."""
    this, path, objective = planned.run, planned.path, planned.objective
    progress(Step(("execution",)))
    executed = simulate_run(job, set_points)
    progress(Step(("evaluation",)))
    found: dict[str, Any] = {
        "execution": executed,
        "evaluation": evaluate_run(this, executed, path, objective),
        "executed_clearance": _executed_clearance(job, planned, executed),
    }
    if plant is None:
        return found
    progress(Step((EXPERIMENT,)))
    try:
        with error_context(EXPERIMENT):
            judged = simulate_rigid_bodies(job, this, set_points, path, objective, plant)
            return {**found, "experiment": judged}
    except ExecutionError as error:
        return {**found, "failure": error}


def compute_set_points(job: Job, this: Run, trajectory: Trajectory) -> SetPoints:
    """Compensate the plan of a run for the servo's delay.

    Raises:
        CompensationError: The method cannot compensate this delay.
    """
    return teach(trajectory, job.servo, this.compensation, cycle=this.cycle, arm=job.arm)


def simulate_run(job: Job, set_points: SetPoints, plant: RigidBodyPlant | None = None) -> Execution:
    """Simulate how a plant executes the set-points of a run, by default the servo of the job.

    Raises:
        ExecutionError: The joints do not come to rest.
    """
    if plant is None:
        return simulate(set_points, ServoPlant(job.arm, job.plant_servo), resolution=RESOLUTION)
    # The plant has no results between two cycles of the drives.
    return simulate(set_points, plant, resolution=max(RESOLUTION, plant.step))


def evaluate_run(this: Run, executed: Execution, path: Program, objective: Program) -> Evaluation:
    """Evaluate the executed motion of a run, with the use of its limits."""
    return evaluate(executed, path, objective=objective, until=this.until, limit_use=True)


def _executed_clearance(job: Job, found: Planned, executed: Execution) -> Clearance | None:
    """How far the arm stays from itself and from its cell when the servo executes a plan.

    Raises:
        Collision: Bodies touch, and the job does not ignore this. What only comes nearer than its
            margin is a warning, as the plan keeps the margin.
    """
    if found.clearance is None:
        return None
    near = job.cell.check(executed)
    if any(x.high <= 0 for x in near.too_near) and not job.ignore_collisions:
        with error_context("as executed"):
            near.refuse()
    return near


def simulate_rigid_bodies(
    job: Job,
    this: Run,
    set_points: SetPoints,
    path: Program,
    objective: Program,
    plant: RigidBodyPlant,
) -> ExperimentResult:
    """Execute set-points on the simulated rigid bodies of the arm.

    Args:
        job: The job.
        this: A run with an experiment.
        set_points: The set-points.
        path: The program that the tool follows.
        objective: The program with sharp corners.
        plant: The simulated robot of the run's experiment.
    """
    executed = simulate_run(job, set_points, plant)
    uncompensated = None
    if not isinstance(this.compensation, NoCompensation):
        plain = replace(this, compensation=NoCompensation())
        with suppress(ExecutionError):
            done = simulate_run(job, compute_set_points(job, plain, set_points.trajectory), plant)
            uncompensated = evaluate(done, path, until=this.until)
    return ExperimentResult(
        plant=plant,
        execution=executed,
        evaluation=evaluate_run(this, executed, path, objective),
        uncompensated=uncompensated,
    )


def steps_of(this: Run, *, simulated: bool = True) -> tuple[str, ...]:
    """Names of the steps of a run, in order."""
    steps = STEPS if simulated else TEACHING
    if this.is_shaped:
        steps = (SHAPING, *steps[1:])
    return steps if this.experiment is None or not simulated else (*steps, EXPERIMENT)
