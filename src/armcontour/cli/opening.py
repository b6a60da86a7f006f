"""Open the job that a command is given: a job file, or a drawing and a cell."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour.cli import quantities
from armcontour.cli.options import SHORT

if TYPE_CHECKING:
    from armcontour.cli.options import JobOptions
    from armcontour.core.progress import Progress
    from armcontour.files.patch import Patch
    from armcontour.jobs import Job

# A job may have one of these endings, or none.
JOBS = (".yaml", ".yml", "")
# Name of the built-in job, which any command takes in place of a job file.
PAPER = "paper"


def read_patch(*groups: Any) -> tuple[Patch, dict[str, str]]:
    """The keys of a job that options set.

    Args:
        groups: Groups of options.

    Returns:
        The values by their keys, and the options by keys with dots.

    Raises:
        InvalidInput: Text of another form, or a key that two options set.
    """
    from armcontour.core.errors import InvalidInput, error_context

    patch: dict[tuple[str | int, ...], Any] = {}
    options: dict[str, str] = {}
    for group in groups:
        for name, value in group.keys.items():
            if value in (None, []):
                continue
            row, option = SHORT[name], f"--{name.replace('_', '-')}"
            try:
                value = getattr(quantities, row["read"])(value) if row["read"] else value
            except ValueError as error:
                raise InvalidInput(f"{option} {error}.") from None
            *outer, last = row["key"].split(".")
            each = value.items() if last == "*" else [(last, value)]
            patch |= {(*outer, key): item for key, item in each}
            options[row["key"].removesuffix(".*")] = option
        for text in getattr(group, "sets", None) or ():
            # Loads the checks of jobs.
            from armcontour.files import parse_set

            with error_context("--set"):
                [(keys, value)] = parse_set(text).items()
            key = ".".join(map(str, keys))
            if key in options:
                raise InvalidInput(f"{options[key]} and --set {key} set the same: leave one out.")
            patch[keys], options[key] = value, "--set"
    return patch, options


@contextmanager
def name_options(options: Mapping[str, str]) -> Iterator[None]:
    """Put the option that has set a key before the message of an error that names this key.

    Args:
        options: The options by keys with dots.
    """
    from armcontour.core.errors import InvalidInput

    try:
        yield
    except InvalidInput as error:
        for key, option in options.items():
            # A name without dots may be another word elsewhere in the sentence.
            begin = r"\b" if "." in key else ": (unknown key )?"
            if re.search(rf"{begin}{re.escape(key)}\b", str(error)):
                raise error.at(option).with_traceback(error.__traceback__) from None
        raise


def library_file(name: str) -> FilePath:
    """A file of the package's library of jobs."""
    return FilePath(str(resources.files("armcontour.jobs") / "library" / name))


def is_job(file: FilePath) -> bool:
    """Whether a file is a job by its name; else it is a drawing."""
    from armcontour.core.errors import InvalidInput

    if file.is_dir():
        raise InvalidInput(f"{file} is a folder: name a job file or a drawing.")
    return file.suffix.lower() in JOBS


def open_job(file: FilePath, x: JobOptions, progress: Progress, *groups: Any) -> Job:
    """Read the job in a job file, or combine a drawing with a cell.

    Args:
        file: A job file, or a drawing.
        x: Options that set keys of the job; --cell is for a drawing only.
        progress: Called with the progress of reading the drawing.
        groups: More groups of options that set keys of the job.

    Raises:
        InvalidInput: A drawing without a cell, a job file with a cell, or an invalid file.
    """
    from armcontour.core.errors import InvalidInput
    from armcontour.files import read_job
    from armcontour.files.cell import cell_names, read_cell
    from armcontour.files.drawings.endings import find_reader

    patch, options = read_patch(x, *groups)
    if is_job(file):
        if x.cell is not None:
            raise InvalidInput(
                f"{file.name} is a job, which has an arm: --cell goes with a drawing."
            )
        if str(file) == PAPER and not file.exists():
            file = library_file("paper.yaml")
        with name_options(options):
            return read_job(file, patch=patch, reading=progress, trust_xacro=x.trust_xacro)
    # A robot description, say, is no drawing, and needs no cell.
    find_reader(file)
    if x.cell is None:
        raise InvalidInput(
            f"{file.name} is a drawing: name the cell it is to be run in with --cell, one of "
            f"{', '.join(cell_names())}, or a job file."
        )
    with name_options(options):
        return read_cell(x.cell, file, patch=patch, reading=progress, trust_xacro=x.trust_xacro)
