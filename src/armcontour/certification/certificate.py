"""A certificate: the fastest plan whose execution holds a tolerance, on the model it names."""

from __future__ import annotations

from dataclasses import dataclass, replace
from typing import Any, NoReturn

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._progress import Progress, Step, under
from armcontour.certification._derating import Held
from armcontour.certification._search import RESOLUTION, Kept, Search
from armcontour.certification._uses import Setting
from armcontour.certification._uses import run as run_on
from armcontour.compensation import compensate
from armcontour.errors import ExecutionError, InvalidInput, NotRealizable
from armcontour.evaluation import Check, Evaluation, evaluate
from armcontour.execution import execute
from armcontour.geometry import Path, RoundedPath
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import Job, Rounding, Run
from armcontour.jobs.study import (
    ExperimentResult,
    RunResult,
    Study,
    on_bodies,
    path_of,
    traced,
)
from armcontour.motion import Execution, JointPath, TaughtData, Trajectory
from armcontour.robustness.monte_carlo import Spread, worst_corner
from armcontour.servo import ServoModel
from armcontour.timing import refuse_jerk

# A command interval this many times shorter is taken for none, but not below this time [s].
CONTINUOUS = 20
SHORTEST = 1e-4
# Of a total tolerance without a budget for the servo, the servo gets these shares, one after the
# other until one will do, and on while that makes a plan faster whose error comes near to its
# budget; what it does not need is given back.
SERVO_SHARES = (0.02, 0.06, 0.2, 0.6)
NEAR = 0.9
# When it is given back, the servo keeps this much more than it needed: the plan changes a little.
KEPT_FOR_SERVO = 1.5
# Corners are not rounded again for less than this share of the tolerance.
LEAST_GAIN = 1e-3


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """What the parts of the contour error come to [m].

    Args:
        rounding: Largest corner error of the path.
        servo: Largest contour error of the same plan with a nearly continuous command.
        sampling: What the command interval adds to that; below 0 where it takes something away.
        box: What the worst robot of the box adds to both; 0 without a box.
        allowed: Tolerance for all of it; None without one.
        servo_allowed: Largest sum of servo, sampling and box.
    """

    rounding: float
    servo: float
    sampling: float
    box: float
    allowed: float | None
    servo_allowed: float

    @property
    def executed(self) -> float:
        """Largest contour error of the execution, over the box if there is one [m]."""
        return self.servo + self.sampling + self.box

    @property
    def total(self) -> float:
        """Bound of the tool's distance from the objective path [m]."""
        return self.rounding + self.executed

    @property
    def left(self) -> float:
        """What is left of the tolerance, or of the servo's part where there is none [m]."""
        if self.allowed is None:
            return self.servo_allowed - self.executed
        return self.allowed - self.total


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertified:
    """The fastest plan of the same limits, with nothing held back, compensated alike.

    Args:
        duration: [s].
        contour_error: Largest, and its root mean square over time [m].
        saturated: Share of the time for which each joint is saturated, (dof,).
        box: Largest contour error in the corners of the box [m]; None without one.
    """

    duration: float
    contour_error: tuple[float, float]
    saturated: FloatArray
    box: float | None

    def __post_init__(self) -> None:
        object.__setattr__(self, "saturated", _checks.lock_floats(self.saturated))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Certificate:
    """The fastest plan found that holds a goal, and what it was found by.

    Args:
        job: The job.
        run: Its run, with the corners as they were rounded in the end.
        goal: What was asked for.
        model: The model that it holds for, in words.
        path: The tool path.
        joint_path: The same in joint space.
        windows: Of the moving averages of s(t) [s].
        held: What was held back, place by place.
        factors: What was left of limits that are held back everywhere alike, by their names.
        trajectory: The certified plan.
        taught: Its taught data.
        execution: On the model.
        evaluation: Of that, at 0.1 ms.
        check: Of the plan against every limit, between samples too.
        budget: The parts of the contour error.
        uncertified: What it is compared with.
        corners: The corners of the box; None without one.
        spread: Robots drawn from the box; None without one.
        trials: Plans that were made.
        experiment: The same taught data on the arm's rigid bodies, which no trial saw; None if the
            run has no experiment, or it failed.
        failure: Why it failed, if it did.
    """

    job: Job
    run: Run
    goal: Goal
    model: str
    path: Path
    joint_path: JointPath
    windows: tuple[float, ...]
    held: Held
    factors: dict[str, float]
    trajectory: Trajectory
    taught: TaughtData
    execution: Execution
    evaluation: Evaluation
    check: Check
    budget: Budget
    uncertified: Uncertified
    corners: Spread | None
    spread: Spread | None
    trials: int
    experiment: ExperimentResult | None
    failure: ExecutionError | None = None

    @property
    def duration(self) -> float:
        """Duration of the certified plan [s]."""
        return self.trajectory.duration

    @property
    def cost(self) -> float:
        """Time that the certificate costs [s]."""
        return self.duration - self.uncertified.duration

    @property
    def headroom(self) -> FloatArray:
        """Share of every joint's acceleration limit that is held back, mean along the path."""
        return np.asarray(1.0 - np.average(self.held.share, axis=0, weights=self.held.width))

    @property
    def largest_headroom(self) -> FloatArray:
        """The same where most is held back, (dof,)."""
        return np.asarray(1.0 - self.held.share.min(axis=0))

    @property
    def result(self) -> RunResult:
        """The certified plan as the result of its run."""
        return RunResult(
            run=self.run,
            objective=self.job.single_path,
            path=self.path,
            joint_path=self.joint_path,
            trajectory=self.trajectory,
            explanation=None,
            taught=self.taught,
            execution=self.execution,
            evaluation=self.evaluation,
            experiment=self.experiment,
            failure=self.failure,
        )

    @property
    def study(self) -> Study:
        """A study with the certified plan as its only run."""
        job = replace(self.job, runs=(self.run,))
        return Study(job=job, runs={self.run.name: self.result})


