"""Formats of exports: a class for each, with its options, and `export`, which writes one."""

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

# Extensions of the files in the folder of a bag; a folder with other files is not replaced.
BAG = (".mcap", ".db3", ".yaml")
Analog = Mapping[str, Callable[[FloatArray], FloatArray]]
Derivatives = Annotated[int, AtLeast(0, 2)]
# With fewer decimals of positions, accelerations would have none.
Decimals = Annotated[int, AtLeast(4, DECIMALS)]


@dataclass(frozen=True, slots=True, kw_only=True)
class ExportFormat(Checked):
    """A format of exports.

    Args:
        name: Name of the program inside the file; by default the name of the file, which the
            template kuka always takes.
        points_per_file: Largest number of points of a file, or a controller: "motoros2" (200),
            "ur" (1000). Longer motions are divided into files part_01, part_02, ..., each from the
            last point of the one before. Files end where the motion rests, and are longer if it
            does not; files of csv and npz also end in motion.
    """

    # Name of the format; its extension, empty if any is possible; required number of joints.
    kind: ClassVar[str] = ""
    ending: ClassVar[str] = ""
    joints: ClassVar[int | None] = None
    # Whether a file may end in motion, as its player goes on with the next one.
    in_motion: ClassVar[bool] = False
    # Whether all points are a cycle apart.
    regular: ClassVar[bool] = False
    name: str | None = None
    points_per_file: int | str | None = None

    def _check_together(self) -> None:
        read_points_per_file(self.points_per_file)

    @property
    def label(self) -> str:
        """Name of the format, or of its template."""
        return self.kind

    @property
    def at_stops(self) -> bool:
        """True if tables need points at the stops of a trajectory, at which files end."""
        return self.points_per_file is not None and not self.regular and not self.in_motion

    @checked
    def digit_of(self, table: SetPointTable) -> float | None:
        """Last digit of joint positions [rad]; None for binary files and templates of users.

        Args:
            table: The table.
        """
        if isinstance(self, CsvFormat | RosYamlFormat):
            return float(10.0 ** -table.decimals_of(self.decimals))
        return LAST_DIGIT.get(self.label)

    def parts(self, table: SetPointTable) -> tuple[SetPointTable, ...]:
        """The tables of the files.

        Args:
            table: The table of the whole motion.
        """
        most = read_points_per_file(self.points_per_file)
        return (table,) if most is None else split_table(table, most, in_motion=self.in_motion)

    @checked
    def describe(
        self, parts: Sequence[SetPointTable], name_output: Callable[[str, int | str], str]
    ) -> list[str]:
        """Sentences on files: outputs not set, digits, and size.

        Args:
            parts: The tables of the files.
            name_output: Gives the text that sets the output of an event, for messages.
        """
        most, outputs = read_points_per_file(self.points_per_file), outputs_of(self)
        sentences = [
            describe_program(x, self.label, outputs, name_output, self.digit_of(x)) for x in parts
        ]
        every = [*describe_parts(parts, most), *(sentence for x in sentences for sentence in x)]
        return list(dict.fromkeys(every))

    @checked
    def write(self, table: SetPointTable, file: FilePath) -> None:
        """Write a table directly to a path, without a temporary file.

        Args:
            table: The table.
            file: The path; for a bag a folder that does not exist yet.
        """
        raise NotImplementedError


@dataclass(frozen=True, slots=True, kw_only=True)
class TrajectoryFormat(ExportFormat):
    """A format with derivatives of the joint positions.

    Args:
        derivatives: Highest derivative that is written: 2, 1 or 0. A ROS controller then
            interpolates by quintics, cubics or lines.
        effort: Whether points have the torques of the drives in the plan [N m], for an arm with
            masses.
    """

    derivatives: Derivatives = 2
    effort: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class TableFormat(TrajectoryFormat):
    """A format with derivatives, the motion of the tool, and analog outputs.

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
    """A table as text (.csv).

    Args:
        decimals: Decimals of joint positions [rad]; by default 7, or 9 with cycles up to 4 ms,
            or 12 for set-points within limits of commands. Velocities have one less, accelerations
            two, torques three.
        comments: Whether the file begins with its name and the contours, in lines that begin with
            #. pandas needs `comment="#"` for these.
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
    """A trajectory_msgs/msg/JointTrajectory of ROS 2 as text (.yaml).

    Args:
        decimals: Decimals, as of CsvFormat.
        tolerances: Tolerances, with which the file is a goal of the action
            control_msgs/action/FollowJointTrajectory; see `predict_tolerances`.
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
    """The same message and the events in a bag of ROS 2 (.mcap), a folder."""

    kind: ClassVar[str] = "mcap"
    ending: ClassVar[str] = ".mcap"

    write = staticmethod(write_mcap)


@checks.explain_calls
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
    """A program that a jinja2 template makes.

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


