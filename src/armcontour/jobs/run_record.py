"""`RunRecord`: what a run has computed, from its plan to its verdict."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, fields
from functools import cached_property
from typing import Any, Self

from armcontour.core.checks import FloatArray
from armcontour.core.errors import ExecutionError
from armcontour.core.render import Result, number
from armcontour.core.result import FILE, JUDGED, VERDICT, Data, Row, Table
from armcontour.core.text import joint_label, short_repr
from armcontour.jobs.job import Run
from armcontour.jobs.plan_quantities import (
    CURVATURE_JUMPS,
    JerkStop,
    Weaving,
    jerk_stops,
    peak_torques,
    stops_of_path,
    weavings,
)
from armcontour.jobs.program_points import ProgramPoints
from armcontour.jobs.resumed_configuration import Resumption
from armcontour.jobs.verdict import (
    BETWEEN_POINTS,
    BODIES,
    EXPECTED,
    SERVO,
    VERDICT_ROUNDING,
    Deviation,
    Errors,
    Verdict,
    judge,
    judging,
)
from armcontour.motion import Execution, SetPoints, Trajectory, arm_of
from armcontour.motion.set_point_rule import SetPointUse
from armcontour.planning import Explanation, Tracing
from armcontour.planning.constraints import CommandVelocity
from armcontour.program import Program
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.simulation import RigidBodyPlant
from armcontour.verification import Evaluation
from armcontour.verification.clearance import Clearance
from armcontour.verification.unknown_gains import UnknownGains

# What is sent to controllers, and judged.
SET_POINTS = "set-points"
PROGRAMS = "programs"


@dataclass(frozen=True, slots=True, kw_only=True)
class Improvement:
    """A suggested change of a job, and its effect.

    Args:
        label: The change in words.
        edits: Keys of the job file, relative to the run, and their values in SI units.
        saved: Reduction of the duration [s]; negative if the motion becomes longer.
        duration: Duration of the changed motion [s].
        off_drawing: Distance of the tool from the drawing after the change [m].
        kept: Verdict on the changed run; None if it is not judged.
        condition: Condition of the change, as a clause.
    """

    label: str
    edits: tuple[tuple[str, Any], ...]
    saved: float
    duration: float
    off_drawing: float
    kept: bool | None
    condition: str = ""

    @property
    def effect(self) -> str:
        """Effect of the change, such as "saves 0.5 s"."""
        if self.saved == 0:
            return "takes as long"
        time = number(abs(self.saved), "s")
        return f"saves {time}" if self.saved >= 0 else f"keeps the accuracy, takes {time} more"


@dataclass(frozen=True, slots=True, kw_only=True)
class Advice(Result):
    """Suggested changes of a run, in order of decreasing effect.

    Args:
        improvements: The changes.
        note: A sentence if there are none.
    """

    improvements: tuple[Improvement, ...]
    note: str

    def to_data(self) -> Data:
        """Return the table of the changes, or the note."""
        return Data("What to change", tables=(self.table,), notes=(self.note,) if self.note else ())

    @property
    def table(self) -> Table:
        """Table of the changes for reports, the Studio, the terminal and files."""
        columns = (
            *(Row("change", None, "", "what to change"), Row("saved", None, "s", "saves")),
            *(Row("off_drawing", None, "m", "off the drawing"), Row("kept", None, JUDGED, "then")),
            *(Row("duration", None, "s"), Row("condition", None, "", "if"), Row("edits", None)),
        )
        changes = [
            (x.label, x.saved, x.off_drawing, x.kept, x.duration, x.condition, x.edits)
            for x in self.improvements
        ]
        return Table("changes", columns, changes, VERDICT if changes else FILE)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExpectedErrors:
    """Contour errors to expect of a robot whose servo was identified from its logs.

    Args:
        contours: Largest error of each contour [m].
        worst: Largest error if every joint deviates as far as it did at most in the logs [m].
    """

    contours: tuple[float, ...]
    worst: float


@dataclass(frozen=True, slots=True, kw_only=True, eq=False)
class ExperimentResult:
    """Result of a run that is simulated with rigid bodies.

    Args:
        plant: The bodies and drives.
        execution: The executed motion.
        evaluation: Errors of the executed motion.
        uncompensated: Errors of the same plan without compensation; None for a run that has none,
            or if its joints do not come to rest.
    """

    plant: RigidBodyPlant
    execution: Execution
    evaluation: Evaluation
    uncompensated: Evaluation | None = None

    def __str__(self) -> str:
        """Write the evaluation of the experiment."""
        return f"Experiment on rigid bodies. {self.evaluation}"

    __repr__ = short_repr


@dataclass(frozen=True, kw_only=True, eq=False)
class RunRecord:
    """What one run of a job has computed, and the verdict on it.

    Rows and notes are made from a record. `RunResult` is the record with its rows and notes; it
    explains the fields.
    """

    run: Run
    objective: Program
    path: Program
    trajectory: Trajectory
    traced: Tracing | None = None
    clearance: Clearance | None = None
    avoided: tuple[str, ...] = ()
    explanation: Explanation | None = None
    # Users get only results with set-points, so that the type of the field is not optional.
    set_points: SetPoints = None  # type: ignore[assignment]
    servo: ServoModel | None = None
    execution: Execution | None = None
    evaluation: Evaluation | None = None
    expected: ExpectedErrors | None = None
    unknown_gains: UnknownGains | None = None
    executed_clearance: Clearance | None = None
    experiment: ExperimentResult | None = None
    failure: ExecutionError | None = None
    advice: Advice | None = None
    resumption: Resumption | None = None
    command_velocity: CommandVelocity | None = None
    program: ProgramPoints | None = None

    @classmethod
    def from_plan(cls, planned: RunRecord, **changes: Any) -> Self:
        """Create an instance of this class from a plan and further or changed fields."""
        return cls(**{x.name: getattr(planned, x.name) for x in fields(RunRecord)} | changes)

    @property
    def kept(self) -> bool | None:
        """True if the tool deviates from the drawing by no more than allowed, within all limits.

        Set-points must stay within the joint ranges and joint velocities, and the simulated robot
        must keep the clearance. If several executions judge the run, the worse one counts.
        Programs whose controllers plan the motion between the points are judged without a
        simulation. None without an execution, and without an accuracy and a tolerance.
        """
        return self.verdict.kept

    @cached_property
    def verdict(self) -> Verdict:
        """The verdict on the run: the worse one of set-points and programs."""
        return self.worst_verdict(self.errors)

    def worst_verdict(self, errors: Mapping[str, Errors] | None) -> Verdict:
        """Return the worse verdict of set-points and programs, for other simulated errors."""
        order = [False, None, True]
        return min(self.verdicts(errors).values(), key=lambda x: order.index(x.kept))

    def verdicts(self, errors: Mapping[str, Errors] | None) -> dict[str, Verdict]:
        """Return the verdicts on what is sent: set-points, programs or both, by name.

        - `errors`: simulated errors of the set-points; None without an execution.
        """
        verdicts = dict[str, Verdict]()
        if self.sends_set_points:
            verdicts[SET_POINTS] = self.judge(errors)
        if self.program is not None:
            verdicts[PROGRAMS] = self._judge_program(self.program)
        return verdicts

    @property
    def sends_set_points(self) -> bool:
        """False if controllers get only programs between whose points they plan the motion."""
        return self.program is None or not self.program.only

    def _judge_program(self, program: ProgramPoints) -> Verdict:
        """Judge a program by what its controller may do between the points."""
        spans = self.trajectory.spans
        between = program.between
        contours = [between.largest_within(*x.t) for x in self.trajectory.contour_spans]
        rapids = [between.largest_within(*x.t) for x in spans if x.kind != "contour"]
        largest = max(rapids, default=0.0)
        errors = {BETWEEN_POINTS: Errors(contour=contours)}
        verdict = judge(self.run, self.deviations, errors)
        if verdict.allowed is None or largest <= verdict.allowed * (1 + VERDICT_ROUNDING):
            return verdict
        clause = f"between the points, rapids may be missed by {number(largest, 'm')}"
        return judge(self.run, self.deviations, errors, violations=(clause,))

    def judge(self, errors: Mapping[str, Errors] | None) -> Verdict:
        """Return the verdict on other simulated errors of this plan; None without an execution."""
        return judge(
            self.run,
            self.deviations,
            errors,
            failed=self.failure is not None,
            violations=self.violations,
        )

    @cached_property
    def violations(self) -> tuple[str, ...]:
        """Limits that the set-points or the simulated robot violate, as clauses."""
        found = list[str]()
        if self.set_points is not None and self.sends_set_points:
            for excess in self.set_point_use.excesses:
                if not excess.is_assumed:
                    label = joint_label(excess.joint + 1, self.arm.joint_names)
                    times = "" if excess.is_range else f" {excess.ratio:.3g} times"
                    found.append(f"set-points of joint {label} exceed {excess.limit}{times}")
        executed = self.executed_clearance
        if executed is not None and not executed.satisfied:
            found.append(f"in the execution, {executed.too_near[0].bodies} come too near")
        return tuple(found)

    @cached_property
    def set_point_use(self) -> SetPointUse:
        """How far the set-points use their limits."""
        return self.set_points.use

    @property
    def deviations(self) -> list[Deviation]:
        """For each contour, how far the path deviates from the drawing."""
        pairs = zip(self.path.contours, self.objective.contours, strict=True)
        return [Deviation.of_path(x.path, drawn.path) for x, drawn in pairs]

    @property
    def errors(self) -> dict[str, Errors] | None:
        """Largest errors in each execution; None without a simulation."""
        errors = {name: Errors.of_evaluation(x) for name, x in self.evaluations.items()}
        if self.expected is not None:
            errors[EXPECTED] = Errors(contour=self.expected.contours)
        return errors or None

    @property
    def evaluations(self) -> dict[str, Evaluation]:
        """Evaluations of all executions by their names `SERVO` and `BODIES`."""
        bodies = None if self.experiment is None else self.experiment.evaluation
        both = {SERVO: self.evaluation, BODIES: bodies}
        return {name: x for name, x in both.items() if x is not None}

    @property
    def judged(self) -> Evaluation | None:
        """The worst evaluation of those that judge the run; None without a simulation.

        Set-points that compensate the dynamics of the arm are judged on rigid bodies only, if the
        run has an experiment.
        """
        judges = judging(self.run, self.evaluations).values()
        return max(judges, key=lambda x: x.contour_error.max, default=None)

    @property
    def arm(self) -> Arm:
        """Arm of the execution, or of the plan."""
        return arm_of(self.trajectory) if self.execution is None else self.execution.arm

    @cached_property
    def motion(self) -> Execution:
        """Executed motion; without a simulation, joints follow the plan exactly."""
        if self.execution is not None:
            return self.execution
        return Execution.from_plan(self.trajectory, self.arm)

    @property
    def rounding_error(self) -> float | None:
        """Largest rounding error of the path [m]; None if corners are as drawn."""
        return max((x.rounding for x in self.deviations if x.rounding is not None), default=None)

    @property
    def smoothing_error(self) -> float:
        """Largest distance by which transitions for jerk limits changed the path [m]."""
        return max((x.smoothing for x in self.deviations), default=0.0)

    @property
    def allowed_distance(self) -> float | None:
        """Distance between tool and drawing that the run allows [m]; None if nothing limits it."""
        if self.run.accuracy is not None or self.tolerance is None:
            return self.run.accuracy
        return self.tolerance + self.smoothing_error + (self.verdict.allowed or 0.0)

    @property
    def tolerance(self) -> float | None:
        """Largest corner error that the run allows [m]; None if not specified."""
        rounding = self.run.rounding
        return None if rounding is None else rounding.tolerance

    @cached_property
    def peak_torques(self) -> FloatArray | None:
        """Largest planned torque of each joint [N m], (dof,); None if the masses are unknown."""
        return peak_torques(self.arm, self.trajectory)

    @cached_property
    def jerk_stops(self) -> tuple[JerkStop, ...]:
        """Full stops inside contours at jumps of the curvature, due to jerk limits."""
        return jerk_stops(self.path, self.traced, self.trajectory, self.run)

    @cached_property
    def weaves(self) -> tuple[Weaving, ...]:
        """Planned width and frequency of each weave."""
        return tuple(weavings(self.path, self.trajectory))

    @property
    def full_stops(self) -> dict[str, int]:
        """Number of full stops inside contours, by reason."""
        stops = self.stops_of_path
        if self.jerk_stops:
            stops[CURVATURE_JUMPS] = len(self.jerk_stops)
        return stops

    @property
    def stops_of_path(self) -> dict[str, int]:
        """Number of full stops that the path requires regardless of limits, by reason."""
        if self.run.timing.passes_corners:
            return {}
        return stops_of_path(self.path)
