"""Presentation of results in text and files: the only place with mm, ms, degrees and digits."""

from __future__ import annotations

import json
import math
import re
import textwrap
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import replace
from itertools import chain
from pathlib import Path as FilePath
from typing import Any

import numpy as np

from armcontour.core.guesses import Explained
from armcontour.core.result import FIRST, JUDGED, TABLE, VERDICT, Data, Row, Table, nest
from armcontour.core.text import LINE_WIDTH, format_table

# The page of the Studio also reads this file.
PALETTE_FILE = FilePath(__file__).with_name("palette.json")
# Colours by theme, dashes [px] and words. Keys of limits are their names in explanations.
PALETTE: dict[str, Any] = json.loads(PALETTE_FILE.read_text("utf-8"))
LIMITS: dict[str, dict[str, Any]] = PALETTE["limits"]
VERDICTS: dict[str, dict[str, Any]] = PALETTE["verdicts"]
LINES: dict[str, str] = PALETTE["lines"]
# Display unit of each SI unit, and size of the display unit in the SI unit.
DISPLAY_UNITS = {
    "1": ("%", 1e-2),
    "m": ("mm", 1e-3),
    "m/s": ("mm/s", 1e-3),
    "rad": ("deg", math.pi / 180),
    "rad/s": ("deg/s", math.pi / 180),
}
# Spelling of units in text.
WRITTEN = {"m/s^2": "m/s²", "rad/s^2": "rad/s²", "rad/s^3": "rad/s³", "kg m^2": "kg m²"}
# Times below this are shown in ms [s].
SHORT_TIME = 0.1
# Number of significant digits.
SIGNIFICANT_DIGITS = 3
# Numbers below this, in their display unit, are shown with six decimals.
SIX_DECIMALS_BELOW = 1e-3
# Smaller numbers are written without an exponent.
SHORTEST_EXPONENT = 1e15
# Widest value that counts for the column in which notes begin [characters].
WIDEST_FIGURE = 21
# Widest line of a table [characters].
WIDEST_TABLE = 118
# Longest list in a JSON file.
MAX_LISTED = 10_000
# Shorter lengths are shown as "< 0.001 mm" on the page [m].
SMALLEST_LENGTH = 1e-6
SMALLEST_LENGTH_TEXT = "< 0.001"
# Shorter lengths in notes, as `number` writes them.
SHORTER_LENGTH = re.compile(r"(?<![-\d.])0\.000\d{3}(?= mm\b(?!/))")


def limit_style(kind: str) -> dict[str, Any]:
    """Return the colours, dashes and word for a kind of limit, from `palette.json`."""
    return LIMITS.get(kind, LIMITS["other"])


def digits_and_unit(value: Any, unit: str = "") -> tuple[str, str]:
    """Return the displayed digits of a value and its display unit.

    A missing value (None or NaN) is "-". A verdict, whose unit is `JUDGED`, is its word; True is
    "yes" and False "no". Texts, and whole numbers without a unit, are unchanged. The display unit
    is empty in these cases.

    >>> digits_and_unit(0.000252, "m")
    ('0.252', 'mm')
    """
    if value is None or (isinstance(value, float) and math.isnan(value)):
        return "-", ""
    if unit == JUDGED:
        return VERDICTS["kept" if value else "not kept"]["word"], ""
    if isinstance(value, bool):
        return "yes" if value else "no", ""
    is_count = isinstance(value, int) and not unit
    if is_count or isinstance(value, str):
        return str(value), ""
    number = float(value)
    is_short_time = unit == "s" and 0 < abs(number) < SHORT_TIME
    display_unit, size = ("ms", 1e-3) if is_short_time else scale(unit)
    return _digits(number / size), display_unit


def _digits(value: float) -> str:
    """Write a number with three significant digits, or six decimals below SIX_DECIMALS_BELOW."""
    if 0 < abs(value) < SIX_DECIMALS_BELOW:
        return f"{value:z.6f}"
    text = f"{value:z.{SIGNIFICANT_DIGITS}g}"
    is_written_in_full = "e+" in text and abs(value) < SHORTEST_EXPONENT
    return f"{float(text):.0f}" if is_written_in_full else text


