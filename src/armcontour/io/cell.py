"""Cells: job files without a path, which are combined with a drawing."""

from __future__ import annotations

import dataclasses
import os
from collections.abc import Mapping
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from armcontour._checks import LONGEST_NAME
from armcontour._progress import Progress
from armcontour._text import make_printable, shorten
from armcontour._yaml import load
from armcontour.arms import Arm
from armcontour.errors import InvalidInput, locate_errors
from armcontour.io.job_arm import arm_of
from armcontour.io.job_edits import Change, change_text, move_files
from armcontour.io.job_file import job_of, job_text, read_model
from armcontour.io.job_model import CellModel, PathModel
from armcontour.io.job_overrides import JobOverrides, override
from armcontour.io.job_path import part_of, read_drawing
from armcontour.io.keys import Given, read_keys
from armcontour.io.scene import scene_of
from armcontour.jobs import Job
from armcontour.jobs.job import LONGEST_TITLE
from armcontour.scene import Scene

# Keys of a job's path that a drawing replaces.
OWN_PATH = ("points", "start", "segments", "spline")
YAML = (".yaml", ".yml")


def cell_names() -> tuple[str, ...]:
    """Names of the built-in cells."""
    files = (resources.files("armcontour.io") / "cells").iterdir()
    return tuple(sorted(x.name.removesuffix(".yaml") for x in files if x.name.endswith(".yaml")))


def cell_text(name: str) -> str:
    """The text of a built-in cell: a job file without a path, with comments.

    Args:
        name: Name of the cell, which is that of its arm.

    Raises:
        InvalidInput: No such cell.
    """
    names = cell_names()
    if name not in names:
        raise InvalidInput(
            f"There is no cell {name!r}: name a job file (.yaml), or one of {', '.join(names)}."
        )
    found = resources.files("armcontour.io") / "cells" / f"{name}.yaml"
    return found.read_text(encoding="utf-8")


def read_cell(
    cell: str | FilePath,
    drawing: str | FilePath,
    *,
    path: Mapping[str, Any] | None = None,
    overrides: JobOverrides | None = None,
    reading: Progress | None = None,
    trust_xacro: bool = False,
) -> Job:
    """Read a cell and a drawing, and combine them into a job.

    Args:
        cell: Name of a built-in cell, or a job file. The drawing replaces the points or segments of
            the job file; its frame and its options for reading files stay.
        drawing: The file of the drawing.
        path: Keys of `path` that differ from the cell's, as in a job file.
        overrides: Values that replace the cell's own values.
        reading: Called with the progress of reading the drawing, as in `read_path`.
        trust_xacro: As in `read_job`.

    Raises:
        InvalidInput: No such cell, or an error of `read_job` or `read_path`.
    """
    text, source, folder = _text(str(cell))
    place = FilePath(drawing)
    found = read_model(CellModel, text, source)
    given = read_keys(Given(PathModel), path or {}, f"{source}: path")
    drawn = {**dict.fromkeys(OWN_PATH), **given, "file": str(place.absolute())}
    own = dataclasses.replace(
        found, **_names(found, place), path=dataclasses.replace(found.path, **drawn)
    )
    with locate_errors(source):
        model = override(own, overrides)
    # What is wrong with the drawing is not the cell's fault: such sentences name the drawing only.
    program = read_drawing(model.path, drawn["file"], folder, reading)
    with locate_errors(source):
        return job_of(model, folder, reading, trust_xacro, program)


def read_cell_arm(cell: str | FilePath, *, trust_xacro: bool = False) -> Arm:
    """Read the arm of a cell, or of a job file, with its tool, work frame and payload.

    Args:
        cell: Name of a built-in cell, or a job file; it needs no path.
        trust_xacro: As in `read_job`.

    Raises:
        InvalidInput: No such cell or file, or an invalid key.
    """
    text, source, folder = _text(str(cell))
    with locate_errors(source):
        model = read_model(CellModel, text, source)
        return arm_of(model.arm, folder, trust_xacro=trust_xacro)


