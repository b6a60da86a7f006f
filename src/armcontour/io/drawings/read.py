"""The function `read_path`, which reads a file into a program by its extension."""

from __future__ import annotations

import importlib
import re
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour import _checks
from armcontour._progress import Progress
from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.geometry.rounding import Continuity
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings.endings import READERS, find_reader
from armcontour.io.drawings.reading import FARTHEST, Reading, bytes_of, color_set
from armcontour.io.units import parse
from armcontour.program import Program, smooth_curvature

# Modules whose readers report their progress.
WITH_PROGRESS = ("gcode", "dxf", "svg")
# Codes and letters of G-code that may be left out by name.
WORD = re.compile(r"[GM]\d{1,4}(\.\d)?|[ABCDEHLPQSTUVW]")
# Beyond this a stated unit is wrong; coordinates of surveys may be far from their origin [m].
LARGEST_PART = 1000.0
# Farther than any arm reaches [m].
FARTHEST_ARM = 10.0


@_checks.checked
def read_path(
    file: str | FilePath,
    *,
    units: str | float | None = None,
    scale: float = 1.0,
    frame: Frame | None = None,
    layers: Collection[str] | None = None,
    names: Collection[str] | None = None,
    colors: Collection[str | int] | None = None,
    flat: bool = False,
    chord_tolerance: float = 1e-5,
    join_tolerance: float = 1e-5,
    mend_vertices: float | None = None,
    smooth_axes: float = 0.0,
    columns: str | None = None,
    unknown: str | Mapping[str, Collection[str]] = "refuse",
    texts: str = "leave_out",
    tools: Mapping[int, float] | None = None,
    continuity: Continuity = "tangent",
    progress: Progress | None = None,
) -> Program:
    """Read the program in a drawing (DXF, SVG), in G-code, or in a table of waypoints.

    Lines and arcs are kept, other curves become tangent arcs. The path of a program with one
    contour is `program.path`.

    Args:
        file: The file; the extension decides how it is read.
        units: Unit of the file's lengths, such as "mm", or its length in metres; by default the
            unit that the file states. A column of a table with a unit of its own keeps that unit.
        scale: Factor of all lengths.
        frame: Frame of the drawing; if it lifts or tilts the drawing, the program is in space.
        layers: Only contours on these layers are read. Unknown keys of a mapping give a note.
        names: Only contours with these names are read: ids of elements (SVG), handles of entities
            (DXF), "line 12" (G-code).
        colors: Only entities of these colours are read (DXF), or elements with strokes of these
            colours (SVG), such as "red" or "#00ff00"; for DXF also AutoCAD's numbers, such as 1.
        flat: Whether z is left out.
        chord_tolerance: Largest distance between a curve and the arcs that replace it [m].
        join_tolerance: Ends closer than this are one point [m].
        mend_vertices: Distance by which printing can have moved a point [m]: vertices that it has
            bent are made tangent again within this distance, with a note. None takes it from the
            file's decimals, up to the chord tolerance; 0 leaves all vertices as they are.
        smooth_axes: For tables of waypoints with tool axes, the largest angle by which these are
            turned so that they turn smoothly [rad], as measured ones do not; 0 leaves them.
        columns: For waypoints in CSV, names of the columns in place of the first line, or of a line
            that is missing, such as "x [mm],y [mm],-"; "-" leaves a column out.
        unknown: Whether to "refuse" or "skip" (with a note) content that the reader does not know;
            for G-code, {"skip": ["M6", "T"]} leaves out these words and codes.
        texts: For DXF, "contours" draws the letters of TEXT through a font of this machine, with a
            note; "leave_out" leaves texts out with a note.
        tools: For G41 and G42 of G-code, diameters of tools [m] by their numbers, such as
            {1: 0.003}; a negative one puts the tool on the other side.
        continuity: "curvature" puts transitions where the curvature jumps without a corner, for
            motions with a limit of jerk (`smooth_curvature`): curves then become arcs within half
            of the chord tolerance, and transitions leave lines and arcs by the other half at most.
            "tangent" keeps lines and arcs.
        progress: Called from time to time with the name of the file and the fraction of it that is
            read, where the reader can tell.

    Raises:
        InvalidInput: The file cannot be read; the message names the line, the element or the row.
    """
    location, suffix = find_reader(file)
    reading = Reading(
        unit=_unit(units),
        chord_tolerance=chord_tolerance,
        join_tolerance=join_tolerance,
        mend_vertices=mend_vertices,
        smooth_axes=smooth_axes,
        columns=columns,
        unknown=unknown if isinstance(unknown, str) else "refuse",
        skip=_words_to_skip(unknown, suffix),
        texts=texts,
        tools={} if tools is None else tools,
        layers=_layer_set(layers),
        layer_tolerances=_layer_tolerances(layers),
        colors=_color_set(colors, suffix),
        continuity=continuity,
    )
    factor = _checks.positive("scale", scale)
    # The scale is that of the file's lengths, and tools are as they are.
    reading = replace(reading, tools={n: x / factor for n, x in reading.tools.items()})
    module, name = READERS[suffix]
    axes = "smooth_axes (path.smooth_axes) is for tables of waypoints with tool axes"
    headings = "columns (path.columns, --waypoint-columns) is for waypoints in CSV"
    for given, purpose in ((reading.smooth_axes != 0.0, axes), (columns is not None, headings)):
        none = f"{purpose}, and {location.name} is none: leave it out."
        _checks.refuse_if(given and module != "waypoints", none)
    read = getattr(importlib.import_module(f"armcontour.io.drawings.{module}"), name)
    if module in WITH_PROGRESS:
        read = partial(read, progress=progress)
    fitting = replace(reading, chord_tolerance=reading.fit_tolerance)
    program: Program = read(bytes_of(location), source=location.name, reading=fitting)
    program = _select(program, layers, names)
    far = _farthest(program) * factor
    _checks.refuse_if(
        far > LARGEST_PART and reading.unit is not None,
        f"With the unit {units}, {program.source} reaches {far:.4g} m from its origin, more than "
        f"{LARGEST_PART:g} m: check the unit.",
    )
    if far > FARTHEST_ARM and (reading.unit, module) == (None, "waypoints"):
        note = (
            f"the coordinates of {program.source} reach {far:.4g} m from their origin, farther "
            "than arms do. Columns without a unit are in metres: if these are mm, write x [mm], or "
            "give `units: mm` or --units mm."
        )
        program = replace(program, notes=(*program.notes, note))
    if flat:
        program = program.without_z()
    if continuity == "curvature":
        left = reading.chord_tolerance - reading.fit_tolerance
        program = smooth_curvature(program, tolerance=left)
    if frame is None and factor == 1.0:
        return program
    program = program.placed(Frame() if frame is None else frame, scale=factor)
    _refuse_odd_size(program, factor)
    return program


