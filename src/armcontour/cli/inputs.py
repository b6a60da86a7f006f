"""Inputs of commands: quantities of options, and the job of a file, or of a drawing and a cell."""

from __future__ import annotations

import math
import re
from collections.abc import Callable, Iterator, Mapping
from contextlib import contextmanager
from importlib import resources
from pathlib import Path as FilePath
from typing import TYPE_CHECKING, Any, get_args

from armcontour.cli.options import SHORT
from armcontour.core.text import plain_number, show

if TYPE_CHECKING:
    from armcontour.cli.options import JobOptions
    from armcontour.core.progress import Progress
    from armcontour.files.patch import Patch
    from armcontour.jobs import Job

# File endings of jobs.
JOBS = (".yaml", ".yml", "")
# Name of the built-in job, which all commands accept instead of a job file.
PAPER = "paper"


def read_patch(*groups: Any) -> tuple[Patch, dict[str, str]]:
    """Values that options set, by the keys of the job, and the options by keys with dots."""
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
            # Imported here, because it loads the checks of jobs.
            from armcontour.files import parse_set

            with error_context("--set"):
                [(keys, value)] = parse_set(text).items()
            key = ".".join(map(str, keys))
            if key in options:
                raise InvalidInput(
                    f"{options[key]} and --set {key} set the same: remove one of them."
                )
            patch[keys], options[key] = value, "--set"
    return patch, options


@contextmanager
def name_options(options: Mapping[str, str]) -> Iterator[None]:
    """Context that puts the option of a key before the message of an error that names the key."""
    from armcontour.core.errors import InvalidInput

    try:
        yield
    except InvalidInput as error:
        for key, option in options.items():
            # A name without dots may occur as an ordinary word in the sentence.
            begin = r"\b" if "." in key else ": (unknown key )?"
            if re.search(rf"{begin}{re.escape(key)}\b", str(error)):
                raise error.with_location(option).with_traceback(error.__traceback__) from None
        raise


def library_file(name: str) -> FilePath:
    """A file of the package's library of jobs."""
    return FilePath(str(resources.files("armcontour.jobs") / "library" / name))


def is_job(file: FilePath) -> bool:
    """True if a file is a job by its name; otherwise it is a drawing."""
    from armcontour.core.errors import InvalidInput

    if file.is_dir():
        raise InvalidInput(f"{file} is a folder: name a job file or a drawing.")
    return file.suffix.lower() in JOBS


def open_job(file: FilePath, job_options: JobOptions, progress: Progress, *groups: Any) -> Job:
    """Read the job in a job file, or combine a drawing with a cell."""
    from armcontour.core.errors import InvalidInput
    from armcontour.files import read_job
    from armcontour.files.cell import cell_names, read_cell
    from armcontour.files.drawings.endings import find_reader

    patch, options = read_patch(job_options, *groups)
    if is_job(file):
        if job_options.cell is not None:
            raise InvalidInput(
                f"{file.name} is a job, which has an arm: --cell goes with a drawing."
            )
        if str(file) == PAPER and not file.exists():
            file = library_file("paper.yaml")
        with name_options(options):
            return read_job(
                file, patch=patch, reading=progress, trust_xacro=job_options.trust_xacro
            )
    # Other files, such as robot descriptions, are rejected before the check for a cell.
    find_reader(file)
    if job_options.cell is None:
        raise InvalidInput(
            f"{file.name} is a drawing: name the cell for it with --cell, one of "
            f"{', '.join(cell_names())}, or a job file."
        )
    with name_options(options):
        return read_cell(
            job_options.cell,
            file,
            patch=patch,
            reading=progress,
            trust_xacro=job_options.trust_xacro,
        )


def read_option(option: str, text: str | int | None, kind: Any) -> float | None:
    """Quantity of an option in SI units; None without the option."""
    return None if text is None else _read(option, str(text), kind)


