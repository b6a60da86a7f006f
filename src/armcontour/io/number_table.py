"""Read numbers from CSV text, with their line numbers and their printed digits."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from armcontour._checks import FloatArray
from armcontour._text import LONGEST, list_some, parse_number, show
from armcontour.errors import InvalidInput

NUMBER = re.compile(
    r"[+-]?(?=\.?\d)(?P<whole>\d*)(?:\.(?P<part>\d*))?(?:[eE](?P<power>[+-]?\d+))?", re.ASCII
)
# A comma between digits, as in 0,125.
_DECIMAL_COMMA = re.compile(r"(\d),(\d)")
_QUOTED_COMMA = re.compile(r'"([-+]?\d+),(\d+(?:[eE][-+]?\d+)?)"')
# Units in the second line of a table.
_UNIT = re.compile(
    r"(?:[mµun]?(?:s|m|rad)|sec|cm|deg|°|degrees?|radians?|turns?|rev|rpm|[mk]?(?:A|V|W|Nm|N|Hz|g)|%|"
    r"°C)(?:[ */·]?(?:s|min|m|mm)(?:\^?2|²)?)?"
)
# Characters of `rename` that stand for others.
WILD = {"#": r"(\d+)", "*": "(.*)"}
# Lines that are searched for a decimal comma, and names that one message lists.
MOST_TRIED = 1000
MOST_NAMED = 12
# Lines that are converted at a time: larger parts take more memory and save no time.
CHUNK = 1 << 14


@dataclass(frozen=True, slots=True, eq=False)
class CsvTable:
    """Lines of CSV: the names of columns, then one line per sample.

    Args:
        source: Name of the file, for messages.
        names: Names of the columns.
        header: Number of the line with the names, from 1; 0 if they are given beside the file.
        separator: The character between cells.
        lines: The lines of samples; blank lines and comments are left out.
        numbers: Numbers of these lines in the file, from 1.
    """

    source: str
    names: tuple[str, ...]
    header: int
    separator: str
    lines: list[str]
    numbers: list[int]

    @property
    def heading(self) -> str:
        """File and place of the names, for messages."""
        return f"{self.source}, line {self.header}" if self.header else f"{self.source}, --columns"

    def cells(self, row: int) -> list[str]:
        """The cells of one sample."""
        return _split(self.lines[row], self.separator)

    def place(self, row: int) -> str:
        """File and line of a sample, for messages."""
        return f"{self.source}, line {self.numbers[row]}"

    def cell(self, row: int, column: int) -> str:
        """Content and column of a cell, for messages."""
        return f"{show(self.cells(row)[column])} in the column {self.names[column]!r}"


@dataclass(slots=True)
class Digits:
    """Printed digits of the numbers in a column.

    Args:
        places: Largest number of decimals.
        digits: Largest number of significant digits.
        highest: Power of ten of the first digit of the largest number.
    """

    places: int = -99
    digits: int = 0
    highest: float = -math.inf

    def add(self, text: str) -> None:
        """Update the counts with the digits of a number."""
        match = NUMBER.fullmatch(text)
        if match is None:
            return
        whole, part, power = match.group("whole", "part", "power")
        part, exponent = part or "", int(power or 0)
        number = (whole + part).lstrip("0")
        self.places = max(self.places, len(part) - exponent)
        if number.strip("0"):
            self.digits = max(self.digits, len(number))
            self.highest = max(self.highest, len(number) - 1 - len(part) + exponent)


def last_digit(columns: Sequence[Digits]) -> float:
    """Value of the last printed digit of the largest number, for numbers of one print format.

    Zeros that a format cuts off at the end do no harm: the number of digits is the largest over
    all numbers, both after the decimal point and in total.
    """
    places = max(x.places for x in columns)
    digits, highest = max(x.digits for x in columns), max(x.highest for x in columns)
    return float(max(10.0**-places, 10.0 ** (highest - digits + 1)) if digits else 10.0**-places)


def split_csv(
    text: str, source: str, columns: str | None = None, *, decimal_commas: bool = True
) -> CsvTable:
    """The table in CSV text with commas, semicolons, tabs or blanks between cells.

    Lines that start with # are comments, and so are those above the names. A second line that has
    only units belongs to the names.

    Args:
        text: The text.
        source: Name of the file, for messages.
        columns: Names of the columns, separated by commas, for a file without a line of names or
            in place of the lines before the first one with a number; or new names of some columns,
            as `rename` takes them.
        decimal_commas: Whether numbers may have a decimal comma, with other separators or in
            quotes.

    Raises:
        InvalidInput: There is no line of column names, or no sample, or `columns` names more or
            fewer columns than there are.
    """
    kept = _numbered_lines(text)
    if not kept:
        raise InvalidInput(f"{source} is empty: it must have a line of column names and samples.")
    new = columns is not None and "=" in columns
    if columns is not None and not new:
        count = columns.count(",") + 1
        samples = (k for k, (_, line) in enumerate(kept) if _is_sample(line, count))
        kept = kept[next(samples, 0) :]
    else:
        kept = kept[_preamble(kept) :]
    header, first = kept[0]
    separator = next((x for x in ";\t" if x in first), ",")
    if separator == "," and _is_blank_separated([line for _, line in kept[:2]]):
        # As the recorder of a UR's RTDE writes it.
        kept = [(number, "\t".join(line.split())) for number, line in kept]
        first, separator = kept[0][1], "\t"
    names, named = tuple(_split(first, separator)), 1
    if columns is not None and not new:
        given = tuple(map(str.strip, columns.split(",")))
        if len(given) != len(names):
            raise InvalidInput(
                f"{source}, line {header}: {len(names)} columns, but names of {len(given)} are "
                "given: name all of them in their order, and - for each that is not needed."
            )
        # Given names replace those of the file.
        named = not any(map(NUMBER.fullmatch, names))
        names, header = given, 0
    elif len(kept) > 1 and (units := _units(_split(kept[1][1], separator), len(names))):
        names = tuple(f"{x} [{y}]" if y else x for x, y in zip(names, units, strict=True))
        named = 2
    lines = [line for _, line in kept[named:]]
    comma = _QUOTED_COMMA if separator == "," else _DECIMAL_COMMA
    if decimal_commas and any(comma.search(x) for x in lines[:MOST_TRIED]):
        lines = [comma.sub(r"\g<1>.\g<2>", x) for x in lines]
    return CsvTable(
        source=source,
        names=rename(names, columns, source) if columns is not None and new else names,
        header=header,
        separator=separator,
        lines=lines,
        numbers=[number for number, _ in kept[named:]],
    )


def _preamble(kept: Sequence[tuple[int, str]]) -> int:
    """Number of lines above the names, which have as many cells as the first sample."""
    lines = [line for _, line in kept[:MOST_TRIED]]
    for k, line in enumerate(lines):
        separator = next((x for x in ";\t," if x in line), None)
        cells = _split(line, separator) if separator else line.split()
        if len(cells) > 1 and all(NUMBER.fullmatch(x.replace(",", ".")) for x in cells[:2]):
            counts = [len(_split(x, separator) if separator else x.split()) for x in lines[:k]]
            return counts.index(len(cells)) if len(cells) in counts else 0
    return 0


def _units(cells: Sequence[str], count: int) -> list[str]:
    """The units in a line below the names; empty if it is no such line."""
    units = [x.strip("[]() ") for x in cells]
    units = ["" if x in ("-", "1") else x for x in units]
    known = all(not x or _UNIT.fullmatch(x) for x in units)
    return units if len(units) == count and known and any(units) else []


def rename(names: Sequence[str], pairs: str, source: str) -> tuple[str, ...]:
    """Names of columns or joints with new ones in the place of some.

    Args:
        names: The names.
        pairs: `NEW=NAME`, separated by commas. A # stands for a number and a * for any text,
            in both the same, as in `q# [deg]=joint_#`.
        source: Name of the file, for messages.

    Raises:
        InvalidInput: A pair is incomplete, or no name is as it says.
    """
    found = list(names)
    for pair in pairs.split(","):
        new, _, old = map(str.strip, pair.partition("="))
        wild = [x for x in old if x in WILD]
        used = [x for x in new if x in WILD]
        if not (new and old) or (used and used != wild):
            raise InvalidInput(
                f"New names are given as NEW=NAME, such as 't [ms]=time' or 'q# [deg]=joint_#', "
                f"not {show(pair)}."
            )
        pattern = re.compile("".join(WILD.get(x) or re.escape(x) for x in old))
        matches = {i: x for i, name in enumerate(names) if (x := pattern.fullmatch(name))}
        if not matches:
            raise InvalidInput(
                f"{source} has no column or joint {show(old)} to rename: it has "
                f"{list_some([show(x) for x in names], MOST_NAMED)}."
            )
        for i, match in matches.items():
            parts = iter(match.groups())
            found[i] = "".join(next(parts) if x in WILD else x for x in new)
    return tuple(found)


def _numbered_lines(text: str) -> list[tuple[int, str]]:
    """The lines of a text with their numbers from 1, without comments and empty lines."""
    # Not `splitlines`, which also splits at characters that are allowed in a cell.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    return [(k, x) for k, x in enumerate(lines, start=1) if x.lstrip()[:1] not in ("", "#")]


def _is_sample(line: str, count: int) -> bool:
    """Whether a line has so many cells, and one of them is a number, with any separator."""
    cells = re.split(r"\s*[,;\t]\s*|\s+", line.strip())
    return len(cells) == count and any(NUMBER.fullmatch(x) for x in cells)


def _is_blank_separated(lines: Sequence[str]) -> bool:
    """Whether the cells of the first lines are separated by blanks, and by nothing else."""
    words = [len(x.split()) for x in lines]
    return min(words) == max(words) > 1 and not any("," in _DECIMAL_COMMA.sub("", x) for x in lines)


def read_columns(table: CsvTable, columns: Sequence[int]) -> tuple[FloatArray, list[Digits]]:
    """Read the numbers of some columns.

    Args:
        table: The table.
        columns: Indices of the columns, from 0.

    Returns:
        The numbers, (samples, columns), and the printed digits per column.

    Raises:
        InvalidInput: There are no samples, a line has too few or too many cells, or a cell of these
            columns is not a finite decimal number.
    """
    if not table.lines:
        raise InvalidInput(f"{table.source} has column names, but no samples.")
    values = np.empty((len(table.lines), len(columns)))
    digits = [Digits() for _ in columns]
    for first in range(0, len(table.lines), CHUNK):
        rows = _rows(table, first)
        texts = [[row[i] for row in rows] for i in columns]
        part = values[first : first + len(rows)]
        if not _convert(texts, part):
            _convert_each(table, first, columns, texts, part)
        for count, column in zip(digits, texts, strict=True):
            for text in column:
                count.add(text)
    return values, digits


def _rows(table: CsvTable, first: int) -> list[list[str]]:
    """Cells of up to `CHUNK` samples from sample `first` on."""
    lines = table.lines[first : first + CHUNK]
    rows = [_split(line, table.separator) for line in lines]
    wanted = len(table.names)
    for i, row in enumerate(rows):
        if len(row) != wanted:
            raise InvalidInput(
                f"{table.place(first + i)}: {len(row)} values, but {wanted} columns.",
                index=first + i,
            )
    return rows


def split_line(line: str, separator: str) -> list[str]:
    """The cells of a line.

    Raises:
        csv.Error: A quote that is not closed, or a cell in quotes that is too long.
    """
    if '"' not in line:
        return [x.strip() for x in line.split(separator)]
    # One line at a time, so that an open quote does not include the next lines.
    return [x.strip() for x in next(csv.reader([line], delimiter=separator, strict=True))]


def _split(line: str, separator: str) -> list[str]:
    """The cells of a line, also if its quotes are wrong."""
    try:
        return split_line(line, separator)
    except csv.Error:
        # An open quote, or a cell of more than 131,072 characters, is refused as no number later.
        return line.split(separator)


def _convert(texts: list[list[str]], values: FloatArray) -> bool:
    """Convert all texts at once into `values`; return whether every text is surely a number."""
    for k, column in enumerate(texts):
        joined = "".join(column)
        if not joined.isascii() or "_" in joined or max(map(len, column)) > LONGEST:
            return False
        try:
            values[:, k] = list(map(float, column))
        except ValueError:
            return False
    return bool(np.isfinite(values).all())


def _convert_each(
    table: CsvTable,
    first: int,
    columns: Sequence[int],
    texts: list[list[str]],
    values: FloatArray,
) -> None:
    """Convert texts one by one into `values`; refuse the first that is no number."""
    for i, row in enumerate(zip(*texts, strict=True)):
        for k, text in enumerate(row):
            try:
                values[i, k] = parse_number(text)
            except ValueError:
                raise InvalidInput(
                    f"{table.place(first + i)}: {show(text)} in the column "
                    f"{table.names[columns[k]]!r} is not a finite number.",
                    index=first + i,
                ) from None
