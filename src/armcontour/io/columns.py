"""Titles of columns in CSV files: the quantity of each column, and its unit."""

from __future__ import annotations

import re
from collections.abc import Callable, Hashable, Sequence
from dataclasses import dataclass
from typing import Generic, TypeVar

from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.number_table import NUMBER
from armcontour.io.units import parse

Key = TypeVar("Key", bound=Hashable)
# A number in brackets, as in q[0], is an index and no unit.
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>(?!\d*[\])])[^\])]*)[\])]")
# Title of a column that is not needed.
SKIPPED = "-"
# For pint an angle is a plain number, so that "1/s" would be accepted as "rad/s".
_ANGLE = re.compile("rad|deg|turn|rev|rpm")


@dataclass(frozen=True, slots=True)
class Column(Generic[Key]):
    """A column, as described by its title.

    Args:
        key: The quantity in the column.
        index: Index of the column, from 0.
        title: The title as in the file.
        unit: The unit as in the title; None without one.
        factor: Factor from the unit to SI units; 1 without a unit.
    """

    key: Key
    index: int
    title: str
    unit: str | None
    factor: float


def read_titles(
    titles: Sequence[str],
    *,
    where: str,
    example: str,
    key_of: Callable[[str, bool], tuple[Key, str | None] | tuple[Key, str | None, int] | None],
    si_of: Callable[[Key], str | None],
    unknown: Callable[[str], None],
    option: str = "",
) -> dict[Key, Column[Key]]:
    """Read the titles of columns.

    A unit follows the name in brackets, `q1 [deg]`, or is a part of the name, such as `q1_deg`.

    Args:
        titles: All titles.
        where: File and line of the titles, for messages.
        example: Valid titles, for messages.
        key_of: Takes a name, and whether a unit in brackets follows. Gives the quantity, the unit
            in the name, and perhaps a rank; None for an unknown name. Of columns of one quantity,
            the one of the lowest rank is used.
        si_of: Takes a quantity and gives its SI unit; None if it has none.
        unknown: Called with every title that is not used but SKIPPED; may raise an error.
        option: The option that names the columns, for messages.

    Returns:
        The known columns by their quantities, in their order.

    Raises:
        InvalidInput: Numbers instead of titles, two columns for one quantity, or a wrong unit.
    """
    if all(NUMBER.fullmatch(x) for x in titles):
        raise InvalidInput(f"{where}: the first line must name the columns, such as {example}.")
    found: dict[Key, Column[Key]] = {}
    ranks: dict[Key, int] = {}
    for index, title in enumerate(titles):
        match = _BRACKETS.fullmatch(title)
        name, unit = (match["name"], match["unit"]) if match else (title, None)
        known = key_of(name, unit is not None)
        if known is None:
            if title != SKIPPED:
                unknown(title)
            continue
        key, suffix = known[:2]
        rank = known[2] if len(known) == 3 else 0
        if unit is not None and suffix is not None:
            raise InvalidInput(f"{where}: the column {show(title)} has two units: leave one out.")
        if key in found and rank == ranks[key]:
            fix = f": leave one out, such as with {option} '{SKIPPED}={title}'" if option else ""
            raise InvalidInput(f"{where}: {_describe_twice(found[key].title, title)}{fix}.")
        if key in found:
            unknown(title if rank > ranks[key] else found[key].title)
            if rank > ranks[key]:
                continue
        unit = suffix if unit is None else unit
        factor = 1.0 if unit is None else _factor(unit, si_of(key), title, where)
        found[key], ranks[key] = Column(key, index, title, unit, factor), rank
    return found


def _describe_twice(first: str, second: str) -> str:
    """What is wrong with two columns of one quantity, for messages."""
    if first == second:
        return f"there are two columns {show(first)}"
    return f"the columns {show(first)} and {show(second)} hold the same"


def _factor(unit: str, si: str | None, title: str, where: str) -> float:
    """Factor from a unit in a title to an SI unit."""
    plain = unit.strip().replace("²", "^2").replace("°", "deg")
    try:
        factor = 0.0 if si is None else parse(f"1 {plain}", si)
    except ValueError:
        factor = 0.0
    if factor <= 0 or (si is not None and "rad" in si and not _ANGLE.search(plain)):
        wanted = f"one that converts to {si}" if si else "wanted: the column has none"
        raise InvalidInput(
            f"{where}: the unit {show(unit)} of the column {show(title)} is not {wanted}."
        )
    return factor
