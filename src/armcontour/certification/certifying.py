"""Entry point `certify`: finds the fastest plan whose execution keeps a tolerance on a model."""

from __future__ import annotations

from collections.abc import Mapping
from concurrent.futures import Executor
from dataclasses import fields, replace
from typing import Any

import numpy as np

from armcontour import _checks
from armcontour._progress import Progress, Step, under
from armcontour.certification._approach import approaches
from armcontour.certification._bodies import look
from armcontour.certification._sharing import (
    Found,
    Sharing,
    Slower,
    shape_part,
)
from armcontour.certification._uses import Robot, Setting, work_on
from armcontour.certification._uses import run as run_on
from armcontour.certification._whole import PlannedContour
from armcontour.certification.certificate import (
    Budget,
    Certificate,
    ContourCertificate,
    Uncertified,
)
from armcontour.certification.lowering import find_lowered
from armcontour.core.fields import checked
from armcontour.errors import ExecutionError, InvalidInput, NotRealizable, Unreachable
from armcontour.evaluation.error_profile import ErrorProfile
from armcontour.evaluation.pieces import pieces_of
from armcontour.execution import execute
from armcontour.jobs import reachability
from armcontour.jobs.alternatives import clearance_of
from armcontour.jobs.experiment import build_plant
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import ARC, FREE, Job, Run, choose_run
from armcontour.jobs.study import evaluate_run, on_bodies
from armcontour.motion import Method, Trajectory
from armcontour.program import Program, contour_called
from armcontour.robustness.monte_carlo import spans_of, worst_corner
from armcontour.timing import Optimal, refuse_unkept_jerk

# A command interval this many times shorter counts as continuous; it is at least SHORTEST [s].
CONTINUOUS = 20
SHORTEST = 1e-4


@checked
def certify(
    job: Job,
    run: str | None = None,
    *,
    goal: Goal | None = None,
    executor: Executor | None = None,
    progress: Progress | None = None,
) -> Certificate:
    """Find the fastest plan of a job whose execution keeps its tolerance.

    Whatever timing the run has, the plan is an optimal one, derated where needed.
    Compensation, command interval and limits are those of the run. The certificate is valid for the
    job's plant: its servos, or its rigid bodies if the goal says so, and for no other model.

    Args:
        job: The job.
        run: Name of the run; by default that of the goal.
        goal: The goal; by default the certificate of the job.
        executor: An executor that executes robots of the box as rigid bodies, such as a
            `concurrent.futures.ProcessPoolExecutor`; by default processes of this machine do.
        progress: Called with a step, which has a few words as its name, before every trial.

    Raises:
        InvalidInput: There is no goal, or no such run.
        NotRealizable: No plan keeps the goal; the message says what binds and what would help.
        ArmContourError: Tracing, planning or execution fails.
    """
    goal = goal_of(job) if goal is None else goal
    this = run_of(job, goal.run if run is None else run)
    if this.duration is not None:
        raise InvalidInput(
            f"Run {this.name} has a duration of {this.duration:g} s, which a certified plan does "
            "not take: leave duration out."
        )
    if this.rounding is not None and this.rounding.free:
        refuse_unkept_jerk(Method.SHAPED, this.limits)
    if this.experiment is not None:
        # What refuses the robot of the experiment is said before the search.
        build_plant(this.experiment, job.arm, job.plant_servo, this.limits)
    if goal.box is not None and goal.plant == "servo":
        # So is what does not fit the box.
        spans_of(goal.box, job.plant_servo.for_joints(job.arm.dof), job.arm, this.period)
    search = _Certifying(job, this, goal, executor, under(progress))
    try:
        return search.certificate()
    except Unreachable as error:
        raise reachability.explain(error, job) from None


def goal_of(job: Job, **overrides: Any) -> Goal:
    """Make the goal of a certificate: that of the job, with some fields replaced.

    Raises:
        InvalidInput: There is no goal, or a goal has no field of a given name.
    """
    known = tuple(x.name for x in fields(Goal))
    for name in overrides:
        _checks.choice("An option of certify", name, known)
    if job.certificate is None:
        return Goal(**overrides)
    return replace(job.certificate, **overrides)