def read_cell_scene(cell: str | FilePath, *, trust_xacro: bool = False) -> tuple[Arm | None, Scene]:
    """Read the arm and the scene of a cell, or of a job file, of which other keys may be missing.

    Args:
        cell: Name of a built-in cell, or a job file.
        trust_xacro: As in `read_job`.

    Returns:
        The arm, or None if the file has none; and the scene, empty without the key `scene`.

    Raises:
        InvalidInput: No such cell or file, or an invalid key.
    """
    text, source, folder = _text(str(cell))
    given = read_keys(Given(CellModel), load(text, source), source)
    model, path, scene = given.get("arm"), given.get("path", PathModel()), given.get("scene")
    with locate_errors(source):
        arm = None if model is None else arm_of(model, folder, trust_xacro=trust_xacro)
        return arm, Scene() if scene is None else scene_of(scene, folder, part_of(path))


def open_text(cell: str) -> tuple[str, FilePath]:
    """The text of a built-in cell or a job file, and the folder of its relative files.

    Args:
        cell: Name of a built-in cell, or a job file.

    Raises:
        InvalidInput: No such cell or file.
    """
    text, _, folder = _text(cell)
    return text, folder


def open_keys(cell: str) -> tuple[CellModel, FilePath]:
    """The keys of a built-in cell or a job file, and the folder of its relative files.

    Args:
        cell: As in `open_text`.

    Raises:
        InvalidInput: No such cell or file, or an invalid key.
    """
    text, source, folder = _text(cell)
    return read_model(CellModel, text, source), folder


def cell_data(
    cell: str | FilePath, drawing: str | FilePath
) -> tuple[dict[str, Any], str, FilePath]:
    """A cell and a drawing as the data of a job file.

    Args:
        cell: As in `read_cell`.
        drawing: The file of the drawing.

    Returns:
        The data, the name of the cell for messages, and the folder of its relative files.

    Raises:
        InvalidInput: No such cell, or an invalid key.
    """
    text, source, folder = _text(str(cell))
    place = FilePath(drawing)
    found = read_model(CellModel, text, source)
    data = load(text, source)
    own = {key: x for key, x in (data.get("path") or {}).items() if key not in OWN_PATH}
    path = {**own, "file": str(place.absolute())}
    return {**data, **_names(found, place), "path": path}, source, folder


def drawing_text(cell: str | FilePath, drawing: str | FilePath, to: FilePath) -> str:
    """A cell and a drawing as the text of a job file, with the comments of the cell.

    Args:
        cell: As in `read_cell`.
        drawing: The file of the drawing.
        to: The folder of the job file, to which the names of files are relative.

    Raises:
        InvalidInput: No such cell, or an invalid key.
    """
    text, source, folder = _text(str(cell))
    place = FilePath(drawing).absolute()
    found = read_model(CellModel, text, source)
    text = move_files(text, folder, to)
    own = (load(text, source).get("path") or {}).keys()
    changes = [Change(("path", key)) for key in OWN_PATH if key in own]
    changes += [Change((key,), x) for key, x in _names(found, place).items()]
    changes.append(Change(("path", "file"), FilePath(os.path.relpath(place, to)).as_posix()))
    return change_text(text, changes, source)


def _names(cell: CellModel, drawing: FilePath) -> dict[str, Any]:
    """Name and title of the job of a drawing."""
    title = f"{drawing.name} on {cell.title}" if cell.title is not None else drawing.name
    # The name of a file may be longer than that of a job, and hold unprintable characters.
    return {"name": _fit(drawing.stem, LONGEST_NAME), "title": _fit(title, LONGEST_TITLE)}


def _text(cell: str) -> tuple[str, str, FilePath]:
    """The text of a cell, its name for messages, and the folder of its relative files."""
    file = FilePath(cell)
    if file.suffix.lower() in YAML:
        return job_text(file), file.name, file.parent
    return cell_text(cell), f"the cell {cell}", FilePath()


def _fit(text: str, most: int) -> str:
    """Make a text printable, and shorten it to a number of characters."""
    return shorten(make_printable(text), most)
