"""Inputs of commands: quantities in options, and the job of a job file or of a drawing and cell."""

from __future__ import annotations

import math
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, get_args

from armcontour.cli.options import SHORT
from armcontour.core.progress import subprogress
from armcontour.core.text import plain_number

if TYPE_CHECKING:
    from armcontour.cli.options import JobOptions
    from armcontour.core.progress import Progress
    from armcontour.files.patch import Patch
    from armcontour.jobs import Job

# Extensions of job files; "" for the name of the built-in job.
JOBS = (".yaml", ".yml", "")
# Name of the built-in job, which can be used instead of a job file.
PAPER = "paper"


def read_patch(*groups: Any) -> tuple[Patch, dict[str, str]]:
    """Read options that set job keys: values by key path, and options by key joined by dots."""
    from armcontour.core.errors import InvalidInput, error_context

    patch: dict[tuple[str | int, ...], Any] = {}
    options: dict[str, str] = {}
    for group in groups:
        for name, value in group.keys.items():
            if value in (None, []):
                continue
            row, option = SHORT[name], f"--{name.replace('_', '-')}"
            try:
                value = READERS[row["read"]](value) if row["read"] else value
            except ValueError as error:
                raise InvalidInput(f"{option} {error}.") from None
            *outer, last = row["key"].split(".")
            each = value.items() if last == "*" else [(last, value)]
            patch |= {(*outer, key): item for key, item in each}
            options[row["key"].removesuffix(".*")] = option
        for text in getattr(group, "sets", None) or ():
            # The import is here, because it loads the slow modules that check jobs.
            from armcontour.files import parse_set

            with error_context("--set"):
                [(keys, value)] = parse_set(text).items()
            key = ".".join(map(str, keys))
            if key in options:
                raise InvalidInput(
                    f"{options[key]} and --set {key} set the same key. Remove one of them."
                )
            patch[keys], options[key] = value, "--set"
    return patch, options


@contextmanager
def name_options(options: Mapping[str, str]) -> Iterator[None]:
    """Context that adds, to the message of an error about a job key, the option that set it."""
    from armcontour.core.errors import InvalidInput

    try:
        yield
    except InvalidInput as error:
        keys = ".".join(map(str, error.key))
        option = next((x for key, x in options.items() if f"{keys}.".startswith(f"{key}.")), None)
        if option is None:
            raise
        raise error.with_location(option).with_traceback(error.__traceback__) from None


def library_file(name: str) -> FilePath:
    """Path of a file in the job library of the package."""
    return FilePath(str(resources.files("armcontour.jobs") / "library" / name))


def is_job(file: FilePath) -> bool:
    """True if a file is a job file according to its extension; otherwise it is a drawing."""
    from armcontour.core.errors import InvalidInput

    if file.is_dir():
        raise InvalidInput(f"{file} is a folder. Specify a job file or a drawing.")
    return file.suffix.lower() in JOBS


def open_job(file: FilePath, job_options: JobOptions, progress: Progress, *groups: Any) -> Job:
    """Read a job file, or combine a drawing with a cell; `groups`: more options with job keys."""
    from armcontour.files import read_job

    patch, options = read_patch(job_options, *groups)
    file, progress = find_file(file, job_options.cell), subprogress(progress, "reading")
    with name_options(options):
        return read_job(file, cell=job_options.cell, patch=patch, reading=progress)


def find_file(file: FilePath, cell: str | None) -> FilePath:
    """File of a job or drawing; checks that a drawing has a cell, and that a job has none."""
    from armcontour.core.errors import InvalidInput
    from armcontour.files.drawings.endings import find_reader

    if is_job(file):
        if cell is not None:
            raise InvalidInput(
                f"--cell is only allowed with a drawing, but {file.name} is a job, which has its "
                "own arm. Remove --cell."
            )
        return library_file("paper.yaml") if str(file) == PAPER and not file.exists() else file
    # `find_reader` raises an error for files that are not drawings, such as robot descriptions.
    # This error is more helpful than the error about a missing cell.
    find_reader(file)
    if cell is None:
        from armcontour.files.cell import cell_names

        raise InvalidInput(
            f"{file.name} is a drawing, which requires a cell. Specify it with --cell: one of "
            f"{', '.join(cell_names())}, or a job file."
        )
    return file


def read_option(option: str, text: str | int | None, kind: Any) -> float | None:
    """Read the quantity of an option in SI units; None if the option is not given."""
    return None if text is None else _read(option, str(text), kind)


def read_window(start: str | None, end: str | None) -> tuple[float, float]:
    """First and last used time of a log [s]; infinite if the option is not given."""
    from armcontour.core.quantities import Moment

    first, last = read_option("--from", start, Moment), read_option("--to", end, Moment)
    return -math.inf if first is None else first, math.inf if last is None else last


def to_quantity(text: str) -> str | int:
    """Convert text to a quantity as in a job file: text with a unit, or 0."""
    return 0 if plain_number(text) == 0 else text.strip()


def to_quantities(text: str) -> list[str | int]:
    """Convert text to a list of quantities, which commas separate."""
    return [to_quantity(part) for part in text.split(",")]


def to_point(text: str) -> list[str | int]:
    """Convert text to the coordinates of a point; z is 0 if it is missing."""
    coordinates = to_quantities(text)
    return [*coordinates, 0] if len(coordinates) == 2 else coordinates


def to_skip(_: bool) -> str:
    """Convert a flag to "skip", the value of the job key for unknown elements."""
    return "skip"


def to_formats(texts: list[str]) -> list[str]:
    """Formats of exports; templates are relative to the working folder, not to the job file."""
    return [str(FilePath(x).absolute()) if x.endswith(".j2") else x for x in texts]


def _read(option: str, text: str, kind: Any) -> float:
    """Read a quantity of an option in SI units; values other than 0 require a unit."""
    from armcontour.core.errors import InvalidInput
    from armcontour.core.units import read_quantity

    quantity = get_args(kind)[1]
    plain = text.strip()
    number = plain_number(plain)
    if number:
        # The message has only an example, because the intended unit is unknown.
        raise InvalidInput(
            f"{option} requires a unit, but {plain!r} has none. Specify it as in "
            f"'{quantity.example}'."
        )
    try:
        return read_quantity(plain if number is None else number, quantity)
    except ValueError as error:
        raise InvalidInput(f"{option}: {str(error).rstrip('.')}.") from None


# Functions that convert option values to values of job keys, by function name in `About`.
READERS: dict[str, Callable[[Any], Any]] = {
    x.__name__: x
    for x in (
        to_quantity,
        to_quantities,
        to_point,
        to_skip,
        to_formats,
    )
}
