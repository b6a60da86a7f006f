"""`play`: plan a run for a robot, play its set-points and record the motion."""

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
from armcontour.jobs.alternatives import clearance_of
from armcontour.jobs.job import Job, Run, choose_run
from armcontour.jobs.job_result import RunResult
from armcontour.jobs.study import run
from armcontour.motion import JointPath, Log, SetPoints
from armcontour.planning import plan
from armcontour.planning.options import Optimal
from armcontour.robot import Limits, resolve_limits

# Default speed factor, and largest speed factor of the motion to the start.
SLOW = 0.1
# Minimum reserve of a plan that moves a robot. Without reserve, a servo that differs slightly from
# its model saturates, and a stop may be impossible where a limit is active.
RESERVE = 0.02
# Maximum number of attempts to play a motion that late set-points disturb.
ATTEMPTS = 3
# Exponents of the speed factor with which limits are scaled; torques and ranges do not change.
POWERS = {
    "speed": 1, "joint_velocity": 1, "angular_speed": 1,
    "joint_acceleration": 2, "tool_acceleration": 2, "centripetal_acceleration": 2,
    "angular_acceleration": 2, "joint_jerk": 3, "tool_jerk": 3, "path_jerk": 3,
}  # fmt: skip


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Played(Result):
    """A motion of a robot, or the motion that a dry run has checked.

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
        """Log of the motion for `identify` and `learn`.

        Raises:
            InvalidInput: A dry run, or a controller that used other set-points than those sent.
        """
        record = self.record
        if record is None:
            raise InvalidInput("A dry run has no log: set execute=True.")
        if not record.faithful:
            raise InvalidInput(
                f"The robot did not execute the set-points as sent: {' '.join(record.notes)} "
                "Play the motion again."
            )
        return self.log_of(record)

    def log_of(self, record: PlayedMotion) -> Log:
        """Log of the commands that the robot used, which may differ from the set-points.

        Args:
            record: The recorded motion.
        """
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
        """Rows on the run, the checks, and the motion if one was executed."""
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

    The run is planned again for the speed factor, with a reserve of at least 2 %, and compensated;
    set-points are never stretched in time. The robot moves to the start on a straight line in joint
    space, with at most 10 % of its speed. A stop ends on the path and respects the limits.

    >>> from armcontour.controllers import LinuxCNC
    >>> ac.play(ac.read_job("job.yaml"), LinuxCNC("machine.hal")).record is None
    True

    Args:
        job: The job.
        controller: The controller, not connected.
        run_name: The run; by default the only one.
        execute: True moves the robot. False is a dry run, which only compares arm, limits,
            set-points and position.
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
    """Refuse a speed factor above 1, or below 1 for learned set-points."""
    if speed_factor > 1:
        raise InvalidInput(f"speed_factor must be at most 1, but is {speed_factor:g}.")
    if learned and speed_factor != 1.0:
        raise InvalidInput("Learned set-points are valid at full speed only: set speed_factor=1.")


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
    """Job with the scaled run, and the result of planning this run."""
    chosen = choose_run(job, run_name, "played")
    played_job = replace(job, runs=(at_speed(chosen, job, speed_factor, reserve),))
    return played_job, run(played_job, progress=progress).runs[chosen.name]


@dataclass(frozen=True, slots=True)
class Player:
    """A controller, and the options of motions on it; fields as the arguments of `play`."""

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
        """Play learned set-points, or by default those of the plan; arguments as of `play`."""
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
        is_final: Callable[[PlayedMotion], bool],
    ) -> Played:
        """Play a motion, up to 3 times until a stop is requested or a record is final."""
        for _ in range(ATTEMPTS):
            played = play_once()
            record = played.record
            if record is None or self.stop_requested() or is_final(record):
                break
        return played

    def play_motion(self, played: Played, motion: Motion) -> Played:
        """Connect, move to the start of a motion, and play it."""
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
            if distance > START:
                tell(Step(("moving to the start",)))
                self._move_to_start(played, motion.q[0])
                if stop_requested():
                    return played
            tell(Step(("playing",)))
            return replace(played, record=controller.stream(motion, stop_requested))

    def _move_to_start(self, played: Played, start: FloatArray) -> None:
        """Move in joint space to the first set-point, again if set-points were late."""
        controller, job = self.controller, played.job
        limits = _scaled(limits_of(job, played.plan), min(SLOW / played.speed_factor, 1.0))
        for _ in range(ATTEMPTS):
            approach = approach_of(job, limits, controller.position(), start, controller.cycle)
            notes = controller.stream(approach, self.stop_requested).notes
            distance = np.abs(controller.position() - start).max()
            if self.stop_requested() or distance <= START:
                return
        raise ControllerRefused(
            f"The motion to the start was stopped in each of {ATTEMPTS} attempts: {' '.join(notes)}"
        )


def limits_of(job: Job, planned: RunResult) -> Limits:
    """Limits of a planned run, with the defaults of the arm."""
    return resolve_limits("play", job.arm, planned.run.limits)


def at_speed(chosen: Run, job: Job, factor: float, reserve: float = RESERVE) -> Run:
    """The run with limits for a speed factor, and with a minimum reserve."""
    limits = _scaled(resolve_limits("play", job.arm, chosen.limits), factor)
    changed = {x: getattr(limits, x) for x in POWERS if getattr(limits, x) is not None}
    timing = replace(chosen.timing, reserve=max(chosen.timing.reserve, reserve))
    return replace(chosen, limits=chosen.limits.replace(**changed), timing=timing)


def _scaled(limits: Limits, factor: float) -> Limits:
    """Limits scaled by a speed factor."""
    changed = {
        name: np.multiply(getattr(limits, name), factor**power)
        for name, power in POWERS.items()
        if getattr(limits, name) is not None
    }
    return limits.replace(**changed)


def approach_of(
    job: Job, limits: Limits, position: FloatArray, start: FloatArray, cycle: float
) -> Motion:
    """Straight motion in joint space to the first set-point, without contact.

    Raises:
        ControllerRefused: The arm would come too near to itself or its cell.
    """
    line = JointPath.spline(np.stack([position, start]), [0.0, 1.0])
    _check_clear(job, line)
    trajectory = plan(line, job.arm, limits.of_joints, Optimal(reserve=RESERVE))
    return uncompensated_motion(trajectory, job.arm, cycle)


def _check_clear(job: Job, line: JointPath) -> None:
    """Refuse a joint path in which the arm comes too near to itself or to its cell."""
    clearance = clearance_of(job, line)
    if clearance is not None and not clearance.satisfied:
        raise ControllerRefused(
            f"The straight motion in joint space to the start is not possible: "
            f"{clearance.sentence} Move the robot to the start by other means."
        )


def _check_same_plan(set_points: SetPoints, planned: RunResult) -> None:
    """Refuse learned set-points whose plan differs from that of the job."""
    before, now = set_points.trajectory, planned.trajectory
    if (
        abs(before.duration - now.duration) > 1e-9
        or np.abs(before(before.duration / 2) - now(before.duration / 2)).max() > 1e-9
    ):
        raise InvalidInput(
            "The learned set-points belong to another plan, because the job has changed since. "
            "Learn again."
        )


def _predicted(planned: RunResult, cycle: float) -> FloatArray:
    """Simulated joint positions at the cycles of the controller [rad], (n, dof)."""
    executed = planned.execution
    assert executed is not None
    begin = planned.set_points.start_time
    t = begin + np.arange(math.ceil((executed.t[-1] - begin) / cycle) + 1) * cycle
    return np.column_stack([np.interp(t, executed.t, x) for x in executed.q.T])
