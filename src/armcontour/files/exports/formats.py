"""Export formats: a class with the options of each format, and the function `export`."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass
from functools import partial
from pathlib import Path as FilePath
from typing import Annotated, ClassVar

from armcontour.core import checks, staging
from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import Checked, checked
from armcontour.core.quantities import AtLeast
from armcontour.files.exports.file_parts import (
    describe_parts,
    part_files,
    read_points_per_file,
    split_table,
)
from armcontour.files.exports.ros import GoalTolerances, write_mcap, write_ros_yaml
from armcontour.files.exports.table import (
    DECIMALS,
    SetPointTable,
    make_table,
    write_csv,
    write_npz,
)
from armcontour.files.exports.template import LAST_DIGIT, describe_program, write_template
from armcontour.files.exports.urscript import JOINTS, write_urscript
from armcontour.motion import SetPoints, Trajectory
from armcontour.robot import Arm

# Extensions of the files in a bag folder. A folder with other files is not overwritten.
BAG_EXTENSIONS = (".mcap", ".db3", ".yaml")
Analog = Mapping[str, Callable[[FloatArray], FloatArray]]
Derivatives = Annotated[int, AtLeast(0, 2)]
# Decimals of joint positions. Accelerations have two fewer and torques three fewer decimals. The
# minimum is 4, so that torques have at least one.
Decimals = Annotated[int, AtLeast(4, DECIMALS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFormat(Checked):
    """Format of an export.

    Args:
        name: Name of the program inside the file; by default the name of the file. The template
            kuka always uses the name of the file.
        points_per_file: Largest number of points of a file, or a controller: "motoros2" (200),
            "ur" (1000). Longer motions are divided into files part_01, part_02, ...; each starts
            with the last point of the previous file. A file ends at a point where the motion rests,
            and is longer if there is no such point. Files of csv and npz may also end in motion.
    """

    # Name of the format
    kind: ClassVar[str] = ""
    # File extension; empty if every extension is allowed
    ending: ClassVar[str] = ""
    # Required number of joints; None if every number is allowed
    joints: ClassVar[int | None] = None
    # Whether a file may end in motion, because the player continues with the next file
    in_motion: ClassVar[bool] = False
    # Whether consecutive points must be exactly one cycle apart
    regular: ClassVar[bool] = False
    name: str | None = None
    points_per_file: int | str | None = None

    def _check_together(self) -> None:
        read_points_per_file(self.points_per_file)

    @property
    def label(self) -> str:
        """Name of the format or of its template, for messages."""
        return self.kind

    @property
    def at_stops(self) -> bool:
        """True if tables need points at the stops of a trajectory, because files end there."""
        return self.points_per_file is not None and not self.regular and not self.in_motion

    @checked
    def digit_of(self, table: SetPointTable) -> float | None:
        """Value of the last digit of joint positions [rad]; None for npz, mcap and user templates.

        Args:
            table: The table.
        """
        if isinstance(self, CsvFormat | RosYamlFormat):
            return float(10.0 ** -table.decimals_of(self.decimals))
        return LAST_DIGIT.get(self.label)

    def parts(self, table: SetPointTable) -> tuple[SetPointTable, ...]:
        """Divide a table into the tables of the files.

        Args:
            table: The table of the whole motion.
        """
        most = read_points_per_file(self.points_per_file)
        return (table,) if most is None else split_table(table, most, in_motion=self.in_motion)

    @checked
    def describe(
        self, parts: Sequence[SetPointTable], name_output: Callable[[str, int | str], str]
    ) -> list[str]:
        """Warnings about files: outputs that are not set, rounding, and too many points.

        Args:
            parts: The tables of the files.
            name_output: Returns the option that sets the output of an event, for messages.
        """
        most, outputs = read_points_per_file(self.points_per_file), outputs_of(self)
        sentences = [
            describe_program(x, self.label, outputs, name_output, self.digit_of(x)) for x in parts
        ]
        every = [*describe_parts(parts, most), *(sentence for x in sentences for sentence in x)]
        return list(dict.fromkeys(every))

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a path directly, without a temporary file.

        Args:
            table: The table.
            file: The path; for a bag, a folder that does not exist.
        """
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryFormat(ExportFormat):
    """Format with derivatives of the joint positions.

    Args:
        derivatives: Highest derivative that is written: 2, 1 or 0. A ROS controller then
            interpolates by quintics, cubics or lines. The default is 2, and 0 for set-points with
            command limits.
        effort: Whether points have the torques of the drives in the plan [N m], for an arm with
            masses.
    """

    derivatives: Derivatives | None = None
    effort: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFormat(TrajectoryFormat):
    """Format with derivatives, the motion of the tool, and analog outputs.

    Args:
        tool_motion: Whether the file gets the tool's point, orientation (quaternion) and speed. For
            set-points they are those of the set-points.
        analog: Analog outputs by their names: functions from times of the plan [s], (n,), to
            values, as `armcontour.jobs.analog_outputs` gives them.
    """

    tool_motion: bool = False
    analog: Analog | None = None


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class CsvFormat(TableFormat):
    """Table as CSV text (.csv).

    Args:
        decimals: Decimals of joint positions [rad]; by default 7, or 9 for cycles up to 4 ms,
            or 12 for set-points with command limits. Velocities have one decimal less,
            accelerations two, torques three.
        comments: Whether the file begins with its name and the contours, in lines that begin with
            #. To read these files with pandas, specify `comment="#"`.
    """

    kind: ClassVar[str] = "csv"
    ending: ClassVar[str] = ".csv"
    in_motion: ClassVar[bool] = True
    decimals: Decimals | None = None
    comments: bool = False

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_csv(table, file, decimals=self.decimals, comments=self.comments)


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class NpzFormat(TableFormat):
    """Arrays of NumPy (.npz), without pickled objects."""

    kind: ClassVar[str] = "npz"
    ending: ClassVar[str] = ".npz"
    in_motion: ClassVar[bool] = True

    write = staticmethod(write_npz)


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class RosYamlFormat(TrajectoryFormat):
    """A trajectory_msgs/msg/JointTrajectory of ROS 2 as YAML text (.yaml).

    Args:
        decimals: Decimals of joint positions, as in CsvFormat.
        tolerances: Tolerances; with them, the file is a goal of the action
            control_msgs/action/FollowJointTrajectory. See `predict_tolerances`.
    """

    kind: ClassVar[str] = "ros-yaml"
    ending: ClassVar[str] = ".yaml"
    decimals: Decimals | None = None
    tolerances: GoalTolerances | None = None

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_ros_yaml(table, file, decimals=self.decimals, tolerances=self.tolerances)


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class McapFormat(TrajectoryFormat):
    """A bag of ROS 2 (.mcap), which is a folder, with a JointTrajectory message and the events."""

    kind: ClassVar[str] = "mcap"
    ending: ClassVar[str] = ".mcap"

    write = staticmethod(write_mcap)


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
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
    ending: ClassVar[str] = ".script"
    joints: ClassVar[int | None] = JOINTS
    regular: ClassVar[bool] = True
    outputs: Mapping[str, int | str] | None = None
    analog: Analog | None = None
    call: bool = False

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_urscript(table, file, self.outputs, call=self.call)


