"""The function `read_path`, and the extensions of files by which it selects the reader."""

from __future__ import annotations

import importlib
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath

import numpy as np

from armcontour.core import checks
from armcontour.core.errors import FileError, InvalidInput
from armcontour.core.fields import checked
from armcontour.core.file_access import read_bytes
from armcontour.core.frames import Frame
from armcontour.core.progress import Progress
from armcontour.files.drawings.read_options import MAX_COORDINATE, MAX_FILE_SIZE, ReadOptions
from armcontour.files.model.edge_rules import MODELS
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.program import Program

# Modules whose readers report the progress.
WITH_PROGRESS = ("gcode", "dxf", "svg")
# Options for some file formats only: the modules of these formats, and the text for the message.
FORMAT_OPTIONS = {
    "columns": (
        ("waypoint_table",),
        "columns (--waypoint-columns) is supported for waypoints in CSV only",
    ),
    "colors": (("dxf", "svg"), "colors is supported for DXF and SVG drawings only"),
    "edges": (("step",), "edges is supported for CAD models (STEP) only"),
}
# Largest coordinate for which a specified unit is plausible [m]; surveys have large coordinates.
LARGEST_PART = 1000.0
# Coordinates of tables above this get a note, because no arm has such a reach [m].
FARTHEST_ARM = 10.0
# Extensions of job files.
YAML = (".yaml", ".yml")
# Module and function of the reader for each extension.
READERS = {
    ".dxf": ("dxf", "read_dxf"),
    ".svg": ("svg", "read_svg"),
    **dict.fromkeys((".ngc", ".nc", ".gcode", ".tap", ".cnc"), ("gcode", "read_gcode")),
    ".csv": ("waypoint_table", "read_waypoints"),
    **dict.fromkeys(MODELS, ("step", "read_step")),
}


@checked
def read_path(
    file: str | FilePath,
    options: ReadOptions = ReadOptions(),
    *,
    frame: Frame | None = None,
    progress: Progress | None = None,
) -> Program:
    """Read the program in a drawing (DXF, SVG), G-code, a table of waypoints or a CAD model (STEP).

    Lines and arcs are not changed; other curves become tangent arcs, or splines for a model. If the
    program has one contour, `program.path` is its path.

    >>> program = ac.read_path("part.csv", frame=ac.Frame((0.0, 0.1, 0.0)))
    >>> len(program.contours)
    1

    Args:
        file: Path of the file; the extension selects the reader.
        options: Options for reading, such as ReadOptions(units="mm", layers=["CUT"]).
        frame: Frame of the drawing. If it moves the drawing out of the plane z = 0, the program is
            in space.
        progress: Function that is called with the name of the file and the fraction that has been
            read. Tables of waypoints report no progress.

    Raises:
        InvalidInput: The file cannot be read, or does not support an option. The message contains
            the line, the element or the row.
    """
    location, suffix = find_reader(file)
    module, name = READERS[suffix]
    for option, (modules, purpose) in FORMAT_OPTIONS.items():
        checks.raise_if(
            bool(getattr(options, option)) and module not in modules,
            f"{purpose}, so it is not valid for {location.name}. Remove the option.",
        )
    read = getattr(importlib.import_module(f"armcontour.files.drawings.{module}"), name)
    if module in WITH_PROGRESS:
        read = partial(read, progress=progress)
    content = read_bytes(location, "file", maximum=MAX_FILE_SIZE)
    read = partial(read, content, source=location.name)
    program: Program = read(options=options)
    if program.other_layers:
        program = _number_in_drawing(program, lambda: read(options=replace(options, layers=None)))
    factor = options.scale
    unit = options.unit
    program = _select(program, options)
    far = _farthest(program) * factor
    checks.raise_if(
        far > LARGEST_PART and unit is not None,
        f"With the unit {options.units}, {program.source} has coordinates up to {far:.4g} m, but "
        f"at most {LARGEST_PART:g} m are allowed. Check the unit, or move the part to the origin.",
    )
    if far > FARTHEST_ARM and (unit, module) == (None, "waypoint_table"):
        note = (
            f"the coordinates of {program.source} are up to {far:.4g} m, which is more than the "
            "reach of an arm. Columns without a unit are in metres. If the coordinates are in mm, "
            "write x [mm] in the heading, or specify `units: mm` or --units mm."
        )
        program = replace(program, notes=(*program.notes, note))
    if options.ignore_z:
        program = program.without_z()
    if frame is None and factor == 1.0:
        return program
    program = program.placed(Frame() if frame is None else frame, scale=factor)
    _check_scaled_size(program, factor)
    return program


def _number_in_drawing(program: Program, read_all: Callable[[], Program]) -> Program:
    """Return the program with the contours of other layers, and with numbers that include these.

    The program is unchanged if its drawing can only be read without the other layers.
    """
    try:
        drawn = read_all().contours
    except InvalidInput:
        return program
    layers = {x.layer for x in program.contours}
    numbers = [x.number for x in drawn if x.layer in layers]
    if len(numbers) != len(program.contours):
        return program
    pairs = zip(program.contours, numbers, strict=True)
    moves = tuple(replace(contour, number=number) for contour, number in pairs)
    return replace(program, moves=moves, left_out=tuple(x for x in drawn if x.layer not in layers))


def _select(program: Program, options: ReadOptions) -> Program:
    """Return the program with only the contours that the options select by layer and name."""
    layers = options.layers
    if isinstance(layers, Mapping):
        # A mapping contains settings for layers, and a drawing need not have all these layers.
        existing = {x.layer for x in program.contours}
        notes = [f"the layer {x!r} has no contour." for x in layers if x not in existing]
        program = replace(program, notes=(*program.notes, *notes))
        layers = [x for x in layers if x in existing] or list(layers)
    return program.selected(layers=layers, names=options.names)


def _farthest(program: Program) -> float:
    """Return the largest absolute coordinate of all contours [m]."""
    return max(float(np.abs(x.path.vertices).max()) for x in program.contours)


def _check_scaled_size(program: Program, factor: float) -> None:
    """Check that coordinates and contour lengths are within the limits after scaling."""
    far = _farthest(program)
    short = min(x.path.length for x in program.contours)
    if not far <= MAX_COORDINATE:
        problem = f"coordinates up to {far:.3g} m, but at most {MAX_COORDINATE:g} m are allowed"
    elif short <= REPEATED_POINT:
        problem = f"a contour of {short:.3g} m, but the length must exceed {REPEATED_POINT:g} m"
    else:
        return
    raise InvalidInput(
        f"With the scale {factor:g}, {program.source} has {problem}. Check the scale."
    )


def find_reader(file: str | FilePath) -> tuple[FilePath, str]:
    """Return the path and the lower-case extension of a file, which must have a reader."""
    location = FilePath(file)
    suffix = location.suffix.lower()
    if suffix == ".dwg":
        raise FileError(f"{location.name} is a DWG file, which is not supported. Save it as DXF.")
    if suffix not in READERS:
        raise FileError(
            f"{location.name} cannot be read as a path. Its extension must be one of "
            f"{', '.join(READERS)}."
        )
    return location, suffix
