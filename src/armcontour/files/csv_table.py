"""Tables of numbers in CSV: column titles and units, cells with line numbers, printed digits."""

from __future__ import annotations

import csv
import math
import re
from collections.abc import Callable, Hashable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Generic, NamedTuple, NoReturn, TypeVar

import numpy as np

from armcontour.core.checks import FloatArray
from armcontour.core.errors import InvalidInput
from armcontour.core.quantities import linear_unit, parse_quantity
from armcontour.core.text import LONGEST_NUMBER, list_some, parse_number, show

Key = TypeVar("Key", bound=Hashable)
NUMBER = re.compile(
    r"[+-]?(?=\.?\d)(?P<whole>\d*)(?:\.(?P<part>\d*))?(?:[eE](?P<power>[+-]?\d+))?", re.ASCII
)
# Translation that replaces each nonzero digit by 1, so that texts of numbers with the same pattern
# of zero and nonzero digits become equal.
_DIGIT_PATTERN = str.maketrans("23456789", "11111111")
# A comma between digits, as in 0,125.
_DECIMAL_COMMA = re.compile(r"(\d),(\d)")
# Matches comments, and blank lines, also of a spreadsheet, which writes separators for empty cells.
_IGNORED = re.compile(r'\s*#|[\s,;"]*$')
# A title with a unit in brackets. A number in brackets, as in q[0], is an index, not a unit.
_BRACKETS = re.compile(r"(?P<name>.*?)\s*[\[(](?P<unit>(?!\d*[\])])[^\])]*)[\])]")
# A unit must contain one of these to be a unit of angle. pint alone would accept "1/s" as "rad/s",
# because it treats angles as plain numbers.
_ANGLE = re.compile("rad|deg|turn|rev|rpm")
# Titles of two columns with the seconds and nanoseconds of one time, as in ROS.
_SECONDS = re.compile(r"(?P<name>(?:.*[._/])?)secs? (?P=name)(?:nanosec|nsecs?)")
# Title of a column that is ignored.
SKIPPED = "-"
# Wildcards of `rename`, and their regular expressions.
WILDCARDS = {"#": r"(\d+)", "*": "(.*)"}
# Maximum number of lines that are searched for the first sample.
MAX_SEARCHED_LINES = 1000
# Maximum number of names that a message lists.
MAX_NAMED = 8
# Number of rows per conversion; larger blocks need more memory and are not faster.
BLOCK_ROWS = 1 << 14


class Title(NamedTuple, Generic[Key]):
    """Content of a column, as recognized from its title."""

    key: Key  # Quantity in the column
    si: str | None  # SI unit of the quantity; None if it has no unit
    unit: str | None = None  # Unit of the format; None if it has none
    rank: int = 0  # If several columns have the same quantity, the column of lowest rank is used


@dataclass(frozen=True, slots=True)
class CsvColumn:
    """A recognized column of a CSV table."""

    index: int  # Index of the column, from 0
    title: str  # Title as in the file
    unit: str | None  # Unit as in the title; None if the title has no unit
    factor: float  # Conversion factor from the unit to SI units; 1 if the title has no unit
    rank: int  # Rank among columns of the same quantity; the lowest rank is used
    linear: bool = False  # True if the unit is that of a prismatic joint


@dataclass(slots=True)
class Digits:
    """Statistics on the printed digits in a column."""

    places: int = -99  # Largest number of decimal places; negative for powers of ten
    digits: int = 0  # Largest number of significant digits
    highest: float = -math.inf  # Power of ten at the first digit of the largest number

    def add(self, texts: Sequence[str]) -> None:
        """Update the statistics with the texts of numbers."""
        # Numbers with the same pattern of zero and nonzero digits have the same statistics, so each
        # pattern is evaluated once. Numbers with exponents are not translated.
        joined = "\n".join(texts)
        alike = set(texts)
        if "e" not in joined and "E" not in joined:
            alike = set(joined.translate(_DIGIT_PATTERN).split("\n"))
        for match in filter(None, map(NUMBER.fullmatch, alike)):
            whole, part, power = match.group("whole", "part", "power")
            part = part or ""
            exponent = int(power or 0)
            number = (whole + part).lstrip("0")
            self.places = max(self.places, len(part) - exponent)
            if number.strip("0"):
                self.digits = max(self.digits, len(number))
                self.highest = max(self.highest, len(number) - 1 - len(part) + exponent)