def scale(unit: str) -> tuple[str, float]:
    """Return the display unit of a quantity, and its size in the SI unit."""
    return DISPLAY_UNITS.get(unit, (WRITTEN.get(unit, unit), 1.0))


def number(value: Any, unit: str = "") -> str:
    """Write a value with its display unit, as in "0.252 mm"."""
    return " ".join(filter(None, digits_and_unit(value, unit)))


def moment(t: float, decimals: int | None) -> str:
    """Write a time [s] with up to `decimals` decimals; with three significant digits if None."""
    if decimals is None:
        return number(t, "s")
    fixed = f"{t:z.{decimals}f}"
    return f"{fixed.rstrip('0').rstrip('.') if decimals else fixed} s"


def number_range(values: Iterable[float], unit: str = "") -> str:
    """Write the smallest and largest of some values; one of them if they look the same.

    >>> number_range([0.1, 0.2], "m")
    '100 to 200 mm'
    """
    ordered = sorted(values)
    if not ordered:
        return ""
    low = digits_and_unit(ordered[0], unit)
    high = digits_and_unit(ordered[-1], unit)
    if low == high:
        return " ".join(filter(None, high))
    start = low[0] if low[1] == high[1] else " ".join(low)
    return " ".join(filter(None, (start, "to", *high)))


def figure(row: Row) -> str:
    """Write the value of a row with its unit, and for what it holds.

    If joints have different units, write the largest value of each unit.
    """
    if row.decimals is not None and row.value is not None:
        return moment(row.value, row.decimals)
    units = row.unit.split(", ")
    if len(units) == 1 or row.value is None:
        return with_validity(number(row.figure, row.unit), row)
    values = row.value.values() if isinstance(row.value, Mapping) else row.value
    largest: dict[str, float] = {}
    for value, unit in zip(values, units, strict=True):
        largest[unit] = max(largest.get(unit, value), value)
    return ", ".join(number(x, unit) for unit, x in largest.items())


def with_validity(words: str, row: Row) -> str:
    """Return the words of a row's value with what they hold for, as in "kept, as modelled"."""
    return f"{words}, {row.holds}" if row.holds else words


def text(data: Data, level: int = TABLE) -> str:
    """Write a result as lines, for `print` and the command line."""
    rows = [(x.label, figure(x), x.note) for x in data.shown(level)]
    # The notes of all rows begin in one column.
    sizes = [len(value) for _, value, note in rows if note]
    width = max((x for x in sizes if x <= WIDEST_FIGURE), default=0)
    lines_of_values = []
    for label, value, note in rows:
        lines_of_values.append((label, f"{value:<{width}}  {note}" if note else value))
    lines = [format_table(data.title, lines_of_values)]
    lines += [lay_out(x.name, cells(x)) for x in data.tables if x.level <= level]
    return "\n".join(lines)


def lay_out(title: str, rows: Sequence[Sequence[str]]) -> str:
    """Write a table as lines below its title."""
    return format_table(title, rows, columns=">", width=WIDEST_TABLE)


def verdict(data: Data) -> str:
    """Write the verdict on a result in one sentence."""
    parts = []
    for row in data.shown(VERDICT):
        words = figure(row) if row.unit == JUDGED else f"{row.label} {figure(row)}"
        parts.append(f"{words} ({row.note})" if row.note else words)
    return f"{data.title}: {'; '.join(parts)}."


def cells(table: Table) -> list[tuple[str, ...]]:
    """Write a table as rows of text, the header first, without columns that have no label."""
    columns = [(k, x) for k, x in enumerate(table.columns) if x.label]
    rows = [tuple(_cell(x, row[k]) for k, x in columns) for row in table.rows]
    return [tuple(x.label for _, x in columns), *rows]


def _cell(column: Row, value: Any) -> str:
    """Write a value of a table with its unit and note."""
    if not isinstance(value, Row):
        return figure(replace(column, value=value))
    return " ".join(filter(None, [figure(value), value.note]))


