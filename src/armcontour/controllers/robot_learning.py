"""`learn_on`: play a run on a robot repeatedly, and learn from each log."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.learning import LearningResult
from armcontour.controllers.controller import Controller, per_joint
from armcontour.controllers.player import (
    ATTEMPTS,
    Band,
    Played,
    Player,
    lost_motion,
    plan_played,
    prepare_motion,
)
from armcontour.controllers.rolling_rows import commands_at
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerLost, ControllerRefused, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress
from armcontour.core.quantities import AngularDistance, Reserve
from armcontour.core.render import Result
from armcontour.core.result import FIRST, VERDICT, Data, Row
from armcontour.core.validity import OF_LOGS, OF_SIMULATION
from armcontour.jobs.job import Job
from armcontour.jobs.run_learning import LearnedRun, learn_logs
from armcontour.jobs.run_result import RunResult
from armcontour.motion import Log, SetPoints
from armcontour.robot import Arm

# Default reserve: learned corrections need additional acceleration, and learning assumes that
# drives do not saturate.
DEFAULT_RESERVE = 0.2
# Default number of runs.
DEFAULT_RUNS = 4
# A run is stopped if a joint deviates from the plan by more than RUNAWAY_LEAST and by more than
# this multiple of the largest deviation in the best earlier run.
RUNAWAY_FACTOR = 3.0
# A run goes on while a revolute joint deviates from the plan by at most this [rad], unless the
# specified band is narrower.
RUNAWAY_LEAST = 1e-3
# The same for a linear axis [m], whose band is not specified.
RUNAWAY_LEAST_LINEAR = 1e-3
# Tolerance between the commands of a log and the set-points of its run [rad].
LOGGED_COMMAND_TOLERANCE = 1e-6
STOPPED = "stopped on request"
LOST = "the controller was lost"


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
        lost: The failure of the controller during the last motion; None without one.
    """

    job: Job
    plan: RunResult
    played: Played | None = None
    logs: tuple[Log, ...] = ()
    lesson: LearningResult | None = None
    ended: str = ""
    lost: ControllerLost | None = None

    @property
    def set_points(self) -> SetPoints:
        """Set-points of the next run."""
        return self.lesson or self.plan.set_points

    def continues(self, runs: int) -> bool:
        """Return whether another run follows, up to a number of runs."""
        return not self.ended and len(self.logs) < runs

    @property
    def best(self) -> LearningResult | None:
        """The lesson with the set-points of the best run, for production."""
        lesson = self.lesson
        if lesson is None or lesson.finished:
            return lesson
        return replace(lesson, q=lesson.runs[lesson.best].q)

    @property
    def learned_run(self) -> LearnedRun | None:
        """Data of the report; None before the first run."""
        best = self.best
        return None if best is None else LearnedRun(job=self.job, plan=self.plan, lesson=best)

    @property
    def lost_log(self) -> Log | None:
        """Log of the last motion until the controller was lost; None without one."""
        played = self.played
        if self.lost is None or played is None or played.record is None:
            return None
        return played.log

    @property
    def stopped(self) -> bool:
        """True if the last motion was stopped on request or did not start."""
        return self.ended == STOPPED

    def to_data(self) -> Data:
        """Return rows on the runs, and the reason why they ended."""
        count = len(self.logs)
        played = self.played
        rows = [Row("runs", count, "", "runs", self.ended, VERDICT)]
        if played is not None:
            rows += [x for x in played.to_data().rows if x.name not in ("executed", "completed")]
        if self.lesson is not None:
            errors = [x.rms for x in self.lesson.runs]
            best = f"run {self.lesson.best + 1}"
            rows.append(Row("errors", errors, "m", "errors, RMS"))
            rows.append(Row("best", min(errors), "m", best, level=FIRST))
        rows.append(Row("ended", self.ended))
        notes: tuple[str, ...] = ()
        if played is not None and not played.executed and played.outputs_note:
            notes = (played.outputs_note,)
        return Data(
            f"Learning of run {self.plan.run.name}",
            tuple(rows),
            notes=notes,
            not_proven=OF_LOGS if count else OF_SIMULATION,
        )


def start_learning(
    job: Job, player: Player, run_name: str | None, reserve: float, logs: Sequence[Log]
) -> RobotLearning:
    """Plan the run, and learn from the logs of earlier runs.

    Raises:
        InvalidInput: The commands of a log differ from the set-points of its run.
    """
    played_job, plan = plan_played(
        job, player.controller, run_name, reserve=reserve, progress=player.progress
    )
    result = RobotLearning(job=played_job, plan=plan)
    for log in logs:
        _check_commands(result, log, player.controller.cycle)
        result = _learn_from(result, log, player.progress)
    return result


