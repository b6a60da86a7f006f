"""`play`: plan a run for a robot, play its set-points and record the motion."""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass, replace
from typing import Annotated, Any, TypeAlias

import numpy as np

from armcontour.control.compensation import NoCompensation
from armcontour.controllers.controller import (
    START_TOLERANCE,
    START_TOLERANCE_LINEAR,
    Controller,
    Motion,
    PlayedMotion,
    per_joint,
)
from armcontour.controllers.path_back import check_configuration, way_to_start
from armcontour.controllers.rolling_rows import (
    SAME_PLAN_TIME,
    Prediction,
    RollingRows,
    predict_plan,
    predict_servo,
)
from armcontour.core.checks import FloatArray
from armcontour.core.errors import ControllerLost, ControllerRefused, InvalidInput
from armcontour.core.fields import checked, declared
from armcontour.core.progress import Progress, Step, subprogress
from armcontour.core.quantities import (
    AngularDistance,
    Axes,
    Quantity,
    SpeedFactor,
    any_unit,
)
from armcontour.core.render import Result, figure, number
from armcontour.core.result import FIRST, JUDGED, VERDICT, Data, Row
from armcontour.core.sampled_data import interpolate
from armcontour.core.text import list_some
from armcontour.core.validity import AS_MODELLED, AT_ENCODERS, OF_LOGS, OF_SIMULATION
from armcontour.jobs.alternatives import clearance_of
from armcontour.jobs.job import Job, Run, choose_run
from armcontour.jobs.rows import reason_of
from armcontour.jobs.run_job import run
from armcontour.jobs.run_learning import measured_pieces
from armcontour.jobs.run_result import RunResult
from armcontour.jobs.stopped_place import StoppedPlace, find_stopped_place
from armcontour.jobs.verdict import Errors
from armcontour.motion import Execution, JointPath, Log, SetPoints, Trajectory
from armcontour.motion.controller_facts import ControllerFacts, facts_of_player
from armcontour.motion.log import FEWEST
from armcontour.planning import Optimal, at_speed, plan
from armcontour.planning.constraints import RapidSpeed
from armcontour.program import contour_called
from armcontour.robot import Arm, Limits, resolve_limits
from armcontour.robot.arm import unit_of
from armcontour.robot.limits import LIMITS
from armcontour.robot.servo import ServoModel
from armcontour.robot.servo.simulation import ServoSimulation

# Differences from the simulation are divided by at least this tolerance [rad].
LEAST_SCALE = 1e-7
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
# Default speed at the start, and largest speed factor of the motion to the start.
DEFAULT_SPEED_FACTOR = 0.1
# Minimum reserve of a plan that moves a robot. Without reserve, a servo that differs slightly from
# its model saturates, and the override may not change where a limit is active.
PLAYED_RESERVE = 0.02
# The same with limits of jerk: with a smaller reserve, changes of the override take seconds.
PLAYED_JERK_RESERVE = 0.05
# Drives that execute less than this fraction of a motion have not moved.
LEAST_MOVED_SHARE = 0.1
# A whole turn [rad], which no joint moves to the start.
APPROACH_TURN = 2 * np.pi
# Two plans are the same if their durations [s] and their joint positions at half of the duration
# [rad] differ by at most this.
SAME_PLAN = 1e-9
# Samples at the same time of the plan are put apart by this fraction of the time between them.
SAMPLE_SEPARATION = 1e-9
# The motion pauses while the plan's time goes on more slowly than this.
PAUSED_RATE = 1e-6
# The speed is steady while its share changes by less than this from sample to sample.
STEADY_RATE = 1e-6
# Maximum number of outputs that a sentence names.
MAX_OUTPUTS = 6
# Maximum number of attempts to play a motion that late set-points disturb.
ATTEMPTS = 3


def uncompensated_motion(trajectory: Trajectory, arm: Arm, cycle: float) -> Motion:
    """Make a motion along a trajectory; set-points are not compensated."""
    q = trajectory.sample(cycle).q
    set_points = SetPoints(cycle=cycle, q=q, trajectory=trajectory, method="none")
    rows = RollingRows(set_points, ServoModel(order="delay"), NoCompensation(), arm, cycle)
    return guarded_motion(rows, rows.q, BAND_LAG_OF_UNKNOWN_SERVO)


