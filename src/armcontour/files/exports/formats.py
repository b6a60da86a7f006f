"""Export formats: a class with the options of each format."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass, fields, replace
from pathlib import Path as FilePath
from pathlib import PurePath
from typing import TYPE_CHECKING, Annotated, Any, ClassVar

import numpy as np

from armcontour.core import file_access
from armcontour.core.checks import FloatArray
from armcontour.core.errors import FileError, InvalidInput, error_context
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.quantities import AtLeast
from armcontour.core.text import show
from armcontour.files.exports.export_table import (
    SetPointTable,
    write_csv,
)
from armcontour.files.exports.ros import (
    GoalTolerances,
    predict_tolerances,
    select_points,
    write_ros_yaml,
)
from armcontour.files.exports.template import (
    BUILT_IN,
    ENDING,
    PROGRAMS,
    RobotProgram,
    ending_of_template,
    program_warnings,
    template_keeps_times,
    write_template,
)
from armcontour.files.exports.urscript import JOINTS, write_urscript
from armcontour.jobs.job import Exports, PointTolerance
from armcontour.motion import Execution, Servoj, SetPoints, Trajectory
from armcontour.motion.set_point_rule import ACCELERATION
from armcontour.motion.trajectory import COMMAND_SLACK
from armcontour.robot import Arm

if TYPE_CHECKING:
    from armcontour.jobs import RunResult

Analog = Mapping[str, Callable[[FloatArray], FloatArray]]
Derivatives = Annotated[int, AtLeast(0, 2)]
# Programs for robots of Universal Robots.
URSCRIPT = RobotProgram(
    output=0,
    input=0,
    analog="AO0",
    substitute="messages (textmsg)",
    advice="stream the set-points over RTDE (--export csv)",
)


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFormat(Checked):
    """Format of an export.

    Args:
        name: Name of the program inside the file; by default the name of the file. The template
            kuka always uses the name of the file.
    """

    # True if the controller executes each point at its time; false if it plans the motion between
    # the points itself, so that it gets the plan only. Every format states it: there is no default.
    keeps_times: ClassVar[bool]
    # Name of the format
    kind: ClassVar[str] = ""
    # Extension of its files
    ending: ClassVar[str] = ""
    # Required number of joints; None if every number is allowed
    joints: ClassVar[int | None] = None
    # True if the points of a plan need the cycle of the run, whatever cycle is requested
    needs_cycle_of_run: ClassVar[bool] = False
    # True if one file of a run contains set-points, plan and simulation
    has_all_motions: ClassVar[bool] = False
    name: str | None = None

    def __init_subclass__(cls, **options: Any) -> None:
        """Refuse a format that does not state whether its controller keeps the times."""
        super(ExportFormat, cls).__init_subclass__(**options)
        if not hasattr(cls, "keeps_times"):
            raise TypeError(f"{cls.__name__} must set keeps_times.")

    @property
    def label(self) -> str:
        """Name of the format or of its template, for messages."""
        return self.kind

    @property
    def program(self) -> RobotProgram | None:
        """The kind of robot program; None for a table."""
        return None

    @property
    def writes_analog(self) -> bool:
        """True if files contain analog outputs."""
        return hasattr(self, "analog")

    @checked
    def check(self, table: SetPointTable) -> None:
        """Check that the format can express the waits of a table.

        Args:
            table: The table of the file.

        Raises:
            InvalidInput: The format does not wait for inputs, or an input has no name.
        """
        if not table.waits:
            return
        first = table.waits[0].input
        if not hasattr(self, "inputs"):
            kinds = [x for x, kind in FORMATS.items() if "inputs" in _options_of(kind)]
            raise InvalidInput(
                f"The format {self.label} cannot wait for an input, but {table.name!r} waits for "
                f"{first} (process.wait). Choose {', '.join((*kinds, *BUILT_IN))}, or a template."
            )
        for wait in table.waits:
            if wait.input not in inputs_of(self):
                example = 3 if self.program is None else self.program.input
                raise InvalidInput(
                    f"{table.name!r} waits for {wait.input} (process.wait), but no input of the "
                    f"robot is named. Name it, such as inputs: {{{wait.input}: {example}}}."
                )

    @checked
    def describe(self, table: SetPointTable) -> list[str]:
        """Return warnings about a file: outputs that are missing, and too many points.

        Args:
            table: The table of the file.
        """
        sentences = list[str]()
        if self.program is not None:
            sentences += program_warnings(table, self.program, outputs_of(self))
        if table.analog and not self.writes_analog:
            names = ", ".join(table.analog)
            sentences.append(f"the format does not support analog outputs ({names}).")
        return sentences

    def with_motions(
        self, plan: Trajectory, arm: Arm | None, execution: Execution | None = None
    ) -> ExportFormat:
        """Return the format with the motions of a run, if it writes them.

        Args:
            plan: The plan of the set-points.
            arm: The arm; None if it is unknown.
            execution: The simulated motion; None without one.
        """
        return self

    def of_run(
        self, options: Exports, result: RunResult, data: SetPoints | Trajectory, arm: Arm
    ) -> ExportFormat:
        """Return the format with what it takes from a run.

        Args:
            options: The exports of the job.
            result: The run.
            data: What is exported.
            arm: The arm.
        """
        return self.with_motions(result.trajectory, arm, result.execution)

    @checked
    def select(self, table: SetPointTable) -> SetPointTable:
        """Table of the points that are written: all, or fewer for ros-yaml with `points`.

        Args:
            table: The table of all points.
        """
        return table

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a path directly, without a temporary file.

        Args:
            table: The table.
            file: The path.
        """
        raise NotImplementedError


