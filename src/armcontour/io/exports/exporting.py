"""The function `export`, which writes taught data or a trajectory in one of the formats."""

from __future__ import annotations

import warnings
from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from armcontour import _checks
from armcontour._checks import FloatArray, refuse_if
from armcontour._text import show
from armcontour.arms import Arm
from armcontour.core.fields import checked
from armcontour.errors import InvalidInput
from armcontour.io.exports.destination import put
from armcontour.io.exports.ros import write_mcap, write_ros_yaml
from armcontour.io.exports.table import Table, make_table
from armcontour.io.exports.tables import write_csv, write_npz
from armcontour.io.exports.template import describe_program, write_template
from armcontour.io.exports.urscript import write_urscript
from armcontour.motion import TaughtData, Trajectory

# File extension of each format; a template may have any.
FORMATS = {
    "csv": ".csv",
    "npz": ".npz",
    "ros-yaml": ".yaml",
    "mcap": ".mcap",
    "urscript": ".script",
    "template": "",
}
# Formats with analog outputs, and the same in words.
WITH_ANALOG = ("csv", "npz", "urscript", "template")
HAVE_ANALOG = "csv, npz, urscript and templates have"
_PLAIN: dict[str, Callable[[Table, FilePath], None]] = {
    "csv": write_csv,
    "npz": write_npz,
    "ros-yaml": write_ros_yaml,
    "mcap": write_mcap,
}


def formats() -> dict[str, str]:
    """The formats with their file extensions; the extension is empty if any is possible."""
    return dict(FORMATS)


@checked
def export(
    data: TaughtData | Trajectory,
    file: str | FilePath,
    *,
    arm: Arm | None = None,
    joint_names: Sequence[str] | None = None,
    format: str | None = None,
    period: float | None = None,
    template: str | FilePath | None = None,
    name: str | None = None,
    outputs: Mapping[str, int | str] | None = None,
    derivatives: int = 2,
    tool_motion: bool = False,
    analog: Mapping[str, Callable[[FloatArray], FloatArray]] | None = None,
    call: bool = False,
) -> None:
    """Write taught data or a trajectory to a file.

    Times, also those of events, count from the first set-point. An earlier file is replaced; if
    writing fails, it stays.

    Args:
        data: Taught data, or a trajectory for a controller that needs no compensation.
        file: The destination; for "mcap" a folder like those of `ros2 bag record`.
        arm: The arm; gives joint names, and tool points if the format contains them.
        joint_names: Joint names instead of the arm's; "joint 1", "joint 2", ... without an arm.
        format: A name of `formats()`; by default the format of the file's extension.
        period: Sampling period of a trajectory [s], 4 ms by default; taught data have their own.
        template: For "template": "kuka", "abb", or the path of a jinja2 file.
        name: Name of the program inside the file; by default the name of the file, which the
            template kuka always takes.
        outputs: For "urscript" and "template": the output of each event by the event's name, and of
            each analog output, such as "AO0" for "urscript".
        derivatives: Highest derivative that is written: 2, 1 or 0. A ROS controller then
            interpolates by quintics, cubics or lines.
        tool_motion: Whether csv, npz and template get the tool's point, orientation
            (quaternion) and speed. For taught data they are those of the set-points.
        analog: Analog outputs by their names, for the same formats: functions from times of the
            plan [s], (n,), to values, as `armcontour.jobs.analog_outputs` gives them. A robot
            program sets those that `outputs` names.
        call: Whether a program of "urscript" is followed by its call, for a script file that a
            program of the pendant includes. Programs that are sent to the controller end without.

    Warns:
        UserWarning: A program of "urscript" or of the template kuka or abb does not switch an
            event, or a program does not set an analog output, as no output is named.

    Raises:
        InvalidInput: The format is unknown or does not have an option, an output is of an unknown
            event, a library is missing, the template has an error, the format cannot hold the
            data, or the file cannot be written.
    """
    destination = _checks.read_place("export", file)
    kind = chosen_format(destination, format, template)
    table = make_table(
        data,
        name=destination.stem if name is None else name,
        arm=arm,
        joint_names=joint_names,
        period=period,
        derivatives=derivatives,
        tool_motion=tool_motion,
        analog=analog,
    )
    if outputs is not None:
        names = (*(x.name for x in table.events), *table.analog)
        refuse_unknown_outputs(outputs, names, option="outputs", owner=repr(table.name))
    # Where warnings are errors, nothing is written.
    for said in describe_program(
        table,
        kind if template is None else template,
        outputs,
        lambda event, output: f"outputs={{{event!r}: {output!r}}}",
    ):
        called = f"Format {kind}" if template is None else f"Template {template}"
        warnings.warn(f"{called}: {said}", stacklevel=3)
    put(
        destination,
        lambda path: write_table(
            table, path, format=kind, template=template, outputs=outputs, call=call
        ),
        folder=kind == "mcap",
    )


