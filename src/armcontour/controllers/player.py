"""`play`: plan a run for a robot, play its set-points and record the motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeAlias

import numpy as np

from armcontour.control.compensation import CompensationOptions, NoCompensation
from armcontour.control.compensation.compensator import unchecked_set_points
from armcontour.controllers.controller import (
    START_TOLERANCE,
    START_TOLERANCE_LINEAR,
    Controller,
    Motion,
    PlayedMotion,
    Stop,
    per_joint,
)
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerLost, ControllerRefused, InvalidInput, NotRealizable
from armcontour.core.fields import checked, declared
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import (
    AngularDistance,
    Axes,
    Quantity,
    SpeedFactor,
    any_unit,
    joint_units,
)
from armcontour.core.render import Result, figure, number
from armcontour.core.result import FIRST, JUDGED, VERDICT, Data, Row
from armcontour.core.sampled_data import differences, interpolate
from armcontour.core.text import list_some
from armcontour.jobs.alternatives import clearance_of
from armcontour.jobs.job import Job, Run, choose_run
from armcontour.jobs.rows import reason_of
from armcontour.jobs.run_job import run
from armcontour.jobs.run_learning import measured_pieces
from armcontour.jobs.run_result import RunResult
from armcontour.jobs.stopped_place import StoppedPlace, find_stopped_place
from armcontour.jobs.verdict import Errors
from armcontour.motion import Execution, JointPath, Log, SetPoints, Trajectory
from armcontour.motion.log import FEWEST
from armcontour.planning import Optimal, at_speed, plan
from armcontour.planning.stop_in_play import plan_stop
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.arm import unit_of
from armcontour.robot.limit_use import use_of
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.simulation import command_weights

# Duration of the rest that is appended to a motion: the joints settle and the last samples arrive
# [s].
FINAL_REST = 1.0
# Tolerance between the set-points of a stop and those of the plan, before the stop begins [rad].
PLAN_TOLERANCE = 1e-7
# Differences from the simulation are divided by at least this tolerance [rad].
LEAST_SCALE = 1e-7
# First guess: the compensation looks ahead by this number of set-points. It is doubled until the
# set-points before the stop no longer change.
FORESIGHT = 16
# Maximum number of set-points by which the compensation may look ahead.
LONGEST_FORESIGHT = 256
# Duration in which a stop reduces learned corrections to 0 [s].
CORRECTION_FADING = 0.2
# Default band: a revolute joint may differ from its prediction by this distance [rad], and by the
# distance of BAND_LAG. A joint may also rest this far from its simulated end, and motions up to
# this distance do not show whether a drive moves.
BAND_LEAST = 2e-3
# The same for a linear axis [m], whose band is not specified.
BAND_LEAST_LINEAR = 2e-3
# Default band: a joint may also differ from its prediction by the distance that it moves in this
# time at its largest speed [s].
BAND_LAG = 0.05
# The same if the servo is unknown, instead of BAND_LAG [s].
BAND_LAG_OF_UNKNOWN_SERVO = 0.25
# Band of revolute joints [rad], or of each joint, (dof,); None for the default.
Band: TypeAlias = float | FloatArray | None
JointDistances = Annotated[FloatArray, Quantity("rad"), Axes("joints")]
# Default speed factor, and largest speed factor of the motion to the start.
DEFAULT_SPEED_FACTOR = 0.1
# Minimum reserve of a plan that moves a robot. Without reserve, a servo that differs slightly from
# its model saturates, and a stop may be impossible where a limit is active.
PLAYED_RESERVE = 0.02
# Drives that execute less than this fraction of a motion have not moved.
LEAST_MOVED_SHARE = 0.1
# A whole turn [rad], which no joint moves to the start.
APPROACH_TURN = 2 * np.pi
# Relative excess of a limit that is ignored as a rounding error.
SET_POINT_LIMIT_ROUNDING = 1e-6
# Two plans are the same if their durations [s] and their joint positions at half of the duration
# [rad] differ by at most this.
SAME_PLAN = 1e-9
# Cycles that differ by less than this [s] are equal.
SAME_CYCLE = 1e-12
# Maximum number of outputs that a sentence names.
MAX_OUTPUTS = 6
# Maximum number of attempts to play a motion that late set-points disturb.
ATTEMPTS = 3


def commands_at(set_points: SetPoints, cycle: float, interpolation: str) -> FloatArray:
    """Sample set-points at a controller's cycles [rad], (n, dof), with a rest at the end.

    Args:
        set_points: The set-points.
        cycle: Cycle of the controller [s].
        interpolation: Interpolation between set-points, as in `ServoModel`.
    """
    q = set_points.q
    rest = np.repeat(q[-1:], round(FINAL_REST / cycle), axis=0)
    if abs(set_points.cycle - cycle) < SAME_CYCLE:
        return np.concatenate([q, rest])
    t = np.arange(0.0, (len(q) - 1) * set_points.cycle + cycle / 2, cycle)
    index, weight = command_weights(len(q), set_points.cycle, interpolation, t)
    return np.concatenate([np.einsum("nk,nkj->nj", weight, q[index]), rest])


class Stopper:
    """Compute the set-points of stops on a plan's path.

    Args:
        set_points: The set-points that are played; learned ones keep their corrections, which fade
            out in a stop.
        servo: The servo model of the compensation.
        options: Options of the compensation.
        arm: The arm.
        cycle: Cycle of the controller [s].
    """

    def __init__(
        self,
        set_points: SetPoints,
        servo: ServoModel,
        options: CompensationOptions,
        arm: Arm,
        cycle: float,
    ) -> None:
        self.set_points = set_points
        self.servo = servo
        self.options = options
        self.arm = arm
        self.cycle = cycle
        self.q = commands_at(set_points, cycle, servo.interpolation)
        # If the robot has more dead time than its model, learned set-points start whole cycles
        # earlier than the planned set-points. Row k of the learned set-points corresponds to row k
        # of the planned set-points in any case.
        planned = self._compensate(set_points.trajectory)
        self._start_time = planned.start_time
        self._planned = commands_at(planned, cycle, servo.interpolation)

    def __call__(self, k: int) -> Stop:
        """Compute the stop that replaces the set-points from cycle k on.

        Raises:
            NotRealizable: The stop would also change set-points before k.
        """
        return self._find(k)[0]

    def end_of(self, k: int) -> float:
        """Return the time at which the plan is where the stop from cycle k on ends [s].

        Raises:
            NotRealizable: The stop would also change set-points before k.
        """
        return self._find(k)[1]

    def _find(self, k: int) -> tuple[Stop, float]:
        """Find the stop from cycle k on, and the time at which the plan is where it ends [s]."""
        plan = self.set_points.trajectory
        foresight = FORESIGHT
        while foresight <= LONGEST_FORESIGHT:
            t = k * self.cycle + self._start_time
            t += float(np.max(self.servo.dead_time)) + foresight * self.set_points.cycle
            if t >= plan.duration:
                return Stop(k=k, q=self.q[min(k, len(self.q) - 1) :]), plan.duration
            early = plan_stop(plan, max(t, 0.0))
            stopped = self._compensate(early.trajectory)
            if abs(stopped.start_time - self._start_time) > PLAN_TOLERANCE * stopped.cycle:
                raise NotRealizable(
                    "The set-points of a stop start at another time than the plan's."
                )
            q = commands_at(stopped, self.cycle, self.servo.interpolation)
            if np.abs(q[:k] - self._planned[:k]).max(initial=0.0) < PLAN_TOLERANCE:
                return Stop(k=k, q=q[k:] + self._correction(k, len(q) - k)), early.end
            foresight *= 2
        raise NotRealizable(
            f"The set-points before cycle {k} depend on the stop after it, because the "
            f"compensation looks ahead by more than {LONGEST_FORESIGHT} set-points. Choose faster "
            "poles or wider command limits."
        )

    def _compensate(self, trajectory: Trajectory) -> SetPoints:
        """Compute the set-points of a trajectory, with the plan's compensation."""
        cycle = self.set_points.cycle
        return unchecked_set_points(trajectory, self.servo, self.options, cycle=cycle, arm=self.arm)

    def _correction(self, k: int, count: int) -> FloatArray:
        """Return the learned correction from cycle k on, which fades out [rad], (count, dof)."""
        learned = self.q[k : k + count] - self._planned[k : k + count]
        number = np.arange(count)
        x = np.clip(number * self.cycle / CORRECTION_FADING, 0.0, 1.0)
        faded = 1 - x**3 * (10 - x * (15 - 6 * x))
        return np.asarray(learned[np.minimum(number, len(learned) - 1)] * faded[:, None])