def last_digit(columns: Sequence[Digits]) -> float:
    """Return the last printed digit's value for the largest number in equally printed columns."""
    # A format that removes trailing zeros does not change the result, because the numbers of
    # decimals and of significant digits are the largest over all numbers.
    decimals = max(x.places for x in columns)
    digits = max(x.digits for x in columns)
    highest = max(x.highest for x in columns)
    return float(
        max(10.0**-decimals, 10.0 ** (highest - digits + 1)) if digits else 10.0**-decimals
    )


@dataclass(frozen=True, slots=True, eq=False)
class CsvTable(Generic[Key]):
    """A CSV table: the recognized columns, and the lines of the rows."""

    source: str  # Name of the file, for messages
    heading: str  # File and line of the titles, for messages
    example: str  # Example of titles, for messages
    option: str  # Option that names columns, for messages
    # Recognized columns by quantity, in the order of the file
    columns: Mapping[Key, CsvColumn]
    unknown: tuple[str, ...]  # Titles of the other columns
    # Titles of all columns in the file; without titles in it, those of `read_table`
    titles: tuple[str, ...]
    separator: str  # Separator between cells
    width: int  # Number of columns
    lines: list[str]  # Lines of the rows, without blank lines and comments
    numbers: list[int]  # Line number in the file of each row, from 1
    comments: list[str]  # Lines that start with #
    row_noun: str = "line"  # What a row is in the file, for messages

    def require_columns(self, *keys: Key) -> None:
        """Check that the table has columns for the given quantities."""
        missing = next((x for x in keys if x not in self.columns), None)
        if missing is None:
            return
        unknown = list_some([show(x) for x in self.unknown], MAX_NAMED)
        other = f" The columns {unknown} are not recognized." if unknown else ""
        raise InvalidInput(
            f"{self.heading}: the column {missing} is missing. Name the columns, such as "
            f"{self.example} (or rename them with {self.suggest(str(missing))}).{other}"
        )

    def suggest(self, *names: str) -> str:
        """Return the option that renames unknown columns to `names` (q1 for q#), for messages."""
        titles = dict.fromkeys(title_pattern(x) for x in self._numeric())
        pairs = []
        for name in map(title_pattern, names):
            alike = [x for x in titles if ("#" in x) == ("#" in name)]
            old = alike[0] if alike else "NAME" + "_#" * ("#" in name)
            titles.pop(old, None)
            unit = _BRACKETS.fullmatch(old)
            pairs.append(f"{name} [{unit['unit']}]={old}" if unit else f"{name}={old}")
        return f"{self.option} '{','.join(pairs)}'"

    def _numeric(self) -> list[str]:
        """Return the titles of the unknown columns with a number in the first row."""
        unknown = [x for x in self.unknown if x]
        first = dict(zip(self.titles, self.first_cells(), strict=False))
        return [x for x in unknown if NUMBER.fullmatch(first.get(x, "0").replace(",", "."))]

    def rename(self, new: str, old: str) -> str:
        """Return the text of the option that renames a column, for messages."""
        return f"{self.option} '{new}={old}'"

    def file_title(self, key: Key) -> str:
        """Return the file's title for the column of a quantity, for messages with the option."""
        return self.titles[self.columns[key].index]

    def place(self, row: int, *keys: Key) -> str:
        """Return file, line of a row and titles of the given columns as text for messages."""
        titles = " ".join(self.columns[x].title for x in keys)
        location = f"{self.source}, {self.row_noun} {self.numbers[row]}"
        return f"{location}, column {show(titles)}" if keys else location

    def cells(self, row: int) -> list[str]:
        """Return all cells of a row, without surrounding blanks."""
        try:
            cells = _split(self.lines[row], self.separator)
        except csv.Error as error:
            # The line has an unclosed quote, or a cell of more than 131,072 characters.
            raise InvalidInput(f"{self.place(row)}: {error}. Correct the quotes.") from None
        if len(cells) != self.width:
            raise InvalidInput(
                f"{self.place(row)}: the row has {len(cells)} values, but must have {self.width}, "
                "one per column.",
                index=row,
            )
        return cells

    def first_cells(self) -> list[str]:
        """Return the cells of the first row, also if their number is wrong; empty without rows."""
        return _split_any(self.lines[0], self.separator) if self.lines else []

    def cell(self, row: int, key: Key) -> str:
        """Return the text of the cell in a row and the column of a quantity."""
        return self.cells(row)[self.columns[key].index]

    def is_empty(self, key: Key) -> bool:
        """Return whether no cell in the column of a quantity has a number: all are empty or NaN."""
        return all(self.cell(i, key).lower() in ("", "nan") for i in range(len(self.lines)))

    def cell_blocks(self, keys: Sequence[Key]) -> Iterator[tuple[int, list[list[str]]]]:
        """Yield blocks of rows: the index of the first row, and the cells of each given column."""
        indices = [self.columns[x].index for x in keys]
        count = len(self.lines)
        for first in range(0, count, BLOCK_ROWS):
            rows = [self.cells(i) for i in range(first, min(first + BLOCK_ROWS, count))]
            yield first, [[row[i] for row in rows] for i in indices]

    def read(self, keys: Sequence[Key]) -> tuple[FloatArray, list[Digits]]:
        """Read numbers in SI units, (rows, columns), NaN in empty cells, and printed digits."""
        if not self.lines:
            raise InvalidInput(f"{self.source} has column names, but no rows with numbers.")
        values = np.empty((len(self.lines), len(keys)))
        digits = [Digits() for _ in keys]
        for first, texts in self.cell_blocks(keys):
            for k, column in enumerate(texts):
                if "," in "".join(column):
                    column = [_DECIMAL_COMMA.sub(r"\g<1>.\g<2>", x) for x in column]
                values[first : first + len(column), k] = self._parse_column(column, first, keys[k])
                digits[k].add(column)
        return values * [self.columns[x].factor for x in keys], digits

    def _parse_column(self, texts: list[str], first: int, key: Key) -> list[float]:
        """Return the numbers in a column's cells, starting at row `first`; NaN for empty cells."""
        joined = "".join(texts)
        if joined.isascii() and "_" not in joined and max(map(len, texts)) <= LONGEST_NUMBER:
            try:
                if np.isfinite(numbers := list(map(float, texts))).all():
                    return numbers
            except ValueError:
                pass
        numbers = []
        for row, text in enumerate(texts, start=first):
            try:
                numbers.append(parse_number(text) if text else math.nan)
            except ValueError:
                self.raise_cell_error(row, key)
        return numbers

    def raise_cell_error(self, row: int, key: Key) -> NoReturn:
        """Raise the error for a cell that is not a finite number."""
        raise InvalidInput(
            f"{self.place(row, key)}: {show(self.cell(row, key))} is not a finite number. Correct "
            "the value (dates and times of day must be in seconds), or remove the line.",
            index=row,
        )


