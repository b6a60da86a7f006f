"""Which length of a job probably lacks its unit, where a path lies farther away than arms reach."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from armcontour.io.job_arm import frame_of
from armcontour.io.job_model import ArmModel, JobModel, PathModel
from armcontour.io.problems import place
from armcontour.program import Program


def hint_at_length(model: JobModel, program: Program) -> str:
    """The end of a sentence on a path that lies far away: the longest length, and how to write it.

    Args:
        model: The keys of the job file.
        program: The program of its path, in its frame.
    """
    lengths = [*_written(model.path), *_of_arm(model.arm)]
    key, found = max(lengths, key=lambda x: _size(x[1]), default=("", ()))
    if model.path.file is not None and _drawn(model.path, program) >= _size(found):
        return (
            f"; the lengths of {program.source} seem to have another unit: give it, such as "
            "`units: mm` or --units mm"
        )
    if not key:
        return ""
    values = ", ".join(f"{x:.6g}" for x in found)
    # Lengths below a metre have their unit already, or are right.
    mend = ", ".join(f"{x if abs(x) >= 1 else x * 1e3:.6g} mm" if x else "0" for x in found)
    return f"; {key} is [{values}] m: if these are mm, write [{mend}]"


def _written(path: PathModel) -> Iterator[tuple[str, Sequence[float]]]:
    """Keys of a path and the lengths that they have [m]."""
    if path.frame is not None and path.frame.position is not None:
        yield "path.frame.position", path.frame.position
    for i, point in enumerate(path.points or ()):
        yield place(("path", "points", i)), point
    if path.start is not None:
        yield "path.start", path.start
    for i, x in enumerate(path.segments or ()):
        for name in ("to", "via", "center"):
            if (point := getattr(x, name)) is not None:
                yield place(("path", "segments", i, name)), point
    for i, point in enumerate(() if path.spline is None else path.spline.points):
        yield place(("path", "spline", "points", i)), point
    for name in ("column_spacing", "row_spacing"):
        if path.repeat is not None and (spacing := getattr(path.repeat, name)) is not None:
            yield f"path.repeat.{name}", [spacing]


def _of_arm(arm: str | ArmModel) -> Iterator[tuple[str, Sequence[float]]]:
    """Keys of an arm and the lengths that they have [m]."""
    if isinstance(arm, str):
        return
    for name in ("work", "tool"):
        frame = getattr(arm, name)
        if frame is not None and frame.position is not None:
            yield f"arm.{name}.position", frame.position


def _size(lengths: Sequence[float]) -> float:
    return max(map(abs, lengths), default=0.0)


def _drawn(path: PathModel, program: Program) -> float:
    """The largest coordinate in a drawing, before its frame places it [m]."""
    origin = np.zeros(3) if path.frame is None else frame_of("path.frame", path.frame).position
    return max(
        float(np.abs(x.path.vertices - origin[: x.path.dimension]).max()) for x in program.contours
    )
