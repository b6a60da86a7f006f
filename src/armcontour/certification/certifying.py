"""Entry point `certify`: finds the fastest plan whose execution keeps a tolerance on a model."""

from __future__ import annotations

from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step, under
from armcontour.certification._approach import approaches
from armcontour.certification._bodies import look
from armcontour.certification._uses import Robot, Setting
from armcontour.certification._uses import run as run_on
from armcontour.certification._whole import Assembly, PlannedContour, Whole
from armcontour.certification.certificate import (
    Budget,
    Certificate,
    ContourCertificate,
    Uncertified,
)
from armcontour.errors import ExecutionError, InvalidInput, NotRealizable
from armcontour.evaluation import evaluate
from armcontour.evaluation.error_profile import ErrorProfile
from armcontour.evaluation.pieces import pieces_of
from armcontour.execution import execute
from armcontour.geometry import Path, RoundedPath
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import Job, Rounding, Run
from armcontour.jobs.programs import programs_of, trace_run
from armcontour.jobs.study import on_bodies
from armcontour.motion import Method, Trajectory
from armcontour.program import Program, contour_called
from armcontour.robustness.box import Box
from armcontour.robustness.monte_carlo import worst_corner
from armcontour.robustness.unknowns import Unknowns
from armcontour.timing import intervals_of, refuse_jerk
from armcontour.timing.methods import Timing
from armcontour.timing.program_tracing import Tracing
from armcontour.timing.programs import time_program

# A command interval this many times shorter counts as continuous; it is at least SHORTEST [s].
CONTINUOUS = 20
SHORTEST = 1e-4
# Shares of a total tolerance that the servo gets if the goal has no budget for the servo. They are
# tried in order until a plan is certified, and further while the error uses NEAR of its budget and
# the plan gets faster. The unused part goes to the corners.
SERVO_SHARES = (0.02, 0.06, 0.2, 0.6)
NEAR = 0.9
# When the unused part goes to the corners, the servo keeps this many times the part that it needed,
# because the plan changes a little.
KEPT_FOR_SERVO = 1.5
# Corners are not rounded again for less than this share of the tolerance.
LEAST_GAIN = 1e-3


def certify(
    job: Job, run: str | None = None, *, progress: Progress | None = None, **overrides: Any
) -> Certificate:
    """Find the fastest plan of a job whose execution keeps its tolerance.

    Whatever timing the run has, the plan is an optimal one, smoothed, and derated where needed.
    Compensation, command interval and limits are those of the run. The certificate is valid for the
    job's plant: its servos, or its rigid bodies if the goal says so, and for no other model.

    Args:
        job: The job; its certificate is the goal.
        run: Name of the run; by default that of the goal.
        progress: Called with a step, which has a few words as its name, before every trial.
        overrides: Fields of `Goal` that replace those of the job.

    Raises:
        InvalidInput: There is no goal, or no such run.
        NotRealizable: No plan keeps the goal; the message says what binds and what would help.
        ArmContourError: Tracing, planning or execution fails.
    """
    goal = goal_of(job, overrides)
    this = run_of(job, goal.run if run is None else run)
    if this.duration is not None:
        raise InvalidInput(
            f"Run {this.name} has a duration of {this.duration:g} s, which a certified plan does "
            "not take: leave duration out."
        )
    if this.smoothing:
        raise InvalidInput(
            f"Run {this.name} has smoothing, but a certified plan has windows of its own: leave "
            "smoothing out."
        )
    refuse_jerk(this.limits, this.ignore_jerk)
    search = _Certifying(job, this, goal, under(progress))
    return search.certificate()


def goal_of(job: Job, overrides: dict[str, Any]) -> Goal:
    """Make the goal of a certificate: that of the job, with some fields replaced.

    Raises:
        InvalidInput: There is no goal, or a field has an unknown name.
    """
    known = Goal.__dataclass_fields__
    for name in overrides:
        if name not in known:
            raise InvalidInput(f"certify knows no {name!r}: it takes {', '.join(known)}.")
    if job.certificate is None:
        return Goal(**overrides)
    return replace(job.certificate, **overrides)


def run_of(job: Job, name: str | None) -> Run:
    """Find the run of a name, or else the only run with the timing optimal.

    Raises:
        InvalidInput: There is no such run, or more than one.
    """
    if name is not None:
        for x in job.runs:
            if x.name == name:
                return x
        names = ", ".join(x.name for x in job.runs)
        raise InvalidInput(f"The job {job.name} has no run {name!r}: its runs are {names}.")
    able = [x for x in job.runs if x.timing == "optimal"]
    if len(able) != 1:
        names = ", ".join(x.name for x in able or job.runs)
        raise InvalidInput(f"Say which run of the job {job.name} is to be certified: {names}.")
    return able[0]


