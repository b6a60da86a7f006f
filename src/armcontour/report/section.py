"""Data of a section of the report, which the template shows."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Any

from armcontour.core import result
from armcontour.core.render import cells, compare, figure
from armcontour.core.result import FIRST, TABLE, Data
from armcontour.jobs import RunResult, Study

# Longer values are sentences [characters].
LONGEST = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class Table:
    """Rows of text with a header; the first column names the row."""

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One important figure, in large print."""

    label: str
    value: str
    note: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A part of the report.

    Args:
        key: Anchor of the section.
        title: Heading of the section.
        text: Introduction.
        tiles: Figures in large print, by the names of their runs.
        figures: Figures, `Figure`.
        choices: Groups of figures of which one is shown, by their names in a selector.
        columns: Relative widths of figures in one row; by default every figure has a row.
        tables: Tables.
        notes: Sentences at the end.
    """

    key: str
    title: str
    text: str = ""
    tiles: tuple[tuple[str, tuple[Tile, ...]], ...] = ()
    figures: tuple[Any, ...] = ()
    choices: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    columns: tuple[int, ...] = ()
    tables: tuple[Table, ...] = ()
    notes: tuple[str, ...] = ()


def tiles(data: Data) -> tuple[Tile, ...]:
    """The figures of the first level in large print, and its sentences in small print."""
    found = []
    for x in data.shown(FIRST):
        value, note = figure(x), x.note
        if len(value) > LONGEST:
            value, note = "", f"{value} {note}".strip()
        found.append(Tile(label=x.label, value=value, note=note))
    return tuple(found)


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


def marked_run(study: Study) -> RunResult | None:
    """The run whose switching points are drawn: the last that has some."""
    switched = [x for x in study.runs.values() if len(x.trajectory.stretches) > 1]
    return switched[-1] if switched else None