def learn_next(result: RobotLearning, player: Player, band: float | None = None) -> RobotLearning:
    """Play the next run, and learn from it; `band`: see `learn_on`.

    If the controller is lost, the result has the error and the motion until then.
    """
    if player.stop_requested():
        return replace(result, ended=STOPPED)
    lesson = result.lesson
    run = f"run {len(result.logs) + 1}"
    allowed: Band = band
    if lesson is not None:
        error = lesson.runs[lesson.best].error
        allowed = _runaway_band(result.job.arm, np.abs(error).max(axis=0), band)
    ready = prepare_motion(
        result.job, result.plan, player.controller, set_points=lesson, band=allowed
    )
    try:
        played = player.play(ready, lambda x: (x.stopped is None and x.faithful) or x.deviated)
    except ControllerLost as lost:
        return replace(result, played=lost_motion(ready, lost), ended=LOST, lost=lost)
    result = replace(result, played=played)
    record = played.record
    if not player.execute:
        return replace(result, ended="dry run")
    if record is None or (record.stopped is not None and player.stop_requested()):
        return replace(result, ended=STOPPED)
    notes = " ".join(record.notes)
    if record.deviated:
        if lesson is None:
            raise ControllerRefused(f"The first run was stopped on its path: {notes}")
        ended = f"{run} was stopped on its path: {notes}"
        q = lesson.runs[lesson.best].q
        lesson = replace(lesson, q=q, finished=True, reason=ended)
        return replace(result, lesson=lesson, ended=ended)
    if record.stopped is not None or not record.faithful:
        raise ControllerRefused(f"The run was disturbed in each of {ATTEMPTS} attempts: {notes}")
    return _learn_from(result, replace(played.log, source=run), player.progress)


def _runaway_band(arm: Arm, largest: FloatArray, band: float | None) -> FloatArray:
    """Return the deviation of each joint from the plan at which a run is stopped [rad], (dof,).

    - `largest`: largest deviation of each joint in the best run [rad], (dof,).
    - `band`: upper bound for revolute joints [rad]; None without one.
    """
    slides = arm.chain.slides
    angular = float(largest[~slides].max(initial=0.0))
    linear = float(largest[slides].max(initial=0.0))
    return per_joint(
        arm,
        min(np.inf if band is None else band, max(RUNAWAY_FACTOR * angular, RUNAWAY_LEAST)),
        max(RUNAWAY_FACTOR * linear, RUNAWAY_LEAST_LINEAR),
        arm.dof,
    )


def _learn_from(result: RobotLearning, log: Log, progress: Progress | None) -> RobotLearning:
    """Compute the next set-points from the log of a run."""
    lesson = learn_logs(
        result.job, result.plan, [log], set_points=result.set_points, progress=progress
    )
    ended = lesson.reason if lesson.finished else ""
    return replace(result, logs=(*result.logs, log), lesson=lesson, ended=ended)


def _check_commands(result: RobotLearning, log: Log, cycle: float) -> None:
    """Refuse a log whose commands differ from the set-points of the next run.

    `cycle`: cycle of the controller [s].
    """
    q = commands_at(result.set_points, cycle, result.job.servo.interpolation)
    n = min(len(q), len(log.command))
    has_cycle = abs(log.interval - cycle) < LOGGED_COMMAND_TOLERANCE * cycle
    is_comparable = log.dof == q.shape[1] and has_cycle
    if not is_comparable or np.abs(log.command[:n] - q[:n]).max() > LOGGED_COMMAND_TOLERANCE:
        raise InvalidInput(
            f"The commands of {log.source} differ from the set-points of run "
            f"{len(result.logs) + 1}, because the job has changed since. Start again in "
            "another folder."
        )


@checked
def learn_on(
    job: Job,
    controller: Controller,
    *,
    run_name: str | None = None,
    runs: int = DEFAULT_RUNS,
    reserve: Reserve = DEFAULT_RESERVE,
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
        runs: Number of runs, including those of `logs`; by default 4.
        reserve: Smallest reserve of the plan, because corrections need acceleration; by default
            20 %.
        execute: Whether the robot moves; by default the first run is only compared.
        logs: Logs of earlier runs, with which learning goes on.
        band: Largest deviation of a revolute joint from the plan before a motion is stopped, also
            in the first run [rad]; in the first run by default as in `play`.
        stop_requested: Called often during a motion; True stops it on its path and ends learning.
        progress: Called with the steps.

    Raises:
        InvalidInput: A log belongs to other set-points.
        ControllerRefused: The controller differs from the plan.
        ControllerLost: The controller failed during a motion.
    """
    player = Player(controller, execute, stop_requested, progress)
    result = start_learning(job, player, run_name, reserve, logs)
    while result.continues(runs):
        result = learn_next(result, player, band)
    if result.lost is not None:
        raise result.lost
    return result