class _Certifying:
    """One call of `certify`."""

    def __init__(self, job: Job, this: Run, goal: Goal, progress: Progress) -> None:
        self.job, self.this, self.goal, self.progress = job, this, goal, progress
        self.trials = 0
        # If no corner is rounded, the servo gets the whole tolerance.
        self.rounds = False
        if goal.tolerance is not None:
            rounded_by_all = programs_of(job, _with_tolerance(this, goal.tolerance))[1]
            self.rounds = max(rounding_part(x.path) for x in rounded_by_all.contours) > 0

    def certificate(self) -> Certificate:
        """Find the certificate.

        Raises:
            NotRealizable: No plan keeps the goal.
        """
        goal = self.goal
        if goal.tolerance is None or not self.rounds:
            budget = goal.servo if goal.tolerance is None else goal.servo or goal.tolerance
            assert budget is not None
            return self._finish(self._search(self.this, budget))
        shares = SERVO_SHARES if goal.servo is None else (goal.servo / goal.tolerance,)
        best: _Found | None = None
        for share in shares:
            budget = share * goal.tolerance
            this = _with_tolerance(self.this, goal.tolerance - budget)
            last = share == shares[-1] and best is None
            found = self._search(this, budget) if last else self._try(this, budget)
            if best is not None and (found is None or found.duration >= best.duration):
                break
            best = found
            if best is not None and best.whole.worst < NEAR * budget:
                break
        assert best is not None  # the search with the last share raises if it fails
        return self._finish(self._give_rest_to_corners(best))

    def _give_rest_to_corners(self, found: _Found) -> _Found:
        """Give the unused tolerance of the servo to the corners, if the plan gets faster."""
        assert self.goal.tolerance is not None
        needed = KEPT_FOR_SERVO * found.whole.worst
        if needed > found.budget - LEAST_GAIN * self.goal.tolerance:
            return found
        better = self._try(_with_tolerance(self.this, self.goal.tolerance - needed), needed)
        return found if better is None or better.duration >= found.duration else better

    def _try(self, this: Run, budget: float) -> _Found | None:
        """Find the fastest plan with the rounding of a run; None if no plan keeps the goal."""
        try:
            return self._search(this, budget)
        except NotRealizable:
            return None

    def _search(self, this: Run, budget: float) -> _Found:
        """Find the fastest plan with the rounding of a run and a budget for the servo [m].

        Raises:
            NotRealizable: No plan keeps the goal.
        """
        job, goal = self.job, self.goal
        self.progress(Step(("tracing",)))
        objective, program = programs_of(job, this)
        dof = job.arm.dof
        robot = Robot(
            arm=job.arm,
            limits=this.limits.for_joints(dof),
            model=job.servo.for_joints(dof),
            servo=job.plant_servo.for_joints(dof),
            saturated=goal.saturation == "report",
            box=goal.box,
            run=this,
            bodies=goal.plant == "rigid_body",
            memory=job.memory,
        )
        if robot.bodies:
            _refuse_other_jobs(program, robot)
        assembly = Assembly(
            job=job,
            robot=robot,
            goal=goal,
            budget=budget,
            objective=objective,
            program=program,
            progress=self.progress,
        )
        try:
            return _Found(this, budget, assembly.whole())
        finally:
            self.trials += assembly.trials

    def _finish(self, found: _Found) -> Certificate:
        """Evaluate the plan as a whole, run the experiment, and make the certificate."""
        job, this, whole = self.job, found.this, found.whole
        self.progress(Step(("evaluation",)))
        objective, path = whole.objective, whole.program
        limits = whole.robot.limits
        result = evaluate(
            whole.execution, path, objective=objective, limits=limits, until=this.until
        )
        experiment, failure = None, None
        if this.experiment is not None:
            self.progress(Step(("experiment",)))
            try:
                experiment = on_bodies(job, this, whole.taught, path, objective)
            except ExecutionError as error:
                failure = error
        fastest, uncertified = self._uncertified(found)
        spans = fastest.contour_spans
        return Certificate(
            job=job,
            run=this,
            goal=self.goal,
            model=model_of(whole.robot),
            objective=objective,
            path=path,
            trajectory=whole.trajectory,
            taught=whole.taught,
            execution=whole.execution,
            evaluation=result,
            check=whole.check,
            contours=tuple(
                self._contour(found, k, span.t[1] - span.t[0]) for k, span in enumerate(spans)
            ),
            rapids=whole.rapids,
            uncertified=uncertified,
            trials=self.trials,
            experiment=experiment,
            failure=failure,
        )

    def _contour(self, found: _Found, k: int, optimum: float) -> ContourCertificate:
        """Make the certificate of the contour k; `optimum` is its uncertified duration [s]."""
        whole = found.whole
        planned, span, judged = whole.contours[k], whole.spans[k], whole.judged[k]
        kept = planned.kept
        assert span.work is not None
        return ContourCertificate(
            name=contour_called(whole.program.contours[k], k),
            t=span.t,
            work=span.work,
            path=planned.setting.path,
            joint_path=planned.joint_path,
            windows=kept.trial.windows,
            derating=kept.trial.derating,
            factors=dict(kept.trial.factors),
            trajectory=planned.trajectory,
            taught=kept.trial.taught,
            error=judged.error,
            missed=judged.missed,
            speed_ratio=float(judged.speed.max()),
            budget=self._budget(found, planned, judged.largest),
            optimum=optimum,
            corners=kept.corners,
            spread=kept.spread,
            linear=kept.linear,
            trials=planned.trials,
        )

    def _budget(self, found: _Found, planned: PlannedContour, nominal: float) -> Budget:
        """Split the contour error of one contour, which is `nominal` [m] without the box."""
        setting, kept = planned.setting, planned.kept
        own = setting.run.period
        period = max(own / CONTINUOUS, min(SHORTEST, own))
        smooth = planned.approach.teach(planned.trajectory, setting, period)
        resolution = max(period, setting.resolution)
        executed = (
            execute(smooth, setting.plant(), resolution=resolution, memory=setting.memory)
            if setting.bodies
            else run_on(setting, smooth, resolution)
        )
        servo = setting.judge(executed).largest
        return Budget(
            rounding=rounding_part(setting.path),
            servo=servo,
            sampling=nominal - servo,
            box=0.0 if setting.box is None else max(kept.worst - nominal, 0.0),
            allowed=self.goal.tolerance,
            servo_allowed=found.budget,
        )

    def _uncertified(self, found: _Found) -> tuple[Trajectory, Uncertified]:
        """Plan and execute with nothing derated, with the whole tolerance for the corners."""
        job, this, whole = self.job, found.this, found.whole
        traced: Tracing | None = whole.traced
        program, robot = whole.program, whole.robot
        if self.rounds:
            program = programs_of(job, _with_tolerance(this, self.goal.tolerance))[1]
            traced = None
        fastest = plan_fastest(job, robot, program, traced)
        taught = robot.teach(fastest)
        executed = execute(
            taught,
            robot.plant(),
            resolution=max(min(1e-3, this.period), robot.resolution),
            memory=robot.memory,
        )
        t = executed.t
        pieces = pieces_of(executed, program, None, float(t[-1]))
        error = ErrorProfile.join([x.contour_error for x in pieces])
        missed = max(x.missed.max for x in pieces)
        return fastest, Uncertified(
            duration=fastest.duration,
            contours=tuple(x.t[1] - x.t[0] for x in fastest.contour_spans),
            contour_error=(max(error.max, missed), error.rms),
            saturated=executed.saturated_time / (t[-1] - t[0]),
            box=None if robot.box is None else _worst_of_box(robot, program, fastest),
        )


