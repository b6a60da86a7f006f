"""The process of a job file: the values of its contours and layers, and notes on unused keys."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection
from typing import Any

from armcontour.core.errors import InvalidInput
from armcontour.core.text import key_text
from armcontour.files.job_model import PathModel
from armcontour.files.job_path import CONTOUR_LIMITS, find_contours, part_of
from armcontour.geometry import Path
from armcontour.program import Event, Process, Program

# Keys that choose what is executed of a path, and how for a first run. They leave the path itself
# as it is, so that a place on it is the same with and without them.
EXECUTION_KEYS = ("resume_at", "rejoin", "only", "off", "lift")


def add_process(
    path: Path | Program, process: Process | None, drawing: PathModel
) -> tuple[Path | Program, Process]:
    """Return a job's program with notes on unused process keys, and the complete process.

    Args:
        path: Path or program. Without a drawing and a process, it is returned unchanged.
        process: Key `process`; None if it is missing.
        drawing: Keys of the path, with values of layers and contours.

    Raises:
        InvalidInput: A value of a contour is wrong. The error has its key path.
    """
    if isinstance(path, Path) and process is None:
        return path, Process()
    program = Program.from_path(path)
    if drawing.file is None and process is not None and _changes_path(process):
        # As for a drawing, the process selects where a closed path of points starts.
        contours = (dataclasses.replace(x, keep_start=False) for x in program.contours)
        program = Program(moves=tuple(contours))
    process = _set_contour_values(program, process or Process(), drawing)
    notes = _note_unused_keys(process, program)
    if notes:
        program = dataclasses.replace(program, notes=(*program.notes, *notes))
    return program, _on_drawing(process, drawing, {x.layer for x in program.contours})


def _changes_path(process: Process) -> bool:
    """Return whether any key is set except those in EXECUTION_KEYS."""
    plain = Process()
    names = [x.name for x in dataclasses.fields(Process) if x.init and x.name != "up"]
    return any(
        getattr(process, name) != getattr(plain, name)
        for name in names
        if name not in EXECUTION_KEYS
    )


def _set_contour_values(program: Program, process: Process, drawing: PathModel) -> Process:
    """Return the process with the values of the key `path.contours`."""
    if not drawing.contours:
        return process
    key_of_contour, _ = find_contours(program, drawing)
    by_contour = dict[int, Any]()
    for contour in program.contours:
        values = drawing.contours.get(key_of_contour.get(contour.number, ""), {})
        own = {x: y for x, y in values.items() if x not in CONTOUR_LIMITS}
        if own:
            by_contour[contour.number] = {**process.by_layer.get(contour.layer, {}), **own}
    try:
        return dataclasses.replace(process, by_contour=by_contour)
    except InvalidInput as error:
        _, number, *inner = error.key
        error.key = ("path", "contours", str(key_of_contour[int(number)]), *inner)
        raise error.with_location(key_text(error.key[:3])) from None


def _note_unused_keys(process: Process, program: Program) -> list[str]:
    """Note process keys that have no effect on the drawing; a cell often has such keys."""
    layers = {x.layer for x in program.contours}
    notes = [
        f"process.by_layer has the layer {x!r}, but no contour is on this layer."
        for x in process.by_layer
        if x not in layers
    ]
    if process.off_between:
        switched = _switched(program, process)
        names = ", ".join(sorted(switched)) or "none"
        notes += [
            f"process.off_between has the output {x!r}, but the program does not switch this "
            f"output, so that it is not switched off during rapids. Switched outputs: {names}."
            for x in process.off_between
            if x not in switched
        ]
    if process.tabs is not None and not any(x.closed for x in program.contours):
        notes.append("process.tabs has no effect, because no contour is closed.")
    return notes


def _switched(program: Program, process: Process) -> set[str]:
    """Return the names of the outputs that a program or its process switches."""
    names = {x.name for x in program.moves if isinstance(x, Event)}
    for contour in program.contours:
        contour_process = process.of_contour(contour)
        names |= {y.name for y in (*contour.events, *contour_process.events)}
        names |= set() if contour_process.switch is None else {contour_process.switch.name}
    return names


def _on_drawing(process: Process, drawing: PathModel, existing: Collection[str]) -> Process:
    """Add the vertical direction and the limits of layers, from the key `path`, to a process."""
    layers = drawing.layers if isinstance(drawing.layers, dict) else {}
    # The reader of the drawing has already reported layers that are missing in the file.
    layer_limits = {name: x for name, x in layers.items() if name in existing}
    by_layer = {name: x for name, x in process.by_layer.items() if name in existing}
    return dataclasses.replace(
        process, up=part_of(drawing).rotation[:, 2], layers=layer_limits, by_layer=by_layer
    )
