"""`run`: the whole way of a job, from its path to its contour errors.

Files are read and written by `io`; all steps between are called from here, in their order.
"""

from __future__ import annotations

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import fields, replace
from types import MappingProxyType
from typing import Any

import numpy as np

from armcontour._progress import Progress, Step, under
from armcontour.arms import Limits, compare_limits
from armcontour.clearance import Clearance
from armcontour.compensation import NoCompensation
from armcontour.compensation.compensator import teach
from armcontour.core.fields import checked
from armcontour.errors import ExecutionError, locate_errors
from armcontour.evaluation import Evaluation, evaluate
from armcontour.execution import ServoPlant, execute
from armcontour.execution.rigid_body_plant import refuse_without_mujoco
from armcontour.jobs.experiment import build_plant
from armcontour.jobs.job import Job, Run
from armcontour.jobs.programs import programs_of, trace_run
from armcontour.jobs.results import ExperimentResult, RunResult, Study
from armcontour.jobs.warnings import collect_warnings
from armcontour.jobs.ways import (
    clearance_of,
    reach_told,
    refuse_collision,
    ways,
)
from armcontour.motion import Execution, Method, TaughtData, Trajectory
from armcontour.program import Program
from armcontour.servo import ServoModel
from armcontour.timing import Explanation, Optimal, Tracing, explain, plan, refuse_unkept_jerk

STEPS = (
    "rounding",
    "tracing",
    "timing",
    "clearance",
    "compensation",
    "execution",
    "evaluation",
)
TEACHING = STEPS[:5]
EXPERIMENT = "experiment"
# Takes the place of rounding where corners have the shape free.
SHAPING = "shaping"
# What runs share that differ only after their plans.
PLANNED = ("objective", "path", "trajectory", "traced", "exceeded", "clearance", "avoided")
# Largest time between two results of an execution [s], unless the drives on bodies are slower.
RESOLUTION = 1e-3


@checked
def run(job: Job, *, simulate: bool = True, progress: Progress | None = None) -> Study:
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
    refuse_impossible(job, simulate=simulate)
    done: dict[str, RunResult] = {}
    for this in job.runs:
        tell = under(progress, this.name)
        with locate_errors(f"Run {this.name}"):
            done[this.name] = run_one(job, this, list(done.values()), tell, simulate=simulate)
    return Study(job=job, runs=MappingProxyType(done))


def refuse_impossible(job: Job, *, simulate: bool = True) -> None:
    """Refuse what is known to fail before any work, which can take minutes.

    Raises:
        ArmContourError: A timing method that keeps no limits of jerk where there are some, or an
            experiment that cannot be simulated.
    """
    for x in job.runs:
        with locate_errors(f"Run {x.name}"):
            free = x.rounding is not None and x.rounding.free
            refuse_unkept_jerk(Method.SHAPED if free else x.timing.method, x.limits)
            if simulate and x.experiment is not None:
                with locate_errors(EXPERIMENT):
                    refuse_without_mujoco()
                    build_plant(x.experiment, job.arm, job.plant_servo, x.limits)


def run_one(
    job: Job, this: Run, earlier: Sequence[RunResult], progress: Progress, *, simulate: bool = True
) -> RunResult:
    """Do one run, from its objective path to its evaluation and its warnings.

    Args:
        job: The job.
        this: The run.
        earlier: Results of earlier runs of the job, whose plans it may share.
        progress: Called with each step.
        simulate: As in `run`.

    Raises:
        ArmContourError: A step fails.
    """
    found = _do_steps(job, this, earlier, progress, simulate=simulate)
    return replace(found, warnings=collect_warnings(found))


def _do_steps(
    job: Job, this: Run, earlier: Sequence[RunResult], progress: Progress, *, simulate: bool
) -> RunResult:
    """The result of `run_one` without its warnings."""
    found = plan_one(job, this, earlier, progress)
    progress(Step(("compensation",)))
    found = replace(found, taught=teach_run(job, this, found.trajectory), servo=job.servo)
    if not simulate:
        return found
    progress(Step(("execution",)))
    executed = execute_run(job, this, found.taught)
    progress(Step(("evaluation",)))
    found = replace(
        found,
        explanation=explain_run(job, this, found.trajectory),
        execution=executed,
        evaluation=evaluate_run(this, executed, found.path, found.objective),
        executed_clearance=_executed_clearance(job, found, executed),
    )
    if this.experiment is None:
        return found
    progress(Step((EXPERIMENT,)))
    try:
        with locate_errors(EXPERIMENT):
            judged = on_bodies(job, this, found.taught, found.path, found.objective)
            return replace(found, experiment=judged)
    except ExecutionError as error:
        return replace(found, failure=error)


def plan_one(job: Job, this: Run, earlier: Sequence[RunResult], progress: Progress) -> RunResult:
    """Plan one run: the fastest motion that keeps its limits and stays clear.

    Runs with the same path and limits share one tracing, because tracing with redundant degrees of
    freedom takes seconds, and shaping too. Leads of automatic length depend on the timing, so that
    such runs share nothing unless they are timed alike.

    Args:
        job: The job.
        this: The run.
        earlier: Results of earlier runs of the job.
        progress: Called with each step.

    Raises:
        ArmContourError: The run cannot be planned.
    """
    alike = [x for x in earlier if x.traced is not None and traced_alike(x.run, this)]
    for x in alike:
        if _timed_alike(x.run, this):
            return RunResult(run=this, **{name: getattr(x, name) for name in PLANNED})
    if alike and not job.process.automatic:
        x = alike[0]
        assert x.traced is not None
        return plan_clear(job, this, x.objective, x.path, x.traced, progress)
    progress(Step((steps_of(this)[0],)))
    known = earlier[0].objective if earlier and not job.process.automatic else None
    with reach_told(job):
        objective, path = programs_of(job, this, progress, known)
        progress(Step(("tracing",)))
        traced = trace_run(job, this, path, progress)
    return plan_clear(job, this, objective, path, traced, progress)