def certify(
    job: Job, run: str | None = None, *, progress: Progress | None = None, **overrides: Any
) -> Certificate:
    """The fastest plan of a job whose execution holds its tolerance.

    Whatever method of timing the run names, the plan is an optimal one, smoothed and held back
    where that is needed; compensation, command interval and limits are the run's. It holds for the
    real servo that the job names, and for no other model.

    Args:
        job: The job; what is to be held is its certificate.
        run: Name of the run; by default the certificate's.
        progress: Called with a step, which has a few words for its name, before every trial.
        overrides: Of the certificate's `Goal`, or all of it where the job has none.

    Raises:
        InvalidInput: Nothing to hold, or a run that is not to be found.
        NotRealizable: No plan holds it; the sentence says what binds and what would mend it.
        ArmContourError: As the steps raise it.
    """
    goal = goal_of(job, overrides)
    this = run_of(job, goal.run if run is None else run)
    refuse_jerk(this.limits, this.ignore_jerk)
    search = _Certifying(job, this, goal, under(progress))
    return search.certificate()


def goal_of(job: Job, overrides: dict[str, Any]) -> Goal:
    """What is to be held: the job's certificate, with some of it replaced.

    Raises:
        InvalidInput: Nothing to hold, or an unknown name.
    """
    known = Goal.__dataclass_fields__
    for name in overrides:
        if name not in known:
            raise InvalidInput(f"certify knows no {name!r}: it takes {', '.join(known)}.")
    if job.certificate is None:
        return Goal(**overrides)
    return replace(job.certificate, **overrides)


