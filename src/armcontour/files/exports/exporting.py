"""The way from a motion to a robot's file, which Python, the commands and the Studio share."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path as FilePath

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.quantities import Distance, joint_units
from armcontour.core.render import number
from armcontour.core.text import capitalise
from armcontour.files.exports.export_table import (
    REFERENCE,
    SetPointTable,
    equals_plan,
    make_table,
)
from armcontour.files.exports.formats import (
    ExportFormat,
    check_inputs,
    check_outputs,
    format_named,
    format_of,
    inputs_of,
    names_of,
    outputs_of,
    table_inputs,
    write_destination,
)
from armcontour.jobs import Job, RunResult, analog_outputs
from armcontour.jobs.program_points import choose_points
from armcontour.motion import DEFAULT_CYCLE, SetPoints, Trajectory
from armcontour.motion.controller_facts import facts_of_format
from armcontour.motion.set_point_rule import SetPointExcess, SetPointRule
from armcontour.robot import Arm
from armcontour.robot.limits import LIMITS
from armcontour.verification.between_points import BetweenPoints, measure_between_points

# Label of exported set-points; that of the exported plan is REFERENCE.
SET_POINTS = "set_points"
# Label of a file with all motions of a run.
MOTIONS = "motions"


@dataclass(frozen=True, slots=True)
class ExportFile:
    """A table that its format can express, and warnings about its file."""

    format: ExportFormat
    table: SetPointTable
    warnings: list[str]

    def write(self, file: FilePath) -> None:
        """Write a file atomically; if writing fails, an existing file is unchanged."""
        write_destination(file, self.write_directly)

    def write_directly(self, file: FilePath) -> None:
        """Write a file without a temporary one."""
        self.format.write(self.table, file)


@dataclass(frozen=True, slots=True)
class Exporter:
    """Exports in one format. Nothing is written before everything is checked."""

    format: ExportFormat

    def motions(self, result: RunResult) -> list[tuple[str, SetPoints | Trajectory]]:
        """Return the motions of a run that the format can express, with their labels."""
        if self.format.has_all_motions:
            return [(MOTIONS, result.set_points)]
        plan = (REFERENCE, result.trajectory)
        return [plan, (SET_POINTS, result.set_points)] if self.format.keeps_times else [plan]

    def prepare_run(
        self,
        job: Job,
        result: RunResult,
        label: str,
        data: SetPoints | Trajectory,
        *,
        cycle: float | None = None,
        origin: str = "",
    ) -> ExportFile:
        """Prepare a motion of a run.

        - `label`: Last word of the program's name.
        - `cycle`: Cycle of a plan [s], by default that of the job's exports.
        """
        format = self.format.of_run(job.export, result, data, job.arm)
        between = None
        if isinstance(data, Trajectory):
            requested = None if format.needs_cycle_of_run else job.export.cycle
            if not format.keeps_times and result.program is not None:
                between = result.program.between
                requested = between.interval
            cycle = cycle or requested or result.run.cycle
        return Exporter(format).prepare_motion(
            data,
            name=f"{job.name} {result.run.name} {label}",
            origin=origin,
            cycle=cycle,
            arm=job.arm,
            derivatives=job.export.derivatives,
            analog=analog_outputs(result.path, result.trajectory, job.process, result.run.limits),
            between=between,
        )

    def prepare_motion(
        self,
        data: SetPoints | Trajectory,
        *,
        name: str,
        arm: Arm | None = None,
        joint_names: Sequence[str] | None = None,
        cycle: float | None = None,
        derivatives: int | None = None,
        analog: Mapping[str, Callable[[FloatArray], FloatArray]] | None = None,
        origin: str = "",
        tolerance: float | None = None,
        between: BetweenPoints | None = None,
    ) -> ExportFile:
        """Prepare a motion; arguments as in `make_table` and `export`.

        - `between`: what `measure_between_points` returns for the plan and an interval, if known.
        """
        if isinstance(data, SetPoints):
            self.check_compensation(name, equals_plan(data.q, data.trajectory.with_rests(data.t)))
        if between is None or between.interval != cycle:
            between = self._measure_between(data, cycle, tolerance)
        if between is not None and isinstance(data, Trajectory):
            cycle = between.interval
        table = make_table(
            data,
            name=name,
            arm=arm,
            joint_names=joint_names,
            cycle=cycle,
            derivatives=derivatives,
            analog=analog,
            origin=origin,
        )
        if between is not None:
            table = replace(table, between=str(between))
        return self.prepare_table(table, repr(name))

    def _measure_between(
        self, data: SetPoints | Trajectory, cycle: float | None, tolerance: float | None
    ) -> BetweenPoints | None:
        """Measure how far the controller may leave the path between the points of a program.

        None for a controller that executes each point at its time, and without an arm.
        """
        if self.format.keeps_times:
            if tolerance is not None:
                raise InvalidInput(
                    f"tolerance has no effect, because a controller of the format "
                    f"{self.format.label} executes each point at its time. Remove tolerance."
                )
            return None
        plan = data.trajectory if isinstance(data, SetPoints) else data
        if plan.arm is None:
            if tolerance is not None:
                raise InvalidInput("tolerance requires a plan that contains its arm.")
            return None
        if isinstance(data, SetPoints):
            cycle = data.cycle
        if tolerance is None:
            return measure_between_points(plan, cycle or DEFAULT_CYCLE)
        chosen = choose_points(plan, tolerance)
        between = chosen if cycle is None else measure_between_points(plan, cycle)
        if between.largest <= tolerance:
            return between
        remedy = f"Specify a tolerance above {number(between.largest, 'm')}."
        if chosen.largest <= tolerance:
            remedy = f"Specify a cycle of {number(chosen.interval, 's')}, or none."
            if isinstance(data, SetPoints):
                remedy = "Export the plan without a cycle, such as set_points.trajectory."
        raise InvalidInput(
            f"With points every {number(between.interval, 's')}, the tolerance of "
            f"{number(tolerance, 'm')} is exceeded: {between}. {remedy}",
            needed=between.largest,
            allowed=tolerance,
        )

    def prepare_table(
        self, table: SetPointTable, owner: str, known: Iterable[str] = ()
    ) -> ExportFile:
        """Prepare a table. If the controller plans the motion, it must be that of a plan.

        - `owner`: What has the events, for messages.
        - `known`: Names of further outputs, whose values the table does not have.
        """
        format = self.format
        excess_warnings = self._judge(table)
        check_outputs(outputs_of(format), {*names_of(table), *known}, option="outputs", owner=owner)
        check_inputs(inputs_of(format), table_inputs(table), option="inputs", owner=owner)
        format.check(table)
        table = format.select(table)
        return ExportFile(format, table, [*excess_warnings, *format.describe(table)])

    def _judge(self, table: SetPointTable) -> list[str]:
        """Return warnings about set-points beyond assumed limits; refuse those beyond stated ones.

        Set-points that were computed for other controllers are judged by the controller of the
        format, too.
        """
        if table.rule is None or not self.format.keeps_times:
            return []
        rule = table.rule
        controller = facts_of_format(self.format.label)
        if controller is not None:
            rule = rule.of_controller(controller)
        excesses = rule.judge(table.q, table.cycle).excesses
        if not excesses:
            return []
        exceeded_before = {x.limit for x in table.rule.judge(table.q, table.cycle).excesses}
        sentences = []
        for excess in excesses:
            joint = excess.joint
            unit = joint_units(LIMITS[excess.limit].unit, table.prismatic)[joint]
            found = f"the {excess.describe(table.joint_names[joint], unit)}"
            remedy = excess.remedy
            if excess.limit not in exceeded_before:
                # The limit is that of this format; set-points keep those of their own rule.
                remedy = (
                    f"Compute set-points for this format: armcontour run JOB --export "
                    f"{self.format.label}. {self._python_remedy(excess, rule, table)}"
                )
            if not excess.is_assumed:
                raise InvalidInput(
                    f"{capitalise(found)}. {remedy}",
                    joint=joint,
                    needed=excess.needed,
                    allowed=excess.allowed,
                )
            sentences.append(f"{found}. {remedy}")
        return sentences

    @staticmethod
    def _python_remedy(excess: SetPointExcess, rule: SetPointRule, table: SetPointTable) -> str:
        """Write how to compute other set-points in Python, as a sentence."""
        if rule.cycle is not None and rule.cycle < table.cycle:
            return f"In Python, compensate with the controller's cycle of {rule.cycle:g} s."
        return f"In Python, compensate with command_limits whose {excess.limit} is this limit."

    def check_compensation(self, name: str, is_plan: bool) -> None:
        """Refuse set-points that differ from the plan if the controller plans the motion itself."""
        if not self.format.keeps_times and not is_plan:
            raise InvalidInput(
                f"A program of the format {self.format.label} states points, and its controller "
                f"plans the motion between them, but {name!r} has compensated or learned "
                "set-points, which are no points of the path. Export the plan, such as "
                "ac.export(set_points.trajectory, ...)."
            )


@checked
def export(
    data: SetPoints | Trajectory,
    file: str | FilePath,
    format: ExportFormat | str | None = None,
    *,
    arm: Arm | None = None,
    joint_names: Sequence[str] | None = None,
    cycle: float | None = None,
    tolerance: Distance | None = None,
) -> None:
    """Write set-points or a trajectory to a file.

    Times of points and events count from the first set-point. An existing file is replaced. If
    writing fails, the existing file is unchanged.

    >>> ac.export(set_points, "set_points.csv")
    >>> ac.export(planned, "plan.csv", arm=arm, cycle=0.01)

    Args:
        data: Set-points, or a trajectory for a controller that needs no compensation.
        file: The destination.
        format: The format by its name, such as "urscript", or with its options, such as
            URScriptFormat(outputs={"tool": 0}); by default that of the file's extension.
        arm: The arm, which gives the joint names.
        joint_names: Joint names instead of the arm's; "joint 1", "joint 2", ... without an arm.
        cycle: Sampling cycle of a trajectory [s], 4 ms by default; set-points have their own.
        tolerance: For a controller that plans the motion between the points, as with kuka and abb:
            largest distance between the path and the motion, with straight lines and with a spline
            between the points [m]. By default, `cycle` is the longest that keeps it.

    Warns:
        UserWarning: A URScript program, or a program of the template kuka or abb, does not switch
            an event or set an analog output, because no output is named; a program has more than
            10,000 points; or set-points exceed an assumed limit.

    Raises:
        InvalidInput: No format has the extension, an output belongs to an unknown event, the format
            does not wait for inputs or an input is not named, the template has an error, the format
            does not support the data (a controller that plans the motion itself, as with kuka and
            abb, needs the trajectory), the points are too far apart for the tolerance, set-points
            exceed a limit of the plan, the user or the controller, or the file cannot be written.
    """
    destination = FilePath(file)
    named = format_of(destination) if format is None else format
    chosen = format_named(named) if isinstance(named, str) else named
    chosen = chosen.with_motions(data.trajectory if isinstance(data, SetPoints) else data, arm)
    prepared = Exporter(chosen).prepare_motion(
        data,
        name=destination.stem if chosen.name is None else chosen.name,
        arm=arm,
        joint_names=joint_names,
        cycle=cycle,
        # Some formats have no such options.
        derivatives=getattr(chosen, "derivatives", 0),
        analog=getattr(chosen, "analog", None),
        tolerance=tolerance,
    )
    # Warnings come before writing, so that nothing is written if warnings are errors.
    for sentence in prepared.warnings:
        warnings.warn(f"Format {chosen.label}: {sentence}", stacklevel=3)
    prepared.write(destination)
