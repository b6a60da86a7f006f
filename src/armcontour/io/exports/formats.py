"""Formats of exports: a class for each, with the options that it has."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from pathlib import Path as FilePath
from typing import Annotated, ClassVar

from armcontour import _checks
from armcontour._checks import FloatArray
from armcontour._quantities import AtLeast
from armcontour.core.fields import Checked
from armcontour.errors import InvalidInput
from armcontour.io.exports.ros import write_mcap, write_ros_yaml
from armcontour.io.exports.table import Table
from armcontour.io.exports.tables import write_csv, write_npz
from armcontour.io.exports.template import write_template
from armcontour.io.exports.urscript import write_urscript

Analog = Mapping[str, Callable[[FloatArray], FloatArray]]
Derivatives = Annotated[int, AtLeast(0, 2)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFormat(Checked):
    """A format of exports.

    Args:
        name: Name of the program inside the file; by default the name of the file, which the
            template kuka always takes.
    """

    # Name of the format, and its file extension, which is empty if any is possible.
    kind: ClassVar[str] = ""
    ending: ClassVar[str] = ""
    name: str | None = None

    @property
    def label(self) -> str:
        """Name of the format, or of its template."""
        return self.kind

    def write(self, table: Table, file: FilePath) -> None:
        """Write a table directly to a path, without a temporary file.

        Args:
            table: The table.
            file: The path; of a bag a folder that does not exist yet.

        Raises:
            InvalidInput: The format cannot hold the table.
        """
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryFormat(ExportFormat):
    """A format with derivatives of the joint positions.

    Args:
        derivatives: Highest derivative that is written: 2, 1 or 0. A ROS controller then
            interpolates by quintics, cubics or lines.
    """

    derivatives: Derivatives = 2


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFormat(TrajectoryFormat):
    """A format with derivatives, the motion of the tool, and analog outputs.

    Args:
        tool_motion: Whether the file gets the tool's point, orientation (quaternion) and speed. For
            taught data they are those of the set-points.
        analog: Analog outputs by their names: functions from times of the plan [s], (n,), to
            values, as `armcontour.jobs.analog_outputs` gives them.
    """

    tool_motion: bool = False
    analog: Analog | None = None


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class CsvFormat(TableFormat):
    """A table as text (.csv), with 12 decimals."""

    kind: ClassVar[str] = "csv"
    ending: ClassVar[str] = ".csv"

    write = staticmethod(write_csv)


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class NpzFormat(TableFormat):
    """Arrays of NumPy (.npz), without pickled objects."""

    kind: ClassVar[str] = "npz"
    ending: ClassVar[str] = ".npz"

    write = staticmethod(write_npz)


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class RosYamlFormat(TrajectoryFormat):
    """A trajectory_msgs/msg/JointTrajectory of ROS 2 as text (.yaml)."""

    kind: ClassVar[str] = "ros-yaml"
    ending: ClassVar[str] = ".yaml"

    write = staticmethod(write_ros_yaml)


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class McapFormat(TrajectoryFormat):
    """The same message and the events in a bag of ROS 2 (.mcap), a folder."""

    kind: ClassVar[str] = "mcap"
    ending: ClassVar[str] = ".mcap"

    write = staticmethod(write_mcap)


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class URScriptFormat(ExportFormat):
    """A program for Universal Robots (.script).

    Args:
        outputs: Number of the digital output of each event, 0 to 7, by the event's name; of an
            analog output 0, 1, "AO0" or "AO1".
        analog: Analog outputs, as of CsvFormat; the program sets those that `outputs` names.
        call: Whether the program is followed by its call, for a script file that a program of the
            pendant includes. Programs that are sent to the controller end without.
    """

    kind: ClassVar[str] = "urscript"
    ending: ClassVar[str] = ".script"
    outputs: Mapping[str, int | str] | None = None
    analog: Analog | None = None
    call: bool = False

    def write(self, table: Table, file: FilePath) -> None:
        """Write a table to a file."""
        write_urscript(table, file, self.outputs, call=self.call)


@_checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class TemplateFormat(TableFormat):
    """A program that a jinja2 template makes.

    Args:
        template: "kuka", "abb", or the path of a jinja2 file.
        outputs: The output of each event, and of each analog output, by its name.
    """

    kind: ClassVar[str] = "template"
    template: str | FilePath
    outputs: Mapping[str, int | str] | None = None

    @property
    def label(self) -> str:
        """Name of the template."""
        return str(self.template)

    def write(self, table: Table, file: FilePath) -> None:
        """Write a table to a file."""
        write_template(table, file, self.template, self.outputs)


# The formats by their names.
FORMATS: dict[str, type[ExportFormat]] = {
    x.kind: x
    for x in (CsvFormat, NpzFormat, RosYamlFormat, McapFormat, URScriptFormat, TemplateFormat)
}
LISTED = ", ".join(f"{x} ({of.ending})" if of.ending else x for x, of in FORMATS.items())
WITH_ANALOG = (TableFormat, URScriptFormat)
WITH_OUTPUTS = (URScriptFormat, TemplateFormat)


def format_named(name: str) -> type[ExportFormat]:
    """The format of a name.

    Raises:
        InvalidInput: There is no such format.
    """
    if name not in FORMATS:
        raise InvalidInput(f"There is no format {name!r}: the formats are {LISTED}.")
    return FORMATS[name]


def format_of(file: FilePath) -> type[ExportFormat]:
    """The format of a file, by its extension.

    Raises:
        InvalidInput: No format has this extension.
    """
    by_ending = {x.ending: x for x in FORMATS.values() if x.ending}
    if file.suffix.lower() in by_ending:
        return by_ending[file.suffix.lower()]
    raise InvalidInput(
        f"The ending of {file.name or file} is not that of a format: give one of the formats "
        f"{LISTED}, or a template, such as kuka."
    )


def outputs_of(format: ExportFormat) -> Mapping[str, int | str]:
    """Outputs of events by their names; none of formats without outputs."""
    return (isinstance(format, WITH_OUTPUTS) and format.outputs) or {}
