"""Entry point `read_path`: a file becomes a program, by its extension."""

from __future__ import annotations

import importlib
import re
from collections.abc import Callable, Collection, Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour import _checks
from armcontour.errors import InvalidInput
from armcontour.frames import Frame
from armcontour.geometry.segments import REPEATED_POINT
from armcontour.io.drawings.reading import FARTHEST, Reading, bytes_of
from armcontour.io.units import parse
from armcontour.program import Program

# Which module and function reads what.
READERS: dict[str, tuple[str, str, dict[str, Any]]] = {
    ".dxf": ("dxf", "read_dxf", {}),
    ".svg": ("svg", "read_svg", {}),
    **dict.fromkeys((".ngc", ".nc", ".gcode", ".tap", ".cnc"), ("gcode", "read_gcode", {})),
    ".csv": ("waypoints", "read_waypoints", {"kind": "csv"}),
    ".parquet": ("waypoints", "read_waypoints", {"kind": "parquet"}),
}
# What of G-code may be left out by name.
WORD = re.compile(r"[GM]\d{1,4}(\.\d)?|[ABCDEHLPQSTUVW]")
# Those that tell how far they are.
TELLING = ("gcode",)


def read_path(
    file: str | FilePath,
    *,
    units: str | float | None = None,
    scale: float = 1.0,
    frame: Frame | None = None,
    layers: Collection[str] | None = None,
    names: Collection[str] | None = None,
    flat: bool = False,
    chord_tolerance: float = 1e-5,
    join_tolerance: float = 1e-5,
    unknown: str | Mapping[str, Collection[str]] = "refuse",
    offsets: str = "file",
    progress: Callable[[float], None] | None = None,
) -> Program:
    """The program in a drawing (DXF, SVG), in G-code, or in a table of waypoints (CSV, Parquet).

    Lines and arcs stay what they are, other curves become tangent arcs. A program of one contour
    gives its path as `program.path`.

    Args:
        file: The file; its extension says what it is.
        units: Unit of its lengths, such as "mm", or how many metres it is; by default what the
            file says. A column of a table that has a unit of its own keeps that.
        scale: Factor of all lengths.
        frame: Where the drawing lies; a frame that lifts or tilts it makes it one in space.
        layers: Only contours on these; of a mapping, those of its keys that there are.
        names: Only contours with these names: ids of elements, handles of entities, "line 12" of
            G-code.
        flat: Leave z out.
        chord_tolerance: Largest distance between a curve and the arcs that it becomes [m].
        join_tolerance: Ends nearer than this are one point [m].
        unknown: "refuse" what the reader does not know, or "skip" it with a note; of G-code,
            {"skip": ["M6", "T"]} leaves out these words and codes.
        offsets: Of G-code, "zero" states that all offsets in the table of the controller are zero;
            "file" reads only those that the file gives.
        progress: Called with the share that is read.

    Raises:
        InvalidInput: A file that cannot be read; names the line, the element or the row.
    """
    if not isinstance(file, str | FilePath):
        raise InvalidInput(f"read_path needs the path of a file, not {type(file).__name__}.")
    place = FilePath(file)
    suffix = place.suffix.lower()
    if suffix not in READERS:
        raise InvalidInput(
            f"{place.name} is no file that can be read as a path: its extension must be one of "
            f"{', '.join(READERS)}."
        )
    reading = Reading(
        unit=_unit(units),
        chord_tolerance=chord_tolerance,
        join_tolerance=join_tolerance,
        unknown=unknown if isinstance(unknown, str) else "refuse",
        skip=_words_of(unknown, suffix),
        offsets=offsets,
        layers=_names_of(layers),
    )
    factor = _checks.positive("scale", scale)
    module, name, options = READERS[suffix]
    read = getattr(importlib.import_module(f"armcontour.io.drawings.{module}"), name)
    if module in TELLING:
        read = partial(read, progress=progress, folder=place.parent)
    program: Program = read(bytes_of(place), source=place.name, reading=reading, **options)
    if isinstance(layers, Mapping):
        # Settings for layers, of which not every drawing has all.
        there = {x.layer for x in program.contours}
        notes = [f"there is nothing on the layer {x!r}." for x in layers if x not in there]
        program = replace(program, notes=(*program.notes, *notes))
        layers = [x for x in layers if x in there] or list(layers)
    program = program.selected(layers=layers, names=names)
    if flat:
        program = program.without_z()
    if frame is None and factor == 1.0:
        return program
    program = program.placed(Frame() if frame is None else frame, scale=factor)
    _refuse_odd_size(program, factor)
    return program


def _words_of(unknown: Any, suffix: str) -> frozenset[str]:
    """Words and codes of G-code to leave out, such as G43 or T, from {"skip": [...]}."""
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


def _names_of(layers: Collection[str] | None) -> frozenset[str] | None:
    if layers is None or isinstance(layers, str):
        return None if layers is None else frozenset((layers,))
    return frozenset(layers) if isinstance(layers, Collection) else None


def _refuse_odd_size(program: Program, factor: float) -> None:
    """Refuse a scale that makes of a drawing what no reader would give."""
    far = max(float(np.abs(x.path.vertices).max()) for x in program.contours)
    short = min(x.path.length for x in program.contours)
    if not far <= FARTHEST:
        said, limit = f"reaches {far:.3g} m far", f"more than {FARTHEST:g} m"
    elif short <= REPEATED_POINT:
        said, limit = f"has a contour of {short:.3g} m", f"no more than {REPEATED_POINT:g} m"
    else:
        return
    raise InvalidInput(
        f"With the scale {factor:g} {program.source} {said}, {limit}: check the scale."
    )


def _unit(units: str | float | None) -> float | None:
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
