"""The function `read_path`, which selects a reader by the extension of a file."""

from __future__ import annotations

import importlib
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import InvalidInput
from armcontour.core.fields import checked
from armcontour.core.file_access import read_bytes
from armcontour.core.frames import Frame
from armcontour.core.progress import Progress
from armcontour.files.drawings.endings import READERS, find_reader
from armcontour.files.drawings.read_options import FARTHEST, LARGEST, ReadOptions
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program import Program, smooth_curvature

# Modules whose readers report their progress.
WITH_PROGRESS = ("gcode", "dxf", "svg")
# Options of some kinds of files only: the modules that read these, and the kinds in words.
ONLY = {
    "smooth_axes": (("waypoint_table",), "smooth_axes is for tables of waypoints with tool axes"),
    "columns": (("waypoint_table",), "columns (--waypoint-columns) is for waypoints in CSV"),
    "colors": (("dxf", "svg"), "colors is for DXF and SVG drawings"),
    "words": (("gcode",), 'unknown: {skip: [...]} is for G-code (others take "skip")'),
}
# Beyond this a stated unit is wrong; coordinates of surveys may be far from their origin [m].
LARGEST_PART = 1000.0
# Farther than any arm reaches [m].
FARTHEST_ARM = 10.0


@checked
def read_path(
    file: str | FilePath,
    options: ReadOptions = ReadOptions(),
    *,
    frame: Frame | None = None,
    progress: Progress | None = None,
) -> Program:
    """Read the program in a drawing (DXF, SVG), in G-code, or in a table of waypoints.

    Lines and arcs are kept, other curves become tangent arcs. The path of a program with one
    contour is `program.path`.

    >>> program = ac.read_path("part.csv", frame=ac.Frame((0.0, 0.1, 0.0)))
    >>> len(program.contours)
    1

    Args:
        file: The file; the extension decides how it is read.
        options: How to read it, such as ReadOptions(units="mm", layers=["CUT"]).
        frame: Frame of the drawing; if it lifts or tilts the drawing, the program is in space.
        progress: Called from time to time with the name of the file and the fraction of it that is
            read, if the reader supports it.

    Raises:
        InvalidInput: The file cannot be read, or has no use for an option; the message names the
            line, the element or the row.
    """
    location, suffix = find_reader(file)
    module, name = READERS[suffix]
    for option, (modules, purpose) in ONLY.items():
        checks.raise_if(
            bool(getattr(options, option)) and module not in modules,
            f"{purpose}, and {location.name} is none: remove it.",
        )
    read = getattr(importlib.import_module(f"armcontour.files.drawings.{module}"), name)
    if module in WITH_PROGRESS:
        read = partial(read, progress=progress)
    program: Program = read(
        read_bytes(location, "file", maximum=LARGEST), source=location.name, options=options
    )
    factor, unit = options.scale, options.unit
    program = _select(program, options)
    far = _farthest(program) * factor
    checks.raise_if(
        far > LARGEST_PART and unit is not None,
        f"With the unit {options.units}, {program.source} reaches {far:.4g} m from its origin, "
        f"more than {LARGEST_PART:g} m: check the unit.",
    )
    if far > FARTHEST_ARM and (unit, module) == (None, "waypoint_table"):
        note = (
            f"the coordinates of {program.source} reach {far:.4g} m from their origin, farther "
            "than arms do. Columns without a unit are in metres: if these are mm, write x [mm], or "
            "give `units: mm` or --units mm."
        )
        program = replace(program, notes=(*program.notes, note))
    if options.ignore_z:
        program = program.without_z()
    if options.continuity == "curvature":
        tolerance = options.chord_tolerance - options.fit_tolerance
        program = smooth_curvature(program, tolerance=tolerance)
    if frame is None and factor == 1.0:
        return program
    program = program.placed(Frame() if frame is None else frame, scale=factor)
    _check_scaled_size(program, factor)
    return program


def _select(program: Program, options: ReadOptions) -> Program:
    """The program's contours on the layers and with the names of the options."""
    layers = options.layers
    if isinstance(layers, Mapping):
        # The mapping has settings for layers; a drawing need not have all of these layers.
        existing = {x.layer for x in program.contours}
        notes = [f"there is nothing on the layer {x!r}." for x in layers if x not in existing]
        program = replace(program, notes=(*program.notes, *notes))
        layers = [x for x in layers if x in existing] or list(layers)
    return program.selected(layers=layers, names=options.names)


def _farthest(program: Program) -> float:
    """The largest coordinate of all contours [m]."""
    return max(float(np.abs(x.path.vertices).max()) for x in program.contours)


def _check_scaled_size(program: Program, factor: float) -> None:
    """Check that a scale leaves coordinates and contours within the limits of the readers."""
    far = _farthest(program)
    short = min(x.path.length for x in program.contours)
    if not far <= FARTHEST:
        problem, limit = f"reaches {far:.3g} m far", f"more than {FARTHEST:g} m"
    elif short <= REPEATED_POINT:
        problem, limit = f"has a contour of {short:.3g} m", f"no more than {REPEATED_POINT:g} m"
    else:
        return
    raise InvalidInput(
        f"With the scale {factor:g} {program.source} {problem}, {limit}: check the scale."
    )