@declared()
class CsvFormat(ExportFormat):
    """Table as CSV text (.csv).

    Args:
        derivatives: Highest derivative of the joint positions that is written: 2, 1 or 0; by
            default 2, and 0 for set-points with command limits.
        analog: Analog outputs by their names: functions from times of the plan [s], (n,), to
            values, as `armcontour.jobs.analog_outputs` gives them.
    """

    keeps_times: ClassVar[bool] = True
    kind: ClassVar[str] = "csv"
    ending: ClassVar[str] = ".csv"
    derivatives: Derivatives | None = None
    analog: Analog | None = None

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_csv(table, file)


@declared()
class RosYamlFormat(ExportFormat):
    """A trajectory_msgs/msg/JointTrajectory of ROS 2 as YAML text (.yaml).

    Args:
        derivatives: As in CsvFormat. A ROS controller then interpolates by quintics, cubics or
            lines.
        tolerances: Tolerances; with them, the file is a goal of the action
            control_msgs/action/FollowJointTrajectory. See `predict_tolerances`.
        points: Largest number of points; by default all points are written.
        point_tolerance: Largest difference that fewer points cause between the interpolation of the
            controller and that of all points, at any joint [rad]; required with `points`.
    """

    keeps_times: ClassVar[bool] = True
    kind: ClassVar[str] = "ros-yaml"
    ending: ClassVar[str] = ".yaml"
    derivatives: Derivatives | None = None
    tolerances: GoalTolerances | None = None
    points: Annotated[int, AtLeast(2)] | None = None
    point_tolerance: PointTolerance | None = None

    def of_run(
        self, options: Exports, result: RunResult, data: SetPoints | Trajectory, arm: Arm
    ) -> RosYamlFormat:
        """Return the format with tolerances of a run's execution, if they are requested.

        Args:
            options: The exports of the job.
            result: The run.
            data: What is exported.
            arm: The arm.
        """
        if isinstance(data, Trajectory) or not options.tolerances or result.execution is None:
            return self
        return replace(self, tolerances=predict_tolerances(result.execution, options.tolerances))

    @checked
    def describe(self, table: SetPointTable) -> list[str]:
        """Also warn if accelerations exceed the limit of the set-points."""
        return [*self._acceleration_warnings(table), *ExportFormat.describe(self, table)]

    def _acceleration_warnings(self, table: SetPointTable) -> list[str]:
        """Warn if the derivatives of the points exceed the limit of the set-points."""
        if table.ddq is None or table.rule is None:
            return []
        low, high = table.rule.bounds[ACCELERATION]
        ratio = np.maximum(table.ddq / low, table.ddq / high).max(axis=0)
        joint = int(np.argmax(ratio))
        if ratio[joint] < 1 + COMMAND_SLACK:
            return []
        return [
            "a controller that follows the exported accelerations requires up to "
            f"{ratio[joint]:.3g} times the acceleration limit of {table.joint_names[joint]}. "
            "Export without derivatives."
        ]

    @checked
    def select(self, table: SetPointTable) -> SetPointTable:
        """Return the table of the points that are written.

        Args:
            table: The table of all points.

        Raises:
            InvalidInput: More points are necessary for the tolerance.
        """
        if self.points is None or self.point_tolerance is None:
            return table
        return select_points(table, self.points, self.point_tolerance)

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_ros_yaml(self.select(table), file, tolerances=self.tolerances)