# The formats by their names.
FORMATS: dict[str, type[ExportFormat]] = {
    x.kind: x
    for x in (CsvFormat, NpzFormat, RosYamlFormat, McapFormat, URScriptFormat, TemplateFormat)
}
LISTED = ", ".join(f"{x} ({of.ending})" if of.ending else x for x, of in FORMATS.items())
WITH_ANALOG = (TableFormat, URScriptFormat)
WITH_OUTPUTS = (URScriptFormat, TemplateFormat)


def format_named(name: str) -> type[ExportFormat]:
    """The format of a name."""
    if name not in FORMATS:
        raise InvalidInput(f"There is no format {name!r}: the formats are {LISTED}.")
    return FORMATS[name]


def format_of(file: FilePath) -> type[ExportFormat]:
    """The format of a file, by its extension."""
    by_ending = {x.ending: x for x in FORMATS.values() if x.ending}
    if file.suffix.lower() in by_ending:
        return by_ending[file.suffix.lower()]
    raise InvalidInput(
        f"The ending of {file.name or file} is not that of a format: give one of the formats "
        f"{LISTED}, or a template, such as kuka."
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

    Times, also those of events, count from the first set-point of each file. An earlier file is
    replaced; if writing fails, it stays.

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
        UserWarning: A program of URScript or of the template kuka or abb does not switch an event,
            or a program does not set an analog output, as no output is named; or a file has more
            points than `points_per_file`, or a program more than 10,000.

    Raises:
        InvalidInput: No format has the extension, an output is of an unknown event, a library is
            missing, the template has an error, the format cannot hold the data, or the file cannot
            be written.
    """
    destination = checks.read_file_path("export", file)
    chosen = format_of(destination)() if format is None else format
    table = make_table(
        data,
        name=destination.stem if chosen.name is None else chosen.name,
        arm=arm,
        joint_names=joint_names,
        cycle=cycle,
        # Some formats do not have these options.
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
    # If warnings are errors, nothing is written.
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
    """Check that outputs belong to existing events."""
    names = sorted(set(events))
    for name in outputs:
        if name not in names:
            has = f"it has {', '.join(names)}" if names else "it switches nothing"
            raise InvalidInput(f"{option} names {name!r}, which {owner} does not switch: {has}.")


def write_destination(
    file: FilePath, write: Callable[[FilePath], None], *, folder: bool = False
) -> None:
    """Write a file or folder to a temporary path, then move it to the destination."""
    # If writing fails, an earlier file at the destination stays.
    try:
        _check_destination(file, folder)
        staging.write_atomically(file, write)
    except OSError as error:
        raise staging.unwritable(file, error) from None


def _check_destination(file: FilePath, folder: bool) -> None:
    """Check that writing to a destination would not destroy other files."""
    if not file.name or "\0" in str(file):
        raise InvalidInput(f"Cannot write {str(file)!r}: it is not the name of a file.")
    if not folder and file.is_dir():
        raise InvalidInput(f"Cannot write {file}: a folder of that name is in the way.")
    if not folder or not file.exists():
        return
    if not file.is_dir():
        raise InvalidInput(f"Cannot write the folder {file}: a file of that name is in the way.")
    other = sorted(x.name for x in file.iterdir() if x.suffix not in BAG or x.is_dir())
    if other:
        raise InvalidInput(
            f"Cannot write {file}: that folder holds other things than a bag, such as {other[0]}."
        )
