"""Contents of a report page: sections, tables and tiles, which the template renders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from itertools import chain
from types import MappingProxyType
from typing import Any

from armcontour.core import result
from armcontour.core.render import cells, compare, figure
from armcontour.core.result import JUDGED, TABLE, VERDICT, Data

# Number of rows in large print.
FEW_TILES = 3
NO_PLACES: Mapping[str, str] = MappingProxyType({})
# Values with more characters count as sentences, and tables of values omit their rows.
LONGEST = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class TextTable:
    """Rows of text with a header; the first column names the row."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    # True if two tables are next to each other on a wide page
    half: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One important value in large print."""

    label: str
    value: str
    note: str = ""
    # Id of the mark in the drawing that shows the value
    place: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A section of the report, which is folded at first."""

    # Anchor in the address
    key: str
    title: str
    # One line that is shown while the section is folded
    summary: str = ""
    # Introduction
    text: str = ""
    # Figures and tables
    parts: tuple[Any, ...] = ()
    # Groups of figures and tables by name; a selector shows one group
    choices: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    # Sentences at the end of the section
    notes: tuple[str, ...] = ()
    # True if the section is unfolded at first
    opened: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """The first screen of a report."""

    # One sentence
    verdict: str = ""
    # True if the verdict is positive; None if there is no criterion
    good: bool | None = None
    # True if the verdict is a warning, whether positive or negative
    doubtful: bool = False
    # The most important values
    tiles: tuple[Tile, ...] = ()
    tables: tuple[TextTable, ...] = ()
    # `Drawing` of the path; None if figures and tables (`parts`) replace it
    drawing: Any = None
    # `MovingArm` next to the drawing
    arm: Any = None
    parts: tuple[Any, ...] = ()
    # Headings and their sentences
    sentences: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """A first screen and the sections below it."""

    front: Front
    sections: Sequence[Section] = ()
    # Title if the page has several chapters
    title: str = ""


def tiles(
    data: Data, level: int = VERDICT, places: Mapping[str, str] = NO_PLACES
) -> tuple[Tile, ...]:
    """Show the first rows up to a level in large print, without the verdict.

    `places` has mark ids by row name; a row with a mark is always shown.
    """
    rows = [x for x in data.shown(level) if x.unit != JUDGED and not isinstance(x.value, bool)]
    return tuple(
        Tile(label=x.label, value=figure(x), note=x.note, place=places.get(x.name, ""))
        for k, x in enumerate(rows)
        if k < FEW_TILES or x.name in places
    )


def side_by_side(results: Mapping[str, Data], caption: str = "") -> tuple[TextTable, ...]:
    """Tabulate the values, one column per result, without rows of sentences or zeros.

    The values of one result have two tables, so that they are as wide as the page.
    """
    header, *rows = compare(results, TABLE, texts=True)
    columns = list(zip(header, *rows, strict=True))[1:]
    figures = [x for x in columns if _is_shown(x[1:])]
    if len(rows) > 1:
        return (TextTable(header=("figure", *results), rows=tuple(figures), caption=caption),)
    values = chain.from_iterable(x.shown() for x in results.values())
    notes = {x.label: x.note for x in values}
    figures = [(*x, notes[x[0]]) for x in figures]
    half = (len(figures) + 1) // 2
    return tuple(
        TextTable(header=("figure", "value", ""), rows=tuple(x), caption=caption, half=True)
        for x in (figures[:half], figures[half:])
    )


def _is_shown(texts: Sequence[str]) -> bool:
    """Return whether the values of a row are short texts that are not all 0 or missing."""
    if max(map(len, texts)) > LONGEST:
        return False
    return any(x.split()[0] not in ("0", "-") for x in texts)


def text_table(table: result.Table, caption: str = "") -> TextTable:
    """Convert the labelled columns of a table to text; joints have numbers and plain names."""
    header, *rows = cells(table)
    if header[0] == "joint":
        rows = [(f"{k} {joint_words(name)}", *x) for k, (name, *x) in enumerate(rows, start=1)]
    return TextTable(header=header, rows=tuple(rows), caption=caption)


def joint_words(name: str) -> str:
    """Return a joint name without the usual ending in robot descriptions."""
    return name.removesuffix("_joint").replace("_", " ")