@declared()
class URScriptFormat(ExportFormat):
    """Program for robots of Universal Robots (.script).

    Args:
        outputs: Number of the digital output of each event, 0 to 7, by the event's name; of an
            analog output 0, 1, "AO0" or "AO1".
        inputs: Number of the digital input of each wait, 0 to 7, by the name of the input.
        analog: Analog outputs, as in CsvFormat; the program sets the outputs that `outputs` names.
        call: Whether a call of the program follows it, for a script file that a program of the
            pendant includes. A program that is sent to the controller needs no call.
        servoj: Arguments of `servoj`.
    """

    keeps_times: ClassVar[bool] = True
    kind: ClassVar[str] = "urscript"
    ending: ClassVar[str] = ".script"
    joints: ClassVar[int | None] = JOINTS
    needs_cycle_of_run: ClassVar[bool] = True
    outputs: Mapping[str, int | str] | None = None
    inputs: Mapping[str, int | str] | None = None
    analog: Analog | None = None
    call: bool = False
    servoj: Servoj = Servoj()

    @property
    def program(self) -> RobotProgram:
        """The kind of robot program."""
        return URSCRIPT

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_urscript(
            table, file, outputs_of(self), inputs_of(self), call=self.call, servoj=self.servoj
        )


@declared()
class TemplateFormat(ExportFormat):
    """Robot program that a jinja2 template generates.

    Args:
        template: "kuka", "abb", or the path of a jinja2 file.
        outputs: The output of each event, and of each analog output, by its name.
        inputs: The input of each wait, by its name.
        derivatives, analog: As in CsvFormat.
    """

    kind: ClassVar[str] = "template"
    joints: ClassVar[int | None] = JOINTS
    template: str | FilePath
    outputs: Mapping[str, int | str] | None = None
    inputs: Mapping[str, int | str] | None = None
    derivatives: Derivatives | None = None
    analog: Analog | None = None

    @property
    def label(self) -> str:
        """Name of the template."""
        return str(self.template)

    @property
    def keeps_times(self) -> bool:  # type: ignore[override]  # the template states it
        """True if the template states that the controller executes each point at its time."""
        return template_keeps_times(self.template)

    @property
    def program(self) -> RobotProgram | None:
        """The kind of robot program; None for a template of the user."""
        return PROGRAMS.get(self.label)

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_template(table, file, self.template, outputs_of(self), inputs_of(self))


