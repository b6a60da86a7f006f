"""The certificate of a plan: its errors contour by contour, its derating, and its cost in time."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace

import numpy as np

from armcontour._checks import FloatArray
from armcontour._describing import brief, line_up, mm
from armcontour.certification._bodies import LinearFigures
from armcontour.certification._derating import Derating
from armcontour.certification._rapids import Derated
from armcontour.certification.lowering import Lowered
from armcontour.clearance import Clearance
from armcontour.core.fields import Checked
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.evaluation import Check, Evaluation
from armcontour.evaluation.error_profile import ErrorProfile, Missed
from armcontour.execution.rigid_body_plant import can_simulate
from armcontour.geometry import Path, RoundedPath, ShapedPath
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import ARC, FREE, Job, Run
from armcontour.jobs.results import ExperimentResult, RunResult, Study
from armcontour.jobs.warnings import beyond_logs, collect_warnings
from armcontour.motion import Execution, JointPath, TaughtData, Trajectory
from armcontour.program import Program
from armcontour.robustness.monte_carlo import Spread
from armcontour.timing import Tracing


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget:
    """The parts of the contour error, the larger one of both directions [m].

    Args:
        rounding: Largest corner error of the path; the tolerance of a path of the shape free.
        servo: Largest contour error of the same plan with a nearly continuous command.
        sampling: Part that the command interval adds to `servo`; may be negative.
        box: Part that the worst robot of the box adds to both; 0 without a box.
        unexplained: Bound of the part across the path that the servo model does not explain, to
            first order; 0 if `unexplained` of the servo is not known.
        allowed: Tolerance for the sum of all parts; None without one.
        servo_allowed: Largest sum of servo, sampling, box and unexplained.
    """

    rounding: float
    servo: float
    sampling: float
    box: float
    unexplained: float
    allowed: float | None
    servo_allowed: float

    @property
    def executed(self) -> float:
        """Bound of the contour error of the execution, over the box if there is one [m]."""
        return self.servo + self.sampling + self.box + self.unexplained

    @property
    def total(self) -> float:
        """Bound of the tool's distance from the objective path [m]."""
        return self.rounding + self.executed

    @property
    def rows(self) -> list[tuple[str, str]]:
        """The error, its parts and what is left as names and values, for tables."""
        allowed = self.servo_allowed if self.allowed is None else self.allowed
        return [
            ("contour error", f"at most {mm(self.executed)}"),
            ("of it servo", mm(self.servo)),
            ("  command interval", mm(self.sampling)),
            ("  robots of the box", mm(self.box) if self.box else ""),
            ("  not explained", mm(self.unexplained) if self.unexplained else ""),
            ("rounding of corners", mm(self.rounding)),
            ("left", f"{mm(self.left)} of {mm(allowed)}"),
        ]

    @property
    def left(self) -> float:
        """Unused part of the tolerance, or of `servo_allowed` without a tolerance [m]."""
        if self.allowed is None:
            return self.servo_allowed - self.executed
        return self.allowed - self.total


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertified(Checked):
    """The fastest plan of the same limits, with nothing derated and the same compensation.

    Args:
        duration: Duration [s].
        contours: Duration of every contour [s].
        contour_error: Largest contour error of both directions, and its root mean square over time,
            from the tool to the path [m].
        saturated: Share of the time for which each joint is saturated, (dof,).
        box: Largest contour error in the corners of the box [m]; None without one.
    """

    duration: float
    contours: tuple[float, ...]
    contour_error: tuple[float, float]
    saturated: FloatArray
    box: float | None


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContourCertificate:
    """The certificate of one contour, for the time during which the process is at work on it.

    Args:
        name: Name in messages.
        t: Start and end time in the whole motion [s].
        work: Start and end time of the work of the process, in which errors count [s].
        path: The tool path.
        joint_path: The joint path.
        derating: Derating of acceleration and speed along the path.
        factors: Shares that are left of limits derated along the whole contour, by their names.
        lowered: What was derated: how much, where, and for what; the largest share first.
        trajectory: Plan of the contour; times from 0 [s].
        taught: Taught data of the contour, after those of the moves before it that still affect the
            servo.
        error: Contour error in the execution of the whole program: from the tool to the path.
        missed: Largest distance from the path to the tool in that execution.
        speed_ratio: Largest ratio of the tool speed to the velocity assigned at its place in that
            execution; 0 where none is assigned.
        budget: The parts of the contour error.
        optimum: Duration of the uncertified plan of the contour [s].
        corners: Executions in the corners of the box; None without a box.
        spread: Executions on robots drawn from the box; None without a box.
        linear: Figures of the linear model of rigid bodies; None of servos.
        trials: Number of plans that were made.
    """

    name: str
    t: tuple[float, float]
    work: tuple[float, float]
    path: Path
    joint_path: JointPath
    derating: Derating
    factors: dict[str, float]
    lowered: tuple[Lowered, ...]
    trajectory: Trajectory
    taught: TaughtData
    error: ErrorProfile
    missed: Missed
    speed_ratio: float
    budget: Budget
    optimum: float
    corners: Spread | None
    spread: Spread | None
    linear: LinearFigures | None
    trials: int

    def __str__(self) -> str:
        """The error of the contour and its parts."""
        cost = (self.duration - self.optimum) * 1e3
        return line_up(
            f"Certified: {self.name}: {self.duration:.4f} s",
            [
                ("cost", f"{cost:+.1f} ms to {self.optimum:.4f} s"),
                *self.budget.rows,
                ("derated, mean", ", ".join(f"{x:.2%}" for x in self.headroom)),
                *(("lowered", str(x)) for x in self.lowered),
            ],
        )

    __repr__ = brief

    @property
    def shape(self) -> str | None:
        """Shape of the corners of the path: "free", "arc", or None where none was changed."""
        if isinstance(self.path, ShapedPath):
            return FREE
        return ARC if isinstance(self.path, RoundedPath) and len(self.path.corners) else None

    @property
    def duration(self) -> float:
        """Duration of the contour [s]."""
        return self.trajectory.duration

    @property
    def headroom(self) -> FloatArray:
        """Share by which each acceleration limit is derated, mean along the path, (dof,)."""
        left = np.average(self.derating.share, axis=0, weights=self.derating.width)
        # Rounding of a mean of ones is no derating.
        return np.maximum(1.0 - left, 0.0)

    @property
    def largest_headroom(self) -> FloatArray:
        """Largest share by which each joint's acceleration limit is derated, (dof,)."""
        return np.asarray(1.0 - self.derating.share.min(axis=0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Certificate:
    """The fastest plan found that keeps a goal, with the evidence.

    A job of a single path has one contour. Its joint path and its derating are attributes of
    the certificate too.

    Args:
        job: The job.
        run: The run, with the corner tolerance of the certified plan.
        goal: The goal that is kept.
        model: The model of the robot for which the certificate is valid, in words.
        objective: The program before its corners were rounded.
        path: The program that was planned; `path.path` is the tool path of a single contour.
        trajectory: The certified plan.
        taught: Taught data of the plan.
        execution: Execution of the taught data on the model.
        evaluation: Evaluation of the execution, at 0.1 ms.
        check: Check of the plan against every limit, between samples too.
        contours: Certificates of the contours, in order.
        rapids: The derated rapids between them, in order.
        uncertified: The fastest plan without derating, for comparison.
        shapes: Where the run asked for a free shape, the duration of the fastest plan by shape: of
            the certified plan, and of plans with the other shape, which may not be certified if
            none can be faster [s]. Else empty.
        trials: Number of plans of contours that were made.
        experiment: Execution of the same taught data on the arm's rigid bodies, which no trial
            used; None if the run has no experiment, or if the experiment failed.
        failure: The error of a failed experiment; None otherwise.
        clearance: How far the arm stays from itself and from its cell; None where nothing looks
            at it.
    """

    job: Job
    run: Run
    goal: Goal
    model: str
    objective: Program
    path: Program
    trajectory: Trajectory
    taught: TaughtData
    execution: Execution
    evaluation: Evaluation
    check: Check
    contours: tuple[ContourCertificate, ...]
    rapids: tuple[Derated, ...]
    uncertified: Uncertified
    shapes: Mapping[str, float]
    trials: int
    experiment: ExperimentResult | None
    failure: ExecutionError | None = None
    clearance: Clearance | None = None

    def __str__(self) -> str:
        """What is certified, for which model, and what it costs."""
        several = len(self.contours) > 1
        worst = f", least left on {self.worst.name}" if several else ""
        title = f"Certified: {self.job.title}, run {self.run.name}: {self.duration:.4f} s"
        return line_up(
            title,
            [
                ("cost", f"{self.cost * 1e3:+.1f} ms to {self.uncertified.duration:.4f} s"),
                ("contours", f"{len(self.contours)}, all certified{worst}" if several else ""),
                *self.budget.rows,
                ("derated, mean", ", ".join(f"{x:.2%}" for x in self.headroom)),
                ("saturated", ", ".join(f"{x:.1%}" for x in self.evaluation.saturated)),
                ("limits of the plan", f"{self.check.verdict}, between samples too"),
                ("holds for", self.model),
                ("condition", self.condition),
            ],
        )

    def __repr__(self) -> str:
        """Job, run, duration and largest contour error, without arrays."""
        error = max(x.budget.executed for x in self.contours)
        return (
            f"Certificate({self.job.name!r}, run {self.run.name!r}, {self.duration:.6g} s, "
            f"contour error at most {error:.3g} m)"
        )

    @property
    def duration(self) -> float:
        """Duration of the certified plan [s]."""
        return self.trajectory.duration

    @property
    def cost(self) -> float:
        """Time that the certificate costs [s]."""
        return self.duration - self.uncertified.duration

    @property
    def condition(self) -> str:
        """Condition of what the servo model does not explain; empty if that is not known."""
        if not self.budget.unexplained:
            return ""
        return beyond_logs(self.job.plant_servo, self.trajectory) or (
            "What the servo model does not explain is bounded for motion with at most the velocity "
            "and acceleration of the logs of its identification."
        )

    @property
    def pauses(self) -> float:
        """Time for which the joints stand still so that the tool settles after rapids [s]."""
        spans = (x for x in self.trajectory.spans if x.kind == "dwell" and x.move is None)
        return sum(x.t[1] - x.t[0] for x in spans)

    @property
    def worst(self) -> ContourCertificate:
        """The contour with the least left of its budget."""
        return min(self.contours, key=lambda x: x.budget.left)

    @property
    def budget(self) -> Budget:
        """The parts of the contour error, of the contour with the least left."""
        return self.worst.budget

    @property
    def corners(self) -> Spread | None:
        """The corners of the box, on the contour with the least left; None without a box."""
        return self.worst.corners

    @property
    def spread(self) -> Spread | None:
        """Robots drawn from the box, on the contour with the least left; None without a box."""
        return self.worst.spread

    @property
    def linear(self) -> LinearFigures | None:
        """What the linear model of rigid bodies says; None of a certificate for servos."""
        return self.worst.linear

    @property
    def headroom(self) -> FloatArray:
        """Share by which each joint's acceleration limit is derated, mean along all contours."""
        lengths = [x.path.length for x in self.contours]
        means = [x.headroom for x in self.contours]
        return np.asarray(np.average(means, axis=0, weights=lengths))

    @property
    def largest_headroom(self) -> FloatArray:
        """Largest share by which each joint's acceleration limit is derated, (dof,)."""
        return np.asarray(np.max([x.largest_headroom for x in self.contours], axis=0))

    @property
    def lowered(self) -> tuple[str, ...]:
        """What was derated, a clause each: of several contours, the one that lost most of each."""
        most: dict[tuple[str, str], tuple[float, str]] = {}
        for x in self.contours:
            of = f"{x.name}: " if len(self.contours) > 1 else ""
            for y in x.lowered:
                known = most.get((y.what, y.cause))
                if known is None or known[0] < y.share:
                    most[y.what, y.cause] = (y.share, f"{of}{y}")
        return tuple(said for _, said in sorted(most.values(), reverse=True))

    @property
    def on_bodies(self) -> str | None:
        """Sentence that a certificate for servos is not valid for the arm's rigid bodies.

        None for a certificate on rigid bodies, and without bodies or without MuJoCo.
        """
        bodies = self.job.arm.has_bodies and self.job.plant_servo.kv is not None and can_simulate()
        if self.goal.plant == "rigid_body" or not bodies:
            return None
        said = "Valid for independent joint servos only: "
        if self.experiment is None:
            said += "coupled dynamics of the arm's rigid bodies can increase the error"
        else:
            e = self.experiment.evaluation
            off = max(e.contour_error.max, e.missed.max)
            beyond = "above" if off > self.budget.servo_allowed else "within"
            said += (
                f"in the experiment on the arm's rigid bodies the contour error is {mm(off)}, "
                f"{beyond} the {mm(self.budget.servo_allowed)} allowed for servos"
            )
        if len(self.path.moves) > 1:
            return f"{said}; an experiment of the job measures it."
        return f"{said}; plant: rigid_body (--plant rigid_body) certifies for these."

    @property
    def joint_path(self) -> JointPath:
        """The joint path of the only contour."""
        return self._only.joint_path

    @property
    def derating(self) -> Derating:
        """Derating of acceleration and speed along the only contour."""
        return self._only.derating

    @property
    def _only(self) -> ContourCertificate:
        """The only contour.

        Raises:
            InvalidInput: There is more than one contour.
        """
        if len(self.contours) != 1:
            raise InvalidInput(
                f"The certificate of the job {self.job.name} has {len(self.contours)} contours: "
                "every one of its contours has a path and a derating of its own."
            )
        return self.contours[0]

    @property
    def result(self) -> RunResult:
        """The certified plan as the result of its run."""
        single = self.path.single_path
        found = RunResult(
            run=self.run,
            objective=self.objective,
            path=self.path,
            traced=None if single is None else Tracing.along(self.joint_path, single),
            trajectory=self.trajectory,
            explanation=None,
            taught=self.taught,
            servo=self.job.servo,
            execution=self.execution,
            evaluation=self.evaluation,
            experiment=self.experiment,
            failure=self.failure,
            clearance=self.clearance,
        )
        return replace(found, warnings=collect_warnings(found))

    @property
    def study(self) -> Study:
        """A study with the certified plan as its only run."""
        job = replace(self.job, runs=(self.run,))
        return Study(job=job, runs={self.run.name: self.result})
