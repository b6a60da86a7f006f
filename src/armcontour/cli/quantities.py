"""Read quantities from options of the command line."""

from __future__ import annotations

import math
from typing import Any, get_args

from armcontour.core.text import plain_number, show


def read_option(option: str, text: str | int | None, kind: Any) -> float | None:
    """The quantity of an option in SI units; None without the option.

    Args:
        option: The option, such as "--speed".
        text: A number with its unit, or 0.
        kind: The annotated type of the quantity, such as `Speed`.

    Raises:
        InvalidInput: The text is no quantity of the required unit, or has no unit.
    """
    return None if text is None else _read(option, str(text), kind)


def read_window(start: str | None, end: str | None) -> tuple[float, float]:
    """First and last time of a log to use [s]; infinite without the option.

    Args:
        start: The option --from.
        end: The option --to.

    Raises:
        InvalidInput: One of them is no time.
    """
    from armcontour.core.quantities import Moment

    first, last = read_option("--from", start, Moment), read_option("--to", end, Moment)
    return -math.inf if first is None else first, math.inf if last is None else last


def to_quantity(text: str) -> str | int:
    """A quantity as a job file has it: text with a unit, or zero."""
    return 0 if plain_number(text) == 0 else text.strip()


def to_quantities(text: str) -> list[str | int]:
    """Quantities that are separated by commas."""
    return [to_quantity(part) for part in text.split(",")]


def to_point(text: str) -> list[str | int]:
    """A point; without z it is zero."""
    coordinates = to_quantities(text)
    return [*coordinates, 0] if len(coordinates) == 2 else coordinates


def to_skip(_: bool) -> str:
    """What the reader does with unknown elements."""
    return "skip"


def to_words(texts: list[str]) -> dict[str, list[str]]:
    """Words to skip, separated by commas, in one option or several."""
    return {"skip": [word.strip() for text in texts for word in text.split(",") if word.strip()]}


def to_tools(texts: list[str]) -> dict[int, str | int]:
    """Diameters of tools by their numbers."""
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
    """By how much the part may be off along axes."""
    return {name: to_quantity(text) for name, text in _named(texts, "x: 2 mm").items()}


def to_anchor(text: str) -> str | list[str | int]:
    """The name of a point, or its coordinates."""
    return to_quantities(text) if "," in text else text


def _named(texts: list[str], example: str) -> dict[str, str]:
    """Texts such as 'x: 2 mm', by the names before their colons.

    Raises:
        ValueError: Text of another form, or a name twice.
    """
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
    """Read one quantity of an option: options are text, and text other than 0 needs a unit."""
    from armcontour.core.errors import InvalidInput
    from armcontour.files.units import read_quantity

    quantity = get_args(kind)[1]
    plain = text.strip()
    number = plain_number(plain)
    if number:
        # Not the number with a unit: the unit that was meant is not known.
        raise InvalidInput(
            f"{option}: {plain!r} has no unit: write one, as in '{quantity.example}'."
        )
    try:
        return read_quantity(plain if number is None else number, quantity)
    except ValueError as error:
        raise InvalidInput(f"{option}: {str(error).rstrip('.')}.") from None