@declared()
class McapFormat(ExportFormat):
    """A bag of ROS 2 (.mcap) with joint states, tool poses, paths and TF, for viewers and as a log.

    Args:
        derivatives: As in CsvFormat; only positions and velocities are written.
        arm: The arm, for poses of the tool and for TF; by default that of `export` or of the plan.
        plan: The planned motion; by default that of the exported set-points.
        execution: The simulated motion; by default it is not written.
    """

    keeps_times: ClassVar[bool] = True
    kind: ClassVar[str] = "mcap"
    ending: ClassVar[str] = ".mcap"
    has_all_motions: ClassVar[bool] = True
    derivatives: Derivatives | None = None
    arm: Arm | None = None
    plan: Trajectory | None = None
    execution: Execution | None = None

    def with_motions(
        self, plan: Trajectory, arm: Arm | None, execution: Execution | None = None
    ) -> McapFormat:
        """Return the format with the motions of a run; those that it has are kept."""
        return replace(
            self,
            arm=self.arm or arm or plan.arm,
            plan=self.plan or plan,
            execution=self.execution or execution,
        )

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        # The kinematics of tool poses load slowly, and other formats do not need them.
        from armcontour.files.exports.mcap import write_mcap

        write_mcap(table, file, arm=self.arm, plan=self.plan, execution=self.execution)


# Formats by name. Further formats are the templates of the package, `BUILT_IN`.
FORMATS: dict[str, type[ExportFormat]] = {
    x.kind: x for x in (CsvFormat, RosYamlFormat, URScriptFormat, McapFormat)
}
# Extensions of files by the name of the format.
ENDINGS: dict[str, str] = {name: x.ending for name, x in FORMATS.items()}
ENDINGS |= {name: ending_of_template(file) for name, file in BUILT_IN.items()}
# Options of formats that `export` of a job determines from its values, instead of copying them.
CONVERTED = {"outputs", "inputs", "tolerances"}
# Keys of a job's `export` that are valid only if one of its formats has an option of this name.
NEEDS_FORMAT = ("tolerances", "points", "call")


def ending_of(format: str) -> str:
    """Return the extension of a format's or template's file: ".src" for "house.src.j2"."""
    if format in ENDINGS:
        return ENDINGS[format]
    if not format.endswith(ENDING):
        raise InvalidInput(
            f"There is no format {show(format)}. The formats are {', '.join(ENDINGS)}, and "
            f"templates of your own, such as house{ENDING}."
        )
    return ending_of_template(format)


def format_named(name: str, options: Exports | None = None) -> ExportFormat:
    """Return the format with a name, or of a template.

    It has those options of `options` that it supports.
    """
    ending_of(name)
    format = FORMATS[name]() if name in FORMATS else TemplateFormat(template=name)
    if options is None:
        return format
    supported = _options_of(type(format)) & _options_of(Exports) - CONVERTED
    values = {x: getattr(options, x) for x in supported}
    if hasattr(format, "outputs"):
        values["outputs"] = options.outputs_for(name)
    if hasattr(format, "inputs"):
        values["inputs"] = options.inputs_for(name)
    return replace(format, **values)


def program_formats(exports: Exports) -> tuple[str, ...]:
    """Return the formats of a job's exports whose controllers plan the motion between the points.

    Raises:
        InvalidInput: A template cannot be read, or does not state `keeps_times`.
    """
    return tuple(x for x in exports.formats if not format_named(x).keeps_times)


def _options_of(kind: type[ExportFormat | Exports]) -> set[str]:
    """Return the names of the options of a format, or of the keys of `export`."""
    return {x.name for x in fields(kind)}


def format_of(file: FilePath) -> str:
    """Return the name of the format with the extension of a file."""
    for name, ending in ENDINGS.items():
        if file.suffix.lower() == ending:
            return name
    listed = ", ".join(f"{name} ({ending})" for name, ending in ENDINGS.items())
    raise InvalidInput(
        f"The extension of {file.name or file} does not belong to a format. Specify one of the "
        f"formats {listed}, or a template."
    )