def uncompensated_motion(trajectory: Trajectory, arm: Arm, cycle: float) -> Motion:
    """Make a motion along a trajectory, with its stops; set-points are not compensated."""
    q = trajectory.sample(cycle).q
    set_points = SetPoints(cycle=cycle, q=q, trajectory=trajectory, method="none")
    stopper = Stopper(set_points, ServoModel(order="delay"), NoCompensation(), arm, cycle)
    return guarded_motion(stopper, stopper.q, BAND_LAG_OF_UNKNOWN_SERVO)


def guarded_motion(
    stopper: Stopper, predicted: FloatArray, lag: float, band: Band = None
) -> Motion:
    """Make a motion that stops if a joint leaves a band around its predicted positions.

    `band`: the band of revolute joints [rad], or of each joint, (dof,); by default 2 mrad or 2 mm,
    plus the distance that a joint moves in the time `lag` [s] at its largest speed.
    """
    speed = np.abs(np.diff(predicted, axis=0)).max(axis=0, initial=0.0) / stopper.cycle
    arm = stopper.arm
    allowed = per_joint(arm, BAND_LEAST, BAND_LEAST_LINEAR, arm.dof) + lag * speed
    if band is not None:
        allowed = _with_band(arm, allowed, band)
    return Motion(q=stopper.q, next_stop=stopper, predicted=predicted, band=allowed)


