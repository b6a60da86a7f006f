"""The certificate of a plan: errors of each contour, derating, and cost in time."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import asdict, dataclass, replace

import numpy as np

from armcontour.core.checks import FloatArray, Frozen
from armcontour.core.pictures import Pictured
from armcontour.core.render import Result, number, verdict
from armcontour.core.result import FILE, FIRST, JUDGED, TABLE, VERDICT, Data, Row, Table
from armcontour.core.text import count_noun, joint_label, short_repr
from armcontour.core.validity import AS_MODELLED, OF_CERTIFICATE
from armcontour.geometry import Path, RoundedPath, ShapedPath
from armcontour.jobs.certificate_goal import CertificateGoal
from armcontour.jobs.job import ARC, FREE, Job
from armcontour.jobs.rows import field_rows, off_drawing, verdict_rows, warning_rows
from armcontour.jobs.run_notes import beyond_logs
from armcontour.jobs.run_result import JobResult, RunResult
from armcontour.jobs.verdict import BODIES, SERVO, VERDICT_ROUNDING, Deviation
from armcontour.motion import JointPath, SetPoints, Trajectory
from armcontour.simulation.rigid_body_plant import can_simulate
from armcontour.studies.certification.box_errors import BoxErrors
from armcontour.studies.certification.derating import DeratedInterval, Derating
from armcontour.verification import Check
from armcontour.verification.error_profile import Coverage, ErrorProfile, error_rows
from armcontour.verification.evaluation import duration_row

# Label of the row with the bound of the distance from the drawing.
GUARANTEED = "off the drawing, guaranteed"
# Names of the rows of the verdict that do not depend on the execution.
PLANNED = ("duration", "time_limit")


@dataclass(frozen=True, slots=True, kw_only=True)
class Budget(Result):
    """The parts of the contour error [m].

    Each contour error is the larger of both directions: tool to path, and path to tool.

    Args:
        rounding: Largest corner error of the path, or the tolerance of a path with the shape
            "free".
        smoothing: Largest distance by which transitions for jerk limits changed the path.
        servo: Largest contour error of the same plan with a nearly continuous command.
        sampling: Part that the cycle adds to `servo`; can be negative.
        box: Part that the worst robot of the box adds to `servo` and `sampling`; 0 without a box.
        model_error: Bound, to first order, of the error across the path that the servo model does
            not explain; 0 if `model_error` of the servo is unknown.
        allowed: Tolerance for the sum of all parts; None if the goal has no tolerance.
        servo_allowed: Largest permitted sum of servo, sampling, box and model error.
    """

    rounding: float
    smoothing: float
    servo: float
    sampling: float
    box: float
    model_error: float
    allowed: float | None
    servo_allowed: float

    @property
    def executed(self) -> float:
        """Bound of the contour error of the execution, for all robots of the box [m]."""
        return self.servo + self.sampling + self.box + self.model_error

    @property
    def total(self) -> float:
        """Bound of the tool's distance from the objective path [m]."""
        return self.rounding + self.smoothing + self.executed

    def to_data(self) -> Data:
        """Return data of the bounds, the remaining budget, and the parts."""
        allowed = self.servo_allowed if self.allowed is None else self.allowed
        note = f"of {number(allowed, 'm')}"
        model_error = "not explained by the servo model" if self.model_error else ""
        return Data(
            "Budget",
            (
                Row("total", self.total, "m", GUARANTEED, level=FIRST),
                Row("executed", self.executed, "m", "contour error, guaranteed", level=FIRST),
                Row("left", self.left, "m", "left of the budget", note, FIRST),
                Row("rounding", self.rounding, "m", "rounding"),
                Row("smoothing", self.smoothing, "m", "smoothing" if self.smoothing else ""),
                Row("servo", self.servo, "m", "servo, continuous command"),
                Row("sampling", self.sampling, "m", "cycle"),
                Row("box", self.box, "m", "robots of the box" if self.box else ""),
                Row("model_error", self.model_error, "m", model_error),
                Row("allowed", self.allowed, "m"),
                Row("servo_allowed", self.servo_allowed, "m"),
            ),
        )

    @property
    def left(self) -> float:
        """Unused part of the tolerance, or of `servo_allowed` if there is no tolerance [m]."""
        if self.allowed is None:
            return self.servo_allowed - self.executed
        return self.allowed - self.total


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class Uncertified(Result, Frozen):
    """The fastest plan with the same limits and compensation, without derating.

    Args:
        duration: Duration [s].
        contours: Duration of each contour [s].
        contour_error: Largest contour error of both directions, and RMS over time of the distance
            from the tool to the path [m].
        saturated: Fraction of time in which each joint is saturated, (dof,).
        robots: Contour errors on robots of the box, for each contour; empty without a box.
    """

    duration: float
    contours: tuple[float, ...]
    contour_error: tuple[float, float]
    saturated: FloatArray
    robots: tuple[BoxErrors, ...]

    @property
    def box(self) -> float | None:
        """Largest contour error on robots of the box [m]; None without a box."""
        return max((float(x.max.max()) for x in self.robots), default=None)

    def to_data(self) -> Data:
        """Return data of duration, errors and saturation."""
        largest, rms = self.contour_error
        return Data(
            "Uncertified optimum",
            (
                duration_row(self.duration),
                Row("contour_error.max", largest, "m", "contour error, largest", level=FIRST),
                Row("contour_error.rms", rms, "m", "contour error, RMS"),
                Row("saturated", self.saturated, "1", "saturated"),
                Row("box", self.box, "m", "robots of the box, largest"),
            ),
        )

    __repr__ = short_repr


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ContourCertificate(Result):
    """The certificate of one contour for the time in which its process is on.

    Args:
        name: Name of the contour in messages.
        t: Start and end time in the whole motion [s].
        work: Start and end time of the process, in which errors count [s].
        path: The tool path.
        joint_path: The joint path.
        derating: Derating of acceleration and speed along the path.
        derated: Derated limits with amount, position and cause, in descending order of the amount.
        trajectory: Plan of the contour; its times start at 0 [s].
        error: Distance from the tool to the path in the execution of the whole program.
        coverage_error: Largest distance from the path to the tool in the execution of the program.
        speed_ratio: Largest ratio of tool speed to assigned velocity in the execution of the
            program; 0 without an assigned velocity.
        budget: The parts of the contour error.
        optimum: Duration of the uncertified plan of the contour [s].
        robots: Contour errors on robots of the box; None without a box.
        trials: Number of plans in the search.
    """

    name: str
    t: tuple[float, float]
    work: tuple[float, float]
    path: Path
    joint_path: JointPath
    derating: Derating
    derated: tuple[DeratedInterval, ...]
    trajectory: Trajectory
    error: ErrorProfile
    coverage_error: Coverage
    speed_ratio: float
    budget: Budget
    optimum: float
    robots: BoxErrors | None
    trials: int

    def to_data(self) -> Data:
        """Return data of the contour's error, its parts, and the derating."""
        optimum = number(self.optimum, "s")
        robots = [Row("robots", None)]
        if self.robots is not None:
            robots = [*self.robots.to_data().with_prefix("robots", FILE)]
        joint = f"joint {int(self.headroom.argmax()) + 1}"
        return Data(
            "Certified contour",
            (
                Row("name", self.name, "", "contour", level=FIRST),
                *self.budget.to_data().with_prefix("budget"),
                duration_row(self.duration),
                Row("cost", self.cost, "s", "cost", f"uncertified {optimum}", FIRST),
                Row("optimum", self.optimum, "s"),
                Row("t", self.t, "s"),
                Row("work", self.work, "s"),
                Row("length", self.path.length, "m"),
                Row("shape", self.shape),
                *error_rows("contour_error", "contour error", self.error),
                *error_rows("coverage_error", "path missed", self.coverage_error),
                Row("speed_ratio", self.speed_ratio, "1"),
                Row("headroom", self.headroom, "1", "acceleration derated", joint),
                Row("derated", [asdict(x) for x in self.derated], "1"),
                *robots,
                Row("trials", self.trials),
            ),
        )

    __repr__ = short_repr

    @property
    def shape(self) -> str | None:
        """Corner shape of the path: "free", "arc", or None if no corner was changed."""
        if isinstance(self.path, ShapedPath):
            return FREE
        return ARC if isinstance(self.path, RoundedPath) and len(self.path.corners) else None

    @property
    def duration(self) -> float:
        """Duration of the contour [s]."""
        return self.trajectory.duration

    @property
    def cost(self) -> float:
        """Additional time compared to the uncertified plan of the contour [s]."""
        return self.duration - self.optimum

    @property
    def headroom(self) -> FloatArray:
        """Largest share by which each joint's acceleration limit is derated, (dof,)."""
        return np.asarray(1.0 - self.derating.share.min(axis=0))