def check_formats(exports: Exports) -> None:
    """Check the formats of a job's exports, and the values that need one of them.

    Raises:
        InvalidInput: A format does not exist, two formats have one file, or a value needs another
            format.
    """
    format_of_ending: dict[str, str] = {}
    for name in exports.formats:
        other = format_of_ending.setdefault(ending_of(name), name)
        if other is not name:
            raise InvalidInput(
                f"The formats {other} and {name} are written to the same file. Remove one of "
                "them, or use a template with another extension, such as cell.txt.j2."
            )
    for key in NEEDS_FORMAT if exports.formats else ():
        supporting = [name for name, kind in FORMATS.items() if key in _options_of(kind)]
        if getattr(exports, key) and not set(supporting) & set(exports.formats):
            names = " or ".join(supporting)
            raise InvalidInput(
                f"{key} requires the format {names}. Remove {key}, or export {names}."
            )
    for kind, signals in (("outputs", exports.outputs), ("inputs", exports.inputs)):
        for name, signal in signals.items():
            if isinstance(signal, Mapping):
                _check_formats_of(kind, name, signal)


def _check_formats_of(kind: str, name: str, signals: Mapping[str, int | str]) -> None:
    """Check the outputs of an event, or the inputs of a wait, by format.

    - `kind`: "outputs" or "inputs".
    """
    without_signals = [x for x, format in FORMATS.items() if kind not in _options_of(format)]
    for format, signal in signals.items():
        key = f"{kind}.{name}.{format}"
        with error_context(f"{kind}.{name}"):
            ending_of(format)
        if format in without_signals or PurePath(format).name != format:
            formats_with_signals = ", ".join(x for x in ENDINGS if x not in without_signals)
            raise InvalidInput(
                f"{key} has no effect, because {kind} are of {formats_with_signals}, and "
                f"templates, which are named without a folder, such as house{ENDING}."
            )
        if isinstance(signal, bool) or not isinstance(signal, int | str):
            raise InvalidInput(f"{key} must be a number or a text, but is {show(signal)}.")


def outputs_of(format: ExportFormat) -> Mapping[str, int | str]:
    """Return the outputs of events by their names; empty for formats without outputs."""
    return getattr(format, "outputs", None) or {}


def inputs_of(format: ExportFormat) -> Mapping[str, int | str]:
    """Return the inputs of waits by their names; empty for formats without inputs."""
    return getattr(format, "inputs", None) or {}


def names_of(table: SetPointTable) -> set[str]:
    """Return the names of the events and analog outputs of a table."""
    return {*(x.name for x in table.events), *table.analog}


def check_outputs(
    outputs: Iterable[str], events: Iterable[str], *, option: str, owner: str
) -> None:
    """Check that outputs belong to existing events or analog outputs.

    Args:
        outputs: Names of the events and analog outputs that have an output.
        events: Names of the existing events and analog outputs.
        option: Option or key that has the outputs, for messages.
        owner: What has the events, such as "the run fast", for messages.

    Raises:
        InvalidInput: An output belongs to no event and no analog output.
    """
    names = sorted(set(events))
    for name in outputs:
        if name not in names:
            has = f"switches only {', '.join(names)}" if names else "switches no output"
            raise InvalidInput(f"{option} names {name!r}, but {owner} {has}.")


def table_inputs(table: SetPointTable) -> set[str]:
    """Return the names of the inputs for which the program of a table waits."""
    return {x.input for x in table.waits}


def check_inputs(inputs: Iterable[str], known: Iterable[str], *, option: str, owner: str) -> None:
    """Check that inputs belong to existing waits; arguments as in `check_outputs`.

    Raises:
        InvalidInput: An input belongs to no wait.
    """
    names = sorted(set(known))
    for name in inputs:
        if name not in names:
            has = f"waits only for {', '.join(names)}" if names else "waits for no input"
            raise InvalidInput(f"{option} names {name!r}, but {owner} {has}.")


def write_destination(file: FilePath, write: Callable[[FilePath], None]) -> None:
    """Write a file atomically; if writing fails, an existing file is unchanged."""
    if not file.name or "\0" in str(file):
        raise FileError(f"Cannot write {str(file)!r}, because it is not a valid file name.")
    if file.is_dir():
        raise FileError(f"Cannot write {file}, because a folder has this name.")
    file_access.write_atomically(file, write)