def _with_band(arm: Arm, default: FloatArray, band: float | FloatArray) -> FloatArray:
    """Return the band of each joint, (dof,): `band` itself if it is an array.

    Otherwise the band is `band` [rad] for revolute joints, and `default` for prismatic ones.
    """
    if isinstance(band, np.ndarray):
        return band
    return np.where(arm.chain.slides, default, band)


def _rest_tolerance(arm: Arm, band: Band) -> FloatArray:
    """Return how far each joint may rest from its simulated end [rad], (dof,)."""
    default = per_joint(arm, BAND_LEAST, BAND_LEAST_LINEAR, arm.dof)
    return default if band is None else _with_band(arm, default, band)


def largest_distance(distances: FloatArray, arm: Arm) -> Row:
    """Return the row with the largest distance of a joint, per unit if the units differ.

    `distances`: distance of each joint [rad], (dof,).
    """
    slides = arm.chain.slides
    unit = any_unit("rad", slides)
    if slides.any() and not slides.all():
        value: Any = [float(distances[~slides].max()), float(distances[slides].max())]
    else:
        value = float(distances.max(initial=0.0))
    return Row("distance", value, unit, "distance from the start", level=FIRST)


@declared(eq=False)
class Played(Result):
    """A motion of a robot, or the motion that a dry run has checked.

    Args:
        job: The job with the run as it is played.
        plan: Plan and simulation of this run, with the set-points that are played.
        controller: Name of the controller.
        speed_factor: Fraction of the planned speed.
        checks: What was compared with the controller.
        motion: Set-points and predicted positions at the cycles of the controller.
        distances: Distance of each joint from the first set-point before the motion [rad], (dof,);
            None before it is measured.
        approach_speed: Largest tool speed of the motion to the start [m/s]; None if the robot is at
            the start.
        approaches: Distance that each joint has moved on the way to the start [rad], (dof,); None
            if no joint has moved.
        record: What the controller recorded; None in a dry run.
        kept: True if the robot completed the run as simulated; None if that was not judged.
        reason: The requirement that decides, as a clause; empty if none decides.
        differences: Differences of the motion from the simulation, and its contour error.
        stopped_at: Where to resume the job after a stop; None if the motion was not stopped.
    """

    job: Job
    plan: RunResult
    controller: str
    speed_factor: float
    checks: tuple[Row, ...]
    motion: Motion
    distances: JointDistances | None = None
    approach_speed: float | None = None
    approaches: JointDistances | None = None
    record: PlayedMotion | None = None
    kept: bool | None = None
    reason: str = ""
    differences: tuple[Row, ...] = ()
    stopped_at: StoppedPlace | None = None

    @property
    def distance(self) -> float:
        """Largest of the `distances`, in rad or m; 0 before they are measured."""
        return 0.0 if self.distances is None else float(self.distances.max())

    @property
    def approach(self) -> float:
        """Largest of the `approaches`, in rad or m; 0 if no joint has moved."""
        return 0.0 if self.approaches is None else float(self.approaches.max())

    @property
    def executed(self) -> bool:
        """True if the robot has moved, or was to play the motion."""
        return self.record is not None or self.approaches is not None

    @property
    def outputs_note(self) -> str:
        """Return a sentence that names the outputs that are not switched; empty without outputs."""
        events = (x.name for x in self.plan.trajectory.events)
        names = list(dict.fromkeys((*events, *self.job.process.analog_names)))
        if not names:
            return ""
        listed = list_some(names, MAX_OUTPUTS)
        return f"no outputs are switched on the robot; those of the job are {listed}."

    @property
    def log(self) -> Log:
        """Return the log for `identify` and `learn`, with the commands that the robot used.

        Raises:
            InvalidInput: A dry run.
        """
        record = self.record
        if record is None:
            raise InvalidInput("A dry run has no log. Set execute=True.")
        return Log(
            t=record.t,
            command=record.command,
            measured=record.measured,
            joint_names=self.job.arm.joint_names,
            interpolation="linear",
            source=self.controller,
            notes=record.notes,
            prismatic=self.job.arm.chain.prismatic or (),
        )

    def _verdict_rows(self) -> Iterator[Row]:
        """Yield the row of the verdict, if the motion was judged."""
        if self.kept is not None:
            yield Row("kept", self.kept, JUDGED, "verdict", self.reason, VERDICT)

    def _resume_rows(self) -> Iterator[Row]:
        """Yield the option that resumes a stopped job, and its value, if the motion was stopped."""
        place = self.stopped_at
        if place is not None:
            answer = place.option or place.words
            note = place.words if place.option else ""
            yield Row("resume.option", answer, "", "to continue", note, FIRST)
            yield Row("resume.at", place.resume_at, "m")

    def to_data(self) -> Data:
        """Return rows on the run, the checks, and the motion if one was executed."""
        record = self.record
        moved = None if record is None else record.stopped is None
        arm = self.job.arm
        distances = np.zeros(arm.dof) if self.distances is None else self.distances
        rows = [
            Row("executed", self.executed, "", "executed", level=VERDICT),
            *self._verdict_rows(),
            *self._resume_rows(),
            *self.differences,
            Row("controller", self.controller, "", "controller", level=FIRST),
            Row("run", self.plan.run.name, "", "run", level=FIRST),
            Row("speed_factor", self.speed_factor, "1", "share of the speed", level=FIRST),
            Row("duration", self.plan.trajectory.duration, "s", "duration", level=FIRST),
            largest_distance(distances, arm),
            Row("approach_speed", self.approach_speed, "m/s", "tool speed to the start, largest"),
            *self.checks,
            Row("completed", moved, "", "played to its end", level=FIRST),
        ]
        notes = () if record is None else record.notes
        if record is None and self.approaches is not None:
            notes = (
                "Stopped on the way to the start: the joints have moved by up to "
                f"{figure(largest_distance(self.approaches, arm))}.",
            )
        if not self.executed and self.outputs_note:
            notes = (*notes, self.outputs_note)
        return Data(f"Run {self.plan.run.name} on {self.controller}", tuple(rows), notes=notes)


