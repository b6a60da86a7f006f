"""What a job file adds to its contours."""

from __future__ import annotations

import dataclasses
from collections.abc import Collection

from armcontour.frames import Frame
from armcontour.geometry import Path
from armcontour.io.job_arm import frame_of
from armcontour.io.job_model import PathModel
from armcontour.program import Contour, Process, Program, prepare


def with_process(
    path: Path | Program, process: Process | None, drawing: PathModel
) -> tuple[Path | Program, Process]:
    """The path or program of a job, and its process; a plain contour of a file is a path.

    Raises:
        InvalidInput: Values that make no process.
    """
    if isinstance(path, Path):
        if process is None:
            return path, Process()
        path = Program(moves=(Contour(path=path),))
    process = _on_drawing(process or Process(), drawing, {x.layer for x in path.contours})
    if process.automatic:
        return path, process
    # Leads need the arm only where their length is automatic: what can go wrong does so now.
    done = prepare(path, process)
    if len(done.moves) == 1 and not done.notes:
        (only,) = done.contours
        begin, end = only.work or (0.0, only.path.length)
        if not only.events and (begin, end) == (0.0, only.path.length):
            return only.path, Process()
    return path, process


def _on_drawing(process: Process, drawing: PathModel, there: Collection[str]) -> Process:
    """A process with what the path of a job says of it: where up is, and the speeds of layers."""
    frame = Frame() if drawing.frame is None else frame_of("path.frame", drawing.frame)
    layers = drawing.layers if isinstance(drawing.layers, dict) else {}
    # Reading has told of those that the file has not.
    known = {name: x for name, x in layers.items() if name in there}
    return dataclasses.replace(process, up=frame.rotation[:, 2], layers=known)