@dataclass(frozen=True, slots=True)
class _Found:
    """A program that keeps the goal, with its run and its budget for the servo [m]."""

    this: Run
    budget: float
    whole: Whole

    @property
    def duration(self) -> float:
        """Duration of the plan [s]."""
        return self.whole.trajectory.duration


def plan_fastest(
    job: Job, robot: Robot, program: Program, traced: Tracing | None = None
) -> Trajectory:
    """Plan a program with nothing derated.

    Args:
        job: The job, for its branch or start.
        robot: The robot.
        program: The program.
        traced: The traced program; None to trace it.
    """
    if traced is None:
        traced = trace_run(job, robot.run, program)
    options = {"intervals": intervals_of(program)}
    timing = Timing(robot.arm, robot.limits, Method.OPTIMAL, options, robot.memory)
    return time_program(traced, timing)


def _worst_of_box(robot: Robot, program: Program, plan: Trajectory) -> float:
    """Largest contour error of a plan in the corners of the box [m]."""
    assert robot.box is not None
    if robot.bodies:
        return _bound_on_bodies(robot, program, plan)
    worst = 0.0
    for contour, (span, approach) in zip(program.contours, approaches(plan, robot), strict=True):
        assert span.trajectory is not None and span.work is not None
        found = worst_corner(
            approach.teach(span.trajectory, robot),
            contour.path,
            robot.arm,
            robot.servo,
            robot.limits,
            robot.box,
            since=None if len(program.moves) == 1 else span.work[0] - span.t[0],
            until=None if len(program.moves) == 1 else span.work[1] - span.t[0],
        )
        worst = max(worst, float(found.max.max()))
    return worst


