"""Export formats: a class with the options of each format, and the function `export`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated, ClassVar

from armcontour.core import file_access
from armcontour.core.checks import FloatArray
from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.fields import Checked, checked, declared
from armcontour.core.quantities import AtLeast
from armcontour.files.exports.export_table import SetPointTable, make_table, write_csv
from armcontour.files.exports.ros import GoalTolerances, select_points, write_ros_yaml
from armcontour.files.exports.template import LAST_DIGIT, describe_program, write_template
from armcontour.files.exports.urscript import JOINTS, write_urscript
from armcontour.jobs.job import ENDINGS, Exports, PointTolerance, ending_of
from armcontour.motion import SetPoints, Trajectory
from armcontour.robot import Arm

Analog = Mapping[str, Callable[[FloatArray], FloatArray]]
Derivatives = Annotated[int, AtLeast(0, 2)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFormat(Checked):
    """Format of an export.

    Args:
        name: Name of the program inside the file; by default the name of the file. The template
            kuka always uses the name of the file.
    """

    # Name of the format
    kind: ClassVar[str] = ""
    # Required number of joints; None if every number is allowed
    joints: ClassVar[int | None] = None
    name: str | None = None

    @property
    def label(self) -> str:
        """Name of the format or of its template, for messages."""
        return self.kind

    @checked
    def describe(self, table: SetPointTable) -> list[str]:
        """Return warnings about a file: outputs that are missing, rounding, and too many points.

        Args:
            table: The table of the file.
        """
        digit = LAST_DIGIT.get(self.label)
        if isinstance(self, CsvFormat | RosYamlFormat):
            digit = 10.0**-table.decimals
        sentences = describe_program(table, self.label, outputs_of(self), digit)
        if table.analog and not isinstance(self, WITH_ANALOG):
            names = ", ".join(table.analog)
            sentences.append(f"the format does not support analog outputs ({names}).")
        return sentences

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

    kind: ClassVar[str] = "csv"
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

    kind: ClassVar[str] = "ros-yaml"
    derivatives: Derivatives | None = None
    tolerances: GoalTolerances | None = None
    points: Annotated[int, AtLeast(2)] | None = None
    point_tolerance: PointTolerance | None = None

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
        analog: Analog outputs, as in CsvFormat; the program sets the outputs that `outputs` names.
        call: Whether a call of the program follows it, for a script file that a program of the
            pendant includes. A program that is sent to the controller needs no call.
    """

    kind: ClassVar[str] = "urscript"
    joints: ClassVar[int | None] = JOINTS
    outputs: Mapping[str, int | str] | None = None
    analog: Analog | None = None
    call: bool = False

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_urscript(table, file, outputs_of(self), call=self.call)


@declared()
class TemplateFormat(ExportFormat):
    """Robot program that a jinja2 template generates.

    Args:
        template: "kuka", "abb", or the path of a jinja2 file.
        outputs: The output of each event, and of each analog output, by its name.
        derivatives, analog: As in CsvFormat.
    """

    kind: ClassVar[str] = "template"
    joints: ClassVar[int | None] = JOINTS
    template: str | FilePath
    outputs: Mapping[str, int | str] | None = None
    derivatives: Derivatives | None = None
    analog: Analog | None = None

    @property
    def label(self) -> str:
        """Name of the template."""
        return str(self.template)

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_template(table, file, self.template, outputs_of(self))


_CLASSES = {x.kind: x for x in (CsvFormat, RosYamlFormat, URScriptFormat)}
WITH_ANALOG = (CsvFormat, URScriptFormat, TemplateFormat)


def format_named(name: str, options: Exports | None = None) -> ExportFormat:
    """Format with a name, or of a template, with those options of `options` that it supports."""
    ending_of(name)
    format = _CLASSES[name]() if name in _CLASSES else TemplateFormat(template=name)
    if options is None:
        return format
    keys = ("derivatives", "points", "point_tolerance", "call")
    values = {x: getattr(options, x) for x in keys if hasattr(format, x)}
    if hasattr(format, "outputs"):
        values["outputs"] = options.outputs_for(name)
    return replace(format, **values)


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


def outputs_of(format: ExportFormat) -> Mapping[str, int | str]:
    """Return the outputs of events by their names; empty for formats without outputs."""
    return getattr(format, "outputs", None) or {}


@checked
def export(
    data: SetPoints | Trajectory,
    file: str | FilePath,
    format: ExportFormat | str | None = None,
    *,
    arm: Arm | None = None,
    joint_names: Sequence[str] | None = None,
    cycle: float | None = None,
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

    Warns:
        UserWarning: A URScript program, or a program of the template kuka or abb, does not switch
            an event or set an analog output, because no output is named; or a program has more than
            10,000 points.

    Raises:
        InvalidInput: No format has the extension, an output belongs to an unknown event, the
            template has an error, the format does not support the data, or the file cannot be
            written.
    """
    destination = FilePath(file)
    named = format_of(destination) if format is None else format
    chosen = format_named(named) if isinstance(named, str) else named
    table = make_table(
        data,
        name=destination.stem if chosen.name is None else chosen.name,
        arm=arm,
        joint_names=joint_names,
        cycle=cycle,
        # Some formats have no such options.
        derivatives=getattr(chosen, "derivatives", 0),
        analog=getattr(chosen, "analog", None),
    )
    check_outputs(outputs_of(chosen), names_of(table), option="outputs", owner=repr(table.name))
    # Warnings come before writing, so that nothing is written if warnings are errors.
    for sentence in chosen.describe(table):
        warnings.warn(f"Format {chosen.label}: {sentence}", stacklevel=3)
    write_destination(destination, partial(chosen.write, table))


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


def write_destination(file: FilePath, write: Callable[[FilePath], None]) -> None:
    """Write a file atomically; if writing fails, an existing file is unchanged."""
    if not file.name or "\0" in str(file):
        raise FileError(f"Cannot write {str(file)!r}, because it is not a valid file name.")
    if file.is_dir():
        raise FileError(f"Cannot write {file}, because a folder has this name.")
    file_access.write_atomically(file, write)