@checked
def play(
    job: Job,
    controller: Controller,
    *,
    run_name: str | None = None,
    execute: bool = False,
    speed_factor: SpeedFactor | None = None,
    band: AngularDistance | None = None,
    set_points: SetPoints | None = None,
    stop_requested: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
) -> Played:
    """Play the set-points of a run on a robot, and record its joints.

    The run is planned with a reserve of at least 2 %, stretched in time to the speed factor, and
    then compensated; set-points themselves are never stretched. The robot moves to the start on a
    straight line in joint space, at most at 10 % of its speed. A stop ends on the path and respects
    the limits. No output is switched. The result compares the measured motion with the simulation.

    >>> from armcontour.controllers import LinuxCNC
    >>> ac.play(ac.read_job("job.yaml"), LinuxCNC("machine.hal")).record is None
    True

    Args:
        job: The job.
        controller: The controller, not connected.
        run_name: The run; by default the only one.
        execute: True moves the robot. False is a dry run, which only compares arm, limits,
            set-points and position.
        speed_factor: Fraction of the planned speed, of contours and rapids; accelerations change by
            its square, jerks by its cube. By default that of the run, or 10 % if it has none.
        band: Largest difference of a revolute joint from its simulated position before the motion
            is stopped [rad]; by default 2 mrad and the distance that it moves in 50 ms at its
            largest speed. The band of a linear axis is always 2 mm and the distance of 50 ms.
        set_points: Set-points of `learn` for this run, which replace the compensation's; with the
            speed factor with which they were learned.
        stop_requested: Called often during the motion; True stops it on its path.
        progress: Called with the steps.

    Raises:
        ControllerRefused: The controller cannot be reached or differs from the plan, and nothing
            moves; or the drives do not follow their commands.
        ControllerLost: The controller failed during the motion.
        ArmContourError: The run cannot be planned.
    """
    learned = set_points is not None
    played_job, planned = plan_kept(job, run_name, speed_factor, learned, progress)
    ready = prepare_motion(played_job, planned, controller, set_points=set_points, band=band)
    played = Player(controller, execute, stop_requested, progress).play(ready)
    return judge_motion(played, controller.cycle, band)


