"""`JobResult` and `RunResult`: results of a job and its runs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import cached_property
from types import MappingProxyType
from typing import Any

from armcontour._version import __version__
from armcontour.control.compensation import NoCompensation
from armcontour.core.errors import ExecutionError
from armcontour.core.fields import checked
from armcontour.core.render import Result, compare, lay_out, number, units
from armcontour.core.result import FILE, FIRST, JUDGED, TABLE, VERDICT, Data, Row, Table
from armcontour.core.text import count_noun, draw, short_repr, to_html
from armcontour.geometry import RoundedPath
from armcontour.jobs import run_warnings
from armcontour.jobs.job import Job
from armcontour.jobs.plan_quantities import applied_torques
from armcontour.jobs.planned_run import Planned
from armcontour.jobs.run_data import (
    angular_rows,
    columns,
    corner_table,
    move_table,
    plant_rows,
    program_rows,
    resume_intervals,
    torque_rows,
    warning_rows,
)
from armcontour.jobs.verdict import (
    BODIES,
    EXPECTED,
    SERVO,
    ExpectedErrors,
    judging,
    time_limit_row,
    verdict_rows,
)
from armcontour.motion import Execution, SetPoints, arm_of
from armcontour.robot import Arm
from armcontour.robot.servo import ServoModel
from armcontour.simulation import RigidBodyPlant
from armcontour.verification import Evaluation
from armcontour.verification.clearance import Clearance
from armcontour.verification.evaluation import duration_row


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
        """Result with the table of the changes, or with the note."""
        return Data("What to change", tables=(self.table,), notes=(self.note,) if self.note else ())

    @property
    def table(self) -> Table:
        """Table of the changes for reports, the Studio, the terminal and files."""
        columns = (
            *(Row("change", None, "", "what to change"), Row("saved", None, "s", "saves")),
            *(Row("off_drawing", None, "m", "off the drawing"), Row("kept", None, JUDGED, "then")),
            *(Row("duration", None, "s"), Row("condition", None, "", "if"), Row("edits", None)),
        )
        rows = [
            (x.label, x.saved, x.off_drawing, x.kept, x.duration, x.condition, x.edits)
            for x in self.improvements
        ]
        return Table("changes", columns, rows, VERDICT if rows else FILE)


# Prefixes of the labels of values from the execution that is not the worst of those that judge.
OTHERS_LABELS = {SERVO: "servo model: ", BODIES: "on rigid bodies: "}
# Prefix of the names of values from the rigid-body simulation.
EXPERIMENT_PREFIX = "experiment."
# Values of that execution that are shown.
SHOWN_OF_OTHERS = ("contour_error", "torque")
# Values of the verdict, in the displayed order. Values of the clearance are in a separate part.
OF_VERDICT = ("kept", "off_drawing", "duration", "time_limit", "saturated", "warning_count")


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
        """The evaluation of the experiment."""
        return f"Experiment on rigid bodies. {self.evaluation}"

    __repr__ = short_repr


@dataclass(frozen=True, kw_only=True, eq=False)
class RunResult(Planned, Result):
    """Result of one run of a job: its plan, its set-points, their execution and its evaluation.

    Args:
        set_points: The set-points.
        servo: The servo model of the compensation.
        execution: The executed motion; None without a simulation.
        evaluation: Errors of the executed motion; None without a simulation.
        expected: Errors to expect of the robot, if its servo was identified from logs.
        executed_clearance: Clearance of the arm from itself and its cell, as executed.
        experiment: Result on rigid bodies, if the run has an experiment that did not fail.
        failure: The error of a failed experiment.
        advice: Suggested changes; None if they were not computed.
    """

    set_points: SetPoints
    servo: ServoModel | None = None
    execution: Execution | None = None
    evaluation: Evaluation | None = None
    expected: ExpectedErrors | None = None
    executed_clearance: Clearance | None = None
    experiment: ExperimentResult | None = None
    failure: ExecutionError | None = None
    advice: Advice | None = None

    def to_data(self) -> Data:
        """Verdict on the run, its values, tables, notes and warnings."""
        return run_data(self)

    __repr__ = short_repr

    figure = draw

    @property
    def kept(self) -> bool | None:
        """True if the tool deviates from the drawing by no more than allowed, without collision.

        If several executions judge the run, the worse one counts.
        None without a simulation, and without an accuracy and a tolerance.
        """
        satisfied: bool | None = next(self.verdict).value
        return satisfied

    @property
    def verdict(self) -> Iterator[Row]:
        """Rows of the verdict and of the deviation from the drawing."""
        errors = {name: [x.max for x in e.contours] for name, e in self.evaluations.items()}
        if self.expected is not None:
            errors[EXPECTED] = [*self.expected.contours]
        yield from verdict_rows(self, errors or None, self._failure)

    @property
    def _failure(self) -> str:
        """Reason why the simulation was not completed; empty if it was completed."""
        return "" if self.failure is None else "the simulated robot does not complete the motion"

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

    def _warnings(self, executed: Clearance | None = None) -> Iterator[str | None]:
        run = self.run
        yield from super()._warnings(self.executed_clearance)
        yield from run_warnings.changed_commands(self.set_points, self.servo)
        if self.servo is not None:
            yield run_warnings.beyond_logs(self.servo, self.trajectory)
            if not isinstance(run.compensation, NoCompensation):
                yield self.servo.doubt
        if self.execution is not None and self.evaluation is not None:
            yield from run_warnings.unsettled(self.execution)
            yield from run_warnings.not_followed(run, self.execution, self.evaluation)
        if (experiment := self.experiment) is not None and experiment.uncompensated is not None:
            yield from run_warnings.worse_than_none(
                run, experiment.evaluation, experiment.uncompensated
            )

    @property
    def remarks(self) -> tuple[str, ...]:
        """Notes about plan and execution that are not warnings, with the name of the run."""
        remarks = [f"Run {self.run.name}: {x}" for x in self.path.remarks]
        remarks += [f"Run {self.run.name}: {x.sentence}" for x in self.weaves if not x.differs]
        if used := self.set_points.command_note:
            remarks.append(f"Run {self.run.name}: set-points / command limits: {used}.")
        clear = None if self._far_from_itself else self.clearance_note
        remarks += [x for x in (self.shape_note, self.stops_note, clear) if x is not None]
        if self.advice is not None and self.advice.note:
            remarks.append(f"Run {self.run.name}: {self.advice.note}")
        if self.explanation is not None and "torque" in self.explanation.kinds:
            remarks.append(
                f"Run {self.run.name}: torque limits restrict the speed. They use the masses of "
                f"{self.arm.name} (source: {self.arm.source})."
            )
        e = self.evaluation
        if e is not None and e.model_error is not None:
            along, across = (number(x, "m") for x in e.model_error)
            remarks.append(
                f"Run {self.run.name}: the contour error is {number(e.contour_error.max, 'm')}. "
                f"Errors that the servo model does not explain add at most {across} across the "
                f"path and {along} along the path."
            )
        return tuple(remarks)

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


@dataclass(frozen=True, kw_only=True, eq=False)
class JobResult:
    """A job and the results of its runs.

    Args:
        job: The job.
        runs: The results, by the names of the job's runs; without executions if the job was not
            simulated.
    """

    job: Job
    runs: Mapping[str, RunResult]

    _repr_html_ = to_html
    figure = draw

    @property
    def simulated(self) -> bool:
        """True if any run was simulated."""
        return any(x.execution is not None for x in self.runs.values())

    @cached_property
    def figures(self) -> dict[str, Data]:
        """Data of each run by name, for the terminal, the summary and reports."""
        return {name: run_data(x, self.job) for name, x in self.runs.items()}

    @checked
    def to_data(
        self, files: Sequence[str] = (), parts: Mapping[str, Data] = MappingProxyType({})
    ) -> Data:
        """Data of the job, its arm and its runs, for the summary of a result.

        Args:
            files: The files of the result, relative to its folder.
            parts: Further parts of the summary by key.
        """
        job, arm = self.job, self.job.arm
        warnings = warnings_of(self.runs.values())
        suffix = f", {count_noun(len(warnings), 'warning')}" if warnings else ""
        runs = self.figures
        return Data(
            f"Study of {job.title}{suffix}",
            (
                Row("armcontour", __version__),
                Row("job", job.name),
                Row("title", job.title),
                Row("arm.name", arm.name),
                Row("arm.source", arm.source),
                Row("arm.joints", arm.joint_names),
                Row("arm.masses_known", arm.has_bodies),
                Row("arm.assumed", (arm.chain and arm.chain.assumed) or None),
                Row("arm.notes", arm.notes),
                Row("simulated", self.simulated),
                Row("units", units([*runs.values(), *parts.values()])),
                Row("files", list(files)),
            ),
            parts={"runs": Data("Runs", parts=runs), **parts},
            warnings=warnings,
        )

    def __str__(self) -> str:
        """Table with a row for every run."""
        data = self.to_data()
        return lay_out(data.title, compare(data.parts["runs"].parts))

    __repr__ = short_repr


def warnings_of(plans: Iterable[RunResult]) -> tuple[str, ...]:
    """Warnings of several runs with the names of the runs; equal warnings are merged."""
    messages: dict[str, list[str]] = {}
    for plan in plans:
        for sentence in plan.warnings:
            messages.setdefault(sentence, []).append(plan.run.name)
    return tuple(
        f"Run{'s' if len(names) > 1 else ''} {', '.join(names)}: {sentence}"
        for sentence, names in messages.items()
    )


def run_data(result: RunResult, job: Job | None = None) -> Data:
    """Data of a run; without values of the execution if the run was not simulated."""
    e = result.evaluation
    parts: dict[str, Data] = {}
    if result.clearance is not None:
        parts["clearance"] = _clearance(result)
    if result.executed_clearance is not None:
        data = result.executed_clearance.to_data()
        executed = (
            replace(x, label=x.label and f"{x.label}, executed", level=max(x.level, TABLE))
            for x in data.rows
        )
        parts["executed_clearance"] = replace(data, rows=tuple(executed))
    why = result.explanation
    if why is not None:
        parts["explanation"] = why.to_data()
        # The table of time shares is listed with the tables of the run.
        time, *others = parts["explanation"].tables
        parts["explanation"] = replace(parts["explanation"], tables=tuple(others))
    rows = [
        *_verdict(result),
        *(_planned(result) if e is None else _executed(result, e)),
        *torque_rows(result.torques, result.run.limits.joint_torque, result.arm, "planned"),
        *_experiment(result),
        *_set_points(result),
        *_plan(result, job),
    ]
    return Data(
        f"Run {result.run.name}",
        promoted(rows),
        (
            *([] if result.advice is None else [result.advice.table]),
            *([] if why is None else [time]),
            *_tables(result, job),
            *(() if e is None else e.to_data().tables),
        ),
        parts,
        notes=result.remarks,
        warnings=result.warnings,
    )


def promoted(rows: Iterable[Row]) -> tuple[Row, ...]:
    """Rows in a new order: rows of the verdict first, in the order of OF_VERDICT."""
    ranks = {name: k for k, name in enumerate(OF_VERDICT)}

    def rank(row: Row) -> int:
        return ranks.get(
            row.name.removeprefix(EXPERIMENT_PREFIX) if row.level <= TABLE else "", len(ranks)
        )

    ordered = sorted(rows, key=rank)
    return tuple(replace(x, level=VERDICT) if rank(x) < len(ranks) else x for x in ordered)


def judging_rows(result: RunResult, rows: Iterable[Row]) -> tuple[Row, ...]:
    """Rows of a run, with the values of the execution that is the verdict."""
    named = {x.name: x for x in rows}
    if result.judged is not result.evaluation:
        bodies = [
            x
            for x in named.values()
            if x.name.startswith(EXPERIMENT_PREFIX) and x.value is not None
        ]
        named |= {
            name: replace(x, name=name)
            for x in bodies
            if (name := x.name[len(EXPERIMENT_PREFIX) :])
        }
    return tuple(named.values())


def _verdict(result: RunResult) -> Iterator[Row]:
    """Yield rows of verdict, deviation from the drawing, longest active limit, and warnings."""
    yield from result.verdict
    if result.expected is not None and result.evaluation is not None:
        yield result.expected.row(result.evaluation.contour_error.max)
    yield from time_limit_row(result)
    yield from warning_rows(result.warnings)


def _executed(result: RunResult, evaluation: Evaluation) -> Iterator[Row]:
    """Yield rows of the execution with the servo model."""
    for row in evaluation.to_data().rows:
        yield row if row.name == "limit_ratios" else _shown(result, row, SERVO)
    yield from angular_rows(result.motion)
    yield Row("unsettled", result.motion.unsettled, "rad")


def _planned(result: RunResult) -> Iterator[Row]:
    """Yield rows of a plan that was not simulated."""
    yield duration_row(result.trajectory.duration)
    if result.trajectory.arm is not None:
        yield Row("speed", result.motion.tool_speed.max(), "m/s", "tool speed, largest")


def _clearance(result: RunResult) -> Data:
    """Data of the planned clearance, with the notes on avoided collisions."""
    assert result.clearance is not None
    data = result.clearance.to_data()
    rows = (replace(x, level=VERDICT) if x.name == "low" else x for x in data.rows)
    return replace(data, rows=(*rows, Row("avoided", result.avoided)))


def _shown(result: RunResult, row: Row, execution: str) -> Row:
    """Row of an execution, which is a main result only if this execution is the verdict."""
    if result.judged is result.evaluations[execution]:
        return row
    if row.label and row.name.startswith(SHOWN_OF_OTHERS):
        return replace(row, label=OTHERS_LABELS[execution] + row.label, level=TABLE)
    return replace(row, level=FILE)


def _experiment(result: RunResult) -> Iterator[Row]:
    """Yield rows of the rigid-body simulation."""
    if result.failure is not None:
        label = f"{OTHERS_LABELS[BODIES]}failed"
        yield Row("experiment.failed", str(result.failure), "", label, level=FIRST)
    experiment = result.experiment
    if experiment is None:
        return
    data = experiment.evaluation.to_data()
    rows = [*plant_rows(experiment.plant), *data.rows, *angular_rows(experiment.execution)]
    limit = result.run.limits.joint_torque
    rows += torque_rows(applied_torques(experiment.execution), limit, result.arm, "applied")
    for row in rows:
        yield replace(_shown(result, row, BODIES), name=f"{EXPERIMENT_PREFIX}{row.name}")
    (cornering,) = data.tables
    yield Row("experiment.cornering", cornering.as_dicts())


def _tables(result: RunResult, job: Job | None) -> Iterator[Table]:
    """Yield tables of stretches (intervals of a speed rule), corners, weaves, moves and events."""
    trajectory, path = result.trajectory, result.path
    yield Table(
        "stretches",
        columns(name="", kind="", t="s", s="m", demand="", speed="m/s"),
        [(x.name, x.kind, x.t, x.s, x.demand, x.speed) for x in trajectory.stretches],
    )
    if isinstance(path.single_path, RoundedPath):
        yield corner_table(path.single_path)
    if result.weaves:
        yield Table(
            "weaves",
            columns(contour="", width="m", frequency="Hz", left_out="1"),
            [(x.contour, x.width, x.frequency, x.left_out) for x in result.weaves],
        )
    if path.single_path is None:
        starts = resume_intervals(0.0 if job is None else job.process.resume_at, result.objective)
        errors = () if result.judged is None else result.judged.contours
        yield move_table(trajectory, path, starts, errors)
        yield Table(
            "events",
            columns(name="", value="", t="s", due="s", s="m", point="m"),
            [(x.name, x.value, x.t, x.due, x.s, x.point) for x in trajectory.events],
        )


def _set_points(result: RunResult) -> Iterator[Row]:
    """Yield rows of set-points and of command limits with their effect on the error."""
    set_points = result.set_points
    if result.servo is None and result.execution is None:
        # Set-points are not reported, because joints without a servo follow the plan exactly.
        return
    every = f"every {number(set_points.cycle, 's')}"
    yield Row("set_points", len(set_points.q), "", "set-points", every)
    yield Row("truncated", set_points.truncated, "rad")
    if set_points.command_limits is None:
        return
    cost, use = set_points.limit_cost, set_points.command_use
    name = max(use, key=lambda x: use[x].max())
    joint = result.arm.joint_names[int(use[name].argmax())]
    note = f"{joint}, {name.replace('_', ' ')}; " + (
        "no set-point is changed" if cost is None else f"changed by {cost}"
    )
    yield Row("command_use", use, "1")
    yield Row("command_ratio", use[name].max(), "1", "set-points of the command limit", note)
    yield Row("set_point_change", 0.0 if cost is None else cost.deviation, "rad")
    yield Row("limit_contour_rms", 0.0 if cost is None else cost.contour_rms, "m")
    yield Row("limit_contour_max", 0.0 if cost is None else cost.contour_max, "m")


def _plan(result: RunResult, job: Job | None) -> Iterator[Row]:
    """Yield rows of path, methods, stops and shaping of a plan."""
    run, trajectory, path = result.run, result.trajectory, result.path
    yield Row("length", path.length, "m", "path")
    if path.single_path is None:
        yield from program_rows(trajectory, path, result.objective)
    if result.rounding_error is not None:
        yield Row("corner_error", result.rounding_error, "m")
    yield Row("timing", run.timing.method, "", "timing")
    yield Row("compensation", run.compensation.method, "", "compensation")
    yield Row("cycle", run.cycle, "s")
    yield Row("reserve", run.timing.reserve, "1")
    yield Row("continuity", run.continuity)
    if trajectory.arm is not None:
        names = arm_of(trajectory).joint_names
        yield Row("start", dict(zip(names, trajectory(0.0), strict=True)), "rad")
    yield Row("switching_points", trajectory.switching_points, "s")
    stops = result.full_stops
    yield Row("full_stops.count", sum(stops.values()))
    yield Row("full_stops.reasons", stops)
    single = path.single_path
    if job is not None and job.process.analog_names:
        yield Row("analog", job.process.analog_names)
    if job is not None and job.export.outputs:
        yield Row("outputs", dict(job.export.outputs))
    yield Row("merged_points", () if single is None else single.merged)
    shaped = result.shaped
    if shaped is None:
        return
    yield Row("shaping.starts", shaped.starts)
    yield Row("shaping.durations", shaped.durations, "s")
    yield Row("shaping.gain", shaped.gain, "1", "saved by shaping", str(shaped))
    yield Row("shaping.iterations", shaped.iterations)


def unknown_notes(study: JobResult) -> tuple[str, ...]:
    """Notes about properties of simulated robots that plan and controller do not model."""
    notes: dict[str, list[str]] = {}
    for name, result in study.runs.items():
        if result.run.experiment is not None and (unknown := result.run.experiment.unknown):
            notes.setdefault(unknown, []).append(name)
    return tuple(
        f"The simulated robot of {', '.join(names)} has properties unknown to plan and controller: "
        f"{unknown}."
        for unknown, names in notes.items()
    )
