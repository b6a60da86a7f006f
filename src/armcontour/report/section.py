"""Data of a page of the report, which the template shows."""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from armcontour.core import result
from armcontour.core.render import cells, compare, figure
from armcontour.core.result import TABLE, Data, Row
from armcontour.report.drawing import Drawing

# Longer values are sentences [characters].
LONGEST = 40
# Widest tables that take a third and half of the page [characters].
NARROWEST, NARROW = 58, 88


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of text with a header; the first column names the row."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""

    @property
    def span(self) -> int:
        """Its width in a section, in sixths."""
        columns = [x for x in zip(self.header, *self.rows, strict=True) if x[0]]
        # Headers are wrapped.
        width = sum(max(map(len, (*x[0].split(), *x[1:]))) + 3 for x in columns)
        return 2 if width <= NARROWEST and all(self.header) else 3 if width <= NARROW else 6

    @property
    def halves(self) -> tuple[Table, ...]:
        """A long table as two that are side by side."""
        half = -(-len(self.rows) // 2)
        return tuple(replace(self, rows=x) for x in (self.rows[:half], self.rows[half:]))


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One important figure, in large print."""

    label: str
    value: str
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A folded part of the report.

    Args:
        key: Anchor of the section.
        title: Heading of the section.
        summary: What it says in a line, which is seen while it is folded.
        text: Introduction.
        parts: Figures, `Figure`, and tables.
        choices: Groups of parts of which one is shown, by their names in a selector.
        notes: Sentences at the end.
    """

    key: str
    title: str
    summary: str = ""
    text: str = ""
    parts: tuple[Any, ...] = ()
    choices: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """The first screen: the answer.

    Args:
        verdict: The answer in a sentence.
        good: Whether it is good; None if nothing was judged.
        tiles: The three most important figures.
        tables: Tables below the tiles.
        drawing: The drawing of the path.
        parts: Figures and tables in its place.
        sentences: Sentences with their headings.
    """

    verdict: str = ""
    good: bool | None = None
    tiles: tuple[Tile, ...] = ()
    tables: tuple[Table, ...] = ()
    drawing: Drawing | None = None
    parts: tuple[Any, ...] = ()
    sentences: tuple[tuple[str, str], ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """A first screen with the sections below it.

    Args:
        front: The first screen.
        sections: The sections.
        title: Its title, if a page has several.
    """

    front: Front
    sections: Sequence[Section] = ()
    title: str = ""


def tiles(rows: Iterable[Row]) -> tuple[Tile, ...]:
    """Figures in large print."""
    return tuple(Tile(label=x.label, value=figure(x), note=x.note) for x in rows)


def side_by_side(results: Mapping[str, Data], level: int = TABLE, caption: str = "") -> Table:
    """A row for every figure that is no sentence, and a column for every result.

    Args:
        results: The results, by their names.
        level: The last level that is shown.
        caption: Caption of the table.
    """
    header, *rows = compare(results, level, texts=True)
    columns = zip(header, *rows, strict=True)
    figures = [x for x in list(columns)[1:] if max(map(len, x[1:])) <= LONGEST]
    if len(rows) == 1:
        notes = {x.label: x.note for data in results.values() for x in data.shown(level)}
        figures = [(*x, notes[x[0]]) for x in figures]
        return Table(header=("figure", "value", ""), rows=tuple(figures), caption=caption)
    return Table(header=("figure", *results), rows=tuple(figures), caption=caption)


def table_of(table: result.Table, caption: str = "") -> Table:
    """A table of a result, of the columns with a label.

    Args:
        table: The table.
        caption: Its caption.
    """
    header, *rows = cells(table)
    return Table(header=header, rows=tuple(rows), caption=caption)