def plan_kept(
    job: Job,
    run_name: str | None,
    speed_factor: float | None,
    learned: bool,
    progress: Progress | None,
) -> tuple[Job, RunResult]:
    """Plan the run of `play`; `learned`: whether set-points of `learn` will be played."""
    if speed_factor is None:
        speed_factor = choose_run(job, run_name, "played").speed_factor
    if learned and speed_factor is None:
        raise InvalidInput(
            "Learned set-points are valid at the speed at which they were learned only. Specify "
            "the speed factor, which is 100 % unless you learned with another one."
        )
    speed_factor = DEFAULT_SPEED_FACTOR if speed_factor is None else speed_factor
    played_job, planned = plan_played(job, run_name, speed_factor, progress=progress)
    if planned.kept is False:
        raise ControllerRefused(
            f"In the simulation, run {planned.run.name} exceeds a limit or the allowed error. "
            "`armcontour run` lists the excess."
        )
    return played_job, planned


def plan_played(
    job: Job,
    run_name: str | None,
    speed_factor: float | None = None,
    reserve: float = PLAYED_RESERVE,
    progress: Progress | None = None,
) -> tuple[Job, RunResult]:
    """Plan a run as it is played; return the job with this run, and the result.

    The run has all limits of the arm, and at least the reserve. Its speed factor is `speed_factor`;
    by default it does not change.

    Raises:
        InvalidInput: The job waits for an input.
    """
    if job.process.waits:
        raise InvalidInput(
            f"A motion that is played cannot wait for an input, but process.wait waits for "
            f"{job.process.waits[0].input}. Add --process-off (process.off), remove process.wait, "
            "or export a program (urscript, kuka or abb), which waits."
        )
    chosen = choose_run(job, run_name, "played")
    played_run = replace(
        chosen,
        limits=resolve_limits("play", job.arm, chosen.limits),
        timing=replace(chosen.timing, reserve=max(chosen.timing.reserve, reserve)),
        speed_factor=chosen.speed_factor if speed_factor is None else speed_factor,
    )
    played_job = replace(job, runs=(played_run,))
    return played_job, run(played_job, progress=progress).runs[chosen.name]


def prepare_motion(
    job: Job,
    planned: RunResult,
    controller: Controller,
    *,
    set_points: SetPoints | None = None,
    band: Band = None,
    lag: float = BAND_LAG,
) -> Played:
    """Make the motion of a planned run, and check it against the controller without a connection.

    `set_points`: learned set-points; by default those of the plan. `band`, `lag`: see
    `guarded_motion`.
    """
    points = planned.set_points if set_points is None else set_points
    stopper = Stopper(points, job.servo, planned.run.compensation, job.arm, controller.cycle)
    t = points.times(len(stopper.q), controller.cycle)
    if set_points is None:
        simulated = planned.execution
        bodies = planned.experiment
        if bodies is not None and planned.judged is bodies.evaluation:
            simulated = bodies.execution
        assert simulated is not None
        predicted = interpolate(t, simulated.t, simulated.q)
    else:
        _check_same_plan(set_points, planned)
        predicted = planned.trajectory.with_rests(t)
    rows = controller.check(job.arm, planned.run.limits, stopper.q)
    is_safe = controller.simulates or job.servo.contour_ratio is not None
    rows.append(_check_accelerations(planned.run, points, is_safe))
    return Played(
        job=job,
        plan=replace(planned, set_points=points),
        controller=controller.name,
        speed_factor=points.trajectory.speed_factor,
        checks=tuple(rows),
        motion=guarded_motion(stopper, predicted, lag, band),
    )


