"""The function `export`, which writes taught data or a trajectory in one of the formats."""

from __future__ import annotations

import warnings
from collections.abc import Iterable, Mapping, Sequence
from pathlib import Path as FilePath

from armcontour import _checks
from armcontour.arms import Arm
from armcontour.core.fields import checked
from armcontour.errors import InvalidInput
from armcontour.io.exports.destination import put
from armcontour.io.exports.formats import (
    ExportFormat,
    McapFormat,
    TemplateFormat,
    format_of,
    outputs_of,
)
from armcontour.io.exports.table import make_table
from armcontour.io.exports.template import describe_program
from armcontour.motion import TaughtData, Trajectory


@checked
def export(
    data: TaughtData | Trajectory,
    file: str | FilePath,
    format: ExportFormat | None = None,
    *,
    arm: Arm | None = None,
    joint_names: Sequence[str] | None = None,
    period: float | None = None,
) -> None:
    """Write taught data or a trajectory to a file.

    Times, also those of events, count from the first set-point. An earlier file is replaced; if
    writing fails, it stays.

    Args:
        data: Taught data, or a trajectory for a controller that needs no compensation.
        file: The destination; for a bag a folder like those of `ros2 bag record`.
        format: The format with its options, such as URScriptFormat(outputs={"tool": 0}); by default
            that of the file's extension.
        arm: The arm; gives joint names, and tool points if the format contains them.
        joint_names: Joint names instead of the arm's; "joint 1", "joint 2", ... without an arm.
        period: Sampling period of a trajectory [s], 4 ms by default; taught data have their own.

    Warns:
        UserWarning: A program of URScript or of the template kuka or abb does not switch an event,
            or a program does not set an analog output, as no output is named.

    Raises:
        InvalidInput: No format has the extension, an output is of an unknown event, a library is
            missing, the template has an error, the format cannot hold the data, or the file cannot
            be written.
    """
    destination = _checks.read_place("export", file)
    chosen = format_of(destination)() if format is None else format
    table = make_table(
        data,
        name=destination.stem if chosen.name is None else chosen.name,
        arm=arm,
        joint_names=joint_names,
        period=period,
        # A format has these or not.
        derivatives=getattr(chosen, "derivatives", 0),
        tool_motion=getattr(chosen, "tool_motion", False),
        analog=getattr(chosen, "analog", None),
    )
    outputs = outputs_of(chosen)
    names = (*(x.name for x in table.events), *table.analog)
    refuse_unknown_outputs(outputs, names, option="outputs", owner=repr(table.name))
    # Where warnings are errors, nothing is written.
    for said in describe_program(
        table,
        chosen.label,
        outputs,
        lambda event, output: f"outputs={{{event!r}: {output!r}}}",
    ):
        kind = "Template" if isinstance(chosen, TemplateFormat) else "Format"
        warnings.warn(f"{kind} {chosen.label}: {said}", stacklevel=3)
    put(
        destination,
        lambda path: chosen.write(table, path),
        folder=isinstance(chosen, McapFormat),
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
        InvalidInput: An output is for an unknown event.
    """
    known = sorted(set(events))
    for name in outputs:
        if name not in known:
            has = f"it has {', '.join(known)}" if known else "it switches nothing"
            raise InvalidInput(f"{option} names {name!r}, which {owner} does not switch: {has}.")