@dataclass(frozen=True, kw_only=True, eq=False)
class Certificate(Result, Pictured):
    """The fastest plan found that satisfies a goal, and the evidence.

    Args:
        job: The job.
        result: The certified plan, its set-points, and their execution on the model, every 0.1
            ms. The run has the corner tolerance of the plan. Its experiment executes the same
            set-points on the arm's rigid bodies, which the search does not use.
        goal: The satisfied goal.
        model: Description of the robot model for which the certificate is valid.
        check: Check of the plan against every limit, also between samples.
        contours: Certificates of the contours, in program order.
        uncertified: The fastest plan without derating, for comparison.
        shapes: Durations of the fastest plans by shape [s] if the run requests the shape "free",
            otherwise empty. If the other shape cannot be faster, its plan need not be certified.
    """

    job: Job
    result: RunResult
    goal: CertificateGoal
    model: str
    check: Check
    contours: tuple[ContourCertificate, ...]
    uncertified: Uncertified
    shapes: Mapping[str, float]

    def to_data(self) -> Data:
        """Return data of the verdict, the parts of the error, and the model."""
        count = len(self.contours)
        run = self.result.run.name
        title = f"Certificate of {self.job.title}, run {run}, for independent servos"
        contours = Table.from_results(
            "contours", [x.to_data() for x in self.contours], TABLE if count > 1 else FILE
        )
        return Data(
            title + (f", {count_noun(count, 'contour')}" if count > 1 else ""),
            (*self._verdict(), *self._figures()),
            (contours,),
            notes=self.notes,
            warnings=self.warnings,
            not_proven=OF_CERTIFICATE,
        )

    __repr__ = short_repr

    def _verdict(self) -> Iterator[Row]:
        """Return rows of the guaranteed deviation from the drawing, the cost, and the rest."""
        worst = max(self.contours, key=lambda x: x.budget.total)
        budget = worst.budget
        rounding = None if worst.shape is None else budget.rounding
        deviation = Deviation(rounding=rounding, smoothing=budget.smoothing)
        tolerance = None
        accuracy = None
        allowed = None
        if budget.allowed is None:
            tolerance = self.result.tolerance
            accuracy = self.result.run.accuracy
            allowed = budget.servo_allowed
        errors = {SERVO: budget.executed}
        row = off_drawing(budget.total, deviation, tolerance, errors, allowed, GUARANTEED)
        sums = {"certified within": budget.allowed, "the job allows": accuracy}
        sums["on rigid bodies"] = self.experiment_error
        ends = (f"; {words} {number(x, 'm')}" for words, x in sums.items() if x is not None)
        yield replace(row, note=row.note + self._on(worst))
        note = f"limits {self.check.verdict}, between samples too" + "".join(ends)
        yield Row("kept", self.kept, JUDGED, "verdict", note, VERDICT, holds=AS_MODELLED)
        yield from (
            x for x in verdict_rows(self.result, self.result.judge(None)) if x.name in PLANNED
        )
        optimum = self.uncertified.duration
        note = f"{number(self.cost / optimum, '1')} of the uncertified {number(optimum, 's')}"
        yield Row("cost", self.cost, "s", "cost", note, VERDICT)
        margin = self.budget.to_data()["left"]
        note = margin.note + self._on(self.worst)
        yield replace(margin, name="budget.left", note=note, level=VERDICT)
        yield from warning_rows(self.warnings)

    def _figures(self) -> Iterator[Row]:
        """Return rows of budget, shape, derating, model, goal, and the uncertified plan."""
        for row in self.budget.to_data().with_prefix("budget"):
            # If there are several contours, the table of contours has their budgets.
            shown = len(self.contours) == 1 and row.name != "budget.total"
            if row.name != "budget.left":
                yield replace(row, level=max(row.level, TABLE) if shown else FILE)
        yield Row("shapes", self.shapes, "s")
        if self.shapes and self.result.run.rounding is not None:
            shape = self.result.run.rounding.shape
            others = {x: number(t, "s") for x, t in self.shapes.items() if x != shape}
            note = ", ".join(f"{x} takes at least {t}" for x, t in others.items())
            yield Row("shape", shape, "", "corner shape", note)
        joint = joint_label(int(self.headroom.argmax()) + 1, self.job.arm.joint_names)
        yield Row("headroom", self.headroom, "1", "acceleration derated", f"at most, joint {joint}")
        yield Row("pauses", self.pauses, "s", "pauses after rapids" if self.pauses else "")
        yield Row("limits_used", {x.name: x.ratio for x in self.check.uses}, "1")
        yield Row("not_judged", self.check.not_judged)
        yield Row("trials", self.trials, "", "plans tried")
        yield Row("model", self.model, "", "valid for")
        yield Row("rigid_body_warning", self.rigid_body_warning)
        yield Row("run", self.result.run.name)
        yield from field_rows("goal", self.goal)
        yield from self.uncertified.to_data().with_prefix("uncertified", FILE)

    def _on(self, contour: ContourCertificate) -> str:
        """Clause with the name of a contour; empty if there is only one contour."""
        return f", on {contour.name}" if len(self.contours) > 1 else ""

    @property
    def comparison(self) -> dict[str, Data]:
        """The same values of the uncertified plan, the certified plan, and its experiment."""
        before = self.uncertified.to_data()
        names = {SERVO: "certified", BODIES: "certified, on rigid bodies"}
        evaluated = {names[x]: y.to_data() for x, y in self.result.evaluations.items()}
        if (box := before["box"]).value is not None:
            certified = evaluated["certified"]
            box = replace(box, value=max(x.budget.executed for x in self.contours))
            evaluated["certified"] = replace(certified, rows=(*certified.rows, box))
        shown = [x.name for x in before.rows]
        compared = {"uncertified optimum": before}
        for name, data in evaluated.items():
            compared[name] = replace(data, rows=tuple(x for x in data.rows if x.name in shown))
        return compared

    @property
    def kept(self) -> bool:
        """True if all contours satisfy their budgets, and the plan satisfies its limits.

        Rigid bodies judge the certificate if the run has an experiment.
        """
        within = (
            x.budget.left >= -VERDICT_ROUNDING * x.budget.servo_allowed for x in self.contours
        )
        bodies = (self.experiment_error or 0.0) <= self.budget.servo_allowed
        completed = self.result.failure is None
        valid = self.check.verdict != "violated"
        return all(within) and bodies and completed and valid

    @property
    def experiment_error(self) -> float | None:
        """Largest contour error of the experiment [m]; None without its result."""
        if self.result.experiment is None:
            return None
        e = self.result.experiment.evaluation
        return max(e.contour_error.max, e.coverage_error.max)

    @property
    def notes(self) -> tuple[str, ...]:
        """Sentences about robots of the box, derating, and unchecked limits."""
        where = f"On {self.worst.name}: " if len(self.contours) > 1 else ""
        robots = self.worst.robots
        sentences = [] if robots is None else [f"{where}{verdict(robots.to_data())}"]
        sentences += [f"Reduced: {x}." for x in self.derating_clauses]
        if self.check.not_judged:
            sentences.append("Not checked: " + ", ".join(self.check.not_judged) + ".")
        return (*sentences, *filter(None, [self.condition]))

    @property
    def warnings(self) -> tuple[str, ...]:
        """Sentences about weak points of the plan, and about models that are not certified."""
        return (*self.result.warnings, *filter(None, [self.rigid_body_warning]))

    @property
    def trials(self) -> int:
        """Number of contour plans in the search, for all contours."""
        return sum(x.trials for x in self.contours)

    @property
    def duration(self) -> float:
        """Duration of the certified plan [s]."""
        return self.trajectory.duration

    @property
    def cost(self) -> float:
        """Additional time compared to the uncertified plan [s]."""
        return self.duration - self.uncertified.duration

    @property
    def condition(self) -> str:
        """Sentence on when the bound of unexplained errors is valid; empty if there is no bound."""
        if not self.budget.model_error:
            return ""
        return beyond_logs(self.job.plant_servo, self.trajectory) or (
            "Errors that the servo model does not explain are bounded for motion with at most the "
            "velocity and acceleration of the logs of its identification."
        )

    @property
    def pauses(self) -> float:
        """Total duration of the pauses in which the tool settles after rapids [s]."""
        spans = (x for x in self.trajectory.spans if x.kind == "dwell" and x.move is None)
        return sum(x.t[1] - x.t[0] for x in spans)

    @property
    def worst(self) -> ContourCertificate:
        """The contour with the smallest remaining budget."""
        return min(self.contours, key=lambda x: x.budget.left)

    @property
    def budget(self) -> Budget:
        """Parts of the worst contour's error."""
        return self.worst.budget

    @property
    def headroom(self) -> FloatArray:
        """Largest share by which each joint's acceleration limit is derated, (dof,)."""
        return np.asarray(np.max([x.headroom for x in self.contours], axis=0))

    @property
    def derating_clauses(self) -> tuple[str, ...]:
        """Derated limits as clauses; for several contours, the largest reduction of each limit."""
        largest: dict[tuple[str, str], tuple[float, str]] = {}
        for contour in self.contours:
            prefix = f"{contour.name}: " if len(self.contours) > 1 else ""
            for y in contour.derated:
                clause = y.share, f"{prefix}{y}"
                largest[y.what, y.cause] = max(largest.get((y.what, y.cause), clause), clause)
        return tuple(clause for _, clause in sorted(largest.values(), reverse=True))

    @property
    def rigid_body_warning(self) -> str | None:
        """Warning that the certificate of an arm with masses is for servos only; otherwise None."""
        if not (self.job.arm.has_bodies and self.job.plant_servo.kv is not None and can_simulate()):
            return None
        if (error := self.experiment_error) is None:
            return (
                "Valid for independent joint servos only: coupled dynamics of the arm's rigid "
                "bodies can increase the error; an experiment of the job measures it."
            )
        return (
            "Valid for independent joint servos only: in the experiment on the arm's rigid bodies "
            f"the contour error is {number(error, 'm')} of "
            f"{number(self.budget.servo_allowed, 'm')} allowed for servos."
        )

    @property
    def trajectory(self) -> Trajectory:
        """The certified plan."""
        return self.result.trajectory

    @property
    def set_points(self) -> SetPoints:
        """Set-points of the certified plan."""
        return self.result.set_points

    @property
    def job_result(self) -> JobResult:
        """Job result with the certified plan as its only run."""
        run = self.result.run
        return JobResult(job=replace(self.job, runs=(run,)), runs={run.name: self.result})
