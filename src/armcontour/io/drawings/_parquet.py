"""Columns of Parquet files, whose unpacked size is checked before pyarrow allocates memory.

The sizes in the metadata at the end of a file are not enough, because a file can state any size.
pyarrow unpacks pages and allocates the size that each page's header states. This module reads the
metadata and the page headers itself, by the definitions in `parquet.thrift` of the Apache Parquet
project: pyarrow does not show page headers, and reading broken column metadata with pyarrow can
crash the process.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from armcontour._checks import FloatArray
from armcontour._files import MEGABYTE
from armcontour._text import show
from armcontour.errors import InvalidInput
from armcontour.io.drawings._thrift import Reader

# Largest unpacked size of the columns that are read [bytes]; a number has eight bytes.
MOST_UNPACKED = 128 * MEGABYTE
# Longest cell of text [characters]; all rows may repeat it.
LONGEST_CELL = 10_000
# Largest size of the metadata at the end of a file [bytes]; usually they have some kilobytes.
MOST_FOOTER = 4 * MEGABYTE
MAGIC = b"PAR1"
# The format stores the sizes of a page in 32 bits.
LARGEST_PAGE = 2**31 - 1
# Field numbers of the structs FileMetaData, RowGroup, ColumnChunk, ColumnMetaData and PageHeader,
# one line each, ColumnMetaData on three.
ROW_GROUPS = 4
COLUMNS, NUM_ROWS = 1, 3
META_DATA = 3
NUM_VALUES = 5
TOTAL_UNCOMPRESSED_SIZE, TOTAL_COMPRESSED_SIZE = 6, 7
DATA_PAGE_OFFSET, DICTIONARY_PAGE_OFFSET = 9, 11
UNCOMPRESSED_PAGE_SIZE, COMPRESSED_PAGE_SIZE = 2, 3


class ParquetTable:
    """A Parquet file, opened but not unpacked.

    Args:
        data: Content of the file.
        source: Name of the file.

    Raises:
        InvalidInput: pyarrow is not installed, the data are not a Parquet file, or two columns
            have the same name.
    """

    def __init__(self, data: bytes, source: str) -> None:
        try:
            import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]
            import pyarrow.parquet as pq  # type: ignore[import-untyped, unused-ignore]
        except ImportError:
            raise InvalidInput(
                f"{source}: reading Parquet needs pyarrow: pip install 'armcontour[tables]'."
            ) from None
        self.data = data
        self.source = source
        try:
            self.about = _footer(data)
            # Columns of text are read as dictionaries, so that a text that all rows repeat is
            # unpacked once.
            texts = _text_columns(pq.ParquetFile(pa.BufferReader(data)))
            self.file = pq.ParquetFile(pa.BufferReader(data), read_dictionary=texts)
            self.rows = int(self.file.metadata.num_rows)
            self.titles = list(self.file.schema_arrow.names)
        except Exception as error:  # a broken file makes the library raise anything
            raise self._unreadable(error) from None
        if len(set(self.titles)) < len(self.titles):
            raise InvalidInput(f"{source} has two columns of the same name.")

    def cells(self, titles: Sequence[str]) -> dict[str, Sequence[str] | FloatArray]:
        """Columns by their titles: texts, or numbers with NaN for empty cells.

        Raises:
            InvalidInput: A column is too large, of another type, or broken.
        """
        try:
            for title in titles:
                _refuse_type(self.file.schema_arrow.field(title).type, self._where(title))
            self._refuse_large(titles)
            found = self.file.read(columns=list(titles), use_threads=False)
            if found.num_rows != self.rows:
                raise ValueError("the number of rows differs from the one in its metadata")
            return {x: _cells(found.column(x), self._where(x)) for x in titles}
        except InvalidInput:
            raise
        except Exception as error:  # a broken file makes the library raise anything
            raise self._unreadable(error) from None

    def _where(self, title: str) -> str:
        """The file and a column, for messages."""
        return f"{self.source}, column {show(title)}"

    def _unreadable(self, error: Exception) -> InvalidInput:
        """The refusal of a broken file, with the first line of the library's message."""
        reason = str(error).split("\n")[0].rstrip(".")[:200]
        return InvalidInput(f"{self.source} cannot be read as Parquet: {reason}.")

    def _refuse_large(self, titles: Sequence[str]) -> None:
        """Refuse columns that are too large by the file's metadata or by their page headers.

        Raises:
            InvalidInput: The columns unpack to more than `MOST_UNPACKED`.
        """
        chunks = list(self._chunks(titles))
        rows = max(self.rows, sum(x[NUM_ROWS] for x in self.about[ROW_GROUPS]))
        values = sum(max(0, x[META_DATA][NUM_VALUES]) for x in chunks)
        stated = sum(max(0, x[META_DATA][TOTAL_UNCOMPRESSED_SIZE]) for x in chunks)
        size = max(stated, 8 * values, 8 * rows * len(titles))
        if size <= MOST_UNPACKED:
            size = max(size, sum(_unpacked_size(self.data, x) for x in chunks))
        if size > MOST_UNPACKED:
            raise InvalidInput(
                f"{self.source} unpacks to {size / MEGABYTE:.0f} MB, more than the "
                f"{MOST_UNPACKED / MEGABYTE:.0f} MB that are read: split it."
            )

    def _chunks(self, titles: Sequence[str]) -> Iterator[dict[int, Any]]:
        """Yield the struct ColumnChunk of each of the columns in each group of rows."""
        paths = [self.file.schema.column(i).path for i in range(len(self.file.schema))]
        for group in self.about[ROW_GROUPS]:
            # pyarrow identifies columns by their order, not by the names in the row groups.
            for path, chunk in zip(paths, group[COLUMNS], strict=True):
                if path in titles:
                    yield chunk