@checks.explain_calls
@dataclass(frozen=True, slots=True, kw_only=True)
class TemplateFormat(TableFormat):
    """Robot program that a jinja2 template generates.

    Args:
        template: "kuka", "abb", or the path of a jinja2 file.
        outputs: The output of each event, and of each analog output, by its name.
    """

    kind: ClassVar[str] = "template"
    joints: ClassVar[int | None] = JOINTS
    template: str | FilePath
    outputs: Mapping[str, int | str] | None = None

    @property
    def label(self) -> str:
        """Name of the template."""
        return str(self.template)

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table to a file."""
        write_template(table, file, self.template, self.outputs)


# Classes of the formats by name.
FORMATS: dict[str, type[ExportFormat]] = {
    x.kind: x
    for x in (CsvFormat, NpzFormat, RosYamlFormat, McapFormat, URScriptFormat, TemplateFormat)
}
FORMAT_LIST = ", ".join(f"{x} ({kind.ending})" if kind.ending else x for x, kind in FORMATS.items())
WITH_ANALOG = (TableFormat, URScriptFormat)
WITH_OUTPUTS = (URScriptFormat, TemplateFormat)


def format_named(name: str) -> type[ExportFormat]:
    """Class of the format with a name."""
    if name not in FORMATS:
        raise InvalidInput(f"There is no format {name!r}. The formats are {FORMAT_LIST}.")
    return FORMATS[name]


def format_of(file: FilePath) -> type[ExportFormat]:
    """Class of the format with the extension of a file."""
    by_ending = {x.ending: x for x in FORMATS.values() if x.ending}
    if file.suffix.lower() in by_ending:
        return by_ending[file.suffix.lower()]
    raise InvalidInput(
        f"The extension of {file.name or file} does not belong to a format. Specify one of the "
        f"formats {FORMAT_LIST}, or a template, such as kuka."
    )


def outputs_of(format: ExportFormat) -> Mapping[str, int | str]:
    """Outputs of events by their names; empty for formats without outputs."""
    return (isinstance(format, WITH_OUTPUTS) and format.outputs) or {}


@checked
def export(
    data: SetPoints | Trajectory,
    file: str | FilePath,
    format: ExportFormat | None = None,
    *,
    arm: Arm | None = None,
    joint_names: Sequence[str] | None = None,
    cycle: float | None = None,
) -> None:
    """Write set-points or a trajectory to a file.

    Times of points and events count from the first set-point of each file. An existing file is
    replaced. If writing fails, the existing file is unchanged.

    >>> ac.export(set_points, "set_points.csv")
    >>> ac.export(planned, "plan.csv", arm=arm, cycle=0.01)

    Args:
        data: Set-points, or a trajectory for a controller that needs no compensation.
        file: The destination; for a bag a folder like those of `ros2 bag record`.
        format: The format with its options, such as URScriptFormat(outputs={"tool": 0}); by default
            that of the file's extension.
        arm: The arm; gives joint names, and tool points if the format contains them.
        joint_names: Joint names instead of the arm's; "joint 1", "joint 2", ... without an arm.
        cycle: Sampling cycle of a trajectory [s], 4 ms by default; set-points have their own.

    Warns:
        UserWarning: A URScript program, or a program of the template kuka or abb, does not switch
            an event or set an analog output, because no output is named; a file has more points
            than `points_per_file`; or a program has more than 10,000 points.

    Raises:
        InvalidInput: No format has the extension, an output belongs to an unknown event, a library
            is missing, the template has an error, the format does not support the data, or the file
            cannot be written.
    """
    destination = checks.read_file_path("export", file)
    chosen = format_of(destination)() if format is None else format
    table = make_table(
        data,
        name=destination.stem if chosen.name is None else chosen.name,
        arm=arm,
        joint_names=joint_names,
        cycle=cycle,
        # Some formats have no such options.
        derivatives=getattr(chosen, "derivatives", 0),
        tool_motion=getattr(chosen, "tool_motion", False),
        effort=getattr(chosen, "effort", False),
        at_stops=chosen.at_stops,
        analog=getattr(chosen, "analog", None),
    )
    outputs = outputs_of(chosen)
    names = (*(x.name for x in table.events), *table.analog)
    check_outputs(outputs, names, option="outputs", owner=repr(table.name))
    parts = chosen.parts(table)
    # Warnings come before writing, so that nothing is written if warnings are errors.
    for sentence in chosen.describe(
        parts, lambda event, output: f"outputs={{{event!r}: {output!r}}}"
    ):
        kind = "Template" if isinstance(chosen, TemplateFormat) else "Format"
        warnings.warn(f"{kind} {chosen.label}: {sentence}", stacklevel=3)
    for part, place in zip(parts, part_files(destination, len(parts)), strict=True):
        write_destination(place, partial(chosen.write, part), folder=isinstance(chosen, McapFormat))


def check_outputs(
    outputs: Mapping[str, int | str], events: Iterable[str], *, option: str, owner: str
) -> None:
    """Check that outputs belong to existing events or analog outputs."""
    names = sorted(set(events))
    for name in outputs:
        if name not in names:
            has = f"switches only {', '.join(names)}" if names else "switches no output"
            raise InvalidInput(f"{option} names {name!r}, but {owner} {has}.")


def write_destination(
    file: FilePath, write: Callable[[FilePath], None], *, folder: bool = False
) -> None:
    """Write a file or folder atomically; if writing fails, an existing file is unchanged."""
    try:
        _check_destination(file, folder)
        staging.write_atomically(file, write)
    except OSError as error:
        raise staging.unwritable(file, error) from None


def _check_destination(file: FilePath, folder: bool) -> None:
    """Check that a destination is a valid path, and that writing does not destroy other files."""
    if not file.name or "\0" in str(file):
        raise InvalidInput(f"Cannot write {str(file)!r}, because it is not a valid file name.")
    if not folder and file.is_dir():
        raise InvalidInput(f"Cannot write {file}, because a folder has this name.")
    if not folder or not file.exists():
        return
    if not file.is_dir():
        raise InvalidInput(f"Cannot write the folder {file}, because a file has this name.")
    other = sorted(x.name for x in file.iterdir() if x.suffix not in BAG_EXTENSIONS or x.is_dir())
    if other:
        raise InvalidInput(
            f"Cannot write {file}, because this folder has files that do not belong to a bag, such "
            f"as {other[0]}."
        )