@dataclass(frozen=True, slots=True)
class _Heading:
    """Column titles of a table, and where they are specified."""

    titles: list[str]  # Titles that determine the content of the columns
    in_file: list[str]  # Titles in the file; without titles in it, equal to `titles`
    location: str  # Line of the file or option that specifies the titles, for messages
    has_line: bool  # Whether a line of the file has titles

    def with_joined_time(self, index: int) -> _Heading:
        """Replace the columns `index` and `index + 1` by one column of time."""

        def join(titles: list[str]) -> list[str]:
            return [*titles[:index], "t [s]", *titles[index + 2 :]]

        return replace(self, titles=join(self.titles), in_file=join(self.in_file))


def read_table(
    text: str,
    source: str,
    title_of: Callable[[str], Title[Key] | None],
    *,
    example: str,
    columns: str | None,
    option: str,
    untitled: Callable[[Sequence[str]], list[str] | None] = lambda cells: None,
    names: Sequence[str] = (),
) -> CsvTable[Key]:
    """Read a table from CSV text with commas, semicolons, tabs or blanks between cells.

    Lines that start with #, and lines above the titles, are comments. The unit of a column is in
    brackets after the title, `q1 [deg]`. Numbers may have a decimal comma if the separator is not a
    comma or if they are quoted.

    Args:
        text: The text.
        source: Name of the file, for messages.
        title_of: Returns the content of a column with a title, without its unit; None if the title
            is not recognized.
        example: Example of titles, for messages.
        columns: Names of all columns, separated by commas, or new names of some columns, as in
            `rename`; None for the titles in the file.
        option: Option that specifies `columns`, for messages.
        untitled: Returns the titles of a known format whose files have no titles, from the cells of
            a row; None for other rows.
        names: Names of joints. Brackets at the end of a name are not a unit.

    Raises:
        InvalidInput: The table has no line, the number of names differs from the number of columns,
            a renamed column does not exist, two columns have the same quantity, or a unit does not
            fit the quantity.
    """
    # `splitlines` would also split at characters that are allowed in a cell.
    lines = text.replace("\r\n", "\n").replace("\r", "\n").split("\n")
    numbered = [(k, x) for k, x in enumerate(lines, start=1) if not _IGNORED.match(x)]
    if not numbered:
        raise InvalidInput(
            f"{source} is empty, but must have a line with column names, and rows with numbers."
        )
    numbered = numbered[_find_titles([line for _, line in numbered], _count_names(columns)) :]
    separator = _find_separator([line for _, line in numbered[:2]])
    if separator is None:
        numbered = [(number, "\t".join(line.split())) for number, line in numbered]
        separator = "\t"
    number, line = numbered[0]
    cells = _split_any(line, separator)
    heading = _read_heading(cells, untitled(cells), columns, source, number, option)
    rows = numbered[1:] if heading.has_line else numbered
    texts = [row for _, row in rows]
    seconds = _find_seconds(heading.titles)
    if seconds is not None:
        heading = heading.with_joined_time(seconds)
        texts = [_join_seconds(x, separator, seconds) for x in texts]
    recognised, unknown = _read_titles(heading, title_of, example, option, names)
    return CsvTable(
        source=source,
        heading=heading.location,
        example=example,
        option=option,
        columns=recognised,
        unknown=unknown,
        titles=tuple(heading.in_file),
        separator=separator,
        width=len(heading.titles),
        lines=texts,
        numbers=[number for number, _ in rows],
        comments=[x.strip() for x in lines if x.lstrip()[:1] == "#"],
    )