def run_of(job: Job, name: str | None) -> Run:
    """Find the run of a name, or else the only run with the timing optimal.

    Raises:
        InvalidInput: There is no such run, or more than one.
    """
    return choose_run(
        job, name, "certified", [x for x in job.runs if isinstance(x.timing, Optimal)]
    )


class _Certifying:
    """One call of `certify`."""

    def __init__(
        self, job: Job, this: Run, goal: Goal, executor: Executor | None, progress: Progress
    ) -> None:
        self.job, self.this, self.goal, self.progress = job, this, goal, progress
        self.executor = executor
        self.trials = 0

    def certificate(self) -> Certificate:
        """Find the certificate: of a free shape, the faster one of those with it and with arcs.

        Raises:
            NotRealizable: No plan keeps the goal.
        """
        rounding = self.this.rounding
        if rounding is None or not rounding.free:
            return self._finish(*self._fastest(self.this))
        arcs = replace(self.this, rounding=rounding.with_arcs)
        try:
            found, sharing = self._fastest(self.this)
        except NotRealizable:
            return self._finish(*self._fastest(arcs))
        shapes = {FREE: found.duration}
        try:
            other, with_arcs = self._fastest(arcs, deadline=found.duration)
            shapes[ARC] = other.duration
            if other.duration < found.duration:
                found, sharing = other, with_arcs
        except Slower as slower:
            shapes[ARC] = slower.least
        except NotRealizable:
            pass
        return self._finish(found, sharing, shapes)

    def _fastest(self, this: Run, deadline: float = np.inf) -> tuple[Found, Sharing]:
        """Find the fastest plan of a run that is faster than a known one.

        Raises:
            NotRealizable: No plan keeps the goal.
            Slower: All plans are slower than the known one.
        """
        sharing = Sharing(
            job=self.job,
            this=this,
            goal=self.goal,
            executor=self.executor,
            progress=self.progress,
            deadline=deadline,
        )
        try:
            return sharing.fastest(), sharing
        finally:
            self.trials += sharing.trials

    def _finish(
        self, found: Found, sharing: Sharing, shapes: Mapping[str, float] | None = None
    ) -> Certificate:
        """Evaluate the plan as a whole, run the experiment, and make the certificate."""
        job, this, whole = self.job, found.this, found.whole
        self.progress(Step(("evaluation",)))
        objective, path = whole.objective, whole.program
        judged = replace(this, limits=whole.robot.limits)
        result = evaluate_run(judged, whole.execution, path, objective)
        experiment, failure = None, None
        if this.experiment is not None:
            self.progress(Step(("experiment",)))
            try:
                experiment = on_bodies(job, this, whole.taught, path, objective)
            except ExecutionError as error:
                failure = error
        uncertified = self._uncertified(found, sharing)
        spans = sharing.uncertified.contour_spans
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
            shapes=shapes or {},
            trials=self.trials,
            experiment=experiment,
            failure=failure,
            clearance=clearance_of(job, whole.trajectory),
        )

    def _contour(self, found: Found, k: int, optimum: float) -> ContourCertificate:
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
            derating=kept.trial.derating,
            factors=dict(kept.trial.factors),
            lowered=find_lowered(
                kept.trial.derating,
                kept.trial.factors,
                planned.squares,
                planned.trajectory,
                span.t[0],
                planned.setting.arm.joint_names,
            ),
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

    def _budget(self, found: Found, planned: PlannedContour, nominal: float) -> Budget:
        """Split the contour error of one contour, which is `nominal` [m] without the box."""
        setting, kept = planned.setting, planned.kept
        own = setting.run.period
        period = max(own / CONTINUOUS, min(SHORTEST, own))
        smooth = planned.approach.teach(planned.trajectory, setting, period)
        resolution = max(period, setting.resolution)
        executed = (
            execute(smooth, setting.plant(), resolution=resolution)
            if setting.bodies
            else run_on(setting, smooth, resolution)
        )
        servo = setting.judge(executed).largest
        return Budget(
            rounding=shape_part(setting.path),
            servo=servo,
            sampling=nominal - servo,
            box=0.0 if setting.box is None else max(kept.worst - nominal, 0.0),
            unexplained=found.unexplained,
            allowed=self.goal.tolerance,
            servo_allowed=found.budget,
        )

    def _uncertified(self, found: Found, sharing: Sharing) -> Uncertified:
        """Execute the fastest plan, with nothing derated."""
        robot, program, fastest = found.whole.robot, sharing.largest, sharing.uncertified
        taught = robot.teach(fastest)
        executed = execute(
            taught,
            robot.plant(),
            resolution=max(min(1e-3, found.this.period), robot.resolution),
        )
        t = executed.t
        pieces = pieces_of(executed, program, None, None)
        error = ErrorProfile.join([x.contour_error for x in pieces])
        missed = max(x.missed.max for x in pieces)
        return Uncertified(
            duration=fastest.duration,
            contours=tuple(x.t[1] - x.t[0] for x in fastest.contour_spans),
            contour_error=(max(error.max, missed), error.rms),
            saturated=executed.saturated_time / (t[-1] - t[0]),
            box=None if robot.box is None else _worst_of_box(robot, program, fastest),
        )


