"""`identify_on`: play motions on a robot, and identify its servos from their logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armcontour.control.compensation import NoCompensation
from armcontour.control.identification import Identification, Prediction, ServoFit, identify
from armcontour.controllers.commands import UNKNOWN_LAG
from armcontour.controllers.controller import Controller, PlayedMotion
from armcontour.controllers.excitation import excite
from armcontour.controllers.player import Played, Player, limits_of, plan_played
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import Reserve
from armcontour.core.render import Result
from armcontour.core.result import FIRST, VERDICT, Data, Row
from armcontour.jobs.job import Job, choose_run
from armcontour.jobs.job_result import RunResult
from armcontour.motion import Log
from armcontour.robot import Limits

# Default reserve of the run, so that commanded accelerations do not saturate.
GENTLE = 0.2
# A joint is excited enough if its RMS acceleration is at least this share of its limit.
ENOUGH = 0.15
# Names of the motions and of their logs.
RUN, EXCITATION = "run", "excitation"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotIdentification(Result):
    """Motions of a robot, and the servos identified from their logs.

    Args:
        played: The motions by their names, `run` and `excitation`: the run without compensation,
            and a motion that excites all joints, if the run does not.
        resting: Names of the joints that the run hardly moves.
        fit: The identified servos; None in a dry run, or if a motion was stopped.
        prediction: The run as the identified servos predict it.
    """

    played: dict[str, Played]
    resting: tuple[str, ...]
    fit: Identification | None = None
    prediction: Prediction | None = None

    @property
    def logs(self) -> dict[str, Log]:
        """Logs of the motions that were completed, by name."""
        return {
            name: replace(x.log, source=name)
            for name, x in self.played.items()
            if x.record is not None and x.record.stopped is None
        }

    @property
    def stopped(self) -> bool:
        """True if a motion was stopped or did not start."""
        records = [x.record for x in self.played.values()]
        executed = any(x is not None for x in records)
        return executed and any(x is None or x.stopped is not None for x in records)

    def to_data(self) -> Data:
        """Rows on the motions."""
        first = self.played[RUN]
        rows = [
            *first.to_data().rows,
            Row("excitation", EXCITATION in self.played, "", "with excitation", level=FIRST),
            Row("resting", self.resting),
            Row("stopped", self.stopped, "", "stopped", level=VERDICT),
        ]
        notes = []
        if self.resting:
            notes = [
                f"The run moves {', '.join(self.resting)} too little, so a second motion excites "
                "all joints about the start of the run."
            ]
        records = [x.record for x in self.played.values() if x.record is not None]
        notes += [x for record in records if record.stopped is not None for x in record.notes]
        title = f"Identification on {first.controller}"
        return Data(title, tuple(rows), notes=tuple(notes))


@checked
def identify_on(
    job: Job,
    controller: Controller,
    *,
    run_name: str | None = None,
    reserve: Reserve = GENTLE,
    excitation: bool = False,
    execute: bool = False,
    options: ServoFit | None = None,
    stop_requested: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
) -> RobotIdentification:
    """Play a run of a job without compensation, and identify the servos of the robot from it.

    If a joint uses less than 15 % of its acceleration limit (RMS) in this run, or if the run does
    not determine all servos, a second motion moves all joints about the begin of the run: sums of
    sines of 12 s, within the limits, clear of the arm itself and of its cell.

    Args:
        job: The job.
        controller: The controller, not connected.
        run_name: The run; by default the only one.
        reserve: Smallest reserve of its plan.
        excitation: Whether all joints are excited in any case, so that servos are judged on two
            different programs.
        execute: Whether the robot moves; otherwise the motions are planned and compared only.
        options: Options of the identification; by default with the arm of the job.
        stop_requested: Called often during a motion; True stops it on its path.
        progress: Called with the steps.

    Raises:
        ControllerRefused: The controller differs from the plan, joints cannot be excited, or drives
            do not move.
        ControllerLost: The controller failed during a motion.
    """
    player = Player(controller, execute, stop_requested, progress)
    chosen = choose_run(job, run_name, "identified")
    plain = replace(chosen, compensation=NoCompensation(), accuracy=None)
    played_job, planned = plan_played(
        replace(job, runs=(plain,)), None, reserve=reserve, progress=progress
    )
    limits, tell = limits_of(played_job, planned), subprogress(progress, chosen.name)
    resting = _resting(planned, limits, controller.cycle)
    result = RobotIdentification(played={}, resting=resting)

    def is_complete(record: PlayedMotion) -> bool:
        # The log has the commands that the robot used, so late set-points do not matter.
        return record.stopped is None or record.deviated

    def play_run() -> Played:
        return player.play_undisturbed(
            lambda: player.play_plan(played_job, planned, lag=UNKNOWN_LAG), is_complete
        )

    def play_excitation() -> Played:
        motion = excite(played_job, limits, planned.trajectory, controller.cycle)
        bare = replace(result.played[RUN], record=None, motion=motion)
        return player.play_undisturbed(lambda: player.play_motion(bare), is_complete)

    def fit_logs() -> Identification:
        tell(Step(("identifying",)))
        fit_options = options or ServoFit(kinematics=job.arm)
        return identify(list(result.logs.values()), fit_options, progress=progress)

    motions = {RUN: play_run, EXCITATION: play_excitation}
    if not resting and not excitation:
        del motions[EXCITATION]
    for name, play_one in motions.items():
        result = replace(result, played={**result.played, name: play_one()})
        if execute and result.stopped:
            return result
    if not execute:
        return result
    fit = fit_logs()
    if EXCITATION not in motions and any(x.note or not x.kp.determined for x in fit.joints):
        names = tuple(x.name for x in fit.joints if x.note or not x.kp.determined)
        result = replace(result, resting=names)
        result = replace(result, played={**result.played, EXCITATION: play_excitation()})
        if result.stopped:
            return result
        fit = fit_logs()
    return replace(result, fit=fit, prediction=fit.predict(result.logs[RUN]))


def _resting(planned: RunResult, limits: Limits, cycle: float) -> tuple[str, ...]:
    """Names of the joints whose planned RMS acceleration is too small for identification."""
    ddq = np.sqrt(np.mean(planned.trajectory.sample(cycle).ddq ** 2, axis=0))
    low, high = limits.acceleration_bounds(len(ddq))
    fastest = np.minimum(-low, high)
    names = planned.arm.joint_names
    return tuple(x for x, moves in zip(names, ddq >= ENOUGH * fastest, strict=True) if not moves)