def make_table(
    titles: Sequence[str],
    rows: list[str],
    source: str,
    title_of: Callable[[str], Title[Key] | None],
    *,
    example: str,
    columns: str | None,
    option: str,
    names: Sequence[str],
) -> CsvTable[Key]:
    """Make a table from titles, and from rows whose cells are numbers separated by commas.

    Args:
        titles: The titles.
        rows: The rows.
        source: As in `read_table`.
        title_of: As in `read_table`.
        example: As in `read_table`.
        columns: As in `read_table`.
        option: As in `read_table`.
        names: As in `read_table`.

    Raises:
        InvalidInput: As in `read_table`.
    """
    heading = _read_heading(list(titles), None, columns, source, 1, option)
    recognised, unknown = _read_titles(heading, title_of, example, option, names)
    return CsvTable(
        source=source,
        heading=heading.location,
        example=example,
        option=option,
        columns=recognised,
        unknown=unknown,
        titles=tuple(heading.in_file),
        separator=",",
        width=len(titles),
        lines=rows,
        numbers=list(range(1, len(rows) + 1)),
        comments=[],
    )


def _count_names(columns: str | None) -> int | None:
    """Return the number of columns that an option names; None if it does not name all columns."""
    return None if columns is None or "=" in columns else len(columns.split(","))


def _find_separator(lines: Sequence[str]) -> str | None:
    """Return the separator between the cells of the first lines; None for blanks.

    The recorder of UR's RTDE client writes blanks between cells.
    """
    separator = next((x for x in ";\t" if x in lines[0]), ",")
    return None if separator == "," and _is_blank_separated(lines) else separator


