"""The command `show`: what a drawing consists of, before any arm."""

from __future__ import annotations

import json
from collections.abc import Sequence
from dataclasses import asdict
from functools import partial
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli.console import Console, open_page
from armcontour.cli.opening import read_tools, split_words

if TYPE_CHECKING:
    from armcontour._progress import Progress
    from armcontour.cli.options import DrawingOptions, ShowOptions
    from armcontour.program import Program
    from armcontour.program.survey import ContourFacts

# Largest number of contours in the printed table.
MOST_PRINTED = 40


def show_file(file: FilePath, drawing: DrawingOptions, options: ShowOptions) -> None:
    """Print layers, contours, sizes and nesting of a drawing, and write a preview if asked.

    Args:
        file: The drawing.
        drawing: Options for reading it.
        options: Options of the command.

    Raises:
        InvalidInput: The drawing cannot be read, or the preview cannot be written.
    """
    from armcontour.cli.progress import search_progress
    from armcontour.errors import InvalidInput
    from armcontour.io.exports.destination import put
    from armcontour.program.survey import survey

    out = options.out
    if out is None and options.open_page:
        raise InvalidInput("--open opens the preview: name its file with --out.")
    if out is not None and out.exists() and not options.force:
        raise InvalidInput(f"{out} exists already: choose another name, or give --force.")
    with search_progress("reading") as progress:
        program = read_drawing(file, drawing, progress)
    facts = survey(program)
    if out is not None:
        from armcontour.report import render_drawing

        put(out, partial(_write, render_drawing(program, file.name)))
    if options.as_json:
        print(json.dumps(describe(program, facts), indent=2))
    else:
        _print(program, facts, file.name)
        if out is not None:
            Console().say(f"Preview: {out.resolve().as_uri()}")
    if out is not None and options.open_page:
        open_page(out)


def _write(page: str, file: FilePath) -> None:
    """Write a page to a file."""
    file.write_text(page, encoding="utf-8")


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
    from armcontour.report.sections.drawing import HEADER, format_corner, format_size, row_of

    console = Console()
    size = extent_of(facts)
    console.say(f"{name}: {format_size(size)} mm from {format_corner(size)} mm")
    console.show_table(
        ["layer", "contours", "closed", "length [mm]"],
        [
            (layer or "-", str(x["contours"]), str(x["closed"]), f"{x['length'] * 1e3:.2f}")
            for layer, x in _layers(facts).items()
        ],
    )
    console.show_table(
        HEADER, [row_of(x) for x in facts[:MOST_PRINTED]], left=(0, 1, 4), title="Contours"
    )
    if len(facts) > MOST_PRINTED:
        console.say(f"{len(facts) - MOST_PRINTED} more contours: --json or --out has them.")
    for note in program.notes:
        console.say(f"Note: {note}")
