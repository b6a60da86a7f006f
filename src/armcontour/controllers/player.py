"""`play`: move a robot along the plan of a job, and record it."""

from __future__ import annotations

import math
from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np

from armcontour.controllers.commands import Stopper, uncompensated_motion
from armcontour.controllers.controller import START, Controller, Motion, PlayedMotion
from armcontour.core import checks
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerRefused, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import AngularDistance, Factor
from armcontour.core.render import Result
from armcontour.core.result import FIRST, VERDICT, Data, Row
from armcontour.jobs.job import Job, Run, choose_run
from armcontour.jobs.job_result import RunResult
from armcontour.jobs.study import run
from armcontour.motion import JointPath, Log, SetPoints
from armcontour.planning import plan
from armcontour.planning.options import Optimal
from armcontour.robot import Limits, resolve_limits

# Share of the planned speed by default.
SLOW = 0.1
# Smallest reserve of a plan that moves a robot: without one, a servo that differs slightly from its
# model saturates, and a stop may be impossible where a limit is active.
RESERVE = 0.02
# Largest number of times that a motion is played if the machine disturbs it.
ATTEMPTS = 3
# Powers of a speed factor by which limits change; torques and ranges do not.
POWERS = {
    "speed": 1, "joint_velocity": 1, "angular_speed": 1,
    "joint_acceleration": 2, "tool_acceleration": 2, "centripetal_acceleration": 2,
    "angular_acceleration": 2, "joint_jerk": 3, "tool_jerk": 3, "path_jerk": 3,
}  # fmt: skip


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Played(Result):
    """A motion of a robot, or of a dry run what would move.

    Args:
        job: The job with the run as it is played.
        plan: Plan, set-points and simulation of this run.
        controller: Name of the controller.
        speed_factor: Share of the job's speed.
        checks: What was compared with the controller.
        distance: Largest distance of a joint from the first set-point before the motion [rad];
            None if it is unknown.
        record: What the controller recorded; None in a dry run.
    """

    job: Job
    plan: RunResult
    controller: str
    speed_factor: float
    checks: tuple[Row, ...]
    distance: float | None
    record: PlayedMotion | None = None

    @property
    def log(self) -> Log:
        """The record as a log, for `identify` and `learn`.

        Raises:
            InvalidInput: A dry run, or a controller that used other set-points than those sent.
        """
        record = self.record
        if record is None:
            raise InvalidInput("A dry run has no log: play with execute=True.")
        if not record.faithful:
            raise InvalidInput(
                f"This motion is no log of its set-points: {' '.join(record.notes)} Play it again."
            )
        return Log(
            t=record.t,
            command=record.command,
            measured=record.measured,
            joint_names=self.job.arm.joint_names,
            interpolation="linear",
            source=self.controller,
            notes=record.notes,
        )

    def to_data(self) -> Data:
        """The run, its checks, and the motion if one was executed."""
        record = self.record
        moved = None if record is None else record.stopped is None
        rows = [
            Row("executed", record is not None, "", "executed", level=VERDICT),
            Row("controller", self.controller, "", "controller", level=FIRST),
            Row("run", self.plan.run.name, "", "run", level=FIRST),
            Row("speed_factor", self.speed_factor, "1", "share of the speed", level=FIRST),
            Row("duration", self.plan.trajectory.duration, "s", "duration", level=FIRST),
            Row("distance", self.distance, "rad", "distance from the start", level=FIRST),
            *self.checks,
            Row("completed", moved, "", "played to its end", level=FIRST),
        ]
        notes = () if record is None else record.notes
        return Data(f"Run {self.plan.run.name} on {self.controller}", tuple(rows), notes=notes)