def _read_heading(
    cells: list[str],
    known: list[str] | None,
    columns: str | None,
    source: str,
    line: int,
    option: str,
) -> _Heading:
    """Find the titles of the columns: in the option, in a known format, or in the first line.

    Args:
        cells: Cells of the first line.
        known: Titles of a known format whose files have no titles.
        columns: Value of the option.
        source: Name of the file, for messages.
        line: Line number of the first line.
        option: Name of the option, for messages.
    """
    in_file = cells if known is None else known
    location = f"{source}, line {line}"
    if columns is None:
        return _Heading(in_file, in_file, location, has_line=known is None)
    if "=" in columns:
        renamed = list(rename(in_file, columns, source))
        return _Heading(renamed, in_file, location, has_line=known is None)
    names = columns.split(",")
    if len(names) != len(in_file):
        raise InvalidInput(
            f"{location}: the table has {len(in_file)} columns, but {option} has {len(names)} "
            f"names. Name all columns in their order; the name {SKIPPED} ignores a column."
        )
    # The specified names replace the titles in the file.
    has_line = known is None and not any(map(NUMBER.fullmatch, cells))
    has_titles = has_line or known is not None
    return _Heading(
        titles=[x.strip() for x in names],
        in_file=in_file if has_titles else names,
        location=f"{source}, {option}",
        has_line=has_line,
    )


def _find_seconds(titles: Sequence[str]) -> int | None:
    """Find a column of seconds before its nanoseconds; returns its index, None without one."""
    pairs = zip(titles, titles[1:], strict=False)
    found = (i for i, (x, y) in enumerate(pairs) if _SECONDS.fullmatch(f"{x} {y}"))
    return next(found, None)


def _join_seconds(line: str, separator: str, index: int) -> str:
    """Return a row in which seconds and the nanoseconds after them are one decimal number."""
    cells = line.split(separator, index + 2)
    if len(cells) < index + 2 or not cells[index + 1].strip().isdigit():
        # A later check of width or number raises the error.
        return line
    time = f"{cells[index].strip()}.{cells[index + 1].strip():0>9}"
    return separator.join([*cells[:index], time, *cells[index + 2 :]])


def _find_titles(lines: Sequence[str], count: int | None) -> int:
    """Find the line of titles, or the first line of numbers if `count` titles are known."""
    if count is not None:
        every = (re.split(r"\s*[,;\t]\s*|\s+", line.strip()) for line in lines)
        of_count = (len(x) == count and any(map(NUMBER.fullmatch, x)) for x in every)
        return next((k for k, sample in enumerate(of_count) if sample), 0)
    # The titles are the first line with as many cells as the first sample.
    for k, line in enumerate(lines[:MAX_SEARCHED_LINES]):
        separator = next((x for x in ";\t," if x in line), None)
        cells = _split_any(line, separator)
        if len(cells) > 1 and all(NUMBER.fullmatch(x.replace(",", ".")) for x in cells[:2]):
            counts = [len(_split_any(x, separator)) for x in lines[:k]]
            return counts.index(len(cells)) if len(cells) in counts else 0
    return 0


def _is_blank_separated(lines: Sequence[str]) -> bool:
    """Return whether the cells of the first lines are separated by blanks and not by commas."""
    words = [len(x.split()) for x in lines]
    return min(words) == max(words) > 1 and not any("," in _DECIMAL_COMMA.sub("", x) for x in lines)


def _split(line: str, separator: str | None) -> list[str]:
    """Split a line into cells without surrounding blanks; None: blanks separate the cells."""
    if separator is None or '"' not in line:
        # Most lines of large files have no blanks, so that stripping is not necessary.
        cells = line.split(separator)
        return cells if line.split() == [line] else [x.strip() for x in cells]
    # Lines are parsed separately, so that an unclosed quote does not include the next lines.
    return [x.strip() for x in next(csv.reader([line], delimiter=separator, strict=True))]


def _split_any(line: str, separator: str | None) -> list[str]:
    """Split a line above the rows; with wrong quotes, it is split at each separator."""
    try:
        return _split(line, separator)
    except csv.Error:
        return line.split(separator)


