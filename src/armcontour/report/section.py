"""Contents of a report page: sections, tables and tiles, which the template renders."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
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
# Maximum widths of tables that take a third and half of the page [characters].
NARROWEST, NARROW = 58, 88


@dataclass(frozen=True, slots=True, kw_only=True)
class TextTable:
    """Rows of text with a header; the first column names the row."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""

    @property
    def span(self) -> int:
        """Width in sixths of the section."""
        columns = [x for x in zip(self.header, *self.rows, strict=True) if x[0]]
        # Headers are wrapped, so only their longest word counts.
        width = sum(max(map(len, (*x[0].split(), *x[1:]))) + 3 for x in columns)
        return 2 if width <= NARROWEST and all(self.header) else 3 if width <= NARROW else 6


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
    """Tiles that show the first rows up to a level in large print, without the verdict.

    `places`: ids of marks by the names of rows; a row with a mark is always shown.
    """
    rows = [x for x in data.shown(level) if x.unit != JUDGED]
    return tuple(
        Tile(label=x.label, value=figure(x), note=x.note, place=places.get(x.name, ""))
        for k, x in enumerate(rows)
        if k < FEW_TILES or x.name in places
    )


def side_by_side(results: Mapping[str, Data], caption: str = "") -> TextTable:
    """Table of the values, one column per result; rows with sentences are omitted."""
    header, *rows = compare(results, TABLE, texts=True)
    columns = zip(header, *rows, strict=True)
    figures = [x for x in list(columns)[1:] if max(map(len, x[1:])) <= LONGEST]
    if len(rows) == 1:
        notes = {x.label: x.note for data in results.values() for x in data.shown()}
        figures = [(*x, notes[x[0]]) for x in figures]
        return TextTable(header=("figure", "value", ""), rows=tuple(figures), caption=caption)
    return TextTable(header=("figure", *results), rows=tuple(figures), caption=caption)


def text_table(table: result.Table, caption: str = "") -> TextTable:
    """Convert the labelled columns of a table to text."""
    header, *rows = cells(table)
    return TextTable(header=header, rows=tuple(rows), caption=caption)
