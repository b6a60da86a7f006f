"""Learning a run's set-points from the logs of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.learning import LearningResult, learn
from armcontour.control.learning.learner import Runs
from armcontour.core.checks import FloatArray
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.render import number
from armcontour.core.result import Data, Row
from armcontour.core.validity import AT_ENCODERS
from armcontour.jobs.job import Job, choose_run
from armcontour.jobs.run_job import run
from armcontour.jobs.run_result import JobResult, RunResult
from armcontour.motion import Execution, SetPoints
from armcontour.verification import ErrorProfile
from armcontour.verification.contour_errors import ContourExecution, split_by_contour


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearnedRun:
    """A run of a job, and what was learned from its executions on a robot.

    Args:
        job: The job.
        plan: Plan and set-points before learning.
        lesson: Result of learning, with the set-points of the next run.
    """

    job: Job
    plan: RunResult
    lesson: LearningResult

    @checked
    def to_data(self) -> Data:
        """Return the data of plan and learning, for the summary of a result."""
        job_result = JobResult(job=self.job, runs={self.plan.run.name: self.plan})
        return job_result.to_data({"learning": self.result})

    @property
    def result(self) -> Data:
        """Data of learning: errors of the runs, next step and notes."""
        name = self.plan.run.name
        data = self.lesson.to_data()
        rows = (Row("run", name), *data.rows, Row("notes", self.notes))
        title = f"Run {name}, errors {AT_ENCODERS}"
        return replace(data, title=title, rows=rows, notes=tuple(self.notes))

    def errors(self, k: int) -> tuple[float, float]:
        """Return the RMS and the largest error of the tool in run k [m], counted from 0.

        The error is the contour error according to the log, or the distance from the planned
        position if the plan has no path.
        """
        run = self.lesson.runs[k]
        return run.rms, run.largest

    def profile(self, k: int) -> ErrorProfile:
        """Return the measured contour error over time in run k, counted from 0.

        The profile ends with the plan.
        """
        assert self.lesson.lifted is not None
        t = self.lesson.lifted.t
        q = self.plan.trajectory.with_rests(t) + self.lesson.runs[k].error
        pieces = measured_pieces(self.job, self.plan, t, q)
        return ErrorProfile.join([x.contour_error for x in pieces])

    @property
    def has_path(self) -> bool:
        """True if errors are distances from a path."""
        return self.lesson.runs[0].contour_rms is not None

    @property
    def notes(self) -> list[str]:
        """Notes about the next step and about the findings from the runs."""
        notes = [self._verdict, *self.lesson.notes]
        if self.plan.set_point_use.excesses:
            notes.append(
                "The set-points before learning already exceed limits, so the learned "
                "set-points can also exceed these limits."
            )
        return notes

    @property
    def _verdict(self) -> str:
        """Sentence about the next step: learning is finished, or another run is useful."""
        lesson = self.lesson
        best = f"run {self.lesson.best + 1}"
        error = f"{number(lesson.remaining, 'm')} RMS {AT_ENCODERS}"
        if lesson.noise is not None:
            error += f", and runs of equal set-points differ by {number(lesson.noise, 'm')} RMS"
        if lesson.finished:
            return f"Finished: {lesson.reason}. The set-points are those of {best}: {error}."
        because = f" ({lesson.reason})" if lesson.reason else ""
        return f"Continue with another run{because}. The best run is {best}: {error}."


def measured_pieces(
    job: Job, plan: RunResult, t: FloatArray, q: FloatArray
) -> Sequence[ContourExecution]:
    """Divide a measured motion into its contours, until the end of the plan.

    Velocities and demand are 0, because a log does not contain them.

    - `t`: times on the clock of the plan [s], (n,).
    - `q`: measured joint positions [rad], (n, dof).
    """
    zeros = np.zeros_like(q)
    executed = Execution(
        arm=job.arm,
        set_points=plan.set_points,
        t=t,
        q=q,
        dq=zeros,
        ddq=zeros,
        demand=zeros,
        demand_range=zeros[:2],
        saturated_time=zeros[0],
    )
    return split_by_contour(executed, plan.path, plan.objective, plan.trajectory.duration)


def plan_run(job: Job, name: str | None, progress: Progress | None = None) -> RunResult:
    """Plan a run of a job and compute its set-points, without simulation."""
    chosen = choose_run(job, name, "learned")
    job_of_run = replace(job, runs=(chosen,))
    return run(job_of_run, simulate=False, progress=progress).runs[chosen.name]


def learn_logs(
    job: Job,
    plan: RunResult,
    logs: Sequence[Runs],
    *,
    set_points: SetPoints | None = None,
    progress: Progress | None = None,
) -> LearningResult:
    """Learn from logs of successive runs, with the arm and servo of the job.

    Each run executes the set-points learned before it; several logs of one run are a list.
    `set_points` are those of the first run, by
    default those of the plan. The learned set-points satisfy the limits of the run, unless the
    executed ones exceed them.
    """
    lesson = plan.set_points if set_points is None else set_points
    for k, log in enumerate(logs, 1):
        subprogress(progress)(Step((f"learning from log {k}",)))
        lesson = learn(
            lesson,
            log,
            arm=job.arm,
            servo=job.servo,
            gravity_feedforward=plan.run.feeds_gravity_forward,
        )
    assert isinstance(lesson, LearningResult)
    return lesson