def compare(
    results: Mapping[str, Data], level: int = FIRST, *, texts: bool = False
) -> list[tuple[str, ...]]:
    """Write several results as rows of text: the header, then a row per result.

    The title of the table says for what the values hold.
    """
    rows = {}
    for name, data in results.items():
        compared = (x for x in data.shown(level) if texts or not isinstance(x.value, str))
        rows[name] = {x.label: figure(replace(x, holds="")) for x in compared}
    # The result with the most values determines the order of the columns.
    longest = sorted(rows.values(), key=len, reverse=True)
    labels = list(dict.fromkeys(chain.from_iterable(longest)))
    table: list[tuple[str, ...]] = [("run", *labels)]
    for name, row in rows.items():
        table.append((name, *(row.get(x, "-") for x in labels)))
    return table


def plain(data: Data) -> dict[str, Any]:
    """Convert a result to mappings and lists in SI units, for JSON.

    Lists are truncated after 10,000 entries; `left_out` has the number of omitted entries.
    """
    figures = nest((x.name, x.value) for x in data.rows)
    for table in data.tables:
        figures[table.name] = table.as_dicts(MAX_LISTED)
    cut = {x.name: len(x.rows) - MAX_LISTED for x in data.tables if len(x.rows) > MAX_LISTED}
    if cut:
        figures["left_out"] = cut
    page = {key: jsonable(value) for key, value in figures.items()}
    return page | {key: plain(part) for key, part in data.parts.items()}


def jsonable(value: Any) -> Any:
    """Convert a value for JSON: arrays to lists, infinite numbers to null, classes to names."""
    if value is None or isinstance(value, bool | int | str):
        return value
    if isinstance(value, type):
        return value.__name__
    if isinstance(value, float):
        return value if math.isfinite(value) else None
    if isinstance(value, Mapping):
        return {str(key): jsonable(x) for key, x in value.items()}
    if isinstance(value, np.ndarray | np.generic):
        return jsonable(value.tolist())
    return [jsonable(x) for x in value]


def units_by_name(results: Iterable[Data]) -> dict[str, str]:
    """Map each value's name to its unit, for JSON.

    A value in a part is listed twice, as `part.name` and as `name`. Values without a unit are
    omitted.
    """
    units: dict[str, str] = {}
    for data in results:
        named = list(data.walk())
        for table in data.tables:
            named += [(x.name, x) for x in table.columns]
        for name, row in named:
            if row.unit and row.unit != JUDGED:
                units[name] = row.unit
        units |= units_by_name(data.parts.values())
    return units


def frame(data: Data) -> list[dict[str, Any]]:
    """List the displayed values of a result for the Studio's page."""
    figures = []
    for row in data.shown():
        has_several_units = ", " in row.unit
        if has_several_units:
            digits_shown = figure(row)
            unit = ""
        else:
            digits_shown, unit = digits_and_unit(row.figure, row.unit)
        if row.unit == "m" and 0.0 < row.figure < SMALLEST_LENGTH:
            digits_shown = SMALLEST_LENGTH_TEXT
            unit = "mm"
        figures.append(
            {
                "name": row.name,
                "label": row.label,
                "value": row.figure,
                "text": with_validity(digits_shown, row),
                "unit": unit,
            }
            | ({"note": SHORTER_LENGTH.sub(SMALLEST_LENGTH_TEXT, row.note)} if row.note else {})
        )
    return figures


class Result(Explained):
    """Base of results: text, HTML and JSON follow from `to_data`."""

    __slots__ = ()

    def to_data(self) -> Data:
        """Return values, tables and sentences of the result."""
        raise NotImplementedError

    def __str__(self) -> str:
        """Write values, warnings and what the result does not prove as lines."""
        data = self.to_data()
        warnings = (Row("warning", x, "", "warning", level=TABLE) for x in data.warnings)
        rows = text(replace(data, rows=(*data.rows, *warnings)))
        return "\n".join([rows, *textwrap.wrap(data.not_proven, LINE_WIDTH)])
