"""Cells: job files without a path, into which a drawing is put."""

from __future__ import annotations

import dataclasses
from collections.abc import Mapping
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from armcontour._checks import LONGEST_NAME
from armcontour._progress import Progress
from armcontour._text import make_printable, shorten
from armcontour.errors import InvalidInput, locate_errors
from armcontour.io.job_file import job_of, job_text, read_model
from armcontour.io.job_model import CellModel, PathModel
from armcontour.io.job_overrides import JobOverrides, override
from armcontour.io.keys import Given, read_keys
from armcontour.jobs import Job
from armcontour.jobs.job import LONGEST_TITLE

# Keys of a job's path that say what it is, and that a drawing takes the place of.
OWN_PATH = ("points", "start", "segments", "spline")
YAML = (".yaml", ".yml")


def cell_names() -> tuple[str, ...]:
    """The names of the cells that come with the package."""
    files = (resources.files("armcontour.io") / "cells").iterdir()
    return tuple(sorted(x.name.removesuffix(".yaml") for x in files if x.name.endswith(".yaml")))


def read_cell(
    cell: str | FilePath,
    drawing: str | FilePath,
    *,
    path: Mapping[str, Any] | None = None,
    overrides: JobOverrides | None = None,
    reading: Progress | None = None,
    trust_xacro: bool = False,
) -> Job:
    """The job of a cell with a drawing.

    Args:
        cell: The name of one that comes with the package, or a job file; its own path, if it has
            one, gives way to the drawing, but for its frame and what else it says of files.
        drawing: The file of the drawing.
        path: Keys of the path that differ from the cell's, as in a job file.
        overrides: What is to stand in the place of the cell's own values.
        reading: Called while the drawing is read, as by `read_path`.
        trust_xacro: As in `read_job`.

    Raises:
        InvalidInput: No such cell, or as `read_job` and `read_path` raise it.
    """
    text, source, folder = _text(str(cell))
    place = FilePath(drawing)
    found = read_model(CellModel, text, source)
    title = f"{place.name} on {found.title}" if found.title is not None else place.name
    given = read_keys(Given(PathModel), path or {}, f"{source}: path")
    drawn = {**dict.fromkeys(OWN_PATH), **given, "file": str(place.absolute())}
    model = dataclasses.replace(
        found,
        # A name of a file may be longer than that of a job, and hold what is not printable.
        name=_fitted(place.stem, LONGEST_NAME),
        title=_fitted(title, LONGEST_TITLE),
        path=dataclasses.replace(found.path, **drawn),
    )
    with locate_errors(source):
        return job_of(override(model, overrides), folder, reading, trust_xacro)


def _text(cell: str) -> tuple[str, str, FilePath]:
    """A cell's text, what to call it, and where its files are looked for."""
    file = FilePath(cell)
    if file.suffix.lower() in YAML:
        return job_text(file), file.name, file.parent
    names = cell_names()
    if cell not in names:
        raise InvalidInput(
            f"There is no cell {cell!r}: name a job file (.yaml), or one of {', '.join(names)}."
        )
    found = resources.files("armcontour.io") / "cells" / f"{cell}.yaml"
    return found.read_text(encoding="utf-8"), f"the cell {cell}", FilePath()


def _fitted(text: str, most: int) -> str:
    return shorten(make_printable(text), most)
