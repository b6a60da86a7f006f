"""A certificate: what its plan holds, contour by contour and as a whole, and what that cost."""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour.certification._derating import Held
from armcontour.certification._rapids import Derated
from armcontour.errors import ExecutionError, InvalidInput
from armcontour.evaluation import Check, Evaluation
from armcontour.evaluation.error_profile import ErrorProfile
from armcontour.geometry import Path
from armcontour.jobs.goal import Goal
from armcontour.jobs.job import Job, Run
from armcontour.jobs.study import ExperimentResult, RunResult, Study
from armcontour.motion import Execution, JointPath, TaughtData, Trajectory
from armcontour.program import Program
from armcontour.robustness.monte_carlo import Spread


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
    """The fastest plan of the same limits, with nothing derated, compensated alike.

    Args:
        duration: [s].
        contours: Of every contour [s].
        contour_error: Largest, and its root mean square over time [m].
        saturated: Share of the time for which each joint is saturated, (dof,).
        box: Largest contour error in the corners of the box [m]; None without one.
    """

    duration: float
    contours: tuple[float, ...]
    contour_error: tuple[float, float]
    saturated: FloatArray
    box: float | None

    def __post_init__(self) -> None:
        object.__setattr__(self, "saturated", _checks.lock_floats(self.saturated))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContourCertificate:
    """What holds for one contour, while the process is at work on it.

    Args:
        name: What sentences call it.
        t: When it starts and ends in the whole motion [s].
        work: From when to when the process is at work, and errors count [s].
        path: The tool path.
        joint_path: The same in joint space.
        windows: Of the moving averages of s(t) [s].
        held: What is left of limits, place by place.
        factors: What is left of limits that are derated everywhere alike, by their names.
        trajectory: Its part of the plan, from 0 [s].
        taught: Its part of the taught data, which starts with as much of the moves before it as
            the servo still feels.
        error: Its contour error in the execution of the whole.
        budget: The parts of that error.
        optimum: Duration of the uncertified plan of it [s].
        corners: The corners of the box; None without one.
        spread: Robots drawn from the box; None without one.
        trials: Plans that were made.
    """

    name: str
    t: tuple[float, float]
    work: tuple[float, float]
    path: Path
    joint_path: JointPath
    windows: tuple[float, ...]
    held: Held
    factors: dict[str, float]
    trajectory: Trajectory
    taught: TaughtData
    error: ErrorProfile
    budget: Budget
    optimum: float
    corners: Spread | None
    spread: Spread | None
    trials: int

    @property
    def duration(self) -> float:
        """Duration of the contour [s]."""
        return self.trajectory.duration

    @property
    def headroom(self) -> FloatArray:
        """Share of every joint's acceleration limit that is derated, mean along the path."""
        left = np.average(self.held.share, axis=0, weights=self.held.width)
        # Rounding of a mean of ones is no derating.
        return np.maximum(1.0 - left, 0.0)

    @property
    def largest_headroom(self) -> FloatArray:
        """The same where most is derated, (dof,)."""
        return np.asarray(1.0 - self.held.share.min(axis=0))


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Certificate:
    """The fastest plan found that holds a goal, and what it was found by.

    A job of a single path has one contour, whose joint path, windows and derating are attributes of
    the certificate too.

    Args:
        job: The job.
        run: Its run, with the corners as they were rounded in the end.
        goal: What was required.
        model: The model that it holds for, in words.
        objective: The program before its corners were rounded.
        path: The program that was planned; `path.path` is the tool path of a single contour.
        trajectory: The certified plan.
        taught: Its taught data.
        execution: On the model.
        evaluation: Of that, at 0.1 ms.
        check: Of the plan against every limit, between samples too.
        contours: What holds for every contour, in order.
        rapids: How the rapids between them were derated, in order.
        uncertified: What it is compared with.
        trials: Plans of contours that were made.
        experiment: The same taught data on the arm's rigid bodies, which no trial saw; None if the
            run has no experiment, or it failed.
        failure: Why it failed, if it did.
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
    def pauses(self) -> float:
        """Time for which joints stand still until little enough is left of a rapid [s]."""
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
    def headroom(self) -> FloatArray:
        """Share of every joint's acceleration limit that is derated, mean along all contours."""
        lengths = [x.path.length for x in self.contours]
        means = [x.headroom for x in self.contours]
        return np.asarray(np.average(means, axis=0, weights=lengths))

    @property
    def largest_headroom(self) -> FloatArray:
        """The same where most is derated, (dof,)."""
        return np.asarray(np.max([x.largest_headroom for x in self.contours], axis=0))

    @property
    def joint_path(self) -> JointPath:
        """The path of the only contour in joint space."""
        return self._only.joint_path

    @property
    def windows(self) -> tuple[float, ...]:
        """The moving averages of s(t) of the only contour [s]."""
        return self._only.windows

    @property
    def held(self) -> Held:
        """What is left of limits along the only contour."""
        return self._only.held

    @property
    def _only(self) -> ContourCertificate:
        if len(self.contours) != 1:
            raise InvalidInput(
                f"The certificate of the job {self.job.name} has {len(self.contours)} contours: "
                "every one of its contours has paths, windows and derating of its own."
            )
        return self.contours[0]

    @property
    def result(self) -> RunResult:
        """The certified plan as the result of its run."""
        return RunResult(
            run=self.run,
            objective=self.objective,
            path=self.path,
            joint_path=None if self.path.single_path is None else self.joint_path,
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
