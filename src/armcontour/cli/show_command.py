"""The command `show`: prints size and layers of a drawing, without an arm."""

from __future__ import annotations

import json
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Annotated, Any

import typer

from armcontour.cli.console import print_lines, show_table
from armcontour.cli.inputs import name_options, read_patch
from armcontour.cli.options import AsJson, DrawingOptions
from armcontour.cli.program import PREPARE, command
from armcontour.cli.progress_bars import show_progress

if TYPE_CHECKING:
    from armcontour.core.progress import Progress
    from armcontour.program import Program


@command(PREPARE, "show gasket.dxf --layer CUT")
def show(
    drawing: Annotated[
        FilePath,
        typer.Argument(
            help="Drawing (.dxf, .svg), G-code (.ngc, .nc, .gcode), or waypoints (.csv)."
        ),
    ],
    drawing_options: DrawingOptions,
    as_json: AsJson = False,
) -> None:
    """Show size and layers of a drawing; no arm is required."""
    import numpy as np

    with show_progress("reading") as progress:
        program = _read(drawing, drawing_options, progress)
    data = _describe(program)
    if as_json:
        print(json.dumps(data, indent=2))
        return
    low, high = np.array(data["extent"]) * 1e3
    # The size in z is omitted if it is rounded to zero.
    sides = [x for k, x in enumerate(high - low) if k < 2 or x >= 5e-3]
    size, corner = " x ".join(f"{x:.2f}" for x in sides), ", ".join(f"{x:z.2f}" for x in low)
    print_lines(f"{drawing.name}: {size} mm from {corner} mm")
    show_table(
        ["layer", "contours", "closed", "length [mm]"],
        [
            (layer or "-", str(x["contours"]), str(x["closed"]), f"{x['length'] * 1e3:.2f}")
            for layer, x in data["layers"].items()
        ],
    )
    print_lines(*(f"Note: {x}" for x in program.notes))


def _read(file: FilePath, options: DrawingOptions, progress: Progress) -> Program:
    """Read a drawing with the options of the command."""
    from armcontour.core.errors import error_context
    from armcontour.files.drawings.read import read_path
    from armcontour.files.drawings.read_options import ReadOptions
    from armcontour.files.keys import read_keys

    patch, names = read_patch(options)
    data = {str(key): value for (_, key), value in patch.items()}
    outer = {key.removeprefix("path."): option for key, option in names.items()}
    with name_options(outer), error_context(file.name):
        reading = read_keys(ReadOptions, data)
    return read_path(file, reading, progress=progress)


def _describe(program: Program) -> dict[str, Any]:
    """Size, layers and notes of a drawing as a mapping for JSON, in SI units."""
    import numpy as np

    extents = np.array([x.path.segments.extent for x in program.contours])
    layers: dict[str, dict[str, Any]] = {}
    for contour in program.contours:
        layer = layers.setdefault(contour.layer, {"contours": 0, "closed": 0, "length": 0.0})
        layer["contours"] += 1
        layer["closed"] += contour.closed
        layer["length"] += contour.path.length
    return {
        "dimension": program.dimension,
        "length": program.length,
        "extent": [extents[:, 0].min(axis=0).tolist(), extents[:, 1].max(axis=0).tolist()],
        "layers": layers,
        "notes": list(program.notes),
    }
