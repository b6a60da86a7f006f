"""The command `show`: prints size and layers of a drawing, without an arm."""

from __future__ import annotations

from typing import Any

import numpy as np

from armcontour.cli.command_execution import Outcome
from armcontour.cli.commands import Show
from armcontour.cli.console import table_lines
from armcontour.cli.inputs import naming_options_in_errors, read_patch
from armcontour.core.errors import error_context
from armcontour.core.progress import Progress
from armcontour.files.drawings.path_reader import read_path
from armcontour.files.drawings.read_options import ReadOptions
from armcontour.files.file_keys import read_keys
from armcontour.program import Program

# A smaller size in z [mm] is shown as 0.00, so it is omitted.
MIN_SHOWN_HEIGHT = 5e-3


def show(options: Show, _: None, progress: Progress) -> Outcome:
    """Print size and layers of a drawing."""
    program = _read(options, progress)
    page = _describe(program)
    low, high = np.array(page["extent"]) * 1e3
    sides = [x for k, x in enumerate(high - low) if k < 2 or x >= MIN_SHOWN_HEIGHT]
    size = " x ".join(f"{x:.2f}" for x in sides)
    corner = ", ".join(f"{x:z.2f}" for x in low)
    rows = [
        (layer or "-", str(x["contours"]), str(x["closed"]), f"{x['length'] * 1e3:.2f}")
        for layer, x in page["layers"].items()
    ]
    lines = [
        f"{options.drawing.name}: {size} mm from {corner} mm",
        *table_lines([("layer", "contours", "closed", "length [mm]"), *rows]),
        *(f"Note: {x}" for x in program.notes),
    ]
    return Outcome(lines=lines, page=page)


def _read(options: Show, progress: Progress) -> Program:
    """Read a drawing with the options of the command."""
    patch, names = read_patch(options)
    data = {str(key): value for (_, key), value in patch.items()}
    names_without_path = {key.removeprefix("path."): option for key, option in names.items()}
    with naming_options_in_errors(names_without_path), error_context(options.drawing.name):
        reading = read_keys(ReadOptions, data)
    return read_path(options.drawing, reading, progress=progress)


def _describe(program: Program) -> dict[str, Any]:
    """Return the size, layers and notes of a drawing as a mapping for JSON, in SI units."""
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