@dataclass(frozen=True, slots=True)
class Player:
    """A controller, and how motions are played on it.

    Args:
        controller: The controller, not connected.
        execute: Whether the robot moves; otherwise the motion is only compared.
        stop_requested: Called often during a motion; True stops it on its path.
        progress: Called with the steps.
    """

    controller: Controller
    execute: bool = False
    stop_requested: Callable[[], bool] = lambda: False
    progress: Progress | None = None

    def play(
        self, ready: Played, is_final: Callable[[PlayedMotion], bool] = lambda record: True
    ) -> Played:
        """Play a motion, up to 3 times until a stop is requested or its record is final."""
        for _ in range(ATTEMPTS):
            played = self._play_once(ready)
            if played.record is None or self.stop_requested() or is_final(played.record):
                break
        return played

    def _play_once(self, ready: Played) -> Played:
        """Connect, move to the start, and play; a dry run only measures the distance."""
        report = subprogress(self.progress, ready.plan.run.name)
        start = ready.motion.q[0]
        with self.controller as controller:
            report(Step(("connecting",)))
            controller.connect(ready.job.arm, start)
            position = controller.position()
            distances = _measure_distances(ready, position)
            played = replace(ready, distances=distances)
            if not is_at_start(ready.job.arm, distances):
                approach = self._approach(played, position)
                speeds = Execution.from_plan(approach, ready.job.arm).tool_speed
                played = replace(played, approach_speed=float(speeds.max()))
            if not self.execute or self.stop_requested():
                return played
            if not is_at_start(ready.job.arm, distances):
                report(Step(("moving to the start",)))
                self._move_to_start(played)
                approaches = np.abs(controller.position() - position)
                played = replace(played, approaches=approaches)
                if self.stop_requested():
                    return played
            report(Step(("playing",)))
            return replace(played, record=self._stream(ready.motion, ready.job.arm))

    def _approach(self, ready: Played, position: FloatArray) -> Trajectory:
        """Plan the motion from a position to the first set-point."""
        limits = ready.plan.run.limits
        start = ready.motion.q[0]
        return approach_of(
            ready.job, limits, position, start, min(DEFAULT_SPEED_FACTOR, ready.speed_factor)
        )

    def _move_to_start(self, ready: Played) -> None:
        """Move in joint space to the first set-point, again if set-points were late."""
        job = ready.job
        start = ready.motion.q[0]
        controller = self.controller
        for _ in range(ATTEMPTS):
            position = controller.position()
            if is_at_start(job.arm, np.abs(position - start)):
                # Late set-points stopped the motion at its end.
                return
            approach = self._approach(ready, position)
            motion = uncompensated_motion(approach, job.arm, controller.cycle)
            record = self._stream(motion, job.arm)
            distances = np.abs(record.measured[-1] - start)
            arrived = bool((distances <= _rest_tolerance(job.arm, None)).all())
            if self.stop_requested() or (record.stopped is None and arrived):
                return
            if record.stopped is None or record.deviated:
                break
        remaining = figure(largest_distance(distances, job.arm))
        raise ControllerRefused(
            f"The motion to the start ended {remaining} from it. "
            f"{' '.join(record.notes) or 'Check the drives.'}"
        )

    def _stream(self, motion: Motion, arm: Arm) -> PlayedMotion:
        """Play a motion, and refuse drives that have not moved."""
        record = self.controller.stream(motion, self.stop_requested)
        if not len(record.t):
            raise ControllerRefused(f"Nothing was recorded: {' '.join(record.notes)}")
        commanded = np.ptp(record.command, axis=0)
        measured = np.ptp(record.measured, axis=0)
        least = per_joint(arm, BAND_LEAST, BAND_LEAST_LINEAR, arm.dof)
        j = int((commanded / least).argmax())
        if commanded[j] > least[j] and measured[j] < LEAST_MOVED_SHARE * commanded[j]:
            unit = unit_of(arm, "rad", j)
            raise ControllerRefused(
                f"The drives have not moved: joint {j + 1} was commanded to move by "
                f"{number(commanded[j], unit)}, but has moved by {number(measured[j], unit)}. "
                "Check that the drives are enabled, and that their positions are measured.",
                joint=j,
                needed=float(commanded[j]),
            )
        return record


def lost_motion(played: Played, lost: ControllerLost) -> Played:
    """Return the motion until its controller was lost; a note says that it is incomplete.

    If the record is too short for a log, the motion has none.
    """
    record = lost.record
    if not isinstance(record, PlayedMotion) or len(record.t) < FEWEST:
        return played
    note = f"This log is incomplete: {lost}"
    return replace(played, record=replace(record, faithful=False, notes=(note, *record.notes)))


