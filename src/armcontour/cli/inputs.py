"""Inputs of commands: jobs, or drawings and cells, and options with quantities or job keys."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any

from armcontour import files
from armcontour.cli.job_options import JOB_OPTIONS
from armcontour.core.errors import FileError, InvalidInput, error_context
from armcontour.core.progress import subprogress
from armcontour.core.text import plain_number
from armcontour.files.drawings.path_reader import YAML, find_reader

if TYPE_CHECKING:
    from armcontour.core.progress import Progress
    from armcontour.files.job_patch import Patch
    from armcontour.jobs import Job
import math
from typing import get_args

from armcontour.core.quantities import Moment, read_quantity

# Fields of options that require --on, and the end of the message.
OF_CONTROLLER = ("execute", "drives", "thread_period", "hal", "address")
NEEDS_ON = "requires --on. Also specify a controller with --on."
# Names of options that differ from those of their fields.
OPTIONS = {"start": "from", "end": "to", "run_name": "run", "sets": "set"}
OPTIONS |= {"thread_period": "thread-period"}


def read_patch(options: Any) -> tuple[Patch, dict[str, str]]:
    """Read options that set job keys: values by key path, and options by key joined by dots."""
    patch: dict[tuple[str | int, ...], Any] = {}
    names: dict[str, str] = {}
    for name, value in getattr(options, "keys", {}).items():
        if value in (None, []):
            continue
        option = JOB_OPTIONS[name]
        patch[tuple(option.key.split("."))] = option.read(value) if option.read else value
        names[option.key] = option.name
    for text in getattr(options, "sets", None) or ():
        with error_context("--set"):
            [(keys, value)] = files.parse_set(text).items()
        key = ".".join(map(str, keys))
        if key in names:
            raise InvalidInput(
                f"{names[key]} and --set {key} set the same key. Remove one of them."
            )
        patch[keys] = value
        names[key] = "--set"
    return patch, names


@contextmanager
def naming_options_in_errors(options: Mapping[str, str]) -> Iterator[None]:
    """Context that names, in an error about a job key, the option of the command that set the key.

    `options`: names of options by the key that they set, such as "path.file".
    """
    try:
        yield
    except InvalidInput as error:
        keys = ".".join(map(str, error.key))
        option = next((x for key, x in options.items() if f"{keys}.".startswith(f"{key}.")), None)
        if option is None:
            raise
        raise error.with_location(option).with_traceback(error.__traceback__) from None


def library_file(name: str) -> FilePath:
    """Return the path of a file in the job library of the package."""
    return FilePath(str(resources.files("armcontour.jobs") / "library" / name))


def is_job(file: FilePath) -> bool:
    """Return whether a file is a job file according to its extension; otherwise it is a drawing."""
    if file.is_dir():
        raise FileError(f"{file} is a folder. Specify a job file or a drawing.")
    return file.suffix.lower() in YAML


def open_job(file: FilePath, options: Any, progress: Progress) -> Job:
    """Read a job file, or a drawing in a cell, with the job keys of the options.

    Args:
        file: Job file or drawing.
        options: Options of the command.
        progress: Called with the progress of reading the drawing.

    Raises:
        InvalidInput: As in `read_job`; the message names the option that set the wrong key. Or a
            drawing has no cell, or a job file has one.
    """
    patch, names = read_patch(options)
    cell = getattr(options, "cell", None)
    file = find_file(file, cell)
    reading = subprogress(progress, "reading")
    with naming_options_in_errors(names):
        return files.read_job(file, cell=cell, patch=patch, reading=reading)


def find_file(file: FilePath, cell: str | None) -> FilePath:
    """Check that a drawing has a cell, and a job has none; returns the file."""
    if is_job(file):
        if cell is not None:
            raise InvalidInput(
                f"--cell is only allowed with a drawing, but {file.name} is a job, which has its "
                "own arm. Remove --cell."
            )
        return file
    # `find_reader` raises an error for files that are not drawings, such as robot descriptions.
    # This error is more helpful than the error about a missing cell.
    find_reader(file)
    if cell is None:
        raise InvalidInput(
            f"{file.name} is a drawing, which requires a cell. Specify it with --cell: a built-in "
            "cell such as ur5e, or a job file. `armcontour arms` lists the built-in cells."
        )
    return file


def refuse_given(options: Any, names: Iterable[str], reason: str) -> None:
    """Check that options are not given.

    Args:
        options: Options of the command.
        names: Fields of the options that must not be given.
        reason: End of the message, after the name of the option.

    Raises:
        InvalidInput: An option is given.
    """
    for name in names:
        option = OPTIONS.get(name, name)
        if getattr(options, name):
            raise InvalidInput(f"--{option} {reason}")


def refuse_existing(file: FilePath, force: bool) -> None:
    """Raise InvalidInput if a file exists, without --force."""
    if file.exists() and not force:
        raise FileError(f"{file} exists. Choose another name, or add --force to replace it.")


def read_option(option: str, text: str | None, kind: Any) -> Any:
    """Read an option with a quantity in SI units; None if the option is not given.

    Args:
        option: Name of the option, for messages.
        text: Text of the option.
        kind: Annotation with the quantity.

    Raises:
        InvalidInput: The text has no unit (0 needs none), or the value is out of range.
    """
    if text is None:
        return None
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


def read_window(start: str | None, end: str | None) -> tuple[float, float]:
    """Return the first and last used time of a log [s]; infinite if the option is not given."""
    first = read_option("--from", start, Moment)
    last = read_option("--to", end, Moment)
    return -math.inf if first is None else first, math.inf if last is None else last
