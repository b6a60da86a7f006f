"""Learning of the set-points of a run from logs of a robot."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.learning import LearningResult, LearningRun, Recording, learn
from armcontour.control.learning.alignment import fit_clock
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.render import number
from armcontour.core.result import Data, Row
from armcontour.core.sampling import interpolate
from armcontour.jobs.job import Job, choose_run
from armcontour.jobs.job_result import JobResult, RunResult
from armcontour.jobs.study import run
from armcontour.motion import Execution, Log, SetPoints
from armcontour.motion.set_point_check import describe_excess
from armcontour.verification import ErrorProfile
from armcontour.verification.contour_errors import ContourExecution, pieces_of

# Minimum relative clock error that is reported.
REPORTED_RATE = 1e-5
# A log belongs to an earlier run if the misfit of the earlier set-points is below this share of the
# misfit of the current set-points.
NEARER = 0.5
# Minimum reported RMS difference between the set-points in a log and those of the run: an absolute
# value above the rounding of printed logs [rad], and a share of the error.
REPORTED_DIFFERENCE, DIFFERENCE_SHARE = 2e-5, 0.05


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class LearningStudy:
    """Run of a job, and the result of learning from its executions on a robot."""

    job: Job
    plan: RunResult  # Plan and set-points before learning
    lesson: LearningResult  # Result of learning, with the set-points of the next run

    @checked
    def to_data(self, files: Sequence[str] = ()) -> Data:
        """Data of the plan and of learning, for the summary of a result."""
        study = JobResult(job=self.job, runs={self.plan.run.name: self.plan})
        return study.to_data(files, {"learning": self.result})

    @property
    def result(self) -> Data:
        """Data of learning: errors of the runs, next step and notes."""
        name, data = self.plan.run.name, self.lesson.to_data()
        rows = (Row("run", name), *data.rows, Row("notes", self.notes))
        return replace(data, title=f"Run {name}", rows=rows, notes=tuple(self.notes))

    def errors(self, k: int) -> tuple[float, float]:
        """RMS and largest error of the tool in run k, from 0 [m].

        The error is the contour error according to the log, or the distance from the planned
        position if the plan has no path.
        """
        run = self.lesson.runs[k]
        largest = run.tool_max if run.contour_max is None else run.contour_max
        return run.rms, largest

    def profile(self, k: int) -> ErrorProfile:
        """Measured contour error over time in run k, with noise, until the end of the plan."""
        assert self.lesson.lifted is not None
        t = self.lesson.lifted.t
        q = self.planned(t) + self.lesson.runs[k].error
        pieces = measured_pieces(self.job, self.plan, t, q)
        return ErrorProfile.join([x.contour_error for x in pieces])

    @property
    def has_path(self) -> bool:
        """True if errors are distances from a path."""
        return self.lesson.runs[0].contour_rms is not None

    @property
    def notes(self) -> list[str]:
        """Notes about the next step and about the findings from the runs."""
        lesson = self.lesson
        timing = _timing_clauses(lesson.runs[-1])
        notes = [self._verdict, *(f"{x}; learning takes this into account." for x in timing)]
        notes += [*_other_set_points(lesson.runs[-1]), *lesson.runs[-1].notes]
        if describe_excess(self.plan.set_points):
            notes.append(
                "The set-points before learning already exceed joint limits, so the learned "
                "set-points can exceed these limits too."
            )
        return notes

    @property
    def _verdict(self) -> str:
        """Sentence about the next step: learning is finished, or another run is useful."""
        lesson, best = self.lesson, f"run {self.lesson.best + 1}"
        error = f"{number(lesson.remaining, 'm')} RMS"
        if lesson.noise is not None:
            error += f", and runs of equal set-points differ by {number(lesson.noise, 'm')} RMS"
        if lesson.finished:
            return f"Finished: {lesson.reason}. The set-points are those of {best}: {error}."
        because = f" ({lesson.reason})" if lesson.reason else ""
        return f"Continue with another run{because}. The best run is {best}: {error}."

    def planned(self, t: FloatArray) -> FloatArray:
        """Planned joint positions at times [rad], (n, dof); at rest before and after the motion."""
        return self.plan.trajectory.with_rests(t)


def measured_pieces(
    job: Job, plan: RunResult, t: FloatArray, q: FloatArray
) -> Sequence[ContourExecution]:
    """Measured motion along each contour until the end of the plan; velocities and demand are 0."""
    still = np.zeros_like(q)
    executed = Execution(
        arm=job.arm,
        set_points=plan.set_points,
        t=t,
        q=q,
        dq=still,
        ddq=still,
        demand=still,
        demand_range=still[:2],
        saturated_time=still[0],
    )
    return pieces_of(executed, plan.path, None, plan.trajectory.duration)


def _timing_clauses(run: LearningRun) -> list[str]:
    """List with a clause about the clock of a log if its rate differs from 1; else empty."""
    if abs(run.rate - 1) < REPORTED_RATE:
        return []
    deviation = f"{(run.rate - 1) * 100:+.3f} %"
    return [f"The clock of the log differs from the clock of the set-points by {deviation}"]


def _other_set_points(run: LearningRun) -> list[str]:
    """List with a warning if the set-points in a log differ from those of the run; else empty."""
    deviation = float(np.sqrt(np.mean(run.error**2)))
    if run.set_points_off <= max(REPORTED_DIFFERENCE, DIFFERENCE_SHARE * deviation):
        return []
    return [
        f"The set-points in {run.source} differ from those of the run by "
        f"{number(run.set_points_off, 'rad')} RMS, and the joints deviate from the plan by "
        f"{number(deviation, 'rad')} RMS. If the robot executed other set-points, all figures of "
        "this run are wrong; in this case, specify the executed set-points (--set-points)."
    ]


def plan_run(job: Job, name: str | None, progress: Progress | None = None) -> RunResult:
    """Plan a run of a job and compute its set-points, without simulation."""
    chosen = choose_run(job, name, "learned")
    alone = replace(job, runs=(chosen,))
    return run(alone, simulate=False, progress=progress).runs[chosen.name]


def learn_run(
    job: Job,
    plan: RunResult,
    set_points: SetPoints,
    executed: Execution | Log | Recording,
) -> LearningResult:
    """Learn from an executed run, with the arm and servo of the job.

    The learned set-points satisfy the limits of the run, unless the executed ones exceed them.
    """
    try:
        lesson = learn(
            set_points,
            executed,
            arm=job.arm,
            servo=job.servo,
            gravity_feedforward=plan.run.feeds_gravity_forward,
        )
    except InvalidInput as error:
        # If the log has the set-points of an earlier run, `check_run` raises a clearer error.
        if error.limit == "set_points" and isinstance(executed, Log):
            check_run(set_points, executed)
        raise
    if isinstance(executed, Log):
        check_run(set_points, executed)
    return lesson


def learn_logs(
    job: Job,
    plan: RunResult,
    logs: Sequence[Log | Recording],
    *,
    set_points: SetPoints | None = None,
    progress: Progress | None = None,
) -> LearningResult:
    """Learn from logs of successive runs; each run executes the set-points learned before it.

    `set_points`: set-points of the first of these runs; by default those of the plan.
    """
    lesson = plan.set_points if set_points is None else set_points
    for log in logs:
        subprogress(progress)(Step((f"learning from {log.source}",)))
        lesson = learn_run(job, plan, lesson, log)
    assert isinstance(lesson, LearningResult)
    return lesson


def check_run(set_points: SetPoints, log: Log) -> None:
    """Raise InvalidInput if a log contains the set-points of an earlier run."""
    if not isinstance(set_points, LearningResult):
        return
    times = set_points.times(len(set_points.q), set_points.cycle)
    misfits = []
    for q in (*(x.q for x in set_points.runs), set_points.q):
        offset, rate = fit_clock(log.t, log.command, times, q)
        commanded = interpolate(offset + rate * log.t, times, q)
        misfits.append(float(np.sqrt(np.mean((log.command - commanded) ** 2))))
    k = int(np.argmin(misfits))
    if misfits[k] < NEARER * misfits[-1]:
        raise InvalidInput(
            f"{log.source} contains the set-points of run {k + 1} ({set_points.runs[k].source}), "
            f"but must contain the specified set-points. Specify the log of the last run, or the "
            "set-points that the robot executed.",
            index=k,
        )
