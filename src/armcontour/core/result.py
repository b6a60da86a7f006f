"""`Data`: values, tables and sentences of a result in SI units, for all outputs."""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

# Levels of a row: shown as verdict, on the first screen, in tables and in print, or only in files.
VERDICT, FIRST, TABLE, FILE = range(4)
# Unit of verdicts, which are shown as "kept" or "NOT KEPT".
JUDGED = "verdict"


@dataclass(frozen=True, slots=True)
class Row:
    """One value of a result, with its name, label and unit.

    Args:
        name: Key in JSON and column in batches; "contour_error.rms" is the key `rms` in the mapping
            `contour_error`.
        value: A number, text, True or False; numbers per joint or per name, of which the largest is
            shown; or several texts. None if unknown.
        unit: SI unit, "1" for a fraction, "" for a count, `JUDGED` for a verdict. If joints have
            different units, one unit per value, separated by ", ".
        label: Displayed name; "" for a value that is only written to files.
        note: Further information, such as the time or the joint.
        level: Where the value is shown: `VERDICT`, `FIRST`, `TABLE` or `FILE`.
        decimals: Decimals of a displayed time in s; None for three significant digits.
        holds: For what the value holds, such as "as modelled"; empty if its table says it.
    """

    name: str
    value: Any
    unit: str = ""
    label: str = ""
    note: str = ""
    level: int = TABLE
    decimals: int | None = None
    holds: str = ""

    @property
    def figure(self) -> Any:
        """The displayed value: the largest of several numbers, all texts; None if there is none."""
        value = self.value
        if isinstance(value, Mapping):
            value = list(value.values())
        if isinstance(value, str | bool) or not hasattr(value, "__len__"):
            return value
        if len(value) and isinstance(value[0], str):
            return ", ".join(value)
        return None if len(value) == 0 else float(np.max(value))


def with_decimals(rows: Iterable[Row], decimals: int | None) -> tuple[Row, ...]:
    """Copy rows and limit the decimals with which their times are displayed."""
    return tuple(replace(x, decimals=decimals) if x.unit == "s" else x for x in rows)


def nest(values: Iterable[tuple[str, Any]]) -> dict[str, Any]:
    """Nest values with dotted names: "error.max" becomes the key `max` in the mapping `error`.

    >>> nest([("error.max", 2.0), ("error.rms", 1.0)])
    {'error': {'max': 2.0, 'rms': 1.0}}
    """
    nested: dict[str, Any] = {}
    for name, value in values:
        *path, key = name.split(".")
        inner = nested
        for part in path:
            inner = inner.setdefault(part, {})
        inner[key] = value
    return nested


@dataclass(frozen=True, slots=True)
class Table:
    """Items of one kind, such as corners or moves.

    Args:
        name: Key in JSON, and caption.
        columns: Name, unit and label of each column, as rows without values; names as in `Row`.
        rows: The values, in the order of the columns; a value that is a `Row` has its own unit and
            note.
        level: Where the table is shown: `VERDICT`, `FIRST`, `TABLE` or `FILE`.
    """

    name: str
    columns: tuple[Row, ...]
    rows: Sequence[Sequence[Any]]
    level: int = FILE

    def as_dicts(self, maximum: int | None = None) -> list[dict[str, Any]]:
        """Return the rows as mappings from column names to values."""
        names = [x.name for x in self.columns]
        mappings = []
        for row in self.rows[:maximum]:
            values = [x.value if isinstance(x, Row) else x for x in row]
            mappings.append(nest(zip(names, values, strict=True)))
        return mappings

    @staticmethod
    def from_rows(name: str, rows: Sequence[Sequence[Row]]) -> Table:
        """Make a table of rows with equal columns; an empty table is hidden."""
        return Table(name, tuple(rows[0]) if rows else (), rows, TABLE if rows else FILE)

    @staticmethod
    def from_results(name: str, results: Sequence[Data], level: int = TABLE) -> Table:
        """Make a table with one result per row; only columns up to `FIRST` are shown."""
        columns: tuple[Row, ...] = ()
        if results:
            columns = tuple(
                replace(x, value=None, label=x.label if x.level <= FIRST else "")
                for x in results[0].rows
            )
        return Table(name, columns, [[x.value for x in data.rows] for data in results], level)


@dataclass(frozen=True, slots=True)
class Data:
    """Values, tables and sentences of a result.

    Args:
        title: Title of the result.
        rows: Values, the most important first.
        tables: Tables, in the order in which they are shown.
        parts: Partial results, by their keys in JSON.
        notes: Sentences that explain values.
        warnings: Sentences on limitations, the most severe first.
        not_proven: Sentence that ends the result: what it does not prove; empty for a part.
    """

    title: str
    rows: tuple[Row, ...] = ()
    tables: tuple[Table, ...] = ()
    parts: Mapping[str, Data] = field(default_factory=dict)
    notes: tuple[str, ...] = ()
    warnings: tuple[str, ...] = ()
    not_proven: str = ""

    def __getitem__(self, name: str) -> Row:
        """Return the row with this name; "part.row" is the name of a row in a part."""
        for key, row in self.walk():
            if key == name:
                return row
        raise KeyError(name)

    def with_prefix(self, name: str, level: int | None = None) -> tuple[Row, ...]:
        """Copy the rows with a prefix and a point before their names."""
        return tuple(
            replace(x, name=f"{name}.{x.name}", level=x.level if level is None else level)
            for x in self.rows
        )

    def walk(self) -> Iterator[tuple[str, Row]]:
        """Yield all rows with their names, including the rows of parts."""
        for row in self.rows:
            yield row.name, row
        for key, part in self.parts.items():
            for name, row in part.walk():
                yield f"{key}.{name}", row

    def shown(self, level: int = TABLE) -> tuple[Row, ...]:
        """Return rows with a label and a value, up to a level; those of lower levels first."""
        rows = (replace(row, name=name) for name, row in self.walk())
        labelled = (x for x in rows if x.label and x.level <= level and x.figure is not None)
        return tuple(sorted(labelled, key=lambda x: x.level))