def guarded_motion(
    rows: RollingRows, predicted: FloatArray, lag: float, band: Band = None
) -> Motion:
    """Make a motion that stops if a joint leaves a band around its predicted positions.

    - `predicted`: the predicted positions at full speed [rad], (n, dof).
    - `lag`: by default the band is 2 mrad or 2 mm, plus the distance that a joint moves in this
      time at its largest speed [s], times the override.
    - `band`: the band of revolute joints [rad], or of each joint, (dof,).
    """
    arm = rows.arm
    speed = np.abs(np.diff(predicted, axis=0)).max(axis=0, initial=0.0) / rows.cycle
    least = per_joint(arm, BAND_LEAST, BAND_LEAST_LINEAR, arm.dof)
    moving = lag * speed
    if band is not None:
        least = _with_band(arm, least, band)
        # A band that was specified is the same at every speed.
        moving = np.where(arm.chain.slides, moving, 0.0)
        if isinstance(band, np.ndarray):
            moving = np.zeros(arm.dof)
    return Motion(q=rows.q, rows=rows, predicted=predicted, band=least, moving_band=moving)


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
        speed_factor: Fraction of the planned speed at the start.
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
            plan_time=record.plan_time,
        )

    def _verdict_rows(self) -> Iterator[Row]:
        """Yield the row of the verdict, if the motion was judged."""
        if self.kept is not None:
            yield Row("kept", self.kept, JUDGED, "verdict", self.reason, VERDICT, holds=AT_ENCODERS)

    def _resume_rows(self) -> Iterator[Row]:
        """Yield the option that resumes a stopped job, and its value, if the motion was stopped."""
        place = self.stopped_at
        if place is not None:
            answer = place.option or place.words
            note = place.words if place.option else ""
            yield Row("resume.option", answer, "", "to continue", note, FIRST)
            yield Row("resume.at", place.resume_at, "m")
            # `armcontour play --resume` reads these values.
            yield Row("resume.place", place.words)
            yield Row("resume.job", place.job)
            yield Row("resume.run", place.run)
            yield Row("resume.only", place.only)

    def _speed_row(self) -> Row:
        """Return the speed at the start, and whether it is the largest one."""
        is_slow = self.plan.trajectory.speed_factor == self.speed_factor < 1.0
        note = "and at most: at full speed, the run is not kept" if is_slow else ""
        return Row("speed_factor", self.speed_factor, "1", "speed at the start", note, FIRST)

    def _override_rows(self) -> Iterator[Row]:
        """Yield how long the motion took, its lowest override, and how long it paused."""
        record = self.record
        if record is None or len(record.t) < 2:
            return
        rate = np.diff(record.plan_time) / np.diff(record.t)
        is_paused = rate <= PAUSED_RATE
        paused = float(np.diff(record.t)[is_paused].sum())
        yield Row("played_time", float(record.t[-1]), "s", "time on the robot")
        # While the speed changes, as before a pause, it is not one that was wanted.
        is_steady = np.abs(np.diff(rate, prepend=np.nan, append=np.nan)) < STEADY_RATE
        is_steady = is_steady[:-1] & is_steady[1:] & ~is_paused
        if is_steady.any():
            lowest = float(rate[is_steady].min())
            yield Row("override.lowest", min(lowest, 1.0), "1", "lowest speed, without changes")
        yield Row("override.paused", paused, "s", "paused")

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
            self._speed_row(),
            Row("duration", self.plan.trajectory.duration, "s", "duration at 100 %", level=FIRST),
            *self._override_rows(),
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
        return Data(
            f"Run {self.plan.run.name} on {self.controller}",
            tuple(rows),
            notes=notes,
            not_proven=OF_LOGS if self.executed else OF_SIMULATION,
        )