def refuse_unknown_outputs(
    outputs: Mapping[str, int | str], events: Iterable[str], *, option: str, owner: str
) -> None:
    """Refuse outputs for events that do not exist.

    Args:
        outputs: Outputs by names of events.
        events: Names of the existing events.
        option: Name of the option in which the outputs were given, for the message.
        owner: Name of the program with the events, for the message.

    Raises:
        InvalidInput: No mapping, or an output is for an unknown event.
    """
    if not isinstance(outputs, Mapping):
        raise InvalidInput(
            f"{option} must give the output of each event by its name, such as {{'tool': 0}}, not "
            f"{show(outputs)}."
        )
    known = sorted(set(events))
    for name in outputs:
        if name not in known:
            has = f"it has {', '.join(known)}" if known else "it switches nothing"
            raise InvalidInput(f"{option} names {name!r}, which {owner} does not switch: {has}.")


def write_table(
    table: Table,
    file: FilePath,
    *,
    format: str,
    template: str | FilePath | None = None,
    outputs: Mapping[str, int | str] | None = None,
    call: bool = False,
) -> None:
    """Write a table directly to a path, without a temporary file.

    Args:
        table: The table.
        file: The path; for "mcap" a folder that does not exist yet.
        format: A name of `formats()`.
        template: As in `export`.
        outputs: As in `export`.
        call: As in `export`.

    Raises:
        InvalidInput: As in `export`.
    """
    kind = chosen_format(file, format, template)
    if outputs is not None and kind not in ("urscript", "template"):
        raise InvalidInput(f"Outputs are for urscript and template, not for {kind}.")
    if call and kind != "urscript":
        raise InvalidInput(f"A call is for urscript, not for {kind}.")
    if table.analog and not takes_analog(kind):
        raise InvalidInput(
            f"The format {kind} has no place for the analog output {next(iter(table.analog))}: "
            f"{HAVE_ANALOG} one."
        )
    if kind == "urscript":
        write_urscript(table, file, outputs, call=call)
    elif kind == "template" and template is not None:
        write_template(table, file, template, outputs)
    else:
        _PLAIN[kind](table, file)


def takes_analog(kind: str) -> bool:
    """Whether a format, which is a name of `formats()`, has analog outputs."""
    return kind in WITH_ANALOG


def chosen_format(file: FilePath, format: str | None, template: Any = None) -> str:
    """The format of an export: the given one, "template", or that of the file's extension.

    Args:
        file: The destination.
        format: A name of `formats()`, or None.
        template: The template, if one is given.

    Raises:
        InvalidInput: The format is unknown or cannot be derived, a template is given for another
            format, or the template is missing.
    """
    listed = ", ".join(f"{x} ({end})" if end else x for x, end in FORMATS.items())
    for name, given in (("format", format), ("template", template)):
        if not isinstance(given, str | FilePath | None):
            raise InvalidInput(f"The {name} of an export is text, not {show(given)}.")
    kind = format
    if kind is None:
        endings = {end: x for x, end in FORMATS.items() if end}
        kind = endings.get(file.suffix.lower()) if template is None else "template"
    if kind is None:
        raise InvalidInput(
            f"The ending of {file.name or file} is not that of a format: give one of the formats "
            f"{listed}, or a template, such as kuka."
        )
    refuse_if(kind not in FORMATS, f"There is no format {kind!r}: the formats are {listed}.")
    other = f"A template is given, but the format is {kind} and not template."
    refuse_if(template is not None and kind != "template", other)
    missing = "The format template needs a template: kuka, abb, or a file."
    refuse_if(template is None and kind == "template", missing)
    return kind