def is_at_start(arm: Arm, distances: FloatArray) -> bool:
    """Return whether joints at these distances [rad], (dof,), are at the start."""
    return bool(
        (distances <= per_joint(arm, START_TOLERANCE, START_TOLERANCE_LINEAR, arm.dof)).all()
    )


def _measure_distances(ready: Played, position: FloatArray) -> FloatArray:
    """Return each joint's distance from the start [rad], (dof,).

    Raises:
        ControllerRefused: The robot cannot move there on a straight line in joint space.
    """
    start = ready.motion.q[0]
    arm = ready.job.arm
    lower, upper = ready.plan.run.limits.joint_range(len(start))
    distance = np.abs(position - start)
    tolerance = per_joint(arm, START_TOLERANCE, START_TOLERANCE_LINEAR, arm.dof)
    excess = np.maximum(lower - position, position - upper) - tolerance
    turn = np.where(ready.job.arm.chain.slides, np.inf, APPROACH_TURN)
    j = int(np.maximum(excess, distance - turn).argmax())
    if excess[j] > 0 or distance[j] >= turn[j]:
        unit = unit_of(ready.job.arm, "rad", j)
        where = f"{number(distance[j], unit)} from the start, at least a turn"
        if excess[j] > 0:
            where = f"outside its range of {number(lower[j], unit)} to {number(upper[j], unit)}"
        raise ControllerRefused(
            f"Joint {j + 1} is at {number(position[j], unit)}, {where}. Check unit and zero of "
            "its measured position, or move the joint by other means.",
            joint=j,
            needed=float(position[j]),
        )
    if not is_at_start(arm, distance):
        _clear_line(ready.job, position, start)
    return np.asarray(distance)


def approach_of(
    job: Job, limits: Limits, position: FloatArray, start: FloatArray, speed_factor: float
) -> Trajectory:
    """Plan the straight motion in joint space to the first set-point, at a fraction of full speed.

    Raises:
        ControllerRefused: The arm would come too near to itself or its cell.
    """
    line = _clear_line(job, position, start)
    fastest = plan(line, job.arm, limits.of_joints, Optimal(reserve=PLAYED_RESERVE))
    return at_speed(fastest, speed_factor)


def _clear_line(job: Job, position: FloatArray, start: FloatArray) -> JointPath:
    """Return the straight line in joint space; refuse it if the arm comes too near to something."""
    line = JointPath.spline(np.stack([position, start]), [0.0, 1.0])
    clearance = clearance_of(job, line)
    if clearance is not None and not clearance.satisfied:
        raise ControllerRefused(
            f"The straight motion in joint space to the start is not possible: "
            f"{clearance.sentence} Move the robot to the start by other means."
        )
    return line


@dataclass(frozen=True, slots=True, kw_only=True)
class _Difference:
    """Distance of a measured motion from its prediction.

    - `arm`: the arm.
    - `t`: times by the controller's clock [s], (n,).
    - `joints`: distance of each joint [rad], (n, dof).
    - `tool`: distance of the tool [m], (n,).
    - `tolerance`: largest distance of each joint at the end [rad], (dof,).
    """

    arm: Arm
    t: FloatArray
    joints: FloatArray
    tool: FloatArray
    tolerance: FloatArray

    @classmethod
    def of_motion(
        cls, played: Played, record: PlayedMotion, cycle: float, band: float | None
    ) -> _Difference:
        """Compare a recorded motion with its prediction, until a stop."""
        arm = played.job.arm
        motion = played.motion
        assert motion.predicted is not None
        k = np.rint(record.t / cycle).astype(int)
        if record.stopped is not None:
            k = k[k < max(record.stopped, 1)]
        measured = record.measured[: len(k)]
        predicted = motion.predicted[k.clip(0, len(motion.q) - 1)]
        return cls(
            arm=arm,
            t=record.t,
            joints=np.abs(measured - predicted),
            tool=np.linalg.norm(arm.tool_position(measured) - arm.tool_position(predicted), axis=1),
            tolerance=_rest_tolerance(arm, band),
        )

    @property
    def _ratio(self) -> FloatArray:
        """Distance of each joint as a multiple of its tolerance, (n, dof)."""
        # Distances in rad and in m are only comparable by this ratio. A tolerance may be 0.
        return self.joints / np.maximum(self.tolerance, LEAST_SCALE)

    def rows(self) -> list[Row]:
        """Return the largest distances of joints and tool."""
        i, j = divmod(int(self._ratio.argmax()), self.arm.dof)
        where = f"from the simulation, joint {j + 1} at {number(self.t[i], 's')}"
        when = f"from the simulation, at {number(self.t[self.tool.argmax()], 's')}"
        unit = unit_of(self.arm, "rad")
        joints = self.joints.max(axis=0)
        tool = float(self.tool.max())
        return [
            Row("difference.joints", joints, unit, "joint difference", where, FIRST),
            Row("difference.tool", tool, "m", "tool difference", when, FIRST),
        ]

    def rest_fault(self) -> str:
        """Say which joint rests too far from its simulated end; "" if none does."""
        final_distances = self.joints[-1]
        j = int(self._ratio[-1].argmax())
        if final_distances[j] <= self.tolerance[j]:
            return ""
        distance = number(final_distances[j], unit_of(self.arm, "rad", j))
        return f"joint {j + 1} rests {distance} from its simulated end"


