"""Titles of columns: what each column holds, and what makes SI units of its numbers."""

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
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>[^\])]*)[\])]")
# To the library of units an angle is a bare number, so that "1/s" would pass for "rad/s".
_ANGLE = re.compile("rad|deg|turn|rev|rpm")


@dataclass(frozen=True, slots=True)
class Column(Generic[Key]):
    """A column by its title.

    Args:
        key: What it holds.
        index: Its place, from 0.
        title: As it stands in the file.
        unit: As it stands in the title; None without one.
        factor: Its numbers times this are in SI units; 1 without a unit.
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
    key_of: Callable[[str, bool], tuple[Key, str | None] | None],
    si_of: Callable[[Key], str | None],
    unknown: Callable[[str], None],
) -> dict[Key, Column[Key]]:
    """The columns by what they hold, in their order.

    A unit stands in brackets after the name, `q1 [deg]`, or in it, as the file's own names have it.

    Args:
        titles: All titles.
        where: The place of the titles, for messages.
        example: Titles as they should be.
        key_of: What a column of a name holds, and the unit in that name; None where the name is not
            known. Also takes whether a unit in brackets follows.
        si_of: The SI unit of what a column holds; None where it has no unit.
        unknown: Called with titles that are not known; refuses them, or not.

    Raises:
        InvalidInput: Numbers instead of titles, two columns for the same, or another unit.
    """
    if all(NUMBER.fullmatch(x) for x in titles):
        raise InvalidInput(f"{where}: the first line must name the columns, such as {example}.")
    found: dict[Key, Column[Key]] = {}
    for index, title in enumerate(titles):
        match = _BRACKETS.fullmatch(title)
        name, unit = (match["name"], match["unit"]) if match else (title, None)
        known = key_of(name, unit is not None)
        if known is None:
            unknown(title)
            continue
        key, suffix = known
        if unit is not None and suffix is not None:
            raise InvalidInput(f"{where}: the column {show(title)} has two units: leave one out.")
        if key in found:
            raise InvalidInput(f"{where}: {_alike(found[key].title, title)}.")
        unit = suffix if unit is None else unit
        factor = 1.0 if unit is None else _factor(unit, si_of(key), title, where)
        found[key] = Column(key, index, title, unit, factor)
    return found


def _alike(first: str, second: str) -> str:
    if first == second:
        return f"there are two columns {show(first)}"
    return f"the columns {show(first)} and {show(second)} hold the same"


def _factor(unit: str, si: str | None, title: str, where: str) -> float:
    plain = unit.strip().replace("²", "^2").replace("°", "deg")
    try:
        factor = 0.0 if si is None else parse(f"1 {plain}", si)
    except ValueError:
        factor = 0.0
    if factor <= 0 or (si is not None and "rad" in si and not _ANGLE.search(plain)):
        wanted = f"one of {si}" if si else "wanted: the column has none"
        raise InvalidInput(
            f"{where}: the unit {show(unit)} of the column {show(title)} is not {wanted}."
        )
    return factor
