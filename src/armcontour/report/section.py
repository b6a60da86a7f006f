"""Contents of a report page: sections, tables and tiles, which the template renders."""

from __future__ import annotations

import re
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
# Names of joints that are numbers.
NUMBERED = re.compile(r"joint \d+")
# Values with more characters count as sentences, and tables of values omit their rows.
LONGEST = 40


@dataclass(frozen=True, slots=True, kw_only=True)
class TextTable:
    """Rows of text with a header; the first column names the row.

    Args:
        header: Column heads.
        rows: The rows.
        caption: Title; empty without one.
        half: True if two tables are next to each other on a wide page.
        links: Anchor to which the first cell of each row leads; empty without one.
    """

    header: tuple[str, ...]
    rows: tuple[tuple[str, ...], ...]
    caption: str = ""
    half: bool = False
    links: tuple[str, ...] = ()


@dataclass(frozen=True, slots=True, kw_only=True)
class Tile:
    """One important value in large print.

    Args:
        label: Name of the value.
        value: The value as text.
        note: A remark below the value; empty without one.
        place: Id of the mark in the drawing that shows the value.
    """

    label: str
    value: str
    note: str = ""
    place: str = ""


@dataclass(frozen=True, slots=True, kw_only=True)
class Section:
    """A section of the report, which is folded at first.

    Args:
        key: Anchor in the address.
        title: Title.
        summary: One line that is shown while the section is folded.
        text: Introduction.
        mouse: How to use the figures with a mouse; not printed.
        parts: Figures and tables.
        choices: Groups of figures and tables by name; a selector shows one group.
        notes: Sentences at the end of the section.
        opened: True if the section is unfolded at first.
    """

    key: str
    title: str
    summary: str = ""
    text: str = ""
    mouse: str = ""
    parts: tuple[Any, ...] = ()
    choices: tuple[tuple[str, tuple[Any, ...]], ...] = ()
    notes: tuple[str, ...] = ()
    opened: bool = False


@dataclass(frozen=True, slots=True, kw_only=True)
class Front:
    """The first screen of a report.

    Args:
        verdict: The verdict, one sentence.
        good: True if the verdict is positive; None if there is no criterion.
        doubtful: True if the verdict is a warning, whether positive or negative.
        tiles: The most important values.
        tables: Tables below the tiles.
        drawing: `Drawing` of the path; None if `parts` replace it.
        arm: `MovingArm` next to the drawing.
        parts: Figures and tables that replace the drawing.
        sentences: Headings and their sentences.
        advice: Heading and sentence on how to make more of the report; not printed.
    """

    verdict: str = ""
    good: bool | None = None
    doubtful: bool = False
    tiles: tuple[Tile, ...] = ()
    tables: tuple[TextTable, ...] = ()
    drawing: Any = None
    arm: Any = None
    parts: tuple[Any, ...] = ()
    sentences: tuple[tuple[str, str], ...] = ()
    advice: tuple[str, str] | None = None


@dataclass(frozen=True, slots=True, kw_only=True)
class Chapter:
    """A first screen and the sections below it.

    Args:
        front: The first screen.
        sections: The sections.
        title: Title if the page has several chapters.
    """

    front: Front
    sections: Sequence[Section] = ()
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
    continued = caption and f"{caption}, continued"
    return tuple(
        TextTable(header=("figure", "value", ""), rows=tuple(x), caption=text, half=True)
        for text, x in ((caption, figures[:half]), (continued, figures[half:]))
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
        rows = [(_joint_label(k, name), *x) for k, (name, *x) in enumerate(rows, start=1)]
    return TextTable(header=header, rows=tuple(rows), caption=caption)


def _joint_label(number: int, name: str) -> str:
    """Return the number of a joint and its name, unless the name is only a number."""
    words = joint_words(name)
    return words if NUMBERED.fullmatch(words) else f"{number} {words}"


def joint_words(name: str) -> str:
    """Return a joint name without the usual ending in robot descriptions."""
    return name.removesuffix("_joint").replace("_", " ")
