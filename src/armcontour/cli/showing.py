"""The command `show`: what a drawing consists of, before any arm."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import Console
from armcontour.cli.opening import read_tools, split_words

if TYPE_CHECKING:
    from armcontour._checks import FloatArray
    from armcontour._progress import Progress
    from armcontour.cli.options import DrawingOptions
    from armcontour.program import Program
    from armcontour.program.survey import ContourFacts

# Largest number of contours in the printed table.
MOST_PRINTED = 40
HEADER = (
    "contour",
    "layer",
    "length [mm]",
    "size [mm]",
    "direction",
    "inside of",
    "corners",
    "lines",
    "arcs",
)


def show_file(file: FilePath, drawing: DrawingOptions, as_json: bool) -> None:
    """Print layers, contours, sizes and nesting of a drawing.

    Args:
        file: The drawing.
        drawing: Options for reading it.
        as_json: Whether to print JSON in place of tables.

    Raises:
        InvalidInput: The drawing cannot be read.
    """
    from armcontour.cli.progress import search_progress
    from armcontour.program.survey import survey

    with search_progress("reading") as progress:
        program = read_drawing(file, drawing, progress)
    facts = survey(program)
    if as_json:
        print(json.dumps(describe(program, facts), indent=2))
    else:
        _print(program, facts, file.name)


def read_drawing(file: FilePath, x: DrawingOptions, progress: Progress) -> Program:
    """Read a drawing with the options of the command line.

    Raises:
        InvalidInput: The drawing cannot be read.
    """
    from armcontour.io.drawings.read import read_path

    words = split_words(x.skip)
    unknown = {"skip": words} if words else "skip" if x.skip_unknown else "refuse"
    return read_path(
        file,
        units=x.units,
        columns=x.waypoint_columns,
        scale=1.0 if x.scale is None else x.scale,
        layers=x.layer or None,
        names=x.contour or None,
        colors=x.color or None,
        flat=x.flat,
        texts=x.texts or "leave_out",
        unknown=unknown,
        tools=read_tools(x.tool),
        progress=progress,
    )


def describe(program: Program, facts: Sequence[ContourFacts]) -> dict[str, Any]:
    """The facts of a drawing for JSON, in SI units."""
    from armcontour.program.survey import extent_of

    return {
        "dimension": program.dimension,
        "length": program.length,
        "extent": extent_of(facts).tolist(),
        "layers": _layers(facts),
        "contours": [asdict(x) | {"extent": x.extent.tolist()} for x in facts],
        "notes": list(program.notes),
    }


def _layers(facts: Sequence[ContourFacts]) -> dict[str, dict[str, Any]]:
    """Number of contours, how many of them are closed, and length of each layer."""
    found: dict[str, dict[str, Any]] = {}
    for x in facts:
        of = found.setdefault(x.layer, {"contours": 0, "closed": 0, "length": 0.0})
        of["contours"] += 1
        of["closed"] += x.closed
        of["length"] += x.length
    return found


def _print(program: Program, facts: Sequence[ContourFacts], name: str) -> None:
    """Print tables of layers and contours, and notes."""
    from armcontour.program.survey import extent_of

    console = Console()
    size = extent_of(facts)
    corner = ", ".join(f"{x:z.2f}" for x in size[0] * 1e3)
    console.say(f"{name}: {_format_size(size)} mm from {corner} mm")
    console.show_table(
        ["layer", "contours", "closed", "length [mm]"],
        [
            (layer or "-", str(x["contours"]), str(x["closed"]), f"{x['length'] * 1e3:.2f}")
            for layer, x in _layers(facts).items()
        ],
    )
    console.show_table(
        HEADER, [_row_of(x) for x in facts[:MOST_PRINTED]], left=(0, 1, 4), title="Contours"
    )
    if len(facts) > MOST_PRINTED:
        console.say(f"{len(facts) - MOST_PRINTED} more contours: --json has them.")
    for note in program.notes:
        console.say(f"Note: {note}")


def _row_of(x: ContourFacts) -> tuple[str, ...]:
    """Cells of a contour, in the order of `HEADER`."""
    turn = "ccw" if x.area > 0 else "cw"
    return (
        f"{x.number}: {x.name}" if x.name else str(x.number),
        x.layer,
        f"{x.length * 1e3:.2f}",
        _format_size(x.extent),
        f"closed, {turn}" if x.closed else "open",
        "" if x.inside is None else str(x.inside),
        str(x.corners),
        str(x.lines),
        str(x.arcs),
    )


def _format_size(extent: FloatArray) -> str:
    """The sides of a box in mm, such as "120.00 x 80.00"; a side of zero in z is left out."""
    sides = (extent[1] - extent[0]) * 1e3
    shown = sides[:2] if len(sides) == 3 and sides[2] < 5e-3 else sides
    return " x ".join(f"{x:.2f}" for x in shown)
