"""Differences of two results: values, and times of active limits."""

from __future__ import annotations

from collections.abc import Iterator

from armcontour.core.render import figure, number
from armcontour.core.result import FIRST, TABLE, Data, Row, Table


def differences(one: Data, other: Data, names: tuple[str, str] = ("one", "other")) -> Table:
    """Table of main values and limit times: label, both values, and first minus second value."""
    columns = ("figure", *names, "difference")
    rows = [
        (before.label or after.label, figure(before), figure(after), _difference(before, after))
        for before, after in _pairs(one, other)
    ]
    return Table("differences", tuple(Row(x, None, "", x) for x in columns), rows, TABLE)


def _pairs(one: Data, other: Data) -> Iterator[tuple[Row, Row]]:
    """Yield pairs of rows: values with the same name, and times of the same active limit."""
    others = {x.name: x for x in other.shown(FIRST)}
    for row in one.shown(FIRST):
        if row.name in others:
            yield row, others[row.name]
    times = [
        {y["name"]: y["time"] for x in data.tables if x.name == "time" for y in x.as_dicts()}
        for data in (one, other)
    ]
    for name in dict.fromkeys([*times[0], *times[1]]):
        row, after = (Row(name, x.get(name, 0.0), "s", f"time: {name}") for x in times)
        yield row, after


def _difference(one: Row, other: Row) -> str:
    """Difference of two values with its sign; empty for texts, verdicts and unknown values."""
    before, after = one.figure, other.figure
    if any(isinstance(x, bool | str) or x is None for x in (before, after)):
        return ""
    return f"{'+' if before > after else ''}{number(before - after, one.unit)}"
