"""Cells: job files without a path, into which a drawing is put."""

from __future__ import annotations

from collections.abc import Mapping
from importlib import resources
from pathlib import Path as FilePath
from typing import Any

from armcontour._checks import LONGEST_NAME
from armcontour._progress import Progress
from armcontour._text import make_printable, shorten
from armcontour.errors import InvalidInput
from armcontour.io.job_file import Changes, job_text, parse_job
from armcontour.jobs import Job
from armcontour.jobs.job import LONGEST_TITLE

# Keys of a job's path that say what it is, and that a drawing takes the place of.
OWN_PATH = ("points", "start", "segments", "spline", "file")
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
    changes: Changes | None = None,
    reading: Progress | None = None,
    trust_xacro: bool = False,
) -> Job:
    """The job of a cell with a drawing.

    Args:
        cell: The name of one that comes with the package, or a job file; its own path, if it has
            one, gives way to the drawing, but for its frame and what else it says of files.
        drawing: The file of the drawing.
        path: Keys of the path that differ from the cell's, as in a job file.
        changes: Applied to all of the data.
        reading: Called while the drawing is read, as by `read_path`.
        trust_xacro: As in `read_job`.

    Raises:
        InvalidInput: No such cell, or as `read_job` and `read_path` raise it.
    """
    text, source, folder = _text(str(cell))
    place = FilePath(drawing)

    def drawn(data: dict[str, Any]) -> dict[str, Any]:
        own = data.get("path") or {}
        if not isinstance(own, dict):
            raise InvalidInput(f"{source}: path must be a mapping of keys.")
        kept = {key: value for key, value in own.items() if key not in OWN_PATH}
        title = data.get("title")
        found = {
            **data,
            # A name of a file may be longer than that of a job, and hold what is not printable.
            "name": _fitted(place.stem, LONGEST_NAME),
            "title": _fitted(
                f"{place.name} on {title}" if isinstance(title, str) else place.name, LONGEST_TITLE
            ),
            "path": {**kept, **(path or {}), "file": str(place.absolute())},
        }
        return found if changes is None else changes(found)

    return parse_job(
        text,
        source=source,
        folder=folder,
        changes=drawn,
        reading=reading,
        trust_xacro=trust_xacro,
    )


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
