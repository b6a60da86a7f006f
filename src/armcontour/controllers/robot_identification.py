"""`identify_on`: play motions on a robot, and identify its servos from their logs."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace

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
from armcontour.core.result import VERDICT, Data, Row
from armcontour.jobs.job import Job, choose_run
from armcontour.motion import Log

# Default reserve of the run, so that commanded accelerations do not saturate.
GENTLE = 0.2
# Names of the motions and of their logs.
RUN, EXCITATION = "run", "excitation"


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class RobotIdentification(Result):
    """Motions of a robot, and the servos identified from their logs.

    Args:
        played: The motions by their names, `run` and `excitation`: the run without compensation,
            and a motion that excites all joints.
        fit: The identified servos; None in a dry run, or if a motion was stopped.
        prediction: The run as the identified servos predict it.
    """

    played: dict[str, Played]
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
        stopped = Row("stopped", self.stopped, "", "stopped", level=VERDICT)
        records = [x.record for x in self.played.values() if x.record is not None]
        notes = [x for record in records if record.stopped is not None for x in record.notes]
        title = f"Identification on {first.controller}"
        return Data(title, (*first.to_data().rows, stopped), notes=tuple(notes))


@checked
def identify_on(
    job: Job,
    controller: Controller,
    *,
    run_name: str | None = None,
    reserve: Reserve = GENTLE,
    execute: bool = False,
    options: ServoFit | None = None,
    stop_requested: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
) -> RobotIdentification:
    """Play two motions on a robot, and identify its servos from them.

    The first motion is a run of a job without compensation. The second one moves all joints about
    the start of the run: sums of sines of 12 s, within the limits, clear of the arm itself and of
    its cell.

    Args:
        job: The job.
        controller: The controller, not connected.
        run_name: The run; by default the only one.
        reserve: Smallest reserve of its plan.
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
    excitation = excite(played_job, limits, planned.trajectory, controller.cycle)
    result = RobotIdentification(played={})

    def play_excitation() -> Played:
        return player.play_motion(replace(result.played[RUN], record=None, motion=excitation))

    motions: dict[str, Callable[[], Played]] = {
        RUN: lambda: player.play_plan(played_job, planned, lag=UNKNOWN_LAG),
        EXCITATION: play_excitation,
    }
    for name, play_once in motions.items():
        played = player.play_undisturbed(play_once, _is_complete)
        result = replace(result, played={**result.played, name: played})
        if execute and result.stopped:
            return result
    if not execute:
        return result
    tell(Step(("identifying",)))
    fit_options = options or ServoFit(kinematics=job.arm)
    fit = identify(list(result.logs.values()), fit_options, progress=progress)
    return replace(result, fit=fit, prediction=fit.predict(result.logs[RUN]))


def _is_complete(record: PlayedMotion) -> bool:
    """True if a motion need not be repeated; late set-points do not matter, as they are logged."""
    return record.stopped is None or record.deviated
