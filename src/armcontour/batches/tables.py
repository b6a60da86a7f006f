"""Tables of rows in files: Parquet, or JSON lines where pyarrow is missing; written whole."""

from __future__ import annotations

import importlib.util
import json
import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from functools import cache
from itertools import islice
from pathlib import Path as FilePath
from typing import Any, Literal

from armcontour import _staging
from armcontour._text import show
from armcontour.errors import InvalidInput

Kind = Literal["number", "count", "text"]
Rows = Mapping[str, Sequence[Any]]
PARQUET, LINES = ".parquet", ".jsonl"
# Rows of a block, which are in memory at once.
BLOCK = 50_000


@cache
def ending() -> str:
    """Ending of the files that are written here."""
    return PARQUET if importlib.util.find_spec("pyarrow") is not None else LINES


@dataclass(frozen=True, slots=True)
class Block:
    """Some rows of a file, one after the other.

    Args:
        file: The file.
        at: Number of the row group of Parquet, or the byte at which lines begin.
        count: Number of rows.
    """

    file: FilePath
    at: int
    count: int

    def read(self, names: Iterable[str]) -> dict[str, list[Any]]:
        """Columns of the rows; those that are missing are empty in each row.

        Args:
            names: Names of the columns.
        """
        if self.file.suffix == LINES:
            with self.file.open(encoding="utf-8") as lines:
                lines.seek(self.at)
                rows = [json.loads(x) for x in islice(lines, self.count)]
            return {name: [x.get(name) for x in rows] for name in names}
        pq = _parquet(self.file)
        with closing(pq.ParquetFile(self.file)) as file:
            known = set(file.schema_arrow.names)
            table = file.read_row_group(self.at, columns=[x for x in names if x in known])
        return {x: table[x].to_pylist() if x in known else [None] * self.count for x in names}


def blocks_of(file: FilePath) -> list[Block]:
    """The blocks of a file.

    Args:
        file: The file.

    Raises:
        InvalidInput: pyarrow is missing and the file is Parquet, or the file is broken.
    """
    if file.suffix == LINES:
        return list(_line_blocks(file))
    pq = _parquet(file)
    with closing(pq.ParquetFile(file)) as opened:
        data = opened.metadata
        return [Block(file, k, data.row_group(k).num_rows) for k in range(data.num_row_groups)]


@contextmanager
def readable(file: FilePath) -> Iterator[None]:
    """Context in which a broken or foreign file is refused, whatever its library raises.

    Raises:
        InvalidInput: As said.
        FileNotFoundError: The file is gone.
    """
    try:
        yield
    except (InvalidInput, FileNotFoundError):
        raise
    except Exception as error:  # pyarrow has errors of many kinds for damaged files
        problem = str(error).strip().partition("\n")[0].rstrip(".") or type(error).__name__
        raise InvalidInput(
            f"{file} has no readable results of a batch ({show(problem)}): remove the file, and "
            "run the batch again, which repeats its jobs."
        ) from None


def _line_blocks(file: FilePath) -> Iterator[Block]:
    """The blocks of a file of JSON lines."""
    at = 0
    with file.open("rb") as lines:
        while rows := list(islice(lines, BLOCK)):
            yield Block(file, at, len(rows))
            at += sum(map(len, rows))


def _parquet(file: FilePath) -> Any:
    """The library for Parquet."""
    try:
        import pyarrow.parquet as pq  # type: ignore[import-untyped, unused-ignore]
    except ImportError:
        raise InvalidInput(
            f"{file} is Parquet, which needs the library pyarrow: pip install 'armcontour[tables]'."
        ) from None
    return pq


def write_table(
    file: FilePath, blocks: Iterable[Rows], kinds: Mapping[str, Kind], units: Mapping[str, str]
) -> None:
    """Write a file; it is on the disk when this returns.

    Args:
        file: The file, which does not exist yet; its ending says the format.
        blocks: The rows, block by block, by the names of their columns.
        kinds: What the columns hold.
        units: Units of columns, which Parquet keeps with them.
    """
    if file.suffix == LINES:
        with file.open("w", encoding="utf-8") as lines:
            for x in blocks:
                for row in zip(*(x[name] for name in kinds), strict=True):
                    lines.write(json.dumps(dict(zip(kinds, row, strict=True))) + "\n")
    else:
        _write_parquet(file, blocks, kinds, units)
    with file.open("rb+") as done:
        os.fsync(done.fileno())


def _write_parquet(
    file: FilePath, blocks: Iterable[Rows], kinds: Mapping[str, Kind], units: Mapping[str, str]
) -> None:
    """Write a Parquet file, a row group for each block."""
    import pyarrow as pa  # type: ignore[import-untyped, unused-ignore]
    import pyarrow.parquet as pq  # type: ignore[import-untyped, unused-ignore]

    types = {"number": pa.float64(), "count": pa.int64(), "text": pa.string()}
    schema = pa.schema(
        [
            pa.field(x, types[kind], metadata={"unit": units[x]} if x in units else None)
            for x, kind in kinds.items()
        ]
    )
    with pq.ParquetWriter(file, schema) as writer:
        for x in blocks:
            arrays = [pa.array(x[name], type=types[kind]) for name, kind in kinds.items()]
            writer.write_table(pa.table(arrays, schema=schema))


def move_in_place(fresh: FilePath, file: FilePath) -> None:
    """Move a file that is on the disk to its place, and have that on the disk too.

    Args:
        fresh: The file, in the same file system.
        file: Its place.
    """
    with _staging.moving():
        os.replace(fresh, file)
    # Windows has no handles of folders.
    with suppress(OSError):
        folder = os.open(file.parent, os.O_RDONLY)
        try:
            os.fsync(folder)
        finally:
            os.close(folder)