@checked
def play(
    job: Job,
    controller: Controller,
    *,
    run_name: str | None = None,
    execute: bool = False,
    speed_factor: Factor = SLOW,
    band: AngularDistance | None = None,
    set_points: SetPoints | None = None,
    stop_requested: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
) -> Played:
    """Play the set-points of a run on a robot, and record its joints.

    The run is planned again at a share of its speed and with a reserve of 2 % at least, then
    compensated; set-points are never stretched. The robot moves to the start in joint space, at
    10 % of its speed at most. A stop ends on the path, within the limits.

    >>> from armcontour.controllers import LinuxCNC
    >>> ac.play(ac.read_job("job.yaml"), LinuxCNC("machine.hal")).record is None
    True

    Args:
        job: The job.
        controller: The controller, not connected.
        run_name: The run; by default the only one.
        execute: Whether the robot moves; otherwise arm, limits, set-points and position are
            compared only.
        speed_factor: Share of the speed; accelerations change by its square, jerks by its cube.
        band: Largest difference of a joint from its simulated position before the motion is stopped
            [rad]; by default unlimited.
        set_points: Set-points of `learn` for this run, instead of those of the compensation; only
            with a speed_factor of 1.
        stop_requested: Called often during the motion; True stops it on its path.
        progress: Called with the steps.

    Raises:
        ControllerRefused: The controller cannot be reached or differs from the plan; nothing moves.
        ControllerLost: The controller failed during the motion.
        ArmContourError: The run cannot be planned.
    """
    check_speed(speed_factor, learned=set_points is not None)
    player = Player(controller, execute, stop_requested, progress)
    played_job, planned = plan_played(job, run_name, speed_factor, progress=progress)
    return play_planned(
        player, played_job, planned, speed_factor=speed_factor, band=band, set_points=set_points
    )


def check_speed(speed_factor: float, *, learned: bool) -> None:
    """Refuse a speed factor above 1, or another one than 1 for learned set-points."""
    if speed_factor > 1:
        raise InvalidInput(f"speed_factor is at most 1, but {speed_factor:g}.")
    if learned and speed_factor != 1.0:
        raise InvalidInput("Learned set-points are for the full speed: give speed_factor=1.")


def play_planned(
    player: Player,
    job: Job,
    planned: RunResult,
    *,
    speed_factor: float,
    band: float | None,
    set_points: SetPoints | None,
) -> Played:
    """Play a run that `plan_played` has planned; arguments as of `play`."""
    if set_points is not None:
        _check_same_plan(set_points, planned)
    if planned.kept is False:
        raise ControllerRefused(
            f"The simulation of run {planned.run.name} is not within its limits or accuracy: see "
            "armcontour run."
        )
    watch = None if band is None else (_predicted(planned, player.controller.cycle), band)
    return player.play_plan(
        job, planned, set_points=set_points, speed_factor=speed_factor, watch=watch
    )


def plan_played(
    job: Job,
    run_name: str | None,
    speed_factor: float = 1.0,
    reserve: float = RESERVE,
    progress: Progress | None = None,
) -> tuple[Job, RunResult]:
    """The job with one run as it is played, and the plan of this run."""
    chosen = choose_run(job, run_name, "played")
    played_job = replace(job, runs=(at_speed(chosen, job, speed_factor, reserve),))
    return played_job, run(played_job, progress=progress).runs[chosen.name]


@dataclass(frozen=True, slots=True)
class Player:
    """A controller, and whether and how motions are executed on it; arguments as of `play`."""

    controller: Controller
    execute: bool
    stop_requested: Callable[[], bool]
    progress: Progress | None

    def play_plan(
        self,
        job: Job,
        planned: RunResult,
        *,
        set_points: SetPoints | None = None,
        speed_factor: float = 1.0,
        watch: tuple[FloatArray, float] | None = None,
    ) -> Played:
        """Play the set-points of a plan, or learned ones; other arguments as of `play`."""
        # watch: expected positions at the cycles of the controller until rest [rad], (n, dof), and
        # the largest difference of a joint from them before the motion is stopped [rad].
        points = planned.set_points if set_points is None else set_points
        controller, limits = self.controller, limits_of(job, planned)
        options = planned.run.compensation
        stopper = Stopper(points, job.servo, options, job.arm, controller.cycle)
        motion = Motion(q=stopper.q, next_stop=stopper)
        if watch is not None:
            expected, band = watch
            k = np.minimum(np.arange(len(stopper.q)), len(expected) - 1)
            motion = replace(motion, predicted=expected[k], band=band)
        played = Played(
            job=job,
            plan=planned,
            controller=controller.name,
            speed_factor=speed_factor,
            checks=tuple(controller.check(job.arm, limits, stopper.q)),
            distance=None,
        )
        return self.play_motion(played, motion)

    def play_undisturbed(
        self,
        play_once: Callable[[], Played],
        deviated: Callable[[PlayedMotion], bool] = lambda record: False,
    ) -> Played:
        """Play a motion up to 3 times, until no late set-point or stop of the feeder disturbs it.

        A motion that is stopped on request, or because the robot deviated, is not repeated.
        """
        for _ in range(ATTEMPTS):
            played = play_once()
            record = played.record
            if record is None or self.stop_requested() or deviated(record):
                break
            if record.stopped is None and record.faithful:
                break
        return played

    def play_motion(self, played: Played, motion: Motion) -> Played:
        """Connect, move to the start, and play a motion."""
        controller, stop_requested = self.controller, self.stop_requested
        if not self.execute and not controller.observes:
            return played
        job, tell = played.job, subprogress(self.progress, played.plan.run.name)
        with controller:
            tell(Step(("connecting",)))
            controller.connect(job.arm, motion.q[0])
            distance = float(np.abs(controller.position() - motion.q[0]).max())
            played = replace(played, distance=distance)
            if not self.execute or stop_requested():
                return played
            limits = _scaled(limits_of(job, played.plan), min(SLOW / played.speed_factor, 1.0))
            for _ in range(ATTEMPTS):
                position = controller.position()
                if np.abs(position - motion.q[0]).max() <= START:
                    break
                tell(Step(("moving to the start",)))
                approach = approach_of(job, limits, position, motion.q[0], controller.cycle)
                controller.stream(approach, stop_requested)
                if stop_requested():
                    return played
            tell(Step(("playing",)))
            return replace(played, record=controller.stream(motion, stop_requested))


