"""Cells: job files without a path, which are combined with a drawing."""

from __future__ import annotations

import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from armcontour.core.checks import LONGEST_NAME
from armcontour.core.errors import InvalidInput, error_context
from armcontour.core.progress import Progress
from armcontour.core.text import make_printable, shorten
from armcontour.core.yaml_loader import load
from armcontour.files.file_keys import SpecifiedKeys, read_keys
from armcontour.files.job_arm import arm_of
from armcontour.files.job_edits import REMOVE, move_files
from armcontour.files.job_file import job_of, job_text, model_of, read_data
from armcontour.files.job_model import CellModel, PathModel
from armcontour.files.job_path import part_of, read_drawing
from armcontour.files.patch import Patch, apply_patch, write_patch
from armcontour.files.scene_file import scene_of
from armcontour.jobs import Job
from armcontour.jobs.job import LONGEST_TITLE
from armcontour.robot import Arm
from armcontour.robot.scene import Scene

# Keys of a job's path that a drawing replaces.
OWN_PATH = ("points", "start", "segments", "spline")
YAML = (".yaml", ".yml")


def cell_names() -> tuple[str, ...]:
    """Names of the built-in cells."""
    files = (resources.files("armcontour.files") / "cells").iterdir()
    return tuple(sorted(x.name.removesuffix(".yaml") for x in files if x.name.endswith(".yaml")))


def cell_text(name: str) -> str:
    """The text of a built-in cell: a job file without a path, with comments."""
    names = cell_names()
    if name not in names:
        raise InvalidInput(
            f"There is no cell {name!r}: name a job file (.yaml), or one of {', '.join(names)}."
        )
    file = resources.files("armcontour.files") / "cells" / f"{name}.yaml"
    return file.read_text(encoding="utf-8")


def read_cell(
    cell: str | FilePath,
    drawing: str | FilePath,
    *,
    path: Mapping[str, Any] | None = None,
    patch: Patch | None = None,
    reading: Progress | None = None,
    trust_xacro: bool = False,
) -> Job:
    """Combine a cell or a job file with a drawing; `path` and `patch` override keys."""
    # The drawing replaces the points or segments of a job file; its frame and its reader options
    # stay.
    values: Patch = {("path", key): value for key, value in (path or {}).items()}
    data, source, folder = cell_data(cell, drawing, {**values, **(patch or {})})
    model = model_of(CellModel, data, source)
    # Errors in the drawing name the drawing only, because the cell does not cause them.
    program = read_drawing(model.path, str(model.path.file), folder, reading)
    with error_context(source):
        return job_of(model, folder, reading, trust_xacro, program)


def read_cell_arm(cell: str | FilePath, *, trust_xacro: bool = False) -> Arm:
    """Read the arm of a cell, or of a job file, with its tool, work frame and payload."""
    text, source, folder = _text(str(cell))
    with error_context(source):
        model = model_of(CellModel, read_data(text, source), source)
        return arm_of(model.arm, folder, trust_xacro=trust_xacro)


def read_cell_scene(cell: str | FilePath, *, trust_xacro: bool = False) -> tuple[Arm | None, Scene]:
    """The arm, or None, and the scene of a cell or of a job file without other keys."""
    text, source, folder = _text(str(cell))
    specified = read_keys(SpecifiedKeys(CellModel), load(text, source), source)
    model, path, scene = (
        specified.get("arm"),
        specified.get("path", PathModel()),
        specified.get("scene"),
    )
    with error_context(source):
        arm = None if model is None else arm_of(model, folder, trust_xacro=trust_xacro)
        return arm, Scene() if scene is None else scene_of(scene, folder, part_of(path))


def cell_data(
    cell: str | FilePath, drawing: str | FilePath, patch: Patch | None = None
) -> tuple[dict[str, Any], str, FilePath]:
    """Cell and drawing as the data of a job file, the cell's name, and the folder of its files."""
    text, source, folder = _text(str(cell))
    data, location = read_data(text, source), FilePath(drawing)
    drawn = _drawn(data, location, str(location.absolute()))
    with error_context(source):
        return apply_patch(data, {**drawn, **(patch or {})}), source, folder


def drawing_text(cell: str | FilePath, drawing: str | FilePath, to: FilePath) -> str:
    """A cell and a drawing as the text of a job file, with the comments of the cell."""
    text, source, folder = _text(str(cell))
    location = FilePath(drawing).absolute()
    file = FilePath(os.path.relpath(location, to)).as_posix()
    drawn = _drawn(read_data(text, source), location, file)
    return write_patch(move_files(text, folder, to), drawn, source)


def _drawn(cell: Mapping[str, Any], drawing: FilePath, file: str) -> Patch:
    """The keys of a cell that a drawing replaces: its path, and name and title of the job."""
    cell_title = cell.get("title")
    title = drawing.name if cell_title is None else f"{drawing.name} on {cell_title}"
    return {
        **{("path", key): REMOVE for key in OWN_PATH},
        ("path", "file"): file,
        # The name of a file may be longer than that of a job, and hold unprintable characters.
        ("name",): _fit(drawing.stem, LONGEST_NAME),
        ("title",): _fit(title, LONGEST_TITLE),
    }


def _text(cell: str) -> tuple[str, str, FilePath]:
    """The text of a cell, its name for messages, and the folder of its relative files."""
    file = FilePath(cell)
    if file.suffix.lower() in YAML:
        return job_text(file), file.name, file.parent
    return cell_text(cell), f"the cell {cell}", FilePath()


def _fit(text: str, length: int) -> str:
    """Make a text printable, and shorten it to a number of characters."""
    return shorten(make_printable(text), length)