@checked
def play(
    job: Job,
    controller: Controller,
    *,
    run_name: str | None = None,
    execute: bool = False,
    override: SpeedFactor | Callable[[], float] | None = None,
    band: AngularDistance | None = None,
    set_points: SetPoints | None = None,
    resume: StoppedPlace | None = None,
    pause_after: Callable[[], bool] = lambda: False,
    stop_requested: Callable[[], bool] = lambda: False,
    progress: Progress | None = None,
) -> Played:
    """Play the set-points of a run on a robot, and record its joints.

    The run is planned for full speed with a reserve of at least 2 %, 5 % with limits of jerk. The
    override is the share of this speed, and can change at any time: the joints then move through
    the same positions more slowly, by changes that use half of the reserve, and the set-points are
    compensated anew. A pause and a stop end at rest on the path, also if this process fails. The
    robot moves to the start on a straight line in joint space, at most at 10 % of its speed; a
    robot that has stopped on the path moves back along it, and one that has stopped on a rapid
    completes it. No output is switched. The result
    compares the measured motion with the simulation.

    >>> from armcontour.controllers import LinuxCNC
    >>> ac.play(ac.read_job("job.yaml"), LinuxCNC("machine.hal")).record is None
    True

    Args:
        job: The job.
        controller: The controller, not connected.
        run_name: The run; by default the only one.
        execute: True moves the robot. False is a dry run, which only compares arm, limits,
            set-points and position.
        override: Share of the planned speed, of contours and rapids, up to 1; or a function that
            returns it and is called often by another thread, with 0 for a pause. By default the
            speed factor of the run, or 10 % if it has none.
        band: Largest difference of a revolute joint from its simulated position before the motion
            is stopped [rad]; by default 2 mrad and the distance that it moves in 50 ms at its
            largest speed. The band of a linear axis is always 2 mm and the distance of 50 ms.
        set_points: Set-points of `learn` for this run, which replace the compensation's. They
            belong to the speed factor of the run, so the override is 100 % by default. While it is
            lower, the learned corrections fade out.
        resume: Where an earlier motion of the job was stopped (`Played.stopped_at`): the rest of
            the job is played, by default of the same run.
        pause_after: Called often by another thread. While it returns True, the motion pauses at the
            end of the contour that is executed; a contour whose last set-points are already sent,
            about 0.35 s before its end, is completed together with the next one.
        stop_requested: Called often during the motion; True stops it on its path.
        progress: Called with the steps.

    Raises:
        InvalidInput: The motion that was stopped belongs to another job, or nothing is left.
        ControllerRefused: The controller cannot be reached or differs from the plan, and nothing
            moves; or the drives do not follow their commands.
        ControllerLost: The controller failed during the motion.
        ArmContourError: The run cannot be planned.
    """
    learned = set_points is not None
    if resume is not None:
        job = resume.resumed(job)
        run_name = run_name or resume.run
    start = start_override(choose_run(job, run_name, "played"), learned=learned)
    wanted = start if override is None else override
    begin = wanted() if callable(wanted) else wanted
    played_job, planned = plan_kept(job, controller, run_name, learned, begin, progress)
    if resume is not None:
        check_configuration(planned, resume)
    ready = prepare_motion(
        played_job,
        planned,
        controller,
        set_points=set_points,
        band=band,
        speed_factor=begin,
    )
    of_time = wanted if callable(wanted) else lambda: begin
    if not learned:
        of_time = override_of_plan(planned, of_time)
    player = Player(controller, execute, stop_requested, progress, of_time, pause_after)
    played = player.play(ready)
    return judge_motion(played, band)


def start_override(run: Run, *, learned: bool) -> float:
    """Return the override with which a run starts by default.

    - `learned`: whether set-points of `learn` are played, which belong to the run's speed factor.
    """
    if learned:
        return 1.0
    return DEFAULT_SPEED_FACTOR if run.speed_factor is None else run.speed_factor


def plan_kept(
    job: Job,
    controller: Controller,
    run_name: str | None,
    learned: bool,
    speed: float,
    progress: Progress | None,
) -> tuple[Job, RunResult]:
    """Plan the run of `play` for full speed; for the speed at the start if only that is kept.

    - `learned`: whether set-points of `learn` will be played.
    - `speed`: override at the start, as a fraction of full speed.

    Raises:
        ControllerRefused: In the simulation, the run exceeds a limit or the allowed error.
    """
    played_job, planned = plan_played(
        job, controller, run_name, at_full_speed=not learned, progress=progress
    )
    if planned.kept is False and not learned and 0.0 < speed < 1.0:
        # Without compensation, the error of many runs is only allowed at a low speed.
        chosen = replace(choose_run(job, run_name, "played"), speed_factor=speed)
        slow_job = replace(job, runs=(chosen,))
        played_job, planned = plan_played(slow_job, controller, None, progress=progress)
    if planned.kept is False:
        raise ControllerRefused(
            f"In the simulation, run {planned.run.name} exceeds a limit or the allowed error. "
            "`armcontour run` lists the excess."
        )
    return played_job, planned