def _text_columns(file: Any) -> list[str]:
    """Names of the columns of text."""
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]

    fields = file.schema_arrow
    return [
        x.name for x in fields if pa.types.is_string(x.type) or pa.types.is_large_string(x.type)
    ]


def _kind(type_: Any) -> Any:
    """The type of a column's values, also if the column is read as a dictionary."""
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]

    return type_.value_type if pa.types.is_dictionary(type_) else type_


def _is_text(kind: Any) -> bool:
    """Whether values of a type are texts, or all missing."""
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]

    is_text = pa.types.is_string(kind) or pa.types.is_large_string(kind)
    return bool(is_text or pa.types.is_null(kind))


def _refuse_type(type_: Any, where: str) -> None:
    """Refuse a column of neither numbers nor text.

    Raises:
        InvalidInput: The column has another type.
    """
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]

    kind = _kind(type_)
    is_number = pa.types.is_integer(kind) or pa.types.is_floating(kind) or pa.types.is_decimal(kind)
    if not (is_number or _is_text(kind)):
        raise InvalidInput(f"{where} has the type {kind}: only numbers and text are read.")


def _cells(column: Any, where: str) -> Sequence[str] | FloatArray:
    """The texts or the numbers of one column.

    Raises:
        InvalidInput: The column has more texts than rows, or a text that is too long.
    """
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]

    if not _is_text(_kind(column.type)):
        plain = column.cast(pa.float64(), safe=False)
        return np.array(plain.to_numpy(), dtype=np.float64)
    cells: list[str] = []
    for chunk in column.chunks:
        if pa.types.is_null(chunk.type):
            cells += [""] * len(chunk)
            continue
        if len(chunk.dictionary) > len(column):
            raise InvalidInput(f"{where} has more texts than rows.")
        words = [_word(x, where) for x in chunk.dictionary.to_pylist()]
        cells += ["" if i is None else words[i] for i in chunk.indices.to_pylist()]
    return cells


def _word(text: str | None, where: str) -> str:
    """The text of a cell without blanks around it; empty for a missing one.

    Raises:
        InvalidInput: The text is too long.
    """
    if text is not None and len(text) > LONGEST_CELL:
        raise InvalidInput(
            f"{where}: a cell has {len(text)} characters, more than the {LONGEST_CELL} that are "
            "read."
        )
    return (text or "").strip()


def _footer(data: bytes) -> dict[int, Any]:
    """The struct FileMetaData at the end of a file.

    Raises:
        ValueError: The struct is missing, cut off or too large.
    """
    if len(data) < 2 * len(MAGIC) + 4 or not data.startswith(MAGIC) or not data.endswith(MAGIC):
        raise ValueError(f"it does not begin and end with {MAGIC.decode()}")
    size = int.from_bytes(data[-8:-4], "little")
    if size > MOST_FOOTER:
        raise ValueError(
            f"its metadata have {size / MEGABYTE:.0f} MB, more than the "
            f"{MOST_FOOTER / MEGABYTE:.0f} MB that are read"
        )
    start = len(data) - 8 - size
    if start < len(MAGIC):
        raise ValueError("its metadata are cut off")
    return Reader(data, start).struct()


def _unpacked_size(data: bytes, chunk: dict[int, Any]) -> int:
    """Unpacked size of all pages of a column in a group of rows [bytes].

    Args:
        data: Content of the file.
        chunk: The struct ColumnChunk of the column.

    Raises:
        ValueError: The pages lie outside of the file, or a page's size is impossible.
    """
    about = chunk[META_DATA]
    if about[NUM_VALUES] <= 0:
        # pyarrow opens no page of such a column, and its offsets may be invalid.
        return 0
    at, size = about[DATA_PAGE_OFFSET], 0
    if 0 < about.get(DICTIONARY_PAGE_OFFSET, 0) < at:
        at = about[DICTIONARY_PAGE_OFFSET]
    end = at + about[TOTAL_COMPRESSED_SIZE]
    if not 0 <= at <= end <= len(data):
        raise ValueError("a column lies outside of it")
    while at < end:
        reader = Reader(data, at)
        header = reader.struct()
        unpacked, packed = header[UNCOMPRESSED_PAGE_SIZE], header[COMPRESSED_PAGE_SIZE]
        if not (0 <= unpacked <= LARGEST_PAGE and 0 <= packed <= LARGEST_PAGE):
            raise ValueError("a page has a size that no page can have")
        size += unpacked
        at = reader.at + packed
    return size