def limits_of(job: Job, planned: RunResult) -> Limits:
    """Limits of a run."""
    return resolve_limits("play", job.arm, planned.run.limits)


def at_speed(chosen: Run, job: Job, factor: float, reserve: float = RESERVE) -> Run:
    """The run at a share of its speed, with a reserve."""
    limits = _scaled(resolve_limits("play", job.arm, chosen.limits), factor)
    changed = {x: getattr(limits, x) for x in POWERS if getattr(limits, x) is not None}
    timing = replace(chosen.timing, reserve=max(chosen.timing.reserve, reserve))
    return replace(chosen, limits=chosen.limits.replace(**changed), timing=timing)


def _scaled(limits: Limits, factor: float) -> Limits:
    """Limits of a motion at a share of its speed."""
    changed = {
        name: np.multiply(getattr(limits, name), factor**power)
        for name, power in POWERS.items()
        if getattr(limits, name) is not None
    }
    return limits.replace(**changed)


def approach_of(
    job: Job, limits: Limits, position: FloatArray, start: FloatArray, cycle: float
) -> Motion:
    """A straight motion of the joints to the first set-point, clear of arm and cell.

    Raises:
        ControllerRefused: The arm would come too near to itself or its cell.
    """
    line = JointPath.spline(np.stack([position, start]), [0.0, 1.0])
    _check_clear(job, line)
    trajectory = plan(line, job.arm, limits.of_joints, Optimal(reserve=RESERVE))
    return uncompensated_motion(trajectory, job.arm, cycle)


def _check_clear(job: Job, line: JointPath) -> None:
    """Refuse a motion to the start that comes too near to the arm or its cell."""
    from armcontour.verification.clearance import check_clearance

    if job.scene is None:
        return
    clearance = check_clearance(line, job.arm, job.scene)
    if not clearance.satisfied:
        raise ControllerRefused(
            f"On a straight way of the joints to the start: {clearance.sentence} Move the robot "
            "to the start yourself."
        )


def _check_same_plan(set_points: SetPoints, planned: RunResult) -> None:
    """Refuse learned set-points of another plan."""
    before, now = set_points.trajectory, planned.trajectory
    if (
        abs(before.duration - now.duration) > 1e-9
        or np.abs(before(before.duration / 2) - now(before.duration / 2)).max() > 1e-9
    ):
        raise InvalidInput("The set-points are of another plan than that of the job.")


def _predicted(planned: RunResult, cycle: float) -> FloatArray:
    """Simulated joint positions at the cycles of a controller [rad], (n, dof)."""
    executed = planned.execution
    assert executed is not None
    begin = planned.set_points.start_time
    t = begin + np.arange(math.ceil((executed.t[-1] - begin) / cycle) + 1) * cycle
    return np.column_stack([np.interp(t, executed.t, x) for x in executed.q.T])
