"""All arrows at once: from a job to a study."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Iterator, Mapping
from contextlib import contextmanager
from dataclasses import asdict, dataclass, fields
from types import MappingProxyType

import numpy as np

from armcontour.arms import Limits
from armcontour.compensation import compensate
from armcontour.errors import ArmContourError, ExecutionError
from armcontour.evaluation import Evaluation, evaluate
from armcontour.execution import RigidBodyPlant, ServoPlant, execute
from armcontour.geometry import Path, round_corners
from armcontour.motion import Execution, JointPath, TaughtData, Trajectory
from armcontour.study.job import Job, Run
from armcontour.timing import (
    Explanation,
    explain,
    plan,
    refuse_jerk,
    trace_fastest,
)

STEPS = ("rounding", "tracing", "timing", "compensation", "execution", "evaluation")
EXPERIMENT = "experiment"
# Largest time between two results of an experiment [s], unless its drives are slower.
RESOLUTION = 1e-3
# Set-points farther apart than this share of the motion are said to be coarse.
COARSE = 0.1
Progress = Callable[[str, str], None]


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExperimentResult:
    """What a run came to on the arm's rigid bodies.

    Args:
        plant: The bodies and drives.
        execution: What the joints did.
        evaluation: What that was worth.
    """

    plant: RigidBodyPlant
    execution: Execution
    evaluation: Evaluation


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
        experiment: The same on the arm's rigid bodies, if the run has an experiment that did not
            fail.
        failure: Why its experiment failed, if it did.
    """

    run: Run
    path: Path
    joint_path: JointPath
    trajectory: Trajectory
    explanation: Explanation | None
    taught: TaughtData
    execution: Execution
    evaluation: Evaluation
    experiment: ExperimentResult | None = None
    failure: ExecutionError | None = None

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences on what makes these results less than they look."""
        period, duration = self.run.period, self.trajectory.duration
        if period <= COARSE * duration:
            return ()
        return (
            f"Run {self.run.name}: the command interval of {period:g} s is more than a tenth of "
            f"the motion of {duration:.3g} s, so set-points hardly say what was planned.",
        )


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Study:
    """A job and its results, by the names of its runs."""

    job: Job
    runs: Mapping[str, RunResult]


def run(job: Job, *, progress: Progress | None = None) -> Study:
    """Do a job: every run from the objective path to its evaluation.

    An experiment whose joints do not come to rest is the `failure` of its run, and no error.

    Args:
        job: The job.
        progress: Called with the run's name and the step before each step.

    Raises:
        ArmContourError: The first run that fails says why.
    """
    results: dict[str, RunResult] = {}
    for x in job.runs:
        with _named(f"Run {x.name}"):
            results[x.name] = _run(job, x, progress or (lambda run, step: None), results.values())
    return Study(job=job, runs=MappingProxyType(results))


def steps_of(this: Run) -> tuple[str, ...]:
    """The steps that a run takes, in order."""
    return STEPS if this.experiment is None else (*STEPS, EXPERIMENT)


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
        angular_tolerance=this.rounding.angular_tolerance,
    )


def _run(job: Job, this: Run, progress: Progress, earlier: Iterable[RunResult]) -> RunResult:
    progress(this.name, "rounding")
    # Runs that differ in what comes behind tracing share what is before: with joints to spare
    # tracing takes seconds.
    same = next((x for x in earlier if traced_alike(x.run, this)), None)
    path = path_of(job, this) if same is None else same.path
    # Before tracing, which can take seconds.
    refuse_jerk(this.limits, this.ignore_jerk)
    progress(this.name, "tracing")
    joint_path = traced(job, this, path) if same is None else same.joint_path
    progress(this.name, "timing")
    trajectory = plan(
        joint_path,
        job.arm,
        this.limits,
        method=this.timing,
        ignore_jerk=this.ignore_jerk,
        **this.timing_options,
    )
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
    evaluation = evaluate(executed, path, objective=job.path, limits=this.limits, until=this.until)
    experiment, failure = None, None
    if this.experiment is not None:
        progress(this.name, EXPERIMENT)
        try:
            with _named("experiment"):
                experiment = on_bodies(job, this, taught, path)
        except ExecutionError as error:
            failure = error
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
        evaluation=evaluation,
        experiment=experiment,
        failure=failure,
    )


def same_plan(first: RunResult, second: RunResult) -> bool:
    """Whether two runs of a study differ only behind their plans."""
    plans = first.trajectory, second.trajectory
    return (
        first.joint_path is second.joint_path
        and plans[0].method == plans[1].method
        and plans[0].duration == plans[1].duration
    )


def traced(job: Job, this: Run, path: Path) -> JointPath:
    """The joint path of the configuration that is fastest under the run's limits."""
    return trace_fastest(path, job.arm, this.limits, branch=job.branch, start=job.start)


def traced_alike(first: Run, second: Run) -> bool:
    """Whether two runs have the same path and limits."""
    return first.rounding == second.rounding and all(
        np.array_equal(getattr(first.limits, x.name), getattr(second.limits, x.name))
        for x in fields(Limits)
    )


def on_bodies(job: Job, this: Run, taught: TaughtData, path: Path) -> ExperimentResult:
    """The same taught data on the arm's rigid bodies, by the real servo's gains."""
    assert this.experiment is not None
    options = asdict(this.experiment)
    plant = RigidBodyPlant(job.arm, job.plant_servo, this.limits, **options)
    # Results closer than the drives' cycle there are none.
    executed = execute(taught, plant, resolution=max(RESOLUTION, plant.step))
    return ExperimentResult(
        plant=plant,
        execution=executed,
        evaluation=evaluate(
            executed, path, objective=job.path, limits=this.limits, until=this.until
        ),
    )


@contextmanager
def _named(what: str) -> Iterator[None]:
    """Put what was being done before the sentence of an error."""
    try:
        yield
    except ArmContourError as error:
        error.args = (f"{what}: {error}",)
        raise