def rename(names: Sequence[str], pairs: str, source: str) -> tuple[str, ...]:
    """Rename columns or joints.

    Args:
        names: Present names.
        pairs: New names: `NEW=OLD`, separated by commas, such as `q1=axis_1`. In OLD, # matches a
            number and * any text; the same wildcard in NEW inserts the matched text, as in
            `q# [deg]=joint_#`.
        source: Name of the file, for messages.

    Raises:
        InvalidInput: A pair has another form, or a name does not exist.
    """
    renamed = list(names)
    for pair in pairs.split(","):
        new, _, old = map(str.strip, pair.partition("="))
        wild = [x for x in old if x in WILDCARDS]
        used = [x for x in new if x in WILDCARDS]
        if not (new and old) or (used and used != wild):
            raise InvalidInput(
                f"New names must have the form NEW=NAME, such as 't [ms]=time' or "
                f"'q# [deg]=joint_#', but one is {show(pair)}."
            )
        pattern = re.compile("".join(WILDCARDS.get(x) or re.escape(x) for x in old))
        matches = {i: x for i, name in enumerate(names) if (x := pattern.fullmatch(name))}
        if not matches:
            raise InvalidInput(
                f"{source} has no column or joint {show(old)} to rename. It has "
                f"{list_some([show(x) for x in names], MAX_NAMED)}."
            )
        for i, match in matches.items():
            parts = iter(match.groups())
            renamed[i] = "".join(next(parts) if x in WILDCARDS else x for x in new)
    return tuple(renamed)


def _read_titles(
    heading: _Heading,
    title_of: Callable[[str], Title[Key] | None],
    example: str,
    option: str,
    names: Sequence[str],
) -> tuple[dict[Key, CsvColumn], tuple[str, ...]]:
    """Recognize columns; returns them by quantity in their order, and titles of the others.

    `names`: as in `read_table`.
    """
    titles = heading.titles
    location = heading.location
    if len(titles) > 1 and all(map(NUMBER.fullmatch, titles[:2])):
        raise InvalidInput(
            f"{location}: the first line must name the columns, such as {example}. If the file has "
            f"no such line, name the columns ({option})."
        )
    recognised: dict[Key, CsvColumn] = {}
    unknown: list[str] = []
    ends = tuple(x for x in names if _BRACKETS.fullmatch(x))
    for index, title in enumerate(titles):
        match = None if title.endswith(ends) else _BRACKETS.fullmatch(title)
        name, unit = (match["name"], match["unit"]) if match else (title, None)
        content = title_of(name)
        if content is None:
            unknown += [title] * (title != SKIPPED)
            continue
        if unit is not None and content.unit is not None:
            raise InvalidInput(f"{location}: the column {show(title)} has two units. Remove one.")
        unit = content.unit if unit is None else unit
        factor = 1.0
        linear = False
        if unit is not None:
            factor, linear = _unit_factor(unit, content.si, title, location)
        column = CsvColumn(index, title, unit, factor, content.rank, linear)
        other = recognised.get(content.key)
        if other is not None and other.rank == column.rank:
            raise InvalidInput(
                f"{location}: the columns {show(other.title)} and {show(title)} have the same "
                f"quantity. Remove one (for example with {option} '{SKIPPED}={title}')."
            )
        if other is None or column.rank < other.rank:
            recognised[content.key] = column
        if other is not None:
            unknown.append(max(column, other, key=lambda x: x.rank).title)
    return recognised, tuple(unknown)


def title_pattern(title: str) -> str:
    """Replace the last number of a title by #, as in the option that renames columns."""
    return re.sub(r"\d+(?=\D*$)", "#", title)


def _unit_factor(unit: str, si: str | None, title: str, location: str) -> tuple[float, bool]:
    """Return the factor to the SI unit of a column, and whether it is that of prismatic joints."""
    plain = unit.strip().replace("²", "^2").replace("°", "deg")
    linear = si is not None and "rad" in si and not _ANGLE.search(plain)
    try:
        target = linear_unit(si or "") if linear else si
        factor = 0.0 if target is None else parse_quantity(f"1 {plain}", target)
    except ValueError:
        factor = 0.0
    if factor <= 0:
        expected = f"must be convertible to {si}" if si else "must be removed"
        raise InvalidInput(
            f"{location}: the unit {show(unit)} of the column {show(title)} {expected}."
        )
    return factor, linear
