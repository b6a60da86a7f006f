"""All arrows at once: from a job to a study."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

from armcontour.compensation import compensate
from armcontour.errors import ArmContourError
from armcontour.evaluation import Evaluation, evaluate
from armcontour.execution import ServoPlant, execute
from armcontour.geometry import Path, round_corners
from armcontour.motion import Execution, JointPath, TaughtData, Trajectory
from armcontour.study.job import Job, Run
from armcontour.timing import Explanation, explain, plan
from armcontour.tracing import trace

STEPS = ("rounding", "tracing", "timing", "compensation", "execution", "evaluation")
Progress = Callable[[str, str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RunResult:
    """What one run of a job came to, arrow by arrow.

    Args:
        run: The run.
        path: The path that the tool was to follow: rounded, or the objective path itself.
        joint_path: The same in joint space.
        trajectory: The realizable trajectory.
        explanation: Which limit binds where, for a plan of the method "optimal".
        taught: The taught data.
        execution: What the joints did.
        evaluation: What that was worth.
    """

    run: Run
    path: Path
    joint_path: JointPath
    trajectory: Trajectory
    explanation: Explanation | None
    taught: TaughtData
    execution: Execution
    evaluation: Evaluation


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study:
    """A job and its results, by the names of its runs."""

    job: Job
    runs: Mapping[str, RunResult]


def run(job: Job, *, progress: Progress | None = None) -> Study:
    """Do a job: every run from the objective path to its evaluation.

    Args:
        job: The job.
        progress: Called with the run's name and the step before each step.

    Raises:
        ArmContourError: The first run that fails says why.
    """
    results = {}
    for x in job.runs:
        try:
            results[x.name] = _run(job, x, progress or (lambda run, step: None))
        except ArmContourError as error:
            # The same error with the run's name before its sentence.
            error.args = (f"Run {x.name}: {error}",)
            raise
    return Study(job=job, runs=MappingProxyType(results))


def path_of(job: Job, this: Run) -> Path:
    """The path that the tool is to follow in one run: with its corners rounded, if they are."""
    if this.rounding is None:
        return job.path
    acceleration = this.rounding.acceleration
    if acceleration is None:
        acceleration = this.limits.centripetal_acceleration
    return round_corners(
        job.path,
        tolerance=this.rounding.tolerance,
        speed=this.rounding.speed,
        acceleration=acceleration,
    )


def _run(job: Job, this: Run, progress: Progress) -> RunResult:
    progress(this.name, "rounding")
    path = path_of(job, this)
    progress(this.name, "tracing")
    joint_path = trace(path, job.arm, branch=job.branch)
    progress(this.name, "timing")
    trajectory = plan(joint_path, job.arm, this.limits, method=this.timing, **this.timing_options)
    progress(this.name, "compensation")
    taught = compensate(
        trajectory,
        job.servo,
        method=this.compensation,
        period=this.period,
        **this.compensation_options,
    )
    progress(this.name, "execution")
    executed = execute(taught, ServoPlant(job.arm, job.plant_servo, this.limits))
    progress(this.name, "evaluation")
    return RunResult(
        run=this,
        path=path,
        joint_path=joint_path,
        trajectory=trajectory,
        explanation=(
            explain(trajectory, job.arm, this.limits) if trajectory.method == "optimal" else None
        ),
        taught=taught,
        execution=executed,
        evaluation=evaluate(
            executed, path, objective=job.path, limits=this.limits, until=this.until
        ),
    )