def _bound_on_bodies(robot: Robot, program: Program, plan: Trajectory) -> float:
    """Largest contour error of a plan over the box in the linear model of rigid bodies [m]."""
    (contour,) = program.contours
    setting = Setting(
        **{x.name: getattr(robot, x.name) for x in fields(Robot)},
        path=contour.path,
        work=None,
        budget=np.inf,
        rms=None,
    )
    return look(setting, robot.teach(plan)).across().worst().largest


def _refuse_other_jobs(program: Program, robot: Robot) -> None:
    """Refuse a job that certificates on rigid bodies are not made for.

    Raises:
        InvalidInput: The program has several moves, or the arm or the servo has no rigid bodies.
    """
    if len(program.moves) > 1:
        raise InvalidInput(
            f"A certificate on rigid bodies is for one contour, but this program has "
            f"{len(program.moves)} moves: make a job of each contour, or certify with plant: servo."
        )
    Unknowns.of(robot.box or Box(), robot.arm, robot.servo)


def rounding_part(path: Path) -> float:
    """Largest corner error of a path [m]; 0 if no corner of it is rounded."""
    if not isinstance(path, RoundedPath) or not len(path.corners):
        return 0.0
    return float(path.corners.error.max())


def model_of(robot: Robot) -> str:
    """The model of the robot for which a certificate is valid, in words."""
    servo = robot.servo
    held = {"linear": "interpolated linearly", "cubic": "interpolated by cubics", "step": "held"}
    if robot.bodies:
        return _model_of_bodies(robot, held[servo.interpolation])
    parts = [
        f"independent joint servos of order {servo.order} with kp {_per_joint(servo.kp)} 1/s"
        + ("" if servo.kv is None else f" and kv {_per_joint(servo.kv)} 1/s"),
        f"set-points every {robot.run.period * 1e3:g} ms, " + held[servo.interpolation],
    ]
    if servo.dead_time.any():
        parts.append(f"dead time {_per_joint(servo.dead_time * 1e3)} ms")
    if servo.order == "second":
        parts.append("accelerations that saturate at the joints' limits")
    if robot.box is not None:
        parts.append("and every such robot of the box that was executed")
    return "; ".join(parts)


def _model_of_bodies(robot: Robot, held: str) -> str:
    """The model of rigid bodies for which a certificate is valid, in words."""
    servo, options = robot.servo, robot.drive_options
    assert servo.kv is not None
    fed = options.get("gravity_feedforward", True)
    parts = [
        f"the rigid bodies of {robot.arm.name} with kp {_per_joint(servo.kp)} 1/s and kv "
        f"{_per_joint(servo.kv)} 1/s, simulated by MuJoCo",
        f"set-points every {robot.run.period * 1e3:g} ms, {held}",
    ]
    if servo.dead_time.any():
        parts.append(f"dead time {_per_joint(servo.dead_time * 1e3)} ms")
    if robot.box is None:
        parts.append("gravity fed forward" if fed else "gravity not fed forward")
        return "; ".join(parts)
    if fed:
        weighed = "of the true payload" if robot.box.payload_known else "of the nominal payload"
        parts.append(f"gravity {weighed} fed forward")
    parts.append("and every such robot of the box that was executed")
    return "; ".join(parts)


def _with_tolerance(this: Run, tolerance: float | None) -> Run:
    """The run with another corner tolerance [m], if it rounds corners."""
    if this.rounding is None or tolerance is None:
        return this
    rounding: Rounding = replace(this.rounding, tolerance=tolerance)
    return replace(this, rounding=rounding)


def _per_joint(values: FloatArray) -> str:
    """Values of all joints in words: one number where they are equal."""
    shown = [f"{x:g}" for x in values]
    return shown[0] if len(set(shown)) == 1 else ", ".join(shown)
