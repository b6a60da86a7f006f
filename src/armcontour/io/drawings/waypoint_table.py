"""Tables of waypoints as they stand in CSV and Parquet files: columns, and where rows are."""

from __future__ import annotations

import csv
import dataclasses
import io
import re
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.drawings._parquet import ParquetTable
from armcontour.io.drawings.reading import Reading

POINT = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
ANGLES = ("roll", "pitch", "yaw")
AXIS = ("ax", "ay", "az")
TEXTS = ("contour", "layer", "event")
KNOWN = (*POINT, *QUATERNION, *ANGLES, *AXIS, "speed", "tolerance", *TEXTS)
_NAME = re.compile(
    r"(?P<name>[A-Za-z]+)(?:\s*[\[(](?P<unit>[^\])]*)[\])]|_(?P<suffix>[A-Za-zµ°]\S*))?"
)


@dataclass(frozen=True, slots=True)
class Column:
    """A column as it stands in the file: text, or numbers with NaN where there is none."""

    title: str
    unit: str | None
    cells: Sequence[str] | FloatArray


@dataclass(frozen=True, slots=True)
class Table:
    """Columns by what they hold, and where each row stands in the file."""

    source: str
    word: str
    places: IntArray
    columns: Mapping[str, Column]
    notes: tuple[str, ...]

    def where(self, i: int, *keys: str) -> str:
        """Row `i`, and the columns that are meant, for messages."""
        titles = " ".join(self.columns[key].title for key in keys)
        place = f"{self.source}, {self.word} {self.places[i]}"
        return f"{place}, column {show(titles)}" if titles else place


def table_of(data: bytes, *, source: str, kind: str, reading: Reading) -> Table:
    """The table in a CSV or Parquet file.

    Raises:
        InvalidInput: It is none, has no rows, or a column that is unknown, there twice or missing.
    """
    if kind == "csv":
        titled, places = _csv(data, source)
        table = _keep_known(titled, Table(source, "line", places, {}, ()), reading)
    else:
        table = _parquet(data, source, reading)
    if not len(table.places):
        raise InvalidInput(f"{source} has column names, but no waypoints.")
    return table


def _csv(data: bytes, source: str) -> tuple[dict[str, Sequence[str] | FloatArray], IntArray]:
    """Columns of text by their titles, and the lines that the rows end on."""
    try:
        text = data.decode("utf-8-sig")
    except UnicodeDecodeError:
        raise InvalidInput(f"{source} is not UTF-8 text: save it as CSV in UTF-8.") from None
    lines = ["" if x.lstrip().startswith("#") else x for x in io.StringIO(text, newline=None)]
    header = next((x for x in lines if x.strip()), "")
    separator = next((x for x in ";\t" if x in header), ",")
    reader = csv.reader(lines, delimiter=separator, strict=True)
    rows, places = [], []
    try:
        for row in reader:
            stripped = [x.strip() for x in row]
            if any(stripped):
                rows.append(stripped)
                places.append(reader.line_num)
    except csv.Error as error:
        raise InvalidInput(f"{source}, line {reader.line_num}: {error}.") from None
    if not rows:
        raise InvalidInput(f"{source} is empty: it must have a line of column names and rows.")
    titles = rows[0]
    if all(x[:1] in "+-.0123456789" for x in titles):
        raise InvalidInput(
            f"{source}, line {places[0]}: the first line must name the columns, such as "
            "x [mm],y [mm]."
        )
    twice = [x for x, count in Counter(titles).items() if count > 1]
    if twice:
        raise InvalidInput(f"{source}, line {places[0]}: there are two columns {show(twice[0])}.")
    for row, place in zip(rows, places, strict=True):
        if len(row) != len(titles):
            raise InvalidInput(
                f"{source}, line {place}: {len(row)} values, but {len(titles)} columns."
            )
    cells = zip(*rows[1:], strict=True) if len(rows) > 1 else [()] * len(titles)
    return dict(zip(titles, cells, strict=True)), np.array(places[1:], dtype=np.intp)


def _parquet(data: bytes, source: str, reading: Reading) -> Table:
    """The table in a Parquet file, of which only columns that are known are unpacked."""
    file = ParquetTable(data, source)
    nowhere = np.zeros(0, dtype=np.intp)
    table = _keep_known(
        dict.fromkeys(file.titles, ()), Table(source, "row", nowhere, {}, ()), reading
    )
    cells = file.cells([x.title for x in table.columns.values()])
    columns = {
        key: dataclasses.replace(x, cells=cells[x.title]) for key, x in table.columns.items()
    }
    places = np.arange(1, file.rows + 1)
    return dataclasses.replace(table, places=places, columns=columns)


def _keep_known(
    titled: Mapping[str, Sequence[str] | FloatArray], empty: Table, reading: Reading
) -> Table:
    """The columns that are known, by what they hold; others are refused, or noted.

    Raises:
        InvalidInput: A column that is unknown, there twice or missing.
    """
    columns: dict[str, Column] = {}
    notes: list[str] = []
    for title, cells in titled.items():
        match = _NAME.fullmatch(title.strip())
        key = match["name"].lower() if match else ""
        key = "event" if key == "events" else key
        if match is None or key not in KNOWN:
            if reading.unknown == "skip":
                notes.append(f"The column {show(title)} of {empty.source} is not known: left out.")
                continue
            raise InvalidInput(
                f"{empty.source}: unknown column {show(title)}: the columns are "
                f"{', '.join(KNOWN)}, with a unit in brackets; with unknown: skip others are left "
                "out."
            )
        if key in columns:
            raise InvalidInput(
                f"{empty.source}: the columns {show(columns[key].title)} and {show(title)} hold "
                "the same."
            )
        suffix = match["suffix"] and match["suffix"].replace("_per_", "/").replace("_", "/")
        columns[key] = Column(title, match["unit"] if match["unit"] is not None else suffix, cells)
    for group, needed in ((POINT[:2], True), *((x, False) for x in (QUATERNION, ANGLES, AXIS))):
        missing = [key for key in group if key not in columns]
        if missing and (needed or len(missing) < len(group)):
            raise InvalidInput(
                f"{empty.source}: the column {missing[0]} is missing: the first line must name "
                "the columns, such as x [mm],y [mm],z [mm]."
            )
    return dataclasses.replace(empty, columns=columns, notes=tuple(notes))