def run_of(job: Job, name: str | None) -> Run:
    """The run of that name, or else the only optimal one.

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
        corners = _rounded(this, goal.tolerance)
        self.whole = path_of(job, corners)
        # Where nothing is rounded the whole tolerance is the servo's.
        self.rounds = goal.tolerance is not None and rounding_part(self.whole) > 0

    def certificate(self) -> Certificate:
        """The certificate, or a refusal."""
        goal = self.goal
        if goal.tolerance is None or not self.rounds:
            budget = goal.servo if goal.tolerance is None else goal.servo or goal.tolerance
            assert budget is not None
            found = self._searched(self.this, budget, last=True)
            assert found is not None
            return self._finished(found)
        shares = SERVO_SHARES if goal.servo is None else (goal.servo / goal.tolerance,)
        best: _Found | None = None
        for share in shares:
            budget = share * goal.tolerance
            this = _rounded(self.this, goal.tolerance - budget)
            found = self._searched(this, budget, last=share == shares[-1] and best is None)
            if best is not None and (found is None or found.duration >= best.duration):
                break
            best = found
            if best is not None and best.error < NEAR * budget:
                break
        assert best is not None  # the last share refuses by itself
        return self._finished(self._given_back(best))

    def _given_back(self, found: _Found) -> _Found:
        """The same with corners that take what the servo did not need, if that is faster."""
        assert self.goal.tolerance is not None
        needed = KEPT_FOR_SERVO * found.error
        if needed > found.setting.budget - LEAST_GAIN * self.goal.tolerance:
            return found
        wider = _rounded(self.this, self.goal.tolerance - needed)
        better = self._searched(wider, needed, last=False)
        return found if better is None or better.duration >= found.duration else better

    def _searched(self, this: Run, budget: float, *, last: bool) -> _Found | None:
        """The fastest plan with one rounding; None, or where it is the last a refusal."""
        job, goal = self.job, self.goal
        self.progress(Step(("tracing",)))
        path = path_of(job, this)
        joint_path = traced(job, this, path)
        setting = Setting(
            arm=job.arm,
            path=path,
            limits=this.limits.for_joints(job.arm.dof),
            model=job.servo.for_joints(job.arm.dof),
            servo=job.plant_servo.for_joints(job.arm.dof),
            saturated=goal.saturation == "report",
            budget=budget,
            rms=goal.rms,
            box=goal.box,
            memory=job.memory,
        )
        search = Search(setting, joint_path, this, goal, self.progress)
        kept = search.fastest()
        self.trials += search.trials
        if kept is None and last:
            _refuse(search)
        return None if kept is None else _Found(this, setting, joint_path, kept)

    def _finished(self, found: _Found) -> Certificate:
        """The certificate: judged once more, finely, and compared."""
        self.progress(Step(("judging",)))
        job, this, setting, trial = self.job, found.this, found.setting, found.kept.trial
        execution = execute(
            trial.taught, setting.plant(), resolution=RESOLUTION, memory=setting.memory
        )
        result = evaluate(
            execution,
            setting.path,
            objective=job.single_path,
            limits=setting.limits,
            until=this.until,
        )
        experiment, failure = None, None
        if this.experiment is not None:
            self.progress(Step(("experiment",)))
            try:
                experiment = on_bodies(job, this, trial.taught, setting.path, job.single_path)
            except ExecutionError as error:
                failure = error
        return Certificate(
            job=job,
            run=this,
            goal=self.goal,
            model=model_of(setting, this),
            path=setting.path,
            joint_path=found.joint_path,
            windows=trial.windows,
            held=trial.held,
            factors=dict(trial.factors),
            trajectory=trial.trajectory,
            taught=trial.taught,
            execution=execution,
            evaluation=result,
            check=found.kept.check,
            budget=self._budget(found, result),
            uncertified=self._uncertified(found),
            corners=found.kept.corners,
            spread=found.kept.spread,
            trials=self.trials,
            experiment=experiment,
            failure=failure,
        )

    def _budget(self, found: _Found, result: Evaluation) -> Budget:
        this, setting, trial = found.this, found.setting, found.kept.trial
        period = max(this.period / CONTINUOUS, min(SHORTEST, this.period))
        smooth = _compensated(setting, this, trial.trajectory, period)
        executed = run_on(setting, smooth, max(period, RESOLUTION))
        tool = setting.arm.forward(executed.q[executed.t >= 0])
        servo = float(setting.path.project(tool).distance.max())
        nominal = result.contour_error.max
        return Budget(
            rounding=rounding_part(setting.path),
            servo=servo,
            sampling=nominal - servo,
            box=0.0 if setting.box is None else found.kept.worst - nominal,
            allowed=self.goal.tolerance,
            servo_allowed=setting.budget,
        )

    def _uncertified(self, found: _Found) -> Uncertified:
        """The plan with nothing held back, of the path that the whole tolerance rounds."""
        from armcontour.timing import plan

        job, this, setting = self.job, found.this, found.setting
        path, joint_path = setting.path, found.joint_path
        if self.rounds:
            path, this = self.whole, _rounded(this, self.goal.tolerance)
            joint_path = traced(job, this, path)
        fastest = plan(joint_path, job.arm, setting.limits, ignore_jerk=this.ignore_jerk)
        taught = _compensated(setting, this, fastest, this.period)
        executed = execute(
            taught,
            setting.plant(),
            resolution=min(1e-3, this.period),
            memory=setting.memory,
        )
        off = path.project(executed.tool).distance
        box = None
        if setting.box is not None:
            shared = (taught, path, job.arm, setting.servo, setting.limits)
            box = float(worst_corner(*shared, setting.box).max.max())
        t = executed.t
        return Uncertified(
            duration=fastest.duration,
            contour_error=(
                float(off.max()),
                float(np.sqrt(np.trapezoid(off**2, t) / (t[-1] - t[0]))),
            ),
            saturated=executed.saturated_time / (t[-1] - t[0]),
            box=box,
        )


@dataclass(frozen=True, slots=True)
class _Found:
    """A plan that holds everything, and the run that it is of."""

    this: Run
    setting: Setting
    joint_path: JointPath
    kept: Kept

    @property
    def duration(self) -> float:
        """Of the plan [s]."""
        return self.kept.trial.trajectory.duration

    @property
    def error(self) -> float:
        """Largest contour error, over the box if there is one [m]."""
        return max(self.kept.worst, self.kept.trial.uses.largest)


def rounding_part(path: Path) -> float:
    """Largest corner error of a path [m]; 0 if no corner of it is rounded."""
    if not isinstance(path, RoundedPath) or not len(path.corners):
        return 0.0
    return float(path.corners.error.max())


def model_of(setting: Setting, this: Run) -> str:
    """The model that a certificate holds for, in words."""
    servo: ServoModel = setting.servo
    parts = [
        f"independent joint servos of order {servo.order} with kp {servo.kp.tolist()} 1/s"
        + ("" if servo.kv is None else f" and kv {servo.kv.tolist()} 1/s"),
        f"set-points every {this.period * 1e3:g} ms, "
        + {"linear": "interpolated linearly", "cubic": "interpolated by cubics", "step": "held"}[
            servo.interpolation
        ],
    ]
    if servo.dead_time.any():
        parts.append(f"dead time {(servo.dead_time * 1e3).tolist()} ms")
    if servo.order == "second":
        parts.append("accelerations that saturate at the joints' limits")
    if setting.box is not None:
        parts.append("and every such robot of the box that was executed")
    return "; ".join(parts)


def _rounded(this: Run, tolerance: float | None) -> Run:
    """The run with another corner error, where it rounds corners."""
    if this.rounding is None or tolerance is None:
        return this
    rounding: Rounding = replace(this.rounding, tolerance=tolerance)
    return replace(this, rounding=rounding)


def _compensated(setting: Setting, this: Run, plan: Trajectory, period: float) -> TaughtData:
    return compensate(
        plan,
        setting.model,
        method=this.compensation,
        period=period,
        memory=setting.memory,
        **this.compensation_options,
    )


def _refuse(search: Search) -> NoReturn:
    """Say what binds, by how much, and what would mend it."""
    setting, goal = search.setting, search.goal
    kind, ratio = search.binds
    slow = f"within {goal.slowest:g} times the {search.optimum:.4g} s of the uncertified optimum"
    longer = "a larger slowest"
    hold = setting.servo.interpolation == "step"
    shorter = "linear interpolation" if hold else "a shorter command interval"
    if not kind:
        raise NotRealizable(
            f"No plan {slow} is certified: smoothing over the command interval alone takes longer; "
            f"take {longer}.",
            limit="slowest",
            allowed=goal.slowest,
        )
    if kind == "acceleration":
        raise NotRealizable(
            f"No plan {slow} is certified: its set-points ask a joint for {ratio:.4g} times the "
            f"acceleration that it has, as they come every {search.this.period * 1e3:g} ms"
            f"{' and are held' if hold else ''}: take {shorter}, saturation: report, or {longer}.",
            limit="joint_acceleration",
            needed=ratio,
            allowed=1.0,
        )
    if kind == "speed":
        raise NotRealizable(
            f"No plan {slow} is certified: a bound of its speed, or a command outside a joint's "
            f"range, is exceeded by {ratio - 1:.2g} of it: raise the limit, keep the path further "
            f"from the ends of the joints' ranges, or take {longer}.",
            limit="speed",
            needed=ratio,
            allowed=1.0,
        )
    # Of trials that came nearer, something else was beyond its limit.
    reached = search.reached if search.reached > setting.budget else ratio * setting.budget
    over = " of the worst robot of the box" if kind == "box" else ""
    mend = (
        "know the robot more closely (a smaller box), slow down the assigned velocity"
        if kind == "box"
        else f"take {shorter}"
    )
    raise NotRealizable(
        f"No plan {slow} is certified: the largest contour error{over} comes down to "
        f"{reached * 1e3:.4g} mm, and {setting.budget * 1e3:.4g} mm is allowed: {mend}, "
        f"take {longer}, or allow more.",
        limit="contour error",
        needed=reached,
        allowed=setting.budget,
    )
