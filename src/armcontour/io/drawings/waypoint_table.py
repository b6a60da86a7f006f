"""Read tables of waypoints from CSV: columns, cells and line numbers."""

from __future__ import annotations

import csv
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import IntArray
from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.columns import Column, read_titles
from armcontour.io.drawings.options import ReadOptions
from armcontour.io.number_table import split_csv, split_line

POINT = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
ANGLES = ("roll", "pitch", "yaw")
AXIS = ("ax", "ay", "az")
TEXTS = ("contour", "layer", "event")
KNOWN = (*POINT, *QUATERNION, *ANGLES, *AXIS, "speed", "tolerance", *TEXTS)
# SI units of the columns that have one.
UNITS = {
    **dict.fromkeys((*POINT, "tolerance"), "m"),
    **dict.fromkeys(ANGLES, "rad"),
    "speed": "m/s",
}
_NAME = re.compile(r"(?P<name>[A-Za-z]+)(?:_(?P<unit>[A-Za-zµ°]\S*))?")


@dataclass(frozen=True, slots=True)
class Table:
    """A table of waypoints.

    Args:
        source: Name of the file.
        places: Line of each row in the file, from 1.
        columns: The known columns.
        cells: Cells by columns.
        notes: Notes on columns that were left out.
    """

    source: str
    places: IntArray
    columns: Mapping[str, Column[str]]
    cells: Mapping[str, Sequence[str]]
    notes: tuple[str, ...]

    def where(self, i: int, *keys: str) -> str:
        """File, number of row `i` and titles of columns, for messages."""
        titles = " ".join(self.columns[key].title for key in keys)
        place = f"{self.source}, line {self.places[i]}"
        return f"{place}, column {show(titles)}" if titles else place


def table_of(data: bytes, *, source: str, options: ReadOptions) -> Table:
    """Read the table in a CSV file.

    Raises:
        InvalidInput: No table, no rows, or a column that is unknown, repeated or missing.
    """
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInput(f"{source} is not UTF-8 text: save it as CSV in UTF-8.") from None
    file = split_csv(text, source, options.columns, decimal_commas=False)
    where = f", line {file.header}" if file.header else ", columns"
    columns, notes = _columns(file.names, source, where, options)
    rows = []
    for i, line in enumerate(file.lines):
        try:
            row = split_line(line, file.separator)
        except csv.Error as error:
            raise InvalidInput(f"{file.place(i)}: {error}.") from None
        if len(row) != len(file.names):
            raise InvalidInput(
                f"{file.place(i)}: {len(row)} values, but {len(file.names)} columns."
            )
        rows.append(row)
    if not rows:
        raise InvalidInput(f"{source} has column names, but no waypoints.")
    cells = {key: [row[x.index] for row in rows] for key, x in columns.items()}
    return Table(source, np.array(file.numbers, dtype=np.intp), columns, cells, notes)


def _columns(
    titles: Sequence[str], source: str, line: str, options: ReadOptions
) -> tuple[dict[str, Column[str]], tuple[str, ...]]:
    """The known columns by their quantity, and notes on unknown columns that are skipped.

    Raises:
        InvalidInput: A column that is unknown, repeated or missing, or has a wrong unit.
    """
    notes: list[str] = []

    def unknown(title: str) -> None:
        if not options.skips:
            raise InvalidInput(
                f"{source}: unknown column {show(title)}: the columns are {', '.join(KNOWN)}, with "
                "a unit in brackets; with unknown: skip others are left out."
            )
        notes.append(f"The column {show(title)} of {source} is not known: left out.")

    columns = read_titles(
        titles,
        where=f"{source}{line}",
        example="x [mm],y [mm]",
        key_of=lambda name, _: _key(name),
        si_of=UNITS.get,
        unknown=unknown,
    )
    for group, needed in ((POINT[:2], True), *((x, False) for x in (QUATERNION, ANGLES, AXIS))):
        missing = [key for key in group if key not in columns]
        if missing and (needed or len(missing) < len(group)):
            raise InvalidInput(
                f"{source}: the column {missing[0]} is missing: the first line must name the "
                "columns, such as x [mm],y [mm],z [mm]."
            )
    return columns, tuple(notes)


def _key(name: str) -> tuple[str, str | None] | None:
    """Quantity of a column by its name, and the unit in the name; None if unknown."""
    match = _NAME.fullmatch(name.strip())
    key = match["name"].lower() if match else ""
    key = "event" if key == "events" else key
    if match is None or key not in KNOWN:
        return None
    unit = match["unit"]
    return key, unit and unit.replace("_per_", "/").replace("_", "/")