def judge_motion(played: Played, cycle: float, band: float | None) -> Played:
    """Add the verdict on a recorded motion, and its differences from the simulation."""
    record = played.record
    if record is None:
        return played
    planned = played.plan
    assert planned.judged is not None
    difference = _Difference.of_motion(played, record, cycle, band)
    rows = difference.rows()
    kept = False
    reason = " ".join(record.notes) or "stopped on request"
    if record.stopped is None:
        t = planned.set_points.start_time + record.t
        errors = Errors.of_pieces(measured_pieces(played.job, planned, t, record.measured))
        largest = max(errors.contour)
        note = f"simulated {number(planned.judged.contour_error.max, 'm')}"
        rows.append(Row("contour_error.max", largest, "m", "contour error", note, FIRST))
        verdict = planned.judge({"measured": errors})
        fault = difference.rest_fault()
        kept = verdict.kept is not False and not fault
        reason = fault or reason_of(planned.run, verdict)
    return replace(
        played,
        kept=kept,
        reason=reason,
        differences=tuple(rows),
        stopped_at=_place_of_stop(played, record),
    )


def _place_of_stop(played: Played, record: PlayedMotion) -> StoppedPlace | None:
    """Find where to resume the job after a stop; None if the motion was not stopped."""
    stopper = played.motion.next_stop
    if record.stopped is None or not isinstance(stopper, Stopper):
        return None
    t = played.plan.set_points.start_time + record.t
    end = stopper.end_of(record.stopped)
    return find_stopped_place(played.job, played.plan, end, t, record.measured)


def _check_same_plan(set_points: SetPoints, planned: RunResult) -> None:
    """Refuse learned set-points whose plan differs from the job's."""
    before = set_points.trajectory
    now = planned.trajectory
    if (
        abs(before.duration - now.duration) > SAME_PLAN
        or np.abs(before(before.duration / 2) - now(before.duration / 2)).max() > SAME_PLAN
    ):
        raise InvalidInput(
            f"The learned set-points belong to another plan, which takes "
            f"{number(before.duration, 's')} instead of {number(now.duration, 's')}. The job or "
            "its speed factor has changed since. Use those with which you learned, or learn again."
        )


def _check_accelerations(run: Run, points: SetPoints, is_safe: bool) -> Row:
    """Compare the set-points' accelerations with the limits; return the ratio per joint."""
    limits = run.limits
    use = use_of("joint_acceleration", limits, differences(points.q, 2) / points.cycle**2)
    i, j = divmod(int(use.ratio.argmax()), use.ratio.shape[1])
    needed = float(use.value[i, j])
    ratio = float(use.ratio[i, j])
    if ratio > 1 + SET_POINT_LIMIT_ROUNDING and not is_safe:
        unit = joint_units("rad/s^2", limits.prismatic or (False,) * (j + 1))[j]
        raise ControllerRefused(
            f"The set-points of run {run.name} demand {number(needed, unit)} of joint "
            f"{j + 1}, above its limit {number(needed / ratio, unit)}, because they "
            "compensate a servo that was not identified. Identify it (armcontour identify --on), "
            "and copy the key servo of servo.yaml, with contour_ratio, to the job. Or play without "
            f"compensation (--set runs.{run.name}.compensation.method=none).",
            joint=j,
            needed=needed,
            allowed=needed / ratio,
        )
    return Row("command_use", use.ratio.max(axis=0), "1", "set-point acceleration", "of the limit")
