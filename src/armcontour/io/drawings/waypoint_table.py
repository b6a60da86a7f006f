"""Tables of waypoints as they stand in CSV and Parquet files: columns, and where rows are."""

from __future__ import annotations

import csv
import dataclasses
import io
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from armcontour._checks import FloatArray, IntArray
from armcontour.errors import InvalidInput
from armcontour.io.drawings.reading import Reading

POINT = ("x", "y", "z")
QUATERNION = ("qx", "qy", "qz", "qw")
ANGLES = ("roll", "pitch", "yaw")
AXIS = ("ax", "ay", "az")
TEXTS = ("contour", "layer", "event")
KNOWN = (*POINT, *QUATERNION, *ANGLES, *AXIS, "speed", "tolerance", *TEXTS)
# Most rows of a Parquet file, which compresses equal rows to nothing.
MOST_ROWS = 10_000_000
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
        return f"{place}, column {titles!r}" if titles else place


def table_of(data: bytes, *, source: str, kind: str, reading: Reading) -> Table:
    """The table in a CSV or Parquet file.

    Raises:
        InvalidInput: It is none, has no rows, or a column that is unknown, there twice or missing.
    """
    titled, places = (_csv if kind == "csv" else _parquet)(data, source)
    word = "line" if kind == "csv" else "row"
    table = _known(titled, Table(source, word, places, {}, ()), reading)
    if not len(places):
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
    twice = next((x for i, x in enumerate(titles) if x in titles[:i]), None)
    if twice is not None:
        raise InvalidInput(f"{source}, line {places[0]}: there are two columns {twice!r}.")
    for row, place in zip(rows, places, strict=True):
        if len(row) != len(titles):
            raise InvalidInput(
                f"{source}, line {place}: {len(row)} values, but {len(titles)} columns."
            )
    cells = zip(*rows[1:], strict=True) if len(rows) > 1 else [()] * len(titles)
    return dict(zip(titles, cells, strict=True)), np.array(places[1:], dtype=np.intp)


def _parquet(data: bytes, source: str) -> tuple[dict[str, Sequence[str] | FloatArray], IntArray]:
    """Columns of text or numbers by their titles, and the numbers of the rows."""
    try:
        import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]
        import pyarrow.parquet as pq  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise InvalidInput(
            f"{source}: reading Parquet needs pyarrow: pip install 'armcontour[tables]'."
        ) from None
    columns: dict[str, Sequence[str] | FloatArray] = {}
    try:
        file = pq.ParquetFile(pa.BufferReader(data))
        if file.metadata.num_rows > MOST_ROWS:
            raise InvalidInput(
                f"{source} has {file.metadata.num_rows} rows, more than the {MOST_ROWS} that are "
                "read: split it."
            )
        found = file.read()
        if len(set(found.column_names)) < len(found.column_names):
            raise InvalidInput(f"{source} has two columns of the same name.")
        for title in found.column_names:
            columns[title] = _arrow_cells(found.column(title), f"{source}, column {title!r}")
    except (pa.ArrowException, OSError, ValueError, TypeError, KeyError) as error:
        if isinstance(error, InvalidInput):
            raise
        said = str(error).split("\n")[0].rstrip(".")[:200]
        raise InvalidInput(f"{source} cannot be read as Parquet: {said}.") from None
    return columns, np.arange(1, found.num_rows + 1)


def _arrow_cells(column: Any, where: str) -> Sequence[str] | FloatArray:
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]

    kind = column.type.value_type if pa.types.is_dictionary(column.type) else column.type
    if pa.types.is_string(kind) or pa.types.is_large_string(kind) or pa.types.is_null(kind):
        return [(x or "").strip() for x in column.to_pylist()]
    if pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind):
        plain = column.cast(pa.float64(), safe=False)
        return np.array(plain.to_numpy(), dtype=np.float64)
    raise InvalidInput(f"{where} holds {kind}: numbers or text are read.")


def _known(
    titled: Mapping[str, Sequence[str] | FloatArray], empty: Table, reading: Reading
) -> Table:
    """The columns that are known, by what they hold; others are refused, or noted.

    Raises:
        InvalidInput: A column that is unknown, there twice or missing.
    """
    columns: dict[str, Column] = {}
    notes = []
    for title, cells in titled.items():
        match = _NAME.fullmatch(title.strip())
        key = match["name"].lower() if match else ""
        key = "event" if key == "events" else key
        if match is None or key not in KNOWN:
            if reading.unknown == "skip":
                notes.append(f"The column {title!r} of {empty.source} is not known: left out.")
                continue
            raise InvalidInput(
                f"{empty.source}: unknown column {title!r}: the columns are {', '.join(KNOWN)}, "
                "with a unit in brackets; with unknown: skip others are left out."
            )
        if key in columns:
            raise InvalidInput(
                f"{empty.source}: the columns {columns[key].title!r} and {title!r} hold the same."
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