def _select(
    program: Program, layers: Collection[str] | None, names: Collection[str] | None
) -> Program:
    """The program's contours on some layers and with some names.

    Raises:
        InvalidInput: A layer or a name does not exist.
    """
    if isinstance(layers, Mapping):
        # The mapping holds settings for layers; a drawing need not have all of these layers.
        existing = {x.layer for x in program.contours}
        notes = [f"there is nothing on the layer {x!r}." for x in layers if x not in existing]
        program = replace(program, notes=(*program.notes, *notes))
        layers = [x for x in layers if x in existing] or list(layers)
    return program.selected(layers=layers, names=names)


def _words_to_skip(unknown: Any, suffix: str) -> frozenset[str]:
    """Words and codes of G-code to leave out, such as G43 or T, from {"skip": [...]}.

    Raises:
        InvalidInput: The argument has another form, a word cannot be left out, or the file is no
            G-code.
    """
    if isinstance(unknown, str):
        return frozenset()
    words = unknown.get("skip") if isinstance(unknown, Mapping) and len(unknown) == 1 else None
    if isinstance(words, str) or not isinstance(words, Collection):
        raise InvalidInput(
            'unknown must be "refuse", "skip", or {"skip": [...]} with the words of G-code to '
            "leave out, such as M6 or T."
        )
    if READERS[suffix][0] != "gcode":
        raise InvalidInput('unknown: {"skip": [...]} is for G-code: other drawings take "skip".')
    found = {str(x).strip().upper() for x in words}
    wrong = next((x for x in sorted(found) if WORD.fullmatch(x) is None), None)
    if wrong is not None:
        raise InvalidInput(
            f"unknown: {{skip: ...}} names {wrong!r}, which cannot be left out: it takes codes "
            "such as G43 or M6, and letters other than X, Y, Z, I, J, K, R, F, N and O."
        )
    return frozenset(re.sub(r"(?<=[GM])0+(?=\d)", "", x) for x in found)


def _color_set(colors: Collection[str | int] | None, suffix: str) -> frozenset[str] | None:
    """The colours that are read; None for all colours.

    Raises:
        InvalidInput: The colours are no list, or the file has none.
    """
    if colors is not None and READERS[suffix][0] not in ("dxf", "svg"):
        raise InvalidInput("colors chooses among the contours of DXF and SVG drawings only.")
    return color_set(colors)


def _layer_set(layers: Collection[str] | None) -> frozenset[str] | None:
    """The names of layers as a set, of a single name too; None for all layers."""
    if layers is None:
        return None
    names = [layers] if isinstance(layers, str) else layers
    return frozenset(
        _checks.check_names("layers", list(names) if isinstance(names, Mapping) else names)
    )


def _layer_tolerances(layers: Collection[str] | None) -> dict[str, float]:
    """Largest corner errors on layers that have one [m], from a mapping of their settings."""
    settings = layers.items() if isinstance(layers, Mapping) else ()
    return {x: y.tolerance for x, y in settings if getattr(y, "tolerance", None) is not None}


def _farthest(program: Program) -> float:
    """The largest coordinate of all contours [m]."""
    return max(float(np.abs(x.path.vertices).max()) for x in program.contours)


def _refuse_odd_size(program: Program, factor: float) -> None:
    """Refuse a scale after which coordinates are too large or contours too short.

    Raises:
        InvalidInput: The scaled program is beyond the limits that the readers keep.
    """
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


def _unit(units: str | float | None) -> float | None:
    """Length of a unit [m], None if none is given.

    Raises:
        InvalidInput: The text is no unit of length, or the number is not above zero.
    """
    if units is None:
        return None
    if isinstance(units, str):
        try:
            return parse(f"1 {units}", "m")
        except ValueError:
            raise InvalidInput(
                f"units must be a unit of length such as mm, not {units!r}."
            ) from None
    return _checks.positive("units", units, "m")
