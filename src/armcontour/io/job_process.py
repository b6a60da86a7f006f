"""What a job file adds to its contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from armcontour.frames import Frame
from armcontour.geometry import Path
from armcontour.io.job_arm import frame_of
from armcontour.io.job_model import PathModel
from armcontour.program import Process, Program


def with_process(
    path: Path | Program, process: Process | None, drawing: PathModel
) -> tuple[Path | Program, Process]:
    """The path or program of a job, and its process.

    Raises:
        InvalidInput: Values that make no process.
    """
    if drawing.file is None and process is None:
        return path, Process()
    program = Program.of(path)
    if drawing.file is None:
        # The process says where a closed path of points begins, as that of a drawing.
        contours = (dataclasses.replace(x, keep_start=False) for x in program.contours)
        program = Program(moves=tuple(contours))
    layers = {x.layer for x in program.contours}
    return program, _on_drawing(process or Process(), drawing, layers)


def _on_drawing(process: Process, drawing: PathModel, there: Collection[str]) -> Process:
    """A process with what the path of a job says of it: where up is, and the speeds of layers."""
    frame = Frame() if drawing.frame is None else frame_of("path.frame", drawing.frame)
    layers = drawing.layers if isinstance(drawing.layers, dict) else {}
    # Reading has told of those that the file has not.
    known = {name: x for name, x in layers.items() if name in there}
    return dataclasses.replace(process, up=frame.rotation[:, 2], layers=known)
