"""Export: taught data, or an uncompensated trajectory, in a format that a robot takes."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from pathlib import Path as FilePath
from typing import Any

from armcontour.arms import Arm
from armcontour.errors import InvalidInput
from armcontour.io.exports.destination import put
from armcontour.io.exports.ros import write_mcap, write_ros_yaml
from armcontour.io.exports.table import Table, make_table
from armcontour.io.exports.tables import write_csv, write_npz, write_parquet
from armcontour.io.exports.template import write_template
from armcontour.io.exports.urscript import write_urscript
from armcontour.motion import TaughtData, Trajectory

# The ending of each format's files; a template's are what its controller wants.
FORMATS = {
    "csv": ".csv",
    "parquet": ".parquet",
    "npz": ".npz",
    "ros-yaml": ".yaml",
    "mcap": ".mcap",
    "urscript": ".script",
    "template": "",
}
_PLAIN: dict[str, Callable[[Table, FilePath], None]] = {
    "csv": write_csv,
    "parquet": write_parquet,
    "npz": write_npz,
    "ros-yaml": write_ros_yaml,
    "mcap": write_mcap,
}


def formats() -> dict[str, str]:
    """The formats and the endings of their files; empty where any will do."""
    return dict(FORMATS)


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
) -> None:
    """Write taught data, or a trajectory as it is, to a file, whole or not at all.

    Time counts from the first set-point, that of events too. An earlier file is replaced.

    Args:
        data: Taught data; or a trajectory, for a controller that needs no compensation.
        file: The destination; for "mcap" a folder, as `ros2 bag record` makes.
        arm: Gives joint names, and tool points where the format has them.
        joint_names: Other names than the arm's; "joint 1", "joint 2", ... without an arm.
        format: A name of `formats()`; by default what the file's ending says.
        period: Time between samples of a trajectory [s]; taught data has its own.
        template: For "template": "kuka", "abb", or a jinja2 file of one's own.
        name: What it is called inside; by default as the file is.
        outputs: For "urscript" and "template": outputs by names of events.
        derivatives: Highest derivative that is written: 2, 1 or 0. A ROS controller joins points
            by quintics, cubics or lines accordingly.

    Raises:
        InvalidInput: An unknown format, an option of another one, an output of an event that there
            is not, a missing library, a template that is wrong, data that the format cannot hold,
            or a file that cannot be written.
    """
    place = FilePath(file)
    kind = chosen_format(place, format, template)
    table = make_table(
        data,
        name=place.stem if name is None else name,
        arm=arm,
        joint_names=joint_names,
        period=period,
        derivatives=derivatives,
    )
    refuse_unknown_outputs(
        outputs or {}, (x.name for x in table.events), option="outputs", owner=repr(table.name)
    )
    put(
        place,
        lambda path: write_table(table, path, format=kind, template=template, outputs=outputs),
        folder=kind == "mcap",
    )


def refuse_unknown_outputs(
    outputs: Mapping[str, int | str], events: Iterable[str], *, option: str, owner: str
) -> None:
    """Refuse outputs of events that there are not.

    Args:
        outputs: Outputs by names of events.
        events: The names that there are.
        option: What the outputs were given as.
        owner: Whose events these are.

    Raises:
        InvalidInput: There is such an output.
    """
    known = sorted(set(events))
    for name in outputs:
        if name not in known:
            has = f"its events are {', '.join(known)}" if known else "it switches nothing"
            raise InvalidInput(f"{option} names the event {name!r}, which {owner} has not: {has}.")


def write_table(
    table: Table,
    file: FilePath,
    *,
    format: str,
    template: str | FilePath | None = None,
    outputs: Mapping[str, int | str] | None = None,
) -> None:
    """Write a table to a path, for those who put the file in place themselves.

    Args:
        table: The table.
        file: Where to; for "mcap" a folder that does not exist yet.
        format: A name of `formats()`.
        template: As in `export`.
        outputs: As in `export`.

    Raises:
        InvalidInput: As in `export`.
    """
    kind = chosen_format(file, format, template)
    if outputs is not None and kind not in ("urscript", "template"):
        raise InvalidInput(f"Outputs are for urscript and template, not for {kind}.")
    if kind == "urscript":
        write_urscript(table, file, outputs)
    elif kind == "template" and template is not None:
        write_template(table, file, template, outputs)
    else:
        _PLAIN[kind](table, file)


def chosen_format(file: FilePath, format: str | None, template: Any = None) -> str:
    """The format that is asked for by name, by a template, or by the ending of a file.

    Raises:
        InvalidInput: None is, or a template and another format are, or no template is given.
    """
    listed = ", ".join(f"{x} ({end})" if end else x for x, end in FORMATS.items())
    kind = format
    if kind is None and template is not None:
        kind = "template"
    if kind is None:
        kind = next((x for x, end in FORMATS.items() if end and end == file.suffix.lower()), None)
        if kind is None:
            raise InvalidInput(
                f"The ending of {file.name} does not say which format it is to have: give one, "
                f"of {listed}."
            )
    if kind not in FORMATS:
        raise InvalidInput(f"There is no format {kind!r}: the formats are {listed}.")
    if template is not None and kind != "template":
        raise InvalidInput(f"A template is given, but the format is {kind} and not template.")
    if template is None and kind == "template":
        raise InvalidInput("The format template needs a template: kuka, abb, or a file.")
    return kind
