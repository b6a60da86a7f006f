"""Make the process of a job file: leads, overlaps and events of its contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from armcontour.geometry import Path
from armcontour.io.job_model import PathModel
from armcontour.io.job_path import part_of
from armcontour.program import Event, Process, Program


def add_process(
    path: Path | Program, process: Process | None, drawing: PathModel
) -> tuple[Path | Program, Process]:
    """The path or program of a job, and its process.

    Raises:
        InvalidInput: Invalid values of the process.
    """
    if drawing.file is None and process is None:
        return path, Process()
    program = Program.of(path)
    if drawing.file is None:
        # The process sets the start point of a closed path of points, as for a drawing.
        contours = (dataclasses.replace(x, keep_start=False) for x in program.contours)
        program = Program(moves=tuple(contours))
    process = process or Process()
    layers = {x.layer for x in program.contours}
    # A cell is for many drawings, which need not have all that it asks for.
    notes = [
        f"process.by_layer: no contour is on the layer {x!r}."
        for x in process.by_layer
        if x not in layers
    ]
    if process.off_between:
        switched = _switched(program, process)
        names = ", ".join(sorted(switched)) or "none"
        notes += [
            f"process.off_between: nothing switches the output {x!r}, so it is not switched off "
            f"during rapids either; outputs that are switched: {names}."
            for x in process.off_between
            if x not in switched
        ]
    if process.tabs is not None and not any(x.closed for x in program.contours):
        notes.append("process.tabs: no contour is closed, so there are no tabs.")
    if notes:
        program = dataclasses.replace(program, notes=(*program.notes, *notes))
    return program, _on_drawing(process, drawing, layers)


def _switched(program: Program, process: Process) -> set[str]:
    """Names of the outputs that a program or its process switches."""
    found = {x.name for x in program.moves if isinstance(x, Event)}
    for x in program.contours:
        own = process.of_layer(x.layer)
        found |= {y.name for y in (*x.events, *own.events)}
        found |= set() if own.switch is None else {own.switch.name}
    return found


def _on_drawing(process: Process, drawing: PathModel, there: Collection[str]) -> Process:
    """A process with the vertical direction and the speeds of layers from a job's path.

    Args:
        process: The process.
        drawing: The key `path` of the job.
        there: Names of the layers in the drawing.
    """
    layers = drawing.layers if isinstance(drawing.layers, dict) else {}
    # The reader has noted layers that are missing in the file.
    known = {name: x for name, x in layers.items() if name in there}
    own = {name: x for name, x in process.by_layer.items() if name in there}
    return dataclasses.replace(
        process, up=part_of(drawing).rotation[:, 2], layers=known, by_layer=own
    )
