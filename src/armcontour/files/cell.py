"""Cells: job files without a path, which are combined with a drawing."""

from __future__ import annotations

import os
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from armcontour.core import checks
from armcontour.core.checks import LONGEST_NAME
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.fields import checked
from armcontour.core.progress import Progress
from armcontour.core.quantities import PartialFields
from armcontour.core.text import make_printable, shorten
from armcontour.files.drawings.read import YAML
from armcontour.files.job_arm import arm_of
from armcontour.files.job_file import file_context, job_of, job_text, parse_job, read_data
from armcontour.files.job_model import CellModel, PathModel
from armcontour.files.job_path import part_of, read_drawing
from armcontour.files.job_text_edits import REMOVE, move_files
from armcontour.files.keys import read_keys
from armcontour.files.patch import Patch, apply_patch, write_patch
from armcontour.files.scene_file import scene_of
from armcontour.jobs import Job
from armcontour.jobs.job import LONGEST_TITLE
from armcontour.robot import Arm
from armcontour.robot.scene import Scene

# Keys of `path` that define the geometry of a job. A drawing replaces them.
GEOMETRY_KEYS = ("points", "start", "segments")


def cell_names() -> tuple[str, ...]:
    """Names of the built-in cells."""
    files = (resources.files("armcontour.files") / "cells").iterdir()
    return tuple(sorted(x.name.removesuffix(".yaml") for x in files if x.name.endswith(".yaml")))


def cell_text(name: str) -> str:
    """Text of a built-in cell, including its comments. A cell is a job file without a path."""
    names = cell_names()
    if name not in names:
        raise InvalidInput(
            f"There is no cell {name!r}. Name a job file (.yaml), or one of {', '.join(names)}."
        )
    file = resources.files("armcontour.files") / "cells" / f"{name}.yaml"
    return file.read_text(encoding="utf-8")


@checked
def read_job(
    file: str | FilePath,
    *,
    cell: str | FilePath | None = None,
    patch: Patch | None = None,
    reading: Progress | None = None,
) -> Job:
    """Read a job from a YAML file, or from a drawing and a cell.

    >>> job = ac.read_job("job.yaml")
    >>> job.name
    'corner'
    >>> ac.read_job("part.csv", cell="pmk3s").arm.name
    'PMK-3s'

    Args:
        file: The job file; with a cell, a drawing, G-code or waypoints.
        cell: Cell for a drawing: a built-in cell such as "ur5e", or a job file, whose path the
            drawing replaces.
        patch: Values by keys that replace the file's own, such as {("limits", "speed"): 0.2}.
        reading: Called with the progress of reading the job's drawing, as in `read_path`.

    Raises:
        InvalidInput: The file does not exist or is not YAML, a key is unknown, a value has no unit,
            or the values are invalid; the message names the key.
    """
    location = checks.read_file_path("read_job", file)
    if cell is not None:
        return read_cell(cell, location, patch=patch, reading=reading)
    return parse_job(
        job_text(location),
        source=location.name,
        folder=location.parent,
        patch=patch,
        reading=reading,
    )


def read_cell(
    cell: str | FilePath,
    drawing: str | FilePath,
    *,
    patch: Patch | None = None,
    reading: Progress | None = None,
) -> Job:
    """Make a job from a cell or job file and a drawing; `patch` overrides keys."""
    # The drawing replaces the geometry of a job file, but not its frame and its reader options.
    data, source, folder = cell_data(cell, drawing, patch)
    with error_context(source):
        model: CellModel = read_keys(CellModel, data)
    # Messages of errors in the drawing name only the drawing, not the cell.
    program = read_drawing(model.path, str(model.path.file), folder, reading)
    with error_context(source):
        return job_of(model, folder, reading, program)


def read_cell_scene(cell: str | FilePath) -> tuple[Arm | None, Scene]:
    """Arm (None if not specified) and scene of a cell or job file; other keys may be missing."""
    text, source, folder = _read_cell_text(str(cell))
    data = read_data(text, source)
    with file_context(text, source):
        specified = read_keys(PartialFields(CellModel), data)
    model, path, scene = (
        specified.get("arm"),
        specified.get("path", PathModel()),
        specified.get("scene"),
    )
    with error_context(source):
        arm = None if model is None else arm_of(model, folder)
        return arm, Scene() if scene is None else scene_of(scene, folder, part_of(path))


def cell_data(
    cell: str | FilePath, drawing: str | FilePath, patch: Patch | None = None
) -> tuple[dict[str, Any], str, FilePath]:
    """Job data of a cell with a drawing, the cell's name for messages, and the cell's folder."""
    text, source, folder = _read_cell_text(str(cell))
    data, location = read_data(text, source), FilePath(drawing)
    drawn = drawing_patch(location, str(location.absolute()))
    with error_context(source):
        return apply_patch(data, {**drawn, **(patch or {})}), source, folder


def drawing_text(cell: str | FilePath, drawing: str | FilePath, to: FilePath) -> str:
    """Text of a job file in the folder `to` for a cell and a drawing, with the cell's comments."""
    text, source, folder = _read_cell_text(str(cell))
    location = FilePath(drawing).absolute()
    file = FilePath(os.path.relpath(location, to)).as_posix()
    return write_patch(move_files(text, folder, to), drawing_patch(location, file), source)


def drawing_patch(drawing: FilePath, file: str) -> Patch:
    """Patch that sets path, name and title of a job for a drawing with the file name `file`."""
    return {
        **{("path", key): REMOVE for key in GEOMETRY_KEYS},
        ("path", "file"): file,
        # A file name may be too long for a job name, and may have unprintable characters.
        ("name",): shorten(make_printable(drawing.stem), LONGEST_NAME),
        ("title",): shorten(make_printable(drawing.name), LONGEST_TITLE),
    }


def _read_cell_text(cell: str) -> tuple[str, str, FilePath]:
    """Text of a cell, its name for messages, and the folder for its relative file names."""
    file = FilePath(cell)
    if file.suffix.lower() in YAML:
        return job_text(file), file.name, file.parent
    return cell_text(cell), f"the cell {cell}", FilePath()