def plan_clear(
    job: Job, this: Run, objective: Program, path: Program, traced: Tracing, progress: Progress
) -> RunResult:
    """Plan a traced program along the first of several joint paths that keep clear.

    Args:
        job: The job.
        this: The run.
        objective: The program with sharp corners.
        path: The program that the tool follows.
        traced: Its joint paths, the fastest.
        progress: Called with the steps "timing" and "clearance", and the share that is done.

    Raises:
        Collision: The arm comes too near to something, no other way was found, and the job does not
            ignore this.
        InvalidInput: The job has a scene, but the shapes of the arm are not known.
    """
    for way in ways(job, this, traced, progress):
        traced, notes = way
        progress(Step(("timing",)))
        trajectory = plan(traced, job.arm, this.limits, this.timing, progress=progress)
        progress(Step(("clearance",)))
        clearance = clearance_of(job, trajectory)
        if clearance is None or clearance.kept or job.ignore_collisions:
            break
    else:
        refuse_collision(job, path, trajectory)
    above = compare_limits(this.limits, job.arm)
    return RunResult(
        run=this,
        objective=objective,
        path=path,
        trajectory=trajectory,
        traced=traced,
        exceeded=(above,) if above else (),
        clearance=clearance,
        avoided=notes,
    )


def explain_run(job: Job, this: Run, trajectory: Trajectory) -> Explanation | None:
    """Which limit binds where on the plan of a run; None for methods that have no such limits."""
    if trajectory.method is not Method.OPTIMAL:
        return None
    return explain(trajectory, job.arm)


def teach_run(job: Job, this: Run, trajectory: Trajectory) -> TaughtData:
    """Compensate the plan of a run for the servo's delay.

    Raises:
        CompensationError: The method cannot compensate this delay.
    """
    return teach(trajectory, job.servo, this.compensation, period=this.period, arm=job.arm)


def execute_run(
    job: Job, this: Run, taught: TaughtData, servo: ServoModel | None = None
) -> Execution:
    """Simulate how the servo executes the set-points of a run.

    Args:
        job: The job.
        this: The run.
        taught: Its set-points.
        servo: The simulated servo; by default that of the job's plant.

    Raises:
        ExecutionError: The joints do not come to rest.
    """
    plant = ServoPlant(job.arm, job.plant_servo if servo is None else servo)
    return execute(taught, plant, resolution=RESOLUTION)


def evaluate_run(this: Run, executed: Execution, path: Program, objective: Program) -> Evaluation:
    """Evaluate the executed motion of a run, with the use of its limits."""
    return evaluate(executed, path, objective=objective, until=this.until, limit_use=True)


def _executed_clearance(job: Job, found: RunResult, executed: Execution) -> Clearance | None:
    """How far the arm stays from itself and from its cell when the servo executes a plan.

    Raises:
        Collision: Bodies touch, and the job does not ignore this. What only comes nearer than its
            margin is a warning, as the plan keeps the margin.
    """
    if found.clearance is None:
        return None
    near = job.cell.check(executed)
    if any(x.high <= 0 for x in near.too_near) and not job.ignore_collisions:
        with locate_errors("as executed"):
            near.refuse()
    return near


def on_bodies(
    job: Job, this: Run, taught: TaughtData, path: Program, objective: Program
) -> ExperimentResult:
    """Execute taught data on the simulated rigid bodies of the arm.

    Args:
        job: The job.
        this: A run with an experiment.
        taught: The set-points.
        path: The program that the tool follows.
        objective: The program with sharp corners.
    """
    assert this.experiment is not None
    plant = build_plant(this.experiment, job.arm, job.plant_servo, this.limits)
    # The plant has no results between two cycles of the drives.
    how: dict[str, Any] = {"resolution": max(RESOLUTION, plant.step)}
    executed = execute(taught, plant, **how)
    uncompensated = None
    if not isinstance(this.compensation, NoCompensation):
        plain = replace(this, compensation=NoCompensation())
        with suppress(ExecutionError):
            done = execute(teach_run(job, plain, taught.trajectory), plant, **how)
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
    if this.rounding is not None and this.rounding.free:
        steps = (SHAPING, *steps[1:])
    return steps if this.experiment is None or not simulated else (*steps, EXPERIMENT)


def _timed_alike(first: Run, second: Run) -> bool:
    """Whether two runs with the same joint paths have the same plan."""
    return first.timing == second.timing


def traced_alike(first: Run, second: Run) -> bool:
    """Whether two runs have the same path and limits, and so the same joint path."""
    if first.rounding != second.rounding:
        return False
    if first.rounding is not None and first.rounding.free:
        # The shape depends on what the plan leaves to the servo, and on its grid.
        one, other = first.timing, second.timing
        assert isinstance(one, Optimal) and isinstance(other, Optimal)
        if replace(one, duration=other.duration) != other:
            return False
    return all(
        np.array_equal(getattr(first.limits, x.name), getattr(second.limits, x.name))
        for x in fields(Limits)
    )