def override_of_plan(planned: RunResult, override: Callable[[], float]) -> Callable[[], float]:
    """Return the override of a plan from that of the full speed; at most 1.

    - `planned`: the plan, for full speed or a fraction of it.
    """
    factor = planned.trajectory.speed_factor
    if factor == 1.0:
        return override
    return lambda: min(override() / factor, 1.0)


def plan_played(
    job: Job,
    controller: Controller,
    run_name: str | None,
    *,
    at_full_speed: bool = False,
    reserve: float = PLAYED_RESERVE,
    progress: Progress | None = None,
) -> tuple[Job, RunResult]:
    """Plan a run as it is played; return the job with this run, and the result.

    The run has all limits of the arm, and at least the reserve, also for changes of the override.
    Its set-points are within the limits of the controller, and computed at the controller's cycle
    if this is shorter: between slower set-points, the controller would read lines with kinks.

    - `at_full_speed`: whether the run's speed factor is ignored.

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
    limits = resolve_limits("play", job.arm, chosen.limits)
    least = PLAYED_JERK_RESERVE if limits.limits_jerk else PLAYED_RESERVE
    timing = replace(
        chosen.timing, reserve=max(chosen.timing.reserve, reserve, least), for_play=True
    )
    factor = None if at_full_speed else chosen.speed_factor
    played_run = replace(
        chosen,
        limits=limits,
        timing=timing,
        speed_factor=factor,
        cycle=min(chosen.cycle, controller.cycle),
    )
    known = facts_of_player(controller.name)
    if known is None:
        known = ControllerFacts(name=controller.name, title=controller.name)
    played_on = replace(known, cycle=controller.cycle)
    played_job = replace(job, runs=(played_run,), played_on=played_on)
    return played_job, run(played_job, progress=progress).runs[chosen.name]


def prepare_motion(
    job: Job,
    planned: RunResult,
    controller: Controller,
    *,
    set_points: SetPoints | None = None,
    band: Band = None,
    lag: float = BAND_LAG,
    speed_factor: float = 1.0,
) -> Played:
    """Make the motion of a planned run, and check it against the controller without a connection.

    - `set_points`: learned set-points; by default those of the plan.
    - `band`, `lag`: see `guarded_motion`.
    - `speed_factor`: override at the start.
    """
    points = planned.set_points if set_points is None else set_points
    if set_points is None:
        predict = _predict_execution(planned, job)
    else:
        _check_same_plan(set_points, planned)
        predict = predict_plan(planned.trajectory)
    options = planned.run.compensation
    rows = RollingRows(
        points,
        job.servo,
        options,
        job.arm,
        controller.cycle,
        predict,
        computed=None if set_points is None else planned.set_points,
        for_play=True,
    )
    checked = [
        Row("servo", job.servo.describe_with_source(job.arm.chain.prismatic), "", "compensated for")
    ]
    checked += controller.check(job.arm, planned.run.limits, rows.q)
    checked += _check_set_points(planned, points, rows.q, controller)
    t = points.times(len(rows.q), controller.cycle)
    return Played(
        job=job,
        plan=replace(planned, set_points=points),
        controller=controller.name,
        speed_factor=speed_factor,
        checks=tuple(checked),
        motion=guarded_motion(rows, _predicted_at(planned, t, set_points), lag, band),
    )


def _predicted_at(planned: RunResult, t: FloatArray, set_points: SetPoints | None) -> FloatArray:
    """Return the positions that are predicted at full speed at times of the plan [rad], (n, dof).

    - `set_points`: learned set-points, with which the joints follow the plan.
    """
    if set_points is not None:
        return planned.trajectory.with_rests(t)
    simulated = _simulated(planned)
    return interpolate(t, simulated.t, simulated.q)


def _simulated(planned: RunResult) -> Execution:
    """Return the simulated execution by which a run is judged."""
    simulated = planned.execution
    bodies = planned.experiment
    if bodies is not None and planned.judged is bodies.evaluation:
        simulated = bodies.execution
    assert simulated is not None
    return simulated


def _predict_execution(planned: RunResult, job: Job) -> Prediction:
    """Make the prediction of measured positions: that of the servos, corrected by the judged one.

    Servos and bodies are simulated at full speed only. Their difference is assumed to be the same
    at every speed.
    """
    judged = _simulated(planned)
    servo = job.servo
    points = planned.set_points
    by_servo = ServoSimulation(points.q, points.cycle, servo.for_joints(job.arm.dof))
    start = points.q[0]
    times = judged.t - points.start_time
    states = by_servo.run_at(times, (start, np.zeros_like(start), np.zeros_like(start))).states
    differences = judged.q[1:] - states[:, :, 0].T
    return predict_servo(servo, job.arm.dof, judged.t[1:], differences)


@dataclass(frozen=True, slots=True)
class Player:
    """A controller, and how motions are played on it.

    Args:
        controller: The controller, not connected.
        execute: Whether the robot moves; otherwise the motion is only compared.
        stop_requested: Called often during a motion; True stops it on its path.
        progress: Called with the steps.
        override: Called often during a motion, by another thread; returns the wanted share of the
            speed, 0 for a pause. The motion to the start also pauses.
        pause_after: Called often during a motion, by another thread; True pauses it at the end of
            the contour.
    """

    controller: Controller
    execute: bool = False
    stop_requested: Callable[[], bool] = lambda: False
    progress: Progress | None = None
    override: Callable[[], float] = lambda: 1.0
    pause_after: Callable[[], bool] = lambda: False

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
            record = self._stream(
                ready.motion,
                ready.job.arm,
                self.override,
                lambda plan_time: report(self._step_at(ready, plan_time)),
                self.pause_after,
            )
            return replace(played, record=record)

    def _approach(self, ready: Played, position: FloatArray) -> Trajectory:
        """Plan the motion from a position to the first set-point."""
        limits = ready.plan.run.limits
        start = ready.motion.q[0]
        way = way_to_start(ready.plan, position, start)
        # A motion that begins with a pause has no speed yet.
        factor = min(DEFAULT_SPEED_FACTOR, ready.speed_factor or DEFAULT_SPEED_FACTOR)
        return approach_of(ready.job, limits, position, start, factor, way)

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
            record = self._stream(motion, job.arm, self._approach_override)
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

    def _approach_override(self) -> float:
        """Return the override of the motion to the start: 0 for a pause, otherwise 1."""
        return float(self.override() > 0.0)

    def _step_at(self, ready: Played, plan_time: float) -> Step:
        """Return the step at a time of the plan [s]: speed, place and remaining time."""
        plan = ready.plan.trajectory
        override = self.override()
        left = max(plan.duration - plan_time, 0.0)
        remaining = f"{number(left / override, 's')} left" if override else "paused"
        place = place_in_program(ready.plan, plan_time)
        if self.pause_after():
            rests = any(abs(plan_time - x.t[1]) < SAME_PLAN_TIME for x in plan.contour_spans)
            place = f"{place}: {'pauses at its end' if not rests else 'has ended'}"
            remaining = "paused" if rests else remaining
        done = min(max(plan_time / plan.duration, 0.0), 1.0)
        share = 100 * override * plan.speed_factor
        return Step(("playing", f"{share:.3g} %", place, remaining), done)

    def _stream(
        self,
        motion: Motion,
        arm: Arm,
        override: Callable[[], float],
        show: Callable[[float], None] = lambda plan_time: None,
        pause_after: Callable[[], bool] = lambda: False,
    ) -> PlayedMotion:
        """Play a motion, and refuse drives that have not moved."""
        record = self.controller.stream(motion, self.stop_requested, override, show, pause_after)
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


def place_in_program(planned: RunResult, t: float) -> str:
    """Return the name of the contour at a time of the plan [s], or of the next one."""
    objective = planned.objective
    spans = planned.trajectory.contour_spans
    for number_of_contour, span in enumerate(spans):
        if t <= span.t[1]:
            name = contour_called(objective.contours[number_of_contour], number_of_contour)
            return name if t >= span.t[0] else f"before {name}"
    return "after all contours"


def lost_motion(played: Played, lost: ControllerLost) -> Played:
    """Return the motion until its controller was lost; a note says that it is incomplete.

    If the record is too short for a log, the motion has none.
    """
    record = lost.record
    if not isinstance(record, PlayedMotion) or len(record.t) < FEWEST:
        return played
    note = f"This log is incomplete: {lost}"
    notes = (note, *record.notes)
    cause = " ".join([note, record.cause]).strip()
    return replace(played, record=replace(record, faithful=False, cause=cause, notes=notes))


def is_at_start(arm: Arm, distances: FloatArray) -> bool:
    """Return whether joints at these distances [rad], (dof,), are at the start."""
    return bool(
        (distances <= per_joint(arm, START_TOLERANCE, START_TOLERANCE_LINEAR, arm.dof)).all()
    )


def _measure_distances(ready: Played, position: FloatArray) -> FloatArray:
    """Return each joint's distance from the start [rad], (dof,).

    Raises:
        ControllerRefused: The robot cannot move there.
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
        _clear_path(ready.job, position, start, way_to_start(ready.plan, position, start))
    return np.asarray(distance)