def _worst_of_box(robot: Robot, program: Program, plan: Trajectory) -> float:
    """Largest contour error of a plan in the corners of the box [m]."""
    assert robot.box is not None
    if robot.bodies:
        return _bound_on_bodies(robot, program, plan)
    worst, at_all_times = 0.0, program.single_path is not None
    for contour, (span, approach) in zip(program.contours, approaches(plan, robot), strict=True):
        assert span.trajectory is not None and span.work is not None
        found = worst_corner(
            approach.teach(span.trajectory, robot),
            contour.path,
            robot.arm,
            robot.servo,
            robot.limits,
            robot.box,
            since=None if at_all_times else span.work[0] - span.t[0],
            until=None if at_all_times else span.work[1] - span.t[0],
        )
        worst = max(worst, float(found.max.max()))
    return worst


def _bound_on_bodies(robot: Robot, program: Program, plan: Trajectory) -> float:
    """Largest contour error of a plan over the box in the linear model of rigid bodies [m]."""
    (contour,) = program.contours
    setting = Setting(
        **{x.name: getattr(robot, x.name) for x in fields(Robot)},
        path=contour.path,
        work=work_on(program, contour),
        budget=np.inf,
        rms=None,
    )
    return look(setting, robot.teach(plan)).across().worst().largest


def model_of(robot: Robot) -> str:
    """The model of the robot for which a certificate is valid, in words."""
    servo = robot.servo
    held = {"linear": "interpolated linearly", "cubic": "interpolated by cubics", "step": "held"}
    if robot.bodies:
        return _model_of_bodies(robot, held[servo.interpolation])
    parts = [
        f"independent joint servos{' of order second' * (servo.order == 'second')} with {servo}",
        f"set-points every {robot.run.period * 1e3:g} ms, " + held[servo.interpolation],
    ]
    if np.isfinite(robot.saturating()).any():
        parts.append("accelerations that saturate at the joints' limits")
    if robot.box is not None:
        parts.append("and every such robot of the box that was executed")
    return "; ".join(parts)


def _model_of_bodies(robot: Robot, held: str) -> str:
    """The model of rigid bodies for which a certificate is valid, in words."""
    fed = robot.drive_options.get("gravity_feedforward", True)
    parts = [
        f"the rigid bodies of {robot.arm.name} with {robot.servo}, simulated by MuJoCo",
        f"set-points every {robot.run.period * 1e3:g} ms, {held}",
    ]
    if robot.box is None:
        parts.append("gravity fed forward" if fed else "gravity not fed forward")
        return "; ".join(parts)
    if fed:
        weighed = "of the true payload" if robot.box.payload_known else "of the nominal payload"
        parts.append(f"gravity {weighed} fed forward")
    parts.append("and every such robot of the box that was executed")
    return "; ".join(parts)