def read_window(start: str | None, end: str | None) -> tuple[float, float]:
    """First and last time of a log to use [s]; infinite without the option."""
    from armcontour.core.quantities import Moment

    first, last = read_option("--from", start, Moment), read_option("--to", end, Moment)
    return -math.inf if first is None else first, math.inf if last is None else last


def to_quantity(text: str) -> str | int:
    """Quantity as in a job file: text with a unit, or zero."""
    return 0 if plain_number(text) == 0 else text.strip()


def to_quantities(text: str) -> list[str | int]:
    """Quantities separated by commas."""
    return [to_quantity(part) for part in text.split(",")]


def to_point(text: str) -> list[str | int]:
    """Point; z is zero by default."""
    coordinates = to_quantities(text)
    return [*coordinates, 0] if len(coordinates) == 2 else coordinates


def to_skip(_: bool) -> str:
    """Treatment of unknown elements by the reader."""
    return "skip"


def to_words(texts: list[str]) -> dict[str, list[str]]:
    """Words to skip, separated by commas, in one option or several."""
    return {"skip": [word.strip() for text in texts for word in text.split(",") if word.strip()]}


def to_tools(texts: list[str]) -> dict[int, str | int]:
    """Diameters of tools by number."""
    example = "1: 3 mm"
    diameters = _named([part for text in texts for part in text.split(",")], example)
    for name in diameters:
        if not (name.isascii() and name.isdigit() and len(name) <= 8):
            raise ValueError(f"takes the number of a tool, as in {example!r}, not {show(name)}")
    return {int(name): to_quantity(diameter) for name, diameter in diameters.items()}


def to_axes(texts: list[str]) -> dict[str, dict[str, str | int]]:
    """Ranges of axes."""
    example, axes = "x: -300 mm .. 300 mm, 25", dict[str, dict[str, str | int]]()
    for name, text in _named(texts, example).items():
        span, _, count = text.rpartition(",")
        low, dots, high = span.partition("..")
        number = plain_number(count)
        if not dots or number is None or number != int(number):
            raise ValueError(f"takes an axis, a range and a number, such as {example!r}")
        axes[name] = {"from": to_quantity(low), "to": to_quantity(high), "places": int(number)}
    return axes


def to_offsets(texts: list[str]) -> dict[str, str | int]:
    """Uncertainty of the position of the part along axes."""
    return {name: to_quantity(text) for name, text in _named(texts, "x: 2 mm").items()}


def to_anchor(text: str) -> str | list[str | int]:
    """Name of a point, or its coordinates."""
    return to_quantities(text) if "," in text else text


def _named(texts: list[str], example: str) -> dict[str, str]:
    """Texts such as 'x: 2 mm', by the names before their colons."""
    values: dict[str, str] = {}
    for text in texts:
        name, colon, value = (part.strip() for part in text.partition(":"))
        if not (name and colon and value):
            raise ValueError(f"takes a name and a value, such as {example!r}, not {show(text)}")
        if name in values:
            raise ValueError(f"names {show(name)} twice: give it once")
        values[name] = value
    return values


def _read(option: str, text: str, kind: Any) -> float:
    """Read one quantity of an option; text other than 0 needs a unit."""
    from armcontour.core.errors import InvalidInput
    from armcontour.files.units import read_quantity

    quantity = get_args(kind)[1]
    plain = text.strip()
    number = plain_number(plain)
    if number:
        # The intended unit is unknown, so the message has an example only.
        raise InvalidInput(
            f"{option}: {plain!r} has no unit: write one, as in '{quantity.example}'."
        )
    try:
        return read_quantity(plain if number is None else number, quantity)
    except ValueError as error:
        raise InvalidInput(f"{option}: {str(error).rstrip('.')}.") from None


# The functions that read the short options, by the names that `About` gives them.
READERS: dict[str, Callable[[Any], Any]] = {
    x.__name__: x
    for x in (
        to_quantity,
        to_quantities,
        to_point,
        to_skip,
        to_words,
        to_tools,
        to_axes,
        to_offsets,
        to_anchor,
    )
}