def approach_of(
    job: Job,
    limits: Limits,
    position: FloatArray,
    start: FloatArray,
    speed_factor: float,
    way: JointPath | None = None,
) -> Trajectory:
    """Plan the motion to the first set-point, at a fraction of full speed.

    - `way`: the way along the path of the job, at the assigned velocity at most; by default a
      straight line in joint space.

    Raises:
        ControllerRefused: The arm would come too near to itself or its cell.
    """
    path = _clear_path(job, position, start, way)
    constraints: tuple[RapidSpeed, ...] = ()
    if way is not None and limits.speed is not None:
        constraints = (RapidSpeed(limits.speed, job.arm),)
    options = Optimal(reserve=PLAYED_RESERVE, constraints=constraints)
    return at_speed(plan(path, job.arm, limits.of_joints, options), speed_factor)


def _clear_path(
    job: Job, position: FloatArray, start: FloatArray, way: JointPath | None
) -> JointPath:
    """Return the way to the start; refuse it if the arm comes too near to something.

    - `way`: the way along the path of the job; None for the straight line in joint space.
    """
    path = way
    called = "motion along the path"
    if path is None:
        path = JointPath.spline(np.stack([position, start]), [0.0, 1.0])
        called = "straight motion in joint space"
    clearance = clearance_of(job, path)
    if clearance is not None and not clearance.satisfied:
        raise ControllerRefused(
            f"The {called} to the start is not possible: {clearance.sentence} Move the robot to "
            "the start by other means."
        )
    return path


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
    def of_motion(cls, played: Played, record: PlayedMotion, band: float | None) -> _Difference:
        """Compare a recorded motion with its prediction."""
        arm = played.job.arm
        tools = arm.tool_position(record.measured) - arm.tool_position(record.predicted)
        return cls(
            arm=arm,
            t=record.t,
            joints=np.abs(record.measured - record.predicted),
            tool=np.linalg.norm(tools, axis=1),
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


def judge_motion(played: Played, band: float | None) -> Played:
    """Add the verdict on a recorded motion, and its differences from the simulation."""
    record = played.record
    if record is None:
        return played
    planned = played.plan
    assert planned.judged is not None
    difference = _Difference.of_motion(played, record, band)
    rows = difference.rows()
    kept = False
    reason = record.cause or "stopped on request"
    if record.stopped is None:
        # During a pause, the time of the plan stands still.
        t = record.plan_time + SAMPLE_SEPARATION * record.t
        errors = Errors.of_pieces(measured_pieces(played.job, planned, t, record.measured))
        largest = max(errors.contour)
        note = f"{AS_MODELLED} {number(planned.judged.contour_error.max, 'm')}"
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
    if record.stopped is None or not len(record.t):
        return None
    t = record.plan_time
    return find_stopped_place(played.job, played.plan, float(t[-1]), t, record.measured)


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


def _check_set_points(
    planned: RunResult, points: SetPoints, q: FloatArray, controller: Controller
) -> list[Row]:
    """Judge set-points as the controller reads them; return the shares of the plan's limits.

    - `q`: rows of the controller [rad], (n, dof).

    Raises:
        ControllerRefused: The set-points exceed a limit; also one that is only assumed.
    """
    use = replace(points.rule, cycle=controller.cycle).judge(q, controller.cycle)
    for excess in use.excesses:
        unit = unit_of(planned.arm, LIMITS[excess.limit].unit, excess.joint)
        found = excess.describe(f"joint {excess.joint + 1}", unit)
        raise ControllerRefused(
            f"Run {planned.run.name}: the {found}. {excess.remedy}",
            joint=excess.joint,
            needed=excess.needed,
            allowed=excess.allowed,
        )
    rows = []
    for name, share in use.plan_ratios.items():
        label = f"set-point {name.removeprefix('joint_')}"
        rows.append(Row(f"set_points.{name}", share, "1", label, "of the plan's limit"))
    return rows
