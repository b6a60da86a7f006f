"""`learn_on`: play a run on a robot repeatedly, and learn from each log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.learning import LearningResult
from armcontour.controllers.commands import commands_at
from armcontour.controllers.controller import Controller, PlayedMotion
from armcontour.controllers.player import ATTEMPTS, Played, Player, plan_played
from armcontour.core.errors import ControllerRefused, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress
from armcontour.core.quantities import AngularDistance, Reserve
from armcontour.core.render import Result, number
from armcontour.core.result import FIRST, VERDICT, Data, Row
from armcontour.jobs.job import Job
from armcontour.jobs.job_result import RunResult
from armcontour.jobs.run_learning import LearningStudy, learn_logs
from armcontour.motion import Log, SetPoints

# Default of the minimum reserve: learned corrections need additional acceleration, and learning
# assumes that drives do not saturate.
CORRECTIONS = 0.2
RUNS = 4
# A run is stopped if a joint deviates from the plan by more than RUNAWAY times the maximum
# deviation of the best earlier run, and by more than LEAST [rad].
RUNAWAY, LEAST = 3.0, 1e-3
# Tolerance between the commands of a log and the set-points of its run [rad].
SAME = 1e-6
STOPPED = "stopped on request"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotLearning(Result):
    """Runs of a robot, and the set-points learned from them.

    Args:
        job: The job with the run as it is played.
        plan: Plan and set-points before learning.
        played: The last motion, or what would move; None before the first one.
        logs: Logs of the runs, in order.
        lesson: Result of learning, with the set-points of the next run; None before the first run.
        ended: Why no further run follows; empty if one may follow.
    """

    job: Job
    plan: RunResult
    played: Played | None = None
    logs: tuple[Log, ...] = ()
    lesson: LearningResult | None = None
    ended: str = ""

    @property
    def best(self) -> LearningResult | None:
        """The lesson with the set-points of the best run, for production."""
        lesson = self.lesson
        if lesson is None or lesson.finished:
            return lesson
        return replace(lesson, q=lesson.runs[lesson.best].q)

    @property
    def study(self) -> LearningStudy | None:
        """Data of the report; None before the first run."""
        best = self.best
        return None if best is None else LearningStudy(job=self.job, plan=self.plan, lesson=best)

    @property
    def stopped(self) -> bool:
        """True if the last motion was stopped on request or did not start."""
        return self.ended == STOPPED

    def to_data(self) -> Data:
        """Rows on the runs, and the reason why they ended."""
        count, first = len(self.logs), self.played
        rows = [Row("runs", count, "", "runs", self.ended, VERDICT)]
        if first is not None:
            rows += [x for x in first.to_data().rows if x.name not in ("executed", "completed")]
        if self.lesson is not None:
            rows.append(Row("errors", [x.rms for x in self.lesson.runs], "m", "errors, RMS"))
            rows.append(
                Row("best", self.lesson.remaining, "m", f"run {self.lesson.best + 1}", level=FIRST)
            )
        rows.append(Row("ended", self.ended))
        return Data(f"Learning of run {self.plan.run.name}", tuple(rows))


class RobotLearner:
    """Plays and learns one run at a time; arguments as of `learn_on`.

    Attributes:
        result: The runs so far.
    """

    def __init__(
        self,
        player: Player,
        job: Job,
        *,
        run_name: str | None = None,
        runs: int = RUNS,
        reserve: float = CORRECTIONS,
        band: float | None = None,
    ) -> None:
        played_job, plan = plan_played(job, run_name, reserve=reserve, progress=player.progress)
        self.player, self.runs, self.band = player, runs, band
        self.result = RobotLearning(job=played_job, plan=plan)

    @property
    def goes_on(self) -> bool:
        """True if another run follows."""
        return not self.result.ended and len(self.result.logs) < self.runs

    @property
    def set_points(self) -> SetPoints:
        """Set-points of the next run."""
        return self.result.lesson or self.result.plan.set_points

    def resume(self, logs: Sequence[Log]) -> None:
        """Learn from logs of earlier runs.

        Raises:
            InvalidInput: The commands of a log differ from the set-points of its run.
        """
        for log in logs:
            self._check_commands(log)
            self._learn_from(log)

    def rehearse(self) -> Played:
        """Compare the next run with the controller, and move nothing."""
        player, result = replace(self.player, execute=False), self.result
        return player.play_plan(result.job, result.plan, set_points=result.lesson)

    def run_next(self) -> None:
        """Play the next run, and learn from it."""
        player = self.player
        if player.stop_requested():
            self.result = replace(self.result, ended=STOPPED)
            return
        result, band = self.result, self._choose_band()
        played = player.play_undisturbed(
            lambda: player.play_plan(result.job, result.plan, set_points=result.lesson, band=band),
            lambda record: (record.stopped is None and record.faithful) or record.deviated,
        )
        record = played.record
        self.result = replace(self.result, played=played)
        if not player.execute:
            self.result = replace(self.result, ended="dry run")
        elif record is None or (record.stopped is not None and player.stop_requested()):
            self.result = replace(self.result, ended=STOPPED)
        elif record.deviated:
            self._go_back(record)
        elif record.stopped is not None or not record.faithful:
            raise ControllerRefused(
                f"The run was disturbed in each of {ATTEMPTS} attempts: {_notes(record)}"
            )
        else:
            name = f"run {len(self.result.logs) + 1}"
            self._learn_from(replace(played.log, source=name))

    def _learn_from(self, log: Log) -> None:
        """Compute the next set-points from the log of a run."""
        result = self.result
        lesson = learn_logs(
            result.job,
            result.plan,
            [log],
            set_points=self.set_points,
            progress=self.player.progress,
        )
        ended = lesson.reason if lesson.finished else ""
        self.result = replace(result, logs=(*result.logs, log), lesson=lesson, ended=ended)

    def _go_back(self, record: PlayedMotion) -> None:
        """End learning with the best run, after a motion that deviated too much."""
        reason, lesson = _notes(record), self.result.lesson
        if lesson is None:
            raise ControllerRefused(f"The first run was stopped on its path: {reason}")
        ended = f"run {len(self.result.logs) + 1} was stopped on its path: {reason}"
        self.result = replace(self.result, lesson=_end(lesson, ended), ended=ended)

    def _choose_band(self) -> float | None:
        """Largest deviation of the next run from its prediction [rad]; None for the default."""
        lesson = self.result.lesson
        if lesson is None:
            return self.band
        largest = float(np.abs(lesson.runs[lesson.best].error).max())
        return min(np.inf if self.band is None else self.band, max(RUNAWAY * largest, LEAST))

    def _check_commands(self, log: Log) -> None:
        """Refuse a log whose commands differ from the set-points of the next run."""
        q = commands_at(
            self.set_points, self.player.controller.cycle, self.result.job.servo.interpolation
        )
        n = min(len(q), len(log.command))
        same = (
            log.dof == q.shape[1]
            and abs(log.interval - self.player.controller.cycle)
            < SAME * self.player.controller.cycle
        )
        differs = float(np.abs(log.command[:n] - q[:n]).max()) if same else np.inf
        if differs > SAME:
            by = f", by up to {number(differs, 'rad')}" if same else ""
            raise InvalidInput(
                f"The commands of {log.source} differ from the set-points of run "
                f"{len(self.result.logs) + 1}{by}: the job has changed since. Start again in "
                "another folder."
            )


def _notes(record: PlayedMotion) -> str:
    return " ".join(record.notes)


def _end(lesson: LearningResult, reason: str) -> LearningResult:
    """Finish a lesson with the set-points of its best run."""
    best = lesson.runs[lesson.best]
    return replace(lesson, q=best.q, finished=True, reason=reason)


@checked
def learn_on(
    job: Job,
    controller: Controller,
    *,
    run_name: str | None = None,
    runs: int = RUNS,
    reserve: Reserve = CORRECTIONS,
    execute: bool = False,
    logs: Sequence[Log] = (),
    band: AngularDistance | None = None,
    stop_requested: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
) -> RobotLearning:
    """Play a run on a robot, learn from its log, and repeat with the learned set-points.

    Learning ends as in `learn`, with the set-points of the best run. It also ends when a joint
    deviates from the plan by 3 times the maximum deviation of the best run. Such a motion is
    stopped on its path.

    Args:
        job: The job.
        controller: The controller, not connected.
        run_name: The run; by default the only one.
        runs: Number of runs, with those of `logs`.
        reserve: Smallest reserve of the plan: corrections need acceleration.
        execute: Whether the robot moves; otherwise the first run is compared only.
        logs: Logs of earlier runs, with which learning goes on.
        band: Largest deviation of a joint from the plan before a motion is stopped, also in the
            first run [rad]; in the first run by default as in `play`.
        stop_requested: Called often during a motion; True stops it on its path and ends learning.
        progress: Called with the steps.

    Raises:
        InvalidInput: A log is one of other set-points.
        ControllerRefused: The controller differs from the plan.
        ControllerLost: The controller failed during a motion.
    """
    player = Player(controller, execute, stop_requested, progress)
    learner = RobotLearner(player, job, run_name=run_name, runs=runs, reserve=reserve, band=band)
    learner.resume(logs)
    while learner.goes_on:
        learner.run_next()
    return learner.result
